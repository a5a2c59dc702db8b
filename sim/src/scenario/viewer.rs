//! The client of a simulated run: the shipped core, without graphics.

use std::future::Future;
use std::time::Duration;

use lodestream_client::core::{ClientCore, Config, Progress, StartView};
use lodestream_client::net::{Clock, Host};
use lodestream_protocol::Time;

/// How a run ended, as seen by the client.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Settled {
    pub(super) after: Duration,
    pub(super) bytes: u64,
}

/// Runs the core after everything that arrives, without a budget: decoding and applying take no virtual
/// time. Leaves once nothing more is wanted, or at the time limit.
#[derive(Debug)]
pub(super) struct Viewer {
    core: ClientCore,
    clock: Clock,
    limit: Time,
    settled: Option<Settled>,
    gave_up: bool,
}

impl Viewer {
    /// A client that calls connect now.
    pub(super) fn new(viewport_px: [u32; 2], target_px: f32, time_limit: Duration) -> Self {
        let mut config = Config::new(StartView::OfScene { viewport_px, target_px });
        // Nobody draws: textures are fetched and counted, but their pixels are not decoded.
        config.track_changes = false;
        let mut core = ClientCore::new(config);
        let clock = Clock::start();
        core.begin(clock.now());
        Self { core, clock, limit: Time::from(time_limit), settled: None, gave_up: false }
    }

    pub(super) fn clock(&self) -> Clock {
        self.clock
    }

    pub(super) fn settled(&self) -> Option<Settled> {
        self.settled
    }

    /// Whether the time limit came before the picture was settled.
    pub(super) fn gave_up(&self) -> bool {
        self.gave_up
    }
}

impl Host for Viewer {
    fn core(&mut self) -> &mut ClientCore {
        &mut self.core
    }

    fn turn(&mut self, now: Time) -> Progress {
        let progress = self.core.update(now, u64::MAX);
        if self.settled.is_none() && self.core.is_settled() {
            let stats = self.core.stats();
            let after = stats.settled_after.unwrap_or(Duration::from(now));
            self.settled = Some(Settled { after, bytes: stats.transport_bytes });
        }
        self.gave_up = self.settled.is_none() && now >= self.limit;
        progress
    }

    fn wake(&mut self) -> impl Future<Output = ()> {
        let limit = self.limit;
        let left = Duration::from(limit).saturating_sub(Duration::from(self.clock.now()));
        tokio::time::sleep(left)
    }

    fn wants_to_leave(&self) -> bool {
        self.settled.is_some() || self.gave_up
    }
}
