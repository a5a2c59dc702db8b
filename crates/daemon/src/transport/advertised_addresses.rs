//! Addresses under which other machines reach a socket of this machine.

use std::net::{IpAddr, Ipv4Addr, Ipv6Addr, SocketAddr, UdpSocket};

/// Remote addresses, from the networks for documentation (RFC 5737, RFC 3849): they are reached by the default route.
const REMOTE_V4: IpAddr = IpAddr::V4(Ipv4Addr::new(192, 0, 2, 1));
const REMOTE_V6: IpAddr = IpAddr::V6(Ipv6Addr::new(0x2001, 0xdb8, 0, 0, 0, 0, 0, 1));
/// Any port; nothing is sent to it.
const PORT: u16 = 9;

/// Addresses to which clients can connect. For a socket bound to all addresses, these are the ones that this machine uses
/// towards other networks, or loopback if it has no route.
pub(crate) fn advertised_addresses(address: SocketAddr) -> Vec<SocketAddr> {
    expand(address, local_address)
}

fn expand(address: SocketAddr, own: impl Fn(IpAddr) -> Option<IpAddr>) -> Vec<SocketAddr> {
    let at = |ip| SocketAddr::new(ip, address.port());
    let (remotes, loopback): (&[IpAddr], IpAddr) = match address.ip() {
        IpAddr::V4(ip) if ip.is_unspecified() => (&[REMOTE_V4], Ipv4Addr::LOCALHOST.into()),
        // The socket accepts IPv4 too.
        IpAddr::V6(ip) if ip.is_unspecified() => (&[REMOTE_V6, REMOTE_V4], Ipv6Addr::LOCALHOST.into()),
        ip => return vec![at(ip)],
    };
    let found: Vec<_> = remotes.iter().filter_map(|remote| own(*remote)).map(at).collect();
    if found.is_empty() { vec![at(loopback)] } else { found }
}

/// This machine's address towards another. Connecting a datagram socket chooses a route and sends nothing.
fn local_address(remote: IpAddr) -> Option<IpAddr> {
    let any: IpAddr = match remote {
        IpAddr::V4(_) => Ipv4Addr::UNSPECIFIED.into(),
        IpAddr::V6(_) => Ipv6Addr::UNSPECIFIED.into(),
    };
    let socket = UdpSocket::bind((any, 0)).ok()?;
    socket.connect((remote, PORT)).ok()?;
    let ip = socket.local_addr().ok()?.ip();
    // A link-local address is incomplete without its interface.
    let link_local = matches!(ip, IpAddr::V6(ip) if ip.is_unicast_link_local());
    (!ip.is_unspecified() && !link_local).then_some(ip)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn shown(address: &str, own: impl Fn(IpAddr) -> Option<IpAddr>) -> String {
        let all = expand(address.parse().unwrap(), own);
        all.iter().map(ToString::to_string).collect::<Vec<_>>().join(" ")
    }

    #[test]
    fn an_unspecified_address_is_printed_as_the_machines_addresses() {
        let both = |towards: IpAddr| {
            Some(if towards.is_ipv4() {
                "10.0.0.7".parse().unwrap()
            } else {
                "2001:db8:7::7".parse().unwrap()
            })
        };
        assert_eq!(shown("0.0.0.0:4433", both), "10.0.0.7:4433");
        assert_eq!(shown("[::]:4433", both), "[2001:db8:7::7]:4433 10.0.0.7:4433");
        assert_eq!(shown("[::]:4433", |towards| both(towards).filter(IpAddr::is_ipv4)), "10.0.0.7:4433");
        assert_eq!(shown("0.0.0.0:4433", |_| None), "127.0.0.1:4433");
        assert_eq!(shown("[::]:4433", |_| None), "[::1]:4433");
        assert_eq!(shown("127.0.0.1:4433", both), "127.0.0.1:4433");
    }

    #[test]
    fn unspecified_addresses_are_expanded_on_this_machine() {
        for address in ["0.0.0.0:1", "[::]:1"] {
            let found = advertised_addresses(address.parse().unwrap());
            assert!(!found.is_empty() && found.iter().all(|found| !found.ip().is_unspecified()), "{found:?}");
        }
    }
}
