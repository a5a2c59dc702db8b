//! Why there is no session for who asked for one, as it is counted.

use crate::admission::leases::LeaseError;

/// See the module.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Refusal {
    /// All places are taken.
    Full,
    /// The address has as many sessions as one may.
    Address,
    /// The address began too many sessions lately.
    Rate,
    /// The server takes no more clients.
    Draining,
    /// There was no token that grants the scene.
    Token,
    /// A web page asked that may not.
    Origin,
    /// There is no such scene.
    Scene,
}

impl Refusal {
    /// All, in the order of their numbers.
    pub(crate) const ALL: [Self; 7] =
        [Self::Full, Self::Address, Self::Rate, Self::Draining, Self::Token, Self::Origin, Self::Scene];

    /// Name in metrics.
    pub(crate) const fn name(self) -> &'static str {
        match self {
            Self::Full => "full",
            Self::Address => "address",
            Self::Rate => "rate",
            Self::Draining => "draining",
            Self::Token => "token",
            Self::Origin => "origin",
            Self::Scene => "scene",
        }
    }
}

impl From<LeaseError> for Refusal {
    fn from(why: LeaseError) -> Self {
        match why {
            LeaseError::Full => Self::Full,
            LeaseError::AddressLimit => Self::Address,
            LeaseError::RateLimit => Self::Rate,
            LeaseError::Draining => Self::Draining,
        }
    }
}
