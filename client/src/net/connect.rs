//! Opens a connection to a server. Every step has a deadline, and every address of the name is tried.

use std::net::SocketAddr;
#[cfg(feature = "quic")]
use std::time::Duration;

use lodestream_protocol::message::{Close, CloseCode, Token};
use lodestream_transport::Clock;
#[cfg(feature = "quic")]
use tokio::time::timeout;

use super::address::{Address, Scheme};
use super::addresses::{Resolver, first_to_answer, resolve};
use super::drive::Host;
#[cfg(feature = "http")]
use super::published::{FileFetch, HttpFetch, Origin, Target as HttpTarget, run_published};
use super::server::Server;
use super::steps::STEP_TIMEOUT;
#[cfg(feature = "websocket")]
use super::steps::open_tcp;
#[cfg(feature = "quic")]
use super::steps::{lost, no_answer};
#[cfg(any(feature = "quic", feature = "tls"))]
use super::trust::Trust;
#[cfg(feature = "websocket")]
use super::websocket::{CountingStream, Target, WebSocketConnection, counting, request_path, run_websocket};
#[cfg(feature = "quic")]
use super::{
    quic::{self, client_config_of, endpoint, run_quic},
    quic_open::{QuicConnection, QuicOpenError},
    trust::CertificateRejection,
};
#[cfg(feature = "websocket")]
use tokio::net::TcpStream;

/// Time limit for delivering the close of a QUIC connection.
#[cfg(feature = "quic")]
const CLOSE_TIMEOUT: Duration = Duration::from_millis(300);

/// State that one attempt to connect leaves to the next.
#[derive(Default)]
pub(super) struct ConnectionMemory {
    #[cfg(feature = "quic")]
    quic: Option<QuicResumption>,
    #[cfg(feature = "tls")]
    tls: Option<super::tls::Tls>,
}

/// Settings and tickets that resume a QUIC session.
#[cfg(feature = "quic")]
struct QuicResumption {
    config: quinn::ClientConfig,
    rejection: CertificateRejection,
    /// The address that the tickets come from.
    ticket_from: Option<SocketAddr>,
}

/// An open connection, ready for a session.
pub(super) enum Connection {
    #[cfg(feature = "websocket")]
    WebSocket(Box<WebSocketConnection<CountingStream<TcpStream>>>),
    #[cfg(feature = "tls")]
    SecureWebSocket(Box<WebSocketConnection<tokio_rustls::client::TlsStream<CountingStream<TcpStream>>>>),
    #[cfg(feature = "quic")]
    Quic(Box<OpenedQuic>),
    #[cfg(feature = "http")]
    Published(PublishedScene),
}

/// A published scene; connections are opened as requests need them.
#[cfg(feature = "http")]
pub(super) enum PublishedScene {
    Http(HttpFetch),
    File(FileFetch),
}

#[cfg(feature = "quic")]
pub(super) struct OpenedQuic {
    endpoint: quinn::Endpoint,
    server: SocketAddr,
    opened: QuicConnection,
    rejection: CertificateRejection,
    /// Whether the name has other addresses.
    has_other_addresses: bool,
}

/// Opens a connection. Ends in bounded time: [`STEP_TIMEOUT`] for each step, and a quarter of a second for each
/// address before the last.
pub(super) async fn connect(
    server: &Server,
    token: Option<&Token>,
    resumes: bool,
    memory: &mut ConnectionMemory,
    resolver: &impl Resolver,
) -> Result<Connection, Close> {
    let address = &server.address;
    #[cfg(feature = "http")]
    if address.scheme.is_published() {
        return Ok(Connection::Published(published(server)));
    }
    let servers = resolve(address, resolver).await?;
    match address.scheme {
        #[cfg(feature = "websocket")]
        Scheme::WebSocket => {
            let (authority, path) = (address.authority(), request_path(&address.path(), resumes));
            let target = Target { authority: &authority, path: &path };
            first_to_answer(address, &servers, |server| open_websocket(server, target, token)).await
        }
        #[cfg(feature = "tls")]
        Scheme::SecureWebSocket => {
            let tls = match &memory.tls {
                Some(tls) => tls,
                None => {
                    let opens = super::tls::Tls::new(&address.host, trust(server).await?);
                    memory.tls.insert(opens.map_err(|why| with_address(address, why))?)
                }
            };
            let (authority, path) = (address.authority(), request_path(&address.path(), resumes));
            let target = Target { authority: &authority, path: &path };
            first_to_answer(address, &servers, |server| open_secure_websocket(server, tls, target, token))
                .await
        }
        #[cfg(feature = "quic")]
        Scheme::Quic => open_quic(server, servers, memory).await,
        // Published scenes without the feature `http`, which were returned above otherwise, and other features.
        _ => {
            let _ = (token, resumes, memory, servers);
            let why =
                format!("{address}: this program was built without the transport {}", address.transport());
            Err(Close::new(CloseCode::Protocol, why))
        }
    }
}

