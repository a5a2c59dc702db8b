//! Numbers of states, each greater than all before it.

use std::sync::atomic::{AtomicU64, Ordering};

/// A unique number for an asset, or for a state of one or of a texture.
pub(crate) fn new_stamp() -> u64 {
    static NEXT: AtomicU64 = AtomicU64::new(1);
    NEXT.fetch_add(1, Ordering::Relaxed)
}
