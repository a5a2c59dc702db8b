//! Connecting over real sockets, and again when the connection is lost.

use std::future::Future;
use std::pin::pin;

use lodestream_protocol::client::Backoff;
use lodestream_protocol::message::Close;
use tokio::time::{Instant, sleep_until};

use super::address::Address;
use super::addresses::{Resolver, System};
use super::connect::{Kept, connect};
use super::drive::{Clock, Host};
use crate::core::Progress;

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
/// longer pauses when it is lost. Every step of that has a deadline, and none outlasts the host's wish to leave.
/// `report` is told in words what is going on (`None`: all is well).
pub async fn stream<H: Host>(
    address: &Address,
    host: &mut H,
    clock: Clock,
    retry: Retry,
    report: impl FnMut(&mut H, Option<String>),
) -> End {
    stream_to(address, &System, host, clock, retry, report).await
}

/// As [`stream`], to where a resolver says that the address's name is.
pub(super) async fn stream_to<H: Host>(
    address: &Address,
    resolver: &impl Resolver,
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
        let close = match meanwhile(host, clock, connect(address, &mut kept, resolver)).await {
            None => return End::Left,
            Some(Err(close)) => close,
            Some(Ok(connection)) => connection.run(address, &mut kept, host, clock).await,
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
        if meanwhile(host, clock, sleep_until(Instant::now() + wait)).await.is_none() {
            return End::Left;
        }
        report(host, Some(format!("connecting to {address}")));
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
