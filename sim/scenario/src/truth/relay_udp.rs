//! A real-time relay of UDP datagrams between a client and a server on this machine.
//!
//! The client sends to the relay's address; the relay forwards to the server from a socket of its own, and back.
//! Datagrams are delayed, dropped or lost by the [`Link`] of their direction, the same code as in virtual time. tokio's
//! timers are up to a millisecond late, and so is the relay.

use std::collections::BTreeMap;
use std::io;
use std::net::{Ipv4Addr, SocketAddr};

use lodestream_netsim::clock::VirtualClock;
use lodestream_netsim::link::{Fate, Link, LinkCounters, LinkSettings};
use tokio::net::UdpSocket;
use tokio::sync::oneshot;

/// Largest datagram that IPv4 carries.
const MAX_DATAGRAM_BYTES: usize = 65_507;

/// Buffer for datagrams that arrive while the relay is busy.
const SOCKET_BUFFER_BYTES: usize = 4 << 20;

/// A direction: its link, and the datagrams on their way, by arrival time and order of sending.
struct RelayDirection {
    link: Link,
    arriving: BTreeMap<(u64, u64), Vec<u8>>,
    sent: u64,
}

impl RelayDirection {
    fn new(settings: LinkSettings, seed: u64) -> Self {
        Self { link: Link::new(settings, seed), arriving: BTreeMap::new(), sent: 0 }
    }

    fn offer(&mut self, now_ns: u64, datagram: &[u8]) {
        if let Fate::Arrives { at_ns } = self.link.offer(now_ns, datagram.len()) {
            self.sent += 1;
            self.arriving.insert((at_ns, self.sent), datagram.to_vec());
        }
    }

    /// The next datagram that has arrived.
    fn arrived(&mut self, now_ns: u64) -> Option<Vec<u8>> {
        let first = self.arriving.first_entry()?;
        (first.key().0 <= now_ns).then(|| first.remove())
    }

    fn next_ns(&self) -> Option<u64> {
        self.arriving.first_key_value().map(|(&(at_ns, _), _)| at_ns)
    }
}

/// A relay between one client and one server.
pub struct UdpRelay {
    client_side: UdpSocket,
    server_side: UdpSocket,
    down: RelayDirection,
    up: RelayDirection,
}

/// A socket on loopback with large buffers.
fn socket() -> io::Result<UdpSocket> {
    let socket = socket2::Socket::new(socket2::Domain::IPV4, socket2::Type::DGRAM, None)?;
    // The system may refuse or halve it; a relay that keeps up needs little.
    let _ = socket.set_recv_buffer_size(SOCKET_BUFFER_BYTES);
    socket.set_nonblocking(true)?;
    socket.bind(&SocketAddr::from((Ipv4Addr::LOCALHOST, 0)).into())?;
    UdpSocket::from_std(socket.into())
}

impl UdpRelay {
    /// Opens the sockets. `down` leads from the server to the client; the seeds determine loss and jitter.
    ///
    /// # Errors
    /// Errors of the system.
    pub async fn bind(
        server: SocketAddr,
        [down, up]: [LinkSettings; 2],
        [down_seed, up_seed]: [u64; 2],
    ) -> io::Result<Self> {
        let (client_side, server_side) = (socket()?, socket()?);
        server_side.connect(server).await?;
        Ok(Self {
            client_side,
            server_side,
            down: RelayDirection::new(down, down_seed),
            up: RelayDirection::new(up, up_seed),
        })
    }

    /// The address for clients.
    ///
    /// # Errors
    /// Errors of the system.
    pub fn address(&self) -> io::Result<SocketAddr> {
        self.client_side.local_addr()
    }

