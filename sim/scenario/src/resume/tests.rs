//! Tests of resumed connections: time of the first data, and unusable tickets.

use std::io::IoSliceMut;
use std::net::SocketAddr;
use std::path::Path;
use std::sync::Mutex;

use lodestream_client::net::{Host as _, QuicConnection, run_quic};
use lodestream_netsim::udp::VirtualUdpSocket;
use lodestream_protocol::message::Close;
use quinn::AsyncUdpSocket;
use quinn::udp::{RecvMeta, Transmit};

use super::super::camera_path::CameraPath;
use super::super::plan::{self, ClientSettings};
use super::super::result::RunResult;
use super::super::result::to_json;
use super::super::run::certificate;
use super::super::viewer::Viewer;
use super::*;
use crate::testing::{results_of, small_scene};

const RATE: u64 = 2_000_000;
const RTT_MS: u64 = 300;

fn resumed_and_not(rtt_ms: &str) -> Vec<RunResult> {
    let text = format!(
        "scene = \"demo-small\"\nviewport_px = [640, 360]\n[[sweep]]\ntransport = \"quic\"\n\
         resumed = [false, true]\nrate_bits_per_s = {RATE}\nrtt_ms = {rtt_ms}\n"
    );
    results_of(&plan::parse(&text, Path::new("test.toml")).unwrap())
}

#[test]
fn a_resumed_session_saves_a_round_trip() {
    let results = resumed_and_not("[20, 50, 150, 300]");
    let (cold, resumed) = results.split_at(4);
    for (cold, resumed) in cold.iter().zip(resumed) {
        assert!(!cold.resumed && resumed.resumed);
        let (before, after) = (cold.ttff_ms.unwrap(), resumed.ttff_ms.unwrap());
        assert!(after <= before - 0.9 * cold.rtt_ms, "RTT {}: {before} and {after}", cold.rtt_ms);
        // One round trip and the bytes' own time, and a tenth; it is 1.101 times that at 50 ms (docs/benchmarks).
        let bytes_ms = resumed.first_frame_bytes.unwrap() as f64 * 8e3 / RATE as f64;
        let bound_ms = resumed.rtt_ms + bytes_ms;
        assert!(after >= bound_ms && after <= 1.102 * bound_ms, "{after}, bound {bound_ms}");
        assert_eq!(resumed.ended, "settled");
    }
}

#[test]
fn resumed_runs_repeat_to_the_byte() {
    let json = || to_json(&resumed_and_not("50")).unwrap();
    assert_eq!(json(), json());
}

/// A network with a link of [`RATE`] and [`RTT_MS`] between the server and each of the other addresses.
fn network(others: &[SocketAddr]) -> UdpNetwork {
    let network = UdpNetwork::new(VirtualClock::start());
    for &other in others {
        for (from, to) in [(SERVER, other), (other, SERVER)] {
            let rate = NonZeroU64::new(RATE).unwrap();
            let link = LinkSettings::constant(rate, RTT_MS * 500_000, 64 * 1024, IP_UDP_BYTES);
            network.connect(from, to, link, 0);
        }
    }
    network
}

fn serve(network: &UdpNetwork, config: quinn::ServerConfig) -> Arc<ServerState> {
    let state = ServerState::new(small_scene(), SessionSettings::default());
    let server = network.endpoint(SERVER, Some(config), [1; 32]).unwrap();
    tokio::spawn(serve_quic(server, Arc::clone(&state)));
    state
}

fn viewer() -> Viewer<'static> {
    Viewer::new([640, 360], ClientSettings::to(1.0), CameraPath::STILL, Duration::from_secs(60), None)
}

/// The client's address with another port.
fn client(port: u16) -> SocketAddr {
    SocketAddr::new(CLIENT.ip(), port)
}

/// Connects from a port and runs a session to its end; returns whether it began with early data.
async fn visit(
    network: &UdpNetwork,
    port: u16,
    config: &quinn::ClientConfig,
    viewer: &mut Viewer<'_>,
) -> (bool, Close) {
    visit_after(Duration::ZERO, network, port, config, viewer).await
}

