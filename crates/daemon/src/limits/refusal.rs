//! Reasons to refuse a session, as metrics count them.

use crate::limits::leases::LeaseError;

/// Why a session is refused.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Refusal {
    /// All leases are held.
    Full,
    /// The address has as many sessions as one address may have.
    Address,
    /// The address started too many sessions within seconds.
    Rate,
    /// The server is draining.
    Draining,
    /// No valid token for the scene.
    Token,
    /// A web page whose origin is not allowed.
    Origin,
    /// No such scene.
    Scene,
}

impl Refusal {
    /// All reasons, in the order of their discriminants.
    pub(crate) const ALL: [Self; 7] =
        [Self::Full, Self::Address, Self::Rate, Self::Draining, Self::Token, Self::Origin, Self::Scene];

    /// Value of the label `reason`.
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
