//! By what it is decided who may see a scene: by keys that have signed the client's token, or by the operator's own word.

use std::net::IpAddr;
use std::sync::Arc;
use std::time::{Duration, SystemTime};

use tokio::sync::watch;
use tokio::time::sleep;

use crate::auth::grant::{Grant, TokenError};
use crate::auth::hook::{Hook, IntrospectionRequest};
use crate::auth::hook_url::Authorization;
use crate::auth::tokens::{Tokens, watch_keys};

/// Time after which what could not be found out is asked again.
const RETRY_INTERVAL: Duration = Duration::from_secs(5);

/// See the module. Either way clients are asked for a token.
#[derive(Debug)]
pub enum Access {
    /// Tokens that these keys have signed.
    Tokens(Tokens),
    /// Whatever this lets in.
    Hook {
        /// What is asked.
        hook: Hook,
        /// What it is shown, where it is a URL that asks for that.
        authorization: Option<Authorization>,
    },
}

impl Access {
    /// Whether a token can be judged before it is known for which scene: if not, it is once that is known.
    pub(crate) const fn verifies_without_scene(&self) -> bool {
        matches!(self, Self::Tokens(_))
    }

    /// What a token grants to who shows it for this scene, if for one.
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

    /// The same for a session that has a grant: what cannot be found out is asked again until it is.
    pub(crate) async fn verify_with_retries(
        &self,
        token: String,
        scene: String,
        address: IpAddr,
    ) -> Result<Grant, TokenError> {
        loop {
            match self.verify(token.clone(), Some(scene.clone()), address).await {
                Err(TokenError::Unavailable) => sleep(RETRY_INTERVAL).await,
                known => return known,
            }
        }
    }

    /// Takes anew what is read from files, when they change. Goes on for ever, or ends where there is no such file.
    pub(crate) async fn watch_files(self: Arc<Self>, asked: watch::Receiver<u64>) {
        match &*self {
            Self::Tokens(tokens) => watch_keys(tokens, asked).await,
            Self::Hook { authorization: Some(authorization), .. } => {
                authorization.clone().watch_files(asked).await
            }
            Self::Hook { authorization: None, .. } => {}
        }
    }
}
