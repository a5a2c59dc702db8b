//! A session's requests: requested and pushed units in one queue, and how much of each blob was sent.

use std::collections::{HashMap, HashSet, VecDeque};

use bytes::Bytes;

use crate::message::{RefusedReason, Want};
use crate::scheduler::{Cancelled, Outgoing, Scheduler, Unit};
use crate::source::{Reading, SceneSource, SourceError};
use lodestream_scene::blob::{BlobId, BlobPart};
use lodestream_scene::limits::MAX_BLOB_BYTES;
use lodestream_select::priority::{DIRECTORY, Priority};

/// The queue of a session and its record of what was sent.
#[derive(Debug)]
pub(super) struct Requests {
    pub(super) scheduler: Scheduler,
    /// Units sent in part or whole, and those the client says it has: up to which byte of the blob.
    sent: HashMap<Unit, u32>,
    /// Number of scene pages in `sent`.
    pages_sent: u32,
    /// End of the part of a blob that was pushed, until a request shows that the client has it.
    pushed_parts: HashMap<BlobId, u32>,
    /// Cancelled blobs that are not reported to the driver yet.
    abandoned: VecDeque<BlobId>,
    max_blob_bytes: u32,
    /// Whether the client has requested anything.
    has_requested: bool,
    /// Whether the client has requested chunks; then nothing more is pushed on a guess.
    has_requested_chunks: bool,
}

/// Outcome of a request for a scene page.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum PageRequest {
    /// It is queued.
    Queued,
    /// The queue is full, and the page was sent before, so it is not among the pushed units.
    Resend(Priority),
    /// The queue is full; the page was never sent and is still among the pushed units.
    StillPushed,
}

impl Requests {
    /// An empty queue.
    pub(super) fn new(max_queued: usize) -> Self {
        Self {
            scheduler: Scheduler::new(max_queued),
            sent: HashMap::new(),
            pages_sent: 0,
            pushed_parts: HashMap::new(),
            abandoned: VecDeque::new(),
            max_blob_bytes: MAX_BLOB_BYTES,
            has_requested: false,
            has_requested_chunks: false,
        }
    }

    /// Applies `Hello`: the longest blob that the client accepts and the blobs that it has.
    pub(super) fn open(&mut self, max_blob_bytes: u32, have: impl Iterator<Item = BlobId>) {
        self.max_blob_bytes = max_blob_bytes.min(MAX_BLOB_BYTES);
        self.sent.extend(have.map(|id| (Unit::Blob(id), u32::MAX)));
    }

    /// Ends the session.
    pub(super) fn clear(&mut self) {
        self.scheduler.clear();
        self.sent = HashMap::new();
        self.pushed_parts = HashMap::new();
        self.abandoned = VecDeque::new();
    }

    /// Whether the client has requested anything.
    pub(super) const fn has_requested(&self) -> bool {
        self.has_requested
    }

    /// Whether the client has requested chunks.
    pub(super) const fn has_requested_chunks(&self) -> bool {
        self.has_requested_chunks
    }

    /// Number of scene pages sent.
    pub(super) const fn pages_sent(&self) -> u32 {
        self.pages_sent
    }

    /// Whether a unit was sent in part or whole, or the client says that it has it.
    pub(super) fn was_sent(&self, unit: &Unit) -> bool {
        self.sent.contains_key(unit)
    }

    /// Whether a unit was sent or is queued.
    pub(super) fn has(&self, unit: &Unit) -> bool {
        self.was_sent(unit) || self.scheduler.contains(unit)
    }

    /// Queues the bytes of a requested part that were not sent.
    ///
    /// # Errors
    /// The reason to refuse the request with.
    pub(super) fn want(&mut self, source: &dyn SceneSource, want: &Want) -> Result<(), RefusedReason> {
        self.has_requested = true;
        self.has_requested_chunks |= matches!(want.id.part(), Some(BlobPart::Chunk(_)));
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
        let sent = self.sent.get(&unit).copied();
        if let Some(pushed) = self.pushed_parts.remove(&id)
            && sent.is_some()
            && offset < pushed
        {
            // The request crossed the pushed part. The client takes that part for the answer and accepts no second
            // run behind it; it requests the rest when it has the part.
            self.pushed_parts.insert(id, pushed);
            if self.scheduler.contains(&unit) {
                self.scheduler.want_part(unit, priority, 0..pushed);
            }
            return Ok(());
        }
        if sent.is_some_and(|sent| sent >= end) && !self.scheduler.contains(&unit) {
            return Ok(());
        }
        let part = offset.max(sent.unwrap_or(0))..end;
        if self.scheduler.want_part(unit, priority, part) { Ok(()) } else { Err(RefusedReason::QueueFull) }
    }

    /// Cancels a request and forgets what was sent of the blob.
    pub(super) fn cancel(&mut self, id: BlobId) {
        self.sent.remove(&Unit::Blob(id));
        self.pushed_parts.remove(&id);
        if self.scheduler.cancel(id) == Cancelled::BlobTransfer {
            self.abandoned.push_back(id);
        }
    }

    /// Queues a scene page, even if it was sent before.
    pub(super) fn want_page(&mut self, page: u32) -> PageRequest {
        let (unit, priority) = (Unit::Page(page), DIRECTORY);
        let resend = self.sent.remove(&unit).is_some();
        if resend {
            self.pages_sent = self.pages_sent.saturating_sub(1);
        }
        match self.scheduler.want(unit, priority) {
            true => PageRequest::Queued,
            false if resend => PageRequest::Resend(priority),
            false => PageRequest::StillPushed,
        }
    }

