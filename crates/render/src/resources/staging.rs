//! Upload budget of a frame, so that uploads do not delay it.

use std::time::Duration;

/// Most steps taken from the streaming thread before they are uploaded. Further steps wait in the client's core, where
/// later changes of a mesh are merged with earlier ones.
pub const MAX_WAITING_STEPS: usize = 16;

/// Bytes uploaded per millisecond between frames; a tenth of it with a software driver.
const BYTES_PER_MS: u64 = 64 << 10;
/// Least budget of a frame.
const LEAST_BYTES: u64 = 512 << 10;
/// Largest budget of a frame. Further changes wait and are merged by slot.
const MOST_BYTES: u64 = 8 << 20;

/// Upload budget for frames that are `apart`: small at high frame rates, where each frame must be on time; larger at
/// low ones, where as much data arrives in between.
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
