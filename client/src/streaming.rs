//! Streaming on a thread of its own: network, session, decoding and refinement, apart from the thread that draws. All
//! channels between the two are bounded: the newest view replaces earlier ones, steps of changes wait for room, and the
//! newest status replaces the last.

mod questions;

use std::collections::BTreeMap;
use std::future::Future;
use std::thread::JoinHandle;
use std::time::Duration;

use lodestream_protocol::message::Token;
use lodestream_protocol::time::Time;
use lodestream_scene::animation::Moment;
use lodestream_scene::parts::{PartTransform, ScenePart};
use lodestream_scene::view::View;
use tokio::sync::{mpsc, watch};
use tokio::time::sleep;

use crate::core::{Change, ClientCore, Config, PartAnswer, Progress, Stats};
use crate::net::{Clock, End, Host, Retry, Server, stream};
use questions::{Asker, Questions};

pub use questions::{Answer, NoAnswer};

/// Payload bytes decoded between two polls of the network: about 5 ms of work.
const SLICE_BYTES: u64 = 16 * 1024;
/// Bytes of changes in one step: about one frame's uploads, so that early changes do not wait for later ones.
const STEP_BYTES: usize = 512 << 10;
/// Most steps that wait for the renderer.
const MAX_STEPS: usize = 8;
/// Most lookups of parts, and answers to them, between the two threads.
const MAX_LOOKUPS: usize = 256;
/// Status message for a server that does not answer while the connection is still open.
const SILENT: &str = "the server does not answer; waiting for it";
/// Interval of status reports.
const STATUS_INTERVAL: Duration = Duration::from_millis(50);

/// Requests of the drawing side.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Controls {
    /// The view; `None`: that of the configuration.
    pub view: Option<View>,
    /// Whether objects out of view that cast shadows into it are refined too; `None`: as configured.
    pub shadows: Option<bool>,
    /// Ends the session and the thread.
    pub leave: bool,
}

/// Report of the streaming side.
#[derive(Clone, Debug, Default)]
pub struct Status {
    /// Counters.
    pub stats: Stats,
    /// A connection problem and what is done about it, for users.
    pub message: Option<String>,
    /// Whether the picture is settled and all changes have been taken.
    pub settled: bool,
    /// Why streaming ended, once it has.
    pub end: Option<End>,
}

/// Parts, and where they are moved to.
type MovedParts = BTreeMap<ScenePart, PartTransform>;

/// Sets newer access tokens ([`Streaming::tokens`]) from any thread; it may outlive the streaming.
#[derive(Clone, Debug)]
pub struct Tokens(watch::Sender<Option<Token>>);

impl Tokens {
    /// Sets the token of the current and later sessions, unless it is the last one set.
    pub fn set(&self, token: Token) {
        self.0.send_if_modified(|last| {
            let new = last.as_ref() != Some(&token);
            *last = Some(token);
            new
        });
    }

    /// Whether streaming has ended, so that tokens have no effect.
    #[must_use]
    pub fn is_closed(&self) -> bool {
        self.0.is_closed()
    }
}

/// Handle of the streaming thread; dropping it ends the session.
#[derive(Debug)]
pub struct Streaming {
    controls: watch::Sender<Controls>,
    tokens: Tokens,
    status: watch::Receiver<Status>,
    steps: mpsc::Receiver<Vec<Change>>,
    lookups: mpsc::Sender<ScenePart>,
    pinned: watch::Sender<Vec<u32>>,
    moved: watch::Sender<MovedParts>,
    moment: watch::Sender<Option<Moment>>,
    parts: mpsc::Receiver<PartAnswer>,
    asker: Asker,
    clock: Clock,
    thread: Option<JoinHandle<()>>,
}

