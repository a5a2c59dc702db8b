//! Opening a connection to a server: every step has a deadline, and every address of its name is tried.

use std::net::SocketAddr;
use std::time::Duration;

use lodestream_protocol::message::{Close, CloseCode};
use tokio::time::timeout;

use super::address::{Address, Scheme};
use super::addresses::{Resolver, find, first_to_answer};
use super::drive::{Clock, Host};
#[cfg(feature = "websocket")]
use super::websocket::{WebSocketConnection, run_websocket};
#[cfg(feature = "quic")]
use super::{
    pin::Pin,
    quic::{self, client_config, endpoint, run_quic},
    quic_open::{QuicConnection, QuicOpenError},
};

/// Time that each step of opening a connection may take: TCP, the WebSocket request, QUIC's handshake.
pub(super) const STEP_TIMEOUT: Duration = Duration::from_secs(4);
/// Time in which a closed QUIC connection tells the server.
#[cfg(feature = "quic")]
const GOODBYE_TIMEOUT: Duration = Duration::from_millis(300);

/// What attempts leave to those after them.
#[derive(Default)]
pub(super) struct Kept {
    /// Holds what resumes a session, with the address that gave it.
    #[cfg(feature = "quic")]
    quic: Option<(quinn::ClientConfig, Option<SocketAddr>)>,
}

/// A connection on which a session can begin.
pub(super) enum Connection {
    #[cfg(feature = "websocket")]
    WebSocket(Box<WebSocketConnection<tokio::net::TcpStream>>),
    #[cfg(feature = "quic")]
    Quic { endpoint: quinn::Endpoint, server: SocketAddr, opened: QuicConnection, others: bool },
}

/// Opens a connection. Ends in bounded time: [`STEP_TIMEOUT`] for each step, and a quarter of a second for each
/// address before the last.
pub(super) async fn connect(
    address: &Address,
    kept: &mut Kept,
    resolver: &impl Resolver,
) -> Result<Connection, Close> {
    let servers = find(address, resolver).await?;
    match address.scheme {
        #[cfg(feature = "websocket")]
        Scheme::WebSocket => {
            let authority = address.authority();
            first_to_answer(address, &servers, |server| open_websocket(server, &authority)).await
        }
        #[cfg(feature = "quic")]
        Scheme::Quic(pin) => open_quic(address, pin, servers, kept).await,
        #[cfg(not(all(feature = "quic", feature = "websocket")))]
        _ => {
            let _ = (kept, servers);
            let why = format!("{address}: this program was built without that transport");
            Err(Close::new(CloseCode::Protocol, why))
        }
    }
}

impl Connection {
    /// Runs one session until it ends; says why.
    pub(super) async fn run<H: Host>(
        self,
        address: &Address,
        kept: &mut Kept,
        host: &mut H,
        clock: Clock,
    ) -> Close {
        match self {
            #[cfg(feature = "websocket")]
            Self::WebSocket(connection) => {
                let _ = (address, kept);
                run_websocket(*connection, host, clock).await
            }
            #[cfg(feature = "quic")]
            Self::Quic { endpoint, server, opened, others } => {
                let (connection, early) = (opened.connection().clone(), opened.is_early());
                let close = run_quic(opened, host, clock).await;
                let answered = connection.stats().udp_rx.datagrams > 0;
                if let (true, Some((_, gave))) = (answered, &mut kept.quic) {
                    *gave = Some(server);
                }
                if !answered && others {
                    // Another address may lead to the server now; with tickets, this one would be believed again.
                    kept.quic = None;
                }
                // With early data, a session can have begun before the certificate was seen.
                let close = match connection.close_reason() {
                    Some(why) if early && is_wrong_certificate(&why) => at(address, refused(&why)),
                    _ => close,
                };
                let _ = timeout(GOODBYE_TIMEOUT, endpoint.wait_idle()).await;
                close
            }
        }
    }
}

#[cfg(feature = "quic")]
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
async fn open_websocket(server: SocketAddr, authority: &str) -> Result<Connection, Close> {
    let stream = match timeout(STEP_TIMEOUT, tokio::net::TcpStream::connect(server)).await {
        Ok(Ok(stream)) => stream,
        Ok(Err(why)) => return Err(lost(why.to_string())),
        Err(_) => return Err(no_answer()),
    };
    let _ = stream.set_nodelay(true);
    let connection = WebSocketConnection::open(stream, authority, STEP_TIMEOUT).await?;
    Ok(Connection::WebSocket(Box::new(connection)))
}

#[cfg(feature = "quic")]
async fn open_quic(
    address: &Address,
    pin: Pin,
    mut servers: Vec<SocketAddr>,
    kept: &mut Kept,
) -> Result<Connection, Close> {
    let (config, gave) = match kept.quic.take().map_or_else(|| client_config(pin).map(|c| (c, None)), Ok) {
        Ok(config) => kept.quic.insert(config).clone(),
        Err(why) => return Err(at(address, lost(why.to_string()))),
    };
    // A ticket is of use where it came from; there the session begins before the server has answered.
    if let Some(at) = servers.iter().position(|&server| Some(server) == gave) {
        servers[..=at].rotate_right(1);
    }
    let others = servers.len() > 1;
    first_to_answer(address, &servers, |server| open_one_quic(server, config.clone(), others)).await
}

#[cfg(feature = "quic")]
async fn open_one_quic(
    server: SocketAddr,
    config: quinn::ClientConfig,
    others: bool,
) -> Result<Connection, Close> {
    let endpoint = endpoint(server, config).map_err(|why| lost(why.to_string()))?;
    // The name is not looked at: the certificate is pinned.
    let connecting = endpoint.connect(server, "localhost").map_err(|why| lost(why.to_string()))?;
    match QuicConnection::open(connecting, STEP_TIMEOUT).await {
        Ok(opened) => Ok(Connection::Quic { endpoint, server, opened, others }),
        Err(QuicOpenError::Handshake(why)) => Err(refused(&why)),
        Err(QuicOpenError::Timeout) => Err(no_answer()),
    }
}

#[cfg(feature = "quic")]
fn is_wrong_certificate(why: &quinn::ConnectionError) -> bool {
    matches!(why, quinn::ConnectionError::TransportError(e)
        if e.reason.contains("ApplicationVerificationFailure") || e.reason.contains("invalid peer certificate"))
}

/// A handshake that failed. A wrong certificate will be wrong again.
#[cfg(feature = "quic")]
fn refused(why: &quinn::ConnectionError) -> Close {
    if is_wrong_certificate(why) {
        return Close::new(
            CloseCode::Protocol,
            "it has another certificate than the address names after #sha256=: copy the address that the server prints \
             at start",
        );
    }
    quic::closed_by(why)
}
