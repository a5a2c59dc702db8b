//! Clients that only exchange frames; the test controls the session.

use std::collections::BTreeMap;

use bytes::Bytes;
use futures_util::{SinkExt, StreamExt};
use lodestream_protocol::frame::{BlobPiece, Frame, FrameReader, ServerFrame, encode_client};
use lodestream_protocol::message::{ClientMessage, Close, Hello, ServerMessage, Want};
use lodestream_protocol::stream::{BLOB_STREAM, BlobStreamReader, CONTROL_STREAM, PAGE_STREAM};
use lodestream_scene::BlobId;
use quinn::{Connection, RecvStream, SendStream};
use tokio::io::{AsyncRead, AsyncWrite};
use tokio::sync::mpsc;
use tokio_tungstenite::WebSocketStream;
use tokio_tungstenite::tungstenite::Message;

/// A valid first message.
pub(crate) fn hello() -> Hello {
    Hello::new("")
}

/// Requests blobs with equal priority.
pub(crate) fn want(ids: impl IntoIterator<Item = BlobId>) -> ClientMessage {
    ClientMessage::Want(ids.into_iter().map(|id| Want::whole(id, 1)).collect())
}

/// Data from the server.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Arrival {
    Message(ServerMessage),
    Blob(BlobId, Bytes),
}

/// A client on either transport.
pub(crate) trait RawClient {
    /// Sends bytes in the place of a frame. Fails if the connection has ended.
    async fn send_bytes(&mut self, frame: Vec<u8>) -> Result<(), String>;

    /// The next arrival; `None` once the connection is closed.
    async fn next(&mut self) -> Option<Arrival>;

    async fn send(&mut self, message: &ClientMessage) {
        self.send_bytes(encode_client(message).unwrap()).await.unwrap();
    }

    /// Reads until the server's `Close`; `None` if the connection ends without it.
    async fn close(&mut self) -> Option<Close> {
        while let Some(arrival) = self.next().await {
            if let Arrival::Message(ServerMessage::Close(close)) = arrival {
                return Some(close);
            }
        }
        None
    }

    /// Reads until a message for which `wanted` holds.
    async fn message(&mut self, mut wanted: impl FnMut(&ServerMessage) -> bool) -> ServerMessage {
        loop {
            match self.next().await.expect("the server has closed") {
                Arrival::Message(message) if wanted(&message) => return message,
                _ => {}
            }
        }
    }
}

/// A client over a byte stream.
pub(crate) struct RawWebSocket<S> {
    socket: WebSocketStream<S>,
    partial: BTreeMap<BlobId, Vec<u8>>,
}

impl<S: AsyncRead + AsyncWrite + Unpin> RawWebSocket<S> {
    pub(crate) async fn open(stream: S) -> Self {
        let (socket, _) = tokio_tungstenite::client_async("ws://server/", stream).await.unwrap();
        Self { socket, partial: BTreeMap::new() }
    }

    fn piece(&mut self, piece: BlobPiece) -> Option<Arrival> {
        let bytes = self.partial.entry(piece.id).or_default();
        assert_eq!(bytes.len(), piece.offset as usize, "pieces arrive out of order");
        bytes.extend_from_slice(&piece.bytes);
        if !piece.is_last() {
            return None;
        }
        Some(Arrival::Blob(piece.id, self.partial.remove(&piece.id)?.into()))
    }
}

impl<S: AsyncRead + AsyncWrite + Unpin> RawClient for RawWebSocket<S> {
    async fn send_bytes(&mut self, frame: Vec<u8>) -> Result<(), String> {
        self.socket.send(Message::Binary(frame.into())).await.map_err(|why| why.to_string())
    }

    async fn next(&mut self) -> Option<Arrival> {
        loop {
            let Ok(message) = self.socket.next().await? else { return None };
            let Message::Binary(bytes) = message else { continue };
            match Frame::parse(bytes).unwrap().into_server_frame().unwrap() {
                Some(ServerFrame::Message(message)) => return Some(Arrival::Message(message)),
                Some(ServerFrame::Piece(piece)) => {
                    if let Some(arrival) = self.piece(piece) {
                        return Some(arrival);
                    }
                }
                None => {}
            }
        }
    }
}

/// A client over a QUIC connection.
pub(crate) struct RawQuic {
    pub(crate) connection: Connection,
    control: Option<SendStream>,
    arrivals: mpsc::Receiver<Arrival>,
}

impl RawQuic {
    pub(crate) fn new(connection: Connection) -> Self {
        let (sender, arrivals) = mpsc::channel(1024);
        let streams = connection.clone();
        tokio::spawn(async move {
            while let Ok(stream) = streams.accept_uni().await {
                tokio::spawn(read_stream(stream, sender.clone()));
            }
        });
        Self { connection, control: None, arrivals }
    }
}

impl RawClient for RawQuic {
    async fn send_bytes(&mut self, frame: Vec<u8>) -> Result<(), String> {
        if self.control.is_none() {
            let mut stream = self.connection.open_uni().await.map_err(|why| why.to_string())?;
            stream.write_all(&[CONTROL_STREAM]).await.map_err(|why| why.to_string())?;
            self.control = Some(stream);
        }
        let stream = self.control.as_mut().unwrap();
        stream.write_all(&frame).await.map_err(|why| why.to_string())
    }

    async fn next(&mut self) -> Option<Arrival> {
        self.arrivals.recv().await
    }
}

async fn read_stream(mut stream: RecvStream, arrivals: mpsc::Sender<Arrival>) {
    let mut kind = [0];
    if stream.read_exact(&mut kind).await.is_err() {
        return;
    }
    let mut frames = FrameReader::new();
    let mut reader = BlobStreamReader::new();
    let mut blob = Vec::new();
    while let Ok(Some(chunk)) = stream.read_chunk(16 * 1024, true).await {
        match kind[0] {
            CONTROL_STREAM | PAGE_STREAM => {
                frames.push(&chunk.bytes);
                while let Some(frame) = frames.next_frame().unwrap() {
                    if let Some(ServerFrame::Message(message)) = frame.into_server_frame().unwrap() {
                        let _ = arrivals.send(Arrival::Message(message)).await;
                    }
                }
            }
            BLOB_STREAM => {
                for piece in reader.push(chunk.bytes).unwrap() {
                    blob.extend_from_slice(&piece.bytes);
                    if piece.is_last() {
                        let _ =
                            arrivals.send(Arrival::Blob(piece.id, std::mem::take(&mut blob).into())).await;
                    }
                }
            }
            other => panic!("a stream of kind {other}"),
        }
    }
}
