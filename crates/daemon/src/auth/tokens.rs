//! JSON Web Tokens (RFC 7519) as bearer tokens, which another program signs.
//!
//! A token must be signed by a key in the operator's file, have an expiry, and name the scene. It is verified before the
//! session takes a lease, and before anything is planned or sent.

use std::fmt;
use std::path::PathBuf;
use std::sync::{Arc, PoisonError, RwLock};
use std::time::SystemTime;

use anyhow::Context as _;
use jsonwebtoken::errors::ErrorKind;
use jsonwebtoken::{Validation, decode, decode_header};
use tokio::sync::watch;

use crate::auth::grant::{Claims, Grant, TokenError};
use crate::auth::token_crypto;
use crate::auth::token_keys::{Key, read_keys};
use crate::lifecycle::file_watch::{read_small_file, watch_files};

/// Verifies tokens by the keys in a file.
pub struct Tokens {
    file: PathBuf,
    audience: Option<String>,
    keys: RwLock<Arc<[Key]>>,
}

impl fmt::Debug for Tokens {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Tokens")
            .field("file", &self.file)
            .field("audience", &self.audience)
            .finish_non_exhaustive()
    }
}

impl Tokens {
    /// Reads the keys from a file. A token with an audience must have this one.
    ///
    /// # Errors
    /// The file cannot be read, or holds no usable key.
    pub fn from_file(file: impl Into<PathBuf>, audience: Option<String>) -> anyhow::Result<Self> {
        token_crypto::install();
        let file = file.into();
        let keys = RwLock::new(Arc::from([]));
        let tokens = Self { file, audience, keys };
        tokens.set_keys(&read_small_file(&tokens.file)?)?;
        Ok(tokens)
    }

    /// Replaces the keys by those in `text`; after an error the old keys stay. Running sessions keep their grants.
    pub(crate) fn set_keys(&self, text: &[u8]) -> anyhow::Result<()> {
        let new = read_keys(text).with_context(|| self.file.display().to_string())?.into();
        *self.keys.write().unwrap_or_else(PoisonError::into_inner) = new;
        Ok(())
    }

    /// Verifies a token at `now`; the grant covers the scenes that it names.
    pub(crate) fn verify(&self, token: &str, now: SystemTime) -> Result<Grant, TokenError> {
        let header = decode_header(token).map_err(|_| TokenError::Malformed)?;
        let keys = Arc::clone(&self.keys.read().unwrap_or_else(PoisonError::into_inner));
        let mut validation = Validation::new(header.alg);
        // The library would read the system's clock, and panic before 1970.
        validation.validate_exp = false;
        validation.validate_nbf = false;
        validation.aud = self.audience.iter().cloned().map(|audience| [audience].into()).next();
        // A key has one algorithm; a token with a key id is verified with that key only.
        let fits = |key: &&Key| {
            key.algorithm == header.alg && (header.kid.is_none() || key.id.is_none() || key.id == header.kid)
        };
        for key in keys.iter().filter(fits) {
            let claims = match decode::<Claims>(token, &key.key, &validation) {
                Ok(data) => data.claims,
                Err(why) => match why.kind() {
                    ErrorKind::InvalidSignature => continue,
                    ErrorKind::InvalidAudience => return Err(TokenError::Audience),
                    ErrorKind::MissingRequiredClaim(_) => return Err(TokenError::NoExpiry),
                    _ => return Err(TokenError::Malformed),
                },
            };
            // Expiry is the only way to revoke a token.
            return if claims.exp.is_some() { claims.grant(now) } else { Err(TokenError::NoExpiry) };
        }
        Err(TokenError::Signature)
    }
}

/// Reloads the keys when their file changes; never returns.
pub(crate) async fn watch_keys(tokens: &Tokens, reload_requests: watch::Receiver<u64>) {
    watch_files("the token keys", vec![tokens.file.clone()], reload_requests, |texts, first| {
        match texts.and_then(|texts| tokens.set_keys(&texts.concat())) {
            Ok(()) if first => {}
            Ok(()) => {
                tracing::info!("the token keys were reloaded; running sessions keep their grants")
            }
            Err(why) => tracing::error!(
                "the token keys are not reloaded: {why:#}; the file is read again when it changes"
            ),
        }
    })
    .await;
}
