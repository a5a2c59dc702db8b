//! The loop that connects a sans-IO session with a transport; one for both transports.
//!
//! A transport is two halves. [`Receive`] gives the client's messages. [`Deliver`] takes one thing at a
//! time and is asked for the next only when the transport has taken the last, so that what waits, waits
//! in the session's scheduler, where it can still be overtaken, and not in a socket.

use std::future::Future;
use std::net::SocketAddr;
use std::pin::pin;
use std::sync::Arc;
use std::time::Duration;

use lodestream_protocol::Time;
use lodestream_protocol::frame::FrameError;
use lodestream_protocol::message::{ClientMessage, Close, CloseCode, ServerMessage};
use lodestream_protocol::server::{ServerSession, Transmit};
use lodestream_protocol::shared_rate_limit::Weight;
use tokio::time::{Instant, sleep_until};

use crate::admission::byte_rate::TOO_MUCH;
use crate::admission::gate::{Admitted, Judging, admit, judged, refusal};
use crate::admission::message_rate::MessageRateLimiter;
use crate::admission::refusal::Refusal;
use crate::auth::grant::{Grant, TokenError};
use crate::session::progress::Progress;
use crate::session::reads::Reads;
use crate::session::state::{Phase, SessionGuard};

/// What came from the client.
#[derive(Debug)]
pub(crate) enum Received {
    /// A message.
    Message(ClientMessage),
    /// Something that is passed over, and counts as a message all the same: it was work.
    Skipped,
    /// More bytes than a client may send.
    TooMuch,
    /// Bytes that are no message.
    Malformed(FrameError),
    /// A breach of the transport's own rules.
    Violation(String),
    /// The client ended the session in good order.
    Ended,
    /// The transport failed.
    Lost(String),
}

/// Receiving half of a transport.
pub(crate) trait Receive: Send {
    /// The next thing that comes. Must be safe to drop before it resolves. Not called again after
    /// `TooMuch`, `Malformed`, `Violation`, `Ended` or `Lost`.
    fn receive(&mut self) -> impl Future<Output = Received> + Send;

    /// Where the client is now, if that may change.
    fn peer(&self) -> Option<SocketAddr> {
        None
    }
}

/// Sending half of a transport.
pub(crate) trait Deliver: Send {
    /// Takes the next thing to send and gives its length in bytes. Called only while idle.
    fn start(&mut self, transmit: Transmit) -> Result<usize, FrameError>;
    /// Whether the transport has taken everything.
    fn is_idle(&self) -> bool;
    /// Resolves when the transport has taken everything. Must be safe to drop before it resolves.
    fn flush(&mut self) -> impl Future<Output = Result<(), String>> + Send;
}

/// Time that a session's last words may take.
const CLOSE_TIMEOUT: Duration = Duration::from_secs(1);
/// Least time between two looks at a session's timers while the transport takes nothing.
const BLOCKED_TICK: Duration = Duration::from_millis(20);
/// Least time to sleep: tokio's timers tick in milliseconds.
const TICK: Duration = Duration::from_millis(1);
/// Messages that a token costs: a signature is verified.
const TOKEN_COST: u32 = 50;

/// The session's clock: tokio's, so that it follows paused time.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Clock(Instant);

impl Clock {
    pub(crate) fn start() -> Self {
        Self(Instant::now())
    }

    pub(crate) fn now(self) -> Time {
        Time::from(self.0.elapsed())
    }

    /// When a grant ends.
    fn granted(self, grant: &Grant) -> Time {
        tracing::debug!(subject = grant.subject, "a token was taken");
        Time::from(grant.until.saturating_duration_since(self.0))
    }

    fn instant(self, time: Time) -> Instant {
        // Far deadlines saturate.
        self.0.checked_add(Duration::from(time)).unwrap_or_else(|| self.0 + Duration::from_secs(1 << 30))
    }
}

