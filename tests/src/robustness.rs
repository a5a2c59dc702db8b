//! Killed clients and servers, and reconnection.

use std::sync::Arc;
use std::time::Duration;

use lodestream_client::core::{Change, ClientCore};
use lodestream_client::net::{Address, Clock, Host, Retry, stream};
use lodestream_daemon::SessionSettings;
use lodestream_protocol::server::ServerConfig;
use tokio::sync::Notify;

use crate::support::LIMIT;
use crate::support::daemon::{Server, Transport};
use crate::support::scene::TestScene;
use crate::support::viewer::{Viewer, config};

/// Slow enough that a scene of some 40 kB takes a second or two, so that a session can be interrupted half-way.
const SLOW: SessionSettings = SessionSettings {
    rate_bits_per_s: Some(300_000),
    rate_per_address_bits_per_s: None,
    total_rate_bits_per_s: None,
    max_sessions: 10,
    max_sessions_per_address: Some(10),
    new_sessions_per_address: None,
    drain: Duration::from_secs(3),
};

/// Chunks that a client has when its server is killed: more than may be sent again before its inventory is known.
const MANY: u64 = 18;

fn number(metrics: &str, name: &str) -> u64 {
    let line = metrics.lines().find_map(|line| line.strip_prefix(name)?.strip_prefix(' '));
    line.unwrap_or_else(|| panic!("no {name} in {metrics}")).trim().parse().unwrap()
}

fn blobs_sent(server: &Server, kind: &str) -> u64 {
    number(&server.metrics(), &format!("lodestream_sent_total{{kind=\"{kind}\"}}"))
}

/// A client that reports its first chunk.
struct UntilFirstChunk {
    core: ClientCore,
    has_chunk: Arc<Notify>,
}

impl Host for UntilFirstChunk {
    fn core(&mut self) -> &mut ClientCore {
        &mut self.core
    }

    fn turn(&mut self, now: lodestream_protocol::Time) -> lodestream_client::core::Progress {
        let progress = self.core.update(now, u64::MAX);
        if self.core.stats().applied_chunks > 0 {
            self.has_chunk.notify_one();
        }
        progress
    }
}

/// Runs a client until it has its first chunk, then kills it: its runtime stops and its sockets close without a
/// message.
fn run_and_kill(address: &Address) {
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().unwrap();
    let has_chunk = Arc::new(Notify::new());
    let mut host = UntilFirstChunk { core: ClientCore::new(config()), has_chunk: has_chunk.clone() };
    let retry = Retry { first_attempts: 3, first_within: Duration::MAX, reconnect: false };
    let server = address.clone().into();
    runtime.block_on(async {
        tokio::select! {
            biased;
            () = has_chunk.notified() => {}
            end = stream(&server, &mut host, Clock::start(), retry, |_, _| {}) => panic!("{end:?}"),
            () = tokio::time::sleep(LIMIT) => panic!("no chunk came"),
        }
    });
    assert!(!host.core.is_settled(), "the client must be killed before it has settled");
}

/// Checks that a vanished client affects neither other sessions nor the server.
#[test]
fn a_killed_client_affects_no_other_session() {
    let scene = TestScene::small();
    for transport in Transport::BOTH {
        let server = Server::start(scene.source(), SLOW);
        let mut other = Viewer::start(&server.address(transport), config());
        other.wait("a first frame", |s| s.stats.milestones.first_frame.is_some());
        run_and_kill(&server.address(transport));
        server.assert_healthy();
        let stats = other.settle().stats;
        assert_eq!((stats.connections, stats.decode_failures), (1, 0), "{stats:?}");
        // New clients are accepted.
        let mut third = Viewer::start(&server.address(transport), config());
        third.wait("a first frame", |s| s.stats.milestones.first_frame.is_some());
        drop((other, third));
        if transport == Transport::WebSocket {
            // A closed socket is detected; a vanished QUIC client only by its silence, later.
            server.wait_for_sessions(0);
        }
        server.assert_healthy();
    }
}

