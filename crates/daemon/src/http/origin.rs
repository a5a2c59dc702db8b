//! Check of the `Origin` header. Browsers let any page open a WebSocket to any reachable address, including a server on
//! the same machine, and send the page's origin (RFC 6455, section 10.2). Other programs send no origin.

use std::borrow::Cow;
use std::collections::BTreeSet;
use std::str::FromStr;

use hyper::header::{self, HeaderMap};

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
    /// The first origin in a request's headers that is not allowed, as it was sent.
    pub(crate) fn refused(&self, headers: &HeaderMap) -> Option<String> {
        let any = || self.0.contains(&Origin("*".into()));
        let mut sent =
            headers.get_all(header::ORIGIN).iter().map(|value| String::from_utf8_lossy(value.as_bytes()));
        let refused = sent.find(|sent| !(self.0.contains(&Origin(sent.to_ascii_lowercase())) || any()));
        refused.map(Cow::into_owned)
    }
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
    fn a_request_without_an_origin_is_allowed() {
        assert_eq!(allowed(&[]).refused(&of(&[])), None);
    }

    #[test]
    fn only_listed_origins_are_allowed() {
        let some = allowed(&["https://Example.org", "http://localhost:8000", "https://a.example:443"]);
        for origin in ["https://example.org", "http://localhost:8000", "https://a.example"] {
            assert_eq!(some.refused(&of(&[origin])), None, "{origin}");
        }
        for origin in [
            "http://example.org",
            "https://example.org:8443",
            "https://evil.example",
            "http://localhost",
            "null",
            "",
        ] {
            assert_eq!(some.refused(&of(&[origin])), Some(origin.into()));
        }
        assert!(some.refused(&of(&["https://example.org", "https://evil.example"])).is_some(), "one of two");
        assert_eq!(allowed(&["*"]).refused(&of(&["https://evil.example"])), None);
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
