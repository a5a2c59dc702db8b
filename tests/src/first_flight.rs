//! The server's push alone makes every visible instance drawable, in few bytes and round trips.

use std::collections::BTreeSet;
use std::sync::Arc;
use std::time::Duration;

use lodestream_client::core::{ClientCore, Milestone, Progress};
use lodestream_client::net::{Clock, Host, WebSocketConnection, run_quic, run_websocket};
use lodestream_compress::decode_base;
use lodestream_daemon::{ServerState, SessionSettings};
use lodestream_netsim::clock::virtual_runtime;
use lodestream_protocol::Time;
use lodestream_protocol::message::ClientMessage;
use lodestream_scene::{BlobId, BlobPart};
use tokio::time::timeout;

use crate::support::raw::{Arrival, RawClient, RawQuic, RawWebSocket, hello};
use crate::support::scene::TestScene;
use crate::support::viewer::config;
use crate::support::virtual_link::{QuicLink, SERVER, tcp_connect};

/// Most bytes, transport and handshake included, until everything visible can be drawn.
const FIRST_FRAME_BYTES: u64 = 40_000;
const RATE_BITS_PER_S: u64 = 2_000_000;
const RTT_MS: u64 = 50;

fn state(scene: &TestScene) -> Arc<ServerState> {
    ServerState::new(scene.source(), SessionSettings::default())
}

/// Collects what arrives within a virtual second of `Hello`, without requests.
async fn pushed(mut client: impl RawClient) -> BTreeSet<BlobId> {
    client.send(&ClientMessage::Hello(hello())).await;
    let mut blobs = BTreeSet::new();
    while let Ok(arrival) = timeout(Duration::from_secs(1), client.next()).await {
        if let Arrival::Blob(id, bytes) = arrival.expect("the session has ended") {
            if id.part() == Some(BlobPart::Base) {
                decode_base(&bytes).unwrap();
            }
            assert!(blobs.insert(id), "{id} came twice");
        }
    }
    blobs
}

/// Checks the push: all base meshes that the start view sees arrive unrequested, complete and once.
#[test]
fn the_push_brings_every_base_mesh() {
    let scene = TestScene::small();
    let expected: BTreeSet<BlobId> = (0..).zip(&scene.assets).map(|(n, _)| BlobId::base(n)).collect();
    let over_quic = virtual_runtime().unwrap().block_on(async {
        let link = QuicLink::new(state(scene), RATE_BITS_PER_S, RTT_MS);
        pushed(RawQuic::new(link.connect().await)).await
    });
    let over_websocket = virtual_runtime().unwrap().block_on(async {
        let (stream, _) = tcp_connect(state(scene), RATE_BITS_PER_S, RTT_MS).await;
        pushed(RawWebSocket::open(stream).await).await
    });
    for blobs in [over_quic, over_websocket] {
        assert!(blobs.is_superset(&expected), "{blobs:?}");
    }
}

/// A client that leaves at its first frame.
struct UntilFirstFrame(ClientCore);

impl Host for UntilFirstFrame {
    fn core(&mut self) -> &mut ClientCore {
        &mut self.0
    }

    fn turn(&mut self, now: Time) -> Progress {
        self.0.update(now, u64::MAX)
    }

    fn wants_to_leave(&self) -> bool {
        self.0.milestones().first_frame.is_some()
    }
}

impl UntilFirstFrame {
    fn new(now: Time) -> Self {
        let mut core = ClientCore::new(config());
        core.begin(now);
        Self(core)
    }

    /// The time of the first frame; fails unless every visible instance was drawable then.
    fn first_frame(&self, scene: &TestScene) -> Milestone {
        let counters = self.0.counters();
        assert_eq!((counters.visible_instances, counters.drawable_instances), (5, 5), "{counters:?}");
        for asset in (0..).take(scene.assets.len()) {
            assert!(self.0.mesh(asset).is_some_and(|mesh| mesh.face_count() > 0), "asset {asset}");
        }
        self.0.milestones().first_frame.expect("no first frame")
    }
}

/// Checks the first frame: two round trips (connection, then the push with or after `Hello`), plus the transfer time of
/// its bytes.
#[test]
fn the_first_frame_comes_after_two_round_trips_and_its_bytes() {
    let scene = TestScene::small();
    let over_quic = virtual_runtime().unwrap().block_on(async {
        let link = QuicLink::new(state(scene), RATE_BITS_PER_S, RTT_MS);
        let clock = Clock::start();
        let mut host = UntilFirstFrame::new(clock.now());
        let connection = link.connect().await;
        run_quic(connection, &mut host, clock).await;
        host.first_frame(scene)
    });
    let over_websocket = virtual_runtime().unwrap().block_on(async {
        let clock = Clock::start();
        let mut host = UntilFirstFrame::new(clock.now());
        let (stream, _) = tcp_connect(state(scene), RATE_BITS_PER_S, RTT_MS).await;
        let connection = WebSocketConnection::open(stream, &SERVER.to_string(), Duration::from_secs(9)).await;
        run_websocket(connection.unwrap(), &mut host, clock).await;
        host.first_frame(scene)
    });
    for (name, first) in [("QUIC", over_quic), ("WebSocket", over_websocket)] {
        println!("{name}: first frame after {:?} and {} bytes", first.after, first.bytes);
        assert!(first.bytes <= FIRST_FRAME_BYTES, "{name}: {first:?}");
        assert!(first.bytes * 4 <= scene.total_bytes(), "{name}: {first:?} of {}", scene.total_bytes());
        // Bytes plus 15 % for headers; timers fire up to 1 ms late, one for each of up to five flights.
        let transfer = Duration::from_secs_f64(first.bytes as f64 * 8.0 * 1.15 / RATE_BITS_PER_S as f64);
        let bound = Duration::from_millis(2 * RTT_MS + 5) + transfer;
        assert!(first.after <= bound, "{name}: {:?} of {bound:?}", first.after);
    }
}
