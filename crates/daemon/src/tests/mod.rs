//! The daemon over loopback sockets and, in paused time, over in-memory streams.

mod access;
mod addresses;
mod admin;
mod bad_peers;
mod http;
mod leases;
mod metrics;
mod page;
mod quic;
mod rates;
mod scenes;
mod session_rate;
mod shutdown;
mod slow_store;
mod soak;
mod tls;
mod tokens;
mod web_transport;
mod websocket;

use std::net::{Ipv4Addr, SocketAddr};
use std::sync::Arc;
use std::time::Duration;

use bytes::Bytes;
use futures_util::{SinkExt, StreamExt};
use lodestream_protocol::frame::{BlobPiece, Frame, ServerFrame, encode_client};
use lodestream_protocol::message::{ClientMessage, Hello, ServerMessage, Want};
use lodestream_scene::BlobId;
use tokio::io::{AsyncRead, AsyncWrite, DuplexStream, duplex};
use tokio_tungstenite::WebSocketStream;
use tokio_tungstenite::tungstenite::Message;

use crate::daemon::{Daemon, DaemonOptions};
use crate::http::server::accept_http;
use crate::session::memory_scene::MemoryScene;
use crate::session::settings::SessionSettings;
use crate::session::state::ServerState;

/// Time limit in real time, far above the time needed.
const REAL_TIME_LIMIT: Duration = Duration::from_secs(30);

fn peer() -> SocketAddr {
    SocketAddr::from((Ipv4Addr::LOCALHOST, 50_000))
}

fn state_of(scene: MemoryScene, rate_bits_per_s: Option<u64>) -> Arc<ServerState> {
    ServerState::new(Arc::new(scene), SessionSettings { rate_bits_per_s, ..SessionSettings::default() })
}

fn hello() -> ClientMessage {
    ClientMessage::Hello(Hello::new(""))
}

/// Requests for every texture level of the first `assets` assets.
fn want_textures(assets: u32) -> ClientMessage {
    let levels = 0..crate::session::memory_scene::TEXTURE_LEVELS;
    let ids = (0..assets).flat_map(|asset| levels.clone().map(move |level| BlobId::texture(asset, 0, level)));
    ClientMessage::Want(ids.map(|id| Want::whole(id, 1)).collect())
}

/// A daemon on loopback, with its certificate's folder.
async fn loopback(scene: MemoryScene, sessions: SessionSettings) -> (Daemon, tempfile::TempDir) {
    let folder = tempfile::tempdir().unwrap();
    let any = Some(SocketAddr::from((Ipv4Addr::LOCALHOST, 0)));
    let options = DaemonOptions { listen: any, http: any, sessions, ..DaemonOptions::new(folder.path()) };
    (Daemon::bind(options, Arc::new(scene)).await.unwrap(), folder)
}

/// A WebSocket client that speaks the protocol's frames.
struct Client<S>(WebSocketStream<S>);

impl Client<DuplexStream> {
    /// Connects over a stream in memory.
    async fn in_memory(state: &Arc<ServerState>) -> Self {
        Self::from(peer(), state).await.unwrap()
    }

    /// Connects over a stream in memory and requests all texture levels of asset 0.
    async fn requesting_textures(state: &Arc<ServerState>) -> Self {
        let mut client = Self::in_memory(state).await;
        client.send(&hello()).await;
        client.send(&want_textures(1)).await;
        client
    }

    /// Connects from an address.
    async fn from(peer: SocketAddr, state: &Arc<ServerState>) -> Result<Self, String> {
        let (near, far) = duplex(64 * 1024);
        tokio::spawn(accept_http(far, state.clone(), peer));
        let opened = tokio_tungstenite::client_async("ws://server/stream", near).await;
        opened.map(|(socket, _)| Self(socket)).map_err(|why| why.to_string())
    }
}

impl<S: AsyncRead + AsyncWrite + Unpin> Client<S> {
    async fn over(stream: S) -> Self {
        let (socket, _) = tokio_tungstenite::client_async("ws://server/stream", stream).await.unwrap();
        Self(socket)
    }

    async fn send(&mut self, message: &ClientMessage) {
        self.0.send(Message::Binary(encode_client(message).unwrap().into())).await.unwrap();
    }

    /// The next frame; `None` once the server has closed.
    async fn next(&mut self) -> Option<ServerFrame> {
        loop {
            match self.0.next().await? {
                Ok(Message::Binary(bytes)) => {
                    if let Some(frame) = Frame::parse(bytes).unwrap().into_server_frame().unwrap() {
                        return Some(frame);
                    }
                }
                Ok(Message::Close(_)) | Err(_) => return None,
                Ok(_) => {}
            }
        }
    }

    /// Reads until this many blobs are complete, and then until `Done`.
    async fn read_blobs(&mut self, count: usize) -> Vec<(BlobId, Bytes)> {
        let mut assembler = Assembler::default();
        loop {
            match self.next().await.expect("closed before Done") {
                ServerFrame::Piece(piece) => assembler.push(piece),
                ServerFrame::Message(ServerMessage::Done) if assembler.complete.len() >= count => {
                    return assembler.complete;
                }
                ServerFrame::Message(_) => {}
            }
        }
    }

    /// Reads until the session's `Close`, which must come.
    async fn read_until_close(&mut self) -> lodestream_protocol::message::Close {
        loop {
            if let ServerFrame::Message(ServerMessage::Close(close)) = self.next().await.expect("no Close") {
                return close;
            }
        }
    }
}

/// Assembles pieces to blobs.
#[derive(Default)]
struct Assembler {
    partial: Vec<(BlobId, Vec<u8>)>,
    complete: Vec<(BlobId, Bytes)>,
}

impl Assembler {
    fn push(&mut self, piece: BlobPiece) {
        let at = self.partial.iter().position(|(id, _)| *id == piece.id).unwrap_or_else(|| {
            self.partial.push((piece.id, Vec::new()));
            self.partial.len() - 1
        });
        let bytes = &mut self.partial[at].1;
        assert_eq!(bytes.len(), piece.offset as usize);
        bytes.extend_from_slice(&piece.bytes);
        if piece.is_last() {
            let (id, bytes) = self.partial.remove(at);
            assert_eq!(bytes, MemoryScene::contents(&id, piece.total));
            self.complete.push((id, bytes.into()));
        }
    }
}
