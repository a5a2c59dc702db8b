//! Links that lose or reorder packets, or have a small MTU.

use super::*;

/// Results of a session until settled.
struct Settled {
    faces: u64,
    /// Bytes of each blob.
    blobs: BTreeMap<BlobId, u64>,
    /// Packets from the server that exceeded the MTU, and lost ones.
    too_big: u64,
    lost: u64,
    /// Number of connections.
    attempts: usize,
}

/// Runs a session until settled. `port` is the client's; the link's seed follows from it.
fn settled_over(settings_of_link: &LinkSettings, port: u16) -> Settled {
    let scene = TestScene::small();
    virtual_runtime().unwrap().block_on(async {
        let network = TestNetwork::new();
        network.serve(ServerState::new(scene.source(), settings(None)), 1);
        let at = client(1, port);
        let endpoint = network.client(at, settings_of_link);
        let mut host = UntilSettled::new();
        let attempts = stream(&endpoint, &mut host).await;
        let stats = host.core.stats();
        assert_eq!(stats.decode_failures, 0, "{stats:?}");
        // Blobs pushed before the server knows the client's inventory may be sent again with each connection.
        let mut twice = sent_twice(scene, &host.received());
        let pushed: u64 = twice.extract_if(.., |id, _| is_pushed(id)).map(|(_, bytes)| bytes).sum();
        assert!(twice.is_empty() && pushed <= 3_000 * (attempts.len() as u64 - 1), "{pushed}: {twice:?}");
        let counters = network.udp.counters(SERVER, at);
        Settled {
            faces: stats.faces,
            blobs: host.received(),
            too_big: counters.too_big,
            lost: counters.lost,
            attempts: attempts.len(),
        }
    })
}

/// Checks reassembly from reordered packets at QUIC's smallest MTU.
#[test]
fn small_and_reordered_packets_deliver_the_same_scene() {
    let whole = settled_over(&link(), 50_000);
    assert_eq!((whole.too_big, whole.attempts), (0, 1));
    for largest_ms in [3, 40] {
        let jitter = Jitter { largest_ns: largest_ms * 1_000_000, reorders: true };
        // QUIC's smallest datagrams, with headers of IP and UDP.
        let mtu_bytes = 1200 + IP_UDP_BYTES;
        let found = settled_over(&LinkSettings { jitter, mtu_bytes, ..link() }, 50_000);
        assert_eq!((found.faces, found.attempts), (whole.faces, 1), "{largest_ms} ms");
        assert!(whole.blobs.keys().all(|id| found.blobs.contains_key(id)), "{largest_ms} ms");
        assert!(found.too_big > 0, "no larger packet was sent: the MTU was not tested");
    }
}

/// Checks sessions over a link that loses three of ten packets both ways. A connection may fail; the picture is
/// complete in the end, and chunks are not sent twice.
#[test]
fn thirty_percent_loss_both_ways_delivers_the_same_scene() {
    let whole = settled_over(&link(), 50_000);
    let mut attempts = 0;
    for port in 50_001..=50_012 {
        let found = settled_over(&LinkSettings { loss: Loss::Random(0.3), ..link() }, port);
        assert_eq!(found.faces, whole.faces, "{port}");
        assert!(whole.blobs.keys().all(|id| found.blobs.contains_key(id)), "{port}");
        assert!(found.lost > 0, "{port}");
        attempts += found.attempts;
    }
    println!("{attempts} connections for 12 pictures");
}
