//! Observers of a run, such as the renderer of its pictures.

use lodestream_client::core::ClientCore;
use lodestream_protocol::Time;

use super::timeline::Sample;

/// Sees a run's core before and after each update and at the end. Virtual time stands still meanwhile, and the run is
/// not affected: an observer only takes decoded changes out of the core.
pub trait Observer: std::fmt::Debug {
    /// Called before an update at `now`; until then the core is as `last` describes it.
    fn before(&mut self, now: Time, core: &mut ClientCore, last: Sample);

    /// Called after an update of the core, which `now` describes.
    fn after(&mut self, core: &mut ClientCore, now: Sample);

    /// Called at the end of the run, settled or not; `last` describes the core at that time.
    fn end(&mut self, core: &mut ClientCore, last: Sample, settled: bool);
}
