//! Records every byte of a session, both ways, in virtual time, in the input format of docs/protocol/reader.py.

use std::collections::BTreeMap;
use std::io;
use std::pin::Pin;
use std::sync::{Arc, Mutex};
use std::task::{Context, Poll};
use std::time::Duration;

use futures_util::{SinkExt as _, StreamExt as _};
use lodestream_daemon::{ServerState, SessionSettings};
use lodestream_netsim::clock::virtual_runtime;
use lodestream_protocol::frame::encode_client;
use lodestream_protocol::message::ClientMessage;
use lodestream_protocol::source::SceneSource;
use lodestream_protocol::stream::CONTROL_STREAM;
use serde_json::{Value, json};
use tokio::io::{AsyncRead, AsyncWrite, ReadBuf};
use tokio::time::{sleep, timeout};
use tokio_tungstenite::tungstenite::Message;

use crate::support::daemon::Transport;
use crate::support::virtual_link::{QuicLink, tcp_connect};

const RATE_BITS_PER_S: u64 = 8_000_000;
const RTT_MS: u64 = 50;
/// Virtual time without data after which a group of messages counts as answered.
const QUIET: Duration = Duration::from_secs(1);

type Shared = Arc<Mutex<Vec<u8>>>;

fn copy(bytes: &Shared) -> Vec<u8> {
    bytes.lock().unwrap().clone()
}

/// The bytes of both sides. A stream is (sender, number, bytes).
pub(super) enum Recording {
    Quic(Vec<(&'static str, u64, Vec<u8>)>),
    WebSocket { from_client: Vec<u8>, from_server: Vec<u8> },
}

impl Recording {
    /// The input of the reader.
    pub(super) fn json(&self) -> Value {
        match self {
            Self::Quic(streams) => {
                let stream = |(from, number, bytes): &(&str, u64, Vec<u8>)| json!({"from": from, "number": number, "bytes": hex(bytes)});
                json!({"transport": "quic", "streams": streams.iter().map(stream).collect::<Vec<_>>()})
            }
            Self::WebSocket { from_client, from_server } => {
                json!({"transport": "websocket", "from_client": hex(from_client), "from_server": hex(from_server)})
            }
        }
    }
}

pub(super) fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}

/// Records a session in which a client sends groups of messages, each once nothing more arrives for the previous.
pub(super) fn record(
    scene: Arc<dyn SceneSource>,
    transport: Transport,
    groups: &[Vec<ClientMessage>],
) -> Recording {
    let state = ServerState::new(scene, SessionSettings::default());
    virtual_runtime().unwrap().block_on(async {
        match transport {
            Transport::Quic => over_quic(state, groups).await,
            Transport::WebSocket => over_websocket(state, groups).await,
        }
    })
}

async fn over_quic(state: Arc<ServerState>, groups: &[Vec<ClientMessage>]) -> Recording {
    let link = QuicLink::new(state, RATE_BITS_PER_S, RTT_MS);
    let connection = link.connect().await;
    let streams: Arc<Mutex<BTreeMap<u64, Shared>>> = Arc::default();
    let (accepting, found) = (connection.clone(), streams.clone());
    tokio::spawn(async move {
        while let Ok(mut stream) = accepting.accept_uni().await {
            let number = quinn::VarInt::from(stream.id()).into_inner();
            let bytes = Shared::default();
            found.lock().unwrap().insert(number, bytes.clone());
            tokio::spawn(async move {
                while let Ok(Some(chunk)) = stream.read_chunk(16 * 1024, true).await {
                    bytes.lock().unwrap().extend_from_slice(&chunk.bytes);
                }
            });
        }
    });
    let mut control = connection.open_uni().await.unwrap();
    let number = quinn::VarInt::from(control.id()).into_inner();
    let mut said = vec![CONTROL_STREAM];
    let mut written = 0;
    for group in groups {
        for message in group {
            said.extend(encode_client(message).unwrap());
        }
        control.write_all(&said[written..]).await.unwrap();
        written = said.len();
        loop {
            let before: usize = streams.lock().unwrap().values().map(|bytes| copy(bytes).len()).sum();
            sleep(QUIET).await;
            let after: usize = streams.lock().unwrap().values().map(|bytes| copy(bytes).len()).sum();
            if before == after {
                break;
            }
        }
    }
    let theirs =
        streams.lock().unwrap().iter().map(|(&n, bytes)| ("server", n, copy(bytes))).collect::<Vec<_>>();
    Recording::Quic([vec![("client", number, said)], theirs].concat())
}

async fn over_websocket(state: Arc<ServerState>, groups: &[Vec<ClientMessage>]) -> Recording {
    let (stream, _) = tcp_connect(state, RATE_BITS_PER_S, RTT_MS).await;
    let (read, written) = (Shared::default(), Shared::default());
    let tap = Tap { stream, read: read.clone(), written: written.clone() };
    let (mut socket, _) = tokio_tungstenite::client_async("ws://server/", tap).await.unwrap();
    for group in groups {
        for message in group {
            socket.send(Message::Binary(encode_client(message).unwrap().into())).await.unwrap();
        }
        while let Ok(Some(Ok(_))) = timeout(QUIET, socket.next()).await {}
    }
    Recording::WebSocket { from_client: copy(&written), from_server: copy(&read) }
}

/// A stream that copies all bytes that pass through it.
struct Tap<S> {
    stream: S,
    read: Shared,
    written: Shared,
}

impl<S: AsyncRead + Unpin> AsyncRead for Tap<S> {
    fn poll_read(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
        buffer: &mut ReadBuf<'_>,
    ) -> Poll<io::Result<()>> {
        let before = buffer.filled().len();
        let polled = Pin::new(&mut self.stream).poll_read(context, buffer);
        self.read.lock().unwrap().extend_from_slice(&buffer.filled()[before..]);
        polled
    }
}

impl<S: AsyncWrite + Unpin> AsyncWrite for Tap<S> {
    fn poll_write(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
        bytes: &[u8],
    ) -> Poll<io::Result<usize>> {
        let polled = Pin::new(&mut self.stream).poll_write(context, bytes);
        if let Poll::Ready(Ok(count)) = &polled {
            self.written.lock().unwrap().extend_from_slice(&bytes[..*count]);
        }
        polled
    }

    fn poll_flush(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<io::Result<()>> {
        Pin::new(&mut self.stream).poll_flush(context)
    }

    fn poll_shutdown(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<io::Result<()>> {
        Pin::new(&mut self.stream).poll_shutdown(context)
    }
}
