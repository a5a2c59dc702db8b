//! Attacks of one untrusted peer, bounded in bytes and time.

use std::net::SocketAddr;
use std::sync::Arc;

use futures_util::{SinkExt as _, StreamExt as _};
use lodestream_client::net;
use lodestream_protocol::frame::encode_client;
use lodestream_protocol::message::{ClientMessage, Hello, Want};
use lodestream_protocol::stream::{ALPN, CONTROL_STREAM};
use lodestream_scene::BlobId;
use rand::{RngCore as _, SeedableRng as _};
use rand_pcg::Pcg64Mcg;
use tokio::io::{AsyncReadExt as _, AsyncWriteExt as _};
use tokio::net::{TcpStream, UdpSocket};
use tokio::time::{Duration, Instant, sleep, sleep_until};
use tokio_tungstenite::tungstenite::Message;
use tokio_tungstenite::tungstenite::client::IntoClientRequest as _;
use tokio_tungstenite::tungstenite::http::HeaderValue;
use tokio_tungstenite::tungstenite::http::header::{ORIGIN, SEC_WEBSOCKET_PROTOCOL};
use tokio_tungstenite::{WebSocketStream, client_async};

use crate::served::Address;

/// Requests per message, and number of messages.
const WANTS: [usize; 2] = [500, 8];
/// Random bytes per frame.
const RANDOM_BYTES: usize = 64;
/// Datagrams of one untrusted peer, and their length.
const DATAGRAMS: [usize; 2] = [200, 1200];
/// Frames without a message, of one untrusted peer.
const EMPTY_FRAMES: usize = 100_000;

/// An attack.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Attack {
    /// No attack.
    Nothing,
    /// Connects by TCP and sends nothing.
    Silent,
    /// Sends half of an HTTP request.
    HalfRequest,
    /// Opens a WebSocket from a page of another site.
    OtherOrigin,
    /// Sends `Hello` over WebSocket, then nothing.
    HelloWs,
    /// Sends `Hello` over QUIC, then nothing.
    HelloQuic,
    /// Requests all blobs several times over and reads nothing.
    Unread,
    /// Requests blobs that do not exist.
    Bogus,
    /// Sends `Hello`, then random bytes as frames.
    RandomFrames,
    /// Sends frames without messages as fast as they are accepted.
    EmptyFrames,
    /// Sends datagrams of random bytes that look like an Initial packet.
    RandomDatagrams,
    /// Connects, sends `Hello` and disconnects, repeatedly.
    Reconnect,
}

impl Attack {
    /// All attacks, each with its number of peers.
    pub const ALL: [(Self, u32); 12] = [
        (Self::Nothing, 0),
        (Self::Silent, 400),
        (Self::HalfRequest, 400),
        (Self::OtherOrigin, 400),
        (Self::HelloWs, 400),
        (Self::HelloQuic, 300),
        (Self::Unread, 100),
        (Self::Bogus, 100),
        (Self::RandomFrames, 400),
        (Self::EmptyFrames, 10),
        (Self::RandomDatagrams, 100),
        (Self::Reconnect, 10),
    ];

