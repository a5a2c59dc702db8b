//! The streaming thread of a viewer: network, session, decoding and refinement, away from the thread that
//! draws. Everything between the two is bounded: the newest view wins, steps of changes wait until there
//! is room, the newest status replaces the last.

use std::future::Future;
use std::thread::JoinHandle;
use std::time::Duration;

use lodestream_protocol::message::Token;
use lodestream_protocol::time::Time;
use lodestream_scene::view::View;
use tokio::sync::{mpsc, watch};
use tokio::time::sleep;

use crate::core::{Change, ClientCore, Config, Progress, Stats};
use crate::net::{Clock, End, Host, Retry, Server, stream};

/// Payload bytes decoded between two looks at the network: about 5 ms of work.
const SLICE_BYTES: u64 = 16 * 1024;
/// Bytes of changes in one step: what a frame takes, so that what was refined first does not wait for more.
const STEP_BYTES: usize = 512 << 10;
/// Steps that may wait for the renderer.
const MAX_STEPS: usize = 8;
/// What is said of a server that does not answer while its connection is not given up.
const SILENT: &str = "the server does not answer; waiting for it";
/// Time between two statuses.
const STATUS_INTERVAL: Duration = Duration::from_millis(50);

/// What the drawing side asks for.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Controls {
    /// The camera; `None`: as the configuration says.
    pub view: Option<View>,
    /// Whether what casts shadows into view from out of it is refined too; `None`: as the configuration says.
    pub shadows: Option<bool>,
    /// End the session and the thread.
    pub leave: bool,
}

/// What the streaming side reports.
#[derive(Clone, Debug, Default)]
pub struct Status {
    /// Counters.
    pub stats: Stats,
    /// What a user should know: no connection, and what is done about it.
    pub message: Option<String>,
    /// The picture is settled and all of it was handed over.
    pub settled: bool,
    /// Why the thread has ended, once it has.
    pub end: Option<End>,
}

/// Where newer tokens are shown ([`Streaming::tokens`]); it may outlive the streaming.
#[derive(Clone, Debug)]
pub struct Tokens(watch::Sender<Option<Token>>);

impl Tokens {
    /// Shows a token in the session that runs and in those after it, unless it is the one that was shown last.
    pub fn show(&self, token: Token) {
        self.0.send_if_modified(|last| {
            let new = last.as_ref() != Some(&token);
            *last = Some(token);
            new
        });
    }

    /// Whether nobody takes tokens any more: the streaming has ended.
    #[must_use]
    pub fn is_closed(&self) -> bool {
        self.0.is_closed()
    }
}

/// Handle of the thread; dropping it ends the session.
#[derive(Debug)]
pub struct Streaming {
    controls: watch::Sender<Controls>,
    tokens: Tokens,
    status: watch::Receiver<Status>,
    steps: mpsc::Receiver<Vec<Change>>,
    clock: Clock,
    thread: Option<JoinHandle<()>>,
}

impl Streaming {
    /// Starts to stream from a server; an address that is parsed will do for one. `notify` is called on the streaming
    /// thread when there is something new to take or a new status.
    ///
    /// # Errors
    /// Fails where the system gives no thread.
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
        // Sockets are served on a thread of their own, so that decoding does not delay them.
        let runtime = tokio::runtime::Builder::new_multi_thread()
            .worker_threads(1)
            .thread_name("network")
            .enable_all()
            .build()?;
        let mut host = StreamHost {
            core: ClientCore::new(config),
            controls: controls_receiver,
            tokens: tokens_receiver,
            steps: Some(step_sender),
            status: status_sender,
            message: Some(format!("connecting to {}", server.address)),
            reported: None,
            notify,
            left: false,
        };
        let thread = std::thread::Builder::new().name("streaming".into()).spawn(move || {
            let end = runtime.block_on(stream(&server, &mut host, clock, retry, StreamHost::set_message));
            host.report(clock.now(), Some(end));
            runtime.shutdown_timeout(Duration::from_millis(200));
        })?;
        Ok(Self { controls, tokens: Tokens(tokens), status, steps, clock, thread: Some(thread) })
    }

    /// The clock of all times in statuses and changes.
    #[must_use]
    pub const fn clock(&self) -> Clock {
        self.clock
    }

    /// Changes what is asked for; the streaming thread sees the newest only.
    pub fn control(&self, controls: Controls) {
        self.controls.send_if_modified(|old| std::mem::replace(old, controls) != controls);
    }

    /// Takes newer tokens than that of the configuration, from any thread.
    #[must_use]
    pub fn tokens(&self) -> Tokens {
        self.tokens.clone()
    }

    /// The newest status.
    #[must_use]
    pub fn status(&self) -> Status {
        self.status.borrow().clone()
    }

    /// The next step of changes, if one waits.
    pub fn take(&mut self) -> Option<Vec<Change>> {
        self.steps.try_recv().ok()
    }
}

