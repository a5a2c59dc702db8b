//! Opening a connection to a server: every step has a deadline, and every address of its name is tried.

use std::net::SocketAddr;
use std::time::Duration;

use lodestream_protocol::message::{Close, CloseCode, Token};
use tokio::time::timeout;

use super::address::{Address, Scheme};
use super::addresses::{Resolver, find, first_to_answer};
use super::drive::{Clock, Host};
use super::server::Server;
#[cfg(any(feature = "quic", feature = "tls"))]
use super::trust::Trust;
#[cfg(feature = "websocket")]
use super::websocket::{Counting, Target, WebSocketConnection, run_websocket};
#[cfg(feature = "quic")]
use super::{
    quic::{self, client_config_of, endpoint, run_quic},
    quic_open::{QuicConnection, QuicOpenError},
    trust::Refusal,
};
#[cfg(feature = "websocket")]
use tokio::net::TcpStream;

/// Time that each step of opening a connection may take: TCP, the WebSocket request, QUIC's handshake.
pub(super) const STEP_TIMEOUT: Duration = Duration::from_secs(4);
/// Time in which a closed QUIC connection tells the server.
#[cfg(feature = "quic")]
const GOODBYE_TIMEOUT: Duration = Duration::from_millis(300);

/// What attempts leave to those after them.
#[derive(Default)]
pub(super) struct ConnectionMemory {
    #[cfg(feature = "quic")]
    quic: Option<QuicResumption>,
    #[cfg(feature = "tls")]
    tls: Option<super::tls::Tls>,
}

/// Holds what resumes a session.
#[cfg(feature = "quic")]
struct QuicResumption {
    config: quinn::ClientConfig,
    refusal: Refusal,
    /// The address that gave it.
    gave: Option<SocketAddr>,
}

/// A connection on which a session can begin.
pub(super) enum Connection {
    #[cfg(feature = "websocket")]
    WebSocket(Box<WebSocketConnection<Counting<TcpStream>>>),
    #[cfg(feature = "tls")]
    SecureWebSocket(Box<WebSocketConnection<tokio_rustls::client::TlsStream<Counting<TcpStream>>>>),
    #[cfg(feature = "quic")]
    Quic(Box<OpenedQuic>),
}

#[cfg(feature = "quic")]
pub(super) struct OpenedQuic {
    endpoint: quinn::Endpoint,
    server: SocketAddr,
    opened: QuicConnection,
    refusal: Refusal,
    others: bool,
}

/// Opens a connection. Ends in bounded time: [`STEP_TIMEOUT`] for each step, and a quarter of a second for each
/// address before the last.
pub(super) async fn connect(
    server: &Server,
    token: Option<&Token>,
    kept: &mut ConnectionMemory,
    resolver: &impl Resolver,
) -> Result<Connection, Close> {
    let address = &server.address;
    let servers = find(address, resolver).await?;
    match address.scheme {
        #[cfg(feature = "websocket")]
        Scheme::WebSocket => {
            let (authority, path) = (address.authority(), address.path());
            let target = Target { authority: &authority, path: &path };
            first_to_answer(address, &servers, |server| open_websocket(server, target, token)).await
        }
        #[cfg(feature = "tls")]
        Scheme::SecureWebSocket => {
            let tls = match &kept.tls {
                Some(tls) => tls,
                None => {
                    let opens = super::tls::Tls::new(&address.host, trust(server).await?);
                    kept.tls.insert(opens.map_err(|why| at(address, why))?)
                }
            };
            let (authority, path) = (address.authority(), address.path());
            let target = Target { authority: &authority, path: &path };
            first_to_answer(address, &servers, |server| open_secure_websocket(server, tls, target, token))
                .await
        }
        #[cfg(feature = "quic")]
        Scheme::Quic => open_quic(server, servers, kept).await,
        #[cfg(not(all(feature = "quic", feature = "tls")))]
        _ => {
            let _ = (token, kept, servers);
            let why = format!("{address}: this program was built without that transport");
            Err(Close::new(CloseCode::Protocol, why))
        }
    }
}

/// By what a server is known.
#[cfg(any(feature = "quic", feature = "tls"))]
async fn trust(server: &Server) -> Result<Trust, Close> {
    match server.address.pin {
        Some(pin) => Ok(pin.into()),
        None => server.authorities.roots().await.map(Trust::Roots).map_err(|why| at(&server.address, why)),
    }
}

impl Connection {
    /// Runs one session until it ends; says why.
    pub(super) async fn run<H: Host>(
        self,
        address: &Address,
        kept: &mut ConnectionMemory,
        host: &mut H,
        clock: Clock,
    ) -> Close {
        match self {
            #[cfg(feature = "websocket")]
            Self::WebSocket(connection) => {
                let _ = (&address, &kept);
                run_websocket(*connection, host, clock).await
            }
            #[cfg(feature = "tls")]
            Self::SecureWebSocket(connection) => run_websocket(*connection, host, clock).await,
            #[cfg(feature = "quic")]
            Self::Quic(connection) => connection.run(address, kept, host, clock).await,
        }
    }
}

