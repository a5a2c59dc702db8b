//! The client of a simulated run: the shipped core with a camera path and an optional observer.

use std::future::Future;
use std::time::Duration;

use lodestream_client::Threads;
use lodestream_client::core::{ClientCore, Config, Decoders, Progress, QUALITIES_PX, StartView};
use lodestream_client::net::{Clock, Host};
use lodestream_protocol::Time;
use lodestream_scene::view::View;

use super::camera_drive::{CameraDrive, Phase, Reached};
use super::camera_path::CameraPath;
use super::computing::Computing;
use super::ledger::{Ledger, Use};
use super::observer::Observer;
use super::plan::ClientSettings;
use super::quality::note_quality;
use super::timeline::{Sample, Series, Stalls};

/// Time and bytes at which the client was settled.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Settled {
    pub(crate) after: Duration,
    pub(crate) bytes: u64,
}

/// The client of a run. It updates the core after every arrival, without a time budget: decoding takes no virtual time
/// unless the plan limits its rate. Leaves once it is settled with the camera at rest, or at the time limit.
#[derive(Debug)]
pub(crate) struct Viewer<'a> {
    core: ClientCore,
    computing: Computing,
    clock: Clock,
    limit: Time,
    drive: CameraDrive,
    /// Selections made before the camera came to rest.
    selections_before_rest: u64,
    rest_quality: [Option<Duration>; QUALITIES_PX.len()],
    rest_unoccluded_quality: [Option<Duration>; QUALITIES_PX.len()],
    settled: Option<Settled>,
    timed_out: bool,
    ended: Option<Time>,
    ledger: Ledger,
    pub(super) series: Series,
    pub(super) stalls: Stalls,
    /// The last sample.
    seen: Sample,
    observer: Option<&'a mut dyn Observer>,
}

impl<'a> Viewer<'a> {
    /// A client that calls connect now, watched by an observer if there is one.
    pub(crate) fn new(
        viewport_px: [u32; 2],
        client: ClientSettings,
        path: CameraPath,
        time_limit: Duration,
        observer: Option<&'a mut dyn Observer>,
    ) -> Self {
        let start = StartView::OfScene { viewport_px, target_px: client.target_px };
        Self::starting(start, viewport_px, client, path, time_limit, observer, Decoders::default())
    }

    /// The same in real time: nothing is drawn, so all processors decode.
    pub(crate) fn in_real_time(
        viewport_px: [u32; 2],
        client: ClientSettings,
        path: CameraPath,
        time_limit: Duration,
    ) -> Self {
        let start = StartView::OfScene { viewport_px, target_px: client.target_px };
        let decoders = Decoders::on_threads(Threads::all_cores());
        Self::starting(start, viewport_px, client, path, time_limit, None, decoders)
    }

    /// A client with a fixed camera.
    pub(super) fn at_pose(view: View, time_limit: Duration, observer: &'a mut dyn Observer) -> Self {
        let (start, path) = (StartView::Given(view), CameraPath::STILL);
        let client = ClientSettings::to(view.target_px);
        let (size, decoders) = (view.viewport_px, Decoders::default());
        Self::starting(start, size, client, path, time_limit, Some(observer), decoders)
    }

    fn starting(
        start: StartView,
        viewport_px: [u32; 2],
        client: ClientSettings,
        path: CameraPath,
        time_limit: Duration,
        observer: Option<&'a mut dyn Observer>,
        decoders: Decoders,
    ) -> Self {
        let mut config = Config::new(start);
        config.decoders = decoders;
        // Without an observer, textures are fetched and counted, but their pixels are not decoded. An observer takes
        // decoded pixels early enough that decoding never has to wait.
        config.track_changes = observer.is_some();
        config.max_waiting_bytes = usize::MAX;
        config.track_received = true;
        client.apply(&mut config);
        let mut core = ClientCore::new(config);
        let clock = Clock::start();
        core.begin(clock.now());
        Self {
            core,
            computing: Computing::new(client.splits_per_s),
            clock,
            limit: Time::from(time_limit),
            drive: CameraDrive::new(path, viewport_px, client.target_px),
            selections_before_rest: 0,
            rest_quality: [None; QUALITIES_PX.len()],
            rest_unoccluded_quality: [None; QUALITIES_PX.len()],
            settled: None,
            timed_out: false,
            ended: None,
            ledger: Ledger::default(),
            series: Series::default(),
            stalls: Stalls::default(),
            seen: Sample { at_ns: 0, bytes: 0, error_px: None, unoccluded_error_px: None },
            observer,
        }
    }

    pub(crate) fn clock(&self) -> Clock {
        self.clock
    }

    pub(crate) fn settled(&self) -> Option<Settled> {
        self.settled
    }

    /// Whether the time limit came before the client was settled.
    pub(crate) fn timed_out(&self) -> bool {
        self.timed_out
    }

    /// When a moving camera came to rest.
    pub(crate) fn rest(&self) -> Option<Time> {
        self.drive.rest()
    }

