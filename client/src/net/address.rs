//! Addresses of servers: `quic://HOST:PORT`, `wss://HOST:PORT` or `ws://HOST:PORT`, optionally followed by a scene's
//! name,
//! `/NAME`. The first two may end with the fingerprint of a certificate (`#sha256=HEX`) or of its key
//! (`#spki-sha256=HEX`).

use std::fmt;
use std::str::FromStr;

use lodestream_protocol::stream::{path_of_scene, scene_of_path};

use super::pin::{Pin, PinError};

/// Transport of an address.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Scheme {
    /// QUIC.
    Quic,
    /// WebSocket over TLS.
    SecureWebSocket,
    /// WebSocket over plain TCP.
    WebSocket,
}

impl Scheme {
    /// "quic", "wss" or "ws".
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Quic => "quic",
            Self::SecureWebSocket => "wss",
            Self::WebSocket => "ws",
        }
    }
}

/// Default port of a `wss://` address.
const HTTPS_PORT: u16 = 443;

/// Address of a server.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Address {
    /// Transport.
    pub scheme: Scheme,
    /// Host name or IP address, without brackets.
    pub host: String,
    /// UDP or TCP port.
    pub port: u16,
    /// Name of the scene; empty for the server's only scene.
    pub scene: String,
    /// Fingerprint of the server's certificate; always `None` for plain WebSocket. With `None`, the certificate is
    /// verified by authorities.
    pub pin: Option<Pin>,
}

/// Why an address is invalid. The message says what to write instead.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum AddressError {
    /// Not one of the three schemes.
    #[error(
        "{0:?} is not a server address: write quic://HOST:PORT#sha256=… (as the server prints it), wss://HOST or \
         ws://HOST:PORT"
    )]
    Scheme(String),
    /// No host, or invalid characters in it.
    #[error("{0:?} has no valid host: write HOST:PORT after the scheme")]
    Host(String),
    /// No port, or an invalid one.
    #[error("{0:?} has no port from 1 to 65535: write HOST:PORT after the scheme")]
    Port(String),
    /// An invalid fingerprint.
    #[error(transparent)]
    Pin(#[from] PinError),
    /// A path that is not a scene's name.
    #[error(
        "{0:?} is not the name of a scene: write /NAME, with characters other than letters and digits as %XX"
    )]
    Scene(String),
    /// Unknown text at the end.
    #[error("{0:?} is not allowed at the end of the address: leave it out")]
    Rest(String),
}

impl FromStr for Address {
    type Err = AddressError;

    fn from_str(text: &str) -> Result<Self, AddressError> {
        let (scheme, rest) = text.split_once("://").ok_or_else(|| AddressError::Scheme(text.into()))?;
        let (rest, fragment) = rest.split_once('#').map_or((rest, None), |(a, b)| (a, Some(b)));
        let (place, path) = rest.find('/').map_or((rest, ""), |at| rest.split_at(at));
        let scene = if path.is_empty() { Some(String::new()) } else { scene_of_path(path) };
        let scene = scene.ok_or_else(|| AddressError::Scene(path.into()))?;
        let scheme = match scheme.to_ascii_lowercase().as_str() {
            "quic" => Scheme::Quic,
            "wss" => Scheme::SecureWebSocket,
            "ws" => Scheme::WebSocket,
            _ => return Err(AddressError::Scheme(text.into())),
        };
        let pin = match fragment {
            None | Some("") => None,
            // Plain WebSocket has no certificate.
            Some(fragment) if scheme == Scheme::WebSocket => {
                return Err(AddressError::Rest(format!("#{fragment}")));
            }
            Some(fragment) => Some(fragment.parse()?),
        };
        // The last colon, unless it is within an IPv6 address.
        let colon = place.rfind(':').filter(|&at| !place[at..].contains(']'));
        let (host, port) = match colon {
            Some(at) => (&place[..at], Some(&place[at + 1..])),
            None => (place, None),
        };
        let bracketed = host.strip_prefix('[').and_then(|h| h.strip_suffix(']'));
        let known = |c: char| c.is_ascii_alphanumeric() || matches!(c, '.' | '-' | '_');
        let valid = match bracketed {
            Some(inside) => inside.parse::<std::net::Ipv6Addr>().is_ok(),
            None => !host.is_empty() && host.chars().all(known),
        };
        if !valid {
            return Err(AddressError::Host(place.into()));
        }
        let port = match port {
            None if scheme == Scheme::SecureWebSocket => Some(HTTPS_PORT),
            port => port.and_then(|port| port.parse().ok()).filter(|port| *port != 0),
        };
        let port = port.ok_or_else(|| AddressError::Port(place.into()))?;
        Ok(Self { scheme, host: bracketed.unwrap_or(host).to_owned(), port, scene, pin })
    }
}

