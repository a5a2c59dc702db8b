//! Check of the `Origin` header. Browsers let any page open a WebSocket to any reachable address, including a server on
//! the same machine, and send the page's origin (RFC 6455, section 10.2). Other programs send no origin.

use std::borrow::Cow;
use std::collections::BTreeSet;
use std::net::IpAddr;
use std::str::FromStr;

use hyper::header::{self, HeaderMap};
use hyper::http::uri::Authority;

use crate::limits::invalid_setting::InvalidSetting;

/// A page's origin (RFC 6454, section 6), such as `https://example.org:8443`, or `*` for any.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Origin(String);

impl FromStr for Origin {
    type Err = InvalidSetting;

    fn from_str(text: &str) -> Result<Self, InvalidSetting> {
        let lower = text.trim().to_ascii_lowercase();
        if matches!(lower.as_str(), "*" | "null") {
            return Ok(Self(lower));
        }
        let example = "SCHEME://HOST[:PORT] without a path, for example https://example.org, or *";
        let expected = || InvalidSetting::new(text, "an origin", example);
        let (scheme, host) = lower.split_once("://").ok_or_else(expected)?;
        let plain = |c: char| c.is_ascii_graphic() && !matches!(c, '/' | '?' | '#' | '@' | ',' | '*' | '"');
        let named = |scheme: &str| {
            scheme.starts_with(|c: char| c.is_ascii_alphabetic())
                && scheme.chars().all(|c| c.is_ascii_alphanumeric() || "+-.".contains(c))
        };
        if !named(scheme) || host.is_empty() || !host.chars().all(plain) {
            return Err(expected());
        }
        // Browsers omit a scheme's default port.
        let port = match scheme {
            "http" => ":80",
            "https" => ":443",
            _ => "",
        };
        let host = host.strip_suffix(port).unwrap_or(host);
        if host.is_empty() { Err(expected()) } else { Ok(Self(format!("{scheme}://{host}"))) }
    }
}

/// The origins whose pages may open sessions; by default none.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct AllowedOrigins(BTreeSet<Origin>);

impl FromIterator<Origin> for AllowedOrigins {
    fn from_iter<I: IntoIterator<Item = Origin>>(origins: I) -> Self {
        Self(origins.into_iter().collect())
    }
}

impl AllowedOrigins {
    /// The first origin in a request's headers that is neither allowed nor `own`, as it was sent.
    pub(crate) fn refused(&self, headers: &HeaderMap, own: impl Fn(&str) -> bool) -> Option<String> {
        let any = || self.0.contains(&Origin("*".into()));
        let mut sent =
            headers.get_all(header::ORIGIN).iter().map(|value| String::from_utf8_lossy(value.as_bytes()));
        let refused =
            sent.find(|sent| !(self.0.contains(&Origin(sent.to_ascii_lowercase())) || any() || own(sent)));
        refused.map(Cow::into_owned)
    }
}

/// Whether an origin is that of the server's own page: the host and port that the request is sent to.
pub(crate) fn is_same_origin(origin: &str, headers: &HeaderMap) -> bool {
    let (Ok(origin), Some(host)) = (origin.parse::<Origin>(), host(headers)) else { return false };
    let Some((scheme, of_page)) = origin.0.split_once("://") else { return false };
    let of_server = format!("{scheme}://{host}").parse::<Origin>();
    of_server.is_ok_and(|of_server| of_server == origin) && is_own_name(scheme, of_page)
}

/// Whether no other site can have this host. By DNS rebinding a site's name resolves to this server, so that its page and
/// this server seem to have one origin: then scheme and name tell that they differ. An https page came from a server with
/// a certificate for the name. Addresses are no names, and nobody can register localhost, names without a dot, or names
/// of the local network (RFC 6761, RFC 6762).
pub(crate) fn is_own_name(scheme: &str, host_and_port: &str) -> bool {
    let host = host_and_port.rsplit_once(':').filter(|(_, port)| port.bytes().all(|b| b.is_ascii_digit()));
    let host = host.map_or(host_and_port, |(host, _)| host);
    let address = host.strip_prefix('[').and_then(|host| host.strip_suffix(']')).unwrap_or(host);
    match scheme {
        "https" => true,
        "http" => {
            address.parse::<IpAddr>().is_ok()
                || !host.contains('.')
                || host.ends_with(".localhost")
                || host.ends_with(".local")
        }
        _ => false,
    }
}

