//! Rates that may vary over time, and the exact time that bits take at them, in integers.
//!
//! Work is counted in bit · ns/s, so that a link of `r` bit/s does `r` units per nanosecond. A rate changes only
//! between two nanoseconds, so every nanosecond has one rate, and the part of a packet's last nanosecond that it does
//! not use is a whole number of units for the next packet.

use std::num::NonZeroU64;
use std::sync::Arc;

/// Nanoseconds per second.
pub const NS_PER_S: u64 = 1_000_000_000;

/// Largest rate, in bits per second: an hour of it is far from overflowing.
pub const MAX_RATE_BITS_PER_S: u64 = 1_000_000_000_000;

/// An invalid rate.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum RateError {
    /// There is no value.
    #[error("there is no rate; give at least one")]
    Empty,
    /// The first step is later than the start.
    #[error("the first rate is from {0} ns on; it must be from 0 on")]
    LateStart(u64),
    /// Times do not ascend.
    #[error("step {0} is not later than the one before it")]
    NotAscending(usize),
    /// A rate beyond [`MAX_RATE_BITS_PER_S`].
    #[error("rate {index} is {bits_per_s} bit/s; at most {MAX_RATE_BITS_PER_S} can be had")]
    TooFast {
        /// Index of the value.
        index: usize,
        /// The value.
        bits_per_s: u64,
    },
    /// The rate stays 0.
    #[error("the rate stays 0 at the end, so nothing would ever pass again; end with a rate above 0")]
    Dead,
    /// A line of a trace that is not a rate.
    #[error("line {line}: {text:?} is not a number of Mbit/s from 0 to 1e6")]
    Line {
        /// Number of the line, from 1.
        line: usize,
        /// Its text.
        text: String,
    },
}

/// What follows the last second of a trace.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum AtEnd {
    /// The trace repeats.
    Repeat,
    /// Its last value holds.
    Hold,
}

#[derive(Clone, Debug, PartialEq, Eq)]
enum Shape {
    Constant(NonZeroU64),
    /// Start time and rate of each step: the first at 0, times ascending, the last rate above 0.
    Steps(Arc<[(u64, u64)]>),
    /// One value per second; at least one above 0, the last too if it holds.
    Trace(Arc<[u64]>, AtEnd),
}

/// Bits per second at every time of a simulation. A rate of 0 is an outage, which must end.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Rate(Shape);

impl Rate {
    /// A constant rate.
    #[must_use]
    pub const fn constant(bits_per_s: NonZeroU64) -> Self {
        Self(Shape::Constant(bits_per_s))
    }

    /// Rates that hold from a time on, in nanoseconds since the start, until the next step.
    ///
    /// # Errors
    /// Times that do not ascend from 0, rates out of range, an outage without end.
    pub fn steps(steps: &[(u64, u64)]) -> Result<Self, RateError> {
        let &(first_ns, _) = steps.first().ok_or(RateError::Empty)?;
        if first_ns != 0 {
            return Err(RateError::LateStart(first_ns));
        }
        if let Some(i) = steps.windows(2).position(|pair| pair[0].0 >= pair[1].0) {
            return Err(RateError::NotAscending(i + 1));
        }
        check_range(steps.iter().map(|&(_, rate)| rate))?;
        if steps.last().is_none_or(|&(_, rate)| rate == 0) {
            return Err(RateError::Dead);
        }
        Ok(Self(Shape::Steps(steps.into())))
    }

    /// One rate for each second.
    ///
    /// # Errors
    /// No values, values out of range, an outage without end.
    pub fn trace(bits_per_s: &[u64], at_end: AtEnd) -> Result<Self, RateError> {
        let &last = bits_per_s.last().ok_or(RateError::Empty)?;
        check_range(bits_per_s.iter().copied())?;
        let dead = match at_end {
            AtEnd::Repeat => bits_per_s.iter().all(|&rate| rate == 0),
            AtEnd::Hold => last == 0,
        };
        if dead {
            return Err(RateError::Dead);
        }
        Ok(Self(Shape::Trace(bits_per_s.into(), at_end)))
    }

