//! The stars of a region's vertices: runs of corners in one array, so that visiting a star follows no pointers.

use crate::entropy::steps;
use crate::mesh::corner::Spaced;

/// Initial capacity of a star.
const INITIAL_CAPACITY: u32 = 8;

/// Place of a vertex's star in the array.
#[derive(Clone, Copy, Default)]
pub(crate) struct Star {
    start: u32,
    count: u32,
    capacity: u32,
}

impl Star {
    /// Number of corners.
    #[inline]
    pub(crate) fn len(self) -> usize {
        self.count as usize
    }
}

/// The corners of all stars, each in insertion order. A star that exceeds its capacity moves to the end of the array,
/// with twice the capacity.
#[derive(Default)]
pub(crate) struct Stars {
    corners: Vec<Spaced>,
}

impl Stars {
    /// Removes all stars.
    pub(crate) fn clear(&mut self) {
        self.corners.clear();
    }

    /// The corners of a star in insertion order.
    #[inline]
    pub(crate) fn of(&self, star: Star) -> &[Spaced] {
        steps::take(star.len() as u64);
        &self.corners[star.start as usize..][..star.len()]
    }

    /// Appends a corner to a star.
    #[inline]
    pub(crate) fn push(&mut self, star: &mut Star, corner: Spaced) {
        if star.count == star.capacity {
            self.make_room(star);
        }
        self.corners[(star.start + star.count) as usize] = corner;
        star.count += 1;
    }

    /// Removes the corners that satisfy `goes`.
    #[inline]
    pub(crate) fn remove_if(&mut self, star: &mut Star, mut goes: impl FnMut(Spaced) -> bool) {
        steps::take(star.len() as u64);
        let corners = &mut self.corners[star.start as usize..][..star.len()];
        let mut stay = 0;
        for at in 0..corners.len() {
            let corner = corners[at];
            corners[stay] = corner;
            stay += usize::from(!goes(corner));
        }
        star.count = u32::try_from(stay).unwrap_or(star.count);
    }

    #[inline]
    fn make_room(&mut self, star: &mut Star) {
        if star.capacity > 0 {
            return self.move_away(star);
        }
        star.start = crate::numbers::id32(self.corners.len());
        star.capacity = INITIAL_CAPACITY;
        self.corners.extend_from_slice(&[Spaced::default(); INITIAL_CAPACITY as usize]);
    }

    #[cold]
    fn move_away(&mut self, star: &mut Star) {
        let from = star.start as usize..(star.start + star.count) as usize;
        let start = self.corners.len();
        star.capacity *= 2;
        self.corners.extend_from_within(from);
        self.corners.resize(start + star.capacity as usize, Spaced::default());
        star.start = crate::numbers::id32(start);
    }

    /// Memory held, in bytes.
    pub(crate) fn bytes(&self) -> usize {
        self.corners.capacity() * size_of::<Spaced>()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn stars_keep_the_order_of_entering_however_they_grow_and_shrink() {
        let mut random = crate::random::Random::new(3);
        let mut stars = Stars::default();
        let mut all = vec![(Star::default(), Vec::new()); 5];
        for corner in (0..2000).map(|face| Spaced::new(face, 1)) {
            let (star, expected) = &mut all[random.below(5)];
            stars.push(star, corner);
            expected.push(corner);
            if random.below(3) == 0 {
                let gone = random.below(7) as u32;
                stars.remove_if(star, |c| c.face() % 7 == gone);
                expected.retain(|c| c.face() % 7 != gone);
            }
            assert!(all.iter().all(|(star, expected)| stars.of(*star) == expected));
        }
        assert!(all.iter().any(|(_, expected)| expected.len() > INITIAL_CAPACITY as usize));
    }
}
