//! WebTransport, by a client that speaks HTTP/3's frames.

use std::collections::BTreeMap;

use quinn::{Connection, ConnectionError, RecvStream, SendStream};
use serde_json::Value;
use tokio::sync::mpsc;
use tokio::time::timeout;
use web_transport_proto as h3;

use super::http::exchange;
use super::quic::{Arrival, certificate, connect_as, read_stream, trusting};
use super::*;
use crate::http::page::{Page, PageSetting};
use lodestream_protocol::message::CloseCode;
use lodestream_protocol::stream::CONTROL_STREAM;

/// A daemon on loopback with two scenes and a page.
struct Served {
    quic: SocketAddr,
    http: SocketAddr,
    state: Arc<ServerState>,
    folder: tempfile::TempDir,
    _stop: mpsc::Sender<()>,
}

impl Served {
    async fn start(sessions: SessionSettings) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let page = folder.path().join("page");
        std::fs::create_dir(&page).unwrap();
        let index = r#"<script type="application/json" id="lodestream-server">{}</script>"#;
        std::fs::write(page.join("index.html"), index).unwrap();
        let any = Some(SocketAddr::from((Ipv4Addr::LOCALHOST, 0)));
        let options = DaemonOptions {
            listen: any,
            http: any,
            sessions,
            page: PageSetting::Loaded(Page::load(&page).unwrap()),
            ..DaemonOptions::new(folder.path())
        };
        let scene = |name| Arc::new(MemoryScene::named(name, 2, 1500, 70_000)) as _;
        let scenes = crate::Scenes::new(vec![scene("one"), scene("two")]).unwrap();
        let daemon = Daemon::bind(options, scenes).await.unwrap();
        let (quic, http) = (daemon.quic_address().unwrap(), daemon.http_address().unwrap());
        let state = Arc::clone(daemon.state());
        let (stop, stopped) = mpsc::channel(2);
        tokio::spawn(daemon.serve(stopped));
        Self { quic, http, state, folder, _stop: stop }
    }

    async fn connect(&self) -> Http3 {
        let config = trusting(&certificate(&self.folder), &["h3"]);
        let (endpoint, connection) = connect_as(self.quic, config).await.unwrap();
        let mut control = connection.open_uni().await.unwrap();
        let mut settings = h3::Settings::default();
        settings.enable_webtransport(1);
        settings.write(&mut control).await.unwrap();
        Http3 { _endpoint: endpoint, connection, _control: control }
    }

    /// Requests a session for a path, with an origin if given.
    async fn request(&self, path: &str, origin: Option<String>) -> Result<Session, String> {
        let http = self.connect().await;
        let url: url::Url = format!("https://{}{path}", self.quic).parse().unwrap();
        let mut request = h3::ConnectRequest::new(url);
        if let Some(origin) = origin {
            request = request.with_header(hyper::header::ORIGIN, origin.parse().unwrap());
        }
        let (mut sending, mut answer) = http.connection.open_bi().await.unwrap();
        request.write(&mut sending).await.unwrap();
        let status = h3::ConnectResponse::read(&mut answer).await.map_err(|why| why.to_string())?;
        assert_eq!(status.status, 200);
        Ok(Session { http, request: sending, answer })
    }
}

/// A client's connection, without a session.
struct Http3 {
    _endpoint: quinn::Endpoint,
    connection: Connection,
    _control: SendStream,
}

/// A client's session.
struct Session {
    http: Http3,
    request: SendStream,
    answer: RecvStream,
}

impl Session {
    /// Reads the session's streams.
    fn arrivals(&self) -> mpsc::Receiver<Arrival> {
        let (sender, arrivals) = mpsc::channel(10_000);
        let (streams, session) = (self.http.connection.clone(), quinn::VarInt::from(self.request.id()));
        tokio::spawn(async move {
            while let Ok(mut stream) = streams.accept_uni().await {
                let kind = h3::StreamUni(h3::VarInt::read(&mut stream).await.unwrap());
                if kind == h3::StreamUni::CONTROL {
                    let settings = read_settings(&mut stream).await;
                    assert_eq!(settings.supports_webtransport(), 1);
                    std::mem::forget(stream);
                    continue;
                }
                let number = h3::VarInt::read(&mut stream).await.unwrap();
                assert_eq!(number.into_inner(), session.into_inner());
                tokio::spawn(read_stream(stream, sender.clone()));
            }
        });
        arrivals
    }
}

