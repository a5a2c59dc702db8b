//! Sending rates over time.

use super::*;
use crate::message::{ClientMessage, Want};
use crate::shared_rate_limit::{Limits, SharedRateLimit, Weight};

#[test]
fn every_window_of_a_saturated_session_is_within_two_percent_of_the_rate() {
    let scene = MemoryScene::new(3, 1, 7);
    for rate in [2, 8, 16] {
        let mut server = session(&scene, ServerConfig::quic(Some(rate * MBIT)));
        server.handle_message(Time::ZERO, ClientMessage::Hello(hello(&scene.header)));
        let chunks = (0..3).flat_map(|a| (0..5461).map(move |c| BlobId::chunk(a, c)));
        let mut chunks = chunks.cycle();
        let mut sent = Vec::new();
        let mut now = Time::ZERO;
        while now < Time::from_ms(8000) {
            if server.requests.scheduler.queued() < 500 {
                let ids: Vec<_> = chunks.by_ref().take(900).collect();
                server.handle_message(now, ClientMessage::Cancel(ids.clone()));
                let wants = ids.iter().map(|&id| Want::whole(id, 5)).collect();
                server.handle_message(now, ClientMessage::Want(wants));
            }
            let before = server.stats().wire_bytes;
            drain(&mut server, now);
            sent.push((now, server.stats().wire_bytes - before));
            let at = server.poll_timeout().unwrap();
            // Drivers wake up late, in whole milliseconds.
            now = Time::from_ms(at.as_ns() / 1_000_000 + 1);
        }
        for start in (500..4900).step_by(61) {
            let window = Time::from_ms(start)..Time::from_ms(start + 3000);
            let bits: u64 = sent.iter().filter(|(at, _)| window.contains(at)).map(|(_, b)| b * 8).sum();
            let ratio = bits as f64 / (3 * rate * MBIT) as f64;
            assert!((0.98..=1.02).contains(&ratio), "{rate} Mbit/s from {start} ms: {ratio}");
        }
    }
}

#[test]
fn shared_limits_are_fair_across_transports() {
    let scene = MemoryScene::new(1, 1, 6);
    let shared_rate_limit =
        SharedRateLimit::new(Limits { total_bits_per_s: Some(4 * MBIT), group_bits_per_s: None });
    let mut sessions: Vec<_> = (0..4)
        .map(|n| {
            let rate = Some(16 * MBIT);
            let config = if n % 2 == 0 { ServerConfig::quic(rate) } else { ServerConfig::websocket(rate) };
            let mut server = session(&scene, config);
            // Their clocks began a second after the shared rate limit's.
            server.set_shared_rate_limit(shared_rate_limit.join(Some(n), Weight::ONE, Time::from_ms(1000)));
            server.handle_message(Time::ZERO, ClientMessage::Hello(hello(&scene.header)));
            let wants = (0..1000).map(|c| Want::whole(BlobId::chunk(0, c), 3)).collect();
            server.handle_message(Time::ZERO, ClientMessage::Want(wants));
            server
        })
        .collect();
    let mut sent_until = |until_ms: std::ops::Range<u64>| -> Vec<u64> {
        for ms in until_ms {
            for server in &mut sessions {
                drain(server, Time::from_ms(ms));
            }
        }
        sessions.iter().map(|s| s.stats().wire_bytes).collect()
    };
    // The first is alone for a moment, and has the burst of all.
    let (before, after) = (sent_until(0..100), sent_until(100..900));
    for (before, after) in before.iter().zip(&after) {
        // A piece of WebSocket's is 3 %.
        assert!((97_000..=103_000).contains(&(after - before)), "{before} {after}");
    }
}
