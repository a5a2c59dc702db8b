//! The session's newest status, and its messages for the user.

use std::borrow::Cow;

use lodestream_client::net::End;
use lodestream_client::streaming::Status;

use crate::outcome::describe_end;

/// The newest status.
#[derive(Debug, Default)]
pub(super) struct SessionStatus {
    status: Status,
}

impl SessionStatus {
    /// Takes a newer status; returns whether the picture changes with it.
    pub(super) fn take(&mut self, status: Status) -> bool {
        let before = (self.message().map(Cow::into_owned), self.status.settled);
        self.status = status;
        (self.message().as_deref(), self.status.settled) != (before.0.as_deref(), before.1)
    }

    pub(super) fn status(&self) -> &Status {
        &self.status
    }

    /// Message over the picture. Derived from the status on each call: a stored message could be replaced before it is
    /// drawn.
    pub(super) fn message(&self) -> Option<Cow<'_, str>> {
        match &self.status.end {
            Some(End::Closed(close)) => {
                Some(Cow::Owned(format!("the server ended the session: {}", close.reason)))
            }
            Some(End::Unreachable { .. } | End::Left) | None => {
                self.status.message.as_deref().map(Cow::Borrowed)
            }
        }
    }

    /// Why the program has to end. If there is a scene, it stays on the screen after the session's end.
    pub(super) fn fatal(&self, has_scene: bool) -> Option<String> {
        match &self.status.end {
            Some(end @ End::Unreachable { .. }) => Some(describe_end(end)),
            Some(end @ End::Closed(_)) if !has_scene => Some(describe_end(end)),
            Some(End::Closed(_) | End::Left) | None => None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use lodestream_protocol::message::{Close, CloseCode};

    fn closed() -> Status {
        let close = Close::new(CloseCode::Protocol, "the scene is gone");
        Status { end: Some(End::Closed(close)), ..Status::default() }
    }

    /// The message remains when the frame takes the same status a second time.
    #[test]
    fn the_message_of_the_sessions_end_is_still_there_when_the_frame_is_drawn() {
        let mut status = SessionStatus::default();
        assert!(status.take(closed()), "the session's end requires a frame");
        // A frame takes the status once more before it is drawn.
        assert!(!status.take(closed()));
        let message = status.message().expect("a message");
        assert!(message.contains("ended the session: the scene is gone"), "{message}");
    }

    #[test]
    fn the_message_is_that_of_the_streaming_thread() {
        let mut status = SessionStatus::default();
        assert!(status.take(Status { message: Some("nobody answers".into()), ..Status::default() }));
        assert_eq!(status.message().as_deref(), Some("nobody answers"));
        assert!(status.take(Status::default()) && status.message().is_none());
    }

    #[test]
    fn only_an_end_without_a_scene_ends_the_program() {
        let mut status = SessionStatus::default();
        assert_eq!(status.fatal(false), None);
        status.take(closed());
        assert_eq!((status.fatal(true), status.fatal(false).as_deref()), (None, Some("the scene is gone")));
        let end = Some(End::Unreachable { attempts: 3, why: "nobody answers".into() });
        status.take(Status { end, ..Status::default() });
        assert!(
            status.fatal(true).unwrap().starts_with("nobody answers (3 attempts); is the server running")
        );
    }
}
