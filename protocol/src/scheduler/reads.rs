//! A session's reads from the store: blobs that are being read or were read ahead, at most [`MAX_READS`], unordered.

use std::cmp::Reverse;
use std::ops::Range;

use bytes::Bytes;

use crate::message::RefusedReason;
use crate::source::SourceError;
use lodestream_scene::blob::BlobId;
use lodestream_select::priority::Priority;

/// Order in the queue: most urgent first, then first come, first served.
pub(super) type Key = (Reverse<Priority>, u64);

/// Most reads of a session, outstanding or read ahead. Each holds the blob in memory. More would waste reads when the
/// view changes; fewer leave the link idle if a read takes long.
pub const MAX_READS: usize = 8;

/// Progress of a read.
#[derive(Clone, Debug)]
enum Stage {
    /// Not reported to the driver yet.
    Due,
    /// The driver is reading it.
    Outstanding,
    /// Finished, with the bytes or a reason.
    Done(Result<Bytes, RefusedReason>),
}

#[derive(Debug)]
struct Read {
    id: BlobId,
    stage: Stage,
    /// Position in the order and wanted part; `None` if the request was withdrawn while the read was outstanding.
    purpose: Option<(Key, Range<u32>)>,
}

/// A blob whose read is finished.
#[derive(Debug)]
pub(super) struct Loaded {
    pub(super) id: BlobId,
    pub(super) priority: Priority,
    pub(super) part: Range<u32>,
    pub(super) bytes: Result<Bytes, RefusedReason>,
}

/// The reads of one session.
#[derive(Debug, Default)]
pub(super) struct Reads {
    list: Vec<Read>,
    /// Whether a read was ever pending; then blobs are read ahead.
    slow: bool,
}

/// The refusal of a blob that could not be read.
pub(super) const fn refusal(error: &SourceError) -> RefusedReason {
    match error {
        SourceError::NotFound(_) => RefusedReason::NotFound,
        SourceError::Unreadable { .. } => RefusedReason::Unreadable,
    }
}

impl Reads {
    /// Whether another blob may be read.
    pub(super) const fn has_room(&self) -> bool {
        self.list.len() < MAX_READS
    }

    /// Whether blobs should be read ahead.
    pub(super) const fn is_slow(&self) -> bool {
        self.slow
    }

    /// Adds a read that must wait for the store. Reuses an outstanding read of the blob whose request was withdrawn.
    pub(super) fn wait(&mut self, id: BlobId, key: Key, part: Range<u32>) {
        self.slow = true;
        match self.list.iter_mut().find(|read| read.id == id && read.purpose.is_none()) {
            Some(read) => read.purpose = Some((key, part)),
            None => self.list.push(Read { id, stage: Stage::Due, purpose: Some((key, part)) }),
        }
    }

    /// Adds a blob that was read ahead at once.
    pub(super) fn insert_done(
        &mut self,
        id: BlobId,
        key: Key,
        part: Range<u32>,
        bytes: Result<Bytes, RefusedReason>,
    ) {
        self.list.push(Read { id, stage: Stage::Done(bytes), purpose: Some((key, part)) });
    }

    /// The next read that the driver should start.
    pub(super) fn poll(&mut self) -> Option<BlobId> {
        let read = self.list.iter_mut().find(|read| matches!(read.stage, Stage::Due))?;
        read.stage = Stage::Outstanding;
        Some(read.id)
    }

    /// Takes the result of a read that the driver started. Drops it if its request was withdrawn.
    pub(super) fn done(&mut self, id: BlobId, bytes: &Result<Bytes, SourceError>) {
        self.list.retain_mut(|read| {
            if read.id == id && !matches!(read.stage, Stage::Done(_)) {
                read.stage = Stage::Done(match bytes {
                    Ok(bytes) => Ok(bytes.clone()),
                    Err(error) => Err(refusal(error)),
                });
            }
            read.purpose.is_some() || !matches!(read.stage, Stage::Done(_))
        });
    }

    /// Key of the most urgent blob whose read is finished.
    pub(super) fn first(&self) -> Option<Key> {
        self.list.iter().filter(|read| matches!(read.stage, Stage::Done(_))).filter_map(Read::key).min()
    }

    /// Removes the blob with a key that [`Reads::first`] returned.
    pub(super) fn take(&mut self, key: Key) -> Option<Loaded> {
        let index = self.list.iter().position(|read| read.key() == Some(key))?;
        match self.list.swap_remove(index) {
            Read { id, stage: Stage::Done(bytes), purpose: Some(((Reverse(priority), _), part)) } => {
                Some(Loaded { id, priority, part, bytes })
            }
            _ => None,
        }
    }

    /// Whether something is read, or to be read, for this blob.
    pub(super) fn contains(&self, id: BlobId) -> bool {
        self.list.iter().any(|read| read.id == id && read.purpose.is_some())
    }

    /// The requested parts of the blobs being read.
    pub(super) fn wanted(&self) -> impl Iterator<Item = (BlobId, &Range<u32>)> {
        self.list.iter().filter_map(|read| read.purpose.as_ref().map(|(_, part)| (read.id, part)))
    }

    /// Whether no session waits for a read.
    pub(super) fn is_empty(&self) -> bool {
        self.list.iter().all(|read| read.purpose.is_none())
    }

    /// Changes the priority and the requested part of a blob being read; `false` if it is not being read.
    pub(super) fn want(&mut self, id: BlobId, priority: Priority, part: &Range<u32>) -> bool {
        let purposes =
            self.list.iter_mut().filter(|read| read.id == id).filter_map(|read| read.purpose.as_mut());
        let Some((key, wanted)) = purposes.into_iter().next() else { return false };
        key.0 = Reverse(priority);
        *wanted = wanted.start.min(part.start)..wanted.end.max(part.end);
        true
    }

    /// Drops what `keep` says no to; `true` if there was such. What is under way from the store stays counted until it
    /// is here.
    pub(super) fn retain(&mut self, mut keep: impl FnMut(BlobId) -> bool) -> bool {
        let mut dropped = false;
        self.list.retain_mut(|read| {
            if read.purpose.is_none() || keep(read.id) {
                return true;
            }
            dropped = true;
            read.purpose = None;
            matches!(read.stage, Stage::Outstanding)
        });
        dropped
    }

    pub(super) fn clear(&mut self) {
        self.list.clear();
    }
}

impl Read {
    fn key(&self) -> Option<Key> {
        self.purpose.as_ref().map(|(key, _)| *key)
    }
}
