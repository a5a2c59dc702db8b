//! Tests: how closely the server's limiter holds its rate over QUIC, counted where a network would count
//! it: bytes of IP packets on the link, handshakes, headers and retransmissions included.

use std::net::SocketAddr;
use std::num::NonZeroU64;
use std::sync::Arc;
use std::time::SystemTime;

use lodestream_client::net::{Pin, client_config};
use lodestream_netsim::clock::{VirtualClock, virtual_runtime};
use lodestream_netsim::link::{IP_UDP_BYTES, LinkSettings, Loss};
use lodestream_netsim::udp::UdpNetwork;
use lodestream_protocol::BlobId;
use lodestream_protocol::frame::encode_client;
use lodestream_protocol::message::{ClientMessage, Hello, Want};
use lodestream_protocol::stream::CONTROL_STREAM;
use lodestream_server::daemon::certificate::Certificate;
use lodestream_server::daemon::memory_scene::{MemoryScene, TEXTURE_LEVELS};
use lodestream_server::daemon::quic::{serve_quic, server_config};
use lodestream_server::daemon::{ServerState, SessionSettings};

const MS: u64 = 1_000_000;
/// How often the link's counters are read.
const STEP_MS: u64 = 50;
const WINDOW_MS: u64 = 3000;

/// Everything that a client says that wants all textures of four assets.
fn requests() -> Vec<u8> {
    let hello = ClientMessage::Hello(Hello::new(""));
    let textures = (0..4).flat_map(|a| (0..TEXTURE_LEVELS).map(move |level| BlobId::texture(a, 0, level)));
    let wants = ClientMessage::Want(textures.map(|id| Want::whole(id, 1)).collect());
    let mut bytes = vec![CONTROL_STREAM];
    bytes.extend(encode_client(&hello).unwrap());
    bytes.extend(encode_client(&wants).unwrap());
    bytes
}

/// IP bytes that the server had sent at each step of 12 s, at a limit of `rate` over a link four times as
/// fast.
fn sent_bytes(rate: u64, loss: f64) -> Vec<u64> {
    virtual_runtime().unwrap().block_on(async move {
        let clock = VirtualClock::start();
        let network = UdpNetwork::new(clock);
        let server_address = SocketAddr::from(([10, 0, 0, 1], 4433));
        let client_address = SocketAddr::from(([10, 0, 0, 2], 50_000));
        let link = LinkSettings {
            loss: Loss::Random(loss),
            ..LinkSettings::constant(NonZeroU64::new(4 * rate).unwrap(), 25 * MS, 256 * 1024, IP_UDP_BYTES)
        };
        network.connect(server_address, client_address, link.clone(), 1);
        network.connect(client_address, server_address, link, 2);
        let certificate = Certificate::self_signed(SystemTime::now()).unwrap();
        let config = server_config(&certificate).unwrap();
        let server = network.endpoint(server_address, Some(config), [1; 32]).unwrap();
        let client = network.endpoint(client_address, None, [2; 32]).unwrap();
        let settings = SessionSettings { rate_bits_per_s: Some(rate), ..SessionSettings::default() };
        let scene = Arc::new(MemoryScene::new(4, 1500, 2_000_000));
        tokio::spawn(serve_quic(server, ServerState::new(scene, settings)));

        let config = client_config(Pin::Certificate(certificate.fingerprint())).unwrap();
        let connection = client.connect_with(config, server_address, "localhost").unwrap().await.unwrap();
        let mut control = connection.open_uni().await.unwrap();
        control.write_all(&requests()).await.unwrap();
        let streams = connection.clone();
        tokio::spawn(async move {
            while let Ok(mut stream) = streams.accept_uni().await {
                tokio::spawn(
                    async move { while let Ok(Some(_)) = stream.read_chunk(1 << 16, true).await {} },
                );
            }
        });
        let mut sent = Vec::new();
        for step in 0..12_000 / STEP_MS {
            clock.sleep_until((200 + step * STEP_MS) * MS).await;
            let closed = connection.close_reason();
            assert!(closed.is_none(), "closed after {} ms: {closed:?}", step * STEP_MS);
            let counters = network.counters(server_address, client_address);
            let packets = counters.arrived + counters.lost;
            sent.push(counters.sent_payload_bytes + packets * u64::from(IP_UDP_BYTES));
        }
        sent
    })
}

/// What was sent in each window, as a share of what the limit allows.
fn shares(rate: u64, loss: f64) -> Vec<f64> {
    let steps = (WINDOW_MS / STEP_MS) as usize;
    let allowed_bytes = rate as f64 * WINDOW_MS as f64 / 8e3;
    sent_bytes(rate, loss).windows(steps + 1).map(|w| (w[steps] - w[0]) as f64 / allowed_bytes).collect()
}

#[test]
fn every_three_second_window_is_within_five_percent_of_the_rate() {
    for rate in [2_000_000, 8_000_000, 16_000_000] {
        let shares = shares(rate, 0.0);
        assert!(shares.len() > 100);
        assert!(shares.iter().all(|share| (0.95..=1.05).contains(share)), "{rate} bit/s: {shares:?}");
    }
}

#[test]
fn retransmissions_do_not_exceed_the_rate() {
    // Congestion control may now stay below the limit; nothing may take the session above it.
    let shares = shares(2_000_000, 0.01);
    assert!(shares.iter().all(|share| (0.5..=1.05).contains(share)), "{shares:?}");
}
