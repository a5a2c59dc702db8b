//! The session with the server: connecting, messages in and out, deadlines.

use std::time::Duration;

use lodestream_protocol::client::{ClientSession, Resume};
use lodestream_protocol::frame::{BlobPiece, FrameError, ServerFrame};
use lodestream_protocol::message::{ClientMessage, Close, CloseCode};
use lodestream_protocol::time::Time;
use lodestream_scene::blob::BlobId;
use lodestream_scene::limits::MAX_HAVE;
use lodestream_select::State;

use super::ClientCore;
use super::source::Source;

impl ClientCore {
    /// Records the time of the user's connect call, from which milestones count. By default it is the first
    /// [`ClientCore::connect`].
    pub fn begin(&mut self, now: Time) {
        self.connection.started.get_or_insert(now);
    }

    /// Begins a session over an open transport. If the server still has the same scene, blobs that the client has are
    /// not fetched again.
    pub fn connect(&mut self, now: Time) {
        let mut resume = Resume::default();
        if let Some(header) = &self.scene.header {
            resume.fingerprint = header.fingerprint;
            let held = (0..).zip(&self.scene.states).flat_map(|(asset, state)| state.held(asset));
            resume.have = held.take(MAX_HAVE).collect();
        }
        let session = ClientSession::new(self.config.session.clone(), self.view, resume, now);
        self.start(now, Source::Server(Box::new(session)));
    }

    /// Begins a session.
    pub(super) fn start(&mut self, now: Time, session: Source) {
        self.begin(now);
        self.disconnect();
        self.connection.session = Some(session);
        self.early.clear();
        self.parts.is_announced = false;
        self.selection.wanted.retain(|wanted| !matches!(wanted.id, BlobId::Parts(_)));
        self.connection.bases_sent = false;
        self.connection.closed = None;
        self.connection.welcome = None;
        self.counts.connections += 1;
        self.selection.stale = true;
    }

    /// Ends the session; requested blobs count as absent again.
    fn disconnect(&mut self) {
        self.connection.earlier_bytes += std::mem::take(&mut self.connection.transport_bytes);
        let Some(session) = self.connection.session.take() else { return };
        self.connection.earlier_requests += session.requests();
        for id in session.requested() {
            if self.state(id) == State::InFlight {
                self.set_state(id, State::Absent);
            }
        }
    }

    /// Handles a frame from the server.
    pub fn handle_frame(&mut self, now: Time, frame: ServerFrame) {
        if let Some(session) = &mut self.connection.session {
            session.handle_frame(now, frame);
            self.handle_session_events(now);
        }
    }

    /// Handles a piece of a blob.
    pub fn handle_piece(&mut self, now: Time, piece: BlobPiece) {
        if let Some(session) = &mut self.connection.session {
            session.handle_piece(now, piece);
            self.handle_session_events(now);
        }
    }

    /// Handles the reset of a blob's stream.
    pub fn handle_abandoned(&mut self, now: Time, id: BlobId) {
        if let Some(session) = &mut self.connection.session {
            session.handle_abandoned(now, id);
            self.handle_session_events(now);
        }
    }

    /// Handles a frame that the driver could not decode: the session ends.
    pub fn handle_frame_error(&mut self, now: Time, error: &FrameError) {
        if let Some(session) = &mut self.connection.session {
            session.handle_frame_error(now, error);
            self.handle_session_events(now);
        }
    }

    /// Handles the loss of the transport.
    pub fn handle_lost(&mut self, now: Time, reason: &str) {
        if let Some(session) = &mut self.connection.session {
            session.handle_lost(now, reason);
            self.handle_session_events(now);
        }
    }

    /// Ends the session normally.
    pub fn leave(&mut self, now: Time) {
        if let Some(session) = &mut self.connection.session {
            session.close(now, CloseCode::Normal, "the viewer left");
            self.handle_session_events(now);
        }
    }

    /// Sets the transport payload received over the present connection so far, handshake included, in bytes.
    pub fn note_transport_bytes(&mut self, bytes: u64) {
        self.connection.transport_bytes = bytes;
    }

    /// Handles timeouts. Call at the time given by [`ClientCore::poll_timeout`], then call [`ClientCore::update`]; an
    /// earlier call is harmless.
    pub fn handle_timeout(&mut self, now: Time) {
        if let Some(session) = &mut self.connection.session {
            session.handle_timeout(now);
            self.handle_session_events(now);
        }
        for id in self.failures.take_due(now) {
            self.set_state(id, State::Absent);
            self.selection.stale = true;
        }
    }

    /// Time of the next call of [`ClientCore::handle_timeout`].
    #[must_use]
    pub fn poll_timeout(&self) -> Option<Time> {
        let session = self.connection.session.as_ref().and_then(Source::poll_timeout);
        let select = (self.selection.stale && self.view.is_some()).then(|| self.next_selection());
        [session, self.failures.next_retry(), select].into_iter().flatten().min()
    }

    /// The next message to send. Call until `None`, while the transport can take it.
    pub fn poll_transmit(&mut self, now: Time) -> Option<ClientMessage> {
        self.connection.session.as_mut()?.poll_transmit(now)
    }

    /// Whether a session is open and the server has answered.
    #[must_use]
    pub const fn is_open(&self) -> bool {
        self.connection.session.is_some()
            && self.connection.welcome.is_some()
            && self.connection.closed.is_none()
    }

    /// Time since the server's last message, if that is longer than an answer takes ([`ClientSession::silence`]); of a
    /// published scene, since requests fail.
    #[must_use]
    pub fn silence(&self, now: Time) -> Option<Duration> {
        self.connection.session.as_ref()?.silence(now)
    }

    /// Why the session ended, once it has and all its messages are sent.
    #[must_use]
    pub fn closed(&self) -> Option<&Close> {
        self.connection
            .session
            .as_ref()
            .filter(|session| session.is_closed())
            .and(self.connection.closed.as_ref())
    }
}
