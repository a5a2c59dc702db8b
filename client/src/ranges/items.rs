//! What is to be fetched, and how urgently.

use std::collections::BTreeMap;

use lodestream_scene::blob::BlobId;
use lodestream_select::Priority;

use super::directory::Item;

/// State of an item that is to be fetched.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Progress {
    /// In no request.
    Waiting,
    /// In the request of this number.
    Requested(u64),
}

/// An item that is to be fetched.
#[derive(Clone, Debug)]
pub(super) struct Pending {
    pub(super) priority: Priority,
    pub(super) progress: Progress,
    /// Whether the core has requested it as a blob.
    pub(super) wanted: bool,
    /// Whether the session itself needs it, or takes it because it comes anyway.
    pub(super) needed: bool,
    /// The wanted bytes of a blob: from, and to if not the end.
    pub(super) from: u32,
    pub(super) to: Option<u32>,
    /// Its bytes did not have their hash once: caches are to be passed by.
    pub(super) reload: bool,
}

/// All items that are to be fetched.
#[derive(Debug, Default)]
pub(super) struct Items {
    pub(super) pending: BTreeMap<Item, Pending>,
}

impl Items {
    fn entry(&mut self, item: Item, priority: Priority) -> &mut Pending {
        self.pending.entry(item).or_insert(Pending {
            priority,
            progress: Progress::Waiting,
            wanted: false,
            needed: false,
            from: 0,
            to: None,
            reload: false,
        })
    }

    /// Adds an item that the session itself needs, or raises its priority.
    pub(super) fn need(&mut self, item: Item, priority: Priority) {
        let pending = self.entry(item, priority);
        pending.priority = pending.priority.max(priority);
        pending.needed = true;
    }

    /// Adds a blob that the core wants, from a byte to a byte; returns whether it was not wanted before.
    pub(super) fn want(&mut self, id: BlobId, priority: Priority, from: u32, to: Option<u32>) -> bool {
        let pending = self.entry(Item::of_blob(id), priority);
        pending.priority = if pending.needed { pending.priority.max(priority) } else { priority };
        if pending.progress == Progress::Waiting {
            (pending.from, pending.to) = (from, to);
        }
        !std::mem::replace(&mut pending.wanted, true)
    }

    /// The core does not want a blob any more.
    pub(super) fn unwant(&mut self, id: BlobId) {
        let item = Item::of_blob(id);
        if let Some(pending) = self.pending.get_mut(&item) {
            pending.wanted = false;
            if pending.progress == Progress::Waiting && !pending.needed {
                self.pending.remove(&item);
            }
        }
    }

    pub(super) fn is_wanted(&self, id: BlobId) -> bool {
        self.pending.get(&Item::of_blob(id)).is_some_and(|pending| pending.wanted)
    }

    /// The blobs that the core waits for.
    pub(super) fn wanted(&self) -> impl Iterator<Item = BlobId> {
        self.pending.iter().filter(|(_, pending)| pending.wanted).filter_map(|(item, _)| item.blob())
    }

    /// Puts the items of a request back.
    pub(super) fn release(&mut self, request: u64) {
        for pending in self.pending.values_mut() {
            if pending.progress == Progress::Requested(request) {
                pending.progress = Progress::Waiting;
            }
        }
    }
}
