//! Where the scene comes from: a server's session, or range requests for a published scene. Both take wanted blobs and
//! give events.

use std::time::Duration;

use lodestream_protocol::client::{ClientEvent, ClientSession, ClientStats};
use lodestream_protocol::frame::{BlobPiece, FrameError, ServerFrame};
use lodestream_protocol::message::{ClientMessage, CloseCode, Token};
use lodestream_protocol::time::Time;
use lodestream_scene::blob::BlobId;
use lodestream_scene::view::View;
use lodestream_select::Wanted;

use crate::ranges::RangeSession;

/// A session with one of the two.
#[derive(Debug)]
pub(super) enum Source {
    Server(Box<ClientSession>),
    Ranges(Box<RangeSession>),
}

/// Calls a method that both sessions have.
macro_rules! both {
    ($self:expr, $session:ident => $call:expr) => {
        match $self {
            Self::Server($session) => $call,
            Self::Ranges($session) => $call,
        }
    };
}

impl Source {
    /// The server's session; frames, tokens and messages are of that alone.
    pub(super) fn server(&mut self) -> Option<&mut ClientSession> {
        match self {
            Self::Server(session) => Some(session),
            Self::Ranges(_) => None,
        }
    }

    pub(super) fn ranges(&mut self) -> Option<&mut RangeSession> {
        match self {
            Self::Server(_) => None,
            Self::Ranges(session) => Some(session),
        }
    }

    pub(super) fn handle_frame(&mut self, now: Time, frame: ServerFrame) {
        if let Some(session) = self.server() {
            session.handle_frame(now, frame);
        }
    }

    pub(super) fn handle_piece(&mut self, now: Time, piece: BlobPiece) {
        if let Some(session) = self.server() {
            session.handle_piece(now, piece);
        }
    }

    pub(super) fn handle_abandoned(&mut self, now: Time, id: BlobId) {
        if let Some(session) = self.server() {
            session.handle_abandoned(now, id);
        }
    }

    pub(super) fn handle_frame_error(&mut self, now: Time, error: &FrameError) {
        if let Some(session) = self.server() {
            session.handle_frame_error(now, error);
        }
    }

    pub(super) fn handle_lost(&mut self, now: Time, reason: &str) {
        match self {
            Self::Server(session) => session.handle_lost(now, reason),
            Self::Ranges(session) => session.close(now, CloseCode::Lost, reason),
        }
    }

    pub(super) fn set_token(&mut self, token: Token) {
        if let Some(session) = self.server() {
            session.set_token(token);
        }
    }

    pub(super) fn poll_transmit(&mut self, now: Time) -> Option<ClientMessage> {
        self.server()?.poll_transmit(now)
    }

    pub(super) fn poll_event(&mut self) -> Option<ClientEvent> {
        both!(self, session => session.poll_event())
    }

    pub(super) fn close(&mut self, now: Time, code: CloseCode, reason: &str) {
        both!(self, session => session.close(now, code, reason));
    }

    pub(super) fn handle_timeout(&mut self, now: Time) {
        both!(self, session => session.handle_timeout(now));
    }

    pub(super) fn poll_timeout(&self) -> Option<Time> {
        both!(self, session => session.poll_timeout())
    }

    pub(super) fn silence(&self, now: Time) -> Option<Duration> {
        both!(self, session => session.silence(now))
    }

    /// What is wrong for the present, if more is known than that nothing comes.
    pub(super) fn trouble(&self) -> Option<&str> {
        match self {
            Self::Server(_) => None,
            Self::Ranges(session) => session.trouble(),
        }
    }

    pub(super) fn set_view(&mut self, now: Time, view: View) {
        both!(self, session => session.set_view(now, view));
    }

    pub(super) fn set_wanted(&mut self, now: Time, wanted: &[Wanted], cancel: &[BlobId]) -> Vec<BlobId> {
        both!(self, session => session.set_wanted(now, wanted, cancel))
    }

    /// Reports evicted blobs: a server would not send them again otherwise.
    pub(super) fn evicted(&mut self, now: Time, ids: &[BlobId]) {
        if let Some(session) = self.server() {
            session.evicted(now, ids);
        }
    }

    pub(super) fn is_requested(&self, id: BlobId) -> bool {
        both!(self, session => session.is_requested(id))
    }

    pub(super) fn requested(&self) -> Vec<BlobId> {
        both!(self, session => session.requested().collect())
    }

    pub(super) const fn is_closed(&self) -> bool {
        both!(self, session => session.is_closed())
    }

    pub(super) fn stats(&self) -> ClientStats {
        both!(self, session => session.stats())
    }

    /// Number of range requests.
    pub(super) fn requests(&self) -> u64 {
        match self {
            Self::Server(_) => 0,
            Self::Ranges(session) => session.requests(),
        }
    }
}
