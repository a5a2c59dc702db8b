//! Addresses of clients behind proxies. Every client of a proxy has the proxy's address; the proxy adds the client's to
//! `X-Forwarded-For`. Any client can send that header, so only entries added by trusted proxies count.

use std::net::{IpAddr, SocketAddr};
use std::str::FromStr;

use hyper::header::HeaderMap;
use ipnet::IpNet;

use crate::limits::invalid_setting::InvalidSetting;

/// Header to which each proxy appends its client's address.
const FORWARDED_FOR: &str = "x-forwarded-for";

/// A network of addresses in CIDR notation, such as `10.0.0.0/8` or `2001:db8::/32`, or one address.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Network(IpNet);

impl FromStr for Network {
    type Err = InvalidSetting;

    fn from_str(text: &str) -> Result<Self, InvalidSetting> {
        let text = text.trim();
        let network = text.parse::<IpNet>().ok().or_else(|| text.parse::<IpAddr>().ok().map(IpNet::from));
        let example = "for example 10.0.0.0/8, 2001:db8::/32 or 127.0.0.1";
        let expected = || InvalidSetting::new(text, "a network", example);
        network.map(|network| Self(network.trunc())).ok_or_else(expected)
    }
}

/// Proxies whose `X-Forwarded-For` is trusted; by default none.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct TrustedProxies(Vec<Network>);

impl FromIterator<Network> for TrustedProxies {
    fn from_iter<I: IntoIterator<Item = Network>>(networks: I) -> Self {
        Self(networks.into_iter().collect())
    }
}

impl TrustedProxies {
    fn trusts(&self, address: IpAddr) -> bool {
        let address = address.to_canonical();
        self.0.iter().any(|network| network.0.contains(&address))
    }

    /// Address of the client that sent a request through `peer`: the last address in the chain that is not a trusted
    /// proxy's. Entries before that, or before a malformed one, may be forged.
    pub(crate) fn client(&self, peer: SocketAddr, headers: &HeaderMap) -> SocketAddr {
        let mut client = peer;
        let fields = headers.get_all(FORWARDED_FOR).iter().rev();
        // A value that is not text ends the search, as an empty one does.
        let mut hops = fields.flat_map(|value| value.to_str().unwrap_or("").rsplit(','));
        while self.trusts(client.ip())
            && let Some(hop) = hops.next().and_then(hop)
        {
            client = hop;
        }
        client
    }
}

/// Parses an address, with or without a port.
fn hop(text: &str) -> Option<SocketAddr> {
    let text = text.trim();
    let bare = text.strip_prefix('[').and_then(|text| text.strip_suffix(']')).unwrap_or(text);
    text.parse().ok().or_else(|| bare.parse::<IpAddr>().ok().map(|ip| SocketAddr::new(ip, 0)))
}

#[cfg(test)]
mod tests {
    use hyper::header::HeaderValue;

    use super::*;

    fn trusted(networks: &[&str]) -> TrustedProxies {
        networks.iter().map(|network| network.parse::<Network>().unwrap()).collect()
    }

    fn client(trusted: &TrustedProxies, peer: &str, fields: &[&[u8]]) -> String {
        let mut headers = HeaderMap::new();
        for field in fields {
            headers.append(FORWARDED_FOR, HeaderValue::from_bytes(field).unwrap());
        }
        trusted.client(SocketAddr::new(peer.parse().unwrap(), 9), &headers).ip().to_string()
    }

    #[test]
    fn forwarded_addresses_of_untrusted_peers_are_ignored() {
        assert_eq!(client(&trusted(&[]), "198.51.100.7", &[b"203.0.113.1"]), "198.51.100.7");
        assert_eq!(client(&trusted(&["10.0.0.0/8"]), "198.51.100.7", &[b"203.0.113.1"]), "198.51.100.7");
        // A forged entry stands before the one that the proxy appended.
        assert_eq!(
            client(&trusted(&["10.0.0.0/8"]), "10.1.2.3", &[b"203.0.113.1, 198.51.100.7"]),
            "198.51.100.7"
        );
        assert_eq!(
            client(&trusted(&["10.0.0.0/8"]), "10.1.2.3", &[b"10.0.0.1", b"198.51.100.7"]),
            "198.51.100.7"
        );
    }

    #[test]
    fn a_chain_of_trusted_proxies_is_followed() {
        let two = trusted(&["10.0.0.0/8", "2001:db8::1"]);
        assert_eq!(client(&two, "10.0.0.9", &[b"203.0.113.1"]), "203.0.113.1");
        assert_eq!(client(&two, "2001:db8::1", &[b"203.0.113.1, 10.7.7.7"]), "203.0.113.1");
        assert_eq!(client(&two, "10.0.0.9", &[b"203.0.113.1", b"10.7.7.7"]), "203.0.113.1");
        assert_eq!(
            client(&two, "::ffff:10.0.0.9", &[b"203.0.113.1:1234"]),
            "203.0.113.1",
            "mapped, and with a port"
        );
        assert_eq!(client(&two, "10.0.0.9", &[b"[2001:db8::2]:443"]), "2001:db8::2");
        assert_eq!(client(&two, "10.0.0.9", &[b"2001:db8::2"]), "2001:db8::2");
        // All are trusted: the first.
        assert_eq!(client(&two, "10.0.0.9", &[b"10.0.0.7, 10.0.0.8"]), "10.0.0.7");
        assert_eq!(client(&two, "10.0.0.9", &[]), "10.0.0.9");
    }

    #[test]
    fn a_malformed_entry_ends_the_chain() {
        let one = trusted(&["10.0.0.0/8"]);
        for field in
            [&b"unknown"[..], b"", b"203.0.113.1, ", b"203.0.113.1, _hidden", b"203.0.113.1;", b"\xff"]
        {
            assert_eq!(client(&one, "10.0.0.9", &[field]), "10.0.0.9", "{field:?}");
        }
        assert_eq!(client(&one, "10.0.0.9", &[b"203.0.113.1, nonsense, 10.0.0.8"]), "10.0.0.8");
    }

    #[test]
    fn malformed_networks_are_refused() {
        for text in ["", "10.0.0.0/33", "example.org", "10.0.0.0/8/8", "10.0.0.0-10.0.0.9"] {
            assert!(text.parse::<Network>().unwrap_err().to_string().contains("10.0.0.0/8"), "{text}");
        }
        assert_eq!("10.1.2.3/8".parse::<Network>(), "10.0.0.0/8".parse());
    }
}
