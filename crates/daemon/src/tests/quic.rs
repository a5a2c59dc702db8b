use std::collections::BTreeMap;

use lodestream_protocol::frame::FrameReader;
use lodestream_protocol::message::{Close, CloseCode};
use lodestream_protocol::stream::{ALPN, BLOB_STREAM, BlobStreamReader, CONTROL_STREAM, PAGE_STREAM};
use lodestream_scene::BlobPart;
use quinn::crypto::rustls::QuicClientConfig;
use quinn::{Connection, ConnectionError, RecvStream, SendStream};
use rustls::pki_types::CertificateDer;
use tokio::sync::mpsc;
use tokio::time::timeout;

use super::*;
use crate::transport::certificate::Certificate;

/// An item that arrives at a client.
#[derive(Debug, PartialEq)]
pub(super) enum Arrival {
    Message(ServerMessage),
    Blob(BlobId, Bytes),
    Reset(BlobId),
}

/// A client on a real QUIC connection.
pub(super) struct QuicClient {
    _endpoint: quinn::Endpoint,
    connection: Connection,
    control: Option<SendStream>,
    arrivals: mpsc::Receiver<Arrival>,
}

pub(super) fn trusting(certificate: &CertificateDer<'static>, alpns: &[&str]) -> quinn::ClientConfig {
    let mut roots = rustls::RootCertStore::empty();
    roots.add(certificate.clone()).unwrap();
    let provider = Arc::new(rustls::crypto::ring::default_provider());
    let mut tls = rustls::ClientConfig::builder_with_provider(provider)
        .with_protocol_versions(&[&rustls::version::TLS13])
        .unwrap()
        .with_root_certificates(roots)
        .with_no_client_auth();
    tls.alpn_protocols = alpns.iter().map(|alpn| alpn.as_bytes().to_vec()).collect();
    quinn::ClientConfig::new(Arc::new(QuicClientConfig::try_from(tls).unwrap()))
}

pub(super) fn certificate(folder: &tempfile::TempDir) -> CertificateDer<'static> {
    let kept = Certificate::load_or_create(folder.path(), std::time::SystemTime::now()).unwrap();
    kept.chain()[0].clone()
}

pub(super) async fn connect_as(
    address: SocketAddr,
    config: quinn::ClientConfig,
) -> Result<(quinn::Endpoint, Connection), ConnectionError> {
    let mut endpoint = quinn::Endpoint::client(SocketAddr::from((Ipv4Addr::LOCALHOST, 0))).unwrap();
    endpoint.set_default_client_config(config);
    let connection = endpoint.connect(address, "localhost").unwrap().await?;
    Ok((endpoint, connection))
}

impl QuicClient {
    pub(super) async fn connect(address: SocketAddr, certificate: &CertificateDer<'static>) -> Self {
        Self::connect_as(address, trusting(certificate, &[ALPN])).await
    }

    pub(super) async fn connect_as(address: SocketAddr, config: quinn::ClientConfig) -> Self {
        let (endpoint, connection) = connect_as(address, config).await.unwrap();
        let (sender, arrivals) = mpsc::channel(10_000);
        let streams = connection.clone();
        tokio::spawn(async move {
            while let Ok(stream) = streams.accept_uni().await {
                tokio::spawn(read_stream(stream, sender.clone()));
            }
        });
        Self { _endpoint: endpoint, connection, control: None, arrivals }
    }

    pub(super) async fn send(&mut self, message: &ClientMessage) {
        let mut bytes = Vec::new();
        if self.control.is_none() {
            self.control = Some(self.connection.open_uni().await.unwrap());
            bytes.push(CONTROL_STREAM);
        }
        bytes.extend_from_slice(&encode_client(message).unwrap());
        self.control.as_mut().unwrap().write_all(&bytes).await.unwrap();
    }

    pub(super) async fn next(&mut self) -> Arrival {
        timeout(REAL_TIME_LIMIT, self.arrivals.recv()).await.unwrap().expect("closed")
    }

    /// Reads until as many blobs are complete.
    pub(super) async fn blobs(&mut self, count: usize) -> BTreeMap<BlobId, Bytes> {
        let mut blobs = BTreeMap::new();
        while blobs.len() < count {
            if let Arrival::Blob(id, bytes) = self.next().await {
                assert_eq!(bytes, MemoryScene::contents(&id, bytes.len() as u32));
                assert!(blobs.insert(id, bytes).is_none(), "{id} twice");
            }
        }
        blobs
    }

    /// The server's reason for closing a connection without a session.
    pub(super) async fn closed(&self) -> Close {
        match self.connection.closed().await {
            ConnectionError::ApplicationClosed(close) => {
                let code = CloseCode::from_number(close.error_code.into_inner());
                Close::new(code.unwrap(), String::from_utf8_lossy(&close.reason))
            }
            other => panic!("{other}"),
        }
    }

