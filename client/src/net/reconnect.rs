//! Connecting over real sockets, and again when the connection is lost.

use std::future::Future;
use std::pin::pin;
use std::time::Duration;

use lodestream_protocol::client::Backoff;
use lodestream_protocol::message::{Close, CloseCode, Token};
use lodestream_protocol::time::Time;
#[cfg(all(feature = "runtime", feature = "websocket"))]
use tokio::io::{AsyncRead, AsyncWrite};
use tokio::time::{Instant, sleep_until, timeout_at};

use super::addresses::{Resolver, System};
use super::connect::{Connection, ConnectionMemory, connect};
use super::drive::{Clock, Host};
#[cfg(all(feature = "runtime", feature = "quic"))]
use super::quic::run_quic;
#[cfg(all(feature = "runtime", feature = "quic"))]
use super::quic_open::QuicConnection;
use super::server::Server;
#[cfg(all(feature = "runtime", feature = "websocket"))]
use super::websocket::{WebSocketConnection, run_websocket};
use crate::core::Progress;

/// Time that an attempt is given at least: where less is left, none is begun.
const LEAST_ATTEMPT: Duration = Duration::from_secs(1);

/// A session that went on for less than this before it was lost counts as a failure, whatever it brought: a server that
/// cuts every session after the first blob would be connected to twice a second for ever.
const USEFUL_AFTER: Duration = Duration::from_secs(10);

/// How often to try.
#[derive(Clone, Copy, Debug)]
pub struct Retry {
    /// Attempts until the first session; afterwards there is no limit.
    pub first_attempts: u32,
    /// Time until the first connection, over all attempts.
    pub first_within: Duration,
    /// Whether to connect again when a session is lost.
    pub reconnect: bool,
}

impl Default for Retry {
    /// Five attempts in 4.5 s, and again whenever a session is lost: for a program with a user before it.
    fn default() -> Self {
        Self { first_attempts: 5, first_within: Duration::from_millis(4500), reconnect: true }
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
                let attempts =
                    if *attempts == 1 { "1 attempt".into() } else { format!("{attempts} attempts") };
                write!(f, "{why} ({attempts}); is the server running, and is the address right?")
            }
            Self::Closed(close) if close.code == CloseCode::Unauthorised => {
                write!(f, "{}: ask whoever runs the server for a token (--token-file FILE)", close.reason)
            }
            Self::Closed(close) => f.write_str(&close.reason),
        }
    }
}

/// Streams from a server until the host leaves: connects, runs the session, and connects again with ever
/// longer pauses when it is lost. Every step of that has a deadline, and none outlasts the host's wish to leave.
/// `report` is told in words what is going on (`None`: all is well).
pub async fn stream<H: Host>(
    server: &Server,
    host: &mut H,
    clock: Clock,
    retry: Retry,
    report: impl FnMut(&mut H, Option<String>),
) -> End {
    stream_to(server, &System, host, clock, retry, report).await
}

/// As [`stream`], to where a resolver says that the address's name is.
pub(super) async fn stream_to<H: Host>(
    server: &Server,
    resolver: &impl Resolver,
    host: &mut H,
    clock: Clock,
    retry: Retry,
    report: impl FnMut(&mut H, Option<String>),
) -> End {
    if !server.address.scene.is_empty() {
        host.core().ask_for(&server.address.scene);
    }
    let sockets = Sockets { server, resolver, kept: ConnectionMemory::default() };
    stream_by(sockets, host, clock, retry, report).await
}

/// As [`stream`], over QUIC connections that `connect` opens: those of a host's own endpoint, or of a simulated one in
/// virtual time. What `connect` does must have a deadline. `name` is what the host is told of where they lead.
#[cfg(all(feature = "runtime", feature = "quic"))]
pub async fn stream_quic<H: Host>(
    name: &str,
    connect: impl AsyncFnMut() -> Result<QuicConnection, Close>,
    host: &mut H,
    clock: Clock,
    retry: Retry,
    report: impl FnMut(&mut H, Option<String>),
) -> End {
    stream_by(Opened { name, connect }, host, clock, retry, report).await
}

/// As [`stream_quic`], over WebSockets.
#[cfg(all(feature = "runtime", feature = "websocket"))]
pub async fn stream_websocket<S: AsyncRead + AsyncWrite + Unpin, H: Host>(
    name: &str,
    connect: impl AsyncFnMut() -> Result<WebSocketConnection<S>, Close>,
    host: &mut H,
    clock: Clock,
    retry: Retry,
    report: impl FnMut(&mut H, Option<String>),
) -> End {
    stream_by(Opened { name, connect }, host, clock, retry, report).await
}

/// How connections come about, and run.
trait Connector {
    type Connection;

    /// Opens one, for a client with a token or without.
    async fn connect(&mut self, token: Option<&Token>) -> Result<Self::Connection, Close>;

    /// Runs a session until it ends; says why.
    async fn run<H: Host>(&mut self, connection: Self::Connection, host: &mut H, clock: Clock) -> Close;

    /// Where connections lead.
    fn to(&self) -> String;
}

/// Over real sockets.
struct Sockets<'a, R> {
    server: &'a Server,
    resolver: &'a R,
    kept: ConnectionMemory,
}

impl<R: Resolver> Connector for Sockets<'_, R> {
    type Connection = Connection;

    async fn connect(&mut self, token: Option<&Token>) -> Result<Connection, Close> {
        connect(self.server, token, &mut self.kept, self.resolver).await
    }

    async fn run<H: Host>(&mut self, connection: Connection, host: &mut H, clock: Clock) -> Close {
        connection.run(&self.server.address, &mut self.kept, host, clock).await
    }

    fn to(&self) -> String {
        self.server.address.to_string()
    }
}

