//! How many lines a place in the code may log: what repeats itself says nothing new, and hides what does.

use std::collections::HashMap;
use std::num::NonZeroU32;
use std::time::{Duration, Instant};

use tracing::Metadata;
use tracing::callsite::Identifier;

/// In this time a place may log so many lines.
const WINDOW: Duration = Duration::from_secs(1);

/// Most lines a second that a place in the code may log; `None` for no limit.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct LogLimit(pub(super) Option<NonZeroU32>);

/// Reads a number of lines, or `off`.
pub(super) fn parse_log_limit(text: &str) -> Result<LogLimit, String> {
    if text.eq_ignore_ascii_case("off") {
        return Ok(LogLimit(None));
    }
    let lines =
        text.parse().map_err(|_| format!("{text:?} is no number of lines: write for example 100, or off"))?;
    Ok(LogLimit(Some(lines)))
}

/// Lines of one place that were left out.
#[derive(Clone, Copy, Debug)]
pub(super) struct LeftOut {
    /// The place.
    pub(super) of: &'static Metadata<'static>,
    /// How many.
    pub(super) lines: u64,
}

/// See the module. There are as many entries as places that have logged.
#[derive(Debug)]
pub(super) struct Limiter {
    limit: LogLimit,
    places: HashMap<Identifier, Place>,
}

#[derive(Debug)]
struct Place {
    metadata: &'static Metadata<'static>,
    window: Instant,
    lines: u32,
    left_out: u64,
}

impl Limiter {
    pub(super) fn new(limit: LogLimit) -> Self {
        Self { limit, places: HashMap::new() }
    }

    /// Whether a place may log a line now; if not, the line is counted.
    pub(super) fn admit(&mut self, of: &'static Metadata<'static>, now: Instant) -> bool {
        let LogLimit(Some(most)) = self.limit else { return true };
        let fresh = || Place { metadata: of, window: now, lines: 0, left_out: 0 };
        let place = self.places.entry(of.callsite()).or_insert_with(fresh);
        if now.saturating_duration_since(place.window) >= WINDOW {
            (place.window, place.lines) = (now, 0);
        }
        if place.lines < most.get() {
            place.lines += 1;
            true
        } else {
            place.left_out += 1;
            false
        }
    }

    /// Takes what was left out in windows that are over, each place once.
    pub(super) fn take(&mut self, now: Instant) -> Vec<LeftOut> {
        self.take_if(|place| now.saturating_duration_since(place.window) >= WINDOW)
    }

    /// Takes all that was left out.
    pub(super) fn take_all(&mut self) -> Vec<LeftOut> {
        self.take_if(|_| true)
    }

    fn take_if(&mut self, over: impl Fn(&Place) -> bool) -> Vec<LeftOut> {
        let places = self.places.values_mut().filter(|place| place.left_out > 0 && over(place));
        let taken =
            places.map(|place| LeftOut { of: place.metadata, lines: std::mem::take(&mut place.left_out) });
        let mut taken: Vec<_> = taken.collect();
        taken.sort_by_key(|left_out| (left_out.of.file(), left_out.of.line()));
        taken
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn limits_are_read() {
        assert_eq!(parse_log_limit("off"), Ok(LogLimit(None)));
        assert_eq!(parse_log_limit("7"), Ok(LogLimit(NonZeroU32::new(7))));
        for bad in ["0", "-1", "", "many"] {
            assert!(parse_log_limit(bad).unwrap_err().contains("100, or off"), "{bad}");
        }
    }
}
