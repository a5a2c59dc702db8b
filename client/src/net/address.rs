//! Addresses of servers: `quic://HOST:PORT#sha256=HEX` and `ws://HOST:PORT`.

use std::fmt;
use std::str::FromStr;

use super::pin::{Pin, PinError};

/// How a server is reached.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Scheme {
    /// QUIC; the certificate's fingerprint must be known.
    Quic(Pin),
    /// WebSocket over plain TCP.
    WebSocket,
}

/// Where a server is.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Address {
    /// Transport.
    pub scheme: Scheme,
    /// Host name or IP address, without brackets.
    pub host: String,
    /// UDP or TCP port.
    pub port: u16,
}

/// An address that cannot be used. The message says what to write instead.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum AddressError {
    /// Neither `quic://` nor `ws://`.
    #[error("{0:?} is no server address: write quic://HOST:PORT#sha256=… or ws://HOST:PORT")]
    Scheme(String),
    /// TLS over TCP.
    #[error("wss:// is not supported: use quic:// (encrypted) or ws:// (plain)")]
    SecureWebSocket,
    /// No host, or characters that no host has.
    #[error("{0:?} names no host: write HOST:PORT after the scheme")]
    Host(String),
    /// No port, or not a port.
    #[error("{0:?} has no port from 1 to 65535: write HOST:PORT after the scheme")]
    Port(String),
    /// QUIC without fingerprint.
    #[error(
        "quic:// needs the server's certificate fingerprint: add #sha256=… as the server prints it at start"
    )]
    NoPin,
    /// A fingerprint that is none.
    #[error(transparent)]
    Pin(#[from] PinError),
    /// Something after the port.
    #[error("{0:?} is not understood at the end of the address")]
    Rest(String),
}

impl FromStr for Address {
    type Err = AddressError;

    fn from_str(text: &str) -> Result<Self, AddressError> {
        let (scheme, rest) = text.split_once("://").ok_or_else(|| AddressError::Scheme(text.into()))?;
        let (rest, fragment) = rest.split_once('#').map_or((rest, None), |(a, b)| (a, Some(b)));
        let (place, path) = rest.find('/').map_or((rest, ""), |at| rest.split_at(at));
        if !matches!(path, "" | "/") {
            return Err(AddressError::Rest(path.into()));
        }
        let scheme = match scheme.to_ascii_lowercase().as_str() {
            "quic" => {
                let hex = match fragment {
                    None | Some("") => return Err(AddressError::NoPin),
                    Some(fragment) => fragment
                        .strip_prefix("sha256=")
                        .ok_or_else(|| AddressError::Rest(format!("#{fragment}")))?,
                };
                Scheme::Quic(hex.parse()?)
            }
            "ws" => match fragment {
                None | Some("") => Scheme::WebSocket,
                Some(fragment) => return Err(AddressError::Rest(format!("#{fragment}"))),
            },
            "wss" => return Err(AddressError::SecureWebSocket),
            _ => return Err(AddressError::Scheme(text.into())),
        };
        let (host, port) = place.rsplit_once(':').ok_or_else(|| AddressError::Port(place.into()))?;
        let bracketed = host.strip_prefix('[').and_then(|h| h.strip_suffix(']'));
        let known = |c: char| c.is_ascii_alphanumeric() || matches!(c, '.' | '-' | '_');
        let valid = match bracketed {
            Some(inside) => inside.parse::<std::net::Ipv6Addr>().is_ok(),
            None => !host.is_empty() && host.chars().all(known),
        };
        if !valid {
            return Err(AddressError::Host(place.into()));
        }
        let port = port.parse().ok().filter(|p| *p != 0).ok_or_else(|| AddressError::Port(place.into()))?;
        Ok(Self { scheme, host: bracketed.unwrap_or(host).to_owned(), port })
    }
}

impl Address {
    /// "quic" or "ws".
    #[must_use]
    pub const fn transport(&self) -> &'static str {
        match self.scheme {
            Scheme::Quic(_) => "quic",
            Scheme::WebSocket => "ws",
        }
    }

    /// `HOST:PORT`, with brackets around IPv6 addresses.
    #[must_use]
    pub fn authority(&self) -> String {
        let Self { host, port, .. } = self;
        if host.contains(':') { format!("[{host}]:{port}") } else { format!("{host}:{port}") }
    }
}

impl fmt::Display for Address {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}://{}", self.transport(), self.authority())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const HEX: &str = "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad";

    #[test]
    fn good_addresses_are_understood() {
        let quic: Address = format!("quic://127.0.0.1:4433#sha256={HEX}").parse().unwrap();
        assert_eq!((quic.transport(), quic.host.as_str(), quic.port), ("quic", "127.0.0.1", 4433));
        assert_eq!(quic.to_string(), "quic://127.0.0.1:4433");
        let ws: Address = "ws://[::1]:8080/".parse().unwrap();
        assert_eq!((ws.transport(), ws.authority().as_str()), ("ws", "[::1]:8080"));
        assert!("WS://example.org:80".parse::<Address>().is_ok());
    }

    #[test]
    fn bad_addresses_say_what_is_wrong() {
        let error = |text: &str| text.parse::<Address>().unwrap_err();
        assert_eq!(error("quic://h:1"), AddressError::NoPin);
        assert_eq!(error("quic://h:1#"), AddressError::NoPin);
        assert!(matches!(error("quic://h:1#sha256=12"), AddressError::Pin(_)));
        assert!(matches!(error("quic://h:1#md5=12"), AddressError::Rest(_)));
        assert!(matches!(error("localhost:8080"), AddressError::Scheme(_)));
        assert!(matches!(error("http://h:1"), AddressError::Scheme(_)));
        assert_eq!(error("wss://h:1"), AddressError::SecureWebSocket);
        for port in ["ws://h", "ws://h:0", "ws://h:65536", "ws://h:x", "ws://h:"] {
            assert!(matches!(error(port), AddressError::Port(_)), "{port}");
        }
        for host in ["ws://:1", "ws://a b:1", "ws://[::zz]:1", "ws://u@h:1", "ws://::1:8080"] {
            assert!(matches!(error(host), AddressError::Host(_)), "{host}");
        }
        assert!(matches!(error("ws://h:1/other"), AddressError::Rest(_)));
    }
}