/// Over connections that the host opens.
#[cfg(feature = "runtime")]
struct Opened<'a, F> {
    name: &'a str,
    connect: F,
}

/// A connection that a host may open.
#[cfg(feature = "runtime")]
trait Run {
    async fn run<H: Host>(self, host: &mut H, clock: Clock) -> Close;
}

#[cfg(all(feature = "runtime", feature = "quic"))]
impl Run for QuicConnection {
    async fn run<H: Host>(self, host: &mut H, clock: Clock) -> Close {
        run_quic(self, host, clock).await
    }
}

#[cfg(all(feature = "runtime", feature = "websocket"))]
impl<S: AsyncRead + AsyncWrite + Unpin> Run for WebSocketConnection<S> {
    async fn run<H: Host>(self, host: &mut H, clock: Clock) -> Close {
        run_websocket(self, host, clock).await
    }
}

#[cfg(feature = "runtime")]
impl<C: Run, F: AsyncFnMut() -> Result<C, Close>> Connector for Opened<'_, F> {
    type Connection = C;

    async fn connect(&mut self, _token: Option<&Token>) -> Result<C, Close> {
        (self.connect)().await
    }

    async fn run<H: Host>(&mut self, connection: C, host: &mut H, clock: Clock) -> Close {
        connection.run(host, clock).await
    }

    fn to(&self) -> String {
        self.name.to_owned()
    }
}

/// Any number for the length of a pause, and far from that of a moment near by: clients that lose one server lose it at
/// about the same time, and may have been started together. Fibonacci hashing (Knuth, The Art of Computer Programming,
/// vol. 3, section 6.4).
fn spread(now: Time) -> u32 {
    u32::try_from(now.as_ns().wrapping_mul(0x9E37_79B9_7F4A_7C15) >> 32).unwrap_or(0)
}

async fn stream_by<H: Host>(
    mut connector: impl Connector,
    host: &mut H,
    clock: Clock,
    retry: Retry,
    mut report: impl FnMut(&mut H, Option<String>),
) -> End {
    host.core().begin(clock.now());
    let mut backoff = Backoff::new();
    let mut reached = false;
    let mut attempts = 0;
    // `None`: further away than there is time.
    let until = Instant::now().checked_add(retry.first_within);
    loop {
        if host.wants_to_leave() {
            return End::Left;
        }
        let limit = until.filter(|_| !reached);
        let token = host.core().token().cloned();
        let connecting = within(limit, retry.first_within, connector.connect(token.as_ref()));
        let mut lasted = Duration::ZERO;
        let close = match meanwhile(host, clock, connecting).await {
            None => return End::Left,
            Some(Err(close)) => close,
            Some(Ok(connection)) => {
                let began = clock.now();
                let close = connector.run(connection, host, clock).await;
                lasted = clock.now().since(began);
                close
            }
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
        if lasted >= USEFUL_AFTER && host.core().stats().session.blobs > 0 {
            backoff.succeeded();
        }
        let wait = backoff.next_wait(spread(clock.now()));
        let late = until.is_some_and(|until| Instant::now() + wait + LEAST_ATTEMPT > until);
        if !reached && (late || attempts >= retry.first_attempts) {
            return End::Unreachable { attempts, why: close.reason };
        }
        report(host, Some(format!("{}; connecting again in {:.1} s", close.reason, wait.as_secs_f32())));
        if meanwhile(host, clock, sleep_until(Instant::now() + wait)).await.is_none() {
            return End::Left;
        }
        report(host, Some(format!("connecting to {}", connector.to())));
    }
}

/// Connects in time, where there is a limit.
async fn within<T>(
    limit: Option<Instant>,
    all: Duration,
    connecting: impl Future<Output = Result<T, Close>>,
) -> Result<T, Close> {
    match limit {
        None => connecting.await,
        Some(limit) => timeout_at(limit, connecting).await.unwrap_or_else(|_| {
            Err(Close::new(CloseCode::Lost, format!("no connection within {} s", all.as_secs_f32())))
        }),
    }
}

/// Waits for something while the picture goes on: what is here can be refined and drawn without a server. `None` once
/// the host wants to leave.
async fn meanwhile<H: Host, T>(host: &mut H, clock: Clock, what: impl Future<Output = T>) -> Option<T> {
    let mut what = pin!(what);
    loop {
        let now = clock.now();
        host.core().handle_timeout(now);
        let again = host.turn(now) == Progress::More;
        if host.wants_to_leave() {
            return None;
        }
        tokio::select! {
            biased;
            done = &mut what => return Some(done),
            () = tokio::task::yield_now(), if again => {}
            () = host.wake() => {}
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn clients_that_were_started_together_came_back_together() {
        // Fifty that lose the server within 50 ms of their clocks.
        let mut waits: Vec<Duration> =
            (0..50).map(|ms| Backoff::new().next_wait(spread(Time::from_ms(30_000 + ms)))).collect();
        waits.sort_unstable();
        // Of a range of 250 ms.
        assert!(waits[49] - waits[0] > Duration::from_millis(225), "{waits:?}");
        let together = waits.windows(6).map(|six| six[5] - six[0]).min().unwrap();
        assert!(together > Duration::from_millis(5), "six within {together:?}");
    }
}
