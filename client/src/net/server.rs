//! A server that a client streams from: where it is, and by what it is known.

use std::str::FromStr;

use super::address::{Address, AddressError};
#[cfg(any(feature = "quic", feature = "tls"))]
use super::trust::Authorities;

/// A server. [`Server::from`] an address, or parsed as one, it is known by the address's fingerprint or by the system's
/// authorities.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct Server {
    /// Where it is.
    pub address: Address,
    /// Who may vouch for it where its address has no fingerprint.
    #[cfg(any(feature = "quic", feature = "tls"))]
    pub authorities: Authorities,
}

impl From<Address> for Server {
    fn from(address: Address) -> Self {
        Self {
            address,
            #[cfg(any(feature = "quic", feature = "tls"))]
            authorities: Authorities::default(),
        }
    }
}

impl FromStr for Server {
    type Err = AddressError;

    fn from_str(text: &str) -> Result<Self, AddressError> {
        text.parse::<Address>().map(Self::from)
    }
}
