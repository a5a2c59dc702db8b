//! A real-time relay of TCP connections between clients and a server on this machine.
//!
//! Loopback's TCP has neither delay nor congestion, so the relay terminates it on both sides and carries the bytes
//! through the simulator's TCP ([`lodestream_netsim::stream_pipe`]) in real time: handshake, slow start, rate, delay
//! and queue are those of virtual time. The buffers of the real sockets take bytes from a server before the modelled
//! sender would, so the relay requests small ones.

use std::io;
use std::net::{Ipv4Addr, SocketAddr};

use lodestream_netsim::clock::VirtualClock;
use lodestream_netsim::link::LinkSettings;
use lodestream_netsim::stream_pipe::{self, Opening, StreamEnd};
use tokio::io::{AsyncReadExt, AsyncWriteExt, ReadHalf, WriteHalf};
use tokio::net::{TcpListener, TcpSocket, TcpStream};

/// Buffer size of the relay's sockets. The system may double it.
const SOCKET_BUFFER_BYTES: u32 = 16 * 1024;
/// Bytes carried at a time.
const PIECE_BYTES: usize = 4 * 1024;

/// A relay for connections to one server.
pub struct TcpRelay {
    listener: TcpListener,
    server: SocketAddr,
    links: [LinkSettings; 2],
    seed: u64,
}

fn socket() -> io::Result<TcpSocket> {
    let socket = TcpSocket::new_v4()?;
    socket.set_recv_buffer_size(SOCKET_BUFFER_BYTES)?;
    socket.set_send_buffer_size(SOCKET_BUFFER_BYTES)?;
    Ok(socket)
}

impl TcpRelay {
    /// Opens the socket. The first link leads from the server to the client; the seed determines jitter.
    ///
    /// # Errors
    /// Errors of the system.
    pub fn bind(server: SocketAddr, links: [LinkSettings; 2], seed: u64) -> io::Result<Self> {
        let socket = socket()?;
        socket.bind(SocketAddr::from((Ipv4Addr::LOCALHOST, 0)))?;
        Ok(Self { listener: socket.listen(8)?, server, links, seed })
    }

    /// The address for clients.
    ///
    /// # Errors
    /// Errors of the system.
    pub fn address(&self) -> io::Result<SocketAddr> {
        self.listener.local_addr()
    }

    /// Relays one connection until both sides have closed it.
    ///
    /// # Errors
    /// Errors of the system, and links over which TCP is not modelled.
    pub async fn run(self) -> io::Result<()> {
        let (client, _) = self.listener.accept().await?;
        let clock = VirtualClock::start();
        let [down, up] = self.links;
        let Opening { client: near, server: far, client_ready_ns, server_ready_ns, .. } =
            stream_pipe::open(clock, down, up, self.seed).map_err(io::Error::other)?;
        client.set_nodelay(true)?;
        let (client_read, client_write) = split(client);
        let (near_read, near_write) = tokio::io::split(near);
        let (far_read, far_write) = tokio::io::split(far);
        let to_server = async {
            clock.sleep_until(client_ready_ns).await;
            carry_in(client_read, near_write).await
        };
        let at_the_server = async {
            clock.sleep_until(server_ready_ns).await;
            let server = socket()?.connect(self.server).await?;
            server.set_nodelay(true)?;
            let (server_read, server_write) = split(server);
            tokio::try_join!(carry_out(far_read, server_write), carry_in(server_read, far_write)).map(drop)
        };
        tokio::try_join!(to_server, at_the_server, carry_out(near_read, client_write)).map(drop)
    }
}

fn split(stream: TcpStream) -> (tokio::net::tcp::OwnedReadHalf, tokio::net::tcp::OwnedWriteHalf) {
    stream.into_split()
}

/// Carries bytes from a socket into the modelled connection.
async fn carry_in(mut from: tokio::net::tcp::OwnedReadHalf, mut to: WriteHalf<StreamEnd>) -> io::Result<()> {
    let mut piece = vec![0; PIECE_BYTES];
    // A peer that aborts has ended too.
    while let Ok(length @ 1..) = from.read(&mut piece).await {
        if to.write_all(&piece[..length]).await.is_err() {
            break;
        }
    }
    to.shutdown().await
}

/// Carries bytes from the modelled connection into a socket.
async fn carry_out(mut from: ReadHalf<StreamEnd>, mut to: tokio::net::tcp::OwnedWriteHalf) -> io::Result<()> {
    let mut piece = vec![0; PIECE_BYTES];
    while let length @ 1.. = from.read(&mut piece).await? {
        if to.write_all(&piece[..length]).await.is_err() {
            break;
        }
    }
    // The peer may be gone already.
    let _ = to.shutdown().await;
    Ok(())
}

#[cfg(test)]
mod tests {
    use std::num::NonZeroU64;
    use std::time::{Duration, Instant};

    use super::*;
    use lodestream_netsim::tcp::{IP_TCP_BYTES, SEGMENT_BYTES};

    /// Only lower bounds of time are checked: a machine may be slow, never too fast.
    #[test]
    fn bytes_pass_both_ways_intact_and_not_too_early() {
        let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().unwrap();
        runtime.block_on(async {
            let link = LinkSettings::constant(
                NonZeroU64::new(8_000_000).unwrap(),
                25_000_000,
                64 * 1024,
                IP_TCP_BYTES,
            );
            let server = TcpListener::bind("127.0.0.1:0").await.unwrap();
            let relay = TcpRelay::bind(server.local_addr().unwrap(), [link.clone(), link], 1).unwrap();
            let address = relay.address().unwrap();
            let running = tokio::spawn(relay.run());
            let sent: Vec<u8> = (0..20 * SEGMENT_BYTES).map(|i| (i % 251) as u8).collect();
            let expected = sent.clone();
            let serving = tokio::spawn(async move {
                let (mut stream, _) = server.accept().await.unwrap();
                let mut question = [0; 4];
                stream.read_exact(&mut question).await.unwrap();
                assert_eq!(&question, b"what");
                stream.write_all(&sent).await.unwrap();
            });
            let start = Instant::now();
            let mut client = TcpStream::connect(address).await.unwrap();
            client.write_all(b"what").await.unwrap();
            let mut received = Vec::new();
            client.read_to_end(&mut received).await.unwrap();
            assert!(received == expected);
            // Handshake and request take a round trip each; ten segments fit before the next.
            assert!(start.elapsed() >= Duration::from_millis(150), "{:?}", start.elapsed());
            drop(client);
            serving.await.unwrap();
            running.await.unwrap().unwrap();
        });
    }
}
