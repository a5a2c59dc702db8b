//! Tests: accuracy of the server's rate limit over QUIC, in bytes of IP packets on the link, including handshakes,
//! headers and retransmissions.

use std::net::SocketAddr;
use std::num::NonZeroU64;
use std::sync::Arc;
use std::time::SystemTime;

use lodestream_client::net::{Pin, client_config};
use lodestream_daemon::{
    Certificate, MemoryScene, ServerState, SessionSettings, TEXTURE_LEVELS, serve_quic, server_config,
};
use lodestream_netsim::clock::{VirtualClock, virtual_runtime};
use lodestream_netsim::link::{IP_UDP_BYTES, LinkSettings, Loss};
use lodestream_netsim::udp::UdpNetwork;
use lodestream_protocol::frame::encode_client;
use lodestream_protocol::message::{ClientMessage, Hello, Want};
use lodestream_protocol::stream::CONTROL_STREAM;
use lodestream_scene::BlobId;

const MS: u64 = 1_000_000;
/// Interval at which the link's counters are read.
const STEP_MS: u64 = 50;
const WINDOW_MS: u64 = 3000;

/// The messages of a client that requests all textures of four assets.
fn requests() -> Vec<u8> {
    let hello = ClientMessage::Hello(Hello::new(""));
    let textures = (0..4).flat_map(|a| (0..TEXTURE_LEVELS).map(move |level| BlobId::texture(a, 0, level)));
    let wants = ClientMessage::Want(textures.map(|id| Want::whole(id, 1)).collect());
    let mut bytes = vec![CONTROL_STREAM];
    bytes.extend(encode_client(&hello).unwrap());
    bytes.extend(encode_client(&wants).unwrap());
    bytes
}

/// IP bytes sent to each of some clients, which have links of their own, at each step of 12 s.
fn sent_to_each(settings: SessionSettings, links: Vec<LinkSettings>) -> Vec<Vec<u64>> {
    virtual_runtime().unwrap().block_on(async move {
        let clock = VirtualClock::start();
        let network = UdpNetwork::new(clock);
        let server_address = SocketAddr::from(([10, 0, 0, 1], 4433));
        let certificate = Certificate::self_signed(SystemTime::now()).unwrap();
        let config = server_config(&certificate).unwrap();
        let server = network.endpoint(server_address, Some(config), [1; 32]).unwrap();
        let scene = Arc::new(MemoryScene::new(4, 1500, 2_000_000));
        tokio::spawn(serve_quic(server, ServerState::new(scene, settings)));

        let mut clients = Vec::new();
        for (n, link) in (2..).zip(links) {
            let address = SocketAddr::from(([10, 0, 0, n], 50_000));
            network.connect(server_address, address, link.clone(), 1);
            network.connect(address, server_address, link, 2);
            let endpoint = network.endpoint(address, None, [n; 32]).unwrap();
            let config = client_config(Pin::Certificate(certificate.fingerprint())).unwrap();
            let connection =
                endpoint.connect_with(config, server_address, "localhost").unwrap().await.unwrap();
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
            clients.push((address, connection, endpoint, control));
        }
        let began_ms = clock.now_ns() / MS;
        let mut sent = vec![Vec::new(); clients.len()];
        for step in 0..12_000 / STEP_MS {
            clock.sleep_until((began_ms + 200 + step * STEP_MS) * MS).await;
            for ((address, connection, ..), sent) in clients.iter().zip(&mut sent) {
                let closed = connection.close_reason();
                assert!(closed.is_none(), "closed after {} ms: {closed:?}", step * STEP_MS);
                let counters = network.counters(server_address, *address);
                let packets = counters.arrived + counters.lost;
                sent.push(counters.sent_payload_bytes + packets * u64::from(IP_UDP_BYTES));
            }
        }
        sent
    })
}

fn link(rate: u64, loss: f64) -> LinkSettings {
    LinkSettings {
        loss: Loss::Random(loss),
        ..LinkSettings::constant(NonZeroU64::new(rate).unwrap(), 25 * MS, 256 * 1024, IP_UDP_BYTES)
    }
}

/// Bits per second in each window.
fn rates(sent_bytes: &[u64]) -> Vec<f64> {
    let steps = (WINDOW_MS / STEP_MS) as usize;
    sent_bytes.windows(steps + 1).map(|w| (w[steps] - w[0]) as f64 * 8e3 / WINDOW_MS as f64).collect()
}

/// Rate in each window over a link four times as fast as the limit, as a share of the limit.
fn shares(rate: u64, loss: f64) -> Vec<f64> {
    let settings = SessionSettings { rate_bits_per_s: Some(rate), ..SessionSettings::default() };
    let sent = sent_to_each(settings, vec![link(4 * rate, loss)]);
    rates(&sent[0]).into_iter().map(|sent| sent / rate as f64).collect()
}

#[test]
fn every_three_second_window_is_within_two_percent_of_the_rate() {
    for rate in [2_000_000, 8_000_000, 16_000_000] {
        let shares = shares(rate, 0.0);
        assert!(shares.len() > 100);
        assert!(shares.iter().all(|share| (0.98..=1.02).contains(share)), "{rate} bit/s: {shares:?}");
    }
}

#[test]
fn retransmissions_do_not_exceed_the_rate() {
    // Congestion control may stay below the limit, but the session must not exceed it.
    let shares = shares(2_000_000, 0.01);
    assert!(shares.iter().all(|share| (0.5..=1.05).contains(share)), "{shares:?}");
}

#[test]
fn sessions_share_one_rate_including_the_part_that_a_slow_link_leaves() {
    const RATE: f64 = 10e6;
    let settings = SessionSettings { total_rate_bits_per_s: Some(10_000_000), ..SessionSettings::default() };
    let links = [20_000_000, 20_000_000, 1_000_000, 20_000_000].map(|rate| link(rate, 0.0));
    let sent = sent_to_each(settings, links.to_vec());
    let of_each: Vec<_> = sent.iter().map(|sent| rates(sent)).collect();
    // Once the rate of the slow client is known.
    for at in (2000 / STEP_MS) as usize..of_each[0].len() {
        let parts: Vec<_> = of_each.iter().map(|rates| rates[at]).collect();
        let sum: f64 = parts.iter().sum();
        assert!((0.98..=1.02).contains(&(sum / RATE)), "{parts:?}");
        for part in [parts[0], parts[1], parts[3]] {
            assert!((0.97..=1.03).contains(&(3.0 * part / (RATE - parts[2]))), "{parts:?}");
        }
        assert!((0.9e6..=1.03e6).contains(&parts[2]), "{parts:?}");
    }
}