impl Streaming {
    /// Starts streaming from a server, which can be parsed from an address. `notify` is called on the streaming thread
    /// when there is a new step or status.
    ///
    /// # Errors
    /// The system provides no thread.
    pub fn start(
        server: Server,
        config: Config,
        retry: Retry,
        notify: impl Fn() + Send + 'static,
    ) -> std::io::Result<Self> {
        let clock = Clock::start();
        let (controls, controls_receiver) = watch::channel(Controls::default());
        let (tokens, tokens_receiver) = watch::channel(None);
        let (status_sender, status) = watch::channel(Status::default());
        let (step_sender, steps) = mpsc::channel(MAX_STEPS);
        let (pinned, pinned_receiver) = watch::channel(Vec::new());
        let (moved, moved_receiver) = watch::channel(MovedParts::new());
        let (moment, moment_receiver) = watch::channel(None);
        let (lookups, lookup_receiver) = mpsc::channel(MAX_LOOKUPS);
        let (part_sender, parts) = mpsc::channel(MAX_LOOKUPS);
        let (asker, questions) = questions::channel();
        // A thread of its own serves the sockets, so that decoding does not delay them.
        let runtime = tokio::runtime::Builder::new_multi_thread()
            .worker_threads(1)
            .thread_name("network")
            .enable_all()
            .build()?;
        let mut host = StreamHost {
            core: ClientCore::new(config),
            controls: controls_receiver,
            tokens: tokens_receiver,
            questions,
            steps: Some(step_sender),
            pinned: pinned_receiver,
            moved: moved_receiver,
            moment: moment_receiver,
            lookups: lookup_receiver,
            next_lookup: None,
            parts: part_sender,
            status: status_sender,
            message: Some(format!("connecting to {}", server.address)),
            reported_at: None,
            notify,
            leaves: false,
        };
        let thread = std::thread::Builder::new().name("streaming".into()).spawn(move || {
            let end = runtime.block_on(stream(&server, &mut host, clock, retry, StreamHost::set_message));
            host.report(clock.now(), Some(end));
            runtime.shutdown_timeout(Duration::from_millis(200));
        })?;
        Ok(Self {
            controls,
            tokens: Tokens(tokens),
            status,
            steps,
            lookups,
            pinned,
            moved,
            moment,
            parts,
            asker,
            clock,
            thread: Some(thread),
        })
    }

    /// The clock of all times in statuses and changes.
    #[must_use]
    pub const fn clock(&self) -> Clock {
        self.clock
    }

    /// Sets the controls; the streaming thread sees only the newest.
    pub fn control(&self, controls: Controls) {
        self.controls.send_if_modified(|old| std::mem::replace(old, controls) != controls);
    }

    /// Sets the instances for which no proxy may stand ([`ClientCore::pin_instances`]): those with parts of which something
    /// is hidden, tinted or isolated.
    pub fn pin_instances(&self, instances: Vec<u32>) {
        self.pinned.send_if_modified(|old| {
            let new = *old != instances;
            *old = instances;
            new
        });
    }

    /// Sets which parts are moved within their instances ([`ClientCore::move_parts`]).
    pub fn move_parts(&self, moved: BTreeMap<ScenePart, PartTransform>) {
        self.moved.send_if_modified(|old| {
            let new = *old != moved;
            *old = moved;
            new
        });
    }

    /// Sets at which clip and time animated instances are ([`ClientCore::animate`]).
    pub fn animate(&self, moment: Option<Moment>) {
        self.moment.send_if_modified(|old| {
            let new = *old != moment;
            *old = moment;
            new
        });
    }

    /// Asks the core something, such as [`ClientCore::pick`]. `notify` is called once it is answered. The streaming
    /// thread does nothing else meanwhile.
    ///
    /// # Errors
    /// Streaming has ended, or sixteen questions wait.
    pub fn ask<T: Send + 'static>(
        &self,
        question: impl FnOnce(&ClientCore) -> T + Send + 'static,
    ) -> Result<Answer<T>, NoAnswer> {
        self.asker.ask(question)
    }

    /// A handle to set newer tokens than the configuration's.
    #[must_use]
    pub fn tokens(&self) -> Tokens {
        self.tokens.clone()
    }

    /// The newest status.
    #[must_use]
    pub fn status(&self) -> Status {
        self.status.borrow().clone()
    }

    /// Looks up what a part is called ([`ClientCore::look_up_part`]); [`Streaming::take_part`] gives the answer. Returns
    /// `false`, and nothing follows, if streaming has ended or 256 lookups have not been noticed yet.
    #[must_use]
    pub fn look_up_part(&self, id: ScenePart) -> bool {
        self.lookups.try_send(id).is_ok()
    }

    /// Takes the next answer to a lookup, if there is one. `notify` is called for each.
    pub fn take_part(&mut self) -> Option<PartAnswer> {
        self.parts.try_recv().ok()
    }

    /// Takes the next step of changes, if there is one.
    pub fn take(&mut self) -> Option<Vec<Change>> {
        self.steps.try_recv().ok()
    }
}

impl Drop for Streaming {
    fn drop(&mut self) {
        self.controls.send_modify(|controls| controls.leave = true);
        self.steps.close();
        if let Some(thread) = self.thread.take() {
            // The thread closes the session within bounded time; a panic there has been reported already.
            let _ = thread.join();
        }
    }
}

struct StreamHost<N> {
    core: ClientCore,
    controls: watch::Receiver<Controls>,
    tokens: watch::Receiver<Option<Token>>,
    questions: Questions,
    pinned: watch::Receiver<Vec<u32>>,
    moved: watch::Receiver<MovedParts>,
    moment: watch::Receiver<Option<Moment>>,
    /// `None` once the receiver is dropped.
    steps: Option<mpsc::Sender<Vec<Change>>>,
    lookups: mpsc::Receiver<ScenePart>,
    /// One that woke the thread.
    next_lookup: Option<ScenePart>,
    parts: mpsc::Sender<PartAnswer>,
    status: watch::Sender<Status>,
    message: Option<String>,
    reported_at: Option<Time>,
    notify: N,
    leaves: bool,
}

