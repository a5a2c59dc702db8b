//! What is sent next: one session's queue of wanted blobs and scene pages.
//!
//! The queue hands out small pieces, one at a time, so that nothing is committed before the limiter
//! admits it. A blob that has begun is finished first, unless something arrives that is more urgent by
//! [`OVERTAKE`]; then it waits, half sent. Of a blob, any part may be wanted: what is sent of it at a time
//! is a run from one byte to another.

use std::cmp::Reverse;
use std::collections::{BTreeMap, HashMap};
use std::ops::Range;

use bytes::Bytes;

use crate::blob::BlobId;
use crate::frame::BlobPiece;
use crate::message::RefusedReason;
use crate::select::Priority;
use crate::source::SourceError;

/// How much more urgent a blob must be to overtake one that has begun. Priorities are the bits of a
/// positive `f32`, so this is a factor of two in screen error.
pub const OVERTAKE: Priority = 1 << 23;

/// Most blobs that wait half sent. Beyond that, nothing overtakes: each of them keeps its bytes in
/// memory, here and at the client.
const MAX_SUSPENDED: usize = 8;

/// Something that can be queued.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Unit {
    /// A page of the scene description.
    Page(u32),
    /// A blob.
    Blob(BlobId),
}

/// What is handed out.
#[derive(Clone, Debug, PartialEq)]
pub enum Outgoing {
    /// Send this page of the scene description.
    Page(u32),
    /// Send this piece.
    Piece {
        /// The piece.
        piece: BlobPiece,
        /// The blob's priority.
        priority: Priority,
    },
    /// The blob could not be read.
    Failed {
        /// The blob.
        id: BlobId,
        /// What to tell the client.
        reason: RefusedReason,
    },
}

/// What became of a cancelled blob.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Cancelled {
    /// It was not queued.
    Unknown,
    /// It had not begun.
    Queued,
    /// Some of it has been sent.
    Begun,
}

#[derive(Debug)]
struct Begun {
    id: BlobId,
    priority: Priority,
    bytes: Bytes,
    offset: usize,
    end: usize,
}

/// Order in the queue: most urgent first, then first come, first served.
type Key = (Reverse<Priority>, u64);

/// A session's queue.
#[derive(Debug)]
pub struct Scheduler {
    queue: BTreeMap<Key, (Unit, Range<u32>)>,
    keys: HashMap<Unit, Key>,
    begun: Vec<Begun>,
    next_number: u64,
    max_queued: usize,
}

impl Scheduler {
    /// An empty queue of at most `max_queued` units, and at least one.
    #[must_use]
    pub fn new(max_queued: usize) -> Self {
        let max_queued = max_queued.max(1);
        Self { queue: BTreeMap::new(), keys: HashMap::new(), begun: Vec::new(), next_number: 0, max_queued }
    }

    /// Queues a unit or changes its priority. Gives `false` where the queue is full.
    pub fn want(&mut self, unit: Unit, priority: Priority) -> bool {
        self.want_part(unit, priority, 0..u32::MAX)
    }

    /// Queues part of a blob, or changes its priority. What is queued already is extended to the part's
    /// end; behind a run that has begun, what is missing to that end is queued. Gives `false` where the
    /// queue is full.
    pub fn want_part(&mut self, unit: Unit, priority: Priority, mut part: Range<u32>) -> bool {
        if let Unit::Blob(id) = unit
            && let Some(begun) = self.begun.iter_mut().find(|begun| begun.id == id)
        {
            begun.priority = priority;
            if part.end as usize <= begun.end || begun.end == begun.bytes.len() {
                return true;
            }
            part.start = number(begun.end);
        }
        match self.keys.get_mut(&unit) {
            Some(key) => {
                let queued = self.queue.remove(key).map_or(part.clone(), |(_, queued)| queued);
                part = queued.start.min(part.start)..queued.end.max(part.end);
                key.0 = Reverse(priority);
                self.queue.insert(*key, (unit, part));
            }
            None if self.queue.len() >= self.max_queued => return false,
            None => {
                let key = (Reverse(priority), self.next_number);
                self.next_number += 1;
                self.queue.insert(key, (unit, part));
                self.keys.insert(unit, key);
            }
        }
        true
    }

    /// Drops a blob. What has been handed out is gone.
    pub fn cancel(&mut self, id: BlobId) -> Cancelled {
        let queued = self.keys.remove(&Unit::Blob(id)).and_then(|key| self.queue.remove(&key));
        if let Some(index) = self.begun.iter().position(|begun| begun.id == id) {
            self.begun.remove(index);
            return Cancelled::Begun;
        }
        if queued.is_some() { Cancelled::Queued } else { Cancelled::Unknown }
    }

    /// Drops the queued units, not begun, for which `keep` says no.
    pub fn retain(&mut self, mut keep: impl FnMut(&Unit) -> bool) {
        let keys = &mut self.keys;
        self.queue.retain(|_, (unit, _)| {
            let kept = keep(unit);
            if !kept {
                keys.remove(unit);
            }
            kept
        });
    }

    /// Drops everything.
    pub fn clear(&mut self) {
        self.queue.clear();
        self.keys.clear();
        self.begun.clear();
    }

