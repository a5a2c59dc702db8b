//! A picture that waits until what its camera sees has arrived.

use lodestream_client::streaming::{Answer, Streaming};
use lodestream_render::Pose;
use lodestream_scene::view::View;

/// A picture that is waited for.
pub(super) struct PendingPicture {
    pub(super) camera: Pose,
    pub(super) view: View,
    /// Whether this view was selected for, and has nothing more to arrive.
    asked: Option<Answer<(bool, bool)>>,
    /// Answers for this view. A question is answered before the core selects anew, so the second one counts.
    seen: u32,
    /// All of it has arrived; what the window has not taken or uploaded yet comes with its next frames.
    pub(super) arrived: bool,
}

impl PendingPicture {
    /// A picture from a camera. `arrived`: of what is there.
    pub(super) fn new(camera: Pose, view: View, arrived: bool) -> Self {
        Self { camera, view, asked: None, seen: 0, arrived }
    }

    /// Asks whether all of it has arrived. Without a stream nothing more does.
    pub(super) fn follow(&mut self, streaming: Option<&Streaming>) {
        let Some(streaming) = streaming else {
            self.arrived = true;
            return;
        };
        match self.asked.as_mut().map(Answer::take) {
            Some(Ok(None)) => return,
            Some(Ok(Some((is_seen, is_done)))) => {
                self.seen += u32::from(is_seen);
                self.arrived = self.seen > 1 && is_done;
            }
            Some(Err(_)) => self.arrived = true,
            None => {}
        }
        let view = self.view;
        let asked = streaming.ask(move |core| {
            let done = core.is_settled() || core.lacking_blobs().next().is_some();
            (core.view() == Some(view), done && !core.has_changes())
        });
        self.arrived |= asked.is_err();
        self.asked = asked.ok();
    }
}
