//! A server that is gone without a word.

use std::sync::Arc;
use std::time::Duration;

use lodestream_client::core::{ClientCore, Config, Progress, StartView};
use lodestream_client::net::{Clock, Host, WebSocketConnection, run_quic, run_websocket};
use lodestream_netsim::clock::virtual_runtime;
use lodestream_protocol::time::Time;
use lodestream_server::daemon::memory_scene::MemoryScene;
use lodestream_server::daemon::{ServerState, SessionSettings};

use crate::support::virtual_link::{QuicLink, cut_after, tcp_with_rate};

const RATE_BITS_PER_S: u64 = 2_000_000;
const RTT_MS: u64 = 50;
/// When the server vanishes: while all is quiet, long after everything has come.
const CUT_MS: u64 = 20_000;

/// Looks after the session as a viewer does, until it has been silent for a while.
struct Watching {
    core: ClientCore,
    /// From when on the silence is told, if it is.
    told: Option<Time>,
    /// Told, and then not any more.
    false_alarms: u32,
}

impl Watching {
    fn new() -> Self {
        let config = Config::new(StartView::OfScene { viewport_px: [320, 180], target_px: 1.0 });
        Self { core: ClientCore::new(config), told: None, false_alarms: 0 }
    }

    fn check(&self, what: &str) {
        let told = Duration::from(self.told.expect("the silence is told")).as_secs_f64();
        let cut = CUT_MS as f64 / 1e3;
        println!("{what}: told {:.3} s after the last word", told - cut);
        assert!(told >= cut && told <= cut + 2.0, "{what}: told after {told} s");
        assert_eq!(self.false_alarms, 0, "{what}");
    }
}

impl Host for Watching {
    fn core(&mut self) -> &mut ClientCore {
        &mut self.core
    }

    fn turn(&mut self, now: Time) -> Progress {
        let progress = self.core.update(now, u64::MAX);
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

fn state() -> Arc<ServerState> {
    ServerState::new(Arc::new(MemoryScene::new(1, 1500, 20_000)), SessionSettings::default())
}

/// Over QUIC it took more than ten seconds until anybody was told.
#[test]
fn a_server_that_vanishes_is_told_within_two_seconds_over_quic() {
    let mut host = Watching::new();
    virtual_runtime().unwrap().block_on(async {
        let link = QuicLink::with_rate(state(), cut_after(CUT_MS, RATE_BITS_PER_S), RTT_MS);
        run_quic(link.connect().await, &mut host, Clock::start()).await;
    });
    host.check("QUIC");
}

#[test]
fn a_server_that_vanishes_is_told_within_two_seconds_over_websocket() {
    let mut host = Watching::new();
    virtual_runtime().unwrap().block_on(async {
        let (stream, _) = tcp_with_rate(state(), cut_after(CUT_MS, RATE_BITS_PER_S), RTT_MS).await;
        let limit = Duration::from_secs(4);
        let opened = WebSocketConnection::open(stream, "10.0.0.1:80", limit).await.unwrap();
        run_websocket(opened, &mut host, Clock::start()).await;
    });
    host.check("WebSocket");
}