#[cfg(feature = "quic")]
impl OpenedQuic {
    async fn run<H: Host>(
        self,
        address: &Address,
        kept: &mut ConnectionMemory,
        host: &mut H,
        clock: Clock,
    ) -> Close {
        let Self { endpoint, server, opened, refusal, others } = self;
        let (connection, early) = (opened.connection().clone(), opened.is_early());
        let close = run_quic(opened, host, clock).await;
        let answered = connection.stats().udp_rx.datagrams > 0;
        if let (true, Some(kept)) = (answered, &mut kept.quic) {
            kept.gave = Some(server);
        }
        if !answered && others {
            // Another address may lead to the server now; with tickets, this one would be believed again.
            kept.quic = None;
        }
        // With early data, a session can have begun before the certificate was seen.
        let close = match connection.close_reason() {
            Some(why) if early && is_of_tls(&why) => refusal.reason().map_or(close, |why| at(address, why)),
            _ => close,
        };
        let _ = timeout(GOODBYE_TIMEOUT, endpoint.wait_idle()).await;
        close
    }
}

#[cfg(any(feature = "quic", feature = "tls"))]
fn at(address: &Address, why: Close) -> Close {
    Close { reason: format!("{address} cannot be reached: {}", why.reason), ..why }
}

/// What ended an attempt, without the address.
fn lost(why: impl Into<String>) -> Close {
    Close::new(CloseCode::Lost, why)
}

fn no_answer() -> Close {
    lost(format!("no answer within {} s", STEP_TIMEOUT.as_secs()))
}

#[cfg(feature = "websocket")]
async fn open_tcp(server: SocketAddr) -> Result<TcpStream, Close> {
    let stream = match timeout(STEP_TIMEOUT, TcpStream::connect(server)).await {
        Ok(Ok(stream)) => stream,
        Ok(Err(why)) => return Err(lost(why.to_string())),
        Err(_) => return Err(no_answer()),
    };
    let _ = stream.set_nodelay(true);
    Ok(stream)
}

#[cfg(feature = "websocket")]
async fn open_websocket(
    server: SocketAddr,
    target: Target<'_>,
    token: Option<&Token>,
) -> Result<Connection, Close> {
    if token.is_some() && !server.ip().is_loopback() {
        let why =
            "a token is not sent over ws://, where anybody on the way could take it: use wss:// or quic://";
        return Err(Close::new(CloseCode::Protocol, why));
    }
    let (stream, received) = Counting::new(open_tcp(server).await?);
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
    // Counted below TLS, as transports count.
    let (stream, received) = Counting::new(open_tcp(server).await?);
    let stream = tls.open(stream, STEP_TIMEOUT).await?;
    let connection = WebSocketConnection::open_counted(stream, received, target, token, STEP_TIMEOUT).await?;
    Ok(Connection::SecureWebSocket(Box::new(connection)))
}

#[cfg(feature = "quic")]
async fn open_quic(
    server: &Server,
    mut servers: Vec<SocketAddr>,
    kept: &mut ConnectionMemory,
) -> Result<Connection, Close> {
    let address = &server.address;
    if kept.quic.is_none() {
        let refusal = Refusal::default();
        let config = client_config_of(trust(server).await?, refusal.clone(), &address.scene);
        let config = config.map_err(|why| at(address, lost(why.to_string())))?;
        kept.quic = Some(QuicResumption { config, refusal, gave: None });
    }
    let Some(kept) = &kept.quic else { return Err(at(address, lost("QUIC cannot be set up"))) };
    // A ticket is of use where it came from; there the session begins before the server has answered.
    if let Some(at) = servers.iter().position(|&server| Some(server) == kept.gave) {
        servers[..=at].rotate_right(1);
    }
    let others = servers.len() > 1;
    // What a fingerprint knows needs no name.
    let name = if address.pin.is_some() { "localhost" } else { &address.host };
    first_to_answer(address, &servers, |server| open_one_quic(server, name, kept, others)).await
}

#[cfg(feature = "quic")]
async fn open_one_quic(
    server: SocketAddr,
    name: &str,
    kept: &QuicResumption,
    others: bool,
) -> Result<Connection, Close> {
    let QuicResumption { config, refusal, .. } = kept;
    let endpoint = endpoint(server, config.clone()).map_err(|why| lost(why.to_string()))?;
    let connecting = endpoint.connect(server, name).map_err(|why| lost(why.to_string()))?;
    match QuicConnection::open(connecting, STEP_TIMEOUT).await {
        Ok(opened) => {
            let refusal = refusal.clone();
            Ok(Connection::Quic(Box::new(OpenedQuic { endpoint, server, opened, refusal, others })))
        }
        Err(QuicOpenError::Handshake(why)) if is_of_tls(&why) => {
            Err(refusal.reason().unwrap_or_else(|| quic::closed_by(&why)))
        }
        Err(QuicOpenError::Handshake(why)) => Err(quic::closed_by(&why)),
        Err(QuicOpenError::Timeout) => Err(no_answer()),
    }
}

/// Whether TLS ended a connection (RFC 9001, section 4.8), perhaps because of its certificate.
#[cfg(feature = "quic")]
fn is_of_tls(why: &quinn::ConnectionError) -> bool {
    matches!(why, quinn::ConnectionError::TransportError(e) if (0x100..0x200).contains(&u64::from(e.code)))
}
