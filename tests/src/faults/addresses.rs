//! Admission and session limits when client addresses change.

use lodestream_protocol::frame::encode_client;
use lodestream_protocol::message::{ClientMessage, ServerMessage};

use super::*;
use crate::support::raw::{Arrival, RawClient, RawQuic, hello};

/// Whether a session from an address is admitted: `Hello` is answered.
async fn is_admitted(network: &TestNetwork, at: SocketAddr) -> bool {
    let endpoint = network.client(at, &link());
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

/// Checks that the session of a client that changes networks continues, and counts for its new address.
#[test]
fn a_session_continues_after_an_address_change_and_frees_the_old_addresss_slot() {
    let scene = TestScene::small();
    virtual_runtime().unwrap().block_on(async {
        let network = TestNetwork::new();
        let one_each = SessionSettings { max_sessions_per_address: Some(1), ..settings(Some(40_000)) };
        let state = ServerState::new(scene.source(), one_each);
        network.serve(Arc::clone(&state), 1);
        let endpoint = network.client(client(1, 50_000), &link());
        let mut host = UntilSettled::new();
        let roam = async {
            sleep(Duration::from_secs(1)).await;
            assert!(
                !is_admitted(&network, client(1, 50_001)).await,
                "the session counts for its first address"
            );
            assert!(is_admitted(&network, client(2, 50_002)).await);
            let to = client(2, 50_003);
            network.connect(to, &link());
            endpoint.rebind_abstract(network.udp.socket(to)).unwrap();
            network.connect(client(1, 50_000), &cut());
            sleep(Duration::from_secs(1)).await;
            assert_eq!(state.metrics().active_sessions(), 1);
            assert!(
                is_admitted(&network, client(1, 50_004)).await,
                "the session still counts for its old address"
            );
            assert!(
                !is_admitted(&network, client(2, 50_005)).await,
                "the session does not count for its new address"
            );
            assert_eq!(state.metrics().active_sessions(), 1, "the session ended early");
        };
        let (attempts, ()) = tokio::join!(stream(&endpoint, &mut host), roam);
        let stats = host.core.stats();
        assert_eq!((attempts.len(), stats.connections, stats.decode_failures), (1, 1, 0), "{stats:?}");
        assert_eq!(sent_twice(scene, &host.received()), BTreeMap::new());
    });
}

/// Handshakes that start before any of them has validated its address all find tokens in the bucket.
#[test]
fn simultaneous_quic_handshakes_take_no_more_tokens_than_available() {
    let scene = TestScene::small();
    virtual_runtime().unwrap().block_on(async {
        let network = TestNetwork::new();
        let new = Some("1".parse().unwrap());
        let state = ServerState::new(
            scene.source(),
            SessionSettings { new_sessions_per_address: new, ..settings(None) },
        );
        network.serve(Arc::clone(&state), 1);
        let at_once = (0..10).map(|n| is_admitted(&network, client(1, 50_000 + n)));
        let taken = join_all(at_once).await.into_iter().filter(|let_in| *let_in).count();
        assert_eq!(taken, 1);
        let refused = |count| {
            let line = format!("lodestream_sessions_refused_total{{reason=\"rate\"}} {count}\n");
            let text = state.render_metrics();
            assert!(text.contains(&line), "{line}{text}");
        };
        refused(9);
        assert!(is_admitted(&network, client(2, 51_000)).await);
        // Eight seconds add one token; a further handshake is refused before it begins.
        sleep(Duration::from_secs(8)).await;
        assert!(is_admitted(&network, client(1, 52_000)).await);
        assert!(!is_admitted(&network, client(1, 52_001)).await);
        refused(10);
    });
}
