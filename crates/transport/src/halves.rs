//! The two halves of a connection, as the loop of a session uses them.

use std::future::Future;

use lodestream_protocol::frame::{BlobPiece, Frame, FrameError, ServerFrame};
use lodestream_protocol::message::{ClientMessage, Close};
use lodestream_scene::blob::BlobId;

/// What frames from the peer decode to.
pub trait Incoming: Send + Sized {
    /// The peer, in texts: `server` or `client`.
    const PEER: &'static str;

    /// Decodes a frame; `None` for an unknown message that may be skipped.
    ///
    /// # Errors
    /// Refuses unknown messages that are not optional, and malformed bodies.
    fn from_frame(frame: Frame) -> Result<Option<Self>, FrameError>;
}

impl Incoming for ServerFrame {
    const PEER: &'static str = "server";

    fn from_frame(frame: Frame) -> Result<Option<Self>, FrameError> {
        frame.into_server_frame()
    }
}

impl Incoming for ClientMessage {
    const PEER: &'static str = "client";

    fn from_frame(frame: Frame) -> Result<Option<Self>, FrameError> {
        frame.into_client_message()
    }
}

/// An event of the receiving half. After the last four nothing more is received.
#[derive(Debug)]
pub enum Received<F> {
    /// A message, or a piece on WebSocket.
    Frame(F),
    /// Pieces of one blob (QUIC only).
    Pieces(Vec<BlobPiece>),
    /// The stream of a blob was reset (QUIC only).
    Abandoned(BlobId),
    /// Nothing for the session: an unknown frame that may be skipped, or an event of the transport.
    Skipped,
    /// Bytes that are not a valid frame.
    Malformed(FrameError),
    /// The peer broke a rule of the transport; the reason to close the connection.
    Violation(Close),
    /// The peer closed the connection. The code is `Lost` if it stated none of ours.
    Closed(Close),
    /// The transport failed.
    Lost(String),
}

impl<F: Incoming> From<Result<Frame, FrameError>> for Received<F> {
    fn from(frame: Result<Frame, FrameError>) -> Self {
        match frame.and_then(F::from_frame) {
            Ok(Some(frame)) => Self::Frame(frame),
            Ok(None) => Self::Skipped,
            Err(why) => Self::Malformed(why),
        }
    }
}

/// Receiving half of a connection.
pub trait Receiver: Send {
    /// What frames decode to.
    type Frame: Incoming;

    /// The next event. Cancel safe.
    fn receive(&mut self) -> impl Future<Output = Received<Self::Frame>> + Send;
}

/// Sending half of a connection.
pub trait Sender: Send {
    /// What the session sends.
    type Item;

    /// Whether another item is accepted.
    fn has_room(&self) -> bool;

    /// Accepts an item; gives its length in bytes. Call only while there is room.
    ///
    /// # Errors
    /// The item is beyond a limit of the protocol and is not sent.
    fn push(&mut self, item: Self::Item) -> Result<usize, FrameError>;

    /// Whether the transport has accepted everything.
    fn is_idle(&self) -> bool;

    /// Resolves when the transport has accepted everything. Cancel safe: what was sent has left the queue.
    ///
    /// # Errors
    /// The transport is lost.
    fn flush(&mut self) -> impl Future<Output = Result<(), SendError>> + Send;
}

/// Items could not be sent: the transport is lost.
#[derive(Debug, thiserror::Error)]
pub enum SendError {
    /// The QUIC connection is lost.
    #[cfg(feature = "quic")]
    #[error(transparent)]
    Connection(#[from] quinn::ConnectionError),
    /// The QUIC stream cannot be written.
    #[cfg(feature = "quic")]
    #[error(transparent)]
    Stream(#[from] quinn::WriteError),
    /// The peer does not read the stream of control frames.
    #[cfg(feature = "quic")]
    #[error("the {0} stopped the stream of control frames")]
    Stopped(&'static str),
    /// The server has not answered early data in time.
    #[cfg(feature = "quic")]
    #[error("the server does not answer")]
    NoAnswer,
    /// The WebSocket cannot be written.
    #[cfg(feature = "websocket")]
    #[error(transparent)]
    WebSocket(#[from] Box<tokio_tungstenite::tungstenite::Error>),
}
