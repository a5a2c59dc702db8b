//! Verification of clients' tokens: by signing keys, or by the operator's program or URL.

use std::net::IpAddr;
use std::sync::Arc;
use std::time::{Duration, SystemTime};

use tokio::sync::watch;
use tokio::time::sleep;

use crate::auth::grant::{Grant, TokenError};
use crate::auth::hook::{Hook, IntrospectionRequest};
use crate::auth::hook_url::Authorization;
use crate::auth::tokens::{Tokens, watch_keys};

/// Time between attempts to verify a later token of a session.
const RETRY_INTERVAL: Duration = Duration::from_secs(5);

/// How tokens are verified. With either variant, clients must send one.
#[derive(Debug)]
pub enum Access {
    /// By the signatures of these keys.
    Tokens(Tokens),
    /// By a program or URL of the operator.
    Hook {
        /// The program or URL.
        hook: Hook,
        /// Credentials for the URL, watched for changes.
        authorization: Option<Authorization>,
    },
}

impl Access {
    /// Whether a token can be verified before the scene is known.
    pub(crate) const fn verifies_without_scene(&self) -> bool {
        matches!(self, Self::Tokens(_))
    }

    /// Verifies a token for one scene, or for any if `scene` is `None`.
    pub(crate) async fn verify(
        &self,
        token: String,
        scene: Option<String>,
        address: IpAddr,
    ) -> Result<Grant, TokenError> {
        let grant = match self {
            Self::Tokens(tokens) => tokens.verify(&token, SystemTime::now())?,
            Self::Hook { hook, .. } => {
                hook.verify(IntrospectionRequest { token, scene: scene.clone(), address }).await?
            }
        };
        match scene {
            Some(scene) => grant.for_scene(&scene),
            None => Ok(grant),
        }
    }

    /// Verifies a later token of a session; retries while no answer is available.
    pub(crate) async fn verify_with_retries(
        &self,
        token: String,
        scene: String,
        address: IpAddr,
    ) -> Result<Grant, TokenError> {
        loop {
            match self.verify(token.clone(), Some(scene.clone()), address).await {
                Err(TokenError::Unavailable) => sleep(RETRY_INTERVAL).await,
                result => return result,
            }
        }
    }

    /// Reloads keys or credentials when their file changes. Returns only if there is no file.
    pub(crate) async fn watch_files(self: Arc<Self>, reload_requests: watch::Receiver<u64>) {
        match &*self {
            Self::Tokens(tokens) => watch_keys(tokens, reload_requests).await,
            Self::Hook { authorization: Some(authorization), .. } => {
                authorization.clone().watch_files(reload_requests).await
            }
            Self::Hook { authorization: None, .. } => {}
        }
    }
}
