//! Addresses of servers: `quic://HOST:PORT`, `wss://HOST:PORT` or `ws://HOST:PORT`, optionally followed by a scene's
//! name, `/NAME`. Addresses of published scenes: `https://HOST/PATH/NAME.lss`, the same with `http`, and
//! `file:PATH/NAME.lss`. Those over TLS may end with the fingerprint of a certificate (`#sha256=HEX`) or of its key
//! (`#spki-sha256=HEX`).

use std::borrow::Cow;
use std::fmt;
use std::str::FromStr;

use lodestream_protocol::stream::{path_of_scene, scene_of_path};
use percent_encoding::percent_decode_str;

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
    /// A published scene on a web server, over TLS.
    Https,
    /// A published scene on a web server, over plain TCP.
    Http,
    /// A published scene in a folder.
    File,
}

impl Scheme {
    /// "quic", "wss", "ws", "https", "http" or "file".
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Quic => "quic",
            Self::SecureWebSocket => "wss",
            Self::WebSocket => "ws",
            Self::Https => "https",
            Self::Http => "http",
            Self::File => "file",
        }
    }

    fn parse(name: &str) -> Option<Self> {
        let all = [Self::Quic, Self::SecureWebSocket, Self::WebSocket, Self::Https, Self::Http, Self::File];
        all.into_iter().find(|scheme| scheme.name().eq_ignore_ascii_case(name))
    }

    /// Whether it is of published scenes, not of servers.
    #[must_use]
    pub const fn is_published(self) -> bool {
        matches!(self, Self::Https | Self::Http | Self::File)
    }

    const fn default_port(self) -> Option<u16> {
        match self {
            Self::SecureWebSocket | Self::Https => Some(HTTPS_PORT),
            Self::Http => Some(HTTP_PORT),
            Self::Quic | Self::WebSocket | Self::File => None,
        }
    }

    /// Whether connections verify a certificate.
    const fn is_encrypted(self) -> bool {
        matches!(self, Self::Quic | Self::SecureWebSocket | Self::Https)
    }
}

/// Default port of `wss://` and `https://` addresses.
const HTTPS_PORT: u16 = 443;
/// Default port of `http://` addresses.
const HTTP_PORT: u16 = 80;
/// End of the names of published scenes.
const PUBLISHED: &str = ".lss";

/// Address of a server.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Address {
    /// Transport.
    pub scheme: Scheme,
    /// Host name or IP address, without brackets.
    pub host: String,
    /// UDP or TCP port; 0 for files.
    pub port: u16,
    /// Name of the scene; empty for the server's only scene. For published scenes, the path and query on the web
    /// server, or the path of the file.
    pub scene: String,
    /// Fingerprint of the server's certificate; always `None` for plain WebSocket. With `None`, the certificate is
    /// verified by authorities.
    pub pin: Option<Pin>,
}

/// Why an address is invalid. The message says what to write instead.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum AddressError {
    /// An unknown scheme.
    #[error(
        "{0:?} is not a server address: write quic://HOST:PORT#sha256=… (as the server prints it), wss://HOST, \
         ws://HOST:PORT, or https://HOST/NAME.lss or file:NAME.lss for a published scene"
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
    /// A path that is not a published scene's.
    #[error(
        "{0:?} is not a published scene, whose address ends with /NAME.lss; for a server write \
         quic://HOST:PORT#sha256=… (as the server prints it), wss://HOST or ws://HOST:PORT"
    )]
    Published(String),
    /// Unknown text at the end.
    #[error("{0:?} is not allowed at the end of the address: leave it out")]
    Rest(String),
}

impl FromStr for Address {
    type Err = AddressError;

