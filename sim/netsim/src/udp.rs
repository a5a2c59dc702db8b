//! UDP sockets for quinn over simulated links, in virtual time.
//!
//! Real quinn runs over it unchanged. For runs to repeat exactly, quinn's random numbers must be
//! seeded (`EndpointConfig::rng_seed`), the certificate's key must be of a kind whose signatures
//! have a constant length (Ed25519; those of ECDSA vary), and everything else on the runtime must
//! be deterministic (`select!` biased, no hash order).
//!
//! A [`UdpNetwork`] holds one [`Link`] per ordered pair of addresses, or for several; a [`VirtualUdpSocket`] is what
//! quinn takes for a socket. Datagrams between addresses without a link vanish, as do those to an
//! address without a socket. Sending never blocks: what the link's queue does not hold is dropped,
//! as by a router behind a fast interface. Receive buffers are unlimited, since a receiver on the
//! paused clock reads at once; what is in flight is limited by the links' queues and delays.

use std::collections::BTreeMap;
use std::future::Future;
use std::io::{self, IoSliceMut};
use std::net::SocketAddr;
use std::pin::Pin;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::task::{Context, Poll, Waker};

use quinn::udp::{RecvMeta, Transmit};
use quinn::{AsyncUdpSocket, UdpPoller};
use tokio::time::Sleep;

use crate::clock::VirtualClock;
use crate::link::{Fate, Link, LinkCounters, LinkSettings};
use crate::trace::Trace;

/// A datagram on its way.
#[derive(Debug)]
struct Datagram {
    from: SocketAddr,
    payload: Vec<u8>,
}

/// Datagrams in flight to one address.
#[derive(Debug, Default)]
struct Inbox {
    /// By arrival time, then in the order of sending.
    datagrams: BTreeMap<(u64, u64), Datagram>,
    timer: Option<Pin<Box<Sleep>>>,
    waker: Option<Waker>,
    received_bytes: u64,
    /// The socket was dropped: datagrams that still arrive are discarded.
    closed: bool,
}

#[derive(Debug)]
struct State {
    clock: VirtualClock,
    links: Vec<Link>,
    /// The link from one address to another.
    routes: BTreeMap<(SocketAddr, SocketAddr), usize>,
    inboxes: BTreeMap<SocketAddr, Inbox>,
    sent: u64,
    trace: Trace,
}

/// Sockets and the links between them. Clones are handles of the same network.
#[derive(Clone, Debug)]
pub struct UdpNetwork(Arc<Mutex<State>>);

impl UdpNetwork {
    /// A network without links, whose times count from `clock`'s start.
    #[must_use]
    pub fn new(clock: VirtualClock) -> Self {
        Self(Arc::new(Mutex::new(State {
            clock,
            links: Vec::new(),
            routes: BTreeMap::new(),
            inboxes: BTreeMap::new(),
            sent: 0,
            trace: Trace::default(),
        })))
    }

    /// Adds (or replaces) the link that leads from one address to another.
    pub fn connect(&self, from: SocketAddr, to: SocketAddr, settings: LinkSettings, seed: u64) {
        let mut state = self.state();
        let link = Link::new(settings, seed);
        match state.routes.get(&(from, to)).copied() {
            Some(place) => state.links[place] = link,
            None => {
                let place = state.links.len();
                state.links.push(link);
                state.routes.insert((from, to), place);
            }
        }
    }

    /// Routes datagrams between two addresses through the link of another pair, including its queue. Without such a
    /// link nothing changes.
    pub fn share(&self, from: SocketAddr, to: SocketAddr, link: (SocketAddr, SocketAddr)) {
        let mut state = self.state();
        if let Some(place) = state.routes.get(&link).copied() {
            state.routes.insert((from, to), place);
        }
    }

    /// Opens a socket. It receives until it is dropped.
    #[must_use]
    pub fn socket(&self, address: SocketAddr) -> Arc<VirtualUdpSocket> {
        self.state().inboxes.insert(address, Inbox::default());
        Arc::new(VirtualUdpSocket { network: self.clone(), address })
    }

    /// A quinn endpoint on a new socket, a server if it has a server configuration. Its random numbers, which affect
    /// packet lengths and timers, follow from the seed.
    ///
    /// # Errors
    /// Errors of quinn.
    pub fn endpoint(
        &self,
        address: SocketAddr,
        server: Option<quinn::ServerConfig>,
        seed: [u8; 32],
    ) -> io::Result<quinn::Endpoint> {
        let mut config = quinn::EndpointConfig::default();
        config.rng_seed(Some(seed));
        let runtime = Arc::new(quinn::TokioRuntime);
        quinn::Endpoint::new_with_abstract_socket(config, server, self.socket(address), runtime)
    }

    /// Counters of the link between two addresses; zeros without a link.
    #[must_use]
    pub fn counters(&self, from: SocketAddr, to: SocketAddr) -> LinkCounters {
        let state = self.state();
        let link = state.routes.get(&(from, to)).map(|place| &state.links[*place]);
        link.map_or_else(LinkCounters::default, Link::counters)
    }

