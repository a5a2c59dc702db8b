//! How much is sent in how long.

use super::*;
use crate::message::{ClientMessage, Want};

#[test]
fn every_window_of_a_saturated_session_is_within_five_percent_of_the_rate() {
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
            assert!((0.95..=1.05).contains(&ratio), "{rate} Mbit/s from {start} ms: {ratio}");
        }
    }
}

#[test]
fn ceilings_are_shared_fairly() {
    let scene = MemoryScene::new(1, 1, 6);
    let ceiling = crate::limiter::SharedCeiling::new(4 * MBIT);
    let mut sessions: Vec<_> = (0..4)
        .map(|_| {
            let mut server = session(&scene, ServerConfig::quic(Some(16 * MBIT)));
            server.set_ceiling(ceiling.join());
            server.handle_message(Time::ZERO, ClientMessage::Hello(hello(&scene.header)));
            let wants = (0..1000).map(|c| Want::whole(BlobId::chunk(0, c), 3)).collect();
            server.handle_message(Time::ZERO, ClientMessage::Want(wants));
            server
        })
        .collect();
    for ms in 0..1000 {
        for server in &mut sessions {
            drain(server, Time::from_ms(ms));
        }
    }
    let sent: Vec<u64> = sessions.iter().map(|s| s.stats().wire_bytes).collect();
    for bytes in &sent {
        assert!((110_000..150_000).contains(bytes), "{sent:?}");
    }
}