    /// Time from then until every visible part had a screen error of at most [`QUALITIES_PX`] pixels.
    pub(crate) fn rest_quality(&self) -> [Option<Duration>; QUALITIES_PX.len()] {
        self.rest_quality
    }

    /// The same over parts that are not occluded.
    pub(crate) fn rest_unoccluded_quality(&self) -> [Option<Duration>; QUALITIES_PX.len()] {
        self.rest_unoccluded_quality
    }

    /// Ends the session.
    pub(crate) fn end(&mut self) {
        let now = self.clock.now();
        self.ended = Some(now);
        self.stalls.end(now.min(self.limit));
        if let Some(observer) = &mut self.observer {
            let settled = self.settled;
            // A settled picture does not change while the session closes.
            let at_ns = settled.map_or(now.min(self.limit).as_ns(), |s| Time::from(s.after).as_ns());
            let bytes = settled.map_or(self.seen.bytes, |s| s.bytes);
            observer.end(&mut self.core, Sample { at_ns, bytes, ..self.seen }, settled.is_some());
        }
    }

    /// When the session ended.
    pub(crate) fn ended(&self) -> Option<Time> {
        self.ended
    }

    /// Use of the received chunk bytes.
    pub(crate) fn usage(&self) -> Use {
        self.ledger.close(&self.core)
    }

    /// Milestones that the path may wait for, once the scene is known.
    fn reached(&self) -> Option<Reached> {
        self.core.scene().map(|_| Reached {
            first_frame: self.core.milestones().first_frame.is_some(),
            settled: self.core.is_settled(),
        })
    }

    /// Updates the camera.
    fn move_camera(&mut self, now: Time) {
        let start = self.core.scene().map(|header| header.camera);
        let Some((start, reached)) = start.zip(self.reached()) else { return };
        let Some(view) = self.drive.advance(now, &start, reached) else { return };
        // The same view is already selected for.
        let news = self.core.view() != Some(view);
        self.core.set_view(now, view);
        let seen = self.core.last_selection().0;
        self.selections_before_rest = if news { seen } else { seen.saturating_sub(1) };
    }

    /// Records the result of the last update.
    fn observe(&mut self, now: Time) {
        self.ledger.observe(&self.core);
        let (number, selection) = self.core.last_selection();
        let counters = selection.counters;
        let bytes = self.core.received_bytes();
        let drawn = self.core.milestones().first_frame.is_some();
        let complete = drawn && counters.drawable_instances >= counters.visible_instances;
        let error_px = Some(counters.max_screen_error_px).filter(|px| complete && px.is_finite());
        let unoccluded_error_px = error_px.and(Some(counters.unoccluded_screen_error_px));
        self.seen = Sample { at_ns: now.as_ns(), bytes, error_px, unoccluded_error_px };
        self.series.push(self.seen);
        if drawn {
            self.stalls.observe(now, bytes, !counters.settled);
        }
        // A selection of an earlier view says nothing about this one.
        let of_this_view = match self.drive.phase() {
            Phase::Waiting => !self.drive.moves(),
            Phase::Moving { .. } => false,
            Phase::Resting { since } => {
                let seen = number > self.selections_before_rest;
                if let Some(error_px) = error_px.filter(|_| seen) {
                    note_quality(&mut self.rest_quality, error_px, now.since(since));
                    note_quality(
                        &mut self.rest_unoccluded_quality,
                        counters.unoccluded_screen_error_px,
                        now.since(since),
                    );
                }
                seen
            }
        };
        if self.settled.is_none() && of_this_view && self.core.is_settled() {
            let first = self.core.stats().settled_after.filter(|_| !self.drive.moves());
            self.settled = Some(Settled { after: first.unwrap_or(Duration::from(now)), bytes });
        }
        self.timed_out = self.settled.is_none() && now >= self.limit;
    }
}

impl Host for Viewer<'_> {
    fn core(&mut self) -> &mut ClientCore {
        &mut self.core
    }

    fn turn(&mut self, now: Time) -> Progress {
        if let Some(observer) = &mut self.observer {
            observer.before(now, &mut self.core, self.seen);
        }
        self.move_camera(now);
        let progress = self.computing.turn(&mut self.core, now);
        self.observe(now);
        if let Some(observer) = &mut self.observer {
            observer.after(&mut self.core, self.seen);
        }
        progress
    }

    fn wake(&mut self) -> impl Future<Output = ()> {
        let until = if self.wants_to_leave() {
            // The transport sends the last messages.
            None
        } else {
            let now = self.clock.now();
            let moves = self.drive.next_move(now, self.reached());
            [moves, self.computing.next(now), Some(self.limit)].into_iter().flatten().min()
        };
        let clock = self.clock;
        async move {
            match until {
                Some(until) => {
                    let left = Duration::from(until).saturating_sub(Duration::from(clock.now()));
                    tokio::time::sleep(left).await;
                }
                None => std::future::pending().await,
            }
        }
    }

    fn wants_to_leave(&self) -> bool {
        self.settled.is_some() || self.timed_out
    }
}