impl Address {
    /// "quic", "wss" or "ws".
    #[must_use]
    pub const fn transport(&self) -> &'static str {
        self.scheme.name()
    }

    /// `HOST:PORT`, with brackets around IPv6 addresses.
    #[must_use]
    pub fn authority(&self) -> String {
        let Self { host, port, .. } = self;
        if host.contains(':') { format!("[{host}]:{port}") } else { format!("{host}:{port}") }
    }

    /// The scene as a path: `/NAME`, percent-encoded; `/` if none is named.
    #[must_use]
    pub fn path(&self) -> String {
        path_of_scene(&self.scene)
    }
}

impl fmt::Display for Address {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}://{}", self.transport(), self.authority())?;
        if self.scene.is_empty() { Ok(()) } else { f.write_str(&self.path()) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const HEX: &str = "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad";

    #[test]
    fn valid_addresses_are_parsed() {
        let quic: Address = format!("quic://127.0.0.1:4433#sha256={HEX}").parse().unwrap();
        assert_eq!((quic.transport(), quic.host.as_str(), quic.port), ("quic", "127.0.0.1", 4433));
        assert_eq!(quic.to_string(), "quic://127.0.0.1:4433");
        let ws: Address = "ws://[::1]:8080/".parse().unwrap();
        assert_eq!((ws.transport(), ws.authority().as_str()), ("ws", "[::1]:8080"));
        assert!("WS://example.org:80".parse::<Address>().is_ok());
        let wss: Address = format!("wss://[::1]/#spki-sha256={HEX}").parse().unwrap();
        assert_eq!((wss.scheme, wss.authority().as_str()), (Scheme::SecureWebSocket, "[::1]:443"));
        assert!(matches!(wss.pin, Some(Pin::Key(_))) && matches!(quic.pin, Some(Pin::Certificate(_))));
        for trusted in ["quic://h:1", "quic://h:1#", "wss://h", "wss://h:8443/", "wss://h#"] {
            assert_eq!(trusted.parse::<Address>().unwrap().pin, None, "{trusted}");
        }
    }

    #[test]
    fn the_path_names_a_scene() {
        let scene = |text: &str| text.parse::<Address>().unwrap().scene;
        assert_eq!(scene("ws://h:1"), "");
        assert_eq!(scene("ws://h:1/"), "");
        assert_eq!(scene("wss://h/temple"), "temple");
        assert_eq!(scene(&format!("quic://h:1/a%20b%2Fc#sha256={HEX}")), "a b/c");
        let address: Address = "quic://[::1]:1/gro%C3%9F%20%2f".parse().unwrap();
        assert_eq!(
            (address.scene.as_str(), address.to_string().as_str()),
            ("groß /", "quic://[::1]:1/gro%C3%9F%20%2F")
        );
        assert_eq!(address.to_string().parse(), Ok(address));
    }

    #[test]
    fn invalid_addresses_are_errors_that_say_what_is_wrong() {
        let error = |text: &str| text.parse::<Address>().unwrap_err();
        assert!(matches!(error("quic://h:1#sha256=12"), AddressError::Pin(_)));
        assert!(matches!(error("wss://h:1#spki-sha256=12"), AddressError::Pin(_)));
        assert!(matches!(error("quic://h:1#md5=12"), AddressError::Pin(_)));
        assert!(matches!(error("localhost:8080"), AddressError::Scheme(_)));
        assert!(matches!(error("http://h:1"), AddressError::Scheme(_)));
        for port in [
            "ws://h",
            "ws://h:0",
            "ws://h:65536",
            "ws://h:x",
            "ws://h:",
            "quic://h",
            "ws://[::1]",
            "wss://h:",
        ] {
            assert!(matches!(error(port), AddressError::Port(_)), "{port}");
        }
        for host in
            ["ws://:1", "ws://a b:1", "ws://[::zz]:1", "ws://u@h:1", "ws://::1:8080", "wss://", "wss://::1"]
        {
            assert!(matches!(error(host), AddressError::Host(_)), "{host}");
        }
        for scene in ["ws://h:1/a/b", "ws://h:1/a?b", "ws://h:1/%ff", "wss://h//"] {
            assert!(matches!(error(scene), AddressError::Scene(_)), "{scene}");
        }
        assert!(matches!(error(&format!("ws://h:1#sha256={HEX}")), AddressError::Rest(_)));
    }
}
