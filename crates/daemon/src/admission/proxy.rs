//! For whom a proxy asks. Behind a proxy every client has the proxy's address; the proxy says in `X-Forwarded-For` whose
//! request it hands on. Anybody can write that field, so it is believed of the proxies alone that the operator names.

use std::net::{IpAddr, SocketAddr};
use std::str::FromStr;

use hyper::header::HeaderMap;
use ipnet::IpNet;

/// What proxies add their clients' addresses to, the nearest one last.
const FORWARDED_FOR: &str = "x-forwarded-for";

/// A network of addresses in CIDR notation, such as `10.0.0.0/8` or `2001:db8::/32`, or one address.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Network(IpNet);

impl FromStr for Network {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let text = text.trim();
        let network = text.parse::<IpNet>().ok().or_else(|| text.parse::<IpAddr>().ok().map(IpNet::from));
        network.map(|network| Self(network.trunc())).ok_or_else(|| {
            format!("{text:?} is no network: write for example 10.0.0.0/8, 2001:db8::/32 or 127.0.0.1")
        })
    }
}

/// The proxies that are believed; by default none.
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

    /// Who asks, when `peer` sends a request with these header fields: the nearest address that is no trusted proxy's.
    /// What stands before that, or behind what is no address, anybody may have written.
    pub(crate) fn client(&self, peer: SocketAddr, headers: &HeaderMap) -> SocketAddr {
        let mut client = peer;
        let fields = headers.get_all(FORWARDED_FOR).iter().rev();
        // A value that is no text ends the search, as an empty one does.
        let mut hops = fields.flat_map(|value| value.to_str().unwrap_or("").rsplit(','));
        while self.trusts(client.ip())
            && let Some(hop) = hops.next().and_then(hop)
        {
            client = hop;
        }
        client
    }
}

/// An address, with or without a port.
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
    fn a_untrusted_peer_could_say_that_he_is_somebody_else() {
        assert_eq!(client(&trusted(&[]), "198.51.100.7", &[b"203.0.113.1"]), "198.51.100.7");
        assert_eq!(client(&trusted(&["10.0.0.0/8"]), "198.51.100.7", &[b"203.0.113.1"]), "198.51.100.7");
        // What a client made up stands before what the proxy added.
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
    fn trusted_proxies_are_believed_one_after_the_other() {
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
        // All the way up: the first that spoke.
        assert_eq!(client(&two, "10.0.0.9", &[b"10.0.0.7, 10.0.0.8"]), "10.0.0.7");
        assert_eq!(client(&two, "10.0.0.9", &[]), "10.0.0.9");
    }

    #[test]
    fn what_is_no_address_is_as_far_as_a_proxy_is_believed() {
        let one = trusted(&["10.0.0.0/8"]);
        for field in
            [&b"unknown"[..], b"", b"203.0.113.1, ", b"203.0.113.1, _hidden", b"203.0.113.1;", b"\xff"]
        {
            assert_eq!(client(&one, "10.0.0.9", &[field]), "10.0.0.9", "{field:?}");
        }
        assert_eq!(client(&one, "10.0.0.9", &[b"203.0.113.1, nonsense, 10.0.0.8"]), "10.0.0.8");
    }

    #[test]
    fn what_is_no_network_is_said_so() {
        for text in ["", "10.0.0.0/33", "example.org", "10.0.0.0/8/8", "10.0.0.0-10.0.0.9"] {
            assert!(text.parse::<Network>().unwrap_err().contains("10.0.0.0/8"), "{text}");
        }
        assert_eq!("10.1.2.3/8".parse::<Network>(), "10.0.0.0/8".parse());
    }
}
