//! A lock for tests that measure held memory: caches of one test's thread may be freed by another's.

use std::sync::{Mutex, MutexGuard, PoisonError};

/// Waits until no other test measures held memory. A test that failed while it held the lock does not poison it.
pub(crate) fn exclusive() -> MutexGuard<'static, ()> {
    static LOCK: Mutex<()> = Mutex::new(());
    LOCK.lock().unwrap_or_else(PoisonError::into_inner)
}
