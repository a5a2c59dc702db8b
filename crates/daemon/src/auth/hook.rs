//! Token introspection (RFC 7662) by the operator's program or URL.
//!
//! The request also holds the scene and the client's address, the response the claims of a grant. The token is passed on
//! unchanged. Untrusted peers cause these requests, so at most 16 run at a time, each has a timeout, and a response is
//! reused for 10 seconds for equal requests.

use std::fmt;
use std::net::IpAddr;
use std::time::{Duration, SystemTime};

use futures_util::future::BoxFuture;
use moka::future::Cache;
use serde::{Deserialize, Serialize};
use tokio::sync::Semaphore;
use tokio::time::timeout;

use crate::auth::grant::{Claims, Grant, SceneClaim, TokenError};

/// Most requests at a time; more wait.
const MAX_CONCURRENT: usize = 16;
/// Timeout of a request, including the wait for others.
const TIMEOUT: Duration = Duration::from_secs(5);
/// Maximum staleness of a response.
const MAX_STALENESS: Duration = Duration::from_secs(10);
/// Most responses in the cache.
const MAX_CACHED: u64 = 4096;
/// Longest response, in bytes.
pub(crate) const MAX_RESPONSE_BYTES: usize = 64 * 1024;

/// An introspection request. It has no `Debug`, which would print the token.
#[derive(Clone, Serialize)]
pub(crate) struct IntrospectionRequest {
    /// The client's token.
    pub(crate) token: String,
    /// The requested scene; `None` for the list of scenes.
    pub(crate) scene: Option<String>,
    /// The client's address, if need be from a trusted proxy.
    #[serde(rename = "client_address")]
    pub(crate) address: IpAddr,
}

impl IntrospectionRequest {
    /// Cache key: a hash, so that no token is stored.
    fn key(&self) -> [u8; 32] {
        let mut hasher = blake3::Hasher::new();
        // Lengths separate the texts.
        for part in [&self.token, self.scene.as_deref().unwrap_or_default(), &self.address.to_string()] {
            hasher.update(&(part.len() as u64).to_le_bytes()).update(part.as_bytes());
        }
        hasher.update(&[u8::from(self.scene.is_some())]).finalize().into()
    }
}

/// An introspection response; claims count only if it is active.
#[derive(Clone, Debug, Deserialize)]
pub(crate) struct IntrospectionResponse {
    active: bool,
    #[serde(flatten)]
    claims: Claims,
}

impl IntrospectionResponse {
    /// Parses a response.
    pub(crate) fn parse(text: &[u8]) -> Result<Self, HookError> {
        serde_json::from_slice(text).map_err(|why| HookError::Malformed(why.to_string()))
    }

    /// The grant at `now` for a request about `scene`.
    fn grant(self, scene: Option<String>, now: SystemTime) -> Result<Grant, TokenError> {
        let Self { active, mut claims } = self;
        if !active {
            return Err(TokenError::Refused);
        }
        // Without a claim `scene`, the response covers the scene of the request.
        claims.scene = claims.scene.or(scene.map(SceneClaim::One));
        claims.grant(now)
    }
}

/// Why there is no response; the text is logged.
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
    #[error("no response within {0:?}")]
    Timeout(Duration),
}

/// A way to send introspection requests.
pub(crate) trait Introspect: Send + Sync {
    /// Sends a request. Dropping the future ends everything that it started.
    fn introspect(
        &self,
        request: IntrospectionRequest,
    ) -> BoxFuture<'static, Result<IntrospectionResponse, HookError>>;
}

/// Introspection by the operator's program or URL, with a cache.
pub struct Hook {
    name: String,
    backend: Box<dyn Introspect>,
    timeout: Duration,
    permits: Semaphore,
    cache: Cache<[u8; 32], IntrospectionResponse>,
}

impl fmt::Debug for Hook {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Hook").field("name", &self.name).finish_non_exhaustive()
    }
}

/// A cache of responses.
fn response_cache(max_staleness: Duration) -> Cache<[u8; 32], IntrospectionResponse> {
    Cache::builder().max_capacity(MAX_CACHED).time_to_live(max_staleness).build()
}

impl Hook {
    /// Introspection by `backend`, which messages call `name`.
    pub(crate) fn new(name: String, backend: impl Introspect + 'static) -> Self {
        let (permits, cache) = (Semaphore::new(MAX_CONCURRENT), response_cache(MAX_STALENESS));
        Self { name, backend: Box::new(backend), timeout: TIMEOUT, permits, cache }
    }

    /// Changes the maximum staleness; the cache's clock runs on while tests pause tokio's.
    #[cfg(test)]
    pub(crate) fn with_cache_ttl(self, max_staleness: Duration) -> Self {
        Self { cache: response_cache(max_staleness), ..self }
    }

    /// Changes the timeout; tests wait longer on a busy machine.
    #[cfg(test)]
    pub(crate) fn with_timeout(self, timeout: Duration) -> Self {
        Self { timeout, ..self }
    }

    /// Verifies a token, for the scenes in the response or else the scene of the request.
    pub(crate) async fn verify(&self, request: IntrospectionRequest) -> Result<Grant, TokenError> {
        let (key, scene) = (request.key(), request.scene.clone());
        let response = async {
            let introspection = async {
                // The semaphore is never closed.
                let _permit = self.permits.acquire().await;
                self.backend.introspect(request).await
            };
            timeout(self.timeout, introspection).await.unwrap_or(Err(HookError::Timeout(self.timeout)))
        };
        match self.cache.try_get_with(key, response).await {
            Ok(response) => response.grant(scene, SystemTime::now()),
            Err(why) => {
                tracing::error!("{} cannot verify a token: {why}", self.name);
                Err(TokenError::Unavailable)
            }
        }
    }
}

/// Text in one line, for the log.
pub(crate) fn one_line(text: &[u8]) -> String {
    String::from_utf8_lossy(text).split_whitespace().collect::<Vec<_>>().join(" ")
}
