//! The faces around a vertex in a canonical order.

/// One face of a star: corner `k` is at the centre, `a` and `b` follow counter-clockwise.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Spoke {
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

/// A star sorted into fans. A manifold star is one segment; anything else is several.
#[derive(Clone, Debug, Default)]
pub(crate) struct Fan {
    pub(crate) spokes: Vec<Spoke>,
    pub(crate) segments: Vec<Segment>,
}

impl Fan {
    /// Sorts a star: open runs from their start, in order of their
    /// first face, then closed ones. Cost O(n log n) for n faces, whatever they look like.
    pub(crate) fn new(star: &[Spoke]) -> Self {
        let mut by_a: Vec<(u32, u32)> = star.iter().enumerate().map(|(i, s)| (s.a, i as u32)).collect();
        by_a.sort_unstable();
        let mut ends: Vec<u32> = star.iter().map(|s| s.b).collect();
        ends.sort_unstable();
        // Next candidate of each run of equal `a`, kept at the run's first place.
        let mut cursor: Vec<u32> = (0..star.len() as u32).collect();
        let mut used = vec![false; star.len()];
        let mut fan = Self { spokes: Vec::with_capacity(star.len()), segments: Vec::new() };
        for open_only in [true, false] {
            for (i, first) in star.iter().enumerate() {
                if used[i] || (open_only && ends.binary_search(&first.a).is_ok()) {
                    continue;
                }
                let start = fan.spokes.len();
                let mut at = Some(i);
                while let Some(j) = at {
                    used[j] = true;
                    fan.spokes.push(star[j]);
                    at = next(&by_a, &mut cursor, &used, star[j].b);
                }
                let end = fan.spokes.len();
                let closed = end - start > 1 && fan.spokes[end - 1].b == fan.spokes[start].a;
                fan.segments.push(Segment { start, end, closed });
            }
        }
        fan
    }

    /// The distinct ring vertices in order of first use.
    pub(crate) fn ring(&self) -> Vec<u32> {
        let mut ring: Vec<u32> = Vec::with_capacity(self.spokes.len() + 1);
        let mut seen: Vec<u32> = Vec::with_capacity(self.spokes.len() + 1);
        for v in self.spokes.iter().flat_map(|s| [s.a, s.b]) {
            if let Err(at) = seen.binary_search(&v) {
                seen.insert(at, v);
                ring.push(v);
            }
        }
        ring
    }
}

/// The first unused face that starts at `a`.
fn next(by_a: &[(u32, u32)], cursor: &mut [u32], used: &[bool], a: u32) -> Option<usize> {
    let run = by_a.partition_point(|e| e.0 < a);
    if run >= by_a.len() {
        return None;
    }
    let mut at = cursor[run] as usize;
    while at < by_a.len() && by_a[at].0 == a {
        let index = by_a[at].1 as usize;
        if !used[index] {
            cursor[run] = at as u32;
            return Some(index);
        }
        at += 1;
    }
    cursor[run] = at as u32;
    None
}

#[cfg(test)]
mod tests {
    use super::*;

    fn spoke(face: u32, a: u32, b: u32) -> Spoke {
        Spoke { face, k: 0, a, b }
    }

    #[test]
    fn a_closed_star_is_one_closed_segment() {
        let fan = Fan::new(&[spoke(0, 1, 2), spoke(1, 3, 1), spoke(2, 2, 3)]);
        assert_eq!(fan.spokes.iter().map(|s| s.face).collect::<Vec<_>>(), [0, 2, 1]);
        assert_eq!(fan.segments, [Segment { start: 0, end: 3, closed: true }]);
    }

    #[test]
    fn open_and_non_manifold_stars_keep_every_face() {
        let fan = Fan::new(&[spoke(0, 5, 6), spoke(1, 1, 2), spoke(2, 2, 3), spoke(3, 2, 3), spoke(4, 0, 1)]);
        assert_eq!(fan.spokes.len(), 5);
        assert_eq!(fan.segments.len(), 3);
        assert_eq!(fan.spokes.iter().map(|s| s.face).collect::<Vec<_>>(), [0, 4, 1, 2, 3]);
    }
}
