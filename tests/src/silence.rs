//! A server that vanishes without a message.

use std::sync::Arc;
use std::time::Duration;

use lodestream_client::core::{ClientCore, Config, Progress, StartView, Stats};
use lodestream_client::net::{Clock, Host, WebSocketConnection, run_quic, run_websocket};
use lodestream_daemon::{MemoryScene, ServerState, SessionSettings};
use lodestream_netsim::clock::virtual_runtime;
use lodestream_protocol::time::Time;

use crate::support::scene::TestScene;
use crate::support::virtual_link::{QuicLink, cut_after, tcp_with_rate};

const RATE_BITS_PER_S: u64 = 2_000_000;
const RTT_MS: u64 = 50;
/// When the server vanishes: long after everything has arrived.
const QUIET_MS: u64 = 20_000;
/// When it vanishes while chunks stream, over a link on which they take seconds.
const STREAMING_MS: u64 = 1_500;
const STREAMING_BITS_PER_S: u64 = 200_000;

/// A client that records what the viewer would report, until the server has been silent for a while.
struct Watching {
    core: ClientCore,
    cut: Duration,
    /// The session's status when the server vanishes.
    at_cut: Option<Stats>,
    /// When the silence was reported, if it was.
    told: Option<Time>,
    /// Number of reports that were withdrawn.
    false_alarms: u32,
}

impl Watching {
    fn new(cut_ms: u64) -> Self {
        let config = Config::new(StartView::OfScene { viewport_px: [320, 180], target_px: 0.05 });
        let cut = Duration::from_millis(cut_ms);
        Self { core: ClientCore::new(config), cut, at_cut: None, told: None, false_alarms: 0 }
    }

    fn check(&self, what: &str) {
        let told = Duration::from(self.told.expect("the silence was not reported")).as_secs_f64();
        let cut = self.cut.as_secs_f64();
        println!("{what}: reported {:.3} s after the last message", told - cut);
        assert!(told >= cut && told <= cut + 2.0, "{what}: reported after {told} s");
        assert_eq!(self.false_alarms, 0, "{what}");
    }

    /// Whether chunks were arriving when the server vanished.
    fn check_streaming(&self, what: &str) {
        let Stats { applied_chunks, wanted_chunks, settled, ref counters, .. } =
            *self.at_cut.as_ref().expect("the server has not vanished");
        println!("{what}: {applied_chunks} chunks were applied, {wanted_chunks} more were wanted");
        assert!(applied_chunks > 0 && wanted_chunks > 2 && !settled, "{what}: nothing streamed");
        assert!(counters.missing_bytes > 5000, "{what}: nothing was left to send");
    }
}

impl Host for Watching {
    fn core(&mut self) -> &mut ClientCore {
        &mut self.core
    }

    fn turn(&mut self, now: Time) -> Progress {
        let progress = self.core.update(now, u64::MAX);
        if Duration::from(now) >= self.cut && self.at_cut.is_none() {
            self.at_cut = Some(self.core.stats());
        }
        if self.core.silence(now).is_some() {
            self.told.get_or_insert(now);
        } else if self.told.take().is_some() {
            self.false_alarms += 1;
        }
        progress
    }

    async fn wake(&mut self) {
        tokio::time::sleep(Duration::from_millis(50)).await;
    }

    fn wants_to_leave(&self) -> bool {
        self.told.is_some()
    }
}

/// A scene that arrives completely within seconds.
fn quiet() -> Arc<ServerState> {
    ServerState::new(Arc::new(MemoryScene::new(1, 1500, 20_000)), SessionSettings::default())
}

/// A scene of meshes whose chunks take seconds. The server's rate limit matches the link.
fn meshes() -> Arc<ServerState> {
    let settings = SessionSettings {
        rate_bits_per_s: Some(STREAMING_BITS_PER_S * 9 / 10),
        ..SessionSettings::default()
    };
    ServerState::new(TestScene::small().source(), settings)
}

/// Runs a session over QUIC until the server has vanished.
fn over_quic(state: impl FnOnce() -> Arc<ServerState>, cut_ms: u64, rate_bits_per_s: u64) -> Watching {
    let mut host = Watching::new(cut_ms);
    virtual_runtime().unwrap().block_on(async {
        let link = QuicLink::with_rate(state(), cut_after(cut_ms, rate_bits_per_s), RTT_MS);
        run_quic(link.connect().await, &mut host, Clock::start()).await;
    });
    host
}

/// The same over WebSocket.
fn over_websocket(state: impl FnOnce() -> Arc<ServerState>, cut_ms: u64, rate_bits_per_s: u64) -> Watching {
    let mut host = Watching::new(cut_ms);
    virtual_runtime().unwrap().block_on(async {
        let (stream, _) = tcp_with_rate(state(), cut_after(cut_ms, rate_bits_per_s), RTT_MS).await;
        let limit = Duration::from_secs(4);
        let opened = WebSocketConnection::open(stream, "10.0.0.1:80", limit).await.unwrap();
        run_websocket(opened, &mut host, Clock::start()).await;
    });
    host
}

/// QUIC itself detects the silence only after ten seconds.
#[test]
fn a_vanished_server_is_reported_within_two_seconds_over_quic() {
    over_quic(quiet, QUIET_MS, RATE_BITS_PER_S).check("QUIC");
}

#[test]
fn a_vanished_server_is_reported_within_two_seconds_over_websocket() {
    over_websocket(quiet, QUIET_MS, RATE_BITS_PER_S).check("WebSocket");
}

#[test]
fn a_server_that_vanishes_while_streaming_is_reported_as_soon_over_quic() {
    let host = over_quic(meshes, STREAMING_MS, STREAMING_BITS_PER_S);
    host.check_streaming("QUIC");
    host.check("QUIC, while chunks stream");
}

#[test]
fn a_server_that_vanishes_while_streaming_is_reported_as_soon_over_websocket() {
    let host = over_websocket(meshes, STREAMING_MS, STREAMING_BITS_PER_S);
    host.check_streaming("WebSocket");
    host.check("WebSocket, while chunks stream");
}
