//! Faults of servers and networks, in virtual time: servers that are restarted under their clients, packets that overtake
//! each other, addresses that change.

use std::collections::BTreeMap;
use std::net::{IpAddr, Ipv4Addr, SocketAddr};
use std::num::NonZeroU64;
use std::sync::Arc;
use std::time::{Duration, SystemTime};

use futures_util::future::join_all;
use lodestream_client::core::{ClientCore, Config, Progress};
use lodestream_client::net::{
    Clock, End, Host, Pin, QuicConnection, QuicOpenError, Retry, client_config, stream_quic,
};
use lodestream_netsim::clock::{VirtualClock, virtual_runtime};
use lodestream_netsim::link::{IP_UDP_BYTES, Jitter, LinkSettings, Loss};
use lodestream_netsim::udp::UdpNetwork;
use lodestream_protocol::frame::encode_client;
use lodestream_protocol::message::{ClientMessage, Close, CloseCode, ServerMessage};
use lodestream_protocol::source::SceneSource as _;
use lodestream_protocol::time::Time;
use lodestream_protocol::{BlobId, BlobPart};
use lodestream_server::daemon::certificate::Certificate;
use lodestream_server::daemon::quic::{serve_quic, server_config};
use lodestream_server::daemon::{ServerState, SessionSettings};
use tokio::time::{Instant, sleep, timeout};

use crate::support::raw::{Arrival, RawClient, RawQuic, hello};
use crate::support::scene::TestScene;
use crate::support::viewer::config;
use crate::support::virtual_link::SERVER;

const RATE_BITS_PER_S: u64 = 2_000_000;
const RTT_MS: u64 = 50;
/// Virtual time that an attempt to connect may take.
const ATTEMPT: Duration = Duration::from_secs(4);
/// What stands before a blob's bytes on its stream, at most.
const STREAM_HEAD_BYTES: u64 = 16;
/// What counts as one instant.
const TOGETHER: Duration = Duration::from_millis(10);
/// Virtual time that anything may take.
const PATIENCE: Duration = Duration::from_secs(300);

fn client(n: u8, port: u16) -> SocketAddr {
    SocketAddr::new(IpAddr::V4(Ipv4Addr::new(10, 0, 1, n)), port)
}

fn link() -> LinkSettings {
    let rate = NonZeroU64::new(RATE_BITS_PER_S).unwrap();
    LinkSettings::constant(rate, RTT_MS * 1_000_000 / 2, 256 * 1024, IP_UDP_BYTES)
}

/// A network with one server's address on it.
struct World {
    network: UdpNetwork,
    certificate: Certificate,
}

impl World {
    fn new() -> Self {
        Self {
            network: UdpNetwork::new(VirtualClock::start()),
            certificate: Certificate::self_signed(SystemTime::now()).unwrap(),
        }
    }

    /// Starts a server; aborting the task is its sudden death.
    fn serve(&self, state: Arc<ServerState>, seed: u8) -> tokio::task::JoinHandle<()> {
        let config = server_config(&self.certificate).unwrap();
        let endpoint = self.network.endpoint(SERVER, Some(config), [seed; 32]).unwrap();
        tokio::spawn(serve_quic(endpoint, state))
    }

    fn connect(&self, client: SocketAddr, settings: &LinkSettings) {
        let seed = u64::from(client.port());
        self.network.connect(SERVER, client, settings.clone(), seed);
        self.network.connect(client, SERVER, settings.clone(), seed + 1);
    }

    fn client(&self, address: SocketAddr, settings: &LinkSettings) -> quinn::Endpoint {
        self.connect(address, settings);
        let [.., last] = address.port().to_be_bytes();
        let mut endpoint = self.network.endpoint(address, None, [last; 32]).unwrap();
        let pin = Pin::Certificate(self.certificate.fingerprint());
        endpoint.set_default_client_config(client_config(pin).unwrap());
        endpoint
    }
}

async fn open(endpoint: &quinn::Endpoint) -> Result<QuicConnection, Close> {
    let connecting = endpoint.connect(SERVER, "localhost").unwrap();
    QuicConnection::open(connecting, ATTEMPT).await.map_err(|why| match why {
        QuicOpenError::Timeout => Close::new(CloseCode::Lost, "the server does not answer"),
        QuicOpenError::Handshake(why) => Close::new(CloseCode::Lost, why.to_string()),
    })
}