    /// Payload of the datagrams delivered to the socket at `address` so far.
    #[must_use]
    pub fn received_bytes(&self, address: SocketAddr) -> u64 {
        self.state().inboxes.get(&address).map_or(0, |inbox| inbox.received_bytes)
    }

    /// Fingerprint of time, size, direction and fate of every datagram so far.
    #[must_use]
    pub fn trace(&self) -> u64 {
        self.state().trace.value()
    }

    fn state(&self) -> MutexGuard<'_, State> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl State {
    fn send(&mut self, from: SocketAddr, to: SocketAddr, payload: &[u8]) {
        let now_ns = self.clock.now_ns();
        let Some(place) = self.routes.get(&(from, to)) else { return };
        let link = &mut self.links[*place];
        let fate = link.offer(now_ns, payload.len());
        self.sent += 1;
        self.trace.add(now_ns);
        self.trace.add(payload.len() as u64);
        self.trace.add(u64::from(from.port()) << 16 | u64::from(to.port()));
        let at_ns = match fate {
            Fate::Arrives { at_ns } => at_ns,
            Fate::Lost | Fate::QueueFull | Fate::TooBig => {
                self.trace.add(u64::MAX);
                return;
            }
        };
        self.trace.add(at_ns);
        if let Some(inbox) = self.inboxes.get_mut(&to).filter(|inbox| !inbox.closed) {
            inbox.datagrams.insert((at_ns, self.sent), Datagram { from, payload: payload.to_vec() });
            if let Some(waker) = inbox.waker.take() {
                waker.wake();
            }
        }
    }
}

/// A UDP socket of a [`UdpNetwork`].
#[derive(Debug)]
pub struct VirtualUdpSocket {
    network: UdpNetwork,
    address: SocketAddr,
}

impl Drop for VirtualUdpSocket {
    fn drop(&mut self) {
        let mut state = self.network.state();
        if let Some(inbox) = state.inboxes.get_mut(&self.address) {
            // The count stays readable.
            *inbox = Inbox { received_bytes: inbox.received_bytes, closed: true, ..Inbox::default() };
        }
    }
}

/// A link's queue drops instead of blocking, so writing is always possible.
#[derive(Debug)]
struct AlwaysWritable;

impl UdpPoller for AlwaysWritable {
    fn poll_writable(self: Pin<&mut Self>, _context: &mut Context<'_>) -> Poll<io::Result<()>> {
        Poll::Ready(Ok(()))
    }
}

impl AsyncUdpSocket for VirtualUdpSocket {
    fn create_io_poller(self: Arc<Self>) -> Pin<Box<dyn UdpPoller>> {
        Box::pin(AlwaysWritable)
    }

    fn try_send(&self, transmit: &Transmit<'_>) -> io::Result<()> {
        let segment = transmit.segment_size.unwrap_or(transmit.contents.len()).max(1);
        let mut state = self.network.state();
        for datagram in transmit.contents.chunks(segment) {
            state.send(self.address, transmit.destination, datagram);
        }
        Ok(())
    }

