//! Clients that reconnect without a pause.

use super::*;
use crate::limits::session_rate::SessionRateLimit;

fn from(n: u8) -> SocketAddr {
    SocketAddr::from((Ipv4Addr::new(10, 0, 0, n), 50_000))
}

/// Opens and closes a session; fails with the client's error.
async fn connect_and_close(peer: SocketAddr, state: &Arc<ServerState>) -> Result<(), String> {
    drop(Client::from(peer, state).await?);
    state.all_sessions_ended().await;
    Ok(())
}

#[tokio::test(start_paused = true)]
async fn an_address_that_reconnects_without_a_pause_is_refused() {
    let settings = SessionSettings { max_sessions: 64, ..SessionSettings::default() };
    let state = ServerState::new(Arc::new(MemoryScene::new(1, 100, 100)), settings);
    let began = tokio::time::Instant::now();
    let mut taken = 0;
    let refused = loop {
        match connect_and_close(from(1), &state).await {
            Ok(()) => taken += 1,
            Err(why) => break why,
        }
        assert!(taken < 1000, "never refused");
    };
    // One more per quarter of a second; a session takes some milliseconds.
    let earned = 1 + usize::try_from(began.elapsed().as_millis() / 250).unwrap();
    assert!((32..=32 + earned).contains(&taken), "{taken}");
    assert!(refused.contains("503"), "{refused}");
    let text = state.render_metrics();
    assert!(text.contains("lodestream_sessions_refused_total{reason=\"rate\"} 1\n"), "{text}");
    connect_and_close(from(2), &state).await.unwrap();
    // After a pause sessions are admitted again; refused attempts take no tokens.
    for _ in 0..20 {
        assert!(connect_and_close(from(1), &state).await.is_err());
    }
    tokio::time::sleep(Duration::from_millis(250)).await;
    connect_and_close(from(1), &state).await.unwrap();
}

#[tokio::test(start_paused = true)]
async fn an_address_may_start_all_its_sessions_at_once() {
    for (places, new, taken) in [(100, None, 100), (100, Some("7".parse().unwrap()), 7)] {
        let settings = SessionSettings {
            max_sessions_per_address: Some(places),
            new_sessions_per_address: new,
            ..SessionSettings::default()
        };
        let state = ServerState::new(Arc::new(MemoryScene::new(1, 100, 100)), settings);
        let mut clients = Vec::new();
        while let Ok(client) = Client::from(from(1), &state).await {
            clients.push(client);
        }
        assert_eq!(clients.len(), taken);
    }
    let settings = SessionSettings {
        new_sessions_per_address: Some(SessionRateLimit::Unlimited),
        ..SessionSettings::default()
    };
    let state = ServerState::new(Arc::new(MemoryScene::new(1, 100, 100)), settings);
    for _ in 0..200 {
        connect_and_close(from(1), &state).await.unwrap();
    }
}
