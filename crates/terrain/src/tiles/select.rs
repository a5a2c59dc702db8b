//! Selection of the tiles that a view draws, by walking the quadtree from its roots.

use super::ranges::clearance_distance;
use super::tile::TileId;

/// A tile with a mask of the quadrants that are drawn with its spacing: bit q for [`TileId::child`] q. Other quadrants
/// are drawn as finer tiles, or are out of view.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SelectedTile {
    /// The tile.
    pub tile: TileId,
    /// Mask of drawn quadrants; never 0.
    pub quadrants: u8,
}

/// Position of the eye over the terrain, in grid units.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Eye {
    /// Position in the plane.
    pub at: [f64; 2],
    /// Height over the highest ground around, at least 0.
    pub above: f64,
}

/// Selects the tiles below `roots` that a view draws, finest first and front to back within a spacing.
///
/// `end` gives the distance up to which a tile is drawn with its spacing ([`RegionRanges::end`]), in grid units; `sees`
/// tells whether a tile may be in view. Returns `None` as soon as more than `max_tiles` are needed: the caller then
/// raises the allowed error. Cost: a few comparisons per visited tile.
///
/// [`RegionRanges::end`]: super::RegionRanges::end
#[must_use]
pub fn select(
    roots: &[TileId],
    end: &dyn Fn(TileId) -> f64,
    eye: Eye,
    max_tiles: usize,
    sees: &dyn Fn(TileId) -> bool,
) -> Option<Vec<SelectedTile>> {
    let mut selected = Vec::new();
    let mut open: Vec<TileId> = roots.iter().copied().filter(|&root| sees(root)).collect();
    while let Some(tile) = open.pop() {
        let mut quadrants = 0b1111;
        if tile.spacing > 0 {
            for quadrant in 0..4 {
                let child = tile.child(quadrant);
                let visible = sees(child);
                if !visible {
                    quadrants &= !(1 << quadrant);
                } else if distance(child, eye) < end(child) {
                    quadrants &= !(1 << quadrant);
                    open.push(child);
                }
            }
        }
        if quadrants != 0 {
            selected.push(SelectedTile { tile, quadrants });
            if selected.len() > max_tiles {
                return None;
            }
        }
    }
    let nearness = |p: &SelectedTile| distance(p.tile, eye);
    selected.sort_by(|a, b| (a.tile.spacing).cmp(&b.tile.spacing).then(nearness(a).total_cmp(&nearness(b))));
    Some(selected)
}