    /// Whether nothing is queued and nothing begun.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.queue.is_empty() && self.begun.is_empty()
    }

    /// Units queued, begun ones not counted.
    #[must_use]
    pub fn queued(&self) -> usize {
        self.queue.len()
    }

    /// Whether a unit is queued or begun.
    #[must_use]
    pub fn contains(&self, unit: &Unit) -> bool {
        self.keys.contains_key(unit)
            || matches!(unit, Unit::Blob(id) if self.begun.iter().any(|begun| begun.id == *id))
    }

    /// Blobs that have begun and are not finished, with their priorities.
    pub fn begun(&self) -> impl Iterator<Item = (Priority, Unit)> + '_ {
        self.begun.iter().map(|begun| (begun.priority, Unit::Blob(begun.id)))
    }

    /// The next unit that would begin if none were begun: its priority and itself.
    #[must_use]
    pub fn peek(&self) -> Option<(Priority, Unit)> {
        self.queue.first_key_value().map(|((Reverse(priority), _), (unit, _))| (*priority, *unit))
    }

    /// Index of the begun blob to go on with, unless the queue's head overtakes.
    fn current(&self) -> Option<usize> {
        // The most urgent; among equals the latest, so that what overtook is finished first.
        let (index, begun) = self.begun.iter().enumerate().max_by_key(|(_, begun)| begun.priority)?;
        let overtaken = self.begun.len() <= MAX_SUSPENDED
            && self.peek().is_some_and(|(head, _)| head >= begun.priority.saturating_add(OVERTAKE));
        (!overtaken).then_some(index)
    }

    /// Hands out the next piece of at most `piece_bytes`, reading blobs by `read` as they begin.
    pub fn next(
        &mut self,
        piece_bytes: usize,
        mut read: impl FnMut(&BlobId) -> Result<Bytes, SourceError>,
    ) -> Option<Outgoing> {
        if let Some(index) = self.current() {
            return Some(self.advance(index, piece_bytes));
        }
        let ((Reverse(priority), _), (unit, part)) = self.queue.pop_first()?;
        self.keys.remove(&unit);
        let id = match unit {
            Unit::Page(page) => return Some(Outgoing::Page(page)),
            Unit::Blob(id) => id,
        };
        match read(&id) {
            Ok(bytes) => {
                let end = bytes.len().min(part.end as usize);
                let offset = (part.start as usize).min(end);
                self.begun.push(Begun { id, priority, bytes, offset, end });
                Some(self.advance(self.begun.len() - 1, piece_bytes))
            }
            Err(SourceError::NotFound(_)) => Some(Outgoing::Failed { id, reason: RefusedReason::NotFound }),
            Err(SourceError::Unreadable { .. }) => {
                Some(Outgoing::Failed { id, reason: RefusedReason::Unreadable })
            }
        }
    }

    fn advance(&mut self, index: usize, piece_bytes: usize) -> Outgoing {
        let begun = &mut self.begun[index];
        let end = begun.end.min(begun.offset + piece_bytes.max(1));
        let piece = BlobPiece {
            id: begun.id,
            offset: number(begun.offset),
            end: number(begun.end),
            total: number(begun.bytes.len()),
            bytes: begun.bytes.slice(begun.offset..end),
        };
        begun.offset = end;
        let priority = begun.priority;
        if end == begun.end {
            self.begun.remove(index);
        }
        Outgoing::Piece { piece, priority }
    }
}

