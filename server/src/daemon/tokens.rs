//! Who may see the scene: bearer tokens, which another program signs (JSON Web Tokens, RFC 7519).
//!
//! A token must be signed by a key of the operator's file, must expire, and must name the scene. It is looked at before
//! a session has a lease, or anything is planned or sent for it.

use std::fmt;
use std::path::PathBuf;
use std::sync::{Arc, PoisonError, RwLock};
use std::time::{Duration, SystemTime, UNIX_EPOCH};

use anyhow::Context as _;
use jsonwebtoken::errors::ErrorKind;
use jsonwebtoken::{Validation, decode, decode_header};
use lodestream_protocol::ceiling::Weight;
use serde::Deserialize;
use serde::de::IgnoredAny;
use tokio::sync::watch;
use tokio::time::Instant;

use super::certificate::read_pem as read_small;
use super::reload::follow;
use super::token_crypto;
use super::token_keys::{Key, read_keys};

/// By how much the clocks of who gives tokens and of this machine may differ.
const LEEWAY: Duration = Duration::from_secs(30);
/// Longest time until a session has to show another token, whatever the first says.
const LONGEST: Duration = Duration::from_secs(400 * 24 * 3600);

/// Lowest rate that a token may say, in bits per second, as of `--rate`.
const LEAST_RATE_BITS_PER_S: u64 = 1000;

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

/// Why a token is not taken, for who shows it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub(super) enum TokenError {
    #[error("the server asks for a token, and none was given")]
    Missing,
    #[error("the token is no JSON Web Token")]
    Malformed,
    #[error("the token is signed by no key that the server knows")]
    Signature,
    #[error("the token has expired")]
    Expired,
    #[error("the token is not valid yet")]
    NotYet,
    #[error("the token says nowhere when it expires")]
    Endless,
    #[error("the token is for another audience")]
    Audience,
    #[error("the token is not for this scene")]
    Scene,
    #[error("the token's weight is no whole number from 1 to 100")]
    Weight,
    #[error("the token's rate is no whole number of bits per second from 1000 up")]
    Rate,
}

/// What a token grants.
#[derive(Clone, Debug)]
pub(super) struct Grant {
    /// When it ends.
    pub(super) until: Instant,
    /// Whom it was given to, if it says so.
    pub(super) subject: Option<String>,
    /// How much the session counts beside others.
    pub(super) weight: Weight,
    /// What the session may have at most, if it says so.
    pub(super) rate_bits_per_s: Option<u64>,
    scenes: Option<Scenes>,
}

impl Grant {
    /// Whether it is for the scene of this name.
    pub(super) fn is_for(&self, scene: &str) -> bool {
        self.scenes.as_ref().is_some_and(|scenes| scenes.has(scene))
    }

    /// The grant, if it is for this scene.
    pub(super) fn of(self, scene: &str) -> Result<Self, TokenError> {
        if self.is_for(scene) { Ok(self) } else { Err(TokenError::Scene) }
    }
}

#[derive(Deserialize)]
struct Claims {
    exp: f64,
    nbf: Option<f64>,
    sub: Option<String>,
    scene: Option<Scenes>,
    weight: Option<Whole>,
    rate: Option<Whole>,
}

/// A claim that should be a whole number.
#[derive(Deserialize)]
#[serde(untagged)]
enum Whole {
    Number(u64),
    Other(IgnoredAny),
}

impl Whole {
    const fn number(&self) -> Option<u64> {
        match self {
            Self::Number(number) => Some(*number),
            Self::Other(_) => None,
        }
    }
}

#[derive(Clone, Debug, Deserialize)]
#[serde(untagged)]
enum Scenes {
    One(String),
    Some(Vec<String>),
}

impl Scenes {
    fn has(&self, name: &str) -> bool {
        let fits = |scene: &String| scene == name || scene == "*";
        match self {
            Self::One(scene) => fits(scene),
            Self::Some(scenes) => scenes.iter().any(fits),
        }
    }
}

impl Tokens {
    /// By the keys in a file; a token with an audience must have this one.
    ///
    /// # Errors
    /// Fails where the file cannot be read or holds no key.
    pub fn of_file(file: impl Into<PathBuf>, audience: Option<String>) -> anyhow::Result<Self> {
        token_crypto::install();
        let file = file.into();
        let keys = RwLock::new(Arc::from([]));
        let tokens = Self { file, audience, keys };
        tokens.take_keys(&read_small(&tokens.file)?)?;
        Ok(tokens)
    }

    /// Takes what was read from the file; what holds no key leaves the old ones in place. Sessions go on until their tokens
    /// end.
    pub(super) fn take_keys(&self, text: &[u8]) -> anyhow::Result<()> {
        let new = read_keys(text).with_context(|| self.file.display().to_string())?.into();
        *self.keys.write().unwrap_or_else(PoisonError::into_inner) = new;
        Ok(())
    }

    /// What a token grants at `now`, for the scenes that it names.
    pub(super) fn verify(&self, token: &str, now: SystemTime) -> Result<Grant, TokenError> {
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
                    ErrorKind::MissingRequiredClaim(_) => return Err(TokenError::Endless),
                    ErrorKind::Json(why) if why.to_string().contains("missing field `exp`") => {
                        return Err(TokenError::Endless);
                    }
                    _ => return Err(TokenError::Malformed),
                },
            };
            let left = left(claims.exp, now).ok_or(TokenError::Expired)?;
            if claims.nbf.is_some_and(|nbf| nbf > (since_1970(now) + LEEWAY).as_secs_f64()) {
                return Err(TokenError::NotYet);
            }
            let weight =
                claims.weight.map_or(Some(Weight::ONE), |weight| weight.number().and_then(Weight::new));
            let rate = claims.rate.map(|rate| rate.number().filter(|rate| *rate >= LEAST_RATE_BITS_PER_S));
            return Ok(Grant {
                until: Instant::now() + left,
                subject: claims.sub,
                weight: weight.ok_or(TokenError::Weight)?,
                rate_bits_per_s: rate.map(|rate| rate.ok_or(TokenError::Rate)).transpose()?,
                scenes: claims.scene,
            });
        }
        Err(TokenError::Signature)
    }
}

/// Takes the keys anew when their file has changed. Goes on for ever.
pub(super) async fn renew_keys(tokens: Arc<Tokens>, asked: watch::Receiver<u64>) {
    follow("the keys of tokens", vec![tokens.file.clone()], asked, |texts, first| {
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

/// A clock that stands before 1970 was never set; it says 1970.
fn since_1970(now: SystemTime) -> Duration {
    now.duration_since(UNIX_EPOCH).unwrap_or_default()
}

/// Time until `exp`, in seconds since 1970, with the leeway.
fn left(exp: f64, now: SystemTime) -> Option<Duration> {
    let exp = Duration::try_from_secs_f64(exp.clamp(0.0, 1e12)).ok()?;
    (exp + LEEWAY).checked_sub(since_1970(now)).filter(|left| !left.is_zero()).map(|left| left.min(LONGEST))
}
