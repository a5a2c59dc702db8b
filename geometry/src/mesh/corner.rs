//! Corners by number: corner k of face f is `f × 3 + k`, and the corners of a face go round.

/// The number of corner `k` (0 to 2) of a face.
#[inline]
pub(crate) fn corner(face: u32, k: usize) -> u32 {
    debug_assert!(k < 3, "a triangle has no corner {k}");
    face * 3 + k as u32
}

/// A corner's face.
#[inline]
pub(crate) fn face_of(corner: u32) -> u32 {
    corner / 3
}

/// Which of its face's corners a corner is, 0 to 2.
#[inline]
pub(crate) fn side_of(corner: u32) -> usize {
    (corner % 3) as usize
}

/// The corner after `k` in its face.
#[inline]
pub(crate) fn next(k: usize) -> usize {
    (k + 1) % 3
}

/// The corner before `k` in its face.
#[inline]
pub(crate) fn previous(k: usize) -> usize {
    (k + 2) % 3
}

/// What is at the corner.
#[inline]
pub(crate) fn at<T: Copy>(faces: &[[T; 3]], corner: u32) -> T {
    faces[face_of(corner) as usize][side_of(corner)]
}
