//! Memory that coding a chunk takes, kept from chunk to chunk: allocated once a thread.

use std::cell::Cell;

use crate::codec::local::LocalMemory;
use crate::codec::model::contexts_in;
use crate::codec::scratch::Scratch;
use crate::entropy::context::Contexts;

/// Most bytes that a thread keeps; who took more gives it back. Chunks of 1,000 splits take 0.6 MB.
const MOST_BYTES: usize = 4 << 20;

/// What coding a chunk works in. What is in it means nothing to the next chunk.
#[derive(Default)]
pub(crate) struct Memory {
    pub(crate) local: LocalMemory,
    pub(crate) scratch: Scratch,
    contexts: Option<Contexts>,
}

thread_local! {
    static KEPT: Cell<Option<Box<Memory>>> = const { Cell::new(None) };
}

impl Memory {
    /// This thread's, or new if that is in use.
    pub(crate) fn take() -> Box<Self> {
        KEPT.take().unwrap_or_default()
    }

    /// Leaves it to the thread's next chunk.
    pub(crate) fn keep(self: Box<Self>) {
        if self.local.bytes() + self.scratch.bytes() <= MOST_BYTES {
            KEPT.set(Some(self));
        }
    }

    /// The contexts that every chunk starts from, in memory that another chunk has had.
    pub(crate) fn contexts(&mut self) -> Contexts {
        contexts_in(self.contexts.take())
    }

    /// Takes contexts back that are of no more use.
    pub(crate) fn keep_contexts(&mut self, contexts: Contexts) {
        self.contexts = Some(contexts);
    }
}
