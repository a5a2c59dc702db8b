//! Under which addresses others reach a socket of this machine.

use std::net::{IpAddr, Ipv4Addr, Ipv6Addr, SocketAddr, UdpSocket};

/// Somewhere that is not here: networks for documentation (RFC 5737, RFC 3849), for which the way out is the default one.
const ELSEWHERE_V4: IpAddr = IpAddr::V4(Ipv4Addr::new(192, 0, 2, 1));
const ELSEWHERE_V6: IpAddr = IpAddr::V6(Ipv6Addr::new(0x2001, 0xdb8, 0, 0, 0, 0, 0, 1));
/// Any port, where nothing is sent to.
const PORT: u16 = 9;

/// Addresses that can be connected to: where the socket listens on all, those of this machine by which it reaches others,
/// or loopback where it has no way out.
pub(crate) fn advertised_addresses(address: SocketAddr) -> Vec<SocketAddr> {
    expand(address, own_address)
}

fn expand(address: SocketAddr, own: impl Fn(IpAddr) -> Option<IpAddr>) -> Vec<SocketAddr> {
    let at = |ip| SocketAddr::new(ip, address.port());
    let (ways, loopback): (&[IpAddr], IpAddr) = match address.ip() {
        IpAddr::V4(ip) if ip.is_unspecified() => (&[ELSEWHERE_V4], Ipv4Addr::LOCALHOST.into()),
        // It takes IPv4 too.
        IpAddr::V6(ip) if ip.is_unspecified() => (&[ELSEWHERE_V6, ELSEWHERE_V4], Ipv6Addr::LOCALHOST.into()),
        ip => return vec![at(ip)],
    };
    let found: Vec<_> = ways.iter().filter_map(|way| own(*way)).map(at).collect();
    if found.is_empty() { vec![at(loopback)] } else { found }
}

/// The address that this machine has towards another. To connect a datagram socket chooses a route and sends nothing.
fn own_address(towards: IpAddr) -> Option<IpAddr> {
    let any: IpAddr = match towards {
        IpAddr::V4(_) => Ipv4Addr::UNSPECIFIED.into(),
        IpAddr::V6(_) => Ipv6Addr::UNSPECIFIED.into(),
    };
    let socket = UdpSocket::bind((any, 0)).ok()?;
    socket.connect((towards, PORT)).ok()?;
    let ip = socket.local_addr().ok()?.ip();
    // An address of one link is none without saying which.
    let of_link = matches!(ip, IpAddr::V6(ip) if ip.is_unicast_link_local());
    (!ip.is_unspecified() && !of_link).then_some(ip)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn shown(address: &str, own: impl Fn(IpAddr) -> Option<IpAddr>) -> String {
        let all = expand(address.parse().unwrap(), own);
        all.iter().map(ToString::to_string).collect::<Vec<_>>().join(" ")
    }

    #[test]
    fn an_address_of_all_was_printed_as_loopback_which_is_of_use_to_nobody_else() {
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
    fn this_machine_has_addresses_that_are_some() {
        for address in ["0.0.0.0:1", "[::]:1"] {
            let found = advertised_addresses(address.parse().unwrap());
            assert!(!found.is_empty() && found.iter().all(|found| !found.ip().is_unspecified()), "{found:?}");
        }
    }
}