/// Prepares requests to a published scene.
#[cfg(feature = "http")]
fn published(server: &Server) -> PublishedScene {
    let address = &server.address;
    if address.scheme == Scheme::File {
        return PublishedScene::File(FileFetch::new((&address.scene).into()));
    }
    let origin =
        Origin { tls: address.scheme == Scheme::Https, host: address.host.clone(), port: address.port };
    let target = HttpTarget { origin, path: address.scene.clone() };
    PublishedScene::Http(HttpFetch::new(target, server.clone()))
}

/// How the server's certificate is verified.
#[cfg(any(feature = "quic", feature = "tls"))]
async fn trust(server: &Server) -> Result<Trust, Close> {
    match server.address.pin {
        Some(pin) => Ok(pin.into()),
        None => server
            .authorities
            .roots()
            .await
            .map(Trust::Roots)
            .map_err(|why| with_address(&server.address, why)),
    }
}

impl Connection {
    /// Runs one session until it ends; gives the reason.
    pub(super) async fn run<H: Host>(
        self,
        address: &Address,
        memory: &mut ConnectionMemory,
        host: &mut H,
        clock: Clock,
    ) -> Close {
        match self {
            #[cfg(feature = "websocket")]
            Self::WebSocket(connection) => {
                let _ = (&address, &memory);
                run_websocket(*connection, host, clock).await
            }
            #[cfg(feature = "tls")]
            Self::SecureWebSocket(connection) => run_websocket(*connection, host, clock).await,
            #[cfg(feature = "quic")]
            Self::Quic(connection) => connection.run(address, memory, host, clock).await,
            #[cfg(feature = "http")]
            Self::Published(PublishedScene::Http(fetch)) => run_published(fetch, host, clock).await,
            #[cfg(feature = "http")]
            Self::Published(PublishedScene::File(fetch)) => run_published(fetch, host, clock).await,
        }
    }
}

#[cfg(feature = "quic")]
impl OpenedQuic {
    async fn run<H: Host>(
        self,
        address: &Address,
        memory: &mut ConnectionMemory,
        host: &mut H,
        clock: Clock,
    ) -> Close {
        let Self { endpoint, server, opened, rejection, has_other_addresses } = self;
        let (connection, early) = (opened.connection().clone(), opened.is_early());
        let close = run_quic(opened, host, clock).await;
        let answered = connection.stats().udp_rx.datagrams > 0;
        if let (true, Some(memory)) = (answered, &mut memory.quic) {
            memory.ticket_from = Some(server);
        }
        if !answered && has_other_addresses {
            // The server may have moved to another address. With the tickets, this one would be tried first again.
            memory.quic = None;
        }
        // With early data, the session may have begun before the certificate arrived.
        let close = match connection.close_reason() {
            Some(why) if early && is_tls_alert(&why) => {
                rejection.reason().map_or(close, |why| with_address(address, why))
            }
            _ => close,
        };
        let _ = timeout(CLOSE_TIMEOUT, endpoint.wait_idle()).await;
        close
    }
}