    /// Name in tables.
    #[must_use]
    pub const fn name(&self) -> &'static str {
        match self {
            Self::Nothing => "nothing",
            Self::Silent => "a TCP connection, then silence",
            Self::HalfRequest => "half a request, then silence",
            Self::OtherOrigin => "a WebSocket from another site's page",
            Self::HelloWs => "hello over WebSocket, then silence",
            Self::HelloQuic => "hello over QUIC, then silence",
            Self::Unread => "4,000 wants, reading nothing",
            Self::Bogus => "4,000 wants of what does not exist",
            Self::RandomFrames => "hello, then random bytes",
            Self::EmptyFrames => "up to 100,000 pings",
            Self::RandomDatagrams => "200 datagrams of 1,200 random bytes",
            Self::Reconnect => "connects, says hello, leaves, again",
        }
    }

    /// Attacks until `end`. Returns whether the server still held the connection then.
    pub(super) async fn run(
        self,
        server: Address,
        number: u32,
        wanted: Arc<Vec<BlobId>>,
        end: Instant,
    ) -> bool {
        tokio::select! {
            held = self.act(server, number, &wanted, end) => held.unwrap_or(false),
            // An attack that is still running was not refused.
            () = sleep_until(end + Duration::from_millis(500)) => true,
        }
    }

    /// Returns `None` if the server refused or closed the connection.
    async fn act(&self, server: Address, number: u32, wanted: &[BlobId], end: Instant) -> Option<bool> {
        let Address { quic, http, pin } = server;
        match self {
            Self::Nothing => None,
            Self::Silent | Self::HalfRequest => {
                let mut stream = TcpStream::connect(http).await.ok()?;
                if *self == Self::HalfRequest {
                    stream.write_all(b"GET / HTTP/1.1\r\nHost: loc").await.ok()?;
                }
                let closed = async { while stream.read(&mut [0; 256]).await.is_ok_and(|n| n > 0) {} };
                Some(is_pending_at(closed, end).await)
            }
            Self::OtherOrigin => {
                open(http, Some("https://elsewhere.example")).await?;
                Some(true)
            }
            Self::HelloWs => {
                let mut socket = websocket_after_hello(http).await?;
                Some(is_pending_at(drain(&mut socket), end).await)
            }
            Self::HelloQuic => {
                let endpoint = net::endpoint(quic, net::client_config(pin).ok()?).ok()?;
                let connection = endpoint.connect(quic, "localhost").ok()?.await.ok()?;
                let mut control = connection.open_uni().await.ok()?;
                control.write_all(&[CONTROL_STREAM]).await.ok()?;
                control.write_all(&hello()?).await.ok()?;
                Some(is_pending_at(async { drop(connection.closed().await) }, end).await)
            }
            Self::Unread | Self::Bogus => {
                let mut socket = websocket_after_hello(http).await?;
                for message in 0..WANTS[1] {
                    let id = |i: usize| match self {
                        Self::Unread => wanted[i % wanted.len()],
                        _ => BlobId::chunk(4_000_000 + number, (message * WANTS[0] + i) as u32),
                    };
                    let wants = (0..WANTS[0]).map(|i| Want::whole(id(i), 1)).collect();
                    let bytes = encode_client(&ClientMessage::Want(wants)).ok()?;
                    socket.send(Message::Binary(bytes.into())).await.ok()?;
                }
                sleep_until(end).await;
                // Reads only now; the data in flight come first.
                Some(is_pending_at(drain(&mut socket), end + Duration::from_millis(100)).await)
            }
            Self::RandomFrames => {
                let mut socket = websocket_after_hello(http).await?;
                let mut random = Pcg64Mcg::seed_from_u64(number.into());
                let mut bytes = vec![0; RANDOM_BYTES];
                random.fill_bytes(&mut bytes);
                socket.send(Message::Binary(bytes.into())).await.ok()?;
                Some(is_pending_at(drain(&mut socket), end).await)
            }
            Self::EmptyFrames => {
                let mut socket = websocket_after_hello(http).await?;
                for _ in 0..EMPTY_FRAMES {
                    socket.send(Message::Ping(Default::default())).await.ok()?;
                    if Instant::now() >= end {
                        break;
                    }
                }
                Some(is_pending_at(drain(&mut socket), end).await)
            }
            Self::RandomDatagrams => {
                let socket = UdpSocket::bind("127.0.0.1:0").await.ok()?;
                let mut random = Pcg64Mcg::seed_from_u64(number.into());
                let mut bytes = vec![0; DATAGRAMS[1]];
                for _ in 0..DATAGRAMS[0] {
                    random.fill_bytes(&mut bytes);
                    // Long header, fixed bit, Initial; version 1; connection ids of eight bytes.
                    bytes[..6].copy_from_slice(&[0xC3, 0, 0, 0, 1, 8]);
                    bytes[14] = 8;
                    socket.send_to(&bytes, quic).await.ok()?;
                    sleep(Duration::from_millis(10)).await;
                }
                None
            }
            Self::Reconnect => {
                while Instant::now() < end {
                    if websocket_after_hello(http).await.is_none() {
                        sleep(Duration::from_millis(1)).await;
                    }
                }
                None
            }
        }
    }
}

/// Whether a future is still pending at `end`.
async fn is_pending_at(what: impl Future<Output = ()>, end: Instant) -> bool {
    tokio::select! {
        () = what => false,
        () = sleep_until(end) => true,
    }
}

fn hello() -> Option<Vec<u8>> {
    encode_client(&ClientMessage::Hello(Hello::new(""))).ok()
}

/// A WebSocket, optionally with the origin of a site.
async fn open(http: SocketAddr, origin: Option<&'static str>) -> Option<WebSocketStream<TcpStream>> {
    let stream = TcpStream::connect(http).await.ok()?;
    let mut request = format!("ws://{http}/").into_client_request().ok()?;
    request.headers_mut().insert(SEC_WEBSOCKET_PROTOCOL, HeaderValue::from_static(ALPN));
    if let Some(origin) = origin {
        request.headers_mut().insert(ORIGIN, HeaderValue::from_static(origin));
    }
    Some(client_async(request, stream).await.ok()?.0)
}

/// A WebSocket that has sent `Hello`.
async fn websocket_after_hello(http: SocketAddr) -> Option<WebSocketStream<TcpStream>> {
    let mut socket = open(http, None).await?;
    socket.send(Message::Binary(hello()?.into())).await.ok()?;
    Some(socket)
}

/// Reads until the other side closes.
async fn drain(socket: &mut WebSocketStream<TcpStream>) {
    while let Some(Ok(message)) = socket.next().await {
        if message.is_close() {
            break;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_attack_has_a_name_and_a_bounded_number_of_peers() {
        let mut names: Vec<_> = Attack::ALL.iter().map(|(attack, _)| attack.name()).collect();
        names.sort_unstable();
        names.dedup();
        assert_eq!(names.len(), Attack::ALL.len());
        // The server's backlog and this process's file limit allow this number.
        assert!(Attack::ALL.iter().all(|(_, count)| *count <= 400));
    }
}
