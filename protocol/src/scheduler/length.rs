//! Lengths of blobs and of the queue, as the protocol's `u32`.

/// Converts a length to `u32`. Blobs have at most `MAX_BLOB_BYTES`, as the session checks before it queues them.
pub(super) fn number(n: usize) -> u32 {
    u32::try_from(n).unwrap_or(u32::MAX)
}
