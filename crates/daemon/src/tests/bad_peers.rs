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
async fn a_client_that_reads_nothing_is_closed() {
    let state = state_of(MemoryScene::new(1, 100, 1_000_000), None);
    let mut stuck = Client::requesting_textures(&state).await;
    // The in-memory stream holds 64 KiB; then writes block. Pings keep the session from being idle.
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

/// Close reason for a client that repeats `bytes`, up to `most` bytes in all.
async fn close_of_flood(
    start: &[u8],
    bytes: &[u8],
    most: usize,
) -> Option<lodestream_protocol::message::Close> {
    use tokio::io::AsyncWriteExt as _;
    let state = state_of(MemoryScene::new(1, 100, 100), None);
    let mut client = Client::in_memory(&state).await;
    client.send(&hello()).await;
    let many = bytes.repeat(4096 / bytes.len());
    let stream = client.0.get_mut();
    stream.write_all(start).await.unwrap();
    let mut sent = 0;
    while sent < most && stream.write_all(&many).await.is_ok() {
        sent += many.len();
    }
    let closing = tokio::time::timeout(Duration::from_secs(1), client.read_until_close());
    closing.await.ok()
}

#[tokio::test(start_paused = true)]
async fn frames_that_are_not_messages_are_counted() {
    // Masked as a client's frames, with a mask of zeros.
    let ping = [0x89, 0x80, 0, 0, 0, 0];
    let unknown_but_optional = [0x82, 0x82, 0, 0, 0, 0, 0xbf, 0];
    let first_fragment = [0x02, 0x80, 0, 0, 0, 0];
    let empty_fragment = [0x00, 0x80, 0, 0, 0, 0];
    for (what, start, frame) in [
        ("pings", &[][..], &ping[..]),
        ("unknown messages", &[], &unknown_but_optional),
        ("fragments", &first_fragment, &empty_fragment),
    ] {
        let close = close_of_flood(start, frame, 4 << 20).await.unwrap_or_else(|| panic!("{what}: no close"));
        assert_eq!(close.code, CloseCode::Limit, "{what}: {close}");
        assert!(
            close.reason.contains("too many messages") || close.reason.contains("256 KiB"),
            "{what}: {close}"
        );
    }
}
