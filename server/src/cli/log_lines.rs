//! Formatting of the log as text or JSON, with a limit per call site and lines about suppressed ones.

use std::fmt;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Instant;

use clap::ValueEnum;
use serde_json::json;
use tracing::{Dispatch, Event, Subscriber};
use tracing_subscriber::EnvFilter;
use tracing_subscriber::fmt::format::Writer;
use tracing_subscriber::fmt::time::{FormatTime as _, SystemTime};
use tracing_subscriber::fmt::{FmtContext, FormatEvent, FormatFields, MakeWriter};
use tracing_subscriber::registry::LookupSpan;

use super::log_limit::{Limiter, LogLimit, SuppressedLines};

/// Format of log lines.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(super) enum LogFormat {
    /// Text for people.
    Text,
    /// JSON for programs, one object per line.
    Json,
}

/// Formats lines, limits them per call site, and reports the suppressed ones.
pub(super) struct Lines {
    format: LogFormat,
    limiter: Mutex<Limiter>,
    now: Box<dyn Fn() -> Instant + Send + Sync>,
}

impl fmt::Debug for Lines {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Lines").field("format", &self.format).finish_non_exhaustive()
    }
}

impl Lines {
    pub(super) fn new(
        format: LogFormat,
        limit: LogLimit,
        now: impl Fn() -> Instant + Send + Sync + 'static,
    ) -> Arc<Self> {
        Arc::new(Self { format, limiter: Mutex::new(Limiter::new(limit)), now: Box::new(now) })
    }

    /// A subscriber that writes these lines.
    pub(super) fn log<W>(self: &Arc<Self>, filter: EnvFilter, colours: bool, writer: W) -> Dispatch
    where
        W: for<'w> MakeWriter<'w> + Send + Sync + 'static,
    {
        let builder = tracing_subscriber::fmt()
            .with_env_filter(filter)
            .with_writer(writer)
            // Suppressed lines are reported to `tracing` as formatting errors, which it would print on standard error,
            // blocking.
            .log_internal_errors(false);
        let lines = Arc::clone(self);
        match self.format {
            LogFormat::Text => builder
                .with_ansi(colours)
                .map_event_format(|format| Limited { format, lines })
                .finish()
                .into(),
            LogFormat::Json => builder
                .with_ansi(false)
                .json()
                .map_event_format(|format| Limited { format, lines })
                .finish()
                .into(),
        }
    }

    /// Lines about all suppressed lines that were not reported yet.
    pub(super) fn last_words(&self) -> String {
        let mut text = String::new();
        for left_out in self.limiter().take_all() {
            // Writing to a String cannot fail.
            let _ = self.tell(&mut Writer::new(&mut text), left_out);
        }
        text
    }

    fn limiter(&self) -> MutexGuard<'_, Limiter> {
        // A thread that panicked while holding the lock can only have left wrong counts.
        self.limiter.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn tell(&self, to: &mut Writer<'_>, SuppressedLines { of, lines }: SuppressedLines) -> fmt::Result {
        let mut time = String::new();
        SystemTime.format_time(&mut Writer::new(&mut time))?;
        let place = format!("{}:{}", of.file().unwrap_or("?"), of.line().unwrap_or(0));
        let (level, target) = (of.level().as_str(), of.target());
        match self.format {
            LogFormat::Text => {
                writeln!(
                    to,
                    "{time} {level:>5} {target}: {lines} more lines like this were left out ({place})"
                )
            }
            LogFormat::Json => {
                let fields = json!({"message": "more lines like this were left out", "left_out": lines, "place": place});
                writeln!(
                    to,
                    "{}",
                    json!({"timestamp": time, "level": level, "fields": fields, "target": target})
                )
            }
        }
    }
}

/// An event format that suppresses lines beyond the limit.
struct Limited<F> {
    format: F,
    lines: Arc<Lines>,
}

