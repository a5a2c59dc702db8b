//! The HTTP port with TLS, and clients behind proxies.

use std::time::SystemTime;

use lodestream_protocol::message::CloseCode;
use tokio::io::AsyncWriteExt;
use tokio::time::Instant;
use tokio_rustls::TlsConnector;
use tokio_rustls::client::TlsStream;
use tokio_tungstenite::tungstenite::client::IntoClientRequest;
use tokio_tungstenite::tungstenite::http::HeaderValue;

use super::*;
use crate::http::proxy::Network;
use crate::http::server::accept_https;
use crate::session::admission_settings::AdmissionSettings;
use crate::transport::certificate::Certificate;
use crate::transport::live_certificate::LiveCertificate;
use crate::transport::tls::Tls;

/// TLS of a server and of a client that trusts it.
fn pair() -> (Tls, TlsConnector) {
    let certificate = Certificate::self_signed(SystemTime::now()).unwrap();
    let mut roots = rustls::RootCertStore::empty();
    roots.add(certificate.chain()[0].clone()).unwrap();
    let provider = Arc::new(rustls::crypto::ring::default_provider());
    let client = rustls::ClientConfig::builder_with_provider(provider)
        .with_protocol_versions(&[&rustls::version::TLS13])
        .unwrap()
        .with_root_certificates(roots)
        .with_no_client_auth();
    (Tls::new(LiveCertificate::new(&certificate).unwrap()).unwrap(), Arc::new(client).into())
}

async fn connect(state: &Arc<ServerState>) -> TlsStream<DuplexStream> {
    let (tls, connector) = pair();
    let (near, far) = duplex(64 * 1024);
    tokio::spawn(accept_https(far, Arc::clone(state), peer(), tls));
    connector.connect("localhost".try_into().unwrap(), near).await.unwrap()
}

#[tokio::test(start_paused = true)]
async fn a_session_over_tls_delivers_all_blobs() {
    let state = state_of(MemoryScene::new(2, 1500, 200_000), None);
    let mut client = Client::over(connect(&state).await).await;
    client.send(&hello()).await;
    client.send(&want_textures(2)).await;
    assert_eq!(client.read_blobs(18).await.len(), 18);
    client.send(&ClientMessage::Bye).await;
    state.all_sessions_ended().await;
}

#[tokio::test(start_paused = true)]
async fn slow_handshakes_are_dropped() {
    let state = state_of(MemoryScene::new(1, 100, 100), None);
    let (tls, _) = pair();
    for begun in [&b""[..], b"\x16\x03\x01\x02\x00\x01\x00", b"GET / HTTP/1.1\r\n\r\n"] {
        let (mut near, far) = duplex(64 * 1024);
        near.write_all(begun).await.unwrap();
        let started = Instant::now();
        accept_https(far, Arc::clone(&state), peer(), tls.clone()).await;
        assert!(started.elapsed() <= Duration::from_secs(5), "{:?}", started.elapsed());
    }
    // After the handshake, a slow request is dropped too.
    let stream = connect(&state).await;
    let started = Instant::now();
    let (_read, mut write) = tokio::io::split(stream);
    while write.write_all(b"G").await.is_ok() && write.flush().await.is_ok() {
        tokio::time::sleep(Duration::from_secs(1)).await;
        assert!(started.elapsed() <= Duration::from_secs(15), "{:?}", started.elapsed());
    }
}

/// One byte per TLS record costs more work than its length tells: bytes are counted below TLS.
#[tokio::test(start_paused = true)]
async fn a_flood_of_small_records_is_closed_with_a_reason() {
    let state = state_of(MemoryScene::new(1, 100, 100), None);
    let client = Client::over(connect(&state).await).await;
    let (mut sink, mut stream) = client.0.split();
    sink.send(Message::Binary(encode_client(&hello()).unwrap().into())).await.unwrap();
    // The header of a frame of 60,000 bytes, whose payload follows byte by byte.
    let mut inner = sink.reunite(stream).unwrap();
    let raw = inner.get_mut();
    raw.write_all(&[0x82, 0xfe, 0xea, 0x60, 0, 0, 0, 0]).await.unwrap();
    for _ in 0..50_000 {
        if raw.write_all(&[0]).await.is_err() || raw.flush().await.is_err() {
            break;
        }
    }
    (_, stream) = inner.split();
    let mut client = stream;
    let close = loop {
        let Some(Ok(message)) = client.next().await else { panic!("no Close") };
        if let Message::Binary(bytes) = message
            && let Some(ServerFrame::Message(ServerMessage::Close(close))) =
                Frame::parse(bytes).unwrap().into_server_frame().unwrap()
        {
            break close;
        }
    };
    assert_eq!(close.code, CloseCode::Limit);
    assert!(close.reason.contains("256 KiB"), "{close}");
    state.all_sessions_ended().await;
}

fn behind(proxies: &[&str], of_address: u64) -> Arc<ServerState> {
    let settings =
        SessionSettings { max_sessions_per_address: Some(of_address), ..SessionSettings::default() };
    let proxies = proxies.iter().map(|network| network.parse::<Network>().unwrap()).collect();
    let admission = AdmissionSettings { proxies, ..AdmissionSettings::default() };
    ServerState::with_admission(Arc::new(MemoryScene::new(1, 100, 100)), settings, admission)
}

/// A client of a proxy; `None` where it is refused.
async fn through(state: &Arc<ServerState>, forwarded_for: &str) -> Option<Client<DuplexStream>> {
    let (near, far) = duplex(64 * 1024);
    tokio::spawn(accept_http(far, Arc::clone(state), peer()));
    let mut request = "ws://server/stream".into_client_request().unwrap();
    request.headers_mut().insert("X-Forwarded-For", HeaderValue::from_str(forwarded_for).unwrap());
    let (socket, _) = tokio_tungstenite::client_async(request, near).await.ok()?;
    let mut client = Client(socket);
    client.send(&hello()).await;
    // Wait until `Hello` was processed.
    client.send(&ClientMessage::Ping(1)).await;
    loop {
        match client.next().await? {
            ServerFrame::Message(ServerMessage::Pong(_)) => return Some(client),
            ServerFrame::Message(ServerMessage::Close(_)) => return None,
            _ => {}
        }
    }
}

#[tokio::test(start_paused = true)]
async fn clients_of_a_trusted_proxy_have_leases_by_their_own_address() {
    let state = behind(&["127.0.0.1"], 1);
    let first = through(&state, "203.0.113.1").await.unwrap();
    let second = through(&state, "203.0.113.2").await.unwrap();
    assert!(through(&state, "203.0.113.1").await.is_none(), "one has a lease each");
    assert!(
        through(&state, "198.51.100.9, 203.0.113.2").await.is_none(),
        "an entry added by the client is not trusted"
    );
    drop((first, second));
    // The header of an untrusted peer is ignored.
    let state = behind(&["10.0.0.0/8"], 1);
    let _first = through(&state, "203.0.113.1").await.unwrap();
    assert!(through(&state, "203.0.113.2").await.is_none());
}
