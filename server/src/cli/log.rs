//! The daemon's log on standard error. It never blocks: lines beyond the queue are dropped and counted.

use std::io::{IsTerminal as _, Write as _};
use std::sync::Arc;
use std::sync::mpsc::sync_channel;
use std::time::{Duration, Instant};

use tracing_appender::non_blocking::{ErrorCounter, NonBlocking, NonBlockingBuilder, WorkerGuard};
use tracing_subscriber::EnvFilter;
use tracing_subscriber::util::SubscriberInitExt as _;

use super::log_limit::LogLimit;
use super::log_lines::{Lines, LogFormat};

/// Most lines that wait to be written.
const MAX_LINES: usize = 1024;
/// Longest time that the program waits at its end for the log to be written.
const LAST_LINES: Duration = Duration::from_millis(1500);

/// A log that a thread writes. Dropping it waits until all lines are written, or for [`LAST_LINES`].
#[derive(Debug)]
pub(super) struct Log {
    lines: Arc<Lines>,
    writer: NonBlocking,
    dropped_lines: ErrorCounter,
    written: Option<WorkerGuard>,
}

impl Log {
    /// Starts the log. `RUST_LOG` sets the level (default: `info`, sessions and their ends).
    pub(super) fn to_stderr(format: LogFormat, limit: LogLimit) -> Self {
        let builder = NonBlockingBuilder::default().buffered_lines_limit(MAX_LINES).lossy(true);
        let (writer, written) = builder.finish(std::io::stderr());
        let dropped_lines = writer.error_counter();
        let filter = EnvFilter::try_from_default_env().unwrap_or_else(|_| EnvFilter::new("info"));
        let lines = Lines::new(format, limit, Instant::now);
        // Fails if the process has a log already; that one is used then.
        let _ = lines.log(filter, std::io::stderr().is_terminal(), writer.clone()).try_init();
        Self { lines, writer, dropped_lines, written: Some(written) }
    }

    /// The counter of lines that were dropped because the queue was full.
    pub(super) fn dropped_lines(&self) -> ErrorCounter {
        self.dropped_lines.clone()
    }
}

impl Drop for Log {
    fn drop(&mut self) {
        let Some(written) = self.written.take() else { return };
        let last = self.lines.last_words();
        if !last.is_empty() {
            // Does not block; lines without room in the queue are counted.
            let _ = self.writer.write_all(last.as_bytes());
        }
        let (done, ended) = sync_channel::<()>(1);
        // If nobody reads standard error, dropping the guard blocks. A thread of its own waits for it.
        let waiting = std::thread::Builder::new().spawn(move || {
            drop(written);
            drop(done);
        });
        if waiting.is_ok() {
            // Either the thread drops its end of the channel, or the time is over and the thread is left behind.
            let _ = ended.recv_timeout(LAST_LINES);
        }
    }
}