    /// Queues a blob that was not requested, up to `end` or whole. Returns `false` if the queue is full.
    pub(super) fn push_part(&mut self, id: BlobId, priority: Priority, end: Option<u32>) -> bool {
        let pushed = self.scheduler.want_part(Unit::Blob(id), priority, 0..end.unwrap_or(u32::MAX));
        if let (true, Some(end)) = (pushed, end) {
            self.pushed_parts.insert(id, end);
        }
        pushed
    }

    /// Withdraws the units of which nothing was sent.
    pub(super) fn withdraw(&mut self, units: &HashSet<Unit>) {
        let Self { scheduler, pushed_parts, .. } = self;
        scheduler.retain(|unit| {
            let dropped = units.contains(unit);
            if let (true, Unit::Blob(id)) = (dropped, unit) {
                pushed_parts.remove(id);
            }
            !dropped
        });
    }

    /// The next cancelled blob to report to the driver.
    pub(super) fn poll_abandoned(&mut self) -> Option<BlobId> {
        self.abandoned.pop_front()
    }

    /// Whether there is something for the driver.
    pub(super) fn has_work(&self) -> bool {
        !self.abandoned.is_empty() || self.scheduler.has_ready_work()
    }

    /// Takes the next unit or piece from the queue and records it as sent.
    pub(super) fn next(&mut self, source: &dyn SceneSource, piece_bytes: usize) -> Option<Outgoing> {
        let max_bytes = self.max_blob_bytes;
        let next = self.scheduler.next(piece_bytes, |id| match source.try_read(id)? {
            Reading::Ready(bytes) => check_length(max_bytes, *id, bytes).map(Reading::Ready),
            Reading::Pending => Ok(Reading::Pending),
        })?;
        match &next {
            Outgoing::Page { page, .. } => {
                if self.sent.insert(Unit::Page(*page), u32::MAX).is_none() {
                    self.pages_sent = self.pages_sent.saturating_add(1);
                }
            }
            Outgoing::Piece { piece, .. } => {
                let sent = self.sent.entry(Unit::Blob(piece.id)).or_insert(0);
                let length = u32::try_from(piece.bytes.len()).unwrap_or(u32::MAX);
                *sent = piece.offset.saturating_add(length).max(*sent);
            }
            Outgoing::Failed { .. } => {}
        }
        Some(next)
    }

    /// Takes the result of a read that [`Scheduler::poll_read`] requested.
    pub(super) fn handle_read(&mut self, id: BlobId, bytes: &Result<Bytes, SourceError>) {
        let checked = bytes.clone().and_then(|bytes| check_length(self.max_blob_bytes, id, bytes));
        self.scheduler.handle_read(id, &checked);
    }

    #[cfg(test)]
    pub(super) fn sent_count(&self) -> usize {
        self.sent.len()
    }

    #[cfg(test)]
    pub(super) fn abandoned_count(&self) -> usize {
        self.abandoned.len()
    }
}

fn check_length(max_bytes: u32, id: BlobId, bytes: Bytes) -> Result<Bytes, SourceError> {
    if bytes.len() > max_bytes as usize {
        let why = format!("it has {} bytes, the client accepts {max_bytes}", bytes.len());
        return Err(SourceError::Unreadable { id, why });
    }
    Ok(bytes)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::MemoryScene;

    /// Start and run end of all pieces until the queue is empty.
    fn drain(requests: &mut Requests, source: &dyn SceneSource) -> Vec<(u32, u32)> {
        let pieces = std::iter::from_fn(|| requests.next(source, 1 << 14)).filter_map(|next| match next {
            Outgoing::Piece { piece, .. } => Some((piece.offset, piece.end)),
            _ => None,
        });
        pieces.collect()
    }

    #[test]
    fn bytes_are_sent_once_until_cancelled() {
        let scene = MemoryScene::new(1, 1, 3);
        let mut requests = Requests::new(10);
        let id = BlobId::chunk(0, 3);
        let length = scene.blob_len(&id).unwrap();
        let want = Want::whole(id, 7);
        requests.want(&*scene, &Want { end: Some(300), ..want }).unwrap();
        assert_eq!(drain(&mut requests, &*scene), [(0, 300)]);
        requests.want(&*scene, &want).unwrap();
        assert_eq!(drain(&mut requests, &*scene), [(300, length)]);
        requests.want(&*scene, &want).unwrap();
        assert_eq!(drain(&mut requests, &*scene), []);
        requests.cancel(id);
        requests.want(&*scene, &want).unwrap();
        assert_eq!(drain(&mut requests, &*scene), [(0, length)]);
    }

    #[test]
    fn scene_pages_survive_a_full_queue() {
        let scene = MemoryScene::new(1, 40, 2);
        let mut requests = Requests::new(1);
        assert_eq!(requests.want_page(0), PageRequest::Queued);
        assert!(matches!(requests.next(&*scene, 100), Some(Outgoing::Page { page: 0, .. })));
        assert_eq!(requests.pages_sent(), 1);
        assert_eq!(requests.want_page(1), PageRequest::Queued);
        assert!(matches!(requests.want_page(0), PageRequest::Resend(_)));
        assert_eq!(requests.want_page(2), PageRequest::StillPushed);
        assert_eq!(requests.pages_sent(), 0);
    }

    #[test]
    fn height_overrides_are_not_chunks() {
        let scene = MemoryScene::new(1, 1, 3);
        let mut requests = Requests::new(10);
        let _ = requests.want(&*scene, &Want::whole(BlobId::height_overrides(0), 1));
        assert!(requests.has_requested() && !requests.has_requested_chunks());
        requests.want(&*scene, &Want::whole(BlobId::chunk(0, 0), 1)).unwrap();
        assert!(requests.has_requested_chunks());
    }
}
