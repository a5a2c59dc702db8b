//! Connects, and reconnects with exponential backoff when the connection is lost.

use std::future::Future;
use std::pin::pin;
use std::time::Duration;

use lodestream_protocol::client::Backoff;
use lodestream_protocol::message::{Close, CloseCode, Token};
use lodestream_transport::Clock;
#[cfg(all(feature = "runtime", feature = "websocket"))]
use tokio::io::{AsyncRead, AsyncWrite};
use tokio::time::{Instant, sleep_until, timeout_at};

use super::addresses::{Resolver, SystemResolver};
use super::connect::{Connection, ConnectionMemory, connect};
use super::drive::Host;
#[cfg(all(feature = "runtime", feature = "quic"))]
use super::quic::run_quic;
#[cfg(all(feature = "runtime", feature = "quic"))]
use super::quic_open::QuicConnection;
use super::server::Server;
#[cfg(all(feature = "runtime", feature = "websocket"))]
use super::websocket::{WebSocketConnection, run_websocket};
use crate::core::Progress;

/// Least time for an attempt: with less left before the deadline, none is begun.
const MIN_ATTEMPT: Duration = Duration::from_secs(1);

/// A session that is lost sooner than this counts as a failed attempt, even if blobs arrived. Without that, a client
/// would reconnect twice a second to a server that cuts every session after the first blob.
const MIN_USEFUL_SESSION: Duration = Duration::from_secs(10);

/// When to connect again.
#[derive(Clone, Copy, Debug)]
pub struct Retry {
    /// Most attempts before the first session; afterwards there is no limit.
    pub first_attempts: u32,
    /// Time limit for the first connection, over all attempts.
    pub first_within: Duration,
    /// Whether to reconnect when a session is lost.
    pub reconnect: bool,
}

impl Default for Retry {
    /// Five attempts within 4.5 s, and reconnection of lost sessions: for interactive programs.
    fn default() -> Self {
        Self { first_attempts: 5, first_within: Duration::from_millis(4500), reconnect: true }
    }
}

/// Why streaming ended.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum End {
    /// The host requested it ([`Host::wants_to_leave`]).
    Left,
    /// The server was never reached.
    Unreachable {
        /// Attempts made.
        attempts: u32,
        /// Why the last one failed.
        why: String,
    },
    /// The session ended, and reconnecting cannot help or is disabled.
    Closed(Close),
}

impl std::fmt::Display for End {
    /// One line for users: what happened, and what to do.
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Left => f.write_str("interrupted"),
            Self::Unreachable { attempts, why } => {
                let attempts =
                    if *attempts == 1 { "1 attempt".into() } else { format!("{attempts} attempts") };
                write!(f, "{why} ({attempts}); is the server running, and is the address right?")
            }
            Self::Closed(close) if close.code == CloseCode::Unauthorised => {
                write!(f, "{}: ask the server's operator for a token", close.reason)
            }
            Self::Closed(close) => f.write_str(&close.reason),
        }
    }
}

/// Streams from a server until the host leaves: connects, runs the session, and reconnects with growing pauses when it
/// is lost. Every step has a deadline and ends at once when the host leaves. `report` gets a line about connection
/// problems for users, and `None` when there are none.
pub async fn stream<H: Host>(
    server: &Server,
    host: &mut H,
    clock: Clock,
    retry: Retry,
    report: impl FnMut(&mut H, Option<String>),
) -> End {
    stream_to(server, &SystemResolver, host, clock, retry, report).await
}

/// As [`stream`], with a given resolver.
pub(super) async fn stream_to<H: Host>(
    server: &Server,
    resolver: &impl Resolver,
    host: &mut H,
    clock: Clock,
    retry: Retry,
    report: impl FnMut(&mut H, Option<String>),
) -> End {
    if !server.address.scene.is_empty() && !server.address.scheme.is_published() {
        host.core().set_scene_name(&server.address.scene);
    }
    let sockets = Sockets { server, resolver, memory: ConnectionMemory::default() };
    stream_with(sockets, host, clock, retry, report).await
}

/// As [`stream`], over QUIC connections that `connect` opens: from the host's own endpoint, or a simulated one in
/// virtual time. `connect` must have a deadline. `name` stands for the server in reports.
#[cfg(all(feature = "runtime", feature = "quic"))]
pub async fn stream_quic<H: Host>(
    name: &str,
    connect: impl AsyncFnMut() -> Result<QuicConnection, Close>,
    host: &mut H,
    clock: Clock,
    retry: Retry,
    report: impl FnMut(&mut H, Option<String>),
) -> End {
    stream_with(HostConnector { name, connect }, host, clock, retry, report).await
}

/// As [`stream_quic`], over WebSockets.
#[cfg(all(feature = "runtime", feature = "websocket"))]
pub async fn stream_websocket<S: AsyncRead + AsyncWrite + Unpin + Send, H: Host>(
    name: &str,
    connect: impl AsyncFnMut() -> Result<WebSocketConnection<S>, Close>,
    host: &mut H,
    clock: Clock,
    retry: Retry,
    report: impl FnMut(&mut H, Option<String>),
) -> End {
    stream_with(HostConnector { name, connect }, host, clock, retry, report).await
}