impl<N: Fn()> StreamHost<N> {
    fn set_message(&mut self, message: Option<String>) {
        self.message = message;
        self.reported_at = None;
    }

    /// Sends steps of changes while there is room.
    fn publish(&mut self, now: Time) {
        let (mut published, mut is_closed) = (false, false);
        while let Some(steps) = &self.steps
            && self.core.has_changes()
            && !is_closed
        {
            match steps.try_reserve() {
                Ok(permit) => {
                    permit.send(self.core.take_changes(now, STEP_BYTES));
                    published = true;
                }
                Err(mpsc::error::TrySendError::Full(())) => break,
                Err(mpsc::error::TrySendError::Closed(())) => is_closed = true,
            }
        }
        if is_closed {
            self.steps = None;
        }
        if published {
            (self.notify)();
        }
    }

    /// Passes lookups to the core, and its answers back while there is room. The others wait in the core.
    fn look_up(&mut self, now: Time) {
        while let Some(id) = self.next_lookup.take().or_else(|| self.lookups.try_recv().ok()) {
            self.core.look_up_part(now, id);
        }
        while let Ok(permit) = self.parts.try_reserve()
            && let Some(answer) = self.core.take_part()
        {
            permit.send(answer);
            (self.notify)();
        }
    }

    fn report(&mut self, now: Time, end: Option<End>) {
        self.reported_at = Some(now);
        let mut stats = self.core.stats();
        let settled = stats.settled && !self.core.has_changes();
        if self.core.has_changes() {
            // Changes that the renderer has not taken count as pending.
            stats.lacking_blobs = 0;
            stats.lacking.clear();
        }
        self.status.send_replace(Status { stats, message: self.message.clone(), settled, end });
        (self.notify)();
    }

    fn report_due(&self) -> Option<Time> {
        self.reported_at.map(|at| at + STATUS_INTERVAL)
    }
}

impl<N: Fn()> Host for StreamHost<N> {
    fn core(&mut self) -> &mut ClientCore {
        &mut self.core
    }

    fn turn(&mut self, now: Time) -> Progress {
        match self.controls.has_changed() {
            Ok(true) => {
                let controls = *self.controls.borrow_and_update();
                self.leaves |= controls.leave;
                if let Some(view) = controls.view {
                    self.core.set_view(now, view);
                }
                if let Some(shadows) = controls.shadows {
                    self.core.set_shadows(shadows);
                }
            }
            Ok(false) => {}
            Err(_) => self.leaves = true,
        }
        if self.tokens.has_changed().unwrap_or(false)
            && let Some(token) = self.tokens.borrow_and_update().clone()
        {
            self.core.set_token(token);
        }
        if self.pinned.has_changed().unwrap_or(false) {
            self.core.pin_instances(&self.pinned.borrow_and_update());
        }
        if self.moved.has_changed().unwrap_or(false) {
            self.core.move_parts(&self.moved.borrow_and_update());
        }
        if self.moment.has_changed().unwrap_or(false) {
            let moment = self.moment.borrow_and_update().clone();
            self.core.animate(moment);
        }
        self.look_up(now);
        if self.questions.answer(&self.core) {
            (self.notify)();
        }
        let progress = self.core.update(now, SLICE_BYTES);
        self.publish(now);
        if self.core.is_open() {
            let was_silent = self.message.is_some();
            let silent = self.core.silence(now).map(|_| SILENT);
            self.message = self.core.trouble().or(silent).map(str::to_owned);
            if self.message.is_some() != was_silent {
                self.reported_at = None;
            }
        }
        let settled = self.core.is_settled() && !self.core.has_changes();
        let changed = settled != self.status.borrow().settled;
        if changed || self.report_due().is_none_or(|due| now >= due) {
            self.report(now, None);
        }
        progress
    }

    fn wake(&mut self) -> impl Future<Output = ()> {
        let waiting = self.core.has_changes();
        async move {
            let room = async {
                match (&self.steps, waiting) {
                    (Some(steps), true) => drop(steps.reserve().await),
                    _ => std::future::pending().await,
                }
            };
            tokio::select! {
                biased;
                changed = self.controls.changed() => {
                    if changed.is_err() {
                        self.leaves = true;
                    } else {
                        // The next turn reads them.
                        self.controls.mark_changed();
                    }
                }
                Some(id) = self.lookups.recv() => self.next_lookup = Some(id),
                () = room => {}
                () = self.questions.wait() => {}
                () = sleep(STATUS_INTERVAL) => {}
            }
        }
    }

    fn wants_to_leave(&self) -> bool {
        self.leaves
    }
}

#[cfg(test)]
mod tests;
