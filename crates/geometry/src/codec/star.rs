//! The stars of a region's vertices, each a run of corners in one array: a walk around a vertex waits for no pointer.

use crate::entropy::steps;
use crate::mesh::corner::Spaced;

/// Room that a star gets first.
const FIRST_ROOM: u32 = 8;

/// Where a vertex's star is.
#[derive(Clone, Copy, Default)]
pub(crate) struct Star {
    start: u32,
    count: u32,
    room: u32,
}

impl Star {
    /// How many corners it has.
    #[inline]
    pub(crate) fn len(self) -> usize {
        self.count as usize
    }
}

/// The corners of all stars, each star's in the order in which they entered. A star that outgrows its
/// room moves to the end, with twice as much.
#[derive(Default)]
pub(crate) struct Stars {
    corners: Vec<Spaced>,
}

impl Stars {
    /// Forgets all stars.
    pub(crate) fn clear(&mut self) {
        self.corners.clear();
    }

    /// The corners of a star, the last to enter last.
    #[inline]
    pub(crate) fn of(&self, star: Star) -> &[Spaced] {
        steps::take(star.len() as u64);
        &self.corners[star.start as usize..][..star.len()]
    }

    /// Adds a corner to a star.
    #[inline]
    pub(crate) fn enter(&mut self, star: &mut Star, corner: Spaced) {
        if star.count == star.room {
            self.make_room(star);
        }
        self.corners[(star.start + star.count) as usize] = corner;
        star.count += 1;
    }

    /// Takes out the corners for which `goes` says so.
    #[inline]
    pub(crate) fn leave(&mut self, star: &mut Star, mut goes: impl FnMut(Spaced) -> bool) {
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
        if star.room > 0 {
            return self.move_away(star);
        }
        star.start = crate::numbers::id32(self.corners.len());
        star.room = FIRST_ROOM;
        self.corners.extend_from_slice(&[Spaced::default(); FIRST_ROOM as usize]);
    }

    #[cold]
    fn move_away(&mut self, star: &mut Star) {
        let from = star.start as usize..(star.start + star.count) as usize;
        let start = self.corners.len();
        star.room *= 2;
        self.corners.extend_from_within(from);
        self.corners.resize(start + star.room as usize, Spaced::default());
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
            stars.enter(star, corner);
            expected.push(corner);
            if random.below(3) == 0 {
                let gone = random.below(7) as u32;
                stars.leave(star, |c| c.face() % 7 == gone);
                expected.retain(|c| c.face() % 7 != gone);
            }
            assert!(all.iter().all(|(star, expected)| stars.of(*star) == expected));
        }
        assert!(all.iter().any(|(_, expected)| expected.len() > FIRST_ROOM as usize));
    }
}