/// Sources give blobs of at most `MAX_BLOB_BYTES`, as the session checks before it queues them.
fn number(n: usize) -> u32 {
    u32::try_from(n).unwrap_or(u32::MAX)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::blob::BlobPart;

    fn read(id: &BlobId) -> Result<Bytes, SourceError> {
        match id.part() {
            Some(BlobPart::Chunk(n)) => Ok(Bytes::from(vec![n as u8; 1000])),
            Some(BlobPart::IndexPage(_)) => Err(SourceError::Unreadable { id: *id, why: "bad hash".into() }),
            _ => Err(SourceError::NotFound(*id)),
        }
    }

    fn chunk(n: u32) -> Unit {
        Unit::Blob(BlobId::chunk(0, n))
    }

    /// The numbers of the chunks that pieces belong to, one per piece.
    fn drain(scheduler: &mut Scheduler) -> Vec<u32> {
        std::iter::from_fn(|| scheduler.next(400, read))
            .map(|out| match out {
                Outgoing::Piece { piece: BlobPiece { id, .. }, .. } => match id.part() {
                    Some(BlobPart::Chunk(n)) => n,
                    _ => 999,
                },
                Outgoing::Page(page) => 100 + page,
                Outgoing::Failed { .. } => 998,
            })
            .collect()
    }

    #[test]
    fn urgent_first_then_first_come() {
        let mut scheduler = Scheduler::new(10);
        for (n, priority) in [(1, 5), (2, 7), (3, 5), (4, 9)] {
            assert!(scheduler.want(chunk(n), priority));
        }
        scheduler.want(Unit::Page(0), 6);
        scheduler.want(chunk(3), 8);
        assert_eq!(drain(&mut scheduler), [4, 4, 4, 3, 3, 3, 2, 2, 2, 100, 1, 1, 1]);
        assert!(scheduler.is_empty());
    }

    #[test]
    fn a_begun_blob_is_overtaken_only_by_the_margin() {
        let mut scheduler = Scheduler::new(10);
        scheduler.want(chunk(1), OVERTAKE);
        let first = scheduler.next(400, read).unwrap();
        assert!(matches!(first, Outgoing::Piece { piece: BlobPiece { offset: 0, total: 1000, .. }, .. }));
        scheduler.want(chunk(2), 2 * OVERTAKE - 1);
        scheduler.want(chunk(3), 2 * OVERTAKE);
        assert_eq!(drain(&mut scheduler), [3, 3, 3, 1, 1, 2, 2, 2]);
    }

    #[test]
    fn pieces_are_contiguous_and_complete() {
        let mut scheduler = Scheduler::new(10);
        scheduler.want(chunk(7), 1);
        let mut received = Vec::new();
        while let Some(Outgoing::Piece { piece, .. }) = scheduler.next(333, read) {
            assert_eq!(piece.offset as usize, received.len());
            received.extend_from_slice(&piece.bytes);
        }
        assert_eq!(received, vec![7; 1000]);
    }

    #[test]
    fn parts_are_sent_once_and_extended_in_the_queue() {
        let mut scheduler = Scheduler::new(10);
        scheduler.want_part(chunk(1), 5, 0..300);
        let mut sent = Vec::new();
        let next = |scheduler: &mut Scheduler, sent: &mut Vec<(u32, u32, u32)>| {
            let Some(Outgoing::Piece { piece, .. }) = scheduler.next(200, read) else { return false };
            sent.push((piece.offset, piece.offset + number(piece.bytes.len()), piece.end));
            true
        };
        next(&mut scheduler, &mut sent);
        // The run has begun: the rest follows as another.
        scheduler.want_part(chunk(1), 6, 0..500);
        scheduler.want_part(chunk(1), 6, 0..700);
        while next(&mut scheduler, &mut sent) {}
        // Not begun: extended.
        scheduler.want_part(chunk(1), 5, 700..800);
        scheduler.want_part(chunk(1), 7, 700..1000);
        while next(&mut scheduler, &mut sent) {}
        assert_eq!(
            sent,
            [
                (0, 200, 300),
                (200, 300, 300),
                (300, 500, 700),
                (500, 700, 700),
                (700, 900, 1000),
                (900, 1000, 1000)
            ]
        );
        scheduler.want_part(chunk(1), 5, 0..300);
        next(&mut scheduler, &mut sent);
        scheduler.want_part(chunk(1), 5, 0..1000);
        assert_eq!(scheduler.cancel(BlobId::chunk(0, 1)), Cancelled::Begun);
        assert!(scheduler.is_empty(), "the rest goes with its beginning");
    }

    #[test]
    fn cancel_drops_what_was_not_handed_over() {
        let mut scheduler = Scheduler::new(10);
        scheduler.want(chunk(1), 5);
        scheduler.want(chunk(2), 4);
        assert_eq!(scheduler.cancel(BlobId::chunk(0, 2)), Cancelled::Queued);
        assert_eq!(scheduler.cancel(BlobId::chunk(0, 2)), Cancelled::Unknown);
        scheduler.next(400, read);
        assert_eq!(scheduler.cancel(BlobId::chunk(0, 1)), Cancelled::Begun);
        assert_eq!(scheduler.next(400, read), None);
    }

    #[test]
    fn a_full_queue_says_so_but_still_takes_new_priorities() {
        let mut scheduler = Scheduler::new(2);
        assert!(scheduler.want(chunk(1), 1) && scheduler.want(chunk(2), 2));
        assert!(!scheduler.want(chunk(3), 3));
        assert!(scheduler.want(chunk(1), 9));
        assert_eq!(scheduler.peek(), Some((9, chunk(1))));
    }

    #[test]
    fn failures_are_reported_and_passed_over() {
        let mut scheduler = Scheduler::new(9);
        scheduler.want(Unit::Blob(BlobId::base(0)), 3);
        scheduler.want(Unit::Blob(BlobId::index_page(0, 0)), 2);
        scheduler.want(chunk(1), 1);
        assert_eq!(
            scheduler.next(400, read),
            Some(Outgoing::Failed { id: BlobId::base(0), reason: RefusedReason::NotFound })
        );
        assert_eq!(
            scheduler.next(400, read),
            Some(Outgoing::Failed { id: BlobId::index_page(0, 0), reason: RefusedReason::Unreadable })
        );
        assert_eq!(drain(&mut scheduler), [1, 1, 1]);
    }

    #[test]
    fn suspended_blobs_are_bounded() {
        let mut scheduler = Scheduler::new(100);
        for n in 0..30 {
            scheduler.want(chunk(n), (n + 1) * OVERTAKE);
            scheduler.next(10, read);
        }
        assert!(scheduler.begun.len() <= MAX_SUSPENDED + 1, "{}", scheduler.begun.len());
    }
}