impl<S, N, F> FormatEvent<S, N> for Limited<F>
where
    S: Subscriber + for<'a> LookupSpan<'a>,
    N: for<'a> FormatFields<'a> + 'static,
    F: FormatEvent<S, N>,
{
    fn format_event(
        &self,
        context: &FmtContext<'_, S, N>,
        mut writer: Writer<'_>,
        event: &Event<'_>,
    ) -> fmt::Result {
        let now = (self.lines.now)();
        let (admitted, left_out) = self.lines.limiter().line(event.metadata(), now);
        let anything = admitted || !left_out.is_empty();
        for left_out in left_out {
            self.lines.tell(&mut writer, left_out)?;
        }
        if admitted {
            self.format.format_event(context, writer, event)?;
        }
        // An error keeps `tracing` from writing an empty line.
        if anything { Ok(()) } else { Err(fmt::Error) }
    }
}

#[cfg(test)]
mod tests {
    use std::io;
    use std::num::NonZeroU32;
    use std::time::Duration;

    use super::*;

    #[derive(Clone, Default)]
    struct Sheet(Arc<Mutex<Vec<u8>>>);

    impl io::Write for Sheet {
        fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
            assert!(!bytes.is_empty(), "suppressed lines must take no room in the queue");
            self.0.lock().unwrap().extend_from_slice(bytes);
            Ok(bytes.len())
        }

        fn write_all(&mut self, bytes: &[u8]) -> io::Result<()> {
            self.write(bytes).map(drop)
        }

        fn flush(&mut self) -> io::Result<()> {
            Ok(())
        }
    }

    /// The lines written when one call site logs ten lines and another two, and both log again a second later; and the
    /// lines written at the end.
    fn written(format: LogFormat, limit: Option<u32>) -> (Vec<String>, String) {
        let (sheet, clock) = (Sheet::default(), Arc::new(Mutex::new(Instant::now())));
        let limit = LogLimit(limit.map(|most| NonZeroU32::new(most).unwrap()));
        let told = Arc::clone(&clock);
        let lines = Lines::new(format, limit, move || *told.lock().unwrap());
        let writer = sheet.clone();
        let log = lines.log(EnvFilter::new("info"), false, move || writer.clone());
        tracing::dispatcher::with_default(&log, || {
            let flood = |count| (0..count).for_each(|n| tracing::warn!(n, "flood"));
            let other = || tracing::info!("other");
            flood(10);
            other();
            other();
            *clock.lock().unwrap() += Duration::from_secs(1);
            other();
            flood(5);
            tracing::debug!("below the level");
        });
        let text = String::from_utf8(sheet.0.lock().unwrap().clone()).unwrap();
        (text.lines().map(str::to_owned).collect(), lines.last_words())
    }

    #[test]
    fn repeated_lines_of_a_call_site_are_suppressed_and_counted() {
        let (lines, last) = written(LogFormat::Text, Some(3));
        let count = |of: &str| lines.iter().filter(|line| line.contains(of)).count();
        assert_eq!((count("flood"), count("other"), lines.len()), (6, 3, 10), "{lines:?}");
        assert!(
            lines[5].contains(" WARN ") && lines[5].contains(": 7 more lines like this were left out"),
            "{lines:?}"
        );
        assert!(lines[5].contains("log_lines.rs:"), "{lines:?}");
        assert!(last.contains(": 2 more lines"), "{last}");
        let (lines, last) = written(LogFormat::Text, None);
        assert_eq!((lines.len(), &last[..]), (18, ""));
    }

    #[test]
    fn json_has_one_object_per_line_for_suppressed_lines_too() {
        let (lines, last) = written(LogFormat::Json, Some(3));
        let read = |line: &str| serde_json::from_str::<serde_json::Value>(line).unwrap();
        let all: Vec<_> = lines.iter().map(|line| read(line)).collect();
        assert!(
            all.iter().all(|line| line["timestamp"].is_string() && line["target"].is_string()),
            "{lines:?}"
        );
        assert_eq!((&all[0]["level"], &all[0]["fields"]["n"]), (&json!("WARN"), &json!(0)));
        assert_eq!(all[0]["fields"]["message"], "flood");
        assert_eq!((&all[5]["level"], &all[5]["fields"]["left_out"]), (&json!("WARN"), &json!(7)));
        assert_eq!(read(last.trim_end())["fields"]["left_out"], 2);
    }
}
