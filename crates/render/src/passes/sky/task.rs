//! Computation of sky maps on its own thread.

use std::thread::JoinHandle;

use super::SkyMaps;
use crate::scene::environment::Environment;

/// A running computation of [`SkyMaps`].
#[derive(Debug)]
pub(crate) struct SkyTask(JoinHandle<SkyMaps>);

impl SkyTask {
    /// Starts the thread.
    ///
    /// # Errors
    /// If the system cannot start a thread.
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
