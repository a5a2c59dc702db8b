//! How far the picture is: what has to hold before the window says that it will not change.

use lodestream_client::net::End;
use lodestream_client::streaming::Status;

/// How far the picture is.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) enum State {
    /// It will change.
    #[default]
    Refining,
    /// It is as sharp as asked for and will stay as it is.
    Settled,
    /// It will stay as it is, but lacks something that does not come.
    Incomplete,
}

/// What the last frame was like.
#[derive(Clone, Copy, Debug)]
pub(super) struct Drawn {
    /// It was shown, with the scene in it.
    pub(super) shows: bool,
    /// Vertices were on their way to their places.
    pub(super) morphing: bool,
    /// The mean over frames, which smooths its edges, is of too few.
    pub(super) unfinished: bool,
    /// Nothing of its quality was given up.
    pub(super) full: bool,
    /// Maps of shadows that show things as they were.
    pub(super) late_shadow_maps: u32,
    /// Steps of the streaming thread that were not uploaded yet.
    pub(super) waiting_steps: usize,
    /// Terrain tiles in whose place coarser ones were drawn.
    pub(super) missing_tiles: usize,
}

impl Drawn {
    /// Whether it showed all that has come, and would look the same again.
    pub(super) const fn rests(&self) -> bool {
        self.lacks_tiles_at_most()
            && !self.unfinished
            && self.late_shadow_maps == 0
            && self.missing_tiles == 0
    }

    /// Whether it showed all that has come but for tiles of the terrain.
    pub(super) const fn lacks_tiles_at_most(&self) -> bool {
        !self.morphing && self.full && self.waiting_steps == 0
    }
}

impl State {
    /// The state after a frame. `presented`: a frame was shown that held everything of the first one. Where a base mesh
    /// does not come there never is such a frame, and the picture is incomplete without.
    pub(super) const fn of(status: &Status, drawn: &Drawn, presented: bool) -> Self {
        match (status.settled, status.stats.lacking_blobs) {
            _ if !drawn.shows || !drawn.rests() => Self::Refining,
            (true, _) if presented => Self::Settled,
            // They are counted only once nothing else is under way.
            (false, 1..) => Self::Incomplete,
            // What has not come does not come any more.
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

    const RESTING: Drawn = Drawn {
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

    /// Mountains changed for four seconds after it said "settled".
    #[test]
    fn no_picture_is_called_settled_or_incomplete_that_will_change() {
        for (status, end) in [(status(true, 0), State::Settled), (status(false, 2), State::Incomplete)] {
            assert_eq!(State::of(&status, &RESTING, true), end);
            for (drawn, why) in [
                (Drawn { missing_tiles: 1, ..RESTING }, "a tile is being made"),
                (Drawn { shows: false, ..RESTING }, "nothing was shown"),
                (Drawn { morphing: true, ..RESTING }, "vertices move"),
                (Drawn { unfinished: true, ..RESTING }, "edges are still smoothed"),
                (Drawn { full: false, ..RESTING }, "drawn worse than it could be"),
                (Drawn { late_shadow_maps: 1, ..RESTING }, "a shadow is late"),
                (Drawn { waiting_steps: 1, ..RESTING }, "something is not uploaded"),
            ] {
                assert_eq!(State::of(&status, &drawn, true), State::Refining, "{end:?}: {why}");
            }
        }
        assert_eq!(State::of(&status(false, 0), &RESTING, true), State::Refining, "something is under way");
    }

    /// It was called refining for ever, since a first frame that held everything was waited for.
    #[test]
    fn a_picture_that_lacks_a_base_mesh_for_good_is_incomplete_though_none_was_ever_whole() {
        assert_eq!(State::of(&status(false, 1), &RESTING, false), State::Incomplete);
        assert_eq!(State::of(&status(true, 0), &RESTING, false), State::Refining);
    }

    /// It was called refining for ever, and `--exit-when-settled` waited as long.
    #[test]
    fn a_picture_whose_session_was_ended_before_all_came_is_incomplete() {
        let closed = || Some(End::Closed(Close::new(CloseCode::Protocol, "the scene is gone")));
        let ended = |settled| Status { end: closed(), ..status(settled, 0) };
        assert_eq!(State::of(&ended(false), &RESTING, true), State::Incomplete);
        assert_eq!(State::of(&ended(true), &RESTING, true), State::Settled);
        let drawn = Drawn { waiting_steps: 1, ..RESTING };
        assert_eq!(State::of(&ended(false), &drawn, true), State::Refining);
    }
}
