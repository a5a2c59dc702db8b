//! State of the picture: whether it is final.

use lodestream_client::net::End;
use lodestream_client::streaming::Status;

/// State of the picture.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) enum State {
    /// It may change.
    #[default]
    Refining,
    /// It is as sharp as requested, and final.
    Settled,
    /// It is final, but lacks blobs that will not arrive.
    Incomplete,
}

/// Properties of the last frame.
#[derive(Clone, Copy, Debug)]
pub(super) struct FrameStatus {
    /// It showed the scene.
    pub(super) shows: bool,
    /// Vertices were morphing.
    pub(super) morphing: bool,
    /// Temporal averages were not complete.
    pub(super) unfinished: bool,
    /// It was drawn at full quality.
    pub(super) full: bool,
    /// Shadow maps that were out of date.
    pub(super) late_shadow_maps: u32,
    /// Steps not uploaded yet.
    pub(super) waiting_steps: usize,
    /// Terrain tiles replaced by coarser ones.
    pub(super) missing_tiles: usize,
}

impl FrameStatus {
    /// Whether it showed everything received and would look the same if drawn again.
    pub(super) const fn is_final(&self) -> bool {
        self.is_final_except_tiles()
            && !self.unfinished
            && self.late_shadow_maps == 0
            && self.missing_tiles == 0
    }

    /// As [`Self::is_final`], except for terrain tiles and averages over frames.
    pub(super) const fn is_final_except_tiles(&self) -> bool {
        !self.morphing && self.full && self.waiting_steps == 0
    }
}

impl State {
    /// The state after a frame. `presented`: a complete first frame has been shown. If a base mesh never arrives there
    /// is no such frame, and the picture is incomplete.
    pub(super) const fn of(status: &Status, drawn: &FrameStatus, presented: bool) -> Self {
        match (status.settled, status.stats.lacking_blobs) {
            _ if !drawn.shows || !drawn.is_final() => Self::Refining,
            (true, _) if presented => Self::Settled,
            // Counted only once no other blob is pending.
            (false, 1..) => Self::Incomplete,
            // Nothing more arrives after the session's end.
            (false, 0) if matches!(status.end, Some(End::Closed(_))) => Self::Incomplete,
            _ => Self::Refining,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use lodestream_client::core::Stats;
    use lodestream_protocol::message::{Close, CloseCode};

    const RESTING: FrameStatus = FrameStatus {
        shows: true,
        morphing: false,
        unfinished: false,
        full: true,
        late_shadow_maps: 0,
        waiting_steps: 0,
        missing_tiles: 0,
    };

    fn status(settled: bool, lacking_blobs: u64) -> Status {
        Status { settled, stats: Stats { lacking_blobs, ..Stats::default() }, ..Status::default() }
    }

    /// Missing terrain tiles, morphs and averages over frames count too.
    #[test]
    fn a_picture_that_will_change_is_neither_settled_nor_incomplete() {
        for (status, end) in [(status(true, 0), State::Settled), (status(false, 2), State::Incomplete)] {
            assert_eq!(State::of(&status, &RESTING, true), end);
            for (drawn, why) in [
                (FrameStatus { missing_tiles: 1, ..RESTING }, "a tile is being made"),
                (FrameStatus { shows: false, ..RESTING }, "nothing was shown"),
                (FrameStatus { morphing: true, ..RESTING }, "vertices move"),
                (FrameStatus { unfinished: true, ..RESTING }, "temporal averages are incomplete"),
                (FrameStatus { full: false, ..RESTING }, "the quality is reduced"),
                (FrameStatus { late_shadow_maps: 1, ..RESTING }, "a shadow is late"),
                (FrameStatus { waiting_steps: 1, ..RESTING }, "something is not uploaded"),
            ] {
                assert_eq!(State::of(&status, &drawn, true), State::Refining, "{end:?}: {why}");
            }
        }
        assert_eq!(State::of(&status(false, 0), &RESTING, true), State::Refining, "blobs are in flight");
    }

    /// Without that base mesh no first frame is ever complete, so the state must not wait for one.
    #[test]
    fn a_picture_without_a_base_mesh_is_incomplete_without_a_first_frame() {
        assert_eq!(State::of(&status(false, 1), &RESTING, false), State::Incomplete);
        assert_eq!(State::of(&status(true, 0), &RESTING, false), State::Refining);
    }

    /// Otherwise `--exit-when-settled` would wait for ever.
    #[test]
    fn a_picture_whose_session_ended_early_is_incomplete() {
        let closed = || Some(End::Closed(Close::new(CloseCode::Protocol, "the scene is gone")));
        let ended = |settled| Status { end: closed(), ..status(settled, 0) };
        assert_eq!(State::of(&ended(false), &RESTING, true), State::Incomplete);
        assert_eq!(State::of(&ended(true), &RESTING, true), State::Settled);
        let drawn = FrameStatus { waiting_steps: 1, ..RESTING };
        assert_eq!(State::of(&ended(false), &drawn, true), State::Refining);
    }
}
