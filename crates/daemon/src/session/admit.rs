//! What a session waits for before it begins: its scene, where it is not known yet, and a token, where the daemon asks for
//! tokens. Nothing is planned, sent or given a lease before.

use std::future::{Future, pending};
use std::pin::Pin;
use std::sync::Arc;
use std::time::Duration;

use lodestream_protocol::message::{ClientMessage, Close, CloseCode, Hello};
use tokio::time::{Instant, sleep_until};

use crate::admission::byte_rate::BYTE_RATE_EXCEEDED;
use crate::auth::access::Access;
use crate::auth::grant::{Grant, TokenError};
use crate::session::connection::{Receive, Received};
use crate::session::guard::SessionGuard;
use crate::session::scenes::SceneVersion;
use crate::session::state::Phase;

/// Time in which all of it must be there, as for `Hello`.
const TIMEOUT: Duration = Duration::from_secs(10);
/// Messages that are passed over before it: pings, and what newer clients may say.
const MAX_BEFORE: u32 = 16;

/// What a session begins with.
pub(crate) struct Admission {
    /// What its token grants, if it was asked for one.
    pub(crate) grant: Option<Grant>,
    /// Its scene.
    pub(crate) version: Arc<SceneVersion>,
    /// What the client said, if it had to be heard first.
    pub(crate) hello: Option<Box<Hello>>,
}

/// A token that is being verified.
pub(crate) type PendingGrant = Pin<Box<dyn Future<Output = Result<Grant, TokenError>> + Send>>;

/// What is verified of it; never, where there is none. Safe to drop before it resolves.
pub(crate) async fn next_grant(pending_grant: &mut Option<PendingGrant>) -> Result<Grant, TokenError> {
    match pending_grant {
        Some(pending_grant) => pending_grant.await,
        None => pending().await,
    }
}

/// Waits for the client's token, unless it came with its request or none is asked for, and for its `Hello` where only that
/// can say which scene is meant. `proof` of its address is waited for meanwhile.
///
/// # Errors
/// Why there is no session.
pub(crate) async fn admit<R: Receive>(
    guard: &SessionGuard,
    mut proof: Pin<&mut impl Future<Output = ()>>,
    proved: &mut bool,
    receiver: &mut R,
) -> Result<Admission, Close> {
    let state = &guard.state;
    let (scenes, access) = (state.scenes(), state.admission().access.clone());
    let asks = access.is_some();
    let mut name = guard.requested_scene.clone().or_else(|| scenes.only().map(|only| only.name().to_owned()));
    let mut grant = guard.grant.clone();
    let mut hello: Option<Box<Hello>> = None;
    let (mut shown, mut pending_grant): (Option<String>, Option<PendingGrant>) = (None, None);
    let until = Instant::now() + TIMEOUT;
    let mut passed_over = 0;
    loop {
        let can_judge = |access: &Arc<Access>| name.is_some() || access.verifies_without_scene();
        if let Some(token) = shown.take_if(|_| access.as_ref().is_some_and(can_judge)) {
            pending_grant = Some(Box::pin(state.clone().verify_token(token, name.clone(), guard.peer)));
        }
        if let Some(name) = name.as_deref().filter(|_| !asks || grant.is_some()) {
            // Whoever may not see a scene does not hear whether there is one.
            let grant =
                grant.map(|grant| grant.for_scene(name).map_err(|why| refusal(state.token_refused(why))));
            let grant = grant.transpose()?;
            let version = scenes.get(name);
            let missing = || Close::new(CloseCode::NoSuchScene, scenes.missing(name, !asks));
            return Ok(Admission { grant, version: version.ok_or_else(missing)?, hello });
        }
        tokio::select! {
            biased;
            () = state.wait_for_phase(Phase::Draining) => {
                return Err(Close::new(CloseCode::ShuttingDown, "the server is shutting down"));
            }
            () = proof.as_mut(), if !*proved => *proved = true,
            why = guard.evicted() => return Err(Close::new(CloseCode::Busy, why)),
            verified = next_grant(&mut pending_grant), if pending_grant.is_some() => {
                grant = Some(verified.map_err(refusal)?);
                pending_grant = None;
            }
            received = receiver.receive(), if pending_grant.is_none() => match received {
                Received::Message(ClientMessage::Token(token)) if asks && grant.is_none() && shown.is_none() => {
                    shown = Some(token.0);
                }
                Received::Message(ClientMessage::Hello(said)) if !asks || grant.is_some() || shown.is_some() => {
                    // The name is not known, or this would be over.
                    if said.scene.is_empty() {
                        let may = |name: &str| grant.as_ref().map_or(!asks, |grant| grant.allows(name));
                        let all = scenes.table().names().all(may);
                        return Err(Close::new(CloseCode::NoSuchScene, scenes.missing("", all)));
                    }
                    name = Some(said.scene.clone());
                    hello = Some(Box::new(said));
                }
                Received::Message(ClientMessage::Bye) | Received::Ended => {
                    return Err(Close::new(CloseCode::Normal, "the client left"));
                }
                Received::Message(ClientMessage::Ping(_) | ClientMessage::Token(_)) | Received::Ignored
                    if passed_over < MAX_BEFORE =>
                {
                    passed_over += 1;
                }
                Received::Message(ClientMessage::Ping(_) | ClientMessage::Token(_)) | Received::Ignored => {
                    return Err(Close::new(CloseCode::Limit, "too many messages before Hello"));
                }
                Received::Message(_) if asks && grant.is_none() && shown.is_none() => {
                    return Err(refusal(state.token_refused(TokenError::Missing)));
                }
                Received::Message(_) => {
                    return Err(Close::new(CloseCode::Protocol, "the first message must be Hello"));
                }
                Received::ByteRateExceeded => return Err(Close::new(CloseCode::Limit, BYTE_RATE_EXCEEDED)),
                Received::Malformed(why) => return Err(Close::new(why.close_code(), why.to_string())),
                Received::Violation(why) => return Err(Close::new(CloseCode::Protocol, why)),
                Received::Lost(why) => return Err(Close::new(CloseCode::Lost, why)),
            },
            () = sleep_until(until) => {
                let awaited = if asks { "neither a token nor Hello" } else { "no Hello" };
                return Err(Close::new(CloseCode::Timeout, format!("{awaited} came in time")));
            }
        }
    }
}

/// What a client is told whose token is not taken. It may try again where the token may be a good one.
pub(crate) fn refusal(why: TokenError) -> Close {
    let code = if why == TokenError::Unavailable { CloseCode::Busy } else { CloseCode::Unauthorised };
    Close::new(code, why.to_string())
}
