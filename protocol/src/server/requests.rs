//! What a session sends and has sent: what was asked for and what is pushed, in one queue, and how far the client has
//! each.

use std::collections::{HashMap, HashSet, VecDeque};

use bytes::Bytes;

use crate::message::{RefusedReason, Want};
use crate::scheduler::{Cancelled, Outgoing, Scheduler, Unit};
use crate::source::{Reading, SceneSource, SourceError};
use lodestream_scene::blob::{BlobId, BlobPart};
use lodestream_scene::limits::MAX_BLOB_BYTES;
use lodestream_select::priority::{DIRECTORY, Priority};

/// See the module.
#[derive(Debug)]
pub(super) struct Requests {
    pub(super) scheduler: Scheduler,
    /// What has begun to be handed over, or what the client says it has: how far, in bytes of a blob.
    handed: HashMap<Unit, u32>,
    /// Pages among `handed`.
    pages_handed: u32,
    /// Where the part ends that was pushed of a blob, until the client shows that it has it.
    pushed_parts: HashMap<BlobId, u32>,
    /// Blobs whose rest will not come, not told yet.
    abandoned: VecDeque<BlobId>,
    max_blob_bytes: u32,
    /// The client asks for itself.
    asks: bool,
    /// The client knows enough to ask for chunks: it needs no more guesses.
    refines: bool,
}

/// What became of a request for a page of the scene.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum PageWanted {
    /// It is queued.
    Queued,
    /// There is no room: it was sent before, so nobody else has it waiting.
    Again(Priority),
    /// There is no room, but it has not been sent: it waits among what is pushed.
    Waits,
}

impl Requests {
    /// Nothing queued, nothing sent.
    pub(super) fn new(max_queued: usize) -> Self {
        Self {
            scheduler: Scheduler::new(max_queued),
            handed: HashMap::new(),
            pages_handed: 0,
            pushed_parts: HashMap::new(),
            abandoned: VecDeque::new(),
            max_blob_bytes: MAX_BLOB_BYTES,
            asks: false,
            refines: false,
        }
    }

    /// The client takes no longer blobs than this, and has these already.
    pub(super) fn open(&mut self, max_blob_bytes: u32, have: impl Iterator<Item = BlobId>) {
        self.max_blob_bytes = max_blob_bytes.min(MAX_BLOB_BYTES);
        self.handed.extend(have.map(|id| (Unit::Blob(id), u32::MAX)));
    }

    /// The session is over.
    pub(super) fn clear(&mut self) {
        self.scheduler.clear();
        self.handed = HashMap::new();
        self.pushed_parts = HashMap::new();
        self.abandoned = VecDeque::new();
    }

    /// Whether the client has asked for anything.
    pub(super) const fn asks(&self) -> bool {
        self.asks
    }

    /// Whether the client has asked for chunks.
    pub(super) const fn refines(&self) -> bool {
        self.refines
    }

    /// Pages of the scene that were sent.
    pub(super) const fn pages_handed(&self) -> u32 {
        self.pages_handed
    }

    /// Whether some of a unit was sent, or the client says that it has it.
    pub(super) fn was_handed(&self, unit: &Unit) -> bool {
        self.handed.contains_key(unit)
    }

    /// Whether a unit was sent, or is about to be.
    pub(super) fn has(&self, unit: &Unit) -> bool {
        self.was_handed(unit) || self.scheduler.contains(unit)
    }

    /// Queues what is missing of the part that is wanted.
    ///
    /// # Errors
    /// What to tell the client.
    pub(super) fn want(&mut self, source: &dyn SceneSource, want: &Want) -> Result<(), RefusedReason> {
        self.asks = true;
        self.refines |= matches!(want.id.part(), Some(BlobPart::Chunk(_)));
        let Want { id, priority, offset, end } = *want;
        let unit = Unit::Blob(id);
        let length = source.blob_len(&id).ok_or(RefusedReason::NotFound)?;
        if length > self.max_blob_bytes {
            return Err(RefusedReason::TooLong);
        }
        let end = end.unwrap_or(length);
        if end > length || (offset >= end && length > 0) || offset > length {
            return Err(RefusedReason::OutOfRange);
        }
        let handed = self.handed.get(&unit).copied();
        if let Some(pushed) = self.pushed_parts.remove(&id)
            && handed.is_some()
            && offset < pushed
        {
            // The wish has met the pushed part on its way, which the client takes for all of this run: it
            // would not know what to do with another behind it. It asks on from there when it has it.
            self.pushed_parts.insert(id, pushed);
            if self.scheduler.contains(&unit) {
                self.scheduler.want_part(unit, priority, 0..pushed);
            }
            return Ok(());
        }
        if handed.is_some_and(|handed| handed >= end) && !self.scheduler.contains(&unit) {
            return Ok(());
        }
        let part = offset.max(handed.unwrap_or(0))..end;
        if self.scheduler.want_part(unit, priority, part) { Ok(()) } else { Err(RefusedReason::QueueFull) }
    }

    /// Takes a request back, and forgets what was sent of the blob.
    pub(super) fn cancel(&mut self, id: BlobId) {
        self.handed.remove(&Unit::Blob(id));
        self.pushed_parts.remove(&id);
        if self.scheduler.cancel(id) == Cancelled::BlobTransfer {
            self.abandoned.push_back(id);
        }
    }

    /// Queues a page of the scene, again if it was sent.
    pub(super) fn want_page(&mut self, page: u32) -> PageWanted {
        let (unit, priority) = (Unit::Page(page), DIRECTORY);
        let again = self.handed.remove(&unit).is_some();
        if again {
            self.pages_handed = self.pages_handed.saturating_sub(1);
        }
        match self.scheduler.want(unit, priority) {
            true => PageWanted::Queued,
            false if again => PageWanted::Again(priority),
            false => PageWanted::Waits,
        }
    }

