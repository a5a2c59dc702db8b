//! Many sessions in sequence: the server's tables must not grow.

use super::*;

/// Address of the n-th client; each is a network of its own.
fn from(n: u32) -> SocketAddr {
    SocketAddr::from((Ipv4Addr::from_bits(0x0a00_0000 + n), 50_000))
}

/// A session that ends with `Bye`, without it, or without `Hello`.
async fn one_session(n: u32, state: &Arc<ServerState>) {
    let mut client = Client::from(from(n), state).await.unwrap();
    match n % 4 {
        // Longer than the time limit for `Hello`.
        0 => tokio::time::sleep(Duration::from_secs(11)).await,
        1 => client.send(&hello()).await,
        _ => {
            client.send(&hello()).await;
            client.send(&want_textures(1)).await;
            client.read_blobs(1).await;
            if n % 4 == 2 {
                client.send(&ClientMessage::Bye).await;
            }
        }
    }
    drop(client);
    state.all_sessions_ended().await;
}

#[tokio::test(start_paused = true)]
async fn hours_of_sessions_leave_no_entries_behind() {
    let state = state_of(MemoryScene::new(2, 300, 500), None);
    let began = tokio::time::Instant::now();
    let mut after_first = None;
    for n in 0..1000 {
        one_session(n, &state).await;
        // Longer than any of them takes, including the close.
        tokio::time::sleep_until(began + Duration::from_secs(14) * (n + 1)).await;
        let entries = state.entries();
        let [leases, buckets, pre_auth, requests] = entries;
        assert_eq!((leases, pre_auth, requests), (0, 0, 0), "after {n} sessions");
        assert_eq!(buckets, *after_first.get_or_insert(buckets), "after {n} sessions");
    }
    assert!(began.elapsed() >= Duration::from_secs(3600));
    assert_eq!(after_first, Some(1), "the last one's");
    let text = state.render_metrics();
    assert!(text.contains("lodestream_sessions_total{transport=\"ws\"} 1000\n"), "{text}");
    assert!(text.contains("lodestream_queued_bytes 0\n"), "{text}");
}
