//! Parts: where they are moved to, and what they are called. Blobs of the table of names stay in the cache, from which
//! later lookups are answered.

use std::collections::BTreeMap;

use bytes::Bytes;
use lodestream_protocol::time::Time;
use lodestream_scene::blob::{BlobId, PartBlob};
use lodestream_scene::parts::{
    INSTANCES_PER_PAGE, PartInfo, PartTable, PartTransform, RECORDS_PER_PAGE, ScenePart, check_page,
    decode_directory, decode_record, records_of,
};
use lodestream_select::State;

use super::ClientCore;
use super::state::ReceivedBlob;
use crate::core::parts::{Lookup, MAX_LOOKUPS, PartAbsence, PartAnswer, PartBlobError};

impl ClientCore {
    /// Sets which parts are moved within their instances, and where to, instead of those set before. Picking, bounds and
    /// refinement follow, and no proxy stands for the instances; what they lack may have to be requested. Cost: for each
    /// selection, as much as an instance for each transform that parts of an instance share.
    pub fn move_parts(&mut self, moved: &BTreeMap<ScenePart, PartTransform>) {
        self.moved.set_parts(moved);
        self.selection.selector.set_moved(self.moved.distinct());
        self.selection.stale = true;
    }

    /// Looks up what a part is called; [`ClientCore::take_part`] gives the answer, at once if the client has it, else when
    /// it has arrived. Before a scene is known, the lookup waits for one. At most 1,024 wait.
    pub fn look_up_part(&mut self, now: Time, id: ScenePart) {
        if self.parts.waiting.len() >= MAX_LOOKUPS {
            return self.parts.answer(id, Err(PartAbsence::TooMany));
        }
        self.parts.waiting.push(Lookup { id, record: None });
        self.advance_lookups(now);
        // A published scene may have what is requested at hand.
        self.handle_session_events(now);
    }

    /// The next answer to a lookup, in the order in which they were found.
    pub fn take_part(&mut self) -> Option<PartAnswer> {
        self.parts.answers.pop_front()
    }

    /// Answers lookups as far as blobs are here, and requests what they need next.
    pub(super) fn advance_lookups(&mut self, now: Time) {
        if self.parts.waiting.is_empty() {
            return;
        }
        let mut left = Vec::new();
        for mut lookup in std::mem::take(&mut self.parts.waiting) {
            match self.advance_lookup(&mut lookup) {
                Some(info) => self.parts.answer(lookup.id, info),
                None => left.push(lookup),
            }
        }
        self.parts.waiting = left;
        // Those of earlier lookups may have been evicted since: they are absent again.
        let wanted = self.parts.wanted();
        let requests = wanted.iter().any(|one| one.state == State::Absent);
        self.selection.wanted.retain(|one| !matches!(one.id, BlobId::Parts(_)));
        self.selection.wanted.splice(0..0, wanted);
        if requests {
            self.send_requests(now, &[]);
        }
    }

    /// What the part of a lookup is called; `None` as long as something has to arrive.
    fn advance_lookup(&mut self, lookup: &mut Lookup) -> Option<Result<PartInfo, PartAbsence>> {
        let ScenePart { instance, part } = lookup.id;
        let instances = self.scene.header.as_ref()?.instance_count;
        if instance >= instances {
            return Some(Err(PartAbsence::NoSuchPart));
        }
        let Some(table) = self.parts.table else {
            // The message about the table comes before the first page.
            return self.scene.has_page().then_some(Err(PartAbsence::NoNames));
        };
        if lookup.record.is_none() {
            let bytes = match self.part_blob(lookup.needs())? {
                Ok(bytes) => bytes,
                Err(absence) => return Some(Err(absence)),
            };
            let count = PartTable::on_directory_page(instances, instance / INSTANCES_PER_PAGE);
            // Checked when it arrived.
            let Ok(runs) = decode_directory(&bytes, count, table.records) else {
                return Some(Err(PartAbsence::Unreadable));
            };
            let records = records_of(&runs, instance % INSTANCES_PER_PAGE);
            let Some(record) = records.and_then(|mut records| records.nth(part as usize)) else {
                return Some(Err(PartAbsence::NoSuchPart));
            };
            lookup.record = Some(record);
        }
        let record = lookup.record?;
        let bytes = match self.part_blob(lookup.needs())? {
            Ok(bytes) => bytes,
            Err(absence) => return Some(Err(absence)),
        };
        let count = table.on_page(record / RECORDS_PER_PAGE);
        let info = decode_record(&bytes, count, record % RECORDS_PER_PAGE);
        Some(info.ok().flatten().ok_or(PartAbsence::Unreadable))
    }

    /// A blob of the table; `None` if it has to arrive.
    fn part_blob(&mut self, blob: PartBlob) -> Option<Result<Bytes, PartAbsence>> {
        let id = BlobId::Parts(blob);
        if self.failures.is_missing(id) {
            return Some(Err(PartAbsence::Unreadable));
        }
        self.cache.get(id).map(Ok)
    }

    /// Takes a blob of the table, if it was requested.
    pub(super) fn receive_part_blob(&mut self, now: Time, blob: PartBlob, received: ReceivedBlob) {
        let ReceivedBlob { id, offset, total, bytes } = received;
        if self.parts.state(blob) != State::InFlight {
            return;
        }
        let whole = offset == 0 && bytes.len() == total as usize;
        let checked = if whole { self.check_part_blob(blob, &bytes) } else { Err(PartBlobError::Partial) };
        match checked {
            Ok(()) => {
                self.failures.clear(id);
                self.cache.insert(id, bytes);
                self.parts.set_state(blob, State::Cached);
            }
            Err(why) => self.mark_failed(now, id, &why.into()),
        }
        self.advance_lookups(now);
        self.trim_cache(now);
    }

    fn check_part_blob(&self, blob: PartBlob, bytes: &[u8]) -> Result<(), PartBlobError> {
        let instances = self.scene.header.as_ref().map_or(0, |header| header.instance_count);
        // Without a table nothing is requested.
        let Some(table) = self.parts.table else { return Ok(()) };
        match blob {
            PartBlob::DirectoryPage(page) => {
                let count = PartTable::on_directory_page(instances, page);
                decode_directory(bytes, count, table.records)?;
            }
            PartBlob::Page(page) => check_page(bytes, table.on_page(page))?,
        }
        Ok(())
    }
}
