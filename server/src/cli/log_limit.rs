//! Rate limit of log lines per call site, so that repeated lines do not hide others.

use std::collections::hash_map::Entry;
use std::collections::{HashMap, VecDeque};
use std::num::NonZeroU32;
use std::time::{Duration, Instant};

use tracing::Metadata;
use tracing::callsite::Identifier;

/// Interval for which [`LogLimit`] lines are admitted per call site.
const WINDOW: Duration = Duration::from_secs(1);

/// Most lines per second that one call site may log; `None` for no limit.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct LogLimit(pub(super) Option<NonZeroU32>);

/// Parses a number of lines, or `off`.
pub(super) fn parse_log_limit(text: &str) -> Result<LogLimit, String> {
    if text.eq_ignore_ascii_case("off") {
        return Ok(LogLimit(None));
    }
    let lines = text
        .parse()
        .map_err(|_| format!("{text:?} is not a number of lines; write for example 100, or off"))?;
    Ok(LogLimit(Some(lines)))
}

/// Suppressed lines of one call site.
#[derive(Clone, Copy, Debug)]
pub(super) struct SuppressedLines {
    /// The call site.
    pub(super) of: &'static Metadata<'static>,
    /// Number of lines.
    pub(super) lines: u64,
}

/// Counts lines per call site. It has one entry per call site that has logged; the cost of a line does not depend on
/// their number.
#[derive(Debug)]
pub(super) struct Limiter {
    limit: LogLimit,
    callsites: HashMap<Identifier, Window>,
    /// Call sites whose window is open, oldest first, each once.
    open: VecDeque<Identifier>,
    /// The latest time passed in. Threads read the clock before they take the lock, so times may arrive out of order.
    latest: Option<Instant>,
}

/// Lines of a call site since its window began.
#[derive(Debug)]
struct Window {
    metadata: &'static Metadata<'static>,
    begin: Instant,
    lines: u32,
    left_out: u64,
}

impl Limiter {
    pub(super) fn new(limit: LogLimit) -> Self {
        Self { limit, callsites: HashMap::new(), open: VecDeque::new(), latest: None }
    }

    /// Whether a call site may log a line now; if not, the line is counted as suppressed. Also returns the suppressed
    /// lines of all windows that have ended since the last call, one entry per call site.
    pub(super) fn line(
        &mut self,
        of: &'static Metadata<'static>,
        now: Instant,
    ) -> (bool, Vec<SuppressedLines>) {
        let LogLimit(Some(most)) = self.limit else { return (true, Vec::new()) };
        let now = *self.latest.insert(self.latest.map_or(now, |latest| latest.max(now)));
        let left_out = self.close(now);
        let fresh = Window { metadata: of, begin: now, lines: 0, left_out: 0 };
        let window = match self.callsites.entry(of.callsite()) {
            Entry::Occupied(entry) => {
                let window = entry.into_mut();
                if now - window.begin >= WINDOW {
                    self.open.push_back(of.callsite());
                    *window = fresh;
                }
                window
            }
            Entry::Vacant(entry) => {
                self.open.push_back(of.callsite());
                entry.insert(fresh)
            }
        };
        let admitted = window.lines < most.get();
        if admitted {
            window.lines += 1;
        } else {
            window.left_out += 1;
        }
        (admitted, left_out)
    }

    /// Closes the windows that have ended.
    fn close(&mut self, now: Instant) -> Vec<SuppressedLines> {
        let mut taken = Vec::new();
        while let Some(callsite) = self.open.front()
            && let Some(window) = self.callsites.get_mut(callsite)
            && now - window.begin >= WINDOW
        {
            taken.extend(window.take());
            self.open.pop_front();
        }
        sorted(taken)
    }

    /// Takes the counts of all suppressed lines.
    pub(super) fn take_all(&mut self) -> Vec<SuppressedLines> {
        sorted(self.callsites.values_mut().filter_map(Window::take).collect())
    }
}

impl Window {
    fn take(&mut self) -> Option<SuppressedLines> {
        let lines = std::mem::take(&mut self.left_out);
        (lines > 0).then_some(SuppressedLines { of: self.metadata, lines })
    }
}

/// Sorted by file and line, so that the order does not depend on the hash map.
fn sorted(mut taken: Vec<SuppressedLines>) -> Vec<SuppressedLines> {
    taken.sort_by_key(|left_out| (left_out.of.file(), left_out.of.line()));
    taken
}

#[cfg(test)]
mod tests {
    use tracing::callsite::Callsite;
    use tracing::field::FieldSet;
    use tracing::metadata::Kind;
    use tracing::subscriber::Interest;

    use super::*;

    #[test]
    fn limits_are_parsed() {
        assert_eq!(parse_log_limit("off"), Ok(LogLimit(None)));
        assert_eq!(parse_log_limit("7"), Ok(LogLimit(NonZeroU32::new(7))));
        for bad in ["0", "-1", "", "many"] {
            assert!(parse_log_limit(bad).unwrap_err().contains("100, or off"), "{bad}");
        }
    }

