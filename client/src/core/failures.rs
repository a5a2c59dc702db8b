//! Retries of blobs that failed, with exponential backoff. A damaged blob is requested [`MAX_ATTEMPTS`] times in all,
//! since each attempt costs its bytes. A blob that the server cannot read costs nothing to request, and its disk may be
//! repaired: it is requested for as long as the session lasts, at most once in [`LONGEST_PAUSE`].

use std::collections::BTreeMap;
use std::time::Duration;

use lodestream_protocol::Time;
use lodestream_scene::BlobId;

/// Attempts in all before a damaged blob is given up and a refused one counts as missing.
const MAX_ATTEMPTS: u32 = 4;
/// Pause before the second attempt; doubled before each further one.
const FIRST_PAUSE: Duration = Duration::from_millis(500);
/// Longest pause before another attempt.
const LONGEST_PAUSE: Duration = Duration::from_secs(30);

#[derive(Clone, Copy, Debug)]
struct Failure {
    attempts: u32,
    /// Time of the next attempt; `None` while the blob is requested, or given up.
    retry_at: Option<Time>,
}

/// Blobs that failed, with their next attempts.
#[derive(Debug, Default)]
pub(crate) struct Failures {
    blobs: BTreeMap<BlobId, Failure>,
}

impl Failures {
    /// Records a damaged blob; returns whether it will be requested again.
    pub(crate) fn record_damaged(&mut self, now: Time, id: BlobId) -> bool {
        let failure = self.schedule_retry(now, id);
        if failure.attempts >= MAX_ATTEMPTS {
            failure.retry_at = None;
        }
        failure.retry_at.is_some()
    }

    /// Records a blob that the server cannot read. It will be requested again, without a limit of attempts.
    pub(crate) fn record_refused(&mut self, now: Time, id: BlobId) {
        self.schedule_retry(now, id);
    }

    fn schedule_retry(&mut self, now: Time, id: BlobId) -> &mut Failure {
        let failure = self.blobs.entry(id).or_insert(Failure { attempts: 0, retry_at: None });
        failure.attempts = failure.attempts.saturating_add(1);
        let doublings = (failure.attempts - 1).min(16);
        failure.retry_at = Some(now + (FIRST_PAUSE * (1 << doublings)).min(LONGEST_PAUSE));
        failure
    }

    /// Excludes a blob from further attempts.
    pub(crate) fn give_up(&mut self, id: BlobId) {
        self.blobs.insert(id, Failure { attempts: MAX_ATTEMPTS, retry_at: None });
    }

    /// Removes a blob that has arrived intact.
    pub(crate) fn clear(&mut self, id: BlobId) {
        if !self.blobs.is_empty() {
            self.blobs.remove(&id);
        }
    }

    /// Takes the blobs that are to be requested again now.
    pub(crate) fn take_due(&mut self, now: Time) -> Vec<BlobId> {
        let due = |f: &mut Failure| f.retry_at.take_if(|at| *at <= now).is_some();
        self.blobs.iter_mut().filter_map(|(id, f)| due(f).then_some(*id)).collect()
    }

    /// Whether a blob failed [`MAX_ATTEMPTS`] times, or was given up.
    pub(crate) fn is_missing(&self, id: BlobId) -> bool {
        self.blobs.get(&id).is_some_and(|f| f.attempts >= MAX_ATTEMPTS)
    }

    /// Whether a blob waits for another attempt and is not yet one that [`Failures::is_missing`].
    pub(crate) fn is_retrying(&self, id: BlobId) -> bool {
        self.blobs.get(&id).is_some_and(|f| f.attempts < MAX_ATTEMPTS && f.retry_at.is_some())
    }

    /// Time of the next attempt.
    pub(crate) fn next_retry(&self) -> Option<Time> {
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
        while failures.record_damaged(now, id) {
            let at = failures.next_retry().unwrap();
            assert!(failures.take_due(now).is_empty());
            assert_eq!(failures.take_due(at), [id]);
            assert_eq!(failures.next_retry(), None);
            pauses.push(at.since(now));
            now = at;
        }
        assert_eq!(pauses, [500, 1000, 2000].map(Duration::from_millis));
        assert!(failures.take_due(now + Duration::from_secs(1000)).is_empty());
    }

    #[test]
    fn success_resets_the_attempts_and_giving_up_is_final() {
        let mut failures = Failures::default();
        let id = BlobId::base(0);
        failures.record_damaged(Time::ZERO, id);
        failures.clear(id);
        assert_eq!(failures.next_retry(), None);
        failures.give_up(id);
        assert!(!failures.record_damaged(Time::ZERO, id));
        assert!(failures.is_missing(id));
    }

    #[test]
    fn refused_blobs_are_retried_without_limit() {
        let mut failures = Failures::default();
        let id = BlobId::chunk(0, 3);
        let mut now = Time::ZERO;
        for attempt in 1..100 {
            failures.record_refused(now, id);
            assert_eq!(failures.is_retrying(id), attempt < 4, "attempt {attempt}");
            let at = failures.next_retry().unwrap();
            assert!(at.since(now) <= LONGEST_PAUSE);
            assert_eq!(failures.take_due(at), [id]);
            now = at;
        }
        assert!(failures.is_missing(id));
        failures.clear(id);
        assert!(!failures.is_missing(id));
    }
}
