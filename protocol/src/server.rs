//! The server's side of a session, sans-IO.

use std::sync::Arc;
use std::time::Duration;

use crate::blob::BlobId;
use crate::frame::{BlobPiece, FrameError};
use crate::limiter::LimiterConfig;
use crate::message::{ClientMessage, Close, CloseCode, ServerMessage};
use crate::source::SceneSource;
use crate::time::Time;

/// Knobs of a server session.
#[derive(Clone, Debug)]
pub struct ServerConfig {
    /// How fast to send.
    pub limiter: LimiterConfig,
    /// Blob bytes and scene pages pushed before the client's `Hello` is heard, in bytes. On QUIC before
    /// address validation about 3 KB fit (three times the client's first packet, less the handshake);
    /// more would only queue for a view that may be another. On WebSocket: no bound of its own.
    pub push_before_hello_bytes: u64,
    /// Bytes pushed unasked after `Hello`, beyond the base meshes: index pages and first chunks of what
    /// is visible, so that refinement does not wait for a round trip.
    pub push_after_hello_bytes: u64,
    /// Most bytes of a blob handed over at once. Small pieces let urgent blobs overtake; each costs a
    /// frame's overhead.
    pub piece_bytes: u32,
    /// Most blobs queued; more are refused.
    pub max_queued: usize,
    /// Time in which `Hello` must come.
    pub hello_timeout: Duration,
    /// Silence after which the session is closed.
    pub idle_timeout: Duration,
    /// Time for which the transport may take nothing although there is something to send.
    pub stall_timeout: Duration,
}

/// What the driver should hand to the transport.
#[derive(Clone, Debug, PartialEq)]
pub enum Transmit {
    /// A control message.
    Message(ServerMessage),
    /// A piece of a blob. Pieces of a blob come in order; pieces of others may come between.
    Piece {
        /// The piece.
        piece: BlobPiece,
        /// The blob's priority, for the stream ([`crate::stream::quic_priority`]).
        priority: u32,
    },
    /// The rest of a blob will not come: reset its stream. Nothing to do on WebSocket.
    Abandon(BlobId),
}

/// A session with one client.
pub struct ServerSession {
    config: Arc<ServerConfig>,
    source: Arc<dyn SceneSource>,
    closed: Option<Close>,
}

impl ServerSession {
    /// A session that begins now: the transport is open, `Hello` has not been heard. It starts to push
    /// the scene's start view at once.
    pub fn new(config: Arc<ServerConfig>, source: Arc<dyn SceneSource>, session: u64, now: Time) -> Self {
        let _ = (session, now);
        Self { config, source, closed: None }
    }

    /// Takes a message of the client.
    pub fn handle_message(&mut self, now: Time, message: ClientMessage) {
        let _ = (now, message, &self.config, &self.source);
    }

    /// Takes what the driver could not decode: queues a reasoned close.
    pub fn handle_frame_error(&mut self, now: Time, error: &FrameError) {
        self.close(now, error.close_code(), &error.to_string());
    }

    /// Ends the session with a reason; what is queued is dropped, `Close` is the last message.
    pub fn close(&mut self, now: Time, code: CloseCode, reason: &str) {
        let _ = now;
        self.closed.get_or_insert_with(|| Close::new(code, reason));
    }

    /// Call when the moment given by [`ServerSession::poll_timeout`] has come; earlier is harmless.
    pub fn handle_timeout(&mut self, now: Time) {
        let _ = now;
    }

    /// When to call [`ServerSession::handle_timeout`] and then [`ServerSession::poll_transmit`] again.
    #[must_use]
    pub fn poll_timeout(&self) -> Option<Time> {
        None
    }

    /// The next thing to send, if the limiter admits one now. Call until `None`, and only while the
    /// transport can take it: what is handed over can no longer be overtaken.
    pub fn poll_transmit(&mut self, now: Time) -> Option<Transmit> {
        let _ = now;
        None
    }

    /// Why the session ended: set as soon as it is decided.
    #[must_use]
    pub const fn close_reason(&self) -> Option<&Close> {
        self.closed.as_ref()
    }

    /// Whether the session has ended and its `Close` has been handed over: close the transport.
    #[must_use]
    pub const fn is_closed(&self) -> bool {
        self.closed.is_some()
    }
}
