//! Admission of a session: waits for the name of its scene and, if the daemon requires one, a valid token. Before that
//! nothing is planned or sent, and no lease is taken.

use std::future::{Future, pending};
use std::pin::Pin;
use std::sync::Arc;
use std::time::Duration;

use lodestream_protocol::message::{ClientMessage, Close, CloseCode, Hello};
use lodestream_transport::{Received, Receiver};
use tokio::time::{Instant, sleep_until};

use crate::auth::access::Access;
use crate::auth::grant::{Grant, TokenError};
use crate::session::guard::SessionGuard;
use crate::session::scenes::SceneVersion;
use crate::session::state::Phase;

/// Time limit for admission, as for `Hello`.
const TIMEOUT: Duration = Duration::from_secs(10);
/// Most messages that are ignored before `Hello`: pings, and messages of newer clients.
const MAX_IGNORED: u32 = 16;

/// The result of admission.
pub(crate) struct Admission {
    /// Grant of the token, if one is required.
    pub(crate) grant: Option<Grant>,
    /// Its scene.
    pub(crate) version: Arc<SceneVersion>,
    /// The client's `Hello`, if it named the scene.
    pub(crate) hello: Option<Box<Hello>>,
}

/// Verification of a token, under way.
pub(crate) type PendingGrant = Pin<Box<dyn Future<Output = Result<Grant, TokenError>> + Send>>;

/// The result of a verification; never resolves without one. Cancel safe.
pub(crate) async fn next_grant(pending_grant: &mut Option<PendingGrant>) -> Result<Grant, TokenError> {
    match pending_grant {
        Some(pending_grant) => pending_grant.await,
        None => pending().await,
    }
}

/// Waits for the client's token, unless it came with the HTTP request or none is required, and for `Hello`, unless the
/// scene is known. Meanwhile notes in `validated` when `validation` of the client's address resolves.
///
/// # Errors
/// The reason to close the connection.
pub(crate) async fn admit(
    guard: &SessionGuard,
    mut validation: Pin<&mut impl Future<Output = ()>>,
    validated: &mut bool,
    receiver: &mut impl Receiver<Frame = ClientMessage>,
) -> Result<Admission, Close> {
    let state = &guard.state;
    let (scenes, access) = (state.scenes(), state.admission().access.clone());
    let requires_token = access.is_some();
    let mut name = guard.requested_scene.clone().or_else(|| scenes.only().map(|only| only.name().to_owned()));
    let mut grant = guard.grant.clone();
    let mut hello: Option<Box<Hello>> = None;
    let (mut token, mut pending_grant): (Option<String>, Option<PendingGrant>) = (None, None);
    let until = Instant::now() + TIMEOUT;
    let mut ignored = 0;
    loop {
        let can_verify = |access: &Arc<Access>| name.is_some() || access.verifies_without_scene();
        if let Some(token) = token.take_if(|_| access.as_ref().is_some_and(can_verify)) {
            pending_grant = Some(Box::pin(state.clone().verify_token(token, name.clone(), guard.peer)));
        }
        if let Some(name) = name.as_deref().filter(|_| !requires_token || grant.is_some()) {
            // A client without access to a scene must not learn whether it exists.
            let grant =
                grant.map(|grant| grant.for_scene(name).map_err(|why| refusal(state.token_refused(why))));
            let grant = grant.transpose()?;
            let version = scenes.get(name);
            let missing = || Close::new(CloseCode::NoSuchScene, scenes.missing(name, !requires_token));
            return Ok(Admission { grant, version: version.ok_or_else(missing)?, hello });
        }
        tokio::select! {
            biased;
            () = state.wait_for_phase(Phase::Draining) => {
                return Err(Close::new(CloseCode::ShuttingDown, "the server is shutting down"));
            }
            () = validation.as_mut(), if !*validated => *validated = true,
            why = guard.evicted() => return Err(Close::new(CloseCode::Busy, why)),
            verified = next_grant(&mut pending_grant), if pending_grant.is_some() => {
                grant = Some(verified.map_err(refusal)?);
                pending_grant = None;
            }
            received = receiver.receive(), if pending_grant.is_none() => match received {
                Received::Frame(ClientMessage::Token(received)) if requires_token && grant.is_none() && token.is_none() => {
                    token = Some(received.0);
                }
                Received::Frame(ClientMessage::Hello(received_hello)) if !requires_token || grant.is_some() || token.is_some() => {
                    // Without the name, or admission would be complete.
                    if received_hello.scene.is_empty() {
                        let may = |name: &str| grant.as_ref().map_or(!requires_token, |grant| grant.allows(name));
                        let all = scenes.table().names().all(may);
                        return Err(Close::new(CloseCode::NoSuchScene, scenes.missing("", all)));
                    }
                    name = Some(received_hello.scene.clone());
                    hello = Some(Box::new(received_hello));
                }
                Received::Frame(ClientMessage::Bye) | Received::Closed(_) => {
                    return Err(Close::new(CloseCode::Normal, "the client left"));
                }
                Received::Frame(ClientMessage::Ping(_) | ClientMessage::Token(_)) | Received::Skipped
                    if ignored < MAX_IGNORED =>
                {
                    ignored += 1;
                }
                Received::Frame(ClientMessage::Ping(_) | ClientMessage::Token(_)) | Received::Skipped => {
                    return Err(Close::new(CloseCode::Limit, "too many messages before Hello"));
                }
                Received::Frame(_) if requires_token && grant.is_none() && token.is_none() => {
                    return Err(refusal(state.token_refused(TokenError::Missing)));
                }
                Received::Frame(_) => {
                    return Err(Close::new(CloseCode::Protocol, "the first message must be Hello"));
                }
                Received::Malformed(why) => return Err(Close::new(why.close_code(), why.to_string())),
                Received::Violation(close) => return Err(close),
                // Clients send no blobs.
                Received::Pieces(_) | Received::Abandoned(_) => {}
                Received::Lost(why) => return Err(Close::new(CloseCode::Lost, why)),
            },
            () = sleep_until(until) => {
                let missing = if requires_token { "no token and no Hello" } else { "no Hello" };
                return Err(Close::new(CloseCode::Timeout, format!("{missing} within {} seconds", TIMEOUT.as_secs())));
            }
        }
    }
}

/// Reason to close the connection of a client whose token is refused. `Busy` if it may retry with the same token.
pub(crate) fn refusal(why: TokenError) -> Close {
    let code = if why == TokenError::Unavailable { CloseCode::Busy } else { CloseCode::Unauthorised };
    Close::new(code, why.to_string())
}
