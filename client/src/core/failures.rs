//! Blobs that came damaged or not at all. What came damaged is asked for again a few times, ever more slowly, then
//! never: each time costs its bytes. What the server refuses because it cannot read it costs nothing to ask for, and
//! its disk may be mended: it is asked for as long as the session lasts, at most once in [`LONGEST_PAUSE`].

use std::collections::BTreeMap;
use std::time::Duration;

use lodestream_protocol::Time;
use lodestream_scene::BlobId;

/// Attempts in all before a damaged blob is given up, and a refused one counts as lacking for good.
const MAX_ATTEMPTS: u32 = 4;
/// Pause before the second attempt; doubled before each further one.
const FIRST_PAUSE: Duration = Duration::from_millis(500);
/// Longest pause before another attempt at a refused blob.
const LONGEST_PAUSE: Duration = Duration::from_secs(30);

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
    /// Notes that a blob came damaged; says whether it will be asked for again.
    pub(crate) fn damaged(&mut self, now: Time, id: BlobId) -> bool {
        let failure = self.again(now, id);
        if failure.attempts >= MAX_ATTEMPTS {
            failure.retry_at = None;
        }
        failure.retry_at.is_some()
    }

    /// Notes that the server cannot read a blob: it is asked for again, however often that happens.
    pub(crate) fn refused(&mut self, now: Time, id: BlobId) {
        self.again(now, id);
    }

    fn again(&mut self, now: Time, id: BlobId) -> &mut Failure {
        let failure = self.blobs.entry(id).or_insert(Failure { attempts: 0, retry_at: None });
        failure.attempts = failure.attempts.saturating_add(1);
        let doublings = (failure.attempts - 1).min(16);
        failure.retry_at = Some(now + (FIRST_PAUSE * (1 << doublings)).min(LONGEST_PAUSE));
        failure
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

    /// Whether a blob failed [`MAX_ATTEMPTS`] times, or was given up.
    pub(crate) fn is_lacking(&self, id: BlobId) -> bool {
        self.blobs.get(&id).is_some_and(|f| f.attempts >= MAX_ATTEMPTS)
    }

    /// Whether a blob waits to be asked for again that may well come: not one that [`Failures::is_lacking`].
    pub(crate) fn is_hopeful(&self, id: BlobId) -> bool {
        self.blobs.get(&id).is_some_and(|f| f.attempts < MAX_ATTEMPTS && f.retry_at.is_some())
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
        while failures.damaged(now, id) {
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
        failures.damaged(Time::ZERO, id);
        failures.forget(id);
        assert_eq!(failures.next(), None);
        failures.give_up(id);
        assert!(!failures.damaged(Time::ZERO, id));
        assert!(failures.is_lacking(id));
    }

    #[test]
    fn what_is_refused_is_asked_for_as_long_as_it_takes() {
        let mut failures = Failures::default();
        let id = BlobId::chunk(0, 3);
        let mut now = Time::ZERO;
        for attempt in 1..100 {
            failures.refused(now, id);
            assert_eq!(failures.is_hopeful(id), attempt < 4, "attempt {attempt}");
            let at = failures.next().unwrap();
            assert!(at.since(now) <= LONGEST_PAUSE);
            assert_eq!(failures.due(at), [id]);
            now = at;
        }
        assert!(failures.is_lacking(id));
        failures.forget(id);
        assert!(!failures.is_lacking(id));
    }
}
