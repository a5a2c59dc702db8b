//! Connecting over real sockets, and again when the connection is lost.

use std::net::SocketAddr;
use std::time::Duration;

use lodestream_protocol::client::Backoff;
use lodestream_protocol::message::{Close, CloseCode};
#[cfg(feature = "websocket")]
use tokio::net::TcpStream;
use tokio::net::lookup_host;
use tokio::time::{Instant, sleep_until, timeout};

use super::address::{Address, Scheme};
use super::drive::{Clock, Host};
#[cfg(feature = "websocket")]
use super::websocket::run_websocket;
#[cfg(feature = "quic")]
use super::{
    pin::Pin,
    quic::{self, client_config, endpoint, run_quic},
    quic_open::{QuicConnection, QuicOpenError},
};

/// Time that name lookup and the opening of a connection may take.
const CONNECT_TIMEOUT: Duration = Duration::from_secs(4);
#[cfg(feature = "quic")]
/// Time in which a closed QUIC connection tells the server.
const GOODBYE_TIMEOUT: Duration = Duration::from_millis(300);

/// How often to try.
#[derive(Clone, Copy, Debug)]
pub struct Retry {
    /// Attempts until the first session; afterwards there is no limit.
    pub first_attempts: u32,
    /// Whether to connect again when a session is lost.
    pub reconnect: bool,
}

impl Default for Retry {
    /// Five attempts, and again whenever a session is lost: for a program with a user before it.
    fn default() -> Self {
        Self { first_attempts: 5, reconnect: true }
    }
}

/// Why streaming came to an end.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum End {
    /// The host wanted to leave.
    Left,
    /// The server was never reached.
    Unreachable {
        /// Attempts made.
        attempts: u32,
        /// What came of the last one.
        why: String,
    },
    /// The session ended and connecting again cannot help, or was not wanted.
    Closed(Close),
}

impl std::fmt::Display for End {
    /// One line for people: what happened, and what they may do.
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Left => f.write_str("interrupted"),
            Self::Unreachable { attempts, why } => {
                write!(f, "{why} ({attempts} attempts); is the server running, and is the address right?")
            }
            Self::Closed(close) => f.write_str(&close.reason),
        }
    }
}

/// Streams from a server until the host leaves: connects, runs the session, and connects again with ever
/// longer pauses when it is lost. `report` is told in words what is going on (`None`: all is well).
pub async fn stream<H: Host>(
    address: &Address,
    host: &mut H,
    clock: Clock,
    retry: Retry,
    mut report: impl FnMut(&mut H, Option<String>),
) -> End {
    host.core().begin(clock.now());
    let mut backoff = Backoff::new();
    let mut reached = false;
    let mut attempts = 0;
    let mut kept = Kept::default();
    loop {
        if host.wants_to_leave() {
            return End::Left;
        }
        let close = tokio::select! {
            biased;
            close = connect_and_run(address, &mut kept, host, clock) => close,
        };
        if host.wants_to_leave() {
            return End::Left;
        }
        attempts += 1;
        if host.core().milestones().first_frame.is_some() || host.core().scene().is_some() {
            reached = true;
        }
        if !close.code.worth_retrying() || (reached && !retry.reconnect) {
            return End::Closed(close);
        }
        if !reached && attempts >= retry.first_attempts {
            return End::Unreachable { attempts, why: close.reason };
        }
        if host.core().stats().session.blobs > 0 {
            backoff.succeeded();
        }
        // Spreads the clients of a restarted server; any number will do.
        let random = u32::try_from(clock.now().as_ns() & 0xFFFF_FFFF).unwrap_or(0);
        let wait = backoff.next_wait(random);
        report(host, Some(format!("{}; connecting again in {:.1} s", close.reason, wait.as_secs_f32())));
        let until = Instant::now() + wait;
        while Instant::now() < until && !host.wants_to_leave() {
            // The picture goes on: what is here can be refined and drawn without a server.
            let now = clock.now();
            host.core().handle_timeout(now);
            let _ = host.turn(now);
            tokio::select! {
                biased;
                () = sleep_until(until) => {}
                () = host.wake() => {}
            }
        }
        report(host, Some(format!("connecting to {address}")));
    }
}

/// What attempts leave to those after them.
#[derive(Default)]
struct Kept {
    /// Holds what resumes a session.
    #[cfg(feature = "quic")]
    quic: Option<quinn::ClientConfig>,
}

