//! Servers that are killed and restarted under their clients, and clock jumps.

use lodestream_client::net::{WebSocketConnection, stream_websocket};
use lodestream_daemon::accept_http;
use lodestream_netsim::link::Rate;
use lodestream_netsim::stream_pipe;
use lodestream_netsim::tcp::IP_TCP_BYTES;
use lodestream_protocol::server::ServerConfig;

use super::*;
use crate::support::daemon::Transport;

const CLIENTS: u8 = 50;
/// A rate at which a scene of some 30 kB takes seconds.
const SLOW: Option<u64> = Some(48_000);
/// When the server is killed, and when another starts.
const DEATH: Duration = Duration::from_secs(4);
const REBIRTH: Duration = Duration::from_secs(30);
/// Most header bytes of a blob, on its stream or in each of its frames.
const HEAD_BYTES: u64 = 32;
/// Interval within which attempts count as simultaneous.
const TOGETHER: Duration = Duration::from_millis(10);

/// A client, and the times of its connection attempts.
type ReturningClient = (UntilSettled, Vec<Instant>);

/// Fifty clients over QUIC, and the second server. The first server is killed without closing connections.
async fn over_quic(scene: &TestScene) -> (Vec<ReturningClient>, Arc<ServerState>) {
    let network = TestNetwork::new();
    let first = network.serve(ServerState::new(scene.source(), settings(SLOW)), 1);
    let addresses: Vec<_> = (0..CLIENTS).map(|n| client(n, 50_000 + u16::from(n))).collect();
    let endpoints: Vec<_> = addresses.iter().map(|at| network.client(*at, &link())).collect();
    let clients = endpoints.iter().zip(0_u64..).map(|(endpoint, n)| async move {
        // All clients start within a second.
        sleep(Duration::from_millis(n * 20)).await;
        let mut host = UntilSettled::new();
        let attempts = stream(endpoint, &mut host).await;
        (host, attempts)
    });
    let restart = async {
        sleep(DEATH).await;
        addresses.iter().for_each(|at| network.connect(*at, &cut()));
        first.abort();
        sleep(REBIRTH - DEATH).await;
        addresses.iter().for_each(|at| network.connect(*at, &link()));
        let state = ServerState::new(scene.source(), settings(None));
        network.serve(Arc::clone(&state), 2);
        state
    };
    tokio::join!(join_all(clients), restart)
}

/// A TCP link without throughput while there is no server.
fn tcp_link() -> LinkSettings {
    let at = |time: Duration| u64::try_from(time.as_nanos()).unwrap();
    let rate = Rate::steps(&[(0, RATE_BITS_PER_S), (at(DEATH), 0), (at(REBIRTH), RATE_BITS_PER_S)]).unwrap();
    LinkSettings { rate, overhead_bytes: IP_TCP_BYTES, ..link() }
}

/// The same over WebSocket.
async fn over_websocket(scene: &TestScene) -> (Vec<ReturningClient>, Arc<ServerState>) {
    let clock = VirtualClock::start();
    let first = ServerState::new(scene.source(), settings(SLOW));
    let second = ServerState::new(scene.source(), settings(None));
    let clients = (0..CLIENTS).map(|n| {
        let (first, second) = (Arc::clone(&first), Arc::clone(&second));
        async move {
            sleep(Duration::from_millis(u64::from(n) * 20)).await;
            let (mut host, mut attempts) = (UntilSettled::new(), Vec::new());
            let connect = async || {
                attempts.push(Instant::now());
                let seed = u64::from(n) << 8 | attempts.len() as u64;
                let opening = stream_pipe::open(clock, tcp_link(), tcp_link(), seed).unwrap();
                let (server, ready_ns) = (opening.server, opening.server_ready_ns);
                let (first, second) = (Arc::clone(&first), Arc::clone(&second));
                tokio::spawn(async move {
                    clock.sleep_until(ready_ns).await;
                    let left = DEATH.saturating_sub(Duration::from_nanos(clock.now_ns()));
                    let (state, lives) = if left.is_zero() { (second, TIMEOUT) } else { (first, left) };
                    let _ = timeout(lives, accept_http(server, state, client(n, 50_000))).await;
                });
                let ready = timeout(ATTEMPT, clock.sleep_until(opening.client_ready_ns)).await;
                ready.map_err(|_| Close::new(CloseCode::Lost, "the server does not answer"))?;
                WebSocketConnection::open_resumed(opening.client, "server:80", attempts.len() > 1, ATTEMPT)
                    .await
            };
            let retry = Retry { first_attempts: 3, first_within: Duration::MAX, reconnect: true };
            let streaming =
                stream_websocket("the server", connect, &mut host, Clock::start(), retry, |_, _| {});
            let end = timeout(TIMEOUT, streaming).await.expect("the picture does not settle");
            assert_eq!(end, End::Left);
            (host, attempts)
        }
    });
    (join_all(clients).await, second)
}

