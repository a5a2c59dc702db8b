//! The loop that runs a sans-IO session over a connection, for QUIC and WebSocket.
//!
//! [`Receiver`] yields the client's messages. [`Sender`] accepts one transmit at a time, the next only when the transport
//! has accepted the last, so that data waits in the session's scheduler, where more urgent data can overtake it, and not
//! in a socket.

use std::future::Future;
use std::net::SocketAddr;
use std::pin::pin;
use std::sync::Arc;
use std::time::Duration;

use lodestream_protocol::Time;
use lodestream_protocol::message::{ClientMessage, Close, CloseCode, ServerMessage};
use lodestream_protocol::server::{ServerSession, Transmit};
use lodestream_protocol::shared_rate_limit::Weight;
use lodestream_transport::{Clock, Received, Receiver, Sender};

use crate::auth::grant::{Grant, TokenError};
use crate::limits::message_rate::MessageRateLimiter;
use crate::limits::refusal::Refusal;
use crate::session::admit::{Admission, PendingGrant, admit, next_grant, refusal};
use crate::session::guard::SessionGuard;
use crate::session::reads::Reads;
use crate::session::session_metrics::SessionMetrics;
use crate::session::state::Phase;

/// Time limit for sending `Close`.
const CLOSE_TIMEOUT: Duration = Duration::from_secs(1);
/// Least time between two turns for timers while the transport is blocked.
const BLOCKED_TICK: Duration = Duration::from_millis(20);
/// Least time to sleep: tokio's timers tick in milliseconds.
const TICK: Duration = Duration::from_millis(1);
/// Cost of a token in messages: a signature is verified.
const TOKEN_COST: usize = 50;

/// Time at which a grant expires.
fn expiry(clock: Clock, grant: &Grant) -> Time {
    tracing::debug!(subject = grant.subject, "token accepted");
    clock.time_of(grant.expires_at)
}

