//! What a session waits for where the daemon asks for tokens: nothing is planned, sent or given a lease before.

use std::future::Future;
use std::pin::Pin;
use std::time::Duration;

use lodestream_protocol::message::{ClientMessage, Close, CloseCode};
use tokio::time::{Instant, sleep_until};

use super::drive::{Receive, Received};
use super::intake::TOO_MUCH;
use super::state::{Phase, SessionGuard};
use super::tokens::{Grant, TokenError};

/// Time in which the token must be there, as for `Hello`.
const TOKEN_TIMEOUT: Duration = Duration::from_secs(10);
/// Messages that are passed over before it: pings, and what newer clients may say.
const MAX_BEFORE: u32 = 16;

/// Waits for the client's token, unless it came with its request or none is asked for. `proof` of its address is waited
/// for meanwhile.
///
/// # Errors
/// Why there is no session.
pub(super) async fn admit<R: Receive>(
    guard: &SessionGuard,
    mut proof: Pin<&mut impl Future<Output = ()>>,
    proved: &mut bool,
    receiver: &mut R,
) -> Result<Option<Grant>, Close> {
    if guard.state.admission().tokens.is_none() || guard.grant.is_some() {
        return Ok(guard.grant.clone());
    }
    let until = Instant::now() + TOKEN_TIMEOUT;
    let mut passed_over = 0;
    loop {
        tokio::select! {
            biased;
            () = guard.state.reached(Phase::Draining) => {
                return Err(Close::new(CloseCode::ShuttingDown, "the server is shutting down"));
            }
            () = proof.as_mut(), if !*proved => *proved = true,
            why = guard.dismissed() => return Err(Close::new(CloseCode::Busy, why)),
            received = receiver.receive() => match received {
                Received::Message(ClientMessage::Token(token)) => {
                    return guard.state.verify_token(&token.0).map(Some).map_err(refusal);
                }
                Received::Message(ClientMessage::Bye) | Received::Ended => {
                    return Err(Close::new(CloseCode::Normal, "the client left"));
                }
                Received::Message(ClientMessage::Ping(_)) | Received::Skipped if passed_over < MAX_BEFORE => {
                    passed_over += 1;
                }
                Received::Message(ClientMessage::Ping(_)) | Received::Skipped => {
                    return Err(Close::new(CloseCode::Limit, "too many messages before a token"));
                }
                Received::Message(_) => return Err(refusal(guard.state.token_refused(TokenError::Missing))),
                Received::TooMuch => return Err(Close::new(CloseCode::Limit, TOO_MUCH)),
                Received::Malformed(why) => return Err(Close::new(why.close_code(), why.to_string())),
                Received::Violation(why) => return Err(Close::new(CloseCode::Protocol, why)),
                Received::Lost(why) => return Err(Close::new(CloseCode::Lost, why)),
            },
            () = sleep_until(until) => {
                return Err(Close::new(CloseCode::Timeout, "neither a token nor Hello came in time"));
            }
        }
    }
}

/// What a client is told whose token is not taken.
pub(super) fn refusal(why: TokenError) -> Close {
    Close::new(CloseCode::Unauthorised, why.to_string())
}
