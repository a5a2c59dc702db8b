//! Clients that vanish in the middle of a blob.

use lodestream_daemon::MemoryScene;
use lodestream_protocol::frame::encode_client;
use lodestream_protocol::message::ClientMessage;

use super::*;
use crate::support::raw::{Arrival, RawClient, RawQuic, hello, want};

/// Long enough that each blob takes two seconds at the link's rate.
const BLOB_BYTES: u32 = 500_000;

/// Checks that the server releases the resources of clients that vanish while a blob is on its way, and that other
/// clients receive all of their blobs.
#[test]
fn a_client_that_vanishes_in_the_middle_of_a_blob_is_released() {
    virtual_runtime().unwrap().block_on(async {
        let network = TestNetwork::new();
        let scene = Arc::new(MemoryScene::new(1, 500, BLOB_BYTES));
        let state = ServerState::new(scene, settings(None));
        network.serve(Arc::clone(&state), 1);
        let open = async |n: u8| {
            let endpoint = network.client(client(n, 50_000 + u16::from(n)), &link());
            let connection = endpoint.connect(SERVER, "localhost").unwrap().await.unwrap();
            let mut client = RawQuic::new(connection);
            client.send_bytes(encode_client(&ClientMessage::Hello(hello())).unwrap()).await.unwrap();
            let all = want((0..2).map(|level| BlobId::texture(0, 0, level)));
            client.send_bytes(encode_client(&all).unwrap()).await.unwrap();
            client
        };
        let (gone, mut other) = (open(1).await, open(2).await);
        // Half of a blob, then silence.
        sleep(Duration::from_secs(1)).await;
        network.connect(client(1, 50_001), &cut());
        let waiting = |text: &str| -> u64 {
            let line = text.lines().find_map(|line| line.strip_prefix("lodestream_queued_bytes "));
            line.unwrap().parse().unwrap()
        };
        assert_eq!(state.metrics().active_sessions(), 2);
        assert!(waiting(&state.render_metrics()) > 0, "everything was sent before the client vanished");
        let mut came = 0;
        while came < 2 {
            let arrival = timeout(Duration::from_secs(20), other.next()).await.expect("nothing more comes");
            match arrival.expect("the connection has ended") {
                Arrival::Blob(id, bytes) if bytes.len() == BLOB_BYTES as usize => {
                    assert_eq!(bytes, MemoryScene::contents(&id, BLOB_BYTES));
                    came += 1;
                }
                _ => {}
            }
        }
        let bye = encode_client(&ClientMessage::Bye).unwrap();
        other.send_bytes(bye).await.unwrap();
        // QUIC closes a silent connection after 20 s.
        sleep(Duration::from_secs(25)).await;
        assert_eq!(state.metrics().active_sessions(), 0);
        assert_eq!(waiting(&state.render_metrics()), 0);
        drop(gone);
    });
}
