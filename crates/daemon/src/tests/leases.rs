//! Distribution of sessions among addresses when the server is full.

use lodestream_protocol::message::{Close, CloseCode};
use tokio::net::UdpSocket;
use tokio::time::timeout;

use super::*;
use crate::limits::session_rate::SessionRateLimit;

fn full_at(max_sessions: u64, max_sessions_per_address: Option<u64>) -> Arc<ServerState> {
    let settings = SessionSettings { max_sessions, max_sessions_per_address, ..SessionSettings::default() };
    ServerState::new(Arc::new(MemoryScene::new(1, 100, 100)), settings)
}

fn from(n: u8) -> SocketAddr {
    SocketAddr::from((Ipv4Addr::new(10, 0, 0, n), 50_000))
}

impl Client<DuplexStream> {
    /// Sends `Hello` and waits for a response; returns the reason if the server closes.
    async fn greet(&mut self) -> Result<(), Close> {
        self.send(&hello()).await;
        self.answered().await
    }

    /// Checks with a ping that the session is open.
    async fn answered(&mut self) -> Result<(), Close> {
        if self.0.send(Message::Binary(encode_client(&ClientMessage::Ping(1)).unwrap().into())).await.is_err()
        {
            return Err(Close::new(CloseCode::Lost, "cannot be sent to"));
        }
        loop {
            match self.next().await {
                Some(ServerFrame::Message(ServerMessage::Pong(_))) => return Ok(()),
                Some(ServerFrame::Message(ServerMessage::Close(close))) => return Err(close),
                Some(_) => {}
                None => return Err(Close::new(CloseCode::Lost, "no reason given")),
            }
        }
    }
}

#[tokio::test(start_paused = true)]
async fn sessions_beyond_the_limit_are_refused() {
    let state = full_at(1, None);
    let mut first = Client::in_memory(&state).await;
    first.greet().await.unwrap();
    let refused = Client::from(peer(), &state).await.err().unwrap();
    assert!(refused.contains("503"), "{refused}");
    first.send(&ClientMessage::Bye).await;
    state.all_sessions_ended().await;
    Client::in_memory(&state).await.greet().await.unwrap();
}

#[tokio::test(start_paused = true)]
async fn idle_clients_of_one_address_cannot_hold_all_leases() {
    let state = full_at(64, None);
    let mut hoard = Vec::new();
    for _ in 0..64 {
        let Ok(mut client) = Client::from(from(1), &state).await else { break };
        client.greet().await.unwrap();
        hoard.push(client);
    }
    assert_eq!(hoard.len(), 8, "an eighth");
    for n in 2..58 {
        let mut other = Client::from(from(n), &state).await.unwrap();
        other.greet().await.unwrap();
        hoard.push(other);
    }
    // Full: a new address gets a lease of the address with many.
    let mut newcomer = Client::from(from(100), &state).await.unwrap();
    newcomer.greet().await.unwrap();
    let closed = hoard[7].answered().await.err().or(hoard[0].answered().await.err()).unwrap();
    assert_eq!(closed.code, CloseCode::Busy, "{closed}");
    assert!(closed.code.worth_retrying() && closed.reason.contains("full"), "{closed}");
    newcomer.answered().await.unwrap();
    hoard[63].answered().await.unwrap();
}

#[tokio::test(start_paused = true)]
async fn connections_without_hello_take_no_lease() {
    let state = full_at(8, Some(8));
    let mut silent = Vec::new();
    for _ in 0..8 {
        silent.push(Client::from(from(1), &state).await.unwrap());
    }
    let mut client = Client::from(from(1), &state).await.unwrap();
    client.greet().await.unwrap();
    drop(silent);
}

#[tokio::test(start_paused = true)]
async fn a_flood_of_silent_connections_evicts_no_other_address() {
    let settings = SessionSettings {
        max_sessions: 8,
        max_sessions_per_address: Some(8),
        new_sessions_per_address: Some(SessionRateLimit::Unlimited),
        ..SessionSettings::default()
    };
    let state = ServerState::new(Arc::new(MemoryScene::new(1, 100, 100)), settings);
    let mut honest = Client::from(from(2), &state).await.unwrap();
    let mut flood = Vec::new();
    for _ in 0..600 {
        flood.push(Client::from(from(1), &state).await.unwrap());
    }
    honest.greet().await.unwrap();
    let close = flood[0].read_until_close().await;
    assert_eq!(close.code, CloseCode::Busy, "{close}");
}

/// An Initial is answered before its address is validated; it must take no lease.
#[tokio::test]
async fn unanswered_quic_initials_take_no_lease() {
    let settings =
        SessionSettings { max_sessions: 4, max_sessions_per_address: Some(4), ..SessionSettings::default() };
    let (daemon, folder) = loopback(MemoryScene::new(1, 100, 100), settings).await;
    let (address, state) = (daemon.quic_address().unwrap(), daemon.state().clone());
    let (_stop, stopped) = tokio::sync::mpsc::channel(2);
    let serving = tokio::spawn(daemon.serve(stopped));
    // Initials of a client that never hears an answer.
    let certificate = super::quic::certificate(&folder);
    for _ in 0..20 {
        let catcher = UdpSocket::bind(SocketAddr::from((Ipv4Addr::LOCALHOST, 0))).await.unwrap();
        let mut endpoint = quinn::Endpoint::client(SocketAddr::from((Ipv4Addr::LOCALHOST, 0))).unwrap();
        endpoint.set_default_client_config(super::quic::trusting(
            &certificate,
            &[lodestream_protocol::stream::ALPN],
        ));
        let connecting = endpoint.connect(catcher.local_addr().unwrap(), "localhost").unwrap();
        let mut initial = vec![0; 2000];
        let (length, _) = timeout(REAL_TIME_LIMIT, catcher.recv_from(&mut initial)).await.unwrap().unwrap();
        catcher.send_to(&initial[..length], address).await.unwrap();
        drop(connecting);
    }
    timeout(REAL_TIME_LIMIT, async {
        while state.metrics().active_sessions() < 20 {
            tokio::time::sleep(Duration::from_millis(5)).await;
        }
    })
    .await
    .expect("the Initials are answered");
    let mut client = super::quic::QuicClient::connect(address, &certificate).await;
    client.send(&hello()).await;
    client.blobs(1).await;
    serving.abort();
}