impl Drop for Streaming {
    fn drop(&mut self) {
        self.controls.send_modify(|controls| controls.leave = true);
        self.steps.close();
        if let Some(thread) = self.thread.take() {
            // The thread says goodbye within bounded time; a panic there was reported already.
            let _ = thread.join();
        }
    }
}

struct StreamHost<N> {
    core: ClientCore,
    controls: watch::Receiver<Controls>,
    tokens: watch::Receiver<Option<Token>>,
    /// `None` once nobody takes steps any more.
    steps: Option<mpsc::Sender<Vec<Change>>>,
    status: watch::Sender<Status>,
    message: Option<String>,
    reported: Option<Time>,
    notify: N,
    left: bool,
}

impl<N: Fn()> StreamHost<N> {
    fn set_message(&mut self, message: Option<String>) {
        self.message = message;
        self.reported = None;
    }

    /// Hands steps over while there is room.
    fn publish(&mut self, now: Time) {
        let (mut published, mut nobody) = (false, false);
        while let Some(steps) = &self.steps
            && self.core.has_changes()
            && !nobody
        {
            match steps.try_reserve() {
                Ok(permit) => {
                    permit.send(self.core.take_changes(now, STEP_BYTES));
                    published = true;
                }
                Err(mpsc::error::TrySendError::Full(())) => break,
                Err(mpsc::error::TrySendError::Closed(())) => nobody = true,
            }
        }
        if nobody {
            self.steps = None;
        }
        if published {
            (self.notify)();
        }
    }

    fn report(&mut self, now: Time, end: Option<End>) {
        self.reported = Some(now);
        let mut stats = self.core.stats();
        let settled = stats.settled && !self.core.has_changes();
        if self.core.has_changes() {
            // What the renderer has not fetched yet is under way too.
            stats.lacking_blobs = 0;
            stats.lacking.clear();
        }
        self.status.send_replace(Status { stats, message: self.message.clone(), settled, end });
        (self.notify)();
    }

    fn report_due(&self) -> Option<Time> {
        self.reported.map(|at| at + STATUS_INTERVAL)
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
                self.left |= controls.leave;
                if let Some(view) = controls.view {
                    self.core.set_view(now, view);
                }
                if let Some(shadows) = controls.shadows {
                    self.core.set_shadows(shadows);
                }
            }
            Ok(false) => {}
            Err(_) => self.left = true,
        }
        if self.tokens.has_changed().unwrap_or(false)
            && let Some(token) = self.tokens.borrow_and_update().clone()
        {
            self.core.set_token(token);
        }
        let progress = self.core.update(now, SLICE_BYTES);
        self.publish(now);
        if self.core.is_open() {
            let told = self.message.is_some();
            self.message = self.core.silence(now).map(|_| SILENT.to_owned());
            if self.message.is_some() != told {
                self.reported = None;
            }
        }
        let settled = self.core.is_settled() && !self.core.has_changes();
        let news = settled != self.status.borrow().settled;
        if news || self.report_due().is_none_or(|due| now >= due) {
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
                        self.left = true;
                    } else {
                        // Seen by the next turn.
                        self.controls.mark_changed();
                    }
                }
                () = room => {}
                () = sleep(STATUS_INTERVAL) => {}
            }
        }
    }

    fn wants_to_leave(&self) -> bool {
        self.left
    }
}

#[cfg(test)]
mod tests;