    fn poll_recv(
        &self,
        context: &mut Context<'_>,
        buffers: &mut [IoSliceMut<'_>],
        meta: &mut [RecvMeta],
    ) -> Poll<io::Result<usize>> {
        let mut state = self.network.state();
        let clock = state.clock;
        let Some(inbox) = state.inboxes.get_mut(&self.address) else {
            return Poll::Ready(Err(io::ErrorKind::NotConnected.into()));
        };
        loop {
            let now_ns = clock.now_ns();
            let mut count = 0;
            for (buffer, meta) in buffers.iter_mut().zip(meta.iter_mut()) {
                let Some(first) = inbox.datagrams.first_entry() else { break };
                if first.key().0 > now_ns {
                    break;
                }
                let datagram = first.remove();
                // As recv() does: excess bytes are cut off.
                let length = datagram.payload.len().min(buffer.len());
                buffer[..length].copy_from_slice(&datagram.payload[..length]);
                *meta = RecvMeta::default();
                meta.addr = datagram.from;
                meta.len = length;
                meta.stride = length;
                inbox.received_bytes += length as u64;
                count += 1;
            }
            if count > 0 {
                return Poll::Ready(Ok(count));
            }
            inbox.waker = Some(context.waker().clone());
            let Some((&(at_ns, _), _)) = inbox.datagrams.first_key_value() else {
                inbox.timer = None;
                return Poll::Pending;
            };
            let deadline = clock.instant(at_ns);
            let timer = inbox.timer.get_or_insert_with(|| Box::pin(clock.sleep_until(at_ns)));
            if timer.deadline() != deadline {
                timer.as_mut().reset(deadline);
            }
            if timer.as_mut().poll(context).is_pending() {
                return Poll::Pending;
            }
            inbox.timer = None;
        }
    }

    fn local_addr(&self) -> io::Result<SocketAddr> {
        Ok(self.address)
    }

    fn may_fragment(&self) -> bool {
        false
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::clock::virtual_runtime;
    use crate::link::{IP_UDP_BYTES, Jitter, Loss};
    use std::num::NonZeroU64;

    fn settings(loss: f64) -> LinkSettings {
        LinkSettings {
            loss: Loss::Random(loss),
            ..LinkSettings::constant(NonZeroU64::new(2_000_000).unwrap(), 25_000_000, 64 * 1024, IP_UDP_BYTES)
        }
    }

    fn address(host: u8) -> SocketAddr {
        SocketAddr::from(([10, 0, 0, host], 4433))
    }

    async fn receive(socket: &VirtualUdpSocket) -> (SocketAddr, Vec<u8>) {
        let mut buffer = vec![0; 2000];
        let mut meta = [RecvMeta::default()];
        std::future::poll_fn(|context| {
            socket.poll_recv(context, &mut [IoSliceMut::new(&mut buffer)], &mut meta)
        })
        .await
        .unwrap();
        (meta[0].addr, buffer[..meta[0].len].to_vec())
    }

    fn send(socket: &VirtualUdpSocket, to: SocketAddr, contents: &[u8], segment_size: Option<usize>) {
        let transmit = Transmit { destination: to, ecn: None, contents, segment_size, src_ip: None };
        socket.try_send(&transmit).unwrap();
    }

    #[test]
    fn datagrams_arrive_in_virtual_time() {
        virtual_runtime().unwrap().block_on(async {
            let clock = VirtualClock::start();
            let network = UdpNetwork::new(clock);
            network.connect(address(1), address(2), settings(0.0), 1);
            let (a, b) = (network.socket(address(1)), network.socket(address(2)));
            let receiver = tokio::spawn(async move {
                let mut arrivals = Vec::new();
                for _ in 0..3 {
                    let (from, payload) = receive(&b).await;
                    assert_eq!(from, address(1));
                    arrivals.push((clock.now_ns(), payload.len()));
                }
                arrivals
            });
            tokio::task::yield_now().await;
            // Three datagrams of 1,000 bytes with headers, 4 ms each at 2 Mbit/s.
            send(&a, address(2), &[7; 3 * 972], Some(972));
            send(&a, address(9), b"nobody listens there", None);
            let ms = 1_000_000;
            assert_eq!(receiver.await.unwrap(), [(29 * ms, 972), (33 * ms, 972), (37 * ms, 972)]);
            assert_eq!(network.counters(address(1), address(2)).arrived, 3);
        });
    }

    #[test]
    fn directions_and_their_jitter_are_independent() {
        virtual_runtime().unwrap().block_on(async {
            let clock = VirtualClock::start();
            let network = UdpNetwork::new(clock);
            let jitter = Jitter { largest_ns: 40_000_000, reorders: true };
            let down = LinkSettings { jitter, mtu_bytes: 600, ..settings(0.0) };
            network.connect(address(1), address(2), down, 1);
            network.connect(address(2), address(1), settings(0.0), 2);
            let (a, b) = (network.socket(address(1)), network.socket(address(2)));
            // 20 numbered packets down, one too large for that way; the same one passes up.
            for number in 0..20 {
                send(&a, address(2), &[number; 22], None);
            }
            send(&a, address(2), &[99; 600], None);
            send(&b, address(1), &[99; 600], None);
            assert_eq!(receive(&a).await.1.len(), 600);
            // 628 bytes at 4 µs, and the delay; timers are up to 1 ms late.
            assert!((27_512_000..=28_512_000).contains(&clock.now_ns()), "{}", clock.now_ns());
            let mut order = Vec::new();
            for _ in 0..20 {
                order.push(receive(&b).await.1[0]);
            }
            assert!(!order.is_sorted(), "{order:?}");
            order.sort_unstable();
            assert_eq!(order, (0..20).collect::<Vec<u8>>());
            assert_eq!(network.counters(address(1), address(2)).too_big, 1);
            assert_eq!(network.counters(address(2), address(1)).too_big, 0);
        });
    }

    #[test]
    fn datagrams_to_a_closed_socket_vanish() {
        virtual_runtime().unwrap().block_on(async {
            let network = UdpNetwork::new(VirtualClock::start());
            network.connect(address(1), address(2), settings(0.0), 1);
            let (a, b) = (network.socket(address(1)), network.socket(address(2)));
            send(&a, address(2), b"one", None);
            assert_eq!(receive(&b).await.1, b"one");
            send(&a, address(2), b"two", None);
            drop(b);
            send(&a, address(2), b"three", None);
            assert_eq!(network.received_bytes(address(2)), 3);
            assert!(network.state().inboxes[&address(2)].datagrams.is_empty());
        });
    }
}
