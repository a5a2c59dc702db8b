//! Who looks on while a run goes, as who draws its pictures does.

use lodestream_client::core::ClientCore;
use lodestream_protocol::Time;

use super::timeline::Sample;

/// Sees a run's core before and after each update and at the end. Virtual time stands still meanwhile, and the run goes
/// on as if nobody had looked: an observer takes decoded changes out of the core and does nothing else to it.
pub trait Observer: std::fmt::Debug {
    /// Before anything happens to the core at a time: until then it is as the last sample describes it.
    fn before(&mut self, now: Time, core: &mut ClientCore, last: Sample);

    /// After an update of the core, which the sample describes.
    fn after(&mut self, core: &mut ClientCore, now: Sample);

    /// The run is over, settled or not; the sample describes the core at that time.
    fn end(&mut self, core: &mut ClientCore, last: Sample, settled: bool);
}
