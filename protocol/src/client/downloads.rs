//! Blobs asked for and arriving: the books of a session.

use std::cmp::Reverse;
use std::collections::{BTreeMap, BTreeSet};

use bytes::Bytes;

use crate::frame::BlobPiece;
use crate::message::{ClientMessage, Want};
use lodestream_scene::blob::{BlobId, BlobPart};
use lodestream_scene::limits::MAX_IDS_PER_MESSAGE;
use lodestream_select::{Priority, State, Wanted};

/// Bytes assumed of a blob whose length is not known yet.
const ASSUMED_BYTES: u32 = 1500;
/// Most blobs that are partly here. A server keeps fewer than ten open at once.
pub(super) const MAX_PARTIAL: usize = 1024;
/// Change of priority that is worth telling: a quarter octave of screen error.
const PRIORITY_CHANGE: Priority = 1 << 21;

/// A piece that a server has no business to send: the session ends.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum DownloadError {
    /// Beyond its run, its blob, or what is taken.
    #[error("{0} is longer than announced or allowed")]
    TooLong(BlobId),
    /// More blobs are begun than a server keeps open.
    #[error("too many blobs at once")]
    TooMany,
    /// The scene or the index announced another length.
    #[error("{id} has {total} bytes, but {announced} were announced")]
    OtherLength {
        /// The blob.
        id: BlobId,
        /// What the piece says.
        total: u32,
        /// What was announced.
        announced: u32,
    },
}

/// A blob, or the part of it that was sent, all of whose pieces are here.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Complete {
    pub(super) id: BlobId,
    pub(super) offset: u32,
    pub(super) total: u32,
    pub(super) bytes: Bytes,
}

/// A blob that is asked for, or arriving.
#[derive(Debug, Default)]
pub(super) struct Pending {
    /// The priority last told; `None` for what the server sends unasked.
    pub(super) asked: Option<Priority>,
    /// The length that scene or index announced.
    expected: Option<u32>,
    /// The part that is asked for: from here, to here if not to the blob's end.
    from: u32,
    to: Option<u32>,
    /// Where the run ends that the pieces belong to, once the first is here.
    end: Option<u32>,
    pub(super) received: Vec<u8>,
}

impl Pending {
    pub(super) fn left(&self) -> u64 {
        let end = self.end.or(self.to).or(self.expected).unwrap_or(ASSUMED_BYTES);
        u64::from(end).saturating_sub(u64::from(self.from) + self.received.len() as u64)
    }
}

/// How much is asked for at a time.
#[derive(Clone, Copy, Debug)]
pub(super) struct Depth {
    /// Bytes under way that the server sends before what is asked for next.
    pub(super) ahead_bytes: u64,
    /// Bytes under way in all.
    pub(super) most_bytes: u64,
    /// Longest blob taken.
    pub(super) max_blob_bytes: u32,
}

/// See the module.
#[derive(Debug, Default)]
pub(super) struct Downloads {
    pub(super) pending: BTreeMap<BlobId, Pending>,
    /// Sum of what is left of the blobs asked for.
    pub(super) in_flight_bytes: u64,
    /// To be told: requests new or changed, and requests taken back.
    wants: BTreeSet<BlobId>,
    cancels: BTreeSet<BlobId>,
    /// Lengths of base meshes, by asset.
    base_bytes: BTreeMap<u32, u32>,
    /// Blobs completed.
    pub(super) completed: u64,
}

impl Downloads {
    /// The scene says how long an asset's base mesh is.
    pub(super) fn announce_base(&mut self, asset: u32, bytes: u32) {
        self.base_bytes.insert(asset, bytes);
    }

