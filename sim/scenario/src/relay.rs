//! A link in real time for programs that this project does not drive, such as browsers and web servers: a relay of TCP
//! connections that share a rate and have a round trip.
//!
//! Loopback's TCP ends at the relay, so slow start, loss and congestion are not modelled; the handshake's round trip is.
//! [`crate::truth`] relays one connection over the modelled TCP instead.

use std::io;
use std::net::SocketAddr;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use tokio::io::{AsyncReadExt as _, AsyncWriteExt as _};
use tokio::net::tcp::{OwnedReadHalf, OwnedWriteHalf};
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::mpsc;
use tokio::time::{Instant, sleep_until};

/// Payload of a segment.
const SEGMENT_BYTES: usize = 1448;
/// Headers of a segment: IP, TCP with timestamps.
const HEADER_BYTES: usize = 52;
/// Segments under way per connection and direction.
const MAX_UNDER_WAY: usize = 4096;

/// Rate and delay of one direction of the link.
#[derive(Clone, Copy, Debug)]
pub struct RelayLink {
    /// Bits per second from the server to clients. The way back has no limit: requests are small.
    pub rate_bits_per_s: u64,
    /// Round trip.
    pub round_trip: Duration,
    /// Bytes that wait for the link before senders must wait.
    pub queue_bytes: u64,
}

/// The direction from the server, which all connections share.
#[derive(Debug)]
struct Bottleneck {
    link: RelayLink,
    busy_until: Mutex<Instant>,
}

impl Bottleneck {
    /// Puts a segment on the link; gives when it has passed, and when the queue has room again.
    fn pass(&self, bytes: usize) -> (Instant, Instant) {
        let seconds =
            |bytes: u64| Duration::from_secs_f64(bytes as f64 * 8.0 / self.link.rate_bits_per_s as f64);
        let mut busy = self.busy_until.lock().unwrap_or_else(PoisonError::into_inner);
        let passed = (*busy).max(Instant::now()) + seconds((bytes + HEADER_BYTES) as u64);
        *busy = passed;
        let room = passed.checked_sub(seconds(self.link.queue_bytes)).unwrap_or(passed);
        (passed, room)
    }
}

/// Relays all connections to `listener` to a server, until the task is dropped.
///
/// # Errors
/// A listener that fails.
pub async fn relay(listener: TcpListener, server: SocketAddr, link: RelayLink) -> io::Result<()> {
    let bottleneck = Arc::new(Bottleneck { link, busy_until: Mutex::new(Instant::now()) });
    loop {
        let (client, _) = listener.accept().await?;
        tokio::spawn(carry(client, server, Arc::clone(&bottleneck)));
    }
}

async fn carry(client: TcpStream, server: SocketAddr, bottleneck: Arc<Bottleneck>) {
    let half = bottleneck.link.round_trip / 2;
    // The client sends its first bytes a round trip after its SYN, and they take half of one.
    let opened = Instant::now() + 2 * half;
    sleep_until(opened).await;
    let Ok(server) = TcpStream::connect(server).await else { return };
    let _ = (client.set_nodelay(true), server.set_nodelay(true));
    let (client_read, client_write) = client.into_split();
    let (server_read, server_write) = server.into_split();
    let up = one_way(client_read, server_write, |_| (Instant::now() + half, Instant::now()));
    let down = one_way(server_read, client_write, |bytes| {
        let (passed, room) = bottleneck.pass(bytes);
        (passed + half, room)
    });
    tokio::join!(up, down);
}

/// Carries one direction: `send` tells when a segment arrives, and when the next may be read.
async fn one_way(mut from: OwnedReadHalf, to: OwnedWriteHalf, send: impl Fn(usize) -> (Instant, Instant)) {
    let (segments, arriving) = mpsc::channel(MAX_UNDER_WAY);
    let deliver = deliver(to, arriving);
    let read = async move {
        let mut segment = vec![0; SEGMENT_BYTES];
        while let Ok(length @ 1..) = from.read(&mut segment).await {
            let (arrives, room) = send(length);
            if segments.send((arrives, segment[..length].to_vec())).await.is_err() {
                break;
            }
            sleep_until(room).await;
        }
    };
    tokio::join!(read, deliver);
}

async fn deliver(mut to: OwnedWriteHalf, mut arriving: mpsc::Receiver<(Instant, Vec<u8>)>) {
    while let Some((at, bytes)) = arriving.recv().await {
        sleep_until(at).await;
        if to.write_all(&bytes).await.is_err() {
            return;
        }
    }
    let _ = to.shutdown().await;
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn segments_share_the_rate() {
        tokio::runtime::Builder::new_current_thread()
            .enable_time()
            .start_paused(true)
            .build()
            .unwrap()
            .block_on(async {
                let link = RelayLink {
                    rate_bits_per_s: 1_000_000,
                    round_trip: Duration::from_millis(50),
                    queue_bytes: 15_000,
                };
                let start = Instant::now();
                let bottleneck = Bottleneck { link, busy_until: Mutex::new(start) };
                let mut last = (start, start);
                for _ in 0..100 {
                    last = bottleneck.pass(SEGMENT_BYTES);
                }
                // 150,000 bytes take 1.2 s, and 15,000 of them may wait.
                assert_eq!(last.0 - start, Duration::from_millis(1200));
                assert_eq!(last.1 - start, Duration::from_millis(1080));
            });
    }

    #[tokio::test]
    async fn connections_are_carried_both_ways_to_their_end() {
        let server = TcpListener::bind("127.0.0.1:0").await.unwrap();
        let to = server.local_addr().unwrap();
        let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
        let at = listener.local_addr().unwrap();
        let link = RelayLink {
            rate_bits_per_s: 80_000_000,
            round_trip: Duration::from_millis(2),
            queue_bytes: 65_536,
        };
        let relaying = tokio::spawn(relay(listener, to, link));
        let mut client = TcpStream::connect(at).await.unwrap();
        client.write_all(b"hello").await.unwrap();
        let (mut served, _) = server.accept().await.unwrap();
        let mut asked = [0; 5];
        served.read_exact(&mut asked).await.unwrap();
        served.write_all(&[7; 100_000]).await.unwrap();
        drop(served);
        let mut answer = Vec::new();
        client.read_to_end(&mut answer).await.unwrap();
        assert_eq!((&asked, answer.len()), (b"hello", 100_000));
        relaying.abort();
    }
}
