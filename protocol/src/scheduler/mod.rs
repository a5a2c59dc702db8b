//! Scheduler: one session's priority queue of requested blobs and scene pages.
//!
//! The scheduler returns small pieces, one at a time, so that nothing is committed before the limiter admits it. A
//! blob that has begun is finished first, unless another is more urgent by [`OVERTAKE`]; then it is suspended. A
//! request may be for any part of a blob; a contiguous part that is sent is a *run*.
//!
//! A blob that must be read from the store is set aside while others are sent (at most [`MAX_READS`] of them). After
//! the first such blob, the next ones are read ahead while pieces are sent.

mod length;
mod queue;
mod reads;
mod unit;

use std::cmp::Reverse;
use std::ops::Range;

use bytes::Bytes;

use crate::frame::BlobPiece;
use crate::message::RefusedReason;
use crate::source::{Reading, SourceError};
use lodestream_scene::blob::BlobId;
use lodestream_select::priority::Priority;

use length::number;
use queue::{Queue, QueuedUnit};
pub use reads::MAX_READS;
use reads::{Key, Loaded, Reads, refusal};
pub use unit::Unit;

/// How much more urgent a blob must be to overtake one that has begun. Priorities are the bits of a
/// positive `f32`, so this is a factor of two in visible difference per byte.
pub const OVERTAKE: Priority = 1 << 23;

/// Most suspended blobs; beyond that nothing overtakes. Each holds its bytes in memory, here and at the client.
const MAX_SUSPENDED: usize = 8;

/// An item to send.
#[derive(Clone, Debug, PartialEq)]
pub enum Outgoing {
    /// A page of the scene description.
    Page {
        /// Its number.
        page: u32,
        /// Its priority.
        priority: Priority,
    },
    /// A piece of a blob.
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
        /// The reason to refuse it with.
        reason: RefusedReason,
    },
}

/// State of a blob when it was cancelled.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Cancelled {
    /// It was not queued.
    Unknown,
    /// It was queued and nothing of it was sent.
    Queued,
    /// It was partly sent.
    BlobTransfer,
}

/// A run that has begun.
#[derive(Debug)]
struct BlobTransfer {
    id: BlobId,
    priority: Priority,
    bytes: Bytes,
    offset: usize,
    end: usize,
}

/// Source of the next run: a finished read, or the queue.
enum Next {
    Loaded(Key),
    Queued,
}

/// A session's queue.
#[derive(Debug)]
pub struct Scheduler {
    queue: Queue,
    begun: Vec<BlobTransfer>,
    reads: Reads,
    next_number: u64,
    max_queued: usize,
}

impl Scheduler {
    /// An empty queue of at most `max_queued` units, and at least one.
    #[must_use]
    pub fn new(max_queued: usize) -> Self {
        let max_queued = max_queued.max(1);
        Self {
            queue: Queue::default(),
            begun: Vec::new(),
            reads: Reads::default(),
            next_number: 0,
            max_queued,
        }
    }

    /// Queues a unit or changes its priority. Returns `false` if the queue is full.
    pub fn want(&mut self, unit: Unit, priority: Priority) -> bool {
        self.want_part(unit, priority, 0..u32::MAX)
    }

