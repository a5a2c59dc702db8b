//! What decodes chunks: the calling thread, or threads that an embedder lends.

use std::fmt;
use std::sync::{Arc, Mutex};

use lodestream_geometry::pool::Pool;

/// Chunks decoded at a time with a pool; bounds what is decoded and not applied.
const BATCH: usize = 64;

/// Threads for decoding, or none: then chunks are decoded where [`super::ClientCore::update`] is called. What comes
/// out is the same for any pool.
#[derive(Clone, Default)]
pub struct Decoders(Option<Arc<dyn Pool + Send>>);

impl Decoders {
    /// Decodes on a pool, which is called from within [`super::ClientCore::update`] and returns once its tasks are
    /// done.
    #[must_use]
    pub fn on(pool: Arc<dyn Pool + Send>) -> Self {
        Self(Some(pool))
    }

    /// Chunks that are worth handing over together.
    pub(super) fn batch(&self) -> usize {
        if self.0.is_some() { BATCH } else { 1 }
    }

    /// `task(0)` … `task(count - 1)`, in this order.
    pub(super) fn map<T: Send>(&self, count: usize, task: &(dyn Fn(usize) -> T + Sync)) -> Vec<T> {
        let Some(pool) = self.0.as_ref().filter(|_| count > 1) else { return (0..count).map(task).collect() };
        let slots: Vec<Mutex<Option<T>>> = (0..count).map(|_| Mutex::new(None)).collect();
        pool.run(count, &|i| {
            let value = task(i);
            if let Ok(mut slot) = slots[i].lock() {
                *slot = Some(value);
            }
        });
        let results = slots.into_iter().map(|slot| slot.into_inner().ok().flatten());
        // What a pool has left out is done here.
        results.enumerate().map(|(i, result)| result.unwrap_or_else(|| task(i))).collect()
    }
}

impl fmt::Debug for Decoders {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(if self.0.is_some() { "Decoders(a pool)" } else { "Decoders(the caller)" })
    }
}
