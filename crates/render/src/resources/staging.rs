//! How much of what has come a frame takes, so that none is late for it.

use std::time::Duration;

/// Steps that are taken from the streaming thread before they are uploaded, at most: what waits is then the core's, where
/// later changes of a mesh join those before.
pub const MAX_WAITING_STEPS: usize = 16;

/// Bytes of changes for each millisecond between two frames: a tenth of it, where a processor draws.
const BYTES_PER_MS: u64 = 64 << 10;
/// What a frame takes however soon the next one comes.
const LEAST_BYTES: u64 = 512 << 10;
/// What a frame takes however long it takes itself. What waits longer comes with more of the same slots.
const MOST_BYTES: u64 = 8 << 20;

/// Bytes of changes that a frame uploads where each takes so long: few where they are close, since each must be in
/// time; more where they are far apart, since as much comes meanwhile.
#[must_use]
pub fn upload_budget(apart: Duration) -> usize {
    let micros = u64::try_from(apart.as_micros()).unwrap_or(u64::MAX);
    let bytes = (micros.saturating_mul(BYTES_PER_MS) / 1000).clamp(LEAST_BYTES, MOST_BYTES);
    usize::try_from(bytes).unwrap_or(usize::MAX)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frames_that_are_close_take_little_and_none_takes_more_than_it_may() {
        let of_ms = |ms| upload_budget(Duration::from_millis(ms));
        assert_eq!(of_ms(16), 1 << 20);
        assert_eq!(of_ms(32), 2 << 20);
        assert_eq!([0, 1, 8].map(of_ms), [512 << 10; 3]);
        assert_eq!([128, 1000].map(of_ms), [8 << 20; 2]);
        assert_eq!(upload_budget(Duration::MAX), 8 << 20);
        assert!((0..200).map(of_ms).is_sorted());
    }
}
