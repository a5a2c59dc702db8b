use lodestream_protocol::message::CloseCode;

use super::*;

#[tokio::test(start_paused = true)]
async fn a_client_that_floods_is_closed() {
    let state = state_of(MemoryScene::new(1, 100, 100), None);
    let client = Client::in_memory(&state).await;
    let (mut sink, stream) = client.0.split();
    let flood = tokio::spawn(async move {
        let hello = encode_client(&hello()).unwrap();
        let _ = sink.send(Message::Binary(hello.into())).await;
        for _ in 0..100_000 {
            let view = encode_client(&ClientMessage::Cancel(Vec::new())).unwrap();
            if sink.send(Message::Binary(view.into())).await.is_err() {
                break;
            }
        }
    });
    let close = stream
        .filter_map(|message| async {
            let Ok(Message::Binary(bytes)) = message else { return None };
            match Frame::parse(bytes).unwrap().into_server_frame().unwrap() {
                Some(ServerFrame::Message(ServerMessage::Close(close))) => Some(close),
                _ => None,
            }
        })
        .boxed()
        .next()
        .await
        .unwrap();
    assert_eq!(close.code, CloseCode::Limit);
    flood.await.unwrap();
    state.all_sessions_ended().await;
}

#[tokio::test(start_paused = true)]
async fn a_client_that_takes_nothing_is_closed() {
    let state = state_of(MemoryScene::new(1, 100, 1_000_000), None);
    let mut stuck = Client::in_memory(&state).await;
    stuck.send(&hello()).await;
    stuck.send(&want_textures(1)).await;
    // The in-memory stream holds 64 KiB; then nothing moves. Pings keep it from being idle.
    let started = tokio::time::Instant::now();
    for nonce in 0..1000 {
        tokio::time::sleep(Duration::from_secs(1)).await;
        let ping = encode_client(&ClientMessage::Ping(nonce)).unwrap();
        if stuck.0.send(Message::Binary(ping.into())).await.is_err() {
            break;
        }
        if state.metrics().active_sessions() == 0 {
            break;
        }
    }
    assert!(started.elapsed() < Duration::from_secs(60), "{:?}", started.elapsed());
    state.all_sessions_ended().await;
}