fn settings(rate_bits_per_s: Option<u64>) -> SessionSettings {
    SessionSettings { rate_bits_per_s, ..SessionSettings::default() }
}

/// A client that leaves when its picture is settled.
struct UntilSettled {
    core: ClientCore,
    settled: bool,
    /// What had come of each blob when the first connection was lost, in bytes.
    held: Option<BTreeMap<BlobId, u64>>,
}

impl UntilSettled {
    fn new() -> Self {
        let config = Config { track_received: true, ..config() };
        Self { core: ClientCore::new(config), settled: false, held: None }
    }

    /// What came of each blob so far, in bytes, as often as they came.
    fn received(&self) -> BTreeMap<BlobId, u64> {
        self.core.received().iter().map(|(id, received)| (*id, received.bytes)).collect()
    }
}

impl Host for UntilSettled {
    fn core(&mut self) -> &mut ClientCore {
        &mut self.core
    }

    fn turn(&mut self, now: Time) -> Progress {
        let progress = self.core.update(now, u64::MAX);
        // A renderer takes what there is.
        self.core.take_changes(now, usize::MAX);
        if self.held.is_none() && self.core.closed().is_some() {
            self.held = Some(self.received());
        }
        self.settled |= self.core.is_settled();
        progress
    }

    fn wants_to_leave(&self) -> bool {
        self.settled
    }
}

/// Streams until the picture is settled; gives the moments of its attempts to connect.
async fn stream(endpoint: &quinn::Endpoint, host: &mut UntilSettled) -> Vec<Instant> {
    let mut attempts = Vec::new();
    let connect = async || {
        attempts.push(Instant::now());
        open(endpoint).await
    };
    let retry = Retry { first_attempts: 3, first_within: Duration::MAX, reconnect: true };
    let streaming = stream_quic("the server", connect, host, Clock::start(), retry, |_, _| {});
    let end = timeout(PATIENCE, streaming).await.expect("the picture does not settle");
    assert_eq!(end, End::Left);
    attempts
}

fn length(scene: &TestScene, id: &BlobId) -> u64 {
    scene.store.blob_len(id).map_or(0, u64::from)
}

/// Blobs that came more than once, in part or whole, with the bytes too many.
fn sent_twice(scene: &TestScene, received: &BTreeMap<BlobId, u64>) -> BTreeMap<BlobId, u64> {
    assert!(!received.is_empty(), "nothing was noted");
    let more = received.iter().map(|(id, bytes)| (*id, bytes.saturating_sub(length(scene, id))));
    more.filter(|(_, bytes)| *bytes > 0).collect()
}

fn is_chunk(id: &BlobId) -> bool {
    matches!(id.part(), Some(BlobPart::Chunk(_)))
}

/// What a server pushes before it can hear what a client has.
fn is_pushed(id: &BlobId) -> bool {
    matches!(id.part(), Some(BlobPart::Base | BlobPart::Texture { level: 0, .. }))
}

