//! A server to stream from: its address, and how its certificate is verified.

use std::str::FromStr;

use super::address::{Address, AddressError};
#[cfg(any(feature = "quic", feature = "tls"))]
use super::trust::Authorities;

/// A server to stream from. Converted or parsed from an address, its certificate is verified by the address's
/// fingerprint or by the system's certificate authorities.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct Server {
    /// Address.
    pub address: Address,
    /// Certificate authorities, used if the address has no fingerprint.
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
