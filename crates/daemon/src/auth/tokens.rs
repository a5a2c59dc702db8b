//! Who may see the scene: bearer tokens, which another program signs (JSON Web Tokens, RFC 7519).
//!
//! A token must be signed by a key of the operator's file, must expire, and must name the scene. It is looked at before
//! a session has a lease, or anything is planned or sent for it.

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

/// What is verified of tokens, and by what.
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
    /// By the keys in a file; a token with an audience must have this one.
    ///
    /// # Errors
    /// Fails where the file cannot be read or holds no key.
    pub fn from_file(file: impl Into<PathBuf>, audience: Option<String>) -> anyhow::Result<Self> {
        token_crypto::install();
        let file = file.into();
        let keys = RwLock::new(Arc::from([]));
        let tokens = Self { file, audience, keys };
        tokens.take_keys(&read_small_file(&tokens.file)?)?;
        Ok(tokens)
    }

    /// Takes what was read from the file; what holds no key leaves the old ones in place. Sessions go on until their tokens
    /// end.
    pub(crate) fn take_keys(&self, text: &[u8]) -> anyhow::Result<()> {
        let new = read_keys(text).with_context(|| self.file.display().to_string())?.into();
        *self.keys.write().unwrap_or_else(PoisonError::into_inner) = new;
        Ok(())
    }

    /// What a token grants at `now`, for the scenes that it names.
    pub(crate) fn verify(&self, token: &str, now: SystemTime) -> Result<Grant, TokenError> {
        let header = decode_header(token).map_err(|_| TokenError::Malformed)?;
        let keys = Arc::clone(&self.keys.read().unwrap_or_else(PoisonError::into_inner));
        let mut validation = Validation::new(header.alg);
        // The library would ask the system for the time, and panics where that lies before 1970.
        validation.validate_exp = false;
        validation.validate_nbf = false;
        validation.aud = self.audience.iter().cloned().map(|audience| [audience].into()).next();
        // A key says what it is for; a token that names a key is tried against that alone.
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
            // Whoever signs has no other way to take back what was signed.
            return if claims.exp.is_some() { claims.grant(now) } else { Err(TokenError::NoExpiry) };
        }
        Err(TokenError::Signature)
    }
}

/// Takes the keys anew when their file has changed. Goes on for ever.
pub(crate) async fn watch_keys(tokens: &Tokens, asked: watch::Receiver<u64>) {
    watch_files("the keys of tokens", vec![tokens.file.clone()], asked, |texts, first| {
        match texts.and_then(|texts| tokens.take_keys(&texts.concat())) {
            Ok(()) if first => {}
            Ok(()) => {
                tracing::info!("the keys of tokens were exchanged; sessions go on until their tokens end")
            }
            Err(why) => tracing::error!(
                "the keys of tokens are not exchanged: {why:#}; the file is read again when it changes"
            ),
        }
    })
    .await;
}
