//! Verdicts on cases, and their counts.

use std::collections::BTreeMap;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::time::{Duration, Instant};

use serde::Serialize;

use super::subject::Subject;

/// The verdict on a case that did not panic.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Verdict {
    /// Accepted: the damage had no effect or gave other valid contents.
    Taken,
    /// Refused, for this kind of reason.
    Refused(String),
    /// Finding: the work exceeded its bound.
    Stuck,
}

impl Verdict {
    pub(super) fn refused(why: impl Into<String>) -> Self {
        Self::Refused(why.into())
    }
}

/// Counts over all cases of a subject. Bytes of memory are resident ones, of the process that read the damaged bytes.
#[derive(Clone, Debug, Serialize)]
pub struct MutationOutcome {
    /// The subject.
    pub subject: &'static str,
    /// Number of cases.
    pub tried: u32,
    /// Number of accepted cases.
    pub taken: u32,
    /// Number of refused cases.
    pub refused: u32,
    /// Number of refused cases by kind of reason, the most frequent first.
    pub reasons: String,
    /// Panics.
    pub panics: u32,
    /// Cases whose work exceeded its bound.
    pub stuck: u32,
    /// Longest time of a case, in milliseconds.
    pub slowest_ms: f64,
    /// Number of that case.
    pub slowest_case: u32,
    /// Memory after the warm-up, a tenth as many cases, and after the measured cases.
    pub before_bytes: u64,
    /// See `before_bytes`.
    pub after_bytes: u64,
    /// Processor time, seconds.
    pub cpu_s: f64,
}

/// Counts while cases run.
#[derive(Clone, Debug, Default)]
pub(super) struct Tally {
    tried: u32,
    verdicts: BTreeMap<Verdict, u32>,
    pub(super) panics: u32,
    slowest: (Duration, u32),
    /// Findings of warm-up cases.
    more_stuck: u32,
}

impl Tally {
    /// Runs a case in this process and records its verdict or panic.
    pub(super) fn catch(
        &mut self,
        subject: Subject,
        case: u32,
        judge: impl FnOnce() -> anyhow::Result<Verdict>,
    ) -> anyhow::Result<()> {
        let begun = Instant::now();
        let judged = catch_unwind(AssertUnwindSafe(judge));
        self.note(subject, case, begun.elapsed(), judged.ok().transpose()?);
        Ok(())
    }

    /// Records the verdict on a case; `None` if it panicked.
    pub(super) fn note(&mut self, subject: Subject, case: u32, took: Duration, verdict: Option<Verdict>) {
        self.tried += 1;
        self.slowest = self.slowest.max((took, case));
        if verdict.as_ref().is_none_or(|verdict| *verdict == Verdict::Stuck) {
            let what = if verdict.is_none() { "panicked" } else { "came to no end" };
            eprintln!("{}: case {case} {what}", subject.name());
        }
        match verdict {
            Some(verdict) => *self.verdicts.entry(verdict).or_default() += 1,
            None => self.panics += 1,
        }
    }

    /// Adds the counts of other cases.
    pub(super) fn merge(&mut self, other: &Self) {
        self.tried += other.tried;
        self.panics += other.panics;
        self.more_stuck += other.more_stuck;
        self.slowest = self.slowest.max(other.slowest);
        for (verdict, count) in &other.verdicts {
            *self.verdicts.entry(verdict.clone()).or_default() += count;
        }
    }

    /// Adds the findings of warm-up cases, which count too.
    pub(super) fn add_findings(&mut self, other: &Self) {
        self.panics += other.panics;
        self.more_stuck += other.of(&Verdict::Stuck);
    }

    fn of(&self, verdict: &Verdict) -> u32 {
        self.verdicts.get(verdict).copied().unwrap_or(0)
    }

    pub(super) fn found(
        &self,
        subject: Subject,
        [before_bytes, after_bytes]: [u64; 2],
        cpu_s: f64,
    ) -> MutationOutcome {
        let mut reasons: Vec<(u32, &str)> = Vec::new();
        for (verdict, count) in &self.verdicts {
            if let Verdict::Refused(why) = verdict {
                reasons.push((*count, why));
            }
        }
        reasons.sort_by_key(|(count, why)| (std::cmp::Reverse(*count), *why));
        let told: Vec<String> = reasons.iter().map(|(count, why)| format!("{why} {count}")).collect();
        MutationOutcome {
            subject: subject.name(),
            tried: self.tried,
            taken: self.of(&Verdict::Taken),
            refused: reasons.iter().map(|(count, _)| count).sum(),
            reasons: told.join("; "),
            panics: self.panics,
            stuck: self.of(&Verdict::Stuck) + self.more_stuck,
            slowest_ms: self.slowest.0.as_secs_f64() * 1e3,
            slowest_case: self.slowest.1,
            before_bytes,
            after_bytes,
            cpu_s,
        }
    }
}

impl std::fmt::Display for MutationOutcome {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let [before, after] = [self.before_bytes, self.after_bytes].map(|bytes| bytes as f64 / 1e6);
        write!(
            f,
            "{}: {} tried, {} taken, {} refused ({}); {} panics, {} without an end; at most {:.0} ms (case {}); memory \
             {before:.1} → {after:.1} MB; {:.1} s of a core",
            self.subject,
            self.tried,
            self.taken,
            self.refused,
            self.reasons,
            self.panics,
            self.stuck,
            self.slowest_ms,
            self.slowest_case,
            self.cpu_s
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn panics_and_endless_cases_of_the_warm_up_are_findings() {
        let subject = Subject::Flights;
        let (mut tally, mut warm) = (Tally::default(), Tally::default());
        for _ in 0..2 {
            tally.catch(subject, 1, || Ok(Verdict::refused("why"))).unwrap();
        }
        tally.catch(subject, 2, || Ok(Verdict::Taken)).unwrap();
        tally.catch(subject, 3, || panic!("as the test wants it")).unwrap();
        warm.catch(subject, 4, || Ok(Verdict::Stuck)).unwrap();
        warm.catch(subject, 5, || panic!("as the test wants it")).unwrap();
        tally.add_findings(&warm);
        let found = tally.found(subject, [1, 2], 0.5);
        assert_eq!((found.tried, found.taken, found.refused, found.panics, found.stuck), (4, 1, 2, 2, 1));
        assert_eq!(found.reasons, "why 2");
        assert!(tally.catch(subject, 6, || anyhow::bail!("no disk")).is_err());
    }
}
