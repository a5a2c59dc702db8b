//! Claims of a token or of the operator's response, and the grant that they give.

use std::time::{Duration, SystemTime, UNIX_EPOCH};

use lodestream_protocol::shared_rate_limit::Weight;
use serde::Deserialize;
use serde::de::IgnoredAny;
use tokio::time::Instant;

/// Tolerated difference between the clocks of the token's issuer and of this machine.
const LEEWAY: Duration = Duration::from_secs(30);
/// Longest lifetime of a grant, whatever its expiry.
const MAX_LIFETIME: Duration = Duration::from_secs(400 * 24 * 3600);

/// Lowest rate of a grant in bits per second, as for `--rate`.
const MIN_RATE_BITS_PER_S: u64 = 1000;

/// Why a token is refused; the text is sent to the client.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub(crate) enum TokenError {
    #[error("the server requires a token, and none was given")]
    Missing,
    #[error("the token is not a JSON Web Token")]
    Malformed,
    #[error("the token is signed by no key that the server knows")]
    Signature,
    #[error("the token has expired")]
    Expired,
    #[error("the token is not valid yet")]
    NotYetValid,
    #[error("the token has no expiry (claim exp)")]
    NoExpiry,
    #[error("the token is for another audience")]
    Audience,
    #[error("the token is not for this scene")]
    Scene,
    #[error("the token's weight is not a whole number from 1 to 100")]
    Weight,
    #[error("the token's rate is not a whole number of bits per second, at least 1000")]
    Rate,
    #[error("the token is refused")]
    Refused,
    #[error("the server cannot verify the token now: try again later")]
    Unavailable,
}

/// The access of a client whose token was accepted.
#[derive(Clone, Debug)]
pub(crate) struct Grant {
    /// Expiry, on a clock that no one sets.
    pub(crate) expires_at: Instant,
    /// Subject of the token, for the log.
    pub(crate) subject: Option<String>,
    /// Weight of the session in shared rate limits.
    pub(crate) weight: Weight,
    /// Limit of the session's rate.
    pub(crate) rate_bits_per_s: Option<u64>,
    scenes: Option<SceneClaim>,
}

impl Grant {
    /// Whether the grant covers a scene.
    pub(crate) fn allows(&self, scene: &str) -> bool {
        self.scenes.as_ref().is_some_and(|scenes| scenes.has(scene))
    }

    /// Returns the grant if it covers `scene`.
    pub(crate) fn for_scene(self, scene: &str) -> Result<Self, TokenError> {
        if self.allows(scene) { Ok(self) } else { Err(TokenError::Scene) }
    }
}

/// Registered claims (RFC 7519, section 4.1), and three private ones: `scene`, `weight` and `rate`.
#[derive(Clone, Debug, Deserialize)]
pub(crate) struct Claims {
    /// Expiry in seconds since 1970.
    pub(crate) exp: Option<f64>,
    nbf: Option<f64>,
    sub: Option<String>,
    /// Scenes that the token covers.
    pub(crate) scene: Option<SceneClaim>,
    weight: Option<IntegerClaim>,
    rate: Option<IntegerClaim>,
}

impl Claims {
    /// The grant at `now`. Claims without expiry give the longest lifetime.
    pub(crate) fn grant(self, now: SystemTime) -> Result<Grant, TokenError> {
        let left =
            self.exp.map_or(Some(MAX_LIFETIME), |exp| remaining(exp, now)).ok_or(TokenError::Expired)?;
        if self.nbf.is_some_and(|nbf| nbf > (since_1970(now) + LEEWAY).as_secs_f64()) {
            return Err(TokenError::NotYetValid);
        }
        let weight = self.weight.map_or(Some(Weight::ONE), |weight| weight.number().and_then(Weight::new));
        let rate = self.rate.map(|rate| rate.number().filter(|rate| *rate >= MIN_RATE_BITS_PER_S));
        Ok(Grant {
            expires_at: Instant::now() + left,
            subject: self.sub,
            weight: weight.ok_or(TokenError::Weight)?,
            rate_bits_per_s: rate.map(|rate| rate.ok_or(TokenError::Rate)).transpose()?,
            scenes: self.scene,
        })
    }
}

/// A claim that must be a whole number; other values are kept to be refused.
#[derive(Clone, Debug, Deserialize)]
#[serde(untagged)]
enum IntegerClaim {
    Number(u64),
    Other(IgnoredAny),
}

impl IntegerClaim {
    const fn number(&self) -> Option<u64> {
        match self {
            Self::Number(number) => Some(*number),
            Self::Other(_) => None,
        }
    }
}

/// One scene or several; `*` covers all.
#[derive(Clone, Debug, Deserialize)]
#[serde(untagged)]
pub(crate) enum SceneClaim {
    One(String),
    Many(Vec<String>),
}

impl SceneClaim {
    fn has(&self, name: &str) -> bool {
        let fits = |scene: &String| scene == name || scene == "*";
        match self {
            Self::One(scene) => fits(scene),
            Self::Many(scenes) => scenes.iter().any(fits),
        }
    }
}

/// Time since 1970; zero for a clock that was never set.
fn since_1970(now: SystemTime) -> Duration {
    now.duration_since(UNIX_EPOCH).unwrap_or_default()
}

/// Time until `exp` (seconds since 1970) with the leeway; `None` if it is past.
fn remaining(exp: f64, now: SystemTime) -> Option<Duration> {
    let exp = Duration::try_from_secs_f64(exp.clamp(0.0, 1e12)).ok()?;
    (exp + LEEWAY)
        .checked_sub(since_1970(now))
        .filter(|left| !left.is_zero())
        .map(|left| left.min(MAX_LIFETIME))
}
