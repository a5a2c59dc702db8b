//! Where chunks are decoded: on the calling thread, or on threads that an embedder lends.

use std::fmt;
use std::sync::{Arc, Mutex};

use lodestream_geometry::pool::Pool;
use lodestream_threads::Threads;

/// Chunks decoded together on a pool; bounds the memory of decoded chunks that are not applied yet.
const BATCH: usize = 64;

/// Thread pool for decoding; the default decodes on the thread that calls [`super::ClientCore::update`]. The result is
/// the same for any pool.
#[derive(Clone, Default)]
pub struct Decoders(Option<Arc<dyn Pool + Send>>);

impl Decoders {
    /// Decodes on a pool. [`super::ClientCore::update`] calls it, and it must return once its tasks are done.
    #[must_use]
    pub fn on(pool: Arc<dyn Pool + Send>) -> Self {
        Self(Some(pool))
    }

    /// Decodes on threads; with one only, on the calling thread.
    #[must_use]
    pub fn on_threads(threads: Threads) -> Self {
        if threads.count().get() == 1 { Self::default() } else { Self::on(Arc::new(threads)) }
    }

    /// Number of chunks to decode together.
    pub(super) fn batch(&self) -> usize {
        if self.0.is_some() { BATCH } else { 1 }
    }

    /// The results of `task(0)` to `task(count - 1)`, in this order.
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
        // Tasks that the pool did not run are run here.
        results.enumerate().map(|(i, result)| result.unwrap_or_else(|| task(i))).collect()
    }
}

impl fmt::Debug for Decoders {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(if self.0.is_some() { "Decoders(a pool)" } else { "Decoders(the caller)" })
    }
}
