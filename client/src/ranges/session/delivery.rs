//! Items whose bytes have arrived: checked, then taken or given up.

use std::time::Duration;

use bytes::Bytes;
use lodestream_protocol::client::ClientEvent;
use lodestream_protocol::message::{Close, CloseCode, RefusedReason};
use lodestream_protocol::time::Time;
use lodestream_scene::blob::BlobId;

use super::RangeSession;
use crate::ranges::directory::{Item, Location};
use crate::ranges::grouping::Candidate;
use crate::ranges::items::Progress;

/// Time until an item that failed twice is tried again for those that need it.
const FAILED_FOR: Duration = Duration::from_secs(5);

impl RangeSession {
    /// Takes an item's bytes.
    pub(super) fn deliver(&mut self, now: Time, one: &Candidate, bytes: Bytes) {
        let Some(pending) = self.items.pending.get(&one.item) else { return };
        let (wanted, from) = (pending.wanted, pending.from);
        let first = one.segments.first().map_or(0, |segment| segment.start);
        let intact = one.segments.iter().all(|segment| {
            let run = (segment.start - first) as usize..(segment.end - first) as usize;
            bytes.get(run).is_some_and(|run| segment.is_of(run))
        });
        if !intact {
            return self.damaged(now, one);
        }
        self.items.pending.remove(&one.item);
        let added = match one.item {
            Item::Page(number) => self.directory.add_page(number, &bytes).map(|()| self.number_pages()),
            Item::Source(number) => {
                self.directory.add_source(number, &bytes).map(|()| self.need_behind(number))
            }
            Item::TerrainTable(page) => self.directory.add_terrain_table(page, &bytes),
            Item::LightTable(page) => self.directory.add_light_table(page, &bytes),
            Item::PartTable(number) => self.directory.add_part_table(number, &bytes),
            Item::Index(asset, page) => {
                let length = self.directory.add_index(asset, page, &bytes);
                length.map(|length| self.deliver_first(BlobId::index_page(asset, page), &bytes, length))
            }
            Item::TextureRegions(asset) => {
                let length = self.directory.add_tiles(asset, &bytes);
                length.map(|length| self.deliver_first(BlobId::texture_regions(asset), &bytes, length))
            }
            Item::Blob(id) => {
                self.blobs += 1;
                let total = match self.directory.locate(one.item) {
                    Location::At(place) => place.bytes,
                    Location::Needs(_) | Location::Nowhere => 0,
                };
                // The core continues a chunk at the byte that it has.
                let skipped = if wanted { from.saturating_sub(first) as usize } else { 0 };
                let bytes = bytes.slice(skipped.min(bytes.len())..);
                let offset = first + u32::try_from(skipped).unwrap_or(u32::MAX);
                self.events.push_back(ClientEvent::Blob { id, offset, total, bytes });
                Ok(())
            }
        };
        // The hash matches, so the scene was published like this.
        if let Err(why) = added {
            self.fail(&why);
        }
    }

    /// Hands out a blob behind which a table lies.
    fn deliver_first(&mut self, id: BlobId, bytes: &Bytes, length: usize) {
        self.blobs += 1;
        let total = u32::try_from(length).unwrap_or(u32::MAX);
        self.events.push_back(ClientEvent::Blob { id, offset: 0, total, bytes: bytes.slice(..length) });
    }

    /// An item's bytes do not have their hash. They are fetched once more, past all caches.
    pub(super) fn damaged(&mut self, now: Time, one: &Candidate) {
        let Some(pending) = self.items.pending.get_mut(&one.item) else { return };
        let Candidate { object, range, .. } = one;
        let why = format!(
            "{object}: bytes {} to {} do not have their hash: the file is damaged or was replaced; publish the scene again",
            range.start, range.end
        );
        tracing::warn!("{why}");
        pending.progress = Progress::Waiting;
        if !std::mem::replace(&mut pending.reload, true) {
            return;
        }
        match one.item {
            Item::Page(_) => self.end(Close::new(CloseCode::Lost, why)),
            item => {
                self.trouble = Some((now, why));
                self.failed.insert(item, now + FAILED_FOR);
                self.give_up(item);
            }
        }
    }

    /// Drops an item. The core tries a blob again later.
    pub(super) fn give_up(&mut self, item: Item) {
        let pending = self.items.pending.remove(&item);
        if let (Some(id), true) = (item.blob(), pending.is_some_and(|pending| pending.wanted)) {
            self.events.push_back(ClientEvent::Refused { id, reason: RefusedReason::Unreadable });
        }
    }
}
