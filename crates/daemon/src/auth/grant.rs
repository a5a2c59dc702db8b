//! What a client is granted, by the claims of its token or by the operator's own program: the same claims.

use std::time::{Duration, SystemTime, UNIX_EPOCH};

use lodestream_protocol::shared_rate_limit::Weight;
use serde::Deserialize;
use serde::de::IgnoredAny;
use tokio::time::Instant;

/// By how much the clocks of who gives grants and of this machine may differ.
const LEEWAY: Duration = Duration::from_secs(30);
/// Longest time until a session has to show another token, whatever the first says.
const LONGEST: Duration = Duration::from_secs(400 * 24 * 3600);

/// Lowest rate that a grant may say, in bits per second, as of `--rate`.
const LEAST_RATE_BITS_PER_S: u64 = 1000;

/// Why a token is not taken, for who shows it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub(crate) enum TokenError {
    #[error("the server asks for a token, and none was given")]
    Missing,
    #[error("the token is no JSON Web Token")]
    Malformed,
    #[error("the token is signed by no key that the server knows")]
    Signature,
    #[error("the token has expired")]
    Expired,
    #[error("the token is not valid yet")]
    NotYetValid,
    #[error("the token says nowhere when it expires")]
    NoExpiry,
    #[error("the token is for another audience")]
    Audience,
    #[error("the token is not for this scene")]
    Scene,
    #[error("the token's weight is no whole number from 1 to 100")]
    Weight,
    #[error("the token's rate is no whole number of bits per second from 1000 up")]
    Rate,
    #[error("the token is refused")]
    Refused,
    #[error("the server cannot find out now whether the token is good: try again later")]
    Unavailable,
}

/// What a client is granted.
#[derive(Clone, Debug)]
pub(crate) struct Grant {
    /// When it ends.
    pub(crate) expires_at: Instant,
    /// Whom it was given to, if it says so.
    pub(crate) subject: Option<String>,
    /// How much the session counts beside others.
    pub(crate) weight: Weight,
    /// What the session may have at most, if it says so.
    pub(crate) rate_bits_per_s: Option<u64>,
    scenes: Option<SceneClaim>,
}

impl Grant {
    /// Whether it is for the scene of this name.
    pub(crate) fn allows(&self, scene: &str) -> bool {
        self.scenes.as_ref().is_some_and(|scenes| scenes.has(scene))
    }

    /// The grant, if it is for this scene.
    pub(crate) fn for_scene(self, scene: &str) -> Result<Self, TokenError> {
        if self.allows(scene) { Ok(self) } else { Err(TokenError::Scene) }
    }
}

/// What is said of a client (RFC 7519, section 4.1), and three things of our own: scenes, weight and rate.
#[derive(Clone, Debug, Deserialize)]
pub(crate) struct Claims {
    /// When it ends, in seconds since 1970.
    pub(crate) exp: Option<f64>,
    nbf: Option<f64>,
    sub: Option<String>,
    /// What it is for.
    pub(crate) scene: Option<SceneClaim>,
    weight: Option<IntegerClaim>,
    rate: Option<IntegerClaim>,
}

impl Claims {
    /// What they grant at `now`. Those without an end grant it for as long as any may.
    pub(crate) fn grant(self, now: SystemTime) -> Result<Grant, TokenError> {
        let left = self.exp.map_or(Some(LONGEST), |exp| left(exp, now)).ok_or(TokenError::Expired)?;
        if self.nbf.is_some_and(|nbf| nbf > (since_1970(now) + LEEWAY).as_secs_f64()) {
            return Err(TokenError::NotYetValid);
        }
        let weight = self.weight.map_or(Some(Weight::ONE), |weight| weight.number().and_then(Weight::new));
        let rate = self.rate.map(|rate| rate.number().filter(|rate| *rate >= LEAST_RATE_BITS_PER_S));
        Ok(Grant {
            expires_at: Instant::now() + left,
            subject: self.sub,
            weight: weight.ok_or(TokenError::Weight)?,
            rate_bits_per_s: rate.map(|rate| rate.ok_or(TokenError::Rate)).transpose()?,
            scenes: self.scene,
        })
    }
}

/// A claim that should be a whole number.
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

/// The scenes of a grant; `*` is any.
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

/// A clock that stands before 1970 was never set; it says 1970.
fn since_1970(now: SystemTime) -> Duration {
    now.duration_since(UNIX_EPOCH).unwrap_or_default()
}

/// Time until `exp`, in seconds since 1970, with the leeway.
fn left(exp: f64, now: SystemTime) -> Option<Duration> {
    let exp = Duration::try_from_secs_f64(exp.clamp(0.0, 1e12)).ok()?;
    (exp + LEEWAY).checked_sub(since_1970(now)).filter(|left| !left.is_zero()).map(|left| left.min(LONGEST))
}
