//! Tests: unmodified quinn over the simulated link, against theoretical values.

use std::net::SocketAddr;
use std::num::NonZeroU64;
use std::sync::Arc;

use quinn::crypto::rustls::{QuicClientConfig, QuicServerConfig};
use rustls::pki_types::{CertificateDer, PrivateKeyDer, PrivatePkcs8KeyDer};

use crate::clock::{VirtualClock, virtual_runtime};
use crate::link::{IP_UDP_BYTES, LinkSettings, Loss};
use crate::udp::UdpNetwork;

/// Measurements of one transfer.
#[derive(Debug, PartialEq)]
struct Outcome {
    connected_ms: f64,
    finished_ms: f64,
    lost: u64,
    trace: u64,
}

pub(crate) fn configs() -> (quinn::ServerConfig, quinn::ClientConfig) {
    let key = rcgen::KeyPair::generate_for(&rcgen::PKCS_ED25519).unwrap();
    let certificate =
        rcgen::CertificateParams::new(vec!["server".into()]).unwrap().self_signed(&key).unwrap();
    let certificate: CertificateDer<'static> = certificate.der().clone();
    let key = PrivateKeyDer::Pkcs8(PrivatePkcs8KeyDer::from(key.serialize_der()));
    let provider = Arc::new(rustls::crypto::ring::default_provider());
    let mut roots = rustls::RootCertStore::empty();
    roots.add(certificate.clone()).unwrap();
    let server = rustls::ServerConfig::builder_with_provider(provider.clone())
        .with_protocol_versions(&[&rustls::version::TLS13])
        .unwrap()
        .with_no_client_auth()
        .with_single_cert(vec![certificate], key)
        .unwrap();
    let client = rustls::ClientConfig::builder_with_provider(provider)
        .with_protocol_versions(&[&rustls::version::TLS13])
        .unwrap()
        .with_root_certificates(roots)
        .with_no_client_auth();
    (
        quinn::ServerConfig::with_crypto(Arc::new(QuicServerConfig::try_from(server).unwrap())),
        quinn::ClientConfig::new(Arc::new(QuicClientConfig::try_from(client).unwrap())),
    )
}

/// Sends `bytes` from server to client at 2 Mbit/s, RTT 50 ms, 64 KiB queue.
fn transfer(bytes: usize, loss: f64, seed: u8) -> Outcome {
    virtual_runtime().unwrap().block_on(async move {
        let clock = VirtualClock::start();
        let network = UdpNetwork::new(clock);
        let server_address = SocketAddr::from(([10, 0, 0, 1], 4433));
        let client_address = SocketAddr::from(([10, 0, 0, 2], 50_000));
        let settings = LinkSettings {
            loss: Loss::Random(loss),
            ..LinkSettings::constant(NonZeroU64::new(2_000_000).unwrap(), 25_000_000, 64 * 1024, IP_UDP_BYTES)
        };
        network.connect(server_address, client_address, settings.clone(), u64::from(seed) * 2);
        network.connect(client_address, server_address, settings, u64::from(seed) * 2 + 1);
        let (server_config, client_config) = configs();
        let server = network.endpoint(server_address, Some(server_config), [seed; 32]).unwrap();
        let client = network.endpoint(client_address, None, [!seed; 32]).unwrap();
        let serving = tokio::spawn(async move {
            let connection = server.accept().await.unwrap().await.unwrap();
            let mut stream = connection.open_uni().await.unwrap();
            stream.write_all(&vec![7; bytes]).await.unwrap();
            stream.finish().unwrap();
            connection.closed().await;
        });
        let connecting = client.connect_with(client_config, server_address, "server").unwrap();
        let connection = connecting.await.unwrap();
        let connected_ns = clock.now_ns();
        let received = connection.accept_uni().await.unwrap().read_to_end(bytes).await.unwrap();
        let finished_ns = clock.now_ns();
        assert_eq!(received.len(), bytes);
        let outcome = Outcome {
            connected_ms: connected_ns as f64 / 1e6,
            finished_ms: finished_ns as f64 / 1e6,
            lost: network.counters(server_address, client_address).lost,
            trace: network.trace(),
        };
        connection.close(0u32.into(), b"");
        serving.await.unwrap();
        outcome
    })
}

#[test]
fn a_transfer_takes_as_long_as_theory_says() {
    let outcome = transfer(1_000_000, 0.0, 1);
    // One round trip and the handshake's few packets (1,200 bytes at least each way, 5 ms).
    assert!((50.0..75.0).contains(&outcome.connected_ms), "{outcome:?}");
    // Payload at the link's rate, and at most 10 % for headers, recovery and acknowledgements.
    assert!((4050.0..4500.0).contains(&outcome.finished_ms), "{outcome:?}");
    assert_eq!(outcome.lost, 0);
}

#[test]
fn the_same_seed_gives_the_same_packets() {
    let outcome = transfer(200_000, 0.02, 7);
    assert!(outcome.lost > 0);
    for _ in 0..2 {
        assert_eq!(transfer(200_000, 0.02, 7), outcome);
    }
    assert_ne!(transfer(200_000, 0.02, 8).trace, outcome.trace);
}