    /// Parses a trace file: a number of Mbit/s per line, one line per second; empty lines and lines that begin with `#`
    /// are ignored.
    ///
    /// # Errors
    /// As [`Rate::trace`], and lines that are not numbers.
    pub fn parse_trace(text: &str, at_end: AtEnd) -> Result<Self, RateError> {
        let mut rates = Vec::new();
        for (line, text) in (1..).zip(text.lines().map(str::trim)) {
            if text.is_empty() || text.starts_with('#') {
                continue;
            }
            let mbit = text.parse::<f64>().ok().filter(|mbit| (0.0..=1e6).contains(mbit));
            let mbit = mbit.ok_or_else(|| RateError::Line { line, text: text.chars().take(40).collect() })?;
            rates.push((mbit * 1e6).round() as u64);
        }
        Self::trace(&rates, at_end)
    }

    /// The constant rate, if it is one.
    #[must_use]
    pub const fn as_constant(&self) -> Option<NonZeroU64> {
        match self.0 {
            Shape::Constant(rate) => Some(rate),
            Shape::Steps(_) | Shape::Trace(..) => None,
        }
    }

    /// The rate in the first nanosecond.
    #[must_use]
    pub fn first(&self) -> u64 {
        self.piece(0).0
    }

    /// The highest rate.
    #[must_use]
    pub fn largest(&self) -> u64 {
        match &self.0 {
            Shape::Constant(rate) => rate.get(),
            Shape::Steps(steps) => steps.iter().map(|&(_, rate)| rate).max().unwrap_or(0),
            Shape::Trace(rates, _) => rates.iter().copied().max().unwrap_or(0),
        }
    }

    /// The rate at a time, and a time until which it holds (`u64::MAX`: for ever).
    fn piece(&self, at_ns: u64) -> (u64, u64) {
        match &self.0 {
            Shape::Constant(rate) => (rate.get(), u64::MAX),
            Shape::Steps(steps) => {
                // The first step starts at 0, so one exists before any time.
                let next = steps.partition_point(|&(from_ns, _)| from_ns <= at_ns);
                (steps[next - 1].1, steps.get(next).map_or(u64::MAX, |&(from_ns, _)| from_ns))
            }
            Shape::Trace(rates, at_end) => {
                let (second, seconds) = (at_ns / NS_PER_S, rates.len() as u64);
                let index = match at_end {
                    AtEnd::Repeat => second % seconds,
                    AtEnd::Hold if second + 1 >= seconds => return (rates[rates.len() - 1], u64::MAX),
                    AtEnd::Hold => second,
                };
                // Below the number of values.
                (rates[index as usize], (second + 1).saturating_mul(NS_PER_S))
            }
        }
    }

    /// The work done between two times, in bit · ns/s.
    #[must_use]
    pub(super) fn work_between(&self, from_ns: u64, to_ns: u64) -> u128 {
        let (mut at_ns, mut work) = (from_ns, 0);
        while at_ns < to_ns {
            let (rate, until_ns) = self.piece(at_ns);
            let until_ns = until_ns.min(to_ns);
            work += u128::from(rate) * u128::from(until_ns - at_ns);
            at_ns = until_ns;
        }
        work
    }

    /// When `work` that begins at the start of a nanosecond is done: whole nanoseconds, and the units done in the one
    /// after them. `u64::MAX` on overflow.
    #[must_use]
    pub(super) fn done(&self, from_ns: u64, mut work: u128) -> (u64, u64) {
        let mut at_ns = from_ns;
        while work > 0 {
            let (rate, until_ns) = self.piece(at_ns);
            let here = u128::from(rate) * u128::from(until_ns - at_ns);
            if work <= here {
                // Both fit: the quotient is at most until_ns - at_ns, the rest below the rate.
                return (at_ns + (work / u128::from(rate)) as u64, (work % u128::from(rate)) as u64);
            }
            if until_ns == u64::MAX {
                return (u64::MAX, 0);
            }
            work -= here;
            at_ns = until_ns;
        }
        (at_ns, 0)
    }
}

