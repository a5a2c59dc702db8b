//! Progress of a plan: a line per run on standard output, a bar on standard error.

use std::fmt::Display;

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};

/// Shows the progress of a plan.
pub(crate) struct Progress {
    bar: ProgressBar,
    quiet: bool,
}

impl Progress {
    /// Progress of a number of runs; nothing is shown if `quiet`, and no bar
    /// if standard error is no terminal.
    pub(crate) fn new(runs: usize, quiet: bool) -> Self {
        let target =
            if quiet { ProgressDrawTarget::hidden() } else { ProgressDrawTarget::stderr_with_hz(10) };
        let bar = ProgressBar::with_draw_target(Some(runs as u64), target);
        let style = ProgressStyle::with_template("[{bar:30}] {pos}/{len} runs, {eta} left");
        bar.set_style(style.unwrap_or_else(|_| ProgressStyle::default_bar()));
        Self { bar, quiet }
    }

    /// Reports a finished run.
    pub(crate) fn line(&self, result: &impl Display) {
        if !self.quiet {
            self.bar.suspend(|| println!("{result}"));
        }
        self.bar.inc(1);
    }

    /// Removes the bar.
    pub(crate) fn finish(&self) {
        self.bar.finish_and_clear();
    }
}