    /// A call site in a file that does not exist.
    fn callsite(line: u32) -> &'static Metadata<'static> {
        /// Has a size, so that each call site has an address of its own.
        struct Somewhere(#[expect(dead_code, reason = "gives the type a size")] u32);
        impl Callsite for Somewhere {
            fn set_interest(&self, _: Interest) {}
            fn metadata(&self) -> &Metadata<'_> {
                unreachable!("no call site is registered")
            }
        }
        let fields = FieldSet::new(&[], Identifier(Box::leak(Box::new(Somewhere(line)))));
        let level = tracing::Level::INFO;
        let (file, kind) = (Some("here.rs"), Kind::EVENT);
        Box::leak(Box::new(Metadata::new("line", "here", level, file, Some(line), None, fields, kind)))
    }

    fn told(left_out: &[SuppressedLines]) -> Vec<(u32, u64)> {
        left_out.iter().map(|left_out| (left_out.of.line().unwrap(), left_out.lines)).collect()
    }

    fn limiter(most: u32) -> Limiter {
        Limiter::new(LogLimit(NonZeroU32::new(most)))
    }

    #[test]
    fn each_call_site_has_a_window_and_is_reported_once_when_it_ends() {
        let [a, b] = [9, 4].map(callsite);
        let (mut limiter, start) = (limiter(2), Instant::now());
        let mut line = |of, at_ms| {
            let (admitted, left_out) = limiter.line(of, start + Duration::from_millis(at_ms));
            (admitted, told(&left_out))
        };
        assert_eq!([0, 1, 2, 3].map(|ms| line(a, ms).0), [true, true, false, false]);
        assert_eq!([500, 501, 502].map(|ms| line(b, ms).0), [true, true, false]);
        assert_eq!(line(b, 999), (false, vec![]));
        assert_eq!(line(b, 1000), (false, vec![(9, 2)]));
        assert_eq!(line(a, 1400), (true, vec![]));
        assert_eq!(line(a, 1500), (true, vec![(4, 3)]));
        assert_eq!(line(a, 1501), (false, vec![]));
        // Both windows end before this line; their counts are sorted by call site.
        assert_eq!([1600, 1601, 1602].map(|ms| line(b, ms).0), [true, true, false]);
        assert_eq!(line(b, 9000), (true, vec![(4, 1), (9, 1)]));
        assert_eq!(told(&limiter.take_all()), []);
    }

    #[test]
    fn times_out_of_order_open_no_window_twice() {
        let [a, b] = [1, 2].map(callsite);
        let (mut limiter, start) = (limiter(1), Instant::now());
        let at = |us| start + Duration::from_micros(us);
        for (of, us) in [(a, 5), (b, 0), (a, 4), (b, 1_000_003), (b, 1_000_001), (a, 1_000_002)] {
            limiter.line(of, at(us));
            assert!(limiter.open.len() <= 2, "{:?}", limiter.open);
        }
        assert_eq!(told(&limiter.take_all()), [(1, 2), (2, 2)]);
    }

    /// A reference limiter, which checks the windows of all call sites for each line.
    #[derive(Default)]
    struct Thorough(Vec<(&'static Metadata<'static>, Instant, u32, u64)>);

    impl Thorough {
        fn line(
            &mut self,
            of: &'static Metadata<'static>,
            now: Instant,
            most: u32,
        ) -> (bool, Vec<(u32, u64)>) {
            let mut told = Vec::new();
            for (of, begin, _, left_out) in &mut self.0 {
                if now - *begin >= WINDOW && *left_out > 0 {
                    told.push((of.line().unwrap(), std::mem::take(left_out)));
                }
            }
            told.sort_unstable();
            let at = self.0.iter().position(|place| place.0.callsite() == of.callsite());
            let at = at.unwrap_or_else(|| {
                self.0.push((of, now, 0, 0));
                self.0.len() - 1
            });
            let (_, begin, lines, left_out) = &mut self.0[at];
            if now - *begin >= WINDOW {
                (*begin, *lines) = (now, 0);
            }
            let admitted = *lines < most;
            *lines += u32::from(admitted);
            *left_out += u64::from(!admitted);
            (admitted, told)
        }
    }

    #[test]
    fn the_limiter_equals_the_reference() {
        let callsites: Vec<_> = (1..=40).map(callsite).collect();
        let (mut limiter, mut thorough) = (limiter(3), Thorough::default());
        let (mut now, mut random, mut left_out) = (Instant::now(), 1_u32, 0);
        for _ in 0..20_000 {
            // Some call sites log often, most now and then (a linear congruential generator from Numerical Recipes).
            random = random.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            let place = (random >> 8) as usize % 40 * ((random >> 20) as usize % 40) / 39;
            now += Duration::from_millis(u64::from(random >> 28) + 700 * u64::from(random >> 22 == 0));
            let (admitted, told_now) = limiter.line(callsites[place], now);
            assert_eq!((admitted, told(&told_now)), thorough.line(callsites[place], now, 3));
            assert!(limiter.open.len() <= callsites.len());
            left_out += usize::from(!admitted);
        }
        assert!((1000..19_000).contains(&left_out), "only {left_out} lines were suppressed, or almost all");
    }
}
