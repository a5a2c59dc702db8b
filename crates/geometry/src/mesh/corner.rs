//! Corners by number: corner k of face f is `f × 3 + k`, and the corners of a face go round. Where stars are walked all
//! the time it is `f × 4 + k` ([`Spaced`]).

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
    // One list of all corners, so that nothing is divided.
    faces.as_flattened()[corner as usize]
}

/// A corner whose number is `face × 4 + k`: a shift and a mask take it apart, where 3 asks for a product and a difference.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Spaced(u32);

/// The corners after and before each of a face, without a branch. There is no fourth; its entries spare a check.
const AFTER: [usize; 4] = [1, 2, 0, 0];
const BEFORE: [usize; 4] = [2, 0, 1, 1];

impl Spaced {
    /// Corner `k` (0 to 2) of a face.
    #[inline]
    pub(crate) fn new(face: u32, k: u8) -> Self {
        debug_assert!(k < 3, "a triangle has no corner {k}");
        Self(face * 4 + u32::from(k))
    }

    /// Its face.
    #[inline]
    pub(crate) fn face(self) -> u32 {
        self.0 / 4
    }

    /// Which of its face's corners it is, 0 to 2.
    #[inline]
    pub(crate) fn side(self) -> u8 {
        (self.0 % 4) as u8
    }

    /// The corner after it in its face.
    #[inline]
    pub(crate) fn next(self) -> usize {
        AFTER[usize::from(self.side())]
    }

    /// The corner before it in its face.
    #[inline]
    pub(crate) fn previous(self) -> usize {
        BEFORE[usize::from(self.side())]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn both_numbers_of_a_corner_say_the_same() {
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
