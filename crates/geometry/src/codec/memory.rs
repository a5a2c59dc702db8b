//! Buffers for coding chunks, reused by each thread.

use std::cell::Cell;

use crate::codec::local::LocalMemory;
use crate::codec::model::contexts_in;
use crate::codec::scratch::Scratch;
use crate::entropy::context::Contexts;

/// Most bytes that a thread retains; larger buffers are freed. Chunks of 1,000 splits take 0.6 MB.
const MAX_BYTES: usize = 4 << 20;

/// Buffers for coding a chunk; their contents do not carry over.
#[derive(Default)]
pub(crate) struct Memory {
    pub(crate) local: LocalMemory,
    pub(crate) scratch: Scratch,
    contexts: Option<Contexts>,
}

thread_local! {
    static CACHED: Cell<Option<Box<Memory>>> = const { Cell::new(None) };
}

impl Memory {
    /// This thread's buffers, or new ones if those are in use.
    pub(crate) fn take() -> Box<Self> {
        CACHED.take().unwrap_or_default()
    }

    /// Retains the buffers for the thread's next chunk.
    pub(crate) fn keep(self: Box<Self>) {
        if self.local.bytes() + self.scratch.bytes() <= MAX_BYTES {
            CACHED.set(Some(self));
        }
    }

    /// The contexts that every chunk starts from, in reused memory.
    pub(crate) fn contexts(&mut self) -> Contexts {
        contexts_in(self.contexts.take())
    }

    /// Retains the memory of used contexts.
    pub(crate) fn keep_contexts(&mut self, contexts: Contexts) {
        self.contexts = Some(contexts);
    }
}
