//! Values noted for each of the screen errors that clients report ([`QUALITIES_PX`]).

use lodestream_client::core::QUALITIES_PX;

/// A value for each screen error of [`QUALITIES_PX`].
type ByError<T> = [Option<T>; QUALITIES_PX.len()];

/// The value noted for a screen error in pixels; `None` for an error that is not in [`QUALITIES_PX`].
pub(crate) fn quality<T: Copy>(noted: &ByError<T>, px: f64) -> Option<T> {
    QUALITIES_PX.iter().position(|q| *q == px).and_then(|i| noted[i])
}

/// Stores `value` for each screen error that `error_px` does not exceed, unless that error already has a value.
pub(crate) fn note_quality<T: Copy>(noted: &mut ByError<T>, error_px: f64, value: T) {
    for (slot, px) in noted.iter_mut().zip(QUALITIES_PX) {
        if error_px <= px {
            slot.get_or_insert(value);
        }
    }
}