/// The server's name in a request. Its characters have no meaning in a policy.
pub(crate) fn host(headers: &HeaderMap) -> Option<Authority> {
    let mut hosts = headers.get_all(header::HOST).iter();
    let (host, None) = (hosts.next()?, hosts.next()) else { return None };
    let plain = |byte: u8| byte.is_ascii_alphanumeric() || b".-:[]_".contains(&byte);
    host.to_str().ok().filter(|host| host.bytes().all(plain))?.parse().ok()
}

#[cfg(test)]
mod tests {
    use hyper::header::HeaderValue;

    use super::*;

    fn allowed(origins: &[&str]) -> AllowedOrigins {
        origins.iter().map(|origin| origin.parse::<Origin>().unwrap()).collect()
    }

    fn of(origins: &[&str]) -> HeaderMap {
        let mut headers = HeaderMap::new();
        for origin in origins {
            headers.append(header::ORIGIN, HeaderValue::from_str(origin).unwrap());
        }
        headers
    }

    #[test]
    fn only_names_that_no_other_site_can_have_are_the_servers_own() {
        let sent_to = |host: &str| {
            let mut headers = HeaderMap::new();
            headers.insert(header::HOST, HeaderValue::from_str(host).unwrap());
            headers
        };
        for (origin, host) in [
            ("http://127.0.0.1:8080", "127.0.0.1:8080"),
            ("http://[::1]:8080", "[::1]:8080"),
            ("http://LocalHost:8080", "localhost:8080"),
            ("http://box", "box:80"),
            ("http://box.local:8080", "box.local:8080"),
            ("https://example.org", "example.org"),
            ("https://example.org", "example.org:443"),
        ] {
            assert!(is_same_origin(origin, &sent_to(host)), "{origin} {host}");
        }
        for (origin, host) in [
            ("http://127.0.0.1:8080", "127.0.0.1:8081"),
            ("http://127.0.0.1", "127.0.0.1:8080"),
            ("http://localhost:8080", "127.0.0.1:8080"),
            ("http://rebound.example:8080", "rebound.example:8080"),
            ("http://127.0.0.1.example:8080", "127.0.0.1.example:8080"),
            ("https://evil.example", "example.org"),
            ("null", "null"),
            ("*", "*"),
            ("http://a@127.0.0.1", "a@127.0.0.1"),
            ("chrome-extension://abc", "abc"),
        ] {
            assert!(!is_same_origin(origin, &sent_to(host)), "{origin} {host}");
        }
        let mut two = sent_to("127.0.0.1:8080");
        two.append(header::HOST, HeaderValue::from_static("127.0.0.1:8080"));
        assert!(!is_same_origin("http://127.0.0.1:8080", &two), "two hosts");
        assert!(!is_same_origin("http://127.0.0.1:8080", &HeaderMap::new()), "no host");
    }

    #[test]
    fn a_request_without_an_origin_is_allowed() {
        assert_eq!(allowed(&[]).refused(&of(&[]), |_| false), None);
    }

    #[test]
    fn only_listed_origins_are_allowed() {
        let some = allowed(&["https://Example.org", "http://localhost:8000", "https://a.example:443"]);
        for origin in ["https://example.org", "http://localhost:8000", "https://a.example"] {
            assert_eq!(some.refused(&of(&[origin]), |_| false), None, "{origin}");
        }
        for origin in [
            "http://example.org",
            "https://example.org:8443",
            "https://evil.example",
            "http://localhost",
            "null",
            "",
        ] {
            assert_eq!(some.refused(&of(&[origin]), |_| false), Some(origin.into()));
        }
        assert!(
            some.refused(&of(&["https://example.org", "https://evil.example"]), |_| false).is_some(),
            "one of two"
        );
        assert_eq!(allowed(&["*"]).refused(&of(&["https://evil.example"]), |_| false), None);
    }

    #[test]
    fn malformed_origins_are_refused() {
        for text in [
            "",
            "example.org",
            "https://",
            "https://:443",
            "https://a/b",
            "https://a,b",
            "//a",
            "1s://a",
            "h ttp://a",
            "https://*",
        ] {
            let why = text.parse::<Origin>().unwrap_err().to_string();
            assert!(why.contains("SCHEME://HOST"), "{why}");
        }
    }
}
