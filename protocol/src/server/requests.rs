//! What the client asks for, and takes back.

use super::ServerSession;
use crate::blob::{BlobId, BlobPart};
use crate::message::{Refused, RefusedReason, ServerMessage, Want};
use crate::scheduler::{Cancelled, Unit};
use crate::select::priority::index_priority;

impl ServerSession {
    pub(super) fn want(&mut self, wants: &[Want]) {
        self.client_wants = true;
        self.done_told = false;
        for want in wants {
            // Points of a terrain say nothing of chunks.
            self.client_refines |= matches!(want.id.part(), Some(BlobPart::Chunk(_)));
            self.unasked.remove(&Unit::Blob(want.id));
            if let Err(reason) = self.want_one(want) {
                self.tell(ServerMessage::Refused(Refused { id: want.id, reason }));
            }
        }
    }

    /// Queues what is missing of the part that is wanted.
    fn want_one(&mut self, want: &Want) -> Result<(), RefusedReason> {
        let Want { id, priority, offset, end } = *want;
        let unit = Unit::Blob(id);
        let length = self.source.blob_len(&id).ok_or(RefusedReason::NotFound)?;
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

    pub(super) fn cancel(&mut self, ids: &[BlobId]) {
        for &id in ids {
            self.handed.remove(&Unit::Blob(id));
            self.pushed_parts.remove(&id);
            self.bases_left.remove(&Unit::Blob(id));
            if self.scheduler.cancel(id) == Cancelled::Begun {
                self.abandoned.push_back(id);
            }
        }
    }

    pub(super) fn want_pages(&mut self, pages: &[u32]) {
        self.done_told = false;
        for &page in pages {
            if page < self.source.header().page_count {
                let (unit, priority) = (Unit::Page(page), index_priority(f32::MAX));
                let was_handed = self.handed.remove(&unit).is_some();
                if was_handed {
                    self.pages_handed = self.pages_handed.saturating_sub(1);
                }
                // Where the queue is full, it waits with what is pushed; what was not handed over is there already.
                if !self.scheduler.want(unit, priority) && was_handed {
                    self.push.push((priority, unit));
                }
            }
        }
    }
}
