//! What the program says on standard error while it runs: lines of its own alone.
//!
//! What libraries say that is wrong is told in one line of the program's each, whatever they wrote. `RUST_LOG` chooses
//! otherwise, and then shows everything as it was said.

use std::fmt::{self, Write as _};
use std::io::IsTerminal as _;

use tracing::{Dispatch, Event, Subscriber};
use tracing_subscriber::EnvFilter;
use tracing_subscriber::fmt::format::{Format, Writer};
use tracing_subscriber::fmt::time::{FormatTime as _, SystemTime};
use tracing_subscriber::fmt::{FmtContext, FormatEvent, FormatFields, MakeWriter};
use tracing_subscriber::registry::LookupSpan;
use tracing_subscriber::util::SubscriberInitExt as _;

/// What is logged unless `RUST_LOG` says otherwise: of libraries, only what is wrong.
const LOGGED: &str = "error,lodestream_client=info,lodestream_render=info,lodestream_viewer=info";
/// What the names of our crates begin with.
const OURS: &str = "lodestream_";
/// Characters of a library's line, at most.
const LONGEST: usize = 500;

/// Begins to log to standard error.
pub(crate) fn to_stderr() {
    // Colours are for people: in a file they are noise.
    let colours =
        std::io::stderr().is_terminal() && std::env::var_os("NO_COLOR").is_none_or(|no| no.is_empty());
    let log = match EnvFilter::try_from_default_env() {
        Ok(chosen) => tracing_subscriber::fmt()
            .with_env_filter(chosen)
            .with_writer(std::io::stderr)
            .with_ansi(colours)
            .finish()
            .into(),
        Err(_) => log(colours, std::io::stderr),
    };
    // Fails where a log is set up already, and then that one is as good.
    let _ = log.try_init();
}

/// The log of those who have chosen nothing.
fn log<W>(colours: bool, writer: W) -> Dispatch
where
    W: for<'w> MakeWriter<'w> + Send + Sync + 'static,
{
    tracing_subscriber::fmt()
        .with_env_filter(EnvFilter::new(LOGGED))
        .with_writer(writer)
        .with_ansi(colours)
        .map_event_format(|ours| UniformLogFormat {
            ours,
            others: Format::default().without_time().with_level(false),
        })
        .finish()
        .into()
}

/// A format that tells what others say as the program's.
struct UniformLogFormat<F, G> {
    ours: F,
    others: G,
}

impl<S, N, F, G> FormatEvent<S, N> for UniformLogFormat<F, G>
where
    S: Subscriber + for<'a> LookupSpan<'a>,
    N: for<'a> FormatFields<'a> + 'static,
    F: FormatEvent<S, N>,
    G: FormatEvent<S, N>,
{
    fn format_event(
        &self,
        context: &FmtContext<'_, S, N>,
        mut writer: Writer<'_>,
        event: &Event<'_>,
    ) -> fmt::Result {
        let about = event.metadata();
        if about.target().starts_with(OURS) {
            return self.ours.format_event(context, writer, event);
        }
        let mut said = String::new();
        self.others.format_event(context, Writer::new(&mut said), event)?;
        SystemTime.format_time(&mut writer)?;
        writeln!(writer, " {:>5} {OURS}viewer: {}", about.level(), in_one_line(&said))
    }
}

/// A text without line breaks and codes, cut where it is long.
fn in_one_line(text: &str) -> String {
    let words = text.split(|c: char| c.is_whitespace() || c.is_control()).filter(|word| !word.is_empty());
    let mut line = String::new();
    for word in words {
        let between = if line.is_empty() { "" } else { " " };
        // Writing to a String cannot fail.
        let _ = write!(line, "{between}{word}");
    }
    match line.char_indices().nth(LONGEST) {
        Some((end, _)) => line[..end].to_owned() + "…",
        None => line,
    }
}

#[cfg(test)]
mod tests {
    use std::sync::{Arc, Mutex};

    use super::*;

    /// What is written to it, by whomever.
    #[derive(Clone, Default)]
    struct Written(Arc<Mutex<Vec<u8>>>);

    impl std::io::Write for Written {
        fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
            self.0.lock().unwrap().extend_from_slice(bytes);
            Ok(bytes.len())
        }

        fn flush(&mut self) -> std::io::Result<()> {
            Ok(())
        }
    }

    fn logged(say: impl FnOnce()) -> String {
        let written = Written::default();
        let writer = written.clone();
        tracing::dispatcher::with_default(&log(false, move || writer.clone()), say);
        let bytes = written.0.lock().unwrap().clone();
        String::from_utf8(bytes).unwrap()
    }

    /// Lines of graphics drivers' wrappers, of several lines each, stood between the program's own.
    #[test]
    fn what_a_library_says_is_told_in_one_line_of_the_programs() {
        let text = logged(|| {
            tracing::info!(target: "lodestream_viewer::run", "connected");
            tracing::error!(target: "wgpu_core::device", "Validation Error\n\n  In a \u{1b}[31mpass\u{1b}[0m\r\n    no buffer");
            tracing::warn!(target: "winit::platform", "an odd keyboard");
            tracing::info!(target: "quinn::endpoint", "a packet");
            tracing::error!(target: "quinn::connection", "{}", "lost ".repeat(1000));
        });
        let lines: Vec<&str> = text.lines().collect();
        let [ours, first, second] = lines[..] else { panic!("{text}") };
        assert!(ours.ends_with(" INFO lodestream_viewer::run: connected"), "{ours}");
        assert!(
            first.contains("ERROR lodestream_viewer: wgpu_core::device: Validation Error In a"),
            "{first}"
        );
        assert!(first.ends_with("no buffer") && !first.contains(|c: char| c.is_control()), "{first}");
        assert!(second.contains("ERROR lodestream_viewer: quinn::connection: lost") && second.ends_with('…'));
        assert!(second.chars().count() < LONGEST + 100, "{second}");
    }
}