/// Guards a restart against its clients: they must not come in one instant, all must come, and none may be sent again
/// what it has. The server says nothing before it dies: its packets stop.
#[test]
fn fifty_clients_come_back_to_a_server_that_was_killed_and_are_sent_nothing_twice() {
    const CLIENTS: u8 = 50;
    // So slow that a scene of some 40 kB takes seconds.
    const SLOW: Option<u64> = Some(60_000);
    let scene = TestScene::small();
    let (clients, second) = virtual_runtime().unwrap().block_on(async {
        let world = World::new();
        let first = world.serve(ServerState::new(scene.source(), settings(SLOW)), 1);
        let addresses: Vec<_> = (0..CLIENTS).map(|n| client(n, 50_000 + u16::from(n))).collect();
        let endpoints: Vec<_> = addresses.iter().map(|at| world.client(*at, &link())).collect();
        let clients = endpoints.iter().zip(0_u64..).map(|(endpoint, n)| async move {
            // Within a second, as a class that is told to begin.
            sleep(Duration::from_millis(n * 20)).await;
            let mut host = UntilSettled::new();
            let attempts = stream(endpoint, &mut host).await;
            (host, attempts)
        });
        let restart = async {
            sleep(Duration::from_secs(4)).await;
            let cut = LinkSettings { loss: Loss::Random(1.0), ..link() };
            addresses.iter().for_each(|at| world.connect(*at, &cut));
            first.abort();
            sleep(Duration::from_secs(22)).await;
            addresses.iter().for_each(|at| world.connect(*at, &link()));
            let state = ServerState::new(scene.source(), settings(None));
            world.serve(Arc::clone(&state), 2);
            state
        };
        tokio::join!(join_all(clients), restart)
    });
    let retries: Vec<_> = clients.iter().map(|(_, attempts)| attempts[1..].to_vec()).collect();
    assert!(retries.iter().all(|retries| retries.len() >= 2), "each tries in vain first: {retries:?}");
    for nth in 0..2 {
        let mut at: Vec<Instant> = retries.iter().map(|retries| retries[nth]).collect();
        at.sort_unstable();
        let most =
            at.iter().map(|from| at.iter().filter(|at| (*from..=*from + TOGETHER).contains(at)).count());
        let most = most.max().unwrap();
        println!("attempt {nth}: within {:?}, at most {most} in {TOGETHER:?}", at[49] - at[0]);
        assert!(most <= 10, "{most} of {CLIENTS} came in one instant");
    }
    // An attempt in vain and a pause that has doubled.
    for retries in &retries {
        let pause = retries[1] - retries[0] - ATTEMPT;
        assert!((500..=1010).contains(&pause.as_millis()), "{pause:?}");
    }
    // Of chunks that were not there, the bytes, and the heads of their streams.
    let mut new = 0;
    for (host, _) in &clients {
        let stats = host.core.stats();
        assert!(host.settled && stats.decode_failures == 0, "{stats:?}");
        let (held, received) = (host.held.as_ref().unwrap(), host.received());
        let sum = |of: &BTreeMap<BlobId, u64>| of.values().sum::<u64>();
        assert!(held.keys().any(is_chunk), "the server died before anything was refined");
        assert!(sum(held) < sum(&received), "the server died too late");
        let mut twice = sent_twice(scene, &received);
        // At most 3,000 bytes are pushed before `Hello`.
        let pushed: u64 = twice.extract_if(.., |id, _| is_pushed(id)).map(|(_, bytes)| bytes).sum();
        assert!(twice.is_empty() && pushed <= 3_000, "{pushed} bytes of what is pushed, {twice:?}");
        for (id, bytes) in received.iter().filter(|(id, _)| is_chunk(id)) {
            let before = held.get(id).copied().unwrap_or(0);
            new += if *bytes > before { bytes - before + STREAM_HEAD_BYTES } else { 0 };
        }
    }
    // The server says the same: what it sent was new to whom it was sent.
    let text = second.render_metrics();
    let line = text.lines().find_map(|l| l.strip_prefix("lodestream_sent_bytes_total{kind=\"chunk\"} "));
    let sent: u64 = line.unwrap().parse().unwrap();
    assert!(sent <= new, "{sent} bytes of chunks were sent, at most {new} were new");
}

/// What is settled when packets take their time, as (faces, bytes of blobs, packets too large, what came twice).
fn settled_over(settings_of_link: &LinkSettings) -> (u64, BTreeMap<BlobId, u64>, u64) {
    let scene = TestScene::small();
    virtual_runtime().unwrap().block_on(async {
        let world = World::new();
        world.serve(ServerState::new(scene.source(), settings(None)), 1);
        let at = client(1, 50_000);
        let endpoint = world.client(at, settings_of_link);
        let mut host = UntilSettled::new();
        let attempts = stream(&endpoint, &mut host).await;
        let stats = host.core.stats();
        assert_eq!((attempts.len(), stats.decode_failures), (1, 0), "{stats:?}");
        assert_eq!(sent_twice(scene, &host.received()), BTreeMap::new());
        let too_big = world.network.counters(SERVER, at).too_big;
        (stats.faces, host.received(), too_big)
    })
}

/// Guards what is put together from packets that overtake each other, none of which is larger than QUIC's least.
#[test]
fn packets_that_overtake_each_other_and_are_small_bring_the_same_scene() {
    let (faces, blobs, too_big) = settled_over(&link());
    assert_eq!(too_big, 0);
    for largest_ms in [3, 40] {
        let jitter = Jitter { largest_ns: largest_ms * 1_000_000, reorders: true };
        // QUIC's least, and IP's and UDP's headers.
        let mtu_bytes = 1200 + IP_UDP_BYTES;
        let found = settled_over(&LinkSettings { jitter, mtu_bytes, ..link() });
        assert_eq!(found.0, faces, "{largest_ms} ms");
        assert!(blobs.keys().all(|id| found.1.contains_key(id)), "{largest_ms} ms");
        assert!(found.2 > 0, "nobody tried a larger packet: the link has no bound");
    }
}