/// One attempt: opens a connection and runs a session over it.
async fn connect_and_run<H: Host>(address: &Address, kept: &mut Kept, host: &mut H, clock: Clock) -> Close {
    match address.scheme {
        #[cfg(feature = "websocket")]
        Scheme::WebSocket => over_websocket(address, host, clock).await,
        #[cfg(feature = "quic")]
        Scheme::Quic(pin) => over_quic(address, pin, &mut kept.quic, host, clock).await,
        #[cfg(not(all(feature = "quic", feature = "websocket")))]
        _ => {
            let _ = kept;
            let why = format!("{address}: this program was built without that transport");
            Close::new(CloseCode::Protocol, why)
        }
    }
}

fn lost(why: String) -> Close {
    Close::new(CloseCode::Lost, why)
}

#[cfg(feature = "websocket")]
async fn over_websocket<H: Host>(address: &Address, host: &mut H, clock: Clock) -> Close {
    let server = match find(address).await {
        Ok(server) => server,
        Err(why) => return lost(why),
    };
    match timeout(CONNECT_TIMEOUT, TcpStream::connect(server)).await {
        Ok(Ok(stream)) => {
            let _ = stream.set_nodelay(true);
            run_websocket(stream, &address.authority(), host, clock).await
        }
        Ok(Err(why)) => lost(format!("{address} cannot be reached: {why}")),
        Err(_) => lost(format!("{address} does not answer")),
    }
}

#[cfg(feature = "quic")]
async fn over_quic<H: Host>(
    address: &Address,
    pin: Pin,
    kept: &mut Option<quinn::ClientConfig>,
    host: &mut H,
    clock: Clock,
) -> Close {
    let server = match find(address).await {
        Ok(server) => server,
        Err(why) => return lost(why),
    };
    let config = match kept.take().map_or_else(|| client_config(pin), Ok) {
        Ok(config) => kept.insert(config).clone(),
        Err(why) => return lost(why.to_string()),
    };
    let endpoint = match endpoint(server, config) {
        Ok(endpoint) => endpoint,
        Err(why) => return lost(why.to_string()),
    };
    // The name is not looked at: the certificate is pinned.
    let connecting = match endpoint.connect(server, "localhost") {
        Ok(connecting) => connecting,
        Err(why) => return lost(format!("{address} cannot be reached: {why}")),
    };
    let close = match QuicConnection::open(connecting, CONNECT_TIMEOUT).await {
        Ok(opened) => {
            let (connection, early) = (opened.connection().clone(), opened.is_early());
            let close = run_quic(opened, host, clock).await;
            // With early data, a session can have begun before the certificate was seen.
            match connection.close_reason() {
                Some(why) if early && is_wrong_certificate(&why) => refused(address, &why),
                _ => close,
            }
        }
        Err(QuicOpenError::Handshake(why)) => refused(address, &why),
        Err(QuicOpenError::Timeout) => lost(format!("{address} does not answer")),
    };
    let _ = timeout(GOODBYE_TIMEOUT, endpoint.wait_idle()).await;
    close
}

/// Looks the address's name up.
async fn find(address: &Address) -> Result<SocketAddr, String> {
    let authority = address.authority();
    match timeout(CONNECT_TIMEOUT, resolve(&authority)).await {
        Ok(Ok(server)) => Ok(server),
        Ok(Err(why)) => Err(format!("{authority} cannot be found: {why}")),
        Err(_) => Err(format!("{authority} cannot be found: name lookup takes too long")),
    }
}

async fn resolve(authority: &str) -> std::io::Result<SocketAddr> {
    let none = || std::io::Error::new(std::io::ErrorKind::NotFound, "no address");
    lookup_host(authority).await?.next().ok_or_else(none)
}

#[cfg(feature = "quic")]
fn is_wrong_certificate(why: &quinn::ConnectionError) -> bool {
    matches!(why, quinn::ConnectionError::TransportError(e)
        if e.reason.contains("ApplicationVerificationFailure") || e.reason.contains("invalid peer certificate"))
}

#[cfg(feature = "quic")]
/// A handshake that failed. A wrong certificate will be wrong again.
fn refused(address: &Address, why: &quinn::ConnectionError) -> Close {
    if is_wrong_certificate(why) {
        return Close::new(
            CloseCode::Protocol,
            format!(
                "{address} has another certificate than the address names after #sha256=: copy the address that the server prints at start"
            ),
        );
    }
    let close = quic::closed_by(why);
    Close { reason: format!("{address} cannot be reached: {}", close.reason), ..close }
}
