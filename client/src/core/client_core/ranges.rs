//! A published scene in place of a server: requests out, responses in.

use lodestream_protocol::message::CloseCode;
use lodestream_protocol::time::Time;

use super::ClientCore;
use super::source::Source;
use crate::ranges::{RangeRequest, RangeSession, ResponseHead};

impl ClientCore {
    /// Begins to read a published scene. If it still is the same scene, blobs that the client has are not fetched
    /// again.
    pub fn connect_ranges(&mut self, now: Time) {
        let closed = self.connection.closed.as_ref();
        let reload = closed.is_some_and(|close| matches!(close.code, CloseCode::Lost | CloseCode::Protocol));
        let session = self.config.session.clone();
        let ranges = RangeSession::new(session, self.config.ranges, self.view, reload, now);
        self.start(now, Source::Ranges(Box::new(ranges)));
    }

    /// The next range request to make. Call until `None`.
    pub fn poll_request(&mut self, now: Time) -> Option<RangeRequest> {
        self.connection.session.as_mut()?.ranges()?.poll_request(now)
    }

    /// The next range request to abort. Call until `None`.
    pub fn poll_cancelled(&mut self) -> Option<u64> {
        self.connection.session.as_mut()?.ranges()?.poll_cancelled()
    }

    fn with_ranges(&mut self, now: Time, handle: impl FnOnce(&mut RangeSession)) {
        if let Some(session) = self.connection.session.as_mut().and_then(Source::ranges) {
            handle(session);
            self.handle_session_events(now);
        }
    }

    /// Handles the head of the response to a request.
    pub fn handle_response_head(&mut self, now: Time, id: u64, head: &ResponseHead) {
        self.with_ranges(now, |session| session.handle_head(now, id, head));
    }

    /// Handles bytes of a response, in order.
    pub fn handle_response_body(&mut self, now: Time, id: u64, bytes: &[u8]) {
        self.with_ranges(now, |session| session.handle_body(now, id, bytes));
    }

    /// Handles the end of a response.
    pub fn handle_response_end(&mut self, now: Time, id: u64) {
        self.with_ranges(now, |session| session.handle_end(now, id));
    }

    /// Handles a request that failed: no connection, or a lost one.
    pub fn handle_request_failure(&mut self, now: Time, id: u64, why: &str) {
        self.with_ranges(now, |session| session.handle_failure(now, id, why));
    }

    /// Handles a request that failed for a reason that stays, such as a certificate that is not trusted: the session ends.
    pub fn handle_request_refusal(&mut self, now: Time, id: u64, why: &str) {
        self.with_ranges(now, |session| session.handle_refusal(id, why));
    }

    /// What is wrong with the source for the present, for people, if it is known.
    #[must_use]
    pub fn trouble(&self) -> Option<&str> {
        self.connection.session.as_ref()?.trouble()
    }
}