    /// Queues part of a blob, or changes its priority. A queued part is extended to cover the new one; after a run
    /// that has begun, the rest of the part is queued. Returns `false` if the queue is full.
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
        if let Unit::Blob(id) = unit
            && self.reads.want(id, priority, &part)
        {
            return true;
        }
        if self.queue.update(&unit, priority, &part) {
            return true;
        }
        if self.queue.len() >= self.max_queued {
            return false;
        }
        let key = (Reverse(priority), self.next_number);
        self.next_number += 1;
        self.queue.insert(QueuedUnit { key, unit, part });
        true
    }

    /// Drops a blob. Pieces already returned are not affected.
    pub fn cancel(&mut self, id: BlobId) -> Cancelled {
        let queued = self.queue.remove(&Unit::Blob(id)).is_some();
        let read = self.reads.retain(|read| read != id);
        if let Some(index) = self.begun.iter().position(|begun| begun.id == id) {
            self.begun.remove(index);
            return Cancelled::BlobTransfer;
        }
        if queued || read { Cancelled::Queued } else { Cancelled::Unknown }
    }

    /// Drops the units that have not begun and for which `keep` returns false.
    pub fn retain(&mut self, mut keep: impl FnMut(&Unit) -> bool) {
        self.queue.retain(&mut keep);
        self.reads.retain(|id| keep(&Unit::Blob(id)));
    }

    /// Drops everything. The results of outstanding reads are dropped when they arrive.
    pub fn clear(&mut self) {
        self.reads.clear();
        self.queue.clear();
        self.begun.clear();
    }

    /// Whether nothing is queued, being read or begun.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.queue.is_empty() && self.begun.is_empty() && self.reads.is_empty()
    }

    /// Whether [`Scheduler::next`] may return something: `false` if all that is left waits for the store.
    #[must_use]
    pub fn has_ready_work(&self) -> bool {
        !self.begun.is_empty()
            || self.reads.first().is_some()
            || self.peek().is_some_and(|(_, unit)| matches!(unit, Unit::Page(_)) || self.reads.has_room())
    }

    /// Number of queued units, without those begun or being read.
    #[must_use]
    pub fn queued(&self) -> usize {
        self.queue.len()
    }

    /// Bytes of blobs that are queued, being read or begun and not returned yet; `length` gives the length of a blob.
    /// O(n).
    pub(crate) fn waiting_bytes(&self, length: impl Fn(&BlobId) -> Option<u32>) -> u64 {
        let part = |id: &BlobId, part: &Range<u32>| {
            u64::from(part.end.min(length(id).unwrap_or(0)).saturating_sub(part.start))
        };
        let queued = self.queue.iter().map(|(unit, wanted)| match unit {
            Unit::Page(_) => 0,
            Unit::Blob(id) => part(id, wanted),
        });
        let read = self.reads.wanted().map(|(id, wanted)| part(&id, wanted));
        let begun = self.begun.iter().map(|begun| (begun.end - begun.offset) as u64);
        queued.chain(read).chain(begun).sum()
    }

    /// Whether a unit is queued, being read or begun.
    #[must_use]
    pub fn contains(&self, unit: &Unit) -> bool {
        let active = |id: BlobId| self.reads.contains(id) || self.begun.iter().any(|begun| begun.id == id);
        self.queue.contains(unit) || matches!(unit, Unit::Blob(id) if active(*id))
    }

    /// Blobs that have begun and are not finished, with their priorities.
    pub fn begun(&self) -> impl Iterator<Item = (Priority, Unit)> + '_ {
        self.begun.iter().map(|begun| (begun.priority, Unit::Blob(begun.id)))
    }

    /// The most urgent queued unit, with its priority.
    #[must_use]
    pub fn peek(&self) -> Option<(Priority, Unit)> {
        self.queue.first().map(|((Reverse(priority), _), unit)| (priority, unit))
    }

    /// The most urgent begun blob: its index and priority.
    fn current(&self) -> Option<(usize, Priority)> {
        // Among equals the latest, so that what overtook is finished first.
        let (index, begun) = self.begun.iter().enumerate().max_by_key(|(_, begun)| begun.priority)?;
        Some((index, begun.priority))
    }

    /// The next page or piece of at most `piece_bytes`. Blobs are read by `read` as they begin. A blob whose read is
    /// pending is reported by [`Scheduler::poll_read`], and others are sent meanwhile.
    pub fn next(
        &mut self,
        piece_bytes: usize,
        mut read: impl FnMut(&BlobId) -> Result<Reading, SourceError>,
    ) -> Option<Outgoing> {
        let current = self.current();
        if current.is_some() && self.reads.is_slow() {
            self.read_ahead(&mut read);
        }
        while let Some(next) = self.next_to_begin(current) {
            let loaded = match next {
                Next::Loaded(key) => self.reads.take(key)?,
                Next::Queued => {
                    let QueuedUnit { key, unit, part } = self.queue.pop()?;
                    let Reverse(priority) = key.0;
                    let id = match unit {
                        Unit::Page(page) => return Some(Outgoing::Page { page, priority }),
                        Unit::Blob(id) => id,
                    };
                    match read(&id) {
                        Ok(Reading::Ready(bytes)) => Loaded { id, priority, part, bytes: Ok(bytes) },
                        Ok(Reading::Pending) => {
                            self.reads.wait(id, key, part);
                            continue;
                        }
                        Err(why) => Loaded { id, priority, part, bytes: Err(refusal(&why)) },
                    }
                }
            };
            return Some(self.begin(loaded, piece_bytes));
        }
        current.map(|(index, _)| self.advance(index, piece_bytes))
    }

    /// The source of the run that may begin now; `None` if a begun one goes first or all are waiting for the store.
    fn next_to_begin(&self, current: Option<(usize, Priority)>) -> Option<Next> {
        let overtakes = |key: &Key| {
            current.is_none_or(|(_, begun)| {
                self.begun.len() <= MAX_SUSPENDED && key.0.0 >= begun.saturating_add(OVERTAKE)
            })
        };
        let loaded = self.reads.first();
        let queued = self
            .queue
            .first()
            .filter(|(_, unit)| matches!(unit, Unit::Page(_)) || self.reads.has_room())
            .map(|(key, _)| key);
        match (loaded, queued) {
            (Some(loaded), Some(queued)) if loaded < queued => Some((loaded, Next::Loaded(loaded))),
            (_, Some(queued)) => Some((queued, Next::Queued)),
            (Some(loaded), None) => Some((loaded, Next::Loaded(loaded))),
            (None, None) => None,
        }
        .filter(|(key, _)| overtakes(key))
        .map(|(_, next)| next)
    }

    /// Starts reads of the next queued blobs while others are sent.
    fn read_ahead(&mut self, read: &mut impl FnMut(&BlobId) -> Result<Reading, SourceError>) {
        while self.reads.has_room()
            && let Some((_, Unit::Blob(id))) = self.queue.first()
        {
            let Some(QueuedUnit { key, part, .. }) = self.queue.pop() else { return };
            match read(&id) {
                Ok(Reading::Ready(bytes)) => self.reads.insert_done(id, key, part, Ok(bytes)),
                Ok(Reading::Pending) => self.reads.wait(id, key, part),
                Err(why) => self.reads.insert_done(id, key, part, Err(refusal(&why))),
            }
        }
    }

    /// The next blob to read from the store; the driver passes the result to [`Scheduler::handle_read`].
    pub fn poll_read(&mut self) -> Option<BlobId> {
        self.reads.poll()
    }

    /// Takes the result of a read. Drops it if the blob is no longer wanted.
    pub fn handle_read(&mut self, id: BlobId, bytes: &Result<Bytes, SourceError>) {
        self.reads.done(id, bytes);
    }

    fn begin(&mut self, Loaded { id, priority, part, bytes }: Loaded, piece_bytes: usize) -> Outgoing {
        let bytes = match bytes {
            Ok(bytes) => bytes,
            Err(reason) => return Outgoing::Failed { id, reason },
        };
        let end = bytes.len().min(part.end as usize);
        let offset = (part.start as usize).min(end);
        self.begun.push(BlobTransfer { id, priority, bytes, offset, end });
        self.advance(self.begun.len() - 1, piece_bytes)
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

#[cfg(test)]
mod tests;
