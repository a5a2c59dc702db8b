//! The faces around a vertex, in canonical order.

use crate::numbers::id32;

/// One face of a star: corner `k` is at the centre, `a` and `b` follow counter-clockwise.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct StarFace {
    pub(crate) face: u32,
    pub(crate) k: u8,
    pub(crate) a: u32,
    pub(crate) b: u32,
}

/// A run of faces each of which shares an edge with the next.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Segment {
    pub(crate) start: usize,
    pub(crate) end: usize,
    /// Whether the last face also meets the first.
    pub(crate) closed: bool,
}

/// Stars of up to this many faces are sorted by linear search.
const SMALL: usize = 16;

/// A star sorted into fans. A manifold star is one segment; anything else is several.
#[derive(Clone, Debug, Default)]
pub(crate) struct Fan {
    pub(crate) star_faces: Vec<StarFace>,
    pub(crate) segments: Vec<Segment>,
    /// In stars of up to [`SMALL`] faces: the face that begins at a vertex. Entries are valid only if that face
    /// confirms it.
    starts: Vec<u8>,
}

impl Fan {
    /// Sorts a star: open runs from their start, in order of their first face, then closed ones. Cost: O(n log n) for
    /// n faces of any connectivity. Vertex numbers must be below `vertices`.
    pub(crate) fn sort(&mut self, star: &[StarFace], vertices: usize) {
        if star.len() > SMALL {
            self.sort_in(star, SortedSearch::new(star));
        } else if !self.sort_closed_run(star, vertices) {
            self.sort_in(star, LinearSearch::new(star));
        }
    }

    /// Sorts a star that is one closed run in which each vertex begins one face; returns whether it is.
    fn sort_closed_run(&mut self, star: &[StarFace], vertices: usize) -> bool {
        self.clear();
        if self.starts.len() < vertices {
            self.starts.resize(vertices, 0);
        }
        for (number, star_face) in (0..).zip(star) {
            self.starts[star_face.a as usize] = number;
        }
        let mut each = star.iter().enumerate();
        if star.len() < 2
            || !each.all(|(number, star_face)| usize::from(self.starts[star_face.a as usize]) == number)
        {
            return false;
        }
        let mut number = 0;
        loop {
            let star_face = star[number];
            self.star_faces.push(star_face);
            number = usize::from(self.starts[star_face.b as usize]);
            if star.get(number).is_none_or(|next| next.a != star_face.b) {
                return false;
            }
            // If each face begins at a different vertex, the first to repeat is the first face, unless two faces end
            // at one vertex.
            if number == 0 || self.star_faces.len() == star.len() {
                break;
            }
        }
        let closed = number == 0 && self.star_faces.len() == star.len();
        if closed {
            self.segments.push(Segment { start: 0, end: star.len(), closed });
        }
        closed
    }

    fn clear(&mut self) {
        self.star_faces.clear();
        self.segments.clear();
    }

    fn sort_in(&mut self, star: &[StarFace], mut faces: impl Faces) {
        self.clear();
        for open_only in [true, false] {
            for (i, first) in star.iter().enumerate() {
                if faces.is_left(i) && !(open_only && faces.is_end(first.a)) {
                    self.run(star, &mut faces, i);
                }
            }
        }
    }

    /// Adds the run that starts with a face.
    #[inline]
    fn run(&mut self, star: &[StarFace], faces: &mut impl Faces, first: usize) {
        let start = self.star_faces.len();
        let mut at = Some(first);
        while let Some(i) = at {
            faces.take(i);
            self.star_faces.push(star[i]);
            at = faces.starting_at(star[i].b);
        }
        let end = self.star_faces.len();
        let closed = end - start > 1 && self.star_faces[end - 1].b == self.star_faces[start].a;
        self.segments.push(Segment { start, end, closed });
    }

    /// The distinct ring vertices in order of first use.
    pub(crate) fn ring(&self) -> Vec<u32> {
        let mut ring: Vec<u32> = Vec::with_capacity(self.star_faces.len() + 1);
        let mut visited: Vec<u32> = Vec::with_capacity(self.star_faces.len() + 1);
        for v in self.star_faces.iter().flat_map(|s| [s.a, s.b]) {
            if let Err(at) = visited.binary_search(&v) {
                visited.insert(at, v);
                ring.push(v);
            }
        }
        ring
    }
}

/// The faces of a star that are not yet in a run.
trait Faces {
    fn is_left(&self, face: usize) -> bool;
    fn take(&mut self, face: usize);
    /// The first remaining face whose `a` is this vertex.
    fn starting_at(&mut self, a: u32) -> Option<usize>;
    /// Whether the vertex is the `b` of any face.
    fn is_end(&self, vertex: u32) -> bool;
}

