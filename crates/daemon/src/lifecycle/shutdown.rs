//! Signals that stop the daemon or reload its files.

use std::future::Future;

use anyhow::Context;
use tokio::sync::watch;

/// SIGINT and SIGTERM (outside Unix: Ctrl-C); [`Signals::next`] resolves with each. SIGHUP reloads files and does not stop
/// the server, not even when a terminal closes.
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
    /// Installs the handlers; from now on the signals no longer end the process.
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

    /// Sets the counter that SIGHUP increments, which the reloading tasks watch.
    pub(crate) fn on_hangup(&mut self, reloads: watch::Sender<u64>) {
        self.reloads = Some(reloads);
    }

    #[cfg(unix)]
    fn request_reload(&self) {
        match self.reloads.as_ref().filter(|reloads| reloads.receiver_count() > 0) {
            Some(reloads) => {
                tracing::info!("SIGHUP: reloading files");
                reloads.send_modify(|count| *count = count.wrapping_add(1));
            }
            None => tracing::info!("SIGHUP: nothing to reload"),
        }
    }
}

/// Requests to stop the daemon: the first drains it, the second stops it at once.
pub trait StopRequests: Send {
    /// Resolves with the next request.
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
                Some(()) = self.hangup.recv() => self.request_reload(),
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