/// As [`visit`], with a pause between the connection's opening and the session.
async fn visit_after(
    pause: Duration,
    network: &UdpNetwork,
    port: u16,
    config: &quinn::ClientConfig,
    viewer: &mut Viewer<'_>,
) -> (bool, Close) {
    // Connection ids follow from the seed, and two visits must not share them.
    let client = network.endpoint(client(port), None, [port.to_le_bytes()[0]; 32]).unwrap();
    let connecting = client.connect_with(config.clone(), SERVER, "localhost").unwrap();
    let connection = QuicConnection::open(connecting, Duration::from_secs(4)).await.unwrap();
    let early = connection.is_early();
    sleep(pause).await;
    let clock = viewer.clock();
    let close = run_quic(connection, viewer, clock).await;
    client.wait_idle().await;
    (early, close)
}

#[test]
fn hello_comes_before_the_handshake_is_complete() {
    let settings = QuicSettings::after_first_session(&small_scene(), &certificate().unwrap()).unwrap();
    virtual_runtime().unwrap().block_on(async {
        let network = network(&[client(2)]);
        let state = serve(&network, settings.server);
        let heard = Mutex::new(None);
        let watching = async {
            let start = tokio::time::Instant::now();
            while state.metrics().early_data_sessions() == 0 {
                sleep(Duration::from_millis(1)).await;
            }
            *heard.lock().unwrap() = Some(start.elapsed());
            std::future::pending::<()>().await;
        };
        let mut viewer = viewer();
        let (early, close) = tokio::select! {
            biased;
            () = watching => unreachable!(),
            ended = visit(&network, 2, &settings.client, &mut viewer) => ended,
        };
        assert!(early && viewer.settled().is_some(), "{close}");
        // Half a round trip, a packet of 1,228 bytes, and timers.
        let one_way = Duration::from_millis(RTT_MS / 2 + 5 + 3);
        assert!(heard.lock().unwrap().is_some_and(|after| after <= one_way), "{heard:?}");
    });
}

#[test]
fn every_session_issues_a_ticket_for_the_next() {
    let settings = QuicSettings::after_first_session(&small_scene(), &certificate().unwrap()).unwrap();
    virtual_runtime().unwrap().block_on(async {
        let network = network(&[1, 2, 3].map(client));
        let state = serve(&network, settings.server);
        for port in 1..=3 {
            let (early, _) = visit(&network, port, &settings.client, &mut viewer()).await;
            assert!(early);
            assert_eq!(state.metrics().early_data_sessions(), u64::from(port));
        }
    });
}

/// Visits a server that has restarted, with the same certificate and no memory, and rejects early data.
fn visit_a_restarted_server(pause: Duration) {
    let certificate = certificate().unwrap();
    let settings = QuicSettings::after_first_session(&small_scene(), &certificate).unwrap();
    virtual_runtime().unwrap().block_on(async {
        let network = network(&[client(2)]);
        let state = serve(&network, server_config(&certificate).unwrap());
        let mut viewer = viewer();
        let (early, close) = visit_after(pause, &network, 2, &settings.client, &mut viewer).await;
        assert!(early && viewer.settled().is_some(), "{close}");
        // Hello arrived once: a session without it, or with two, would be closed.
        let metrics = state.metrics();
        assert_eq!((metrics.early_data_sessions(), metrics.rejected_messages()), (0, 0));
        assert_eq!(viewer.usage().repeated_bytes, 0);
    });
}

#[test]
fn rejected_early_data_is_sent_again() {
    visit_a_restarted_server(Duration::ZERO);
}

#[test]
fn a_stream_opened_after_the_rejection_of_early_data_is_kept() {
    // The server has answered when the client opens its stream, as on a busy machine.
    visit_a_restarted_server(Duration::from_millis(4 * RTT_MS));
}

