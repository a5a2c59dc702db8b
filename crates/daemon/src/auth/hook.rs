//! Who may see a scene, by the operator's own word: a program that is run, or a URL that is asked, for each token.
//!
//! The questions and answers are those of token introspection (RFC 7662), with a scene and the client's address in the
//! question and what a grant holds in the answer. Whatever a client shows as its token comes to the program as it is.
//! Untrusted peers cause these questions, so there are at most sixteen at a time, each has an end, and an answer is
//! good for ten seconds for whoever asks the same.

use std::fmt;
use std::net::IpAddr;
use std::time::{Duration, SystemTime};

use futures_util::future::BoxFuture;
use moka::future::Cache;
use serde::{Deserialize, Serialize};
use tokio::sync::Semaphore;
use tokio::time::timeout;

use crate::auth::grant::{Claims, Grant, SceneClaim, TokenError};

/// Questions at a time; more wait.
const MAX_AT_ONCE: usize = 16;
/// Time in which a question must be answered, that in which it waits for others included.
const ANSWER_WITHIN: Duration = Duration::from_secs(5);
/// How long an answer is good for.
const GOOD_FOR: Duration = Duration::from_secs(10);
/// Answers that are cache.
const MAX_KEPT: u64 = 4096;
/// Longest answer, in bytes.
pub(crate) const MAX_RESPONSE_BYTES: usize = 64 * 1024;

/// What is asked. Not to be formatted: the token would be in it.
#[derive(Clone, Serialize)]
pub(crate) struct IntrospectionRequest {
    /// What the client showed.
    pub(crate) token: String,
    /// The scene that it asks for, if it is one: the list of scenes is for none.
    pub(crate) scene: Option<String>,
    /// Where it is, or where a proxy that is believed says so.
    #[serde(rename = "client_address")]
    pub(crate) address: IpAddr,
}

impl IntrospectionRequest {
    /// By what alike questions are known. No token is cache.
    fn key(&self) -> [u8; 32] {
        let mut hasher = blake3::Hasher::new();
        // Lengths part the texts.
        for part in [&self.token, self.scene.as_deref().unwrap_or_default(), &self.address.to_string()] {
            hasher.update(&(part.len() as u64).to_le_bytes()).update(part.as_bytes());
        }
        hasher.update(&[u8::from(self.scene.is_some())]).finalize().into()
    }
}

/// What is answered; claims count only where it is active.
#[derive(Clone, Debug, Deserialize)]
pub(crate) struct IntrospectionResponse {
    active: bool,
    #[serde(flatten)]
    claims: Claims,
}

impl IntrospectionResponse {
    /// Reads an answer.
    pub(crate) fn parse(text: &[u8]) -> Result<Self, HookError> {
        serde_json::from_slice(text).map_err(|why| HookError::Malformed(why.to_string()))
    }

    /// What it grants at `now` to who asked this.
    fn grant(self, scene: Option<String>, now: SystemTime) -> Result<Grant, TokenError> {
        let Self { active, mut claims } = self;
        if !active {
            return Err(TokenError::Refused);
        }
        // It was asked of this scene and has said no other.
        claims.scene = claims.scene.or(scene.map(SceneClaim::One));
        claims.grant(now)
    }
}

/// Why there is no answer, for the operator.
#[derive(Clone, Debug, thiserror::Error)]
pub(crate) enum HookError {
    #[error("the program cannot be started: {0}")]
    Spawn(String),
    #[error("the program failed with {status}{stderr}")]
    ExitStatus { status: String, stderr: String },
    #[error("the request failed: {0}")]
    Request(String),
    #[error("the response has status {0} instead of 200 OK")]
    HttpStatus(u16),
    #[error("the response is longer than {MAX_RESPONSE_BYTES} bytes")]
    TooLong,
    #[error("the response is not JSON with \"active\": true or false, and claims: {0}")]
    Malformed(String),
    #[error("no response came within {0:?}")]
    Timeout(Duration),
}

/// One way to ask.
pub(crate) trait Introspect: Send + Sync {
    /// Asks. Dropped before it resolves, it leaves nothing running.
    fn introspect(
        &self,
        question: IntrospectionRequest,
    ) -> BoxFuture<'static, Result<IntrospectionResponse, HookError>>;
}

/// See the module.
pub struct Hook {
    name: String,
    backend: Box<dyn Introspect>,
    with_timeout: Duration,
    permits: Semaphore,
    cache: Cache<[u8; 32], IntrospectionResponse>,
}

impl fmt::Debug for Hook {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Hook").field("name", &self.name).finish_non_exhaustive()
    }
}

/// PreAuthPool for answers that are good for so long.
fn answers(good_for: Duration) -> Cache<[u8; 32], IntrospectionResponse> {
    Cache::builder().max_capacity(MAX_KEPT).time_to_live(good_for).build()
}

impl Hook {
    /// What asks in this way, under a name for messages.
    pub(crate) fn new(name: String, backend: impl Introspect + 'static) -> Self {
        let (permits, cache) = (Semaphore::new(MAX_AT_ONCE), answers(GOOD_FOR));
        Self { name, backend: Box::new(backend), with_timeout: ANSWER_WITHIN, permits, cache }
    }

    /// The same whose answers are good for another time: that of the cache goes on where tests pause theirs.
    #[cfg(test)]
    pub(crate) fn with_cache_ttl(self, good_for: Duration) -> Self {
        Self { cache: answers(good_for), ..self }
    }

    /// The same with another end of questions: tests wait longer for a busy machine.
    #[cfg(test)]
    pub(crate) fn with_timeout(self, with_timeout: Duration) -> Self {
        Self { with_timeout, ..self }
    }

    /// What is granted, for the scenes that the answer names, or else for that of the question.
    pub(crate) async fn verify(&self, question: IntrospectionRequest) -> Result<Grant, TokenError> {
        let (key, scene) = (question.key(), question.scene.clone());
        let asked = async {
            let answered = async {
                // It is never closed.
                let _turn = self.permits.acquire().await;
                self.backend.introspect(question).await
            };
            timeout(self.with_timeout, answered).await.unwrap_or(Err(HookError::Timeout(self.with_timeout)))
        };
        match self.cache.try_get_with(key, asked).await {
            Ok(answer) => answer.grant(scene, SystemTime::now()),
            Err(why) => {
                tracing::error!("{} decides nothing: {why}", self.name);
                Err(TokenError::Unavailable)
            }
        }
    }
}

/// What was said on the way, for one line of the log.
pub(crate) fn one_line(text: &[u8]) -> String {
    String::from_utf8_lossy(text).split_whitespace().collect::<Vec<_>>().join(" ")
}
