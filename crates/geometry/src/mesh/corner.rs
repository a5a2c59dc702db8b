//! Corner numbers: corner k of face f is `f × 3 + k`, counter-clockwise. Hot loops over stars use `f × 4 + k`
//! ([`Spaced`]).

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

/// A corner's index in its face, 0 to 2.
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

/// The entry at a corner.
#[inline]
pub(crate) fn at<T: Copy>(faces: &[[T; 3]], corner: u32) -> T {
    // Flattened, to avoid a division.
    faces.as_flattened()[corner as usize]
}

/// A corner numbered `face × 4 + k`, which shift and mask decompose without division.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Spaced(u32);

/// Next and previous corner of a face, branch-free. The fourth entry avoids a bounds check.
const AFTER: [usize; 4] = [1, 2, 0, 0];
const BEFORE: [usize; 4] = [2, 0, 1, 1];

impl Spaced {
    /// Corner `k` (0 to 2) of a face.
    #[inline]
    pub(crate) fn new(face: u32, k: u8) -> Self {
        debug_assert!(k < 3, "a triangle has no corner {k}");
        Self(face * 4 + u32::from(k))
    }

    /// The face.
    #[inline]
    pub(crate) fn face(self) -> u32 {
        self.0 / 4
    }

    /// The index in its face, 0 to 2.
    #[inline]
    pub(crate) fn side(self) -> u8 {
        (self.0 % 4) as u8
    }

    /// The next corner in its face.
    #[inline]
    pub(crate) fn next(self) -> usize {
        AFTER[usize::from(self.side())]
    }

    /// The previous corner in its face.
    #[inline]
    pub(crate) fn previous(self) -> usize {
        BEFORE[usize::from(self.side())]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn both_corner_numbers_agree() {
        for face in [0, 1, 7, 1 << 18] {
            for (k, side) in [(0, 0), (1, 1), (2, 2)] {
                let (dense, spaced) = (corner(face, k), Spaced::new(face, side));
                assert_eq!((face_of(dense), side_of(dense)), (face, k));
                assert_eq!((spaced.face(), usize::from(spaced.side())), (face, k));
                assert_eq!((spaced.next(), spaced.previous()), (next(k), previous(k)));
            }
        }
    }
}