/// Adds the address to the reason of a failed attempt.
#[cfg(any(feature = "quic", feature = "tls"))]
fn with_address(address: &Address, why: Close) -> Close {
    Close { reason: format!("{address} cannot be reached: {}", why.reason), ..why }
}

#[cfg(feature = "websocket")]
async fn open_websocket(
    server: SocketAddr,
    target: Target<'_>,
    token: Option<&Token>,
) -> Result<Connection, Close> {
    if token.is_some() && !server.ip().is_loopback() {
        let why = "a token is not sent over ws://, which is not encrypted: use wss:// or quic://";
        return Err(Close::new(CloseCode::Protocol, why));
    }
    let (stream, received) = counting(open_tcp(server).await?);
    let connection = WebSocketConnection::open_counted(stream, received, target, token, STEP_TIMEOUT).await?;
    Ok(Connection::WebSocket(Box::new(connection)))
}

#[cfg(feature = "tls")]
async fn open_secure_websocket(
    server: SocketAddr,
    tls: &super::tls::Tls,
    target: Target<'_>,
    token: Option<&Token>,
) -> Result<Connection, Close> {
    // Counted below TLS: transport payload.
    let (stream, received) = counting(open_tcp(server).await?);
    let stream = tls.open(stream, STEP_TIMEOUT).await?;
    let connection = WebSocketConnection::open_counted(stream, received, target, token, STEP_TIMEOUT).await?;
    Ok(Connection::SecureWebSocket(Box::new(connection)))
}

#[cfg(feature = "quic")]
async fn open_quic(
    server: &Server,
    mut servers: Vec<SocketAddr>,
    memory: &mut ConnectionMemory,
) -> Result<Connection, Close> {
    let address = &server.address;
    if memory.quic.is_none() {
        let rejection = CertificateRejection::default();
        let config = client_config_of(trust(server).await?, rejection.clone(), &address.scene);
        let config = config.map_err(|why| with_address(address, lost(why.to_string())))?;
        memory.quic = Some(QuicResumption { config, rejection, ticket_from: None });
    }
    let Some(memory) = &memory.quic else { return Err(with_address(address, lost("QUIC cannot be set up"))) };
    // A ticket is valid at the address that issued it: there the session begins before the server answers.
    if let Some(at) = servers.iter().position(|&server| Some(server) == memory.ticket_from) {
        servers[..=at].rotate_right(1);
    }
    let has_other_addresses = servers.len() > 1;
    // A certificate that is verified by its fingerprint needs no name.
    let name = if address.pin.is_some() { "localhost" } else { &address.host };
    first_to_answer(address, &servers, |server| open_one_quic(server, name, memory, has_other_addresses))
        .await
}

#[cfg(feature = "quic")]
async fn open_one_quic(
    server: SocketAddr,
    name: &str,
    memory: &QuicResumption,
    has_other_addresses: bool,
) -> Result<Connection, Close> {
    let QuicResumption { config, rejection, .. } = memory;
    let endpoint = endpoint(server, config.clone()).map_err(|why| lost(why.to_string()))?;
    let connecting = endpoint.connect(server, name).map_err(|why| lost(why.to_string()))?;
    match QuicConnection::open(connecting, STEP_TIMEOUT).await {
        Ok(opened) => {
            let rejection = rejection.clone();
            Ok(Connection::Quic(Box::new(OpenedQuic {
                endpoint,
                server,
                opened,
                rejection,
                has_other_addresses,
            })))
        }
        Err(QuicOpenError::Handshake(why)) if is_tls_alert(&why) => {
            Err(rejection.reason().unwrap_or_else(|| quic::close_of(&why)))
        }
        Err(QuicOpenError::Handshake(why)) => Err(quic::close_of(&why)),
        Err(QuicOpenError::Timeout) => Err(no_answer()),
    }
}

/// Whether TLS closed the connection (RFC 9001, section 4.8), for example because of the certificate.
#[cfg(feature = "quic")]
fn is_tls_alert(why: &quinn::ConnectionError) -> bool {
    matches!(why, quinn::ConnectionError::TransportError(e) if (0x100..0x200).contains(&u64::from(e.code)))
}