    fn from_str(text: &str) -> Result<Self, AddressError> {
        if let Some(path) = text.strip_prefix("file:") {
            return Self::of_file(text, path);
        }
        let (scheme, rest) = text.split_once("://").ok_or_else(|| AddressError::Scheme(text.into()))?;
        let (rest, fragment) = rest.split_once('#').map_or((rest, None), |(a, b)| (a, Some(b)));
        let (place, path) = rest.find('/').map_or((rest, ""), |at| rest.split_at(at));
        let scheme = Scheme::parse(scheme).ok_or_else(|| AddressError::Scheme(text.into()))?;
        let scene = match path {
            path if scheme.is_published() => {
                let name = path.split('?').next().unwrap_or(path);
                let valid = name.ends_with(PUBLISHED) && path.bytes().all(|byte| byte.is_ascii_graphic());
                valid.then(|| path.to_owned()).ok_or_else(|| AddressError::Published(text.into()))?
            }
            "" => String::new(),
            path => scene_of_path(path).ok_or_else(|| AddressError::Scene(path.into()))?,
        };
        let pin = match fragment {
            None | Some("") => None,
            // There is no certificate.
            Some(fragment) if !scheme.is_encrypted() => {
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
            None if scheme.default_port().is_some() => scheme.default_port(),
            port => port.and_then(|port| port.parse().ok()).filter(|port| *port != 0),
        };
        let port = port.ok_or_else(|| AddressError::Port(place.into()))?;
        Ok(Self { scheme, host: bracketed.unwrap_or(host).to_owned(), port, scene, pin })
    }
}

impl Address {
    /// `file:PATH` or `file:///PATH`.
    fn of_file(text: &str, path: &str) -> Result<Self, AddressError> {
        let path = path.strip_prefix("//").unwrap_or(path);
        let path = percent_decode_str(path).decode_utf8().ok();
        let scene = path.filter(|path| path.ends_with(PUBLISHED)).map(Cow::into_owned);
        let scene = scene.ok_or_else(|| AddressError::Published(text.into()))?;
        Ok(Self { scheme: Scheme::File, host: String::new(), port: 0, scene, pin: None })
    }

    /// The transport's name ([`Scheme::name`]).
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
        match self.scheme {
            Scheme::File => return write!(f, "file:{}", self.scene),
            Scheme::Https | Scheme::Http => {
                // A query may grant access.
                let path = self.scene.split('?').next().unwrap_or_default();
                return write!(f, "{}://{}{path}", self.transport(), self.authority());
            }
            Scheme::Quic | Scheme::SecureWebSocket | Scheme::WebSocket => {}
        }
        write!(f, "{}://{}", self.transport(), self.authority())?;
        if self.scene.is_empty() { Ok(()) } else { f.write_str(&self.path()) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn published_scenes_have_the_address_of_their_file() {
        let https: Address = format!("https://h/a%20b/scene.lss?key=1#sha256={HEX}").parse().unwrap();
        assert_eq!(
            (https.scheme, https.port, https.scene.as_str()),
            (Scheme::Https, 443, "/a%20b/scene.lss?key=1")
        );
        assert!(https.pin.is_some());
        assert_eq!(https.to_string(), "https://h:443/a%20b/scene.lss");
        let http: Address = "http://[::1]:8080/scene.lss".parse().unwrap();
        assert_eq!((http.scheme, http.port), (Scheme::Http, 8080));
        for (text, path) in
            [("file:a/b.lss", "a/b.lss"), ("file:///a%20b.lss", "/a b.lss"), ("file:/a/b.lss", "/a/b.lss")]
        {
            let file: Address = text.parse().unwrap();
            assert_eq!((file.scheme, file.scene.as_str()), (Scheme::File, path));
        }
        for bad in ["http://h", "http://h/", "https://h/a.glb", "file:a.glb", "file:", "https://h/a b.lss"] {
            assert!(matches!(bad.parse::<Address>(), Err(AddressError::Published(_))), "{bad}");
        }
        assert!(matches!("http://h/a.lss#x".parse::<Address>(), Err(AddressError::Rest(_))));
    }

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
        assert!(matches!(error("ftp://h:1"), AddressError::Scheme(_)));
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