/// Checks that clients of a restarted server do not reconnect simultaneously, that all reconnect, and that no blob is
/// sent again to a client that has it.
fn fifty_clients_come_back(transport: Transport) {
    let scene = TestScene::small();
    let (clients, second) = virtual_runtime().unwrap().block_on(async {
        match transport {
            Transport::Quic => over_quic(scene).await,
            Transport::WebSocket => over_websocket(scene).await,
        }
    });
    let retries: Vec<_> = clients.iter().map(|(_, attempts)| attempts[1..].to_vec()).collect();
    assert!(retries.iter().all(|retries| retries.len() >= 2), "each has a failed attempt first: {retries:?}");
    for nth in 0..2 {
        let mut at: Vec<Instant> = retries.iter().map(|retries| retries[nth]).collect();
        at.sort_unstable();
        let most =
            at.iter().map(|from| at.iter().filter(|at| (*from..=*from + TOGETHER).contains(at)).count());
        let most = most.max().unwrap();
        println!("attempt {nth}: within {:?}, at most {most} in {TOGETHER:?}", at[49] - at[0]);
        assert!(most <= 10, "{most} of {CLIENTS} connected at the same time");
    }
    // A failed attempt and a doubled pause.
    for retries in &retries {
        let pause = retries[1] - retries[0] - ATTEMPT;
        assert!((500..=1010).contains(&pause.as_millis()), "{pause:?}");
    }
    // Before the server knows a client's inventory it pushes base meshes over QUIC; over WebSocket the request says that
    // the client has something.
    let (most_pushed, may_be_pushed): (u64, fn(&BlobId) -> bool) = match transport {
        Transport::Quic => (ServerConfig::quic(None).push_before_hello_bytes, is_pushed),
        Transport::WebSocket => (0, |_| false),
    };
    // Bytes of missing chunks, and the headers of their streams.
    let mut new = 0;
    for (host, _) in &clients {
        let stats = host.core.stats();
        assert!(host.settled && stats.decode_failures == 0, "{stats:?}");
        let (held, received) = (host.held.as_ref().unwrap(), host.received());
        let sum = |of: &BTreeMap<BlobId, u64>| of.values().sum::<u64>();
        assert!(held.keys().any(is_chunk), "the server was killed before it sent a chunk");
        assert!(sum(held) < sum(&received), "the server was killed after it had sent everything");
        let mut twice = sent_twice(scene, &received);
        let pushed: u64 = twice.extract_if(.., |id, _| may_be_pushed(id)).map(|(_, bytes)| bytes).sum();
        assert!(twice.is_empty() && pushed <= most_pushed, "{pushed} bytes of what is pushed, {twice:?}");
        for (id, bytes) in received.iter().filter(|(id, _)| is_chunk(id)) {
            let before = held.get(id).copied().unwrap_or(0);
            new += if *bytes > before { bytes - before + HEAD_BYTES } else { 0 };
        }
    }
    // The server agrees: what it sent was new to its recipients.
    let text = second.render_metrics();
    let line = text.lines().find_map(|l| l.strip_prefix("lodestream_sent_bytes_total{kind=\"chunk\"} "));
    let sent: u64 = line.unwrap().parse().unwrap();
    assert!(sent > 0 && sent <= new, "{sent} bytes of chunks were sent, at most {new} were new");
}

#[test]
fn fifty_quic_clients_reconnect_to_a_restarted_server_and_receive_nothing_twice() {
    fifty_clients_come_back(Transport::Quic);
}

#[test]
fn fifty_websocket_clients_reconnect_and_receive_nothing_twice() {
    fifty_clients_come_back(Transport::WebSocket);
}

/// Checks both sides after a clock jump of an hour, as of a suspended machine: pending work times out, and the session
/// continues from its present state.
#[test]
fn a_clock_jump_of_an_hour_ends_the_session_but_not_the_picture() {
    let scene = TestScene::small();
    virtual_runtime().unwrap().block_on(async {
        let network = TestNetwork::new();
        let state = ServerState::new(scene.source(), settings(SLOW));
        network.serve(Arc::clone(&state), 1);
        let endpoint = network.client(client(1, 50_000), &link());
        let mut host = UntilSettled::new();
        let jump = async {
            sleep(DEATH).await;
            assert_eq!(state.metrics().active_sessions(), 1);
            tokio::time::advance(Duration::from_secs(3600)).await;
        };
        let (attempts, ()) = tokio::join!(stream(&endpoint, &mut host), jump);
        assert!(attempts.len() >= 2, "the session survived an hour of silence");
        let (stats, held) = (host.core.stats(), host.held.as_ref().unwrap());
        assert!(host.settled && stats.decode_failures == 0, "{stats:?}");
        assert!(held.keys().any(is_chunk), "the clock jumped before a chunk arrived");
        let mut twice = sent_twice(scene, &host.received());
        let pushed: u64 = twice.extract_if(.., |id, _| is_pushed(id)).map(|(_, bytes)| bytes).sum();
        assert!(twice.is_empty() && pushed <= 3_000, "{pushed} bytes of what is pushed, {twice:?}");
        sleep(Duration::from_secs(60)).await;
        assert_eq!(state.metrics().active_sessions(), 0, "the earlier session is still open");
    });
}