    async fn close_reason(&mut self) -> Close {
        loop {
            if let Arrival::Message(ServerMessage::Close(close)) = self.next().await {
                return close;
            }
        }
    }
}

pub(super) async fn read_stream(mut stream: RecvStream, arrivals: mpsc::Sender<Arrival>) {
    let mut kind = [0];
    if stream.read_exact(&mut kind).await.is_err() {
        return;
    }
    match kind[0] {
        CONTROL_STREAM | PAGE_STREAM => {
            let mut frames = FrameReader::new();
            while let Ok(Some(chunk)) = stream.read_chunk(10_000, true).await {
                frames.push(&chunk.bytes);
                while let Some(frame) = frames.next_frame().unwrap() {
                    if let Some(ServerFrame::Message(message)) = frame.into_server_frame().unwrap() {
                        let _ = arrivals.send(Arrival::Message(message)).await;
                    }
                }
            }
        }
        BLOB_STREAM => {
            let mut reader = BlobStreamReader::new();
            let mut bytes = Vec::new();
            loop {
                match stream.read_chunk(10_000, true).await {
                    Ok(Some(chunk)) => {
                        for piece in reader.push(chunk.bytes).unwrap() {
                            bytes.extend_from_slice(&piece.bytes);
                        }
                    }
                    Ok(None) => {
                        reader.finish().unwrap();
                        let id = reader.blob().unwrap().0;
                        let _ = arrivals.send(Arrival::Blob(id, bytes.into())).await;
                        return;
                    }
                    Err(_) => {
                        if let Some((id, _)) = reader.blob() {
                            let _ = arrivals.send(Arrival::Reset(id)).await;
                        }
                        return;
                    }
                }
            }
        }
        other => panic!("a stream of kind {other}"),
    }
}

/// A serving daemon; ends with the test.
struct Served {
    address: SocketAddr,
    http: SocketAddr,
    certificate: CertificateDer<'static>,
    state: Arc<ServerState>,
    stop: mpsc::Sender<()>,
    serving: tokio::task::JoinHandle<anyhow::Result<()>>,
    _folder: tempfile::TempDir,
}

async fn serve(scene: MemoryScene, settings: SessionSettings) -> Served {
    let (daemon, folder) = loopback(scene, settings).await;
    let (stop, stopped) = mpsc::channel(2);
    Served {
        address: daemon.quic_address().unwrap(),
        http: daemon.http_address().unwrap(),
        certificate: certificate(&folder),
        state: daemon.state().clone(),
        stop,
        serving: tokio::spawn(daemon.serve(stopped)),
        _folder: folder,
    }
}

#[tokio::test]
async fn welcome_and_bases_come_before_hello() {
    let served = serve(MemoryScene::new(2, 1000, 100), SessionSettings::default()).await;
    let mut client = QuicClient::connect(served.address, &served.certificate).await;
    let (mut welcome, mut page, mut bases) = (false, false, 0);
    while !(welcome && page && bases == 2) {
        match client.next().await {
            Arrival::Message(ServerMessage::Welcome(_)) => welcome = true,
            Arrival::Message(ServerMessage::ScenePage(_)) => page = true,
            Arrival::Blob(BlobId::Asset { part: BlobPart::Base, .. }, bytes) => {
                assert_eq!(bytes.len(), 1000);
                bases += 1;
            }
            other => panic!("{other:?}"),
        }
    }
    assert!(client.control.is_none());
}

#[tokio::test]
async fn requested_blobs_arrive_complete_and_once() {
    let served = serve(MemoryScene::new(4, 3000, 150_000), SessionSettings::default()).await;
    let mut client = QuicClient::connect(served.address, &served.certificate).await;
    client.send(&hello()).await;
    client.send(&want_textures(4)).await;
    let blobs = client.blobs(4 + 32).await;
    assert_eq!(blobs.values().map(Bytes::len).sum::<usize>(), 4 * 3000 + 32 * 150_000);
    client.send(&ClientMessage::Bye).await;
    let closed = timeout(REAL_TIME_LIMIT, client.connection.closed()).await.unwrap();
    assert!(matches!(closed, ConnectionError::ApplicationClosed(close) if close.error_code == 0u32.into()));
    timeout(REAL_TIME_LIMIT, served.state.all_sessions_ended()).await.unwrap();
}

#[tokio::test]
async fn a_cancelled_blob_is_reset() {
    let settings = SessionSettings { rate_bits_per_s: Some(2_000_000), ..SessionSettings::default() };
    let served = serve(MemoryScene::new(1, 100, 10_000_000), settings).await;
    let mut client = QuicClient::connect(served.address, &served.certificate).await;
    client.send(&hello()).await;
    let id = BlobId::texture(0, 0, 0);
    client.send(&ClientMessage::Want(vec![Want::whole(id, 5)])).await;
    tokio::time::sleep(Duration::from_millis(200)).await;
    client.send(&ClientMessage::Cancel(vec![id])).await;
    loop {
        match client.next().await {
            Arrival::Reset(reset) => break assert_eq!(reset, id),
            Arrival::Blob(whole, _) => assert_ne!(whole, id),
            Arrival::Message(_) => {}
        }
    }
}