/// Whether a session of an address is let in: `Hello` is answered.
async fn is_let_in(world: &World, at: SocketAddr) -> bool {
    let endpoint = world.client(at, &link());
    let Ok(connection) = endpoint.connect(SERVER, "localhost").unwrap().await else { return false };
    let mut client = RawQuic::new(connection);
    let Ok(()) = client.send_bytes(encode_client(&ClientMessage::Hello(hello())).unwrap()).await else {
        return false;
    };
    let Ok(()) = client.send_bytes(encode_client(&ClientMessage::Ping(1)).unwrap()).await else {
        return false;
    };
    while let Some(arrival) = client.next().await {
        if let Arrival::Message(ServerMessage::Pong(_)) = arrival {
            let _ = client.send_bytes(encode_client(&ClientMessage::Bye).unwrap()).await;
            sleep(Duration::from_secs(1)).await;
            return true;
        }
    }
    false
}

/// Guards a client that goes from one network to another: its session goes on, and takes a place of the address that it
/// has now.
#[test]
fn a_client_whose_address_changes_goes_on_and_gives_its_place_back() {
    let scene = TestScene::small();
    virtual_runtime().unwrap().block_on(async {
        let world = World::new();
        let one_each = SessionSettings { max_sessions_per_address: Some(1), ..settings(Some(40_000)) };
        let state = ServerState::new(scene.source(), one_each);
        world.serve(Arc::clone(&state), 1);
        let endpoint = world.client(client(1, 50_000), &link());
        let mut host = UntilSettled::new();
        let roam = async {
            sleep(Duration::from_secs(1)).await;
            assert!(!is_let_in(&world, client(1, 50_001)).await, "the address has its session");
            assert!(is_let_in(&world, client(2, 50_002)).await);
            let to = client(2, 50_003);
            world.connect(to, &link());
            endpoint.rebind_abstract(world.network.socket(to)).unwrap();
            let cut = LinkSettings { loss: Loss::Random(1.0), ..link() };
            world.connect(client(1, 50_000), &cut);
            sleep(Duration::from_secs(1)).await;
            assert_eq!(state.metrics().active_sessions(), 1);
            assert!(is_let_in(&world, client(1, 50_004)).await, "the place of the old address was kept");
            assert!(!is_let_in(&world, client(2, 50_005)).await, "the session counts nowhere");
            assert_eq!(state.metrics().active_sessions(), 1, "the session was over before");
        };
        let (attempts, ()) = tokio::join!(stream(&endpoint, &mut host), roam);
        let stats = host.core.stats();
        assert_eq!((attempts.len(), stats.connections, stats.decode_failures), (1, 1, 0), "{stats:?}");
        assert_eq!(sent_twice(scene, &host.received()), BTreeMap::new());
    });
}

/// Connections of one address that are all begun before any of them has proved it: each sees a bucket that is not empty.
#[test]
fn quic_handshakes_at_the_same_time_took_more_tokens_than_there_were() {
    let scene = TestScene::small();
    virtual_runtime().unwrap().block_on(async {
        let world = World::new();
        let new = Some("1".parse().unwrap());
        let state = ServerState::new(
            scene.source(),
            SessionSettings { new_sessions_per_address: new, ..settings(None) },
        );
        world.serve(Arc::clone(&state), 1);
        let at_once = (0..10).map(|n| is_let_in(&world, client(1, 50_000 + n)));
        let taken = join_all(at_once).await.into_iter().filter(|let_in| *let_in).count();
        assert_eq!(taken, 1);
        let refused = |count| {
            let line = format!("lodestream_sessions_refused_total{{reason=\"rate\"}} {count}\n");
            let text = state.render_metrics();
            assert!(text.contains(&line), "{line}{text}");
        };
        refused(9);
        assert!(is_let_in(&world, client(2, 51_000)).await);
        // Eight seconds bring one more, and now a handshake is refused before it begins.
        sleep(Duration::from_secs(8)).await;
        assert!(is_let_in(&world, client(1, 52_000)).await);
        assert!(!is_let_in(&world, client(1, 52_001)).await);
        refused(10);
    });
}
