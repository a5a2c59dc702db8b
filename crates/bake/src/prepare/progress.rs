//! Display of a preparation's progress: a bar on a terminal, else an occasional line.

use std::fmt;
use std::io::IsTerminal as _;
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use crate::stderr::write_line;
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressState, ProgressStyle};
use lodestream_geometry::pool::{Monitor, Progress};

type Watcher = dyn Fn(&str, Progress) -> bool + Send + Sync;

/// Interval between lines without a terminal.
const LINE_INTERVAL: Duration = Duration::from_secs(5);

/// Follows preparations: is called with an asset's name and progress, by any thread, and cancels by returning `false`.
#[derive(Clone)]
pub struct Watch(Arc<Watcher>);

impl Watch {
    /// A watch that calls this.
    #[must_use]
    pub fn new(watcher: impl Fn(&str, Progress) -> bool + Send + Sync + 'static) -> Self {
        Self(Arc::new(watcher))
    }
}

impl fmt::Debug for Watch {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("Watch")
    }
}

/// Shows the progress of one asset on standard error.
pub struct Reporter {
    name: String,
    start: Instant,
    display: Display,
    watch: Option<Watch>,
}

enum Display {
    Nothing,
    Bar(ProgressBar),
    /// When the last line was written.
    Lines(Mutex<Instant>),
}

impl Reporter {
    /// A reporter for the asset of this name; `quiet` disables the display, `watch` is told as well.
    #[must_use]
    pub fn new(name: &str, quiet: bool, watch: Option<Watch>) -> Self {
        let start = Instant::now();
        let display = if quiet {
            Display::Nothing
        } else if std::io::stderr().is_terminal() {
            let bar = ProgressBar::with_draw_target(Some(0), ProgressDrawTarget::stderr_with_hz(10));
            bar.set_style(style());
            bar.set_prefix(name.to_owned());
            Display::Bar(bar)
        } else {
            Display::Lines(Mutex::new(start))
        };
        Self { name: name.to_owned(), start, display, watch }
    }

    /// Removes the bar when the asset is done or has failed.
    pub fn finish(&self) {
        if let Display::Bar(bar) = &self.display {
            bar.finish_and_clear();
        }
    }

    fn line(&self, last: &Mutex<Instant>, progress: Progress) {
        let now = Instant::now();
        let Ok(mut last) = last.lock() else { return };
        if now.duration_since(*last) < LINE_INTERVAL {
            return;
        }
        *last = now;
        write_line(format_args!("{}", describe(&self.name, progress, now.duration_since(self.start))));
    }
}

impl Monitor for Reporter {
    fn report(&self, progress: Progress) -> bool {
        match &self.display {
            Display::Nothing => {}
            Display::Bar(bar) => {
                bar.set_length(progress.faces_total as u64);
                bar.set_position(progress.faces_done as u64);
                let rate = rate(progress.collapses, self.start.elapsed());
                bar.set_message(format!("{rate} collapses/s"));
            }
            Display::Lines(last) => self.line(last, progress),
        }
        self.watch.as_ref().is_none_or(|watch| (watch.0)(&self.name, progress))
    }
}

fn style() -> ProgressStyle {
    let template = "{prefix:20!} [{bar:30}] {pos}/{len} faces, {msg}, {eta_known}";
    ProgressStyle::with_template(template).unwrap_or_else(|_| ProgressStyle::default_bar()).with_key(
        "eta_known",
        |state: &ProgressState, out: &mut dyn std::fmt::Write| {
            let _ = if state.pos() == 0 {
                write!(out, "starting")
            } else {
                write!(out, "{} s left", state.eta().as_secs())
            };
        },
    )
}

fn rate(collapses: usize, elapsed: Duration) -> u64 {
    let seconds = elapsed.as_secs_f64();
    if seconds > 0.0 { (collapses as f64 / seconds) as u64 } else { 0 }
}

fn describe(name: &str, progress: Progress, elapsed: Duration) -> String {
    let Progress { stage: _, faces_done, faces_total, collapses } = progress;
    let rate = rate(collapses, elapsed);
    let left = if faces_done > 0 {
        let per_face = elapsed.as_secs_f64() / faces_done as f64;
        format!("{:.0} s left", per_face * faces_total.saturating_sub(faces_done) as f64)
    } else {
        "starting".to_owned()
    };
    format!("{name}: {faces_done}/{faces_total} faces, {rate} collapses/s, {left}")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_tell_faces_rate_and_time_left() {
        let progress = Progress { faces_done: 250, faces_total: 1000, collapses: 500, ..Progress::default() };
        assert_eq!(
            describe("bunny", progress, Duration::from_secs(2)),
            "bunny: 250/1000 faces, 250 collapses/s, 6 s left"
        );
        let none = describe("bunny", Progress { faces_total: 9, ..Progress::default() }, Duration::ZERO);
        assert_eq!(none, "bunny: 0/9 faces, 0 collapses/s, starting");
    }
}