/// Runs a session until it has ended and its `Close` was accepted by the transport; returns the reason and stores its code
/// in the guard. The caller then closes the transport. The session takes a lease when `validation` of the client's address
/// has resolved and the client is admitted. `peer` gives the client's current address, if it can change.
pub(crate) async fn drive(
    guard: &mut SessionGuard,
    validation: impl Future<Output = ()> + Send,
    peer: impl Fn() -> Option<SocketAddr> + Send,
    receiver: &mut impl Receiver<Frame = ClientMessage>,
    sender: &mut impl Sender<Item = Transmit>,
) -> Close {
    let mut validation = pin!(validation);
    let mut validated = false;
    let Admission { grant, version, hello } =
        match admit(guard, validation.as_mut(), &mut validated, receiver).await {
            Ok(admitted) => admitted,
            Err(close) => {
                match close.code {
                    CloseCode::Unauthorised => guard.state.metrics().session_refused(Refusal::Token),
                    CloseCode::NoSuchScene => guard.state.metrics().session_refused(Refusal::Scene),
                    _ => {}
                }
                guard.close_code = close.code;
                return close;
            }
        };
    let clock = Clock::start();
    let weight = grant.as_ref().map_or(Weight::ONE, |grant| grant.weight);
    let granted_bits_per_s = grant.as_ref().and_then(|grant| grant.rate_bits_per_s);
    let mut pending_grant: Option<PendingGrant> = None;
    let mut token_expiry = grant.map(|grant| expiry(clock, &grant));
    let state = guard.state.clone();
    let metrics = state.metrics();
    let config = state.config_for_rate(guard.transport, granted_bits_per_s);
    let config = if guard.resumes { Arc::new(config.resumed()) } else { config };
    let (plans, source) = (Arc::clone(version.plans()), Arc::clone(version.source()));
    let mut session = ServerSession::with_plans(plans, config, source, guard.id, clock.now());
    if let Some(share) = guard.join_shared_limit(weight) {
        session.set_shared_rate_limit(share);
    }
    let mut reads = Reads::new(Arc::clone(version.source()));
    let mut message_limiter = MessageRateLimiter::new();
    let mut session_metrics = SessionMetrics::new(metrics, Time::ZERO);
    // One future for the session: a new one in each turn took a twentieth of the loop's time.
    let mut draining = pin!(state.wait_for_phase(Phase::Draining));
    let mut receiving = true;
    let mut sent_bytes = 0_u64;
    // Whether all requests have been served.
    let mut all_served = false;
    let mut drain_deadline: Option<Time> = None;
    guard.version = Some(Arc::clone(&version));
    if let Some(hello) = hello {
        let hello = ClientMessage::Hello(*hello);
        guard.record_request();
        session_metrics.message_received(clock.now(), &hello);
        session.handle_message(clock.now(), hello);
    }
    let mut close_deadline: Option<Time> = None;
    loop {
        // A client that never pauses must not starve other tasks of the thread.
        tokio::task::consume_budget().await;
        let now = clock.now();
        if session.poll_timeout().is_some_and(|due| due <= now) {
            session.handle_timeout(now);
        }
        if token_expiry.is_some_and(|until| until <= now) {
            let close = refusal(state.token_refused(TokenError::Expired));
            session.close(now, close.code, &close.reason);
            token_expiry = None;
        }
        if let Some(peer) = peer() {
            guard.set_peer(peer);
        }
        if validated && let Err(why) = guard.count_for_address() {
            session.close(now, CloseCode::Busy, &why.to_string());
        }
        session.set_group(now, guard.group());
        if validated
            && session.is_open()
            && let Err(why) = guard.take_lease()
        {
            session.close(now, CloseCode::Busy, &why.to_string());
        }
        if drain_deadline.is_some_and(|until| until <= now || (all_served && sender.is_idle())) {
            session.close(now, CloseCode::ShuttingDown, "the server is shutting down");
        }
        while sender.has_room()
            && let Some(transmit) = session.poll_transmit(now)
        {
            let mut piece = None;
            match &transmit {
                Transmit::Piece { piece: sent, .. } => {
                    piece = Some((sent.id, sent.is_last()));
                    all_served = false;
                }
                Transmit::Message { message: ServerMessage::Done, .. } => all_served = true,
                Transmit::Message { message: ServerMessage::BasesSent, .. } => {
                    metrics.bases_sent(now.since(Time::ZERO));
                }
                Transmit::Message { message: ServerMessage::Refused(_), .. } => metrics.requests_refused(1),
                Transmit::Message { message: ServerMessage::RefusedMany(many), .. } => {
                    metrics.requests_refused(many.len());
                }
                Transmit::Message { .. } | Transmit::Abandon(_) => {}
            }
            match sender.push(transmit) {
                Ok(bytes) => {
                    sent_bytes += bytes as u64;
                    match piece {
                        Some((id, last)) => {
                            metrics.piece_sent(&id, bytes, last);
                            session_metrics.piece_sent(clock.now());
                        }
                        None => metrics.control_sent(bytes),
                    }
                }
                // The scene holds an item beyond a limit of the protocol.
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
        session_metrics.turn(now, &session);
        if let Some(close) = session.close_reason() {
            let until = *close_deadline.get_or_insert(now + CLOSE_TIMEOUT);
            if (session.is_closed() && sender.is_idle()) || now >= until {
                guard.close_code = close.code;
                tracing::debug!(sent_bytes, "session closed");
                return close.clone();
            }
        }
        let earliest = now + if sender.is_idle() { TICK } else { BLOCKED_TICK };
        let wake = [session.poll_timeout(), drain_deadline, close_deadline, token_expiry]
            .into_iter()
            .flatten()
            .min();
        let wake = wake.map_or(now + Duration::from_secs(60), |due| due.max(earliest));
        tokio::select! {
            biased;
            () = &mut draining, if drain_deadline.is_none() => {
                drain_deadline = Some(clock.now() + state.settings().drain);
            }
            () = &mut validation, if !validated => validated = true,
            why = guard.evicted() => session.close(clock.now(), CloseCode::Busy, why),
            verified = next_grant(&mut pending_grant), if pending_grant.is_some() => {
                pending_grant = None;
                let now = clock.now();
                match verified {
                    Ok(grant) => {
                        token_expiry = Some(expiry(clock, &grant));
                        session.set_rate(now, state.settings().capped_rate(grant.rate_bits_per_s));
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
                receiving = matches!(received, Received::Frame(_) | Received::Skipped);
                match received {
                    Received::Frame(ClientMessage::Token(_)) if !message_limiter.take(now, TOKEN_COST) => {
                        receiving = false;
                        metrics.message_rejected();
                        session.close(now, CloseCode::Limit, "too many tokens within seconds");
                    }
                    Received::Frame(ClientMessage::Token(token)) => {
                        if state.admission().access.is_some() {
                            let (token, scene) = (token.0.clone(), version.name().to_owned());
                            // A newer token replaces one whose verification is under way.
                            pending_grant = Some(Box::pin(state.clone().verify_next_token(token, scene, guard.peer)));
                        }
                        session.handle_message(now, ClientMessage::Token(token));
                    }
                    Received::Frame(_) | Received::Skipped if !message_limiter.take(now, 1) => {
                        receiving = false;
                        metrics.message_rejected();
                        session.close(now, CloseCode::Limit, "too many messages within seconds");
                    }
                    Received::Frame(message) => {
                        let is_request = !matches!(message, ClientMessage::Ping(_));
                        if is_request {
                            guard.record_request();
                        }
                        all_served &= !is_request;
                        session_metrics.message_received(now, &message);
                        session.handle_message(now, message);
                    }
                    Received::Skipped => {}
                    Received::Malformed(why) => {
                        metrics.message_rejected();
                        session.handle_frame_error(now, &why);
                    }
                    Received::Violation(close) => {
                        metrics.message_rejected();
                        session.close(now, close.code, &close.reason);
                    }
                    // Clients send no blobs.
                    Received::Pieces(_) | Received::Abandoned(_) => {}
                    Received::Closed(_) => session.handle_message(now, ClientMessage::Bye),
                    Received::Lost(why) => {
                        guard.close_code = CloseCode::Lost;
                        return Close::new(CloseCode::Lost, why);
                    }
                }
            }
            flushed = sender.flush(), if !sender.is_idle() => {
                if let Err(why) = flushed {
                    guard.close_code = CloseCode::Lost;
                    return Close::new(CloseCode::Lost, why.to_string());
                }
            }
            Some((id, bytes)) = reads.next(), if !reads.is_empty() => {
                if let Err(why) = &bytes {
                    state.read_failed(why);
                }
                session.handle_read(clock.now(), id, &bytes);
            }
            () = clock.sleep_until(wake) => session_metrics.timer_fired(),
        }
    }
}