    /// Takes a piece; gives the blob if that completes it.
    ///
    /// Pieces that do not continue what is here are passed over: they belong to a blob that was cancelled
    /// while they were under way.
    ///
    /// # Errors
    /// What ends the session.
    pub(super) fn take(
        &mut self,
        piece: BlobPiece,
        max_blob_bytes: u32,
    ) -> Result<Option<Complete>, DownloadError> {
        let BlobPiece { id, offset, end: run_end, total, bytes } = piece;
        let end = u64::from(offset) + bytes.len() as u64;
        if total > max_blob_bytes || run_end > total || end > u64::from(run_end) {
            return Err(DownloadError::TooLong(id));
        }
        let known_base = match id {
            BlobId::Asset { asset, part: BlobPart::Base } => self.base_bytes.get(&asset).copied(),
            _ => None,
        };
        if offset > 0 && !self.pending.contains_key(&id) {
            return Ok(None);
        }
        let begins = self.pending.get(&id).map_or(0, |pending| pending.from) == offset;
        if begins && self.pending.values().filter(|p| !p.received.is_empty()).count() >= MAX_PARTIAL {
            return Err(DownloadError::TooMany);
        }
        let pending = self.pending.entry(id).or_default();
        pending.expected = pending.expected.or(known_base);
        if let Some(announced) = pending.expected
            && announced != total
        {
            return Err(DownloadError::OtherLength { id, total, announced });
        }
        if begins {
            // The length is the peer's word: memory is taken as bytes arrive, not in advance.
            let before = pending.left();
            pending.received.clear();
            pending.end = Some(run_end);
            let after = pending.left();
            if pending.asked.is_some() {
                self.in_flight_bytes = self.in_flight_bytes.saturating_sub(before).saturating_add(after);
            }
        } else if u64::from(pending.from) + pending.received.len() as u64 != u64::from(offset)
            || pending.end != Some(run_end)
        {
            return Ok(None);
        }
        let before = pending.left();
        pending.received.extend_from_slice(&bytes);
        if pending.asked.is_some() {
            self.in_flight_bytes = self.in_flight_bytes.saturating_sub(before - pending.left());
        }
        if end != u64::from(run_end) {
            return Ok(None);
        }
        let offset = pending.from;
        let bytes = Bytes::from(std::mem::take(&mut pending.received));
        // Nothing of it is left in flight.
        self.pending.remove(&id);
        self.wants.remove(&id);
        self.cancels.remove(&id);
        self.completed += 1;
        Ok(Some(Complete { id, offset, total, bytes }))
    }

    /// Drops all that is known of a request.
    pub(super) fn forget(&mut self, id: BlobId) {
        if let Some(pending) = self.pending.remove(&id)
            && pending.asked.is_some()
        {
            self.in_flight_bytes = self.in_flight_bytes.saturating_sub(pending.left());
        }
        self.wants.remove(&id);
    }

    /// The stream of a blob was reset: what came of it is dropped.
    pub(super) fn abandoned(&mut self, id: BlobId) {
        // A blob that was asked for again since is still to come, on another stream.
        if let Some(pending) = self.pending.get_mut(&id) {
            let before = pending.left();
            pending.received.clear();
            pending.end = None;
            if pending.asked.is_some() {
                let in_flight = self.in_flight_bytes.saturating_sub(before);
                self.in_flight_bytes = in_flight.saturating_add(pending.left());
            } else {
                self.pending.remove(&id);
            }
        }
    }

    /// Nothing more will come.
    pub(super) fn clear(&mut self) {
        self.pending.clear();
        self.in_flight_bytes = 0;
        self.wants.clear();
        self.cancels.clear();
    }

    /// Asks for as much of what is wanted, most urgent first, as `depth` allows, notes changed priorities and takes
    /// the rest back. Gives the blobs newly asked for.
    pub(super) fn set_wanted(&mut self, wanted: &[Wanted], cancel: &[BlobId], depth: Depth) -> Vec<BlobId> {
        for &id in cancel {
            if self.pending.get(&id).is_some_and(|pending| pending.asked.is_some()) {
                self.forget(id);
                self.cancels.insert(id);
            }
        }
        let mut asked = Vec::new();
        let mut in_flight = self.in_flight_by_urgency().into_iter().peekable();
        // Bytes under way that the server sends before what is looked at.
        let mut ahead = 0_u64;
        for &Wanted { id, priority, bytes, state, held, end, .. } in wanted {
            while let Some((_, left)) = in_flight.next_if(|(told, _)| *told >= priority) {
                ahead = ahead.saturating_add(left);
            }
            if matches!(state, State::Cached | State::Applied | State::Failed) {
                continue;
            }
            if let Some(pending) = self.pending.get_mut(&id)
                && let Some(told) = &mut pending.asked
            {
                if told.abs_diff(priority) >= PRIORITY_CHANGE {
                    *told = priority;
                    self.wants.insert(id);
                }
                continue;
            }
            if ahead >= depth.ahead_bytes
                || self.in_flight_bytes >= depth.most_bytes
                || bytes.is_some_and(|b| b > depth.max_blob_bytes)
            {
                continue;
            }
            let pending = self.pending.entry(id).or_default();
            pending.asked = Some(priority);
            pending.expected = pending.expected.or(bytes);
            // What the server sends unasked begins at the blob's beginning.
            if pending.received.is_empty() {
                (pending.from, pending.to) = (held, end);
            }
            let left = pending.left();
            self.in_flight_bytes = self.in_flight_bytes.saturating_add(left);
            ahead = ahead.saturating_add(left);
            self.wants.insert(id);
            asked.push(id);
        }
        asked
    }

