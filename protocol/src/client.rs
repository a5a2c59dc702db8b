//! The client's side of a session, sans-IO.

use std::time::Duration;

use bytes::Bytes;

use crate::blob::BlobId;
use crate::frame::{BlobPiece, FrameError, ServerFrame};
use crate::message::{ClientMessage, Close, CloseCode, RefusedReason, ServerMessage, Welcome};
use crate::scene::{Fingerprint, ScenePage};
use crate::select::Wanted;
use crate::time::Time;
use crate::view::View;

/// Knobs of a client session.
#[derive(Clone, Debug)]
pub struct ClientConfig {
    /// Name of the scene; empty for the server's default.
    pub scene: String,
    /// Longest blob taken, in bytes.
    pub max_blob_bytes: u32,
    /// Bytes that the client can hold in all.
    pub budget_bytes: u64,
    /// Least bytes kept in flight.
    pub min_in_flight_bytes: u64,
    /// Most bytes kept in flight.
    pub max_in_flight_bytes: u64,
    /// Time in which `Welcome` must come.
    pub welcome_timeout: Duration,
    /// Silence after which the connection counts as lost.
    pub idle_timeout: Duration,
}

/// What a client keeps from one session to the next.
#[derive(Clone, Debug, Default)]
pub struct Resume {
    /// Fingerprint of the scene.
    pub fingerprint: Fingerprint,
    /// Base meshes and index pages that are still here (chunks are asked for by selection anyway).
    pub have: Vec<BlobId>,
}

/// What happened.
#[derive(Clone, Debug, PartialEq)]
pub enum ClientEvent {
    /// The server has answered.
    Connected(Welcome),
    /// A page of the scene description came.
    ScenePage(ScenePage),
    /// A blob is complete.
    Blob {
        /// The blob.
        id: BlobId,
        /// All of it.
        bytes: Bytes,
    },
    /// A blob will not come.
    Refused {
        /// The blob.
        id: BlobId,
        /// Why.
        reason: RefusedReason,
    },
    /// The server has handed over all visible base meshes.
    BasesSent,
    /// The server has nothing queued.
    Done,
    /// The session has ended; the last event.
    Closed(Close),
}

/// A session with a server.
#[derive(Debug)]
pub struct ClientSession {
    config: ClientConfig,
    closed: Option<Close>,
}

impl ClientSession {
    /// A session that begins now; `Hello` is the first thing to transmit.
    #[must_use]
    pub fn new(config: ClientConfig, view: Option<View>, resume: Resume, now: Time) -> Self {
        let _ = (view, resume, now);
        Self { config, closed: None }
    }

    /// Takes a frame of the server.
    pub fn handle_frame(&mut self, now: Time, frame: ServerFrame) {
        match frame {
            ServerFrame::Message(message) => self.handle_message(now, message),
            ServerFrame::Piece(piece) => self.handle_piece(now, piece),
        }
    }

    /// Takes a control message of the server.
    pub fn handle_message(&mut self, now: Time, message: ServerMessage) {
        let _ = (now, message, &self.config);
    }

    /// Takes a piece of a blob.
    pub fn handle_piece(&mut self, now: Time, piece: BlobPiece) {
        let _ = (now, piece);
    }

    /// The stream of a blob was reset: what came of it is dropped.
    pub fn handle_abandoned(&mut self, now: Time, id: BlobId) {
        let _ = (now, id);
    }

    /// Takes what the driver could not decode: ends the session.
    pub fn handle_frame_error(&mut self, now: Time, error: &FrameError) {
        self.close(now, error.close_code(), &error.to_string());
    }

    /// The transport failed or ended.
    pub fn handle_lost(&mut self, now: Time, reason: &str) {
        self.close(now, CloseCode::Lost, reason);
    }

    /// Call when the moment given by [`ClientSession::poll_timeout`] has come; earlier is harmless.
    pub fn handle_timeout(&mut self, now: Time) {
        let _ = now;
    }

    /// When to call [`ClientSession::handle_timeout`].
    #[must_use]
    pub fn poll_timeout(&self) -> Option<Time> {
        None
    }

    /// The next message to send.
    pub fn poll_transmit(&mut self, now: Time) -> Option<ClientMessage> {
        let _ = now;
        None
    }

    /// The next thing that happened.
    pub fn poll_event(&mut self) -> Option<ClientEvent> {
        None
    }

    /// Tells the session what the selection wants, most urgent first, and what is no longer needed. The
    /// session asks for as much of it as keeps the link busy, and cancels the rest.
    pub fn set_wanted(&mut self, now: Time, wanted: &[Wanted], cancel: &[BlobId]) {
        let _ = (now, wanted, cancel);
    }

    /// Tells the server of a new view; sent at most every 100 ms.
    pub fn set_view(&mut self, now: Time, view: View) {
        let _ = (now, view);
    }

    /// These blobs were dropped from the client's cache and may be asked for again.
    pub fn evicted(&mut self, now: Time, ids: &[BlobId]) {
        let _ = (now, ids);
    }

    /// Leaves: `Bye` is sent, then the session is closed.
    pub fn close(&mut self, now: Time, code: CloseCode, reason: &str) {
        let _ = now;
        self.closed.get_or_insert_with(|| Close::new(code, reason));
    }

    /// Whether the session has ended: nothing more will be sent.
    #[must_use]
    pub const fn is_closed(&self) -> bool {
        self.closed.is_some()
    }
}
