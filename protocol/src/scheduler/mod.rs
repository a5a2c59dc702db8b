//! What is sent next: one session's queue of wanted blobs and scene pages.
//!
//! The queue hands out small pieces, one at a time, so that nothing is committed before the limiter
//! admits it. A blob that has begun is finished first, unless something arrives that is more urgent by
//! [`OVERTAKE`]; then it waits, half sent. Of a blob, any part may be wanted: what is sent of it at a time
//! is a run from one byte to another.
//!
//! A blob that the store has not at hand waits aside while others are sent ([`MAX_READS`] of them at most); from
//! then on, what comes next is read ahead while pieces are sent.

mod queue;
mod reads;

use std::cmp::Reverse;
use std::ops::Range;

use bytes::Bytes;

use crate::frame::BlobPiece;
use crate::message::RefusedReason;
use crate::source::{Reading, SourceError};
use lodestream_scene::blob::BlobId;
use lodestream_select::priority::Priority;

use queue::{Queue, Waiting};
pub use reads::MAX_READS;
use reads::{Key, Loaded, Reads, refusal};

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
    BlobTransfer,
}

#[derive(Debug)]
struct BlobTransfer {
    id: BlobId,
    priority: Priority,
    bytes: Bytes,
    offset: usize,
    end: usize,
}

/// Where what begins next is found.
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
        if let Unit::Blob(id) = unit
            && self.reads.want(id, priority, &part)
        {
            return true;
        }
        if self.queue.want(&unit, priority, &part) {
            return true;
        }
        if self.queue.len() >= self.max_queued {
            return false;
        }
        let key = (Reverse(priority), self.next_number);
        self.next_number += 1;
        self.queue.insert(Waiting { key, unit, part });
        true
    }

    /// Drops a blob. What has been handed out is gone.
    pub fn cancel(&mut self, id: BlobId) -> Cancelled {
        let queued = self.queue.remove(&Unit::Blob(id)).is_some();
        let read = self.reads.retain(|read| read != id);
        if let Some(index) = self.begun.iter().position(|begun| begun.id == id) {
            self.begun.remove(index);
            return Cancelled::BlobTransfer;
        }
        if queued || read { Cancelled::Queued } else { Cancelled::Unknown }
    }

    /// Drops the queued units, not begun, for which `keep` says no.
    pub fn retain(&mut self, mut keep: impl FnMut(&Unit) -> bool) {
        self.queue.retain(&mut keep);
        self.reads.retain(|id| keep(&Unit::Blob(id)));
    }

    /// Drops everything. What is under way from the store is dropped when it comes.
    pub fn clear(&mut self) {
        self.reads.clear();
        self.queue.clear();
        self.begun.clear();
    }

    /// Whether nothing is queued, nothing read and nothing begun.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.queue.is_empty() && self.begun.is_empty() && self.reads.is_empty()
    }

    /// Whether [`Scheduler::next`] may have something: `false` where all that is left waits for the store.
    #[must_use]
    pub fn can_go_on(&self) -> bool {
        !self.begun.is_empty()
            || self.reads.first().is_some()
            || self.peek().is_some_and(|(_, unit)| matches!(unit, Unit::Page(_)) || self.reads.has_room())
    }

    /// Units queued, begun ones and those that are read not counted.
    #[must_use]
    pub fn queued(&self) -> usize {
        self.queue.len()
    }

    /// Bytes of blobs that are queued, read or begun and not handed out, where `length` gives that of a blob. Looks at
    /// each.
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

    /// Whether a unit is queued, read or begun.
    #[must_use]
    pub fn contains(&self, unit: &Unit) -> bool {
        let under_way = |id: BlobId| self.reads.contains(id) || self.begun.iter().any(|begun| begun.id == id);
        self.queue.contains(unit) || matches!(unit, Unit::Blob(id) if under_way(*id))
    }

    /// Blobs that have begun and are not finished, with their priorities.
    pub fn begun(&self) -> impl Iterator<Item = (Priority, Unit)> + '_ {
        self.begun.iter().map(|begun| (begun.priority, Unit::Blob(begun.id)))
    }

    /// The next unit that would begin if none were begun: its priority and itself.
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

    /// Hands out the next piece of at most `piece_bytes`, reading blobs by `read` as they begin. What it cannot give
    /// at once is told by [`Scheduler::poll_read`], and others go first.
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
                    let Waiting { key, unit, part } = self.queue.pop()?;
                    let Reverse(priority) = key.0;
                    let id = match unit {
                        Unit::Page(page) => return Some(Outgoing::Page(page)),
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

    /// What may begin now, if anything: nothing where a begun blob goes first, or all waits for the store.
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

    /// Has the store read what comes next, while others are sent.
    fn read_ahead(&mut self, read: &mut impl FnMut(&BlobId) -> Result<Reading, SourceError>) {
        while self.reads.has_room()
            && let Some((_, Unit::Blob(id))) = self.queue.first()
        {
            let Some(Waiting { key, part, .. }) = self.queue.pop() else { return };
            match read(&id) {
                Ok(Reading::Ready(bytes)) => self.reads.keep(id, key, part, Ok(bytes)),
                Ok(Reading::Pending) => self.reads.wait(id, key, part),
                Err(why) => self.reads.keep(id, key, part, Err(refusal(&why))),
            }
        }
    }

    /// The next blob that the driver should have the store read. It answers by [`Scheduler::handle_read`].
    pub fn poll_read(&mut self) -> Option<BlobId> {
        self.reads.poll()
    }

    /// Takes what the store has read. Blobs that nobody waits for any longer are dropped.
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

/// Sources give blobs of at most `MAX_BLOB_BYTES`, as the session checks before it queues them.
fn number(n: usize) -> u32 {
    u32::try_from(n).unwrap_or(u32::MAX)
}

#[cfg(test)]
mod tests;