/// The settings after a control stream's type.
async fn read_settings(stream: &mut RecvStream) -> h3::Settings {
    assert_eq!(h3::Frame(h3::VarInt::read(stream).await.unwrap()), h3::Frame::SETTINGS);
    let length = h3::VarInt::read(stream).await.unwrap();
    let mut body = vec![0; length.into_inner() as usize];
    stream.read_exact(&mut body).await.unwrap();
    let mut whole = Vec::new();
    h3::StreamUni::CONTROL.encode(&mut whole);
    h3::Frame::SETTINGS.encode(&mut whole);
    length.encode(&mut whole);
    whole.extend_from_slice(&body);
    h3::Settings::decode(&mut whole.as_slice()).unwrap()
}

async fn next(arrivals: &mut mpsc::Receiver<Arrival>) -> Arrival {
    timeout(REAL_TIME_LIMIT, arrivals.recv()).await.unwrap().expect("closed")
}

/// The server's reason for closing a connection.
async fn closed(connection: &Connection) -> (u64, String) {
    match timeout(REAL_TIME_LIMIT, connection.closed()).await.unwrap() {
        ConnectionError::ApplicationClosed(close) => {
            (close.error_code.into_inner(), String::from_utf8_lossy(&close.reason).into_owned())
        }
        other => panic!("{other}"),
    }
}

#[tokio::test]
async fn a_session_is_pushed_to_and_answers_requests() {
    let served = Served::start(SessionSettings::default()).await;
    let mut session = served.request("/two", None).await.unwrap();
    let mut arrivals = session.arrivals();
    // The client has sent nothing but its request.
    let Arrival::Message(ServerMessage::Welcome(welcome)) = next(&mut arrivals).await else {
        panic!("no Welcome")
    };
    assert_eq!(welcome.scene.name, "two");
    let mut blobs = BTreeMap::new();
    while blobs.is_empty() {
        if let Arrival::Blob(id, bytes) = next(&mut arrivals).await {
            blobs.insert(id, bytes);
        }
    }
    assert!(blobs.keys().all(|id| id.part() == Some(lodestream_scene::BlobPart::Base)));
    // A stream without bytes and one of reserved type come before the session's: both are opened late by browsers.
    let _silent = session.http.connection.open_uni().await.unwrap();
    let mut reserved = session.http.connection.open_uni().await.unwrap();
    reserved.write_all(&[0x21, 1, 2, 3]).await.unwrap();
    let mut control = session.http.connection.open_uni().await.unwrap();
    let mut first = Vec::new();
    h3::StreamUni::WEBTRANSPORT.encode(&mut first);
    h3::VarInt::from_u32(0).encode(&mut first);
    first.push(CONTROL_STREAM);
    for message in [hello(), want_textures(2)] {
        first.extend_from_slice(&encode_client(&message).unwrap());
    }
    control.write_all(&first).await.unwrap();
    while blobs.len() < 18 {
        if let Arrival::Blob(id, bytes) = next(&mut arrivals).await {
            assert_eq!(bytes, MemoryScene::contents(&id, bytes.len() as u32));
            blobs.insert(id, bytes);
        }
    }
    // The page closes its session.
    session.request.finish().unwrap();
    timeout(REAL_TIME_LIMIT, served.state.all_sessions_ended()).await.unwrap();
    assert_eq!(closed(&session.http.connection).await.0, 0x100);
    let text = served.state.render_metrics();
    for line in [
        "lodestream_webtransport_sessions_total 1",
        "lodestream_sessions_total{transport=\"quic\"} 1",
        "lodestream_sessions_ended_total{reason=\"Normal\"} 1",
        "lodestream_sent_total{kind=\"texture\"} 16",
    ] {
        assert!(text.lines().any(|l| l == line), "{line}\n{text}");
    }
}

#[tokio::test]
async fn paths_and_origins_are_judged_as_for_websocket() {
    let served = Served::start(SessionSettings::default()).await;
    let port = served.http.port();
    for (path, origin) in [
        ("/one", Some(format!("http://127.0.0.1:{port}"))),
        ("/", None),
        ("/stream", None),
        ("/one?anything", None),
    ] {
        assert!(served.request(path, origin).await.is_ok(), "{path}");
    }
    for (path, origin, status) in [
        ("/three", None, "404"),
        ("/one/two", None, "404"),
        ("/one", Some("https://evil.example".to_owned()), "403"),
        ("/one", Some("null".into()), "403"),
        // Another site on this machine, and the port of QUIC itself.
        ("/one", Some(format!("http://127.0.0.1:{}", port.wrapping_add(1))), "403"),
        ("/one", Some(format!("http://127.0.0.1:{}", served.quic.port())), "403"),
        ("/one", Some(format!("http://localhost:{port}")), "403"),
    ] {
        let refused = served.request(path, origin.clone()).await.err().unwrap_or_default();
        assert!(refused.contains(status), "{path} {origin:?}: {refused}");
    }
    let text = served.state.render_metrics();
    assert!(text.contains("lodestream_sessions_refused_total{reason=\"origin\"} 5"), "{text}");
    timeout(REAL_TIME_LIMIT, served.state.all_sessions_ended()).await.unwrap();
}

