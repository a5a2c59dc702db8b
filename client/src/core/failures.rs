//! Blobs that came damaged or not at all: asked for again a few times, ever more slowly, then never.

use std::collections::BTreeMap;
use std::time::Duration;

use lodestream_protocol::{BlobId, Time};

/// Attempts in all before a blob is given up.
const MAX_ATTEMPTS: u32 = 4;
/// Pause before the second attempt; doubled before each further one.
const FIRST_PAUSE: Duration = Duration::from_millis(500);

#[derive(Clone, Copy, Debug)]
struct Failure {
    attempts: u32,
    /// When to ask again; `None` while asked for, or given up.
    retry_at: Option<Time>,
}

/// What failed so far.
#[derive(Debug, Default)]
pub(crate) struct Failures {
    blobs: BTreeMap<BlobId, Failure>,
}

impl Failures {
    /// Notes a failure; says whether the blob will be asked for again.
    pub(crate) fn note(&mut self, now: Time, id: BlobId) -> bool {
        let failure = self.blobs.entry(id).or_insert(Failure { attempts: 0, retry_at: None });
        failure.attempts += 1;
        failure.retry_at =
            (failure.attempts < MAX_ATTEMPTS).then(|| now + FIRST_PAUSE * (1 << (failure.attempts - 1)));
        failure.retry_at.is_some()
    }

    /// Gives a blob up.
    pub(crate) fn give_up(&mut self, id: BlobId) {
        self.blobs.insert(id, Failure { attempts: MAX_ATTEMPTS, retry_at: None });
    }

    /// The blob is here and sound after all.
    pub(crate) fn forget(&mut self, id: BlobId) {
        if !self.blobs.is_empty() {
            self.blobs.remove(&id);
        }
    }

    /// Blobs whose time has come to be asked for again.
    pub(crate) fn due(&mut self, now: Time) -> Vec<BlobId> {
        let due = |f: &mut Failure| f.retry_at.take_if(|at| *at <= now).is_some();
        self.blobs.iter_mut().filter_map(|(id, f)| due(f).then_some(*id)).collect()
    }

    /// When [`Failures::due`] has something.
    pub(crate) fn next(&self) -> Option<Time> {
        self.blobs.values().filter_map(|f| f.retry_at).min()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn retries_are_few_and_ever_slower() {
        let mut failures = Failures::default();
        let id = BlobId::chunk(0, 3);
        let (mut now, mut pauses) = (Time::ZERO, Vec::new());
        while failures.note(now, id) {
            let at = failures.next().unwrap();
            assert!(failures.due(now).is_empty());
            assert_eq!(failures.due(at), [id]);
            assert_eq!(failures.next(), None);
            pauses.push(at.since(now));
            now = at;
        }
        assert_eq!(pauses, [500, 1000, 2000].map(Duration::from_millis));
        assert!(failures.due(now + Duration::from_secs(1000)).is_empty());
    }

    #[test]
    fn success_starts_afresh_and_giving_up_is_final() {
        let mut failures = Failures::default();
        let id = BlobId::base(0);
        failures.note(Time::ZERO, id);
        failures.forget(id);
        assert_eq!(failures.next(), None);
        failures.give_up(id);
        assert!(!failures.note(Time::ZERO, id));
    }
}