/// Opens connections and runs sessions over them.
trait Connector {
    type Connection;

    /// Opens a connection; `token` authenticates the client. `resumes`: the client has something of the scene.
    async fn connect(&mut self, token: Option<&Token>, resumes: bool) -> Result<Self::Connection, Close>;

    /// Runs a session until it ends; gives the reason.
    async fn run<H: Host>(&mut self, connection: Self::Connection, host: &mut H, clock: Clock) -> Close;

    /// The server's address or name, for reports.
    fn server_name(&self) -> String;
}

/// Connects over sockets.
struct Sockets<'a, R> {
    server: &'a Server,
    resolver: &'a R,
    memory: ConnectionMemory,
}

impl<R: Resolver> Connector for Sockets<'_, R> {
    type Connection = Connection;

    async fn connect(&mut self, token: Option<&Token>, resumes: bool) -> Result<Connection, Close> {
        connect(self.server, token, resumes, &mut self.memory, self.resolver).await
    }

    async fn run<H: Host>(&mut self, connection: Connection, host: &mut H, clock: Clock) -> Close {
        connection.run(&self.server.address, &mut self.memory, host, clock).await
    }

    fn server_name(&self) -> String {
        self.server.address.to_string()
    }
}

/// Connects through a function of the host.
#[cfg(feature = "runtime")]
struct HostConnector<'a, F> {
    name: &'a str,
    connect: F,
}

/// A connection that a host can open.
#[cfg(feature = "runtime")]
trait RunSession {
    async fn run<H: Host>(self, host: &mut H, clock: Clock) -> Close;
}

#[cfg(all(feature = "runtime", feature = "quic"))]
impl RunSession for QuicConnection {
    async fn run<H: Host>(self, host: &mut H, clock: Clock) -> Close {
        run_quic(self, host, clock).await
    }
}

#[cfg(all(feature = "runtime", feature = "websocket"))]
impl<S: AsyncRead + AsyncWrite + Unpin + Send> RunSession for WebSocketConnection<S> {
    async fn run<H: Host>(self, host: &mut H, clock: Clock) -> Close {
        run_websocket(self, host, clock).await
    }
}

#[cfg(feature = "runtime")]
impl<C: RunSession, F: AsyncFnMut() -> Result<C, Close>> Connector for HostConnector<'_, F> {
    type Connection = C;

    async fn connect(&mut self, _token: Option<&Token>, _resumes: bool) -> Result<C, Close> {
        (self.connect)().await
    }

    async fn run<H: Host>(&mut self, connection: C, host: &mut H, clock: Clock) -> Close {
        connection.run(host, clock).await
    }

    fn server_name(&self) -> String {
        self.name.to_owned()
    }
}

/// Connects and runs sessions until one of the reasons in [`End`].
async fn stream_with<H: Host>(
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
    // `None`: the deadline is beyond the clock's range.
    let until = Instant::now().checked_add(retry.first_within);
    loop {
        if host.wants_to_leave() {
            return End::Left;
        }
        let limit = until.filter(|_| !reached);
        let token = host.core().token().cloned();
        let resumes = host.core().scene().is_some();
        let connecting = within(limit, retry.first_within, connector.connect(token.as_ref(), resumes));
        let mut lasted = Duration::ZERO;
        let close = match run_host_until(host, clock, connecting).await {
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
        if lasted >= MIN_USEFUL_SESSION && host.core().stats().session.blobs > 0 {
            backoff.succeeded();
        }
        let wait = backoff.next_wait_at(clock.now());
        let late = until.is_some_and(|until| Instant::now() + wait + MIN_ATTEMPT > until);
        if !reached && (late || attempts >= retry.first_attempts) {
            return End::Unreachable { attempts, why: close.reason };
        }
        report(host, Some(format!("{}; connecting again in {:.1} s", close.reason, wait.as_secs_f32())));
        if run_host_until(host, clock, sleep_until(Instant::now() + wait)).await.is_none() {
            return End::Left;
        }
        report(host, Some(format!("connecting to {}", connector.server_name())));
    }
}

/// Waits for a connection, until `limit` if there is one. `all` is the whole time allowed, for the message.
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

/// Waits for a future while the host keeps running: what has arrived is refined and drawn without a server. `None` once
/// the host leaves.
async fn run_host_until<H: Host, T>(
    host: &mut H,
    clock: Clock,
    future: impl Future<Output = T>,
) -> Option<T> {
    let mut future = pin!(future);
    loop {
        let now = clock.now();
        host.core().handle_timeout(now);
        let again = host.turn(now) == Progress::More;
        if host.wants_to_leave() {
            return None;
        }
        tokio::select! {
            biased;
            output = &mut future => return Some(output),
            () = tokio::task::yield_now(), if again => {}
            () = host.wake() => {}
        }
    }
}
