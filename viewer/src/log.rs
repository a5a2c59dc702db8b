//! Log on standard error. Errors of libraries are reformatted to one line each in the program's own format; with
//! `RUST_LOG` set, all events are shown unchanged.

use std::fmt::{self, Write as _};
use std::io::IsTerminal as _;

use tracing::{Dispatch, Event, Subscriber};
use tracing_subscriber::EnvFilter;
use tracing_subscriber::fmt::format::{Format, Writer};
use tracing_subscriber::fmt::time::{FormatTime as _, SystemTime};
use tracing_subscriber::fmt::{FmtContext, FormatEvent, FormatFields, MakeWriter};
use tracing_subscriber::registry::LookupSpan;
use tracing_subscriber::util::SubscriberInitExt as _;

/// Default filter: of libraries, only errors.
/// To the crate of title bars it is an error if a desktop does not tell their colours.
const DEFAULT_FILTER: &str =
    "error,lodestream_client=info,lodestream_render=info,lodestream_viewer=info,sctk_adwaita=off";
/// Prefix of the project's crates.
const CRATE_PREFIX: &str = "lodestream_";
/// Most characters of a library's line.
const MAX_LINE_CHARS: usize = 500;

/// Starts logging to standard error.
pub(crate) fn to_stderr() {
    // Colours only on a terminal.
    let colours =
        std::io::stderr().is_terminal() && std::env::var_os("NO_COLOR").is_none_or(|no| no.is_empty());
    let log = match EnvFilter::try_from_default_env() {
        Ok(filter) => tracing_subscriber::fmt()
            .with_env_filter(filter)
            .with_writer(std::io::stderr)
            .with_ansi(colours)
            .finish()
            .into(),
        Err(_) => default_log(colours, std::io::stderr),
    };
    // Fails only if a log is set up already, which then stays.
    let _ = log.try_init();
}

/// The default log, without `RUST_LOG`.
fn default_log<W>(colours: bool, writer: W) -> Dispatch
where
    W: for<'w> MakeWriter<'w> + Send + Sync + 'static,
{
    tracing_subscriber::fmt()
        .with_env_filter(EnvFilter::new(DEFAULT_FILTER))
        .with_writer(writer)
        .with_ansi(colours)
        .map_event_format(|ours| UniformLogFormat {
            ours,
            others: Format::default().without_time().with_level(false),
        })
        .finish()
        .into()
}

/// Formats events of libraries as lines of the program.
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
        let metadata = event.metadata();
        if metadata.target().starts_with(CRATE_PREFIX) {
            return self.ours.format_event(context, writer, event);
        }
        let mut message = String::new();
        self.others.format_event(context, Writer::new(&mut message), event)?;
        SystemTime.format_time(&mut writer)?;
        writeln!(writer, " {:>5} {CRATE_PREFIX}viewer: {}", metadata.level(), in_one_line(&message))
    }
}

/// Replaces line breaks and control characters by spaces, and truncates long text.
fn in_one_line(text: &str) -> String {
    let words = text.split(|c: char| c.is_whitespace() || c.is_control()).filter(|word| !word.is_empty());
    let mut line = String::new();
    for word in words {
        let between = if line.is_empty() { "" } else { " " };
        // Writing to a String cannot fail.
        let _ = write!(line, "{between}{word}");
    }
    match line.char_indices().nth(MAX_LINE_CHARS) {
        Some((end, _)) => line[..end].to_owned() + "…",
        None => line,
    }
}

#[cfg(test)]
mod tests {
    use std::sync::{Arc, Mutex};

    use super::*;

    /// Buffer that several writers share.
    #[derive(Clone, Default)]
    struct SharedBuffer(Arc<Mutex<Vec<u8>>>);

    impl std::io::Write for SharedBuffer {
        fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
            self.0.lock().unwrap().extend_from_slice(bytes);
            Ok(bytes.len())
        }

        fn flush(&mut self) -> std::io::Result<()> {
            Ok(())
        }
    }

    fn logged(say: impl FnOnce()) -> String {
        let written = SharedBuffer::default();
        let writer = written.clone();
        tracing::dispatcher::with_default(&default_log(false, move || writer.clone()), say);
        let bytes = written.0.lock().unwrap().clone();
        String::from_utf8(bytes).unwrap()
    }

    /// Errors of wgpu have several lines.
    #[test]
    fn errors_of_libraries_are_one_line_each_in_the_programs_format() {
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
        assert!(second.chars().count() < MAX_LINE_CHARS + 100, "{second}");
    }
}