#[tokio::test]
async fn a_protocol_violation_closes_with_a_reason() {
    let served = serve(MemoryScene::new(1, 100, 100), SessionSettings::default()).await;
    let mut too_long = vec![CONTROL_STREAM, 0x02];
    too_long.extend_from_slice(&(0x8000_0000_u32 | 200_000).to_be_bytes());
    let cases: [(Vec<u8>, CloseCode, &str); 3] = [
        (vec![9, 1, 2, 3], CloseCode::Protocol, "unknown kind 0x09"),
        (vec![CONTROL_STREAM, 0x7e, 0], CloseCode::Protocol, "unknown message 0x7e"),
        (too_long, CloseCode::Limit, "200000 bytes"),
    ];
    for (bytes, code, reason) in cases {
        let mut client = QuicClient::connect(served.address, &served.certificate).await;
        let mut stream = client.connection.open_uni().await.unwrap();
        stream.write_all(&bytes).await.unwrap();
        let close = client.close_reason().await;
        assert_eq!(close.code, code, "{close}");
        assert!(close.reason.contains(reason), "{close}");
        let closed = timeout(REAL_TIME_LIMIT, client.connection.closed()).await.unwrap();
        match closed {
            ConnectionError::ApplicationClosed(closed) => {
                assert_eq!(closed.error_code.into_inner(), u64::from(code.number()));
                assert_eq!(closed.reason, close.reason.as_bytes());
            }
            other => panic!("{other}"),
        }
    }
}

#[tokio::test]
async fn another_protocol_and_another_certificate_are_refused() {
    let served = serve(MemoryScene::new(1, 100, 100), SessionSettings::default()).await;
    let refused = connect_as(served.address, trusting(&served.certificate, &["h2"])).await;
    assert!(refused.is_err());
    let other = Certificate::self_signed(std::time::SystemTime::now()).unwrap();
    let refused = connect_as(served.address, trusting(&other.chain()[0], &[ALPN])).await;
    assert!(refused.is_err());
    timeout(REAL_TIME_LIMIT, served.state.all_sessions_ended()).await.unwrap();
    let mut client = QuicClient::connect(served.address, &served.certificate).await;
    client.next().await;
}

#[tokio::test]
async fn garbage_on_both_ports_leaves_the_server_healthy() {
    use tokio::io::{AsyncReadExt, AsyncWriteExt};
    let served = serve(MemoryScene::new(1, 100, 100), SessionSettings::default()).await;
    let udp = tokio::net::UdpSocket::bind(SocketAddr::from((Ipv4Addr::LOCALHOST, 0))).await.unwrap();
    let mut noise = 1_u64;
    for length in (1..1400).step_by(7) {
        let datagram: Vec<u8> = (0..length)
            .map(|i| {
                noise = noise.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
                // Every third one looks like a QUIC Initial of version 1.
                match (length % 3, i) {
                    (0, 0) => 0xc3,
                    (0, 1..4) => 0,
                    (0, 4) => 1,
                    _ => (noise >> 56) as u8,
                }
            })
            .collect();
        udp.send_to(&datagram, served.address).await.unwrap();
        let mut tcp = tokio::net::TcpStream::connect(served.http).await.unwrap();
        let _ = tcp.write_all(&datagram).await;
    }
    let mut client = QuicClient::connect(served.address, &served.certificate).await;
    client.send(&hello()).await;
    client.blobs(1).await;
    let mut tcp = tokio::net::TcpStream::connect(served.http).await.unwrap();
    tcp.write_all(b"GET /health HTTP/1.1\r\nHost: s\r\n\r\n").await.unwrap();
    let mut answer = String::new();
    timeout(REAL_TIME_LIMIT, tcp.read_to_string(&mut answer)).await.unwrap().unwrap();
    assert!(answer.starts_with("HTTP/1.1 200"), "{answer}");
    assert!(!served.serving.is_finished());
}

#[tokio::test]
async fn a_drained_server_closes_its_sessions_and_ends() {
    let served = serve(MemoryScene::new(1, 100, 100), SessionSettings::default()).await;
    let mut client = QuicClient::connect(served.address, &served.certificate).await;
    client.send(&hello()).await;
    while client.next().await != Arrival::Message(ServerMessage::Done) {}
    served.stop.send(()).await.unwrap();
    assert_eq!(client.close_reason().await.code, CloseCode::ShuttingDown);
    timeout(REAL_TIME_LIMIT, served.serving).await.unwrap().unwrap().unwrap();
}
