//! Maps of a sky that a thread of their own computes.

use std::thread::JoinHandle;

use super::SkyMaps;
use crate::scene::environment::Environment;

/// What will be [`SkyMaps`].
#[derive(Debug)]
pub(crate) struct SkyTask(JoinHandle<SkyMaps>);

impl SkyTask {
    /// Begins.
    ///
    /// # Errors
    /// Fails where the system gives no thread.
    pub(crate) fn start(environment: Environment) -> std::io::Result<Self> {
        let thread = std::thread::Builder::new().name("sky".into());
        Ok(Self(thread.spawn(move || SkyMaps::new(&environment))?))
    }

    pub(crate) fn is_finished(&self) -> bool {
        self.0.is_finished()
    }

    /// Waits for the maps; `None` if computing them failed.
    pub(crate) fn finish(self) -> Option<SkyMaps> {
        self.0.join().ok()
    }
}
