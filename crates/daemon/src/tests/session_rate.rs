//! Clients that come, go and come again without a pause.

use super::*;
use crate::admission::session_rate::SessionRateLimit;

fn from(n: u8) -> SocketAddr {
    SocketAddr::from((Ipv4Addr::new(10, 0, 0, n), 50_000))
}

/// A session that is over as soon as it has begun; fails with what its client is told.
async fn come_and_go(peer: SocketAddr, state: &Arc<ServerState>) -> Result<(), String> {
    drop(Client::from(peer, state).await?);
    state.all_sessions_ended().await;
    Ok(())
}

#[tokio::test(start_paused = true)]
async fn an_address_that_came_and_went_without_a_pause_was_never_refused() {
    let settings = SessionSettings { max_sessions: 64, ..SessionSettings::default() };
    let state = ServerState::new(Arc::new(MemoryScene::new(1, 100, 100)), settings);
    let began = tokio::time::Instant::now();
    let mut taken = 0;
    let refused = loop {
        match come_and_go(from(1), &state).await {
            Ok(()) => taken += 1,
            Err(why) => break why,
        }
        assert!(taken < 1000, "nobody is refused");
    };
    // A quarter of a second brings one more; a session takes some milliseconds.
    let earned = 1 + usize::try_from(began.elapsed().as_millis() / 250).unwrap();
    assert!((32..=32 + earned).contains(&taken), "{taken}");
    assert!(refused.contains("503"), "{refused}");
    let text = state.render_metrics();
    assert!(text.contains("lodestream_sessions_refused_total{reason=\"rate\"} 1\n"), "{text}");
    come_and_go(from(2), &state).await.unwrap();
    // Who waits is taken again, and being refused costs nothing.
    for _ in 0..20 {
        assert!(come_and_go(from(1), &state).await.is_err());
    }
    tokio::time::sleep(Duration::from_millis(250)).await;
    come_and_go(from(1), &state).await.unwrap();
}

#[tokio::test(start_paused = true)]
async fn as_many_as_an_address_may_have_may_come_at_once() {
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
        come_and_go(from(1), &state).await.unwrap();
    }
}