fn check_range(rates: impl Iterator<Item = u64>) -> Result<(), RateError> {
    for (index, bits_per_s) in rates.enumerate() {
        if bits_per_s > MAX_RATE_BITS_PER_S {
            return Err(RateError::TooFast { index, bits_per_s });
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    const S: u64 = NS_PER_S;
    const BIT: u128 = NS_PER_S as u128;

    #[test]
    fn work_across_steps_takes_each_steps_rate() {
        // 8 Mbit in the first second, none in the second, then 1 Mbit/s.
        let rate = Rate::steps(&[(0, 8_000_000), (S, 0), (2 * S, 1_000_000)]).unwrap();
        assert_eq!(rate.done(0, 4_000_000 * BIT), (S / 2, 0));
        // Done at the start of the outage, not at its end.
        assert_eq!(rate.done(0, 8_000_000 * BIT), (S, 0));
        assert_eq!(rate.done(0, 8_500_000 * BIT), (2 * S + S / 2, 0));
        assert_eq!(rate.done(S + 7, 1_000 * BIT), (2 * S + S / 1000, 0));
        assert_eq!(rate.work_between(S / 2, 3 * S), 5_000_000 * BIT);
        assert_eq!((rate.first(), rate.largest(), rate.as_constant()), (8_000_000, 8_000_000, None));
    }

    #[test]
    fn fractions_of_a_nanosecond_are_carried() {
        // A bit at 3 Gbit/s takes a third of a nanosecond.
        let rate = Rate::constant(NonZeroU64::new(3_000_000_000).unwrap());
        assert_eq!(rate.done(5, BIT), (5, 1_000_000_000));
        assert_eq!(rate.done(5, 3 * BIT), (6, 0));
        assert_eq!(rate.done(5, 7 * BIT), (7, 1_000_000_000));
    }

    #[test]
    fn a_trace_repeats_or_holds() {
        let text = "# Mbit/s\n2\n\n0.5\n 4 \n";
        let repeat = Rate::parse_trace(text, AtEnd::Repeat).unwrap();
        let hold = Rate::parse_trace(text, AtEnd::Hold).unwrap();
        let at = |rate: &Rate, s: u64| rate.piece(s * S + 1).0;
        assert_eq!(
            [0, 1, 2, 3, 4, 7].map(|s| at(&repeat, s)),
            [2_000_000, 500_000, 4_000_000, 2_000_000, 500_000, 500_000]
        );
        assert_eq!(
            [0, 1, 2, 3, 4, 7].map(|s| at(&hold, s)),
            [2_000_000, 500_000, 4_000_000, 4_000_000, 4_000_000, 4_000_000]
        );
        // 6.5 Mbit per round of three seconds.
        assert_eq!(repeat.work_between(0, 300 * S), 650_000_000 * BIT);
        assert_eq!(repeat.done(0, 651_000_000 * BIT), (300 * S + S / 2, 0));
        assert_eq!(hold.done(0, 10_500_000 * BIT), (4 * S, 0));
    }

    #[test]
    fn rates_that_cannot_be_used_are_named() {
        let steps = Rate::steps;
        assert_eq!(steps(&[]), Err(RateError::Empty));
        assert_eq!(steps(&[(1, 5)]), Err(RateError::LateStart(1)));
        assert_eq!(steps(&[(0, 5), (9, 5), (9, 6)]), Err(RateError::NotAscending(2)));
        assert_eq!(steps(&[(0, 5), (9, 0)]), Err(RateError::Dead));
        let too_fast = RateError::TooFast { index: 1, bits_per_s: MAX_RATE_BITS_PER_S + 1 };
        assert_eq!(steps(&[(0, 5), (9, MAX_RATE_BITS_PER_S + 1)]), Err(too_fast));
        let trace = Rate::parse_trace;
        assert_eq!(trace("# nothing", AtEnd::Hold), Err(RateError::Empty));
        assert_eq!(trace("1\n0", AtEnd::Hold), Err(RateError::Dead));
        assert!(trace("1\n0", AtEnd::Repeat).is_ok());
        assert_eq!(trace("0\n0", AtEnd::Repeat), Err(RateError::Dead));
        for bad in ["fast", "-1", "nan", "1e7", "1 2"] {
            let error = trace(&format!("1\n{bad}"), AtEnd::Repeat).unwrap_err();
            assert_eq!(error, RateError::Line { line: 2, text: bad.into() });
        }
    }
}
