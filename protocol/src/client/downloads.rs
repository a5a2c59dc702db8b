//! A client session's record of requested and arriving blobs: the only one of what is requested.

use std::cmp::Reverse;
use std::collections::{BTreeMap, BTreeSet};

use bytes::Bytes;

use crate::frame::BlobPiece;
use crate::message::{ClientMessage, Want};
use lodestream_scene::blob::{BlobId, BlobPart};
use lodestream_scene::limits::MAX_IDS_PER_MESSAGE;
use lodestream_select::{Priority, State, Wanted};

/// Assumed length of a blob whose length is not known yet.
const ASSUMED_BYTES: u32 = 1500;
/// Most partly received blobs. A server has fewer than ten runs open at once.
pub(super) const MAX_PARTIAL: usize = 1024;
/// Least change of priority that is sent to the server: a factor of 2^¼ in visible difference per byte.
const PRIORITY_CHANGE: Priority = 1 << 21;

/// A piece that breaks the protocol; it ends the session.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum DownloadError {
    /// It exceeds its run, its blob or the longest blob that the client accepts.
    #[error("{0} is longer than announced or allowed")]
    TooLong(BlobId),
    /// More than `MAX_PARTIAL` blobs are partly received.
    #[error("too many blobs at once")]
    TooMany,
    /// The scene or the index announced another length.
    #[error("{id} has {total} bytes, but {announced} were announced")]
    OtherLength {
        /// The blob.
        id: BlobId,
        /// Length that the piece states.
        total: u32,
        /// Length in the scene page or index.
        announced: u32,
    },
}

/// A completely received run: a blob or the requested part of one.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Complete {
    pub(super) id: BlobId,
    pub(super) offset: u32,
    pub(super) total: u32,
    pub(super) bytes: Bytes,
}

/// A blob that is requested or arriving.
#[derive(Debug, Default)]
pub(super) struct Pending {
    /// Priority last sent to the server; `None` for a pushed blob.
    pub(super) requested: Option<Priority>,
    /// Length in the scene page or index.
    expected: Option<u32>,
    /// The requested part; `to` is `None` for the blob's end.
    from: u32,
    to: Option<u32>,
    /// End of the run, once its first piece has arrived.
    end: Option<u32>,
    pub(super) received: Vec<u8>,
}

impl Pending {
    pub(super) fn remaining_bytes(&self) -> u64 {
        let end = self.end.or(self.to).or(self.expected).unwrap_or(ASSUMED_BYTES);
        u64::from(end).saturating_sub(u64::from(self.from) + self.received.len() as u64)
    }
}

/// Bounds on the requests in flight.
#[derive(Clone, Copy, Debug)]
pub(super) struct Depth {
    /// Most bytes in flight of higher priority than the next request.
    pub(super) ahead_bytes: u64,
    /// Most bytes in flight in all.
    pub(super) most_bytes: u64,
    /// Longest blob that the client accepts.
    pub(super) max_blob_bytes: u32,
}

/// Blobs in flight, and requests to send.
#[derive(Debug, Default)]
pub(super) struct Downloads {
    pub(super) pending: BTreeMap<BlobId, Pending>,
    /// Remaining bytes of the requested blobs.
    pub(super) in_flight_bytes: u64,
    /// Messages to send: new or changed requests, and cancelled ones.
    wants: BTreeSet<BlobId>,
    cancels: BTreeSet<BlobId>,
    /// Lengths of base meshes, by asset.
    base_bytes: BTreeMap<u32, u32>,
    /// Blobs completed.
    pub(super) completed: u64,
}

impl Downloads {
    /// Records the length of an asset's base mesh, from a scene page.
    pub(super) fn announce_base(&mut self, asset: u32, bytes: u32) {
        self.base_bytes.insert(asset, bytes);
    }

