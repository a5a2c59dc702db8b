//! Bytes on the wire against the rate limit.

use std::sync::Arc;
use std::time::Duration;

use lodestream_daemon::{MemoryScene, ServerState, SessionSettings, TEXTURE_LEVELS};
use lodestream_netsim::clock::virtual_runtime;
use lodestream_protocol::message::ClientMessage;
use lodestream_scene::BlobId;

use crate::support::raw::{RawClient, RawQuic, RawWebSocket, hello, want};
use crate::support::virtual_link::{QuicLink, tcp_connect};

const RATE_BITS_PER_S: u64 = 2_000_000;
const TICK: Duration = Duration::from_millis(100);
const WINDOW: Duration = Duration::from_secs(3);
const DURATION: Duration = Duration::from_secs(12);
const ASSETS: u32 = 4;

/// A daemon with 32 blobs of 200 kB: more than can be sent while the test runs.
fn state() -> Arc<ServerState> {
    let settings = SessionSettings { rate_bits_per_s: Some(RATE_BITS_PER_S), ..SessionSettings::default() };
    ServerState::new(Arc::new(MemoryScene::new(ASSETS, 1500, 200_000)), settings)
}

/// Requests everything and records the bytes on the wire at every tick.
async fn sample(mut client: impl RawClient, wire_bytes: impl Fn() -> u64) -> Vec<u64> {
    client.send(&ClientMessage::Hello(hello())).await;
    let levels = |asset| (0..TEXTURE_LEVELS).map(move |level| BlobId::texture(asset, 0, level));
    client.send(&want((0..ASSETS).flat_map(levels))).await;
    let mut samples = Vec::new();
    let mut ticks = tokio::time::interval(TICK);
    while samples.len() * TICK.as_millis() as usize <= DURATION.as_millis() as usize {
        tokio::select! {
            biased;
            _ = ticks.tick() => samples.push(wire_bytes()),
            arrival = client.next() => assert!(arrival.is_some(), "the session has ended"),
        }
    }
    samples
}

fn assert_windows(name: &str, samples: &[u64]) {
    let span = (WINDOW.as_millis() / TICK.as_millis()) as usize;
    let expected = RATE_BITS_PER_S as f64 / 8.0 * WINDOW.as_secs_f64();
    let ratios = samples.windows(span + 1).map(|w| (w[span] - w[0]) as f64 / expected);
    let (low, high) = ratios.fold((f64::MAX, 0.0_f64), |(low, high), r| (low.min(r), high.max(r)));
    println!("{name}: {low:.4} to {high:.4} of the rate in every window of 3 s");
    assert!(low >= 0.95 && high <= 1.05, "{name}: {low} to {high} of the rate");
}

/// Checks the limiter's accounting: packets of quinn, headers included, over a link far faster than the limit.
#[test]
fn quic_keeps_to_the_rate_on_the_wire() {
    let samples = virtual_runtime().unwrap().block_on(async {
        let link = QuicLink::new(state(), 1_000_000_000, 20);
        let client = RawQuic::new(link.connect().await);
        sample(client, || link.wire_bytes()).await
    });
    assert_windows("QUIC", &samples);
}

/// The same for TCP segments.
#[test]
fn websocket_keeps_to_the_rate_on_the_wire() {
    let samples = virtual_runtime().unwrap().block_on(async {
        let (stream, wire) = tcp_connect(state(), 1_000_000_000, 20).await;
        sample(RawWebSocket::open(stream).await, || wire.wire_bytes()).await
    });
    assert_windows("WebSocket", &samples);
}