/// Drives a session until it has ended and its last words have been taken; gives the reason, also to
/// the guard. The caller then closes the transport. The session has a lease from when `proof` of the client's address
/// is there and `Hello` was heard.
pub(crate) async fn drive<R: Receive, D: Deliver>(
    guard: &mut SessionGuard,
    proof: impl Future<Output = ()> + Send,
    receiver: &mut R,
    sender: &mut D,
) -> Close {
    let mut proof = pin!(proof);
    let mut proved = false;
    let Admitted { grant, version, hello } = match admit(guard, proof.as_mut(), &mut proved, receiver).await {
        Ok(admitted) => admitted,
        Err(close) => {
            match close.code {
                CloseCode::Unauthorised => guard.state.metrics().session_refused(Refusal::Token),
                CloseCode::NoSuchScene => guard.state.metrics().session_refused(Refusal::Scene),
                _ => {}
            }
            guard.ended = close.code;
            return close;
        }
    };
    let clock = Clock::start();
    let weight = grant.as_ref().map_or(Weight::ONE, |grant| grant.weight);
    let granted_bits_per_s = grant.as_ref().and_then(|grant| grant.rate_bits_per_s);
    let mut judging: Option<Judging> = None;
    let mut token_until = grant.map(|grant| clock.granted(&grant));
    let state = guard.state.clone();
    let metrics = state.metrics();
    let config = state.config_of(guard.transport, granted_bits_per_s);
    let (plans, source) = (Arc::clone(version.plans()), Arc::clone(version.source()));
    let mut session = ServerSession::with_plans(plans, config, source, guard.id, clock.now());
    if let Some(share) = guard.share(weight, clock.0) {
        session.set_shared_rate_limit(share);
    }
    let mut reads = Reads::new(Arc::clone(version.source()));
    let mut allowance = MessageRateLimiter::new(clock.now());
    let mut progress = Progress::new(metrics, Time::ZERO);
    // Once for the session: to ask anew in each turn took a twentieth of the loop's time.
    let mut draining = pin!(state.reached(Phase::Draining));
    let mut receiving = true;
    let mut sent_bytes = 0_u64;
    // Everything that was asked for has been handed over.
    let mut all_done = false;
    let mut drain_until: Option<Time> = None;
    guard.version = Some(Arc::clone(&version));
    if let Some(hello) = hello {
        let hello = ClientMessage::Hello(*hello);
        guard.asked();
        progress.heard(clock.now(), &hello);
        session.handle_message(clock.now(), hello);
    }
    let mut close_until: Option<Time> = None;
    loop {
        // A client that never pauses must not keep the thread from others.
        tokio::task::consume_budget().await;
        let now = clock.now();
        if session.poll_timeout().is_some_and(|due| due <= now) {
            session.handle_timeout(now);
        }
        if token_until.is_some_and(|until| until <= now) {
            let close = refusal(state.token_refused(TokenError::Expired));
            session.close(now, close.code, &close.reason);
            token_until = None;
        }
        if let Some(peer) = receiver.peer() {
            guard.comes_from(peer);
        }
        if proved && let Err(why) = guard.count() {
            session.close(now, CloseCode::Busy, &why.to_string());
        }
        session.set_group(now, guard.group());
        if proved
            && session.is_open()
            && let Err(why) = guard.take_lease()
        {
            session.close(now, CloseCode::Busy, &why.to_string());
        }
        if drain_until.is_some_and(|until| until <= now || (all_done && sender.is_idle())) {
            session.close(now, CloseCode::ShuttingDown, "the server is shutting down");
        }
        while sender.is_idle()
            && let Some(transmit) = session.poll_transmit(now)
        {
            let mut piece = None;
            match &transmit {
                Transmit::Piece { piece: sent, .. } => {
                    piece = Some((sent.id, sent.is_last()));
                    all_done = false;
                }
                Transmit::Message { message: ServerMessage::Done, .. } => all_done = true,
                Transmit::Message { message: ServerMessage::BasesSent, .. } => {
                    metrics.bases_sent(now.since(Time::ZERO));
                }
                Transmit::Message { message: ServerMessage::Refused(_), .. } => metrics.requests_refused(1),
                Transmit::Message { message: ServerMessage::RefusedMany(many), .. } => {
                    metrics.requests_refused(many.len());
                }
                Transmit::Message { .. } | Transmit::Abandon(_) => {}
            }
            match sender.start(transmit) {
                Ok(bytes) => {
                    sent_bytes += bytes as u64;
                    match piece {
                        Some((id, last)) => {
                            metrics.piece_sent(&id, bytes, last);
                            progress.piece_sent(clock.now());
                        }
                        None => metrics.control_sent(bytes),
                    }
                }
                // The scene holds what cannot be sent; the client cannot help it, nor go on.
                Err(why) => {
                    tracing::error!("cannot send: {why}");
                    session.close(
                        now,
                        CloseCode::Limit,
                        &format!("the server cannot send this scene: {why}"),
                    );
                }
            }
        }
        while let Some(id) = session.poll_read() {
            reads.begin(id);
        }
        progress.look(now, &session);
        if let Some(close) = session.close_reason() {
            let until = *close_until.get_or_insert(now + CLOSE_TIMEOUT);
            if (session.is_closed() && sender.is_idle()) || now >= until {
                guard.ended = close.code;
                tracing::debug!(sent_bytes, "session over");
                return close.clone();
            }
        }
        let earliest = now + if sender.is_idle() { TICK } else { BLOCKED_TICK };
        let wake =
            [session.poll_timeout(), drain_until, close_until, token_until].into_iter().flatten().min();
        let wake = clock.instant(wake.map_or(now + Duration::from_secs(60), |due| due.max(earliest)));
        tokio::select! {
            biased;
            () = &mut draining, if drain_until.is_none() => {
                drain_until = Some(clock.now() + state.settings().drain);
            }
            () = &mut proof, if !proved => proved = true,
            why = guard.dismissed() => session.close(clock.now(), CloseCode::Busy, why),
            judged = judged(&mut judging), if judging.is_some() => {
                judging = None;
                let now = clock.now();
                match judged {
                    Ok(grant) => {
                        token_until = Some(clock.granted(&grant));
                        session.set_rate(now, state.settings().rate_at_most(grant.rate_bits_per_s));
                        session.set_weight(now, grant.weight);
                    }
                    Err(why) => {
                        let close = refusal(why);
                        session.close(now, close.code, &close.reason);
                    }
                }
            }
            received = receiver.receive(), if receiving => {
                let now = clock.now();
                receiving = matches!(received, Received::Message(_) | Received::Skipped);
                match received {
                    Received::Message(ClientMessage::Token(_)) if !allowance.take(now, TOKEN_COST) => {
                        receiving = false;
                        metrics.message_rejected();
                        session.close(now, CloseCode::Limit, "too many tokens at once");
                    }
                    Received::Message(ClientMessage::Token(token)) => {
                        if state.admission().access.is_some() {
                            let (token, scene) = (token.0.clone(), version.name().to_owned());
                            // The last one counts.
                            judging = Some(Box::pin(state.clone().verify_next_token(token, scene, guard.peer)));
                        }
                        session.handle_message(now, ClientMessage::Token(token));
                    }
                    Received::Message(_) | Received::Skipped if !allowance.take(now, 1) => {
                        receiving = false;
                        metrics.message_rejected();
                        session.close(now, CloseCode::Limit, "too many messages at once");
                    }
                    Received::Message(message) => {
                        let asks = !matches!(message, ClientMessage::Ping(_));
                        if asks {
                            guard.asked();
                        }
                        all_done &= !asks;
                        progress.heard(now, &message);
                        session.handle_message(now, message);
                    }
                    Received::Skipped => {}
                    Received::TooMuch => {
                        metrics.message_rejected();
                        session.close(now, CloseCode::Limit, TOO_MUCH);
                    }
                    Received::Malformed(why) => {
                        metrics.message_rejected();
                        session.handle_frame_error(now, &why);
                    }
                    Received::Violation(why) => {
                        metrics.message_rejected();
                        session.close(now, CloseCode::Protocol, &why);
                    }
                    Received::Ended => session.handle_message(now, ClientMessage::Bye),
                    Received::Lost(why) => {
                        guard.ended = CloseCode::Lost;
                        return Close::new(CloseCode::Lost, why);
                    }
                }
            }
            flushed = sender.flush(), if !sender.is_idle() => {
                if let Err(why) = flushed {
                    guard.ended = CloseCode::Lost;
                    return Close::new(CloseCode::Lost, why);
                }
            }
            Some((id, bytes)) = reads.next(), if !reads.is_empty() => {
                if let Err(why) = &bytes {
                    state.read_failed(why);
                }
                session.handle_read(clock.now(), id, &bytes);
            }
            () = sleep_until(wake) => progress.alarm(),
        }
    }
}