    /// Takes a piece; returns the run if the piece completes it.
    ///
    /// Ignores pieces that do not continue what was received: they belong to a blob that was cancelled while they
    /// were in flight.
    ///
    /// # Errors
    /// If the piece breaks the protocol.
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
            // The peer states the length, so memory is reserved as bytes arrive, not in advance.
            let before = pending.remaining_bytes();
            pending.received.clear();
            pending.end = Some(run_end);
            let after = pending.remaining_bytes();
            if pending.requested.is_some() {
                self.in_flight_bytes = self.in_flight_bytes.saturating_sub(before).saturating_add(after);
            }
        } else if u64::from(pending.from) + pending.received.len() as u64 != u64::from(offset)
            || pending.end != Some(run_end)
        {
            return Ok(None);
        }
        let before = pending.remaining_bytes();
        pending.received.extend_from_slice(&bytes);
        if pending.requested.is_some() {
            self.in_flight_bytes = self.in_flight_bytes.saturating_sub(before - pending.remaining_bytes());
        }
        if end != u64::from(run_end) {
            return Ok(None);
        }
        let offset = pending.from;
        let bytes = Bytes::from(std::mem::take(&mut pending.received));
        self.pending.remove(&id);
        self.wants.remove(&id);
        self.cancels.remove(&id);
        self.completed += 1;
        Ok(Some(Complete { id, offset, total, bytes }))
    }

    /// Drops a request and what was received for it.
    pub(super) fn forget(&mut self, id: BlobId) {
        if let Some(pending) = self.pending.remove(&id)
            && pending.requested.is_some()
        {
            self.in_flight_bytes = self.in_flight_bytes.saturating_sub(pending.remaining_bytes());
        }
        self.wants.remove(&id);
    }

    /// Drops what was received of a blob whose stream was reset.
    pub(super) fn abandoned(&mut self, id: BlobId) {
        // A blob that was requested again since still arrives, on another stream.
        if let Some(pending) = self.pending.get_mut(&id) {
            let before = pending.remaining_bytes();
            pending.received.clear();
            pending.end = None;
            if pending.requested.is_some() {
                let in_flight = self.in_flight_bytes.saturating_sub(before);
                self.in_flight_bytes = in_flight.saturating_add(pending.remaining_bytes());
            } else {
                self.pending.remove(&id);
            }
        }
    }

    /// Ends the session: nothing more arrives. What was requested can still be listed.
    pub(super) fn end(&mut self) {
        self.pending.retain(|_, pending| pending.requested.is_some());
        self.pending.values_mut().for_each(|pending| pending.received = Vec::new());
        self.in_flight_bytes = 0;
        self.wants.clear();
        self.cancels.clear();
    }

    /// Requests as many of the wanted blobs, most urgent first, as `depth` allows, updates changed priorities and
    /// cancels `cancel`. Returns the newly requested blobs.
    pub(super) fn set_wanted(&mut self, wanted: &[Wanted], cancel: &[BlobId], depth: Depth) -> Vec<BlobId> {
        for &id in cancel {
            if self.pending.get(&id).is_some_and(|pending| pending.requested.is_some()) {
                self.forget(id);
                self.cancels.insert(id);
            }
        }
        let mut requested = Vec::new();
        let mut in_flight = self.in_flight_by_urgency().into_iter().peekable();
        // Bytes in flight of at least the current priority.
        let mut ahead = 0_u64;
        for &Wanted { id, priority, bytes, state, held, end, .. } in wanted {
            while let Some((_, left)) = in_flight.next_if(|(sent, _)| *sent >= priority) {
                ahead = ahead.saturating_add(left);
            }
            if matches!(state, State::Cached | State::Applied | State::Failed) {
                continue;
            }
            if let Some(pending) = self.pending.get_mut(&id)
                && let Some(sent) = &mut pending.requested
            {
                if sent.abs_diff(priority) >= PRIORITY_CHANGE {
                    *sent = priority;
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
            pending.requested = Some(priority);
            pending.expected = pending.expected.or(bytes);
            // A pushed blob that is arriving begins at its start.
            if pending.received.is_empty() {
                (pending.from, pending.to) = (held, end);
            }
            let left = pending.remaining_bytes();
            self.in_flight_bytes = self.in_flight_bytes.saturating_add(left);
            ahead = ahead.saturating_add(left);
            self.wants.insert(id);
            requested.push(id);
        }
        requested
    }

    /// Priority and remaining bytes of all blobs in flight, most urgent first. Pushed blobs come before requested ones.
    fn in_flight_by_urgency(&self) -> Vec<(Priority, u64)> {
        let mut in_flight: Vec<(Priority, u64)> = self
            .pending
            .values()
            .map(|pending| (pending.requested.unwrap_or(Priority::MAX), pending.remaining_bytes()))
            .collect();
        in_flight.sort_unstable_by_key(|&(priority, _)| Reverse(priority));
        in_flight
    }

    /// Cancels blobs that were received, so that the server sends them again on request. Ignores those in flight again.
    pub(super) fn cancel_received(&mut self, ids: &[BlobId]) {
        self.cancels.extend(ids.iter().filter(|id| !self.pending.contains_key(id)));
    }

    /// The next message to send: cancellations, then requests.
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
                let &Pending { requested, from, to, .. } = self.pending.get(&id)?;
                Some(Want { id, priority: requested?, offset: from, end: to })
            })
            .collect();
        wants.sort_by_key(|want| (Reverse(want.priority), want.id));
        Some(ClientMessage::Want(wants))
    }
}

/// Removes the first `count` elements of a set.
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
    fn blobs_longer_than_accepted_are_not_requested() {
        let mut downloads = Downloads::default();
        let wanted = |chunk, bytes| Wanted::whole(BlobId::chunk(0, chunk), 9, Some(bytes), State::Absent);
        let requested = downloads.set_wanted(&[wanted(1, 5001), wanted(2, 5000)], &[], DEPTH);
        assert_eq!(requested, [BlobId::chunk(0, 2)]);
        assert_eq!(downloads.in_flight_bytes, 5000);
    }

    #[test]
    fn invalid_pieces_have_distinct_errors() {
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
    fn received_blobs_are_cancelled_once_unless_requested_again() {
        let mut downloads = Downloads::default();
        let (received, requested) = (BlobId::chunk(0, 1), BlobId::chunk(0, 2));
        downloads.set_wanted(&[Wanted::whole(requested, 9, Some(100), State::Absent)], &[], DEPTH);
        downloads.cancel_received(&[received, requested]);
        assert_eq!(downloads.poll_message(), Some(ClientMessage::Cancel(vec![received])));
        assert!(matches!(downloads.poll_message(), Some(ClientMessage::Want(wants)) if wants.len() == 1));
        assert_eq!(downloads.poll_message(), None);
    }
}