#[test]
fn a_ticket_is_not_used_for_another_pin() {
    let (certificate, other) = (certificate().unwrap(), certificate().unwrap());
    let settings = QuicSettings::after_first_session(&small_scene(), &certificate).unwrap();
    virtual_runtime().unwrap().block_on(async {
        let network = network(&[2, 3].map(client));
        // Another server has the address: it cannot read the early data and rejects it.
        let state = serve(&network, server_config(&other).unwrap());
        let mut viewer = viewer();
        let (early, close) = visit(&network, 2, &settings.client, &mut viewer).await;
        assert!(early && viewer.core().scene().is_none());
        assert!(close.reason.contains("ApplicationVerificationFailure"), "{close}");
        assert_eq!(state.metrics().early_data_sessions(), 0);
        // Its own pin has no ticket.
        let config = net::client_config(Pin::Certificate(other.fingerprint())).unwrap();
        let mut viewer = super::tests::viewer();
        let (early, _) = visit(&network, 3, &config, &mut viewer).await;
        assert!(!early && viewer.settled().is_some());
    });
}

/// The datagrams that arrive within some time.
async fn receive(socket: &VirtualUdpSocket, time: Duration) -> Vec<Vec<u8>> {
    let mut datagrams = Vec::new();
    let _ = timeout(time, async {
        loop {
            let mut buffer = vec![0; 2000];
            let mut meta = [RecvMeta::default()];
            let received = std::future::poll_fn(|context| {
                socket.poll_recv(context, &mut [IoSliceMut::new(&mut buffer)], &mut meta)
            });
            received.await.unwrap();
            datagrams.push(buffer[..meta[0].len].to_vec());
        }
    })
    .await;
    datagrams
}

fn send(socket: &VirtualUdpSocket, datagrams: &[Vec<u8>]) -> usize {
    for contents in datagrams {
        let transmit =
            Transmit { destination: SERVER, ecn: None, contents, segment_size: None, src_ip: None };
        socket.try_send(&transmit).unwrap();
    }
    datagrams.iter().map(Vec::len).sum()
}

/// The first flight of a returning client, delayed on its way.
fn first_flight(settings: &QuicSettings) -> Vec<Vec<u8>> {
    virtual_runtime().unwrap().block_on(async {
        let network = network(&[client(2)]);
        let holder = network.socket(SERVER);
        let mut viewer = viewer();
        // Before the client retransmits.
        let time = Duration::from_millis(RTT_MS / 2 + 100);
        tokio::select! {
            biased;
            datagrams = receive(&holder, time) => datagrams,
            _ = visit(&network, 2, &settings.client, &mut viewer) => unreachable!(),
        }
    })
}

#[test]
fn replayed_early_data_is_not_read_and_answered_with_at_most_three_times_its_length() {
    let settings = QuicSettings::after_first_session(&small_scene(), &certificate().unwrap()).unwrap();
    let datagrams = first_flight(&settings);
    assert!(datagrams.len() <= 2, "{}", datagrams.len());
    virtual_runtime().unwrap().block_on(async {
        let network = network(&[2, 3].map(client));
        let state = serve(&network, settings.server.clone());
        let length = |datagrams: &[Vec<u8>]| datagrams.iter().map(Vec::len).sum::<usize>();
        let (owner, thief) = (network.socket(client(2)), network.socket(client(3)));
        send(&owner, &datagrams);
        let (answer, ()) = tokio::join!(receive(&owner, Duration::from_secs(60)), async {
            // While the session is open: copies of its packets.
            sleep(Duration::from_secs(1)).await;
            send(&thief, &datagrams);
        });
        // The token is valid, so the answer is not limited.
        assert!(length(&answer) > 4 * length(&datagrams), "{}", length(&answer));
        assert_eq!(receive(&thief, Duration::from_secs(1)).await.len(), 0);
        assert_eq!(state.metrics().early_data_sessions(), 1);
        state.all_sessions_ended().await;
        sleep(Duration::from_secs(60)).await;
        // After the session: it looks like one, but ticket and token are used up.
        let sent = send(&thief, &datagrams);
        let answer = receive(&thief, Duration::from_secs(60)).await;
        assert!(!answer.is_empty() && length(&answer) <= 3 * sent, "{} for {sent}", length(&answer));
        assert_eq!(state.metrics().early_data_sessions(), 1);
        assert!(state.render_metrics().contains("lodestream_sessions_total{transport=\"quic\"} 2\n"));
        // A server that never issued them answers as little.
        state.all_sessions_ended().await;
    });
}
