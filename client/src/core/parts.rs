//! Lookups of what parts are called: those that wait, the states of the blobs that they need, and answers.

use std::collections::{BTreeMap, BTreeSet, VecDeque};

use lodestream_scene::blob::{BlobId, PartBlob};
use lodestream_scene::parts::{
    INSTANCES_PER_PAGE, PartInfo, PartTable, PartsError, RECORDS_PER_PAGE, ScenePart,
};
use lodestream_select::{Priority, State, Wanted};

/// Most lookups that wait, and most answers that are kept; more are answered by [`PartAbsence::TooMany`] or dropped.
pub(super) const MAX_LOOKUPS: usize = 1024;

/// The answer to a lookup.
#[derive(Clone, Debug, PartialEq)]
pub struct PartAnswer {
    /// The part.
    pub id: ScenePart,
    /// What it is called, or why that is not known.
    pub info: Result<PartInfo, PartAbsence>,
}

/// Why it is not known what a part is called.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum PartAbsence {
    /// The scene has no table of its parts.
    #[error("no names are known: the scene was published without them; publish it again")]
    NoNames,
    /// No such instance, or it has no such part.
    #[error("there is no such part")]
    NoSuchPart,
    /// The table is damaged, or the server cannot read it.
    #[error("the names cannot be read; try again later")]
    Unreadable,
    /// Another scene has come before the answer.
    #[error("the scene has changed; numbers of its parts have too")]
    OtherScene,
    /// Too many lookups wait.
    #[error("too many lookups wait; try again later")]
    TooMany,
}

/// Why a blob of the table cannot be used.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub(super) enum PartBlobError {
    /// Only a part of it has arrived.
    #[error("only a part of it has arrived")]
    Partial,
    /// It is invalid or does not fit the scene.
    #[error(transparent)]
    Parts(#[from] PartsError),
}

/// A lookup that waits.
#[derive(Clone, Copy, Debug)]
pub(super) struct Lookup {
    pub(super) id: ScenePart,
    /// Its record, once the directory has told it.
    pub(super) record: Option<u32>,
}

impl Lookup {
    /// The blob that tells more about it.
    pub(super) const fn needs(&self) -> PartBlob {
        match self.record {
            None => PartBlob::DirectoryPage(self.id.instance / INSTANCES_PER_PAGE),
            Some(record) => PartBlob::Page(record / RECORDS_PER_PAGE),
        }
    }
}

/// All lookups, and what is known of the table.
#[derive(Debug, Default)]
pub(super) struct PartLookups {
    /// The scene's table, once it is known that it has one.
    pub(super) table: Option<PartTable>,
    /// Whether the present session has said so. A server that has not may not know such blobs.
    pub(super) is_announced: bool,
    pub(super) waiting: Vec<Lookup>,
    pub(super) answers: VecDeque<PartAnswer>,
    /// States of the blobs that were requested.
    states: BTreeMap<PartBlob, State>,
}

impl PartLookups {
    /// Forgets the scene. Lookups that wait are answered if they were meant for another one.
    pub(super) fn begin_scene(&mut self, had_scene: bool) {
        self.table = None;
        self.states.clear();
        if had_scene {
            for lookup in std::mem::take(&mut self.waiting) {
                self.answer(lookup.id, Err(PartAbsence::OtherScene));
            }
        }
    }

    pub(super) fn answer(&mut self, id: ScenePart, info: Result<PartInfo, PartAbsence>) {
        // Only a host that never takes answers lets them reach the limit.
        if self.answers.len() < MAX_LOOKUPS {
            self.answers.push_back(PartAnswer { id, info });
        }
    }

    pub(super) fn state(&self, blob: PartBlob) -> State {
        self.states.get(&blob).copied().unwrap_or_default()
    }

    pub(super) fn set_state(&mut self, blob: PartBlob, state: State) {
        if state == State::Absent {
            self.states.remove(&blob);
        } else {
            self.states.insert(blob, state);
        }
    }

    /// Whether a lookup waits for a blob, which must not be evicted then.
    pub(super) fn needs(&self, id: BlobId) -> bool {
        matches!(id, BlobId::Parts(blob) if self.waiting.iter().any(|lookup| lookup.needs() == blob))
    }

    /// The blobs that lookups wait for, each once: before all else, since a person waits for the answer.
    pub(super) fn wanted(&self) -> Vec<Wanted> {
        if !self.is_announced {
            return Vec::new();
        }
        let blobs: BTreeSet<PartBlob> = self.waiting.iter().map(Lookup::needs).collect();
        let state = |blob| (blob, self.state(blob));
        blobs
            .into_iter()
            .map(state)
            .filter(|(_, state)| matches!(state, State::Absent | State::InFlight))
            .map(|(blob, state)| Wanted::whole(BlobId::Parts(blob), Priority::MAX, None, state))
            .collect()
    }
}