#[tokio::test]
async fn the_page_names_the_port_and_the_certificate_of_webtransport() {
    let served = Served::start(SessionSettings::default()).await;
    let host = format!("127.0.0.1:{}", served.http.port());
    let text = exchange(
        &served.state,
        format!("GET /one HTTP/1.1\r\nHost: {host}\r\nConnection: close\r\n\r\n").as_bytes(),
    )
    .await;
    let json = text.split_once("id=\"lodestream-server\">").unwrap().1.split_once("</script>").unwrap().0;
    let told: Value = serde_json::from_str(json).unwrap();
    assert_eq!(told["webtransport"]["port"], served.quic.port());
    let kept =
        crate::Certificate::load_or_create(served.folder.path(), std::time::SystemTime::now()).unwrap();
    assert_eq!(told["webtransport"]["certificate_hashes"], serde_json::json!([kept.fingerprint_hex()]));
    let allowed = format!("https://127.0.0.1:{}", served.quic.port());
    assert!(text.contains(&allowed), "the policy refuses {allowed}: {text}");
}

#[tokio::test]
async fn a_protocol_violation_closes_the_session_with_a_reason() {
    let served = Served::start(SessionSettings::default()).await;
    let mut session = served.request("/one", None).await.unwrap();
    let mut control = session.http.connection.open_uni().await.unwrap();
    // The prefix, the kind, and a message that does not exist.
    control.write_all(&[0x40, 0x54, 0, CONTROL_STREAM, 0x7f, 0]).await.unwrap();
    let mut arrivals = session.arrivals();
    let close = loop {
        if let Arrival::Message(ServerMessage::Close(close)) = next(&mut arrivals).await {
            break close;
        }
    };
    assert_eq!(close.code, CloseCode::Protocol);
    let mut capsules = h3::Http3CapsuleReader::new(&mut session.answer);
    let capsule = timeout(REAL_TIME_LIMIT, capsules.read()).await.unwrap().unwrap().unwrap();
    assert_eq!(
        capsule,
        h3::Capsule::CloseWebTransportSession {
            code: CloseCode::Protocol.number().into(),
            reason: close.reason
        }
    );
    assert_eq!(closed(&session.http.connection).await.0, 0x100);
}

#[tokio::test]
async fn hostile_clients_are_closed_politely() {
    let served = Served::start(SessionSettings::default()).await;
    // Not a request for WebTransport.
    let http = served.connect().await;
    let (mut sending, _answer) = http.connection.open_bi().await.unwrap();
    sending.write_all(&[1, 3, 0xff, 0xff, 0xff]).await.unwrap();
    assert_eq!(closed(&http.connection).await.0, 0x100);
    // A request that is too long.
    let http = served.connect().await;
    let (mut sending, _answer) = http.connection.open_bi().await.unwrap();
    sending.write_all(&[1, 0x80, 1, 0, 0]).await.unwrap();
    let (code, reason) = closed(&http.connection).await;
    assert!(code == 0x100 && reason.contains("too large"), "{code}: {reason}");
    // More than the limits of streams: the client's QUIC waits, and the session goes on.
    let session = served.request("/one", None).await.unwrap();
    let connection = &session.http.connection;
    let mut opened = Vec::new();
    while let Ok(stream) = timeout(Duration::from_millis(200), connection.open_uni()).await {
        opened.push(stream.unwrap());
        assert!(opened.len() < 100, "streams without end");
    }
    assert!(timeout(Duration::from_millis(200), connection.open_bi()).await.is_err(), "a second request");
    assert!(matches!(next(&mut session.arrivals()).await, Arrival::Message(ServerMessage::Welcome(_))));
    // More than an explanation on the request's stream.
    let mut session = served.request("/one", None).await.unwrap();
    let _ = session.request.write_all(&vec![0; 100_000]).await;
    let (code, reason) = closed(&session.http.connection).await;
    assert!(code == 0x100 && reason.contains("CONNECT stream"), "{code}: {reason}");
}

#[tokio::test]
async fn a_client_without_a_request_times_out() {
    let served = Served::start(SessionSettings::default()).await;
    let http = served.connect().await;
    let started = std::time::Instant::now();
    let (code, reason) = closed(&http.connection).await;
    assert_eq!((code, reason.as_str()), (0x10b, "no CONNECT within 10 seconds"));
    assert!(started.elapsed() > Duration::from_secs(9), "{:?}", started.elapsed());
    assert_eq!(served.state.metrics().active_sessions(), 0);
}
