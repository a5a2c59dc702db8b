//! Signals that end the daemon.

use std::future::Future;

use anyhow::Context;
use tokio::sync::watch;

/// SIGINT and SIGTERM (on other systems than Unix: Ctrl-C). Each call of [`Signals::next`] resolves with
/// the next one that comes. SIGHUP ends nothing: files are read anew, and a terminal that is closed is no wish of who runs
/// the server.
#[derive(Debug)]
pub(crate) struct Signals {
    reloads: Option<watch::Sender<u64>>,
    #[cfg(unix)]
    interrupt: tokio::signal::unix::Signal,
    #[cfg(unix)]
    terminate: tokio::signal::unix::Signal,
    #[cfg(unix)]
    hangup: tokio::signal::unix::Signal,
}

impl Signals {
    /// Begins to listen; from here on the signals no longer end the process by themselves.
    pub(crate) fn listen() -> anyhow::Result<Self> {
        #[cfg(unix)]
        {
            use tokio::signal::unix::{SignalKind, signal};
            let listen = |kind| signal(kind).context("cannot listen for signals");
            Ok(Self {
                reloads: None,
                interrupt: listen(SignalKind::interrupt())?,
                terminate: listen(SignalKind::terminate())?,
                hangup: listen(SignalKind::hangup())?,
            })
        }
        #[cfg(not(unix))]
        Ok(Self { reloads: None })
    }

    /// Has SIGHUP counted there, for those who read files anew.
    pub(crate) fn on_hangup(&mut self, reloads: watch::Sender<u64>) {
        self.reloads = Some(reloads);
    }

    #[cfg(unix)]
    fn hung_up(&self) {
        match self.reloads.as_ref().filter(|reloads| reloads.receiver_count() > 0) {
            Some(reloads) => {
                tracing::info!("SIGHUP: files are read anew");
                reloads.send_modify(|count| *count = count.wrapping_add(1));
            }
            None => tracing::info!("SIGHUP: nothing is read anew; going on"),
        }
    }
}

/// Asks to end the daemon: the first time in good order, the second time at once.
pub trait StopRequests: Send {
    /// Resolves when the daemon is asked to end.
    fn next(&mut self) -> impl Future<Output = ()> + Send;
}

impl StopRequests for Signals {
    async fn next(&mut self) {
        #[cfg(unix)]
        loop {
            tokio::select! {
                biased;
                _ = self.interrupt.recv() => break,
                _ = self.terminate.recv() => break,
                Some(()) = self.hangup.recv() => self.hung_up(),
            }
        }
        #[cfg(not(unix))]
        if tokio::signal::ctrl_c().await.is_err() {
            std::future::pending::<()>().await;
        }
    }
}

impl StopRequests for tokio::sync::mpsc::Receiver<()> {
    async fn next(&mut self) {
        if self.recv().await.is_none() {
            std::future::pending::<()>().await;
        }
    }
}