/// Distance of the nearest point of a tile, in grid units.
fn distance(tile: TileId, eye: Eye) -> f64 {
    let side = tile.side() as f64;
    let outside = |origin: i64, eye: f64| {
        let from = origin as f64;
        (from - eye).max(eye - (from + side)).max(0.0)
    };
    let [x, y] = tile.origin();
    clearance_distance(outside(x, eye.at[0]).hypot(outside(y, eye.at[1])), eye.above)
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use glam::DVec2;

    use super::*;
    use crate::tiles::{Region, RegionRanges, TILE_CELLS};

    const ROOTS: [TileId; 4] = [
        TileId { spacing: 7, x: -1, y: -1 },
        TileId { spacing: 7, x: 0, y: -1 },
        TileId { spacing: 7, x: -1, y: 0 },
        TileId { spacing: 7, x: 0, y: 0 },
    ];

    /// Drawn quadrants: origin to (side, spacing drawn there).
    fn quadrants(picked: &[SelectedTile]) -> BTreeMap<(i64, i64), (i64, u8)> {
        let mut all = BTreeMap::new();
        for p in picked {
            for q in (0..4).filter(|q| p.quadrants & (1 << q) != 0) {
                let side = p.tile.side() / 2;
                let [x, y] = p.tile.origin();
                let at = (x + side * i64::from(q & 1), y + side * i64::from(q >> 1));
                assert!(all.insert(at, (side, p.tile.spacing)).is_none(), "drawn twice");
            }
        }
        all
    }

    /// Distances of a view, with up to four rough regions.
    fn ranges(random: &mut lodestream_geometry::random::Random) -> RegionRanges {
        let mut errors = || -> Vec<f64> {
            let (first, factor) = (0.02 + 0.1 * random.unit(), 1.0 + random.below(20) as f64 * 0.1);
            (0..9).map(|s| if s == 0 { 0.0 } else { first * factor.powi(s) }).collect()
        };
        let (plain, rough) = (errors(), [errors(), errors(), errors(), errors()]);
        let mut regions = Vec::new();
        for errors in rough.into_iter().take(random.below(5)) {
            let mut place = || DVec2::new(random.unit(), random.unit()) * 4096.0 - 2048.0;
            let (from, to) = (place(), place());
            regions.push(Region { from, to, radius: 200.0 * random.unit(), errors });
        }
        RegionRanges::new(&plain, &regions, 500.0, 1.0 + random.below(8) as f64)
    }

    #[test]
    fn tiles_cover_the_world_once_and_neighbours_differ_by_one_spacing() {
        let mut random = lodestream_geometry::random::Random::new(7);
        for _ in 0..50 {
            let ranges = ranges(&mut random);
            let mut coordinate = || random.below(4096) as f64 - 2048.0;
            let eye = Eye { at: [coordinate(), coordinate()], above: (coordinate() * 0.1).max(0.0) };
            let picked = select(&ROOTS, &|tile| ranges.end(tile), eye, usize::MAX, &|_| true).unwrap();
            let drawn = quadrants(&picked);
            let world = 2 * ROOTS[0].side();
            assert_eq!(drawn.values().map(|(side, _)| side * side).sum::<i64>(), world * world);

            // Along every edge of every quadrant: find its neighbour, and check that the finer side has ended its
            // morph.
            let at = |x: i64, y: i64| {
                drawn.iter().find(|((x0, y0), (side, _))| {
                    (*x0..x0 + side).contains(&x) && (*y0..y0 + side).contains(&y)
                })
            };
            for (&(x, y), &(side, spacing)) in drawn.iter().filter(|(_, (_, s))| *s < 3) {
                for (dx, dy) in [(-1, side / 2), (side, side / 2), (side / 2, -1), (side / 2, side)] {
                    let Some((_, &(_, other))) = at(x + dx, y + dy) else { continue };
                    assert!(other.abs_diff(spacing) <= 1, "{spacing} beside {other}");
                    if other > spacing {
                        // The nearest point of the edge that the two share.
                        let (ex, ey) = (x + dx.clamp(0, side), y + dy.clamp(0, side));
                        let (fx, fy) = if dx < 0 || dx == side { (0, side / 2) } else { (side / 2, 0) };
                        for t in -8..=8_i64 {
                            let px = (ex + fx * t / 8) as f64 - eye.at[0];
                            let py = (ey + fy * t / 8) as f64 - eye.at[1];
                            let d = clearance_distance(px.hypot(py), eye.above);
                            let at = DVec2::from(eye.at) + DVec2::new(px, py);
                            let arrived = ranges.morph(spacing, at)[1];
                            assert!(d >= arrived * (1.0 - 1e-12), "the finer side still morphs");
                            let begins = ranges.morph(other, at)[0];
                            assert!(d <= begins * (1.0 + 1e-12), "the coarser side morphs already");
                        }
                    }
                }
            }
        }
    }

    #[test]
    fn no_tile_coarser_than_allowed_is_drawn() {
        let mut random = lodestream_geometry::random::Random::new(8);
        let ranges = ranges(&mut random);
        let eye = Eye { at: [10.0, -300.0], above: 0.0 };
        for p in select(&ROOTS, &|tile| ranges.end(tile), eye, usize::MAX, &|_| true).unwrap() {
            for q in (0..4).filter(|q| p.quadrants & (1 << q) != 0 && p.tile.spacing > 0) {
                assert!(distance(p.tile.child(q), eye) >= ranges.end(p.tile.child(q)));
            }
        }
    }

    #[test]
    fn tiles_out_of_view_are_left_out_and_too_many_give_none() {
        let ranges = RegionRanges::new(&[0.0, 1.0, 2.0, 4.0, 8.0, 16.0, 32.0, 64.0], &[], 500.0, 1.0);
        let eye = Eye { at: [0.5, 0.5], above: 0.0 };
        let right = |tile: TileId| tile.origin()[0] + tile.side() > 0;
        let all = select(&ROOTS, &|tile| ranges.end(tile), eye, usize::MAX, &|_| true).unwrap();
        let half = select(&ROOTS, &|tile| ranges.end(tile), eye, usize::MAX, &right).unwrap();
        assert!(half.len() < all.len() * 6 / 10, "{} of {}", half.len(), all.len());
        assert!(half.iter().all(|p| right(p.tile)));
        assert_eq!(select(&ROOTS, &|tile| ranges.end(tile), eye, half.len() - 1, &right), None);
        assert!(TILE_CELLS.is_power_of_two());
    }
}