    /// What is under way, most urgent first: the priority last told, and bytes. What the server sends unasked comes
    /// before all that is asked for.
    fn in_flight_by_urgency(&self) -> Vec<(Priority, u64)> {
        let mut in_flight: Vec<(Priority, u64)> = self
            .pending
            .values()
            .map(|pending| (pending.asked.unwrap_or(Priority::MAX), pending.left()))
            .collect();
        in_flight.sort_unstable_by_key(|&(priority, _)| Reverse(priority));
        in_flight
    }

    /// The server should forget that it sent these, unless they are asked for again already.
    pub(super) fn give_back(&mut self, ids: &[BlobId]) {
        self.cancels.extend(ids.iter().filter(|id| !self.pending.contains_key(id)));
    }

    /// The next message to send: what is taken back, then what is asked for.
    pub(super) fn poll_message(&mut self) -> Option<ClientMessage> {
        if !self.cancels.is_empty() {
            return Some(ClientMessage::Cancel(take_first(&mut self.cancels, MAX_IDS_PER_MESSAGE)));
        }
        if self.wants.is_empty() {
            return None;
        }
        let ids = take_first(&mut self.wants, MAX_IDS_PER_MESSAGE);
        let mut wants: Vec<Want> = ids
            .into_iter()
            .filter_map(|id| {
                let &Pending { asked, from, to, .. } = self.pending.get(&id)?;
                Some(Want { id, priority: asked?, offset: from, end: to })
            })
            .collect();
        wants.sort_by_key(|want| (Reverse(want.priority), want.id));
        Some(ClientMessage::Want(wants))
    }
}

/// Takes the first few out of a set.
pub(super) fn take_first<T: Ord + Copy>(set: &mut BTreeSet<T>, count: usize) -> Vec<T> {
    let mut taken = Vec::with_capacity(set.len().min(count));
    while taken.len() < count
        && let Some(first) = set.pop_first()
    {
        taken.push(first);
    }
    taken
}

#[cfg(test)]
mod tests {
    use super::*;

    const DEPTH: Depth = Depth { ahead_bytes: 10_000, most_bytes: 100_000, max_blob_bytes: 5000 };

    fn piece(id: BlobId, offset: u32, length: usize, total: u32) -> BlobPiece {
        BlobPiece { id, offset, end: total, total, bytes: vec![7; length].into() }
    }

    #[test]
    fn longer_blobs_than_are_taken_are_not_asked_for() {
        let mut downloads = Downloads::default();
        let wanted = |chunk, bytes| Wanted::whole(BlobId::chunk(0, chunk), 9, Some(bytes), State::Absent);
        let asked = downloads.set_wanted(&[wanted(1, 5001), wanted(2, 5000)], &[], DEPTH);
        assert_eq!(asked, [BlobId::chunk(0, 2)]);
        assert_eq!(downloads.in_flight_bytes, 5000);
    }

    #[test]
    fn pieces_that_break_the_rules_are_told_apart() {
        let mut downloads = Downloads::default();
        let id = BlobId::base(3);
        downloads.announce_base(3, 100);
        let other = DownloadError::OtherLength { id, total: 101, announced: 100 };
        assert_eq!(downloads.take(piece(id, 0, 10, 101), 5000), Err(other));
        assert_eq!(downloads.take(piece(id, 0, 10, 5001), 5000), Err(DownloadError::TooLong(id)));
        let beyond = BlobPiece { end: 5, ..piece(id, 0, 10, 100) };
        assert_eq!(downloads.take(beyond, 5000), Err(DownloadError::TooLong(id)));
    }

    #[test]
    fn what_is_given_back_is_said_once_and_not_if_it_is_asked_for() {
        let mut downloads = Downloads::default();
        let (here, asked) = (BlobId::chunk(0, 1), BlobId::chunk(0, 2));
        downloads.set_wanted(&[Wanted::whole(asked, 9, Some(100), State::Absent)], &[], DEPTH);
        downloads.give_back(&[here, asked]);
        assert_eq!(downloads.poll_message(), Some(ClientMessage::Cancel(vec![here])));
        assert!(matches!(downloads.poll_message(), Some(ClientMessage::Want(wants)) if wants.len() == 1));
        assert_eq!(downloads.poll_message(), None);
    }
}