/// Linear search, for few faces.
struct LinearSearch<'a> {
    star: &'a [StarFace],
    /// A bit per face that is not yet used.
    left: u32,
}

impl<'a> LinearSearch<'a> {
    fn new(star: &'a [StarFace]) -> Self {
        Self { star, left: (1 << star.len()) - 1 }
    }
}

impl Faces for LinearSearch<'_> {
    fn is_left(&self, face: usize) -> bool {
        self.left >> face & 1 == 1
    }

    fn take(&mut self, face: usize) {
        self.left &= !(1 << face);
    }

    fn starting_at(&mut self, a: u32) -> Option<usize> {
        let mut left = self.left;
        while left != 0 {
            let i = left.trailing_zeros() as usize;
            if self.star[i].a == a {
                return Some(i);
            }
            left &= left - 1;
        }
        None
    }

    fn is_end(&self, vertex: u32) -> bool {
        self.star.iter().any(|s| s.b == vertex)
    }
}

/// Binary search in sorted lists, for many faces.
struct SortedSearch {
    /// (`a`, face), ascending.
    by_a: Vec<(u32, u32)>,
    /// Every `b`, ascending.
    ends: Vec<u32>,
    /// Next candidate of each run of equal `a`, stored at the run's first index.
    cursor: Vec<u32>,
    used: Vec<bool>,
}

impl SortedSearch {
    fn new(star: &[StarFace]) -> Self {
        let mut by_a: Vec<(u32, u32)> = star.iter().enumerate().map(|(i, s)| (s.a, id32(i))).collect();
        by_a.sort_unstable();
        let mut ends: Vec<u32> = star.iter().map(|s| s.b).collect();
        ends.sort_unstable();
        Self { by_a, ends, cursor: (0..id32(star.len())).collect(), used: vec![false; star.len()] }
    }
}

impl Faces for SortedSearch {
    fn is_left(&self, face: usize) -> bool {
        !self.used[face]
    }

    fn take(&mut self, face: usize) {
        self.used[face] = true;
    }

    fn starting_at(&mut self, a: u32) -> Option<usize> {
        let run = self.by_a.partition_point(|e| e.0 < a);
        let mut at = *self.cursor.get(run)? as usize;
        let mut found = None;
        while let Some(&(_, face)) = self.by_a.get(at).filter(|e| e.0 == a) {
            if !self.used[face as usize] {
                found = Some(face as usize);
                break;
            }
            at += 1;
        }
        self.cursor[run] = id32(at);
        found
    }

    fn is_end(&self, vertex: u32) -> bool {
        self.ends.binary_search(&vertex).is_ok()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn star_face(face: u32, a: u32, b: u32) -> StarFace {
        StarFace { face, k: 0, a, b }
    }

    fn sorted(star: &[StarFace]) -> Fan {
        let mut fan = Fan::default();
        fan.sort(star, 10);
        fan
    }

    #[test]
    fn a_closed_star_is_one_closed_segment() {
        let fan = sorted(&[star_face(0, 1, 2), star_face(1, 3, 1), star_face(2, 2, 3)]);
        assert_eq!(fan.star_faces.iter().map(|s| s.face).collect::<Vec<_>>(), [0, 2, 1]);
        assert_eq!(fan.segments, [Segment { start: 0, end: 3, closed: true }]);
    }

    #[test]
    fn open_and_non_manifold_stars_keep_every_face() {
        let fan = sorted(&[
            star_face(0, 5, 6),
            star_face(1, 1, 2),
            star_face(2, 2, 3),
            star_face(3, 2, 3),
            star_face(4, 0, 1),
        ]);
        assert_eq!(fan.star_faces.len(), 5);
        assert_eq!(fan.segments.len(), 3);
        assert_eq!(fan.star_faces.iter().map(|s| s.face).collect::<Vec<_>>(), [0, 4, 1, 2, 3]);
    }

    #[test]
    fn linear_and_sorted_search_agree() {
        // Random stars with few ring vertices, so edges have one, two or more faces.
        let mut random = crate::random::Random::new(7);
        let mut below = |n: usize| random.below(n) as u32;
        for _ in 0..2000 {
            let (faces, ring) = (1 + below(16), 2 + below(8) as usize);
            let star: Vec<StarFace> = (0..faces).map(|i| star_face(i, below(ring), below(ring))).collect();
            let (looked, mut searched) = (sorted(&star), Fan::default());
            searched.sort_in(&star, SortedSearch::new(&star));
            assert_eq!(
                (looked.star_faces, looked.segments),
                (searched.star_faces, searched.segments),
                "{star:?}"
            );
        }
    }
}
