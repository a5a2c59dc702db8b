//! Time of the server's first data over QUIC, in virtual time.
//!
//! The client of these tests sends nothing of its own: data that arrive before its own first flight could have been
//! answered were part of the handshake's second flight.

use std::net::SocketAddr;
use std::num::NonZeroU64;
use std::sync::Arc;

use lodestream_daemon::{MemoryScene, ServerState, SessionSettings, serve_quic, server_config};
use lodestream_netsim::clock::{VirtualClock, virtual_runtime};
use lodestream_netsim::link::{IP_UDP_BYTES, LinkSettings};
use lodestream_netsim::udp::UdpNetwork;
use lodestream_protocol::frame::{FrameReader, ServerFrame};
use lodestream_protocol::message::ServerMessage;
use lodestream_protocol::stream::{BlobStreamReader, CONTROL_STREAM};
use quinn::RecvStream;
use quinn::crypto::rustls::QuicClientConfig;
use tokio::sync::mpsc;

/// Kind of the data that arrived, in order, with the time in milliseconds.
#[derive(Clone, Debug, PartialEq)]
enum What {
    Welcome,
    ScenePage,
    Base,
    Close,
}

async fn read(mut stream: RecvStream, clock: VirtualClock, arrivals: mpsc::Sender<(What, f64)>) {
    let mut kind = [0];
    if stream.read_exact(&mut kind).await.is_err() {
        return;
    }
    let mut frames = FrameReader::new();
    let mut blob = BlobStreamReader::new();
    while let Ok(Some(chunk)) = stream.read_chunk(1 << 16, true).await {
        if kind[0] == CONTROL_STREAM {
            frames.push(&chunk.bytes);
            while let Some(frame) = frames.next_frame().unwrap() {
                let what = match frame.into_server_frame().unwrap() {
                    Some(ServerFrame::Message(ServerMessage::Welcome(_))) => What::Welcome,
                    Some(ServerFrame::Message(ServerMessage::ScenePage(_))) => What::ScenePage,
                    Some(ServerFrame::Message(ServerMessage::Close(_))) => What::Close,
                    other => panic!("{other:?}"),
                };
                arrivals.send((what, clock.now_ns() as f64 / 1e6)).await.unwrap();
            }
        } else {
            blob.push(chunk.bytes).unwrap();
        }
    }
    if kind[0] != CONTROL_STREAM {
        blob.finish().unwrap();
        arrivals.send((What::Base, clock.now_ns() as f64 / 1e6)).await.unwrap();
    }
}

/// Connects to a server over a link and listens; returns the data that arrived before `until_ms`, the time at which the
/// handshake was complete, and a hash of all packets.
fn listen(rate: u64, rtt_ms: u64, base_bytes: u32, until_ms: u64) -> (Vec<(What, f64)>, f64, u64) {
    virtual_runtime().unwrap().block_on(async move {
        let clock = VirtualClock::start();
        let network = UdpNetwork::new(clock);
        let addresses = [([10, 0, 0, 1], 4433), ([10, 0, 0, 2], 50_000)].map(SocketAddr::from);
        let [server_address, client_address] = addresses;
        let settings =
            LinkSettings::constant(NonZeroU64::new(rate).unwrap(), rtt_ms * 500_000, 64 * 1024, IP_UDP_BYTES);
        network.connect(server_address, client_address, settings.clone(), 1);
        network.connect(client_address, server_address, settings, 2);
        let certificate = crate::run::certificate().unwrap();
        let config = server_config(&certificate).unwrap();
        let server = network.endpoint(server_address, Some(config), [3; 32]).unwrap();
        let settings = SessionSettings { rate_bits_per_s: Some(rate), ..SessionSettings::default() };
        let state = ServerState::new(Arc::new(MemoryScene::new(2, base_bytes, 100)), settings);
        tokio::spawn(serve_quic(server, state));

        let mut roots = rustls::RootCertStore::empty();
        roots.add(certificate.chain()[0].clone()).unwrap();
        let mut tls =
            rustls::ClientConfig::builder_with_provider(Arc::new(rustls::crypto::ring::default_provider()))
                .with_protocol_versions(&[&rustls::version::TLS13])
                .unwrap()
                .with_root_certificates(roots)
                .with_no_client_auth();
        tls.alpn_protocols = vec![lodestream_protocol::stream::ALPN.into()];
        let config = quinn::ClientConfig::new(Arc::new(QuicClientConfig::try_from(tls).unwrap()));
        let client = network.endpoint(client_address, None, [4; 32]).unwrap();
        let connection = client.connect_with(config, server_address, "localhost").unwrap().await.unwrap();
        let connected_ms = clock.now_ns() as f64 / 1e6;
        let (sender, mut arrivals) = mpsc::channel(1000);
        let streams = connection.clone();
        tokio::spawn(async move {
            while let Ok(stream) = streams.accept_uni().await {
                tokio::spawn(read(stream, clock, sender.clone()));
            }
        });
        clock.sleep_until(until_ms * 1_000_000).await;
        let mut seen = Vec::new();
        while let Ok(arrival) = arrivals.try_recv() {
            seen.push(arrival);
        }
        (seen, connected_ms, network.trace())
    })
}

#[test]
fn welcome_page_and_base_meshes_are_in_the_handshakes_second_flight() {
    for rtt_ms in [50, 300] {
        let (seen, connected_ms, _) = listen(2_000_000, rtt_ms, 900, rtt_ms * 2);
        let order: Vec<_> = seen.iter().map(|(what, _)| what.clone()).collect();
        assert_eq!(order, [What::Welcome, What::ScenePage, What::Base, What::Base], "{seen:?}");
        // One round trip; the client's first packet of at least 1,200 bytes; 3,600 bytes from the server.
        let bound_ms = rtt_ms as f64 + (1228.0 + 3.0 * 1200.0 + 3.0 * 28.0) * 8.0 / 2000.0 + 2.0;
        let last_ms = seen.last().unwrap().1;
        assert!(last_ms <= bound_ms, "RTT {rtt_ms} ms: {seen:?}, connected at {connected_ms}");
    }
}

#[test]
fn runs_repeat_packet_by_packet() {
    let first = listen(8_000_000, 50, 3000, 400);
    assert_eq!(listen(8_000_000, 50, 3000, 400), first);
}

#[test]
fn a_silent_client_is_closed_with_a_reason() {
    let (seen, ..) = listen(2_000_000, 50, 900, 25_000);
    assert_eq!(seen.last().unwrap().0, What::Close, "{seen:?}");
}