/// Most chunks that a server pushes before it knows the client's inventory.
fn most_before_hello(scene: &TestScene, transport: Transport) -> u64 {
    let config = match transport {
        Transport::WebSocket => ServerConfig::websocket(None),
        Transport::Quic => ServerConfig::quic(None),
    };
    let bases: u64 = scene.assets.iter().map(|asset| asset.base_bytes).sum();
    let mut room = config.refine_before_hello_bytes.saturating_sub(bases);
    let mut lengths: Vec<u64> =
        scene.assets.iter().flat_map(|asset| &asset.chunks).map(|chunk| chunk.len() as u64).collect();
    lengths.sort_unstable();
    let fits = |length: &u64| room.checked_sub(*length).map(|left| room = left).is_some();
    lengths.into_iter().take_while(fits).count() as u64
}

/// Checks the viewer when its server vanishes: the picture stays, the status tells what happens, and it reconnects and
/// continues without fetching again what it has.
fn a_server_dies_and_comes_back(transport: Transport) {
    let scene = TestScene::small();
    // Slow enough that about a second's data remain when the client has that many chunks.
    let slow = SessionSettings { rate_bits_per_s: Some(100_000), ..SLOW };
    let server = Server::start(scene.source(), slow);
    let address = server.address(transport);
    let mut viewer = Viewer::start(&address, config());
    let before = viewer.wait("many chunks", |s| s.stats.applied_chunks >= MANY).stats;
    assert!(!before.settled, "the server must be killed before the viewer has settled");
    assert!(blobs_sent(&server, "base") > 0);
    let site = server.kill();

    let lost =
        viewer.wait("the message of the loss", |s| s.message.as_ref().is_some_and(|m| m.contains("again")));
    let message = lost.message.unwrap();
    assert!(!message.contains('\n') && message.contains("connecting again in"), "{message}");
    // Nothing was removed.
    assert!(lost.stats.applied_chunks >= before.applied_chunks, "{:?}", lost.stats);
    let scenes = |viewer: &Viewer| viewer.changes.iter().filter(|c| matches!(c, Change::Scene(_))).count();
    assert_eq!(scenes(&viewer), 1);

    let server = Server::start_at(site, scene.source(), SessionSettings::default());
    assert_eq!(server.address(transport), address, "the same port and certificate");
    let after = viewer.settle();
    assert_eq!(after.message, None);
    assert!(after.stats.connections >= 2, "{:?}", after.stats);
    assert_eq!(after.stats.decode_failures, 0, "{:?}", after.stats);
    assert_eq!(scenes(&viewer), 1, "the picture was discarded");
    // Base meshes may be sent again, and over WebSocket some chunks: the server pushes them before it knows the
    // client's inventory.
    let chunks = blobs_sent(&server, "chunk") + lost.stats.applied_chunks;
    let all: u64 = scene.assets.iter().map(|a| a.chunks.len() as u64).sum();
    let most = all + most_before_hello(scene, transport);
    assert!(most < all + MANY, "the bound allows all chunks to be sent again");
    assert!(chunks <= most, "chunks were sent again: {chunks} of {all}, at most {most}");
    server.assert_healthy();
}

#[test]
fn a_websocket_viewer_survives_its_server() {
    a_server_dies_and_comes_back(Transport::WebSocket);
}

#[test]
fn a_quic_viewer_survives_its_server() {
    a_server_dies_and_comes_back(Transport::Quic);
}

/// Checks an orderly shutdown: clients are told, the picture stays, the daemon ends by itself.
#[test]
fn an_orderly_shutdown_is_announced() {
    let scene = TestScene::small();
    let server = Server::start(scene.source(), SessionSettings { drain: Duration::from_millis(300), ..SLOW });
    let mut viewers: Vec<_> =
        Transport::BOTH.iter().map(|t| Viewer::start(&server.address(*t), config())).collect();
    for viewer in &mut viewers {
        viewer.wait("a first frame", |s| s.stats.milestones.first_frame.is_some());
    }
    let (ended, _) = server.stop();
    ended.unwrap();
    for viewer in &mut viewers {
        let status = viewer.wait("the message of the end", |s| s.message.is_some());
        let message = status.message.unwrap();
        assert!(message.contains("shut"), "{message}");
        assert!(status.stats.faces > 0, "{:?}", status.stats);
    }
}