    /// Queues a blob that nobody asked for, up to `end` if not whole. `false` where the queue is full.
    pub(super) fn push_part(&mut self, id: BlobId, priority: Priority, end: Option<u32>) -> bool {
        let pushed = self.scheduler.want_part(Unit::Blob(id), priority, 0..end.unwrap_or(u32::MAX));
        if let (true, Some(end)) = (pushed, end) {
            self.pushed_parts.insert(id, end);
        }
        pushed
    }

    /// Takes back what of these has not begun.
    pub(super) fn take_back(&mut self, units: &HashSet<Unit>) {
        let Self { scheduler, pushed_parts, .. } = self;
        scheduler.retain(|unit| {
            let dropped = units.contains(unit);
            if let (true, Unit::Blob(id)) = (dropped, unit) {
                pushed_parts.remove(id);
            }
            !dropped
        });
    }

    /// The next blob whose rest will not come.
    pub(super) fn poll_abandoned(&mut self) -> Option<BlobId> {
        self.abandoned.pop_front()
    }

    /// Whether there is something to hand over, or to say of what was.
    pub(super) fn has_work(&self) -> bool {
        !self.abandoned.is_empty() || self.scheduler.can_go_on()
    }

    /// The next thing to send; it counts as sent.
    pub(super) fn next(&mut self, source: &dyn SceneSource, piece_bytes: usize) -> Option<Outgoing> {
        let longest = self.max_blob_bytes;
        let next = self.scheduler.next(piece_bytes, |id| match source.try_read(id)? {
            Reading::Ready(bytes) => not_longer(longest, *id, bytes).map(Reading::Ready),
            Reading::Pending => Ok(Reading::Pending),
        })?;
        match &next {
            Outgoing::Page(page) => {
                if self.handed.insert(Unit::Page(*page), u32::MAX).is_none() {
                    self.pages_handed = self.pages_handed.saturating_add(1);
                }
            }
            Outgoing::Piece { piece, .. } => {
                let handed = self.handed.entry(Unit::Blob(piece.id)).or_insert(0);
                let length = u32::try_from(piece.bytes.len()).unwrap_or(u32::MAX);
                *handed = piece.offset.saturating_add(length).max(*handed);
            }
            Outgoing::Failed { .. } => {}
        }
        Some(next)
    }

    /// A read that [`Scheduler::poll_read`] gave is done.
    pub(super) fn handle_read(&mut self, id: BlobId, bytes: &Result<Bytes, SourceError>) {
        let checked = bytes.clone().and_then(|bytes| not_longer(self.max_blob_bytes, id, bytes));
        self.scheduler.handle_read(id, &checked);
    }

    #[cfg(test)]
    pub(super) fn handed_count(&self) -> usize {
        self.handed.len()
    }

    #[cfg(test)]
    pub(super) fn abandoned_count(&self) -> usize {
        self.abandoned.len()
    }
}

fn not_longer(longest: u32, id: BlobId, bytes: Bytes) -> Result<Bytes, SourceError> {
    if bytes.len() > longest as usize {
        let why = format!("{} bytes are more than the client takes", bytes.len());
        return Err(SourceError::Unreadable { id, why });
    }
    Ok(bytes)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::MemoryScene;

    /// What is sent of a blob until nothing is left: where runs begin and end.
    fn sent(requests: &mut Requests, source: &dyn SceneSource) -> Vec<(u32, u32)> {
        let pieces = std::iter::from_fn(|| requests.next(source, 1 << 14)).filter_map(|next| match next {
            Outgoing::Piece { piece, .. } => Some((piece.offset, piece.end)),
            _ => None,
        });
        pieces.collect()
    }

    #[test]
    fn bytes_are_sent_once_until_they_are_taken_back() {
        let scene = MemoryScene::new(1, 1, 3);
        let mut requests = Requests::new(10);
        let id = BlobId::chunk(0, 3);
        let length = scene.blob_len(&id).unwrap();
        let want = Want::whole(id, 7);
        requests.want(&*scene, &Want { end: Some(300), ..want }).unwrap();
        assert_eq!(sent(&mut requests, &*scene), [(0, 300)]);
        requests.want(&*scene, &want).unwrap();
        assert_eq!(sent(&mut requests, &*scene), [(300, length)]);
        requests.want(&*scene, &want).unwrap();
        assert_eq!(sent(&mut requests, &*scene), []);
        requests.cancel(id);
        requests.want(&*scene, &want).unwrap();
        assert_eq!(sent(&mut requests, &*scene), [(0, length)]);
    }

    #[test]
    fn pages_of_the_scene_that_find_no_room_are_not_forgotten() {
        let scene = MemoryScene::new(1, 40, 2);
        let mut requests = Requests::new(1);
        assert_eq!(requests.want_page(0), PageWanted::Queued);
        assert!(matches!(requests.next(&*scene, 100), Some(Outgoing::Page(0))));
        assert_eq!(requests.pages_handed(), 1);
        assert_eq!(requests.want_page(1), PageWanted::Queued);
        assert!(matches!(requests.want_page(0), PageWanted::Again(_)));
        assert_eq!(requests.want_page(2), PageWanted::Waits);
        assert_eq!(requests.pages_handed(), 0);
    }

    #[test]
    fn points_of_a_terrain_are_no_chunks() {
        let scene = MemoryScene::new(1, 1, 3);
        let mut requests = Requests::new(10);
        let _ = requests.want(&*scene, &Want::whole(BlobId::terrain_points(0), 1));
        assert!(requests.asks() && !requests.refines());
        requests.want(&*scene, &Want::whole(BlobId::chunk(0, 0), 1)).unwrap();
        assert!(requests.refines());
    }
}