    /// Relays until stopped; returns the counters of both links, from server to client first. The client is the last
    /// sender.
    pub async fn run(mut self, mut stop: oneshot::Receiver<()>) -> [LinkCounters; 2] {
        let clock = VirtualClock::start();
        let mut client: Option<SocketAddr> = None;
        let (mut from_client, mut from_server) = (vec![0; MAX_DATAGRAM_BYTES], vec![0; MAX_DATAGRAM_BYTES]);
        loop {
            let now_ns = clock.now_ns();
            while let Some(datagram) = self.up.arrived(now_ns) {
                // A full buffer or a closed port loses the datagram, as a network would.
                let _ = self.server_side.try_send(&datagram);
            }
            while let Some(datagram) = self.down.arrived(now_ns) {
                if let Some(client) = client {
                    let _ = self.client_side.try_send_to(&datagram, client);
                }
            }
            let next_ns = self.up.next_ns().into_iter().chain(self.down.next_ns()).min();
            tokio::select! {
                biased;
                _ = &mut stop => return [self.down.link.counters(), self.up.link.counters()],
                received = self.client_side.recv_from(&mut from_client) => {
                    if let Ok((length, from)) = received {
                        client = Some(from);
                        self.up.offer(clock.now_ns(), &from_client[..length]);
                    }
                }
                received = self.server_side.recv(&mut from_server) => {
                    if let Ok(length) = received {
                        self.down.offer(clock.now_ns(), &from_server[..length]);
                    }
                }
                () = clock.sleep_until(next_ns.unwrap_or(0)), if next_ns.is_some() => {}
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use std::num::NonZeroU64;
    use std::time::{Duration, Instant};

    use super::*;
    use lodestream_netsim::link::{IP_UDP_BYTES, Loss};

    fn settings() -> LinkSettings {
        LinkSettings::constant(NonZeroU64::new(2_000_000).unwrap(), 25_000_000, 64 * 1024, IP_UDP_BYTES)
    }

    fn runtime() -> tokio::runtime::Runtime {
        tokio::runtime::Builder::new_current_thread().enable_all().build().unwrap()
    }

    /// Only lower bounds of time are checked: a machine may be slow, never too fast.
    #[test]
    fn datagrams_pass_both_ways_intact_and_not_too_early() {
        runtime().block_on(async {
            let (server, client) = (socket().unwrap(), socket().unwrap());
            let relay =
                UdpRelay::bind(server.local_addr().unwrap(), [settings(), settings()], [1, 2]).await.unwrap();
            client.connect(relay.address().unwrap()).await.unwrap();
            let (stop, stopped) = oneshot::channel();
            let running = tokio::spawn(relay.run(stopped));
            let start = Instant::now();
            for number in 0..3_u8 {
                client.send(&[number; 972]).await.unwrap();
            }
            // Larger than the link takes.
            client.send(&[9; 1473]).await.unwrap();
            let mut buffer = [0; 2000];
            let mut relay_address = None;
            for number in 0..3_u8 {
                let (length, from) = server.recv_from(&mut buffer).await.unwrap();
                assert!(buffer[..length] == [number; 972]);
                // 1,000 bytes with headers take 4 ms each at 2 Mbit/s, then the delay.
                let least = Duration::from_millis(25 + 4 * (u64::from(number) + 1));
                assert!(start.elapsed() >= least, "{number}: {:?}", start.elapsed());
                relay_address = Some(from);
            }
            server.send_to(b"back", relay_address.unwrap()).await.unwrap();
            let length = client.recv(&mut buffer).await.unwrap();
            assert_eq!(&buffer[..length], b"back");
            assert!(start.elapsed() >= Duration::from_millis(37 + 25));
            stop.send(()).unwrap();
            let [down, up] = running.await.unwrap();
            assert_eq!((down.arrived, up.arrived, up.too_big), (1, 3, 1));
        });
    }

    #[test]
    fn lost_datagrams_do_not_pass() {
        runtime().block_on(async {
            let (server, client) = (socket().unwrap(), socket().unwrap());
            let lossy = LinkSettings { loss: Loss::Random(0.5), ..settings() };
            let relay =
                UdpRelay::bind(server.local_addr().unwrap(), [settings(), lossy], [1, 2]).await.unwrap();
            client.connect(relay.address().unwrap()).await.unwrap();
            let (stop, stopped) = oneshot::channel();
            let running = tokio::spawn(relay.run(stopped));
            for number in 0..40_u8 {
                client.send(&[number]).await.unwrap();
            }
            let mut passed = Vec::new();
            let mut buffer = [0; 10];
            while let Ok(received) =
                tokio::time::timeout(Duration::from_secs(2), server.recv(&mut buffer)).await
            {
                assert_eq!(received.unwrap(), 1);
                passed.push(buffer[0]);
            }
            stop.send(()).unwrap();
            let [_, up] = running.await.unwrap();
            assert_eq!((up.offered, up.arrived), (40, passed.len() as u64));
            assert!((5..=35).contains(&passed.len()) && passed.is_sorted(), "{passed:?}");
        });
    }
}
