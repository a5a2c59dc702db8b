//! Decoding on several workers, where the page may share memory with them (it is cross-origin isolated). Built with the
//! feature `threads`: the module's memory is shared, and each worker is an instance of the module with that memory.

use std::sync::{Arc, Mutex, PoisonError};

use lodestream_client::core::Decoders;
use lodestream_geometry::pool::{Pool, Tasks};
use rayon_core::{ThreadBuilder, ThreadPool, ThreadPoolBuilder};
use wasm_bindgen::prelude::*;

use crate::streamer::{SLICE_BYTES, Streamer};

/// Threads of the pool that no worker runs yet.
static WAITING: Mutex<Vec<ThreadBuilder>> = Mutex::new(Vec::new());

/// A pool whose threads are workers.
#[derive(Debug)]
struct WorkerPool(ThreadPool);

impl Pool for WorkerPool {
    fn run(&self, count: usize, task: &(dyn Fn(usize) + Sync)) {
        let tasks = Tasks::new(count, task);
        self.0.in_place_scope(|scope| {
            for _ in 0..self.0.current_num_threads() {
                scope.spawn(|_| tasks.work());
            }
            tasks.work();
        });
    }
}

#[wasm_bindgen]
impl Streamer {
    /// Makes a pool of `count` workers, each of which has to call [`decode_on_this_worker`].
    ///
    /// # Errors
    /// The pool cannot be made.
    pub fn prepare_decoders(&mut self, count: u32) -> Result<(), String> {
        let wait = |thread| {
            WAITING.lock().unwrap_or_else(PoisonError::into_inner).push(thread);
            Ok(())
        };
        let pool = ThreadPoolBuilder::new().num_threads(count as usize).spawn_handler(wait).build();
        let pool = pool.map_err(|why| format!("no pool of {count} workers: {why}"))?;
        self.decoders = Some(Decoders::on(Arc::new(WorkerPool(pool))));
        Ok(())
    }

    /// Decodes on the pool from now on. Its workers have to be there: a call would wait for them for ever.
    pub fn use_decoders(&mut self, count: u32) {
        if let Some(decoders) = self.decoders.take() {
            self.core.set_decoders(decoders);
            self.slice_bytes = SLICE_BYTES * (1 + u64::from(count));
        }
    }
}

/// Runs a thread of the pool, until the worker is terminated.
#[wasm_bindgen]
pub fn decode_on_this_worker() {
    let thread = WAITING.lock().unwrap_or_else(PoisonError::into_inner).pop();
    if let Some(thread) = thread {
        thread.run();
    }
}
