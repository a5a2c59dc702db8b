//! Tests: the server's congestion control over simulated links, alone and with other flows in one queue.

use std::net::SocketAddr;
use std::num::NonZeroU64;
use std::sync::Arc;
use std::time::Duration;

use lodestream_daemon::bounded_queue;
use lodestream_netsim::clock::{VirtualClock, virtual_runtime};
use lodestream_netsim::link::{IP_UDP_BYTES, Jitter, LinkCounters, LinkSettings};
use lodestream_netsim::udp::UdpNetwork;
use quinn::congestion::{ControllerFactory, CubicConfig};
use rustls::pki_types::PrivateKeyDer;

/// Default settings of quinn for a server and a client that trusts it.
fn configs() -> (quinn::ServerConfig, quinn::ClientConfig) {
    let pair = rcgen::generate_simple_self_signed(vec!["server".to_owned()]).unwrap();
    let mut roots = rustls::RootCertStore::empty();
    roots.add(pair.cert.der().clone()).unwrap();
    let key = PrivateKeyDer::Pkcs8(pair.signing_key.serialize_der().into());
    (
        quinn::ServerConfig::with_single_cert(vec![pair.cert.into()], key).unwrap(),
        quinn::ClientConfig::with_root_certificates(Arc::new(roots)).unwrap(),
    )
}

type Factory = Arc<dyn ControllerFactory + Send + Sync>;

fn cubic() -> Factory {
    Arc::new(CubicConfig::default())
}

fn link(rate_bits_per_s: u64, rtt_ms: u64) -> LinkSettings {
    let rate = NonZeroU64::new(rate_bits_per_s).unwrap();
    LinkSettings::constant(rate, rtt_ms * 500_000, 64 * 1024, IP_UDP_BYTES)
}

/// Throughput and round trips of flows through one queue.
#[derive(Debug)]
struct Shared {
    /// Bytes that each flow delivered in the second half of the time.
    bytes: Vec<u64>,
    link: LinkCounters,
    /// Round trip of each flow's server at the end.
    rtt: Vec<Duration>,
}

/// Sends endlessly over connections with these congestion controls through one link; each starts two seconds after the
/// previous one.
fn share(flows: Vec<Factory>, link: LinkSettings, seconds: u64) -> Shared {
    virtual_runtime().unwrap().block_on(async move {
        let clock = VirtualClock::start();
        let network = UdpNetwork::new(clock);
        let address = |host: u8, port| SocketAddr::from(([10, 0, 0, host], port));
        let first = (address(1, 4433), address(101, 50_000));
        network.connect(first.0, first.1, link.clone(), 1);
        network.connect(first.1, first.0, link, 2);
        let mut running = Vec::new();
        for (number, factory) in (0_u8..).zip(flows) {
            let (server_address, client_address) = (address(1 + number, 4433), address(101 + number, 50_000));
            network.share(server_address, client_address, first);
            network.share(client_address, server_address, (first.1, first.0));
            let (mut server_config, client_config) = configs();
            let mut transport = quinn::TransportConfig::default();
            transport.congestion_controller_factory(factory);
            server_config.transport_config(Arc::new(transport));
            let server = network.endpoint(server_address, Some(server_config), [number; 32]).unwrap();
            let client = network.endpoint(client_address, None, [!number; 32]).unwrap();
            running.push(tokio::spawn(async move {
                tokio::time::sleep(Duration::from_secs(2 * u64::from(number))).await;
                let sending = tokio::spawn(async move {
                    let connection = server.accept().await.unwrap().await.unwrap();
                    let mut stream = connection.open_uni().await.unwrap();
                    while stream.write_all(&[7; 10_000]).await.is_ok() {}
                    connection.stats().path.rtt
                });
                let connection =
                    client.connect_with(client_config, server_address, "server").unwrap().await.unwrap();
                let mut stream = connection.accept_uni().await.unwrap();
                let mut bytes = 0_u64;
                while clock.now_ns() < seconds * 1_000_000_000 {
                    let chunk = stream.read_chunk(usize::MAX, true).await.unwrap().unwrap();
                    if clock.now_ns() > seconds * 500_000_000 {
                        bytes += chunk.bytes.len() as u64;
                    }
                }
                connection.close(0u32.into(), b"");
                (bytes, sending.await.unwrap())
            }));
        }
        let mut shared = Shared { bytes: Vec::new(), link: LinkCounters::default(), rtt: Vec::new() };
        for flow in running {
            let (bytes, rtt) = flow.await.unwrap();
            shared.bytes.push(bytes);
            shared.rtt.push(rtt);
        }
        shared.link = network.counters(first.0, first.1);
        shared
    })
}

/// Share of the link that each flow got, headers not counted.
fn shares(shared: &Shared, rate_bits_per_s: u64, seconds: u64) -> Vec<f64> {
    let carried = (rate_bits_per_s / 8 * seconds) as f64 / 2.0;
    shared.bytes.iter().map(|bytes| *bytes as f64 / carried).collect()
}

#[test]
fn alone_the_link_is_full_and_its_queue_short() {
    let cubic = share(vec![cubic()], link(2_000_000, 50), 30);
    let bounded = share(vec![bounded_queue()], link(2_000_000, 50), 30);
    assert!(shares(&bounded, 2_000_000, 30)[0] > 0.95, "{bounded:?}");
    assert!(bounded.rtt[0] < Duration::from_millis(100), "{bounded:?}");
    assert!(cubic.rtt[0] > Duration::from_millis(150), "{cubic:?}");
    assert!(bounded.link.queue_full < cubic.link.queue_full / 4, "{bounded:?}, {cubic:?}");
}

#[test]
fn beside_cubic_and_beside_each_other_flows_get_a_share() {
    for flows in [
        vec![cubic(), bounded_queue()],
        vec![bounded_queue(), cubic()],
        vec![bounded_queue(), bounded_queue()],
    ] {
        let shared = share(flows, link(2_000_000, 50), 60);
        let shares = shares(&shared, 2_000_000, 60);
        assert!(shares.iter().all(|share| *share > 0.3), "{shares:?}: {shared:?}");
        assert!(shares.iter().sum::<f64>() > 0.9, "{shares:?}: {shared:?}");
    }
}

#[test]
fn jitter_is_not_taken_for_a_queue_for_long() {
    for largest_ms in [20, 60] {
        for reorders in [false, true] {
            let jitter = Jitter { largest_ns: largest_ms * 1_000_000, reorders };
            let link = LinkSettings { jitter, ..link(2_000_000, 50) };
            // The cost of jitter for CUBIC, which takes reordering for loss.
            let cubic = share(vec![cubic()], link.clone(), 60);
            let bounded = share(vec![bounded_queue()], link, 60);
            let [cubic, bounded] = [cubic, bounded].map(|shared| shares(&shared, 2_000_000, 60)[0]);
            assert!(bounded > 0.8 * cubic, "{largest_ms} ms, {reorders}: {bounded} of CUBIC's {cubic}");
        }
    }
}
