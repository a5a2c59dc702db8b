//! Where textures lie on what is built: mostly as projected along the axis that a face looks along, on all faces alike, so
//! texture coordinates follow from where a corner is and from the faces that are there.

use crate::codec::model::PLACES;
use crate::codec::residual::quarter_octaves;
use crate::mesh::orientation_class::{ORIENTATION_CLASSES, ways_of};
use crate::mesh::vec3::{Vec3, sub};
use crate::numbers::floored;

/// Sides: towards and against each axis.
const SIDES: usize = 6;
/// Materials whose textures are told apart; others count as one of these.
const MATERIALS: usize = 4;

/// The axes across each.
const ACROSS: [[usize; 2]; 3] = [[1, 2], [0, 2], [0, 1]];
/// Edges count as if they were so much shorter where a corner is a copy: it has the texture of where it came from, so they
/// count only until others are there.
const OF_COPIES: f64 = 1.0 / 32.0;
/// A corner that a projection misses by as many cells was not projected so.
const NEAR: u32 = 8;

/// What the corners on one side say of how texture coordinates follow from the other two axes: sums of products over edges,
/// which do not depend on where a texture begins.
#[derive(Clone, Copy, Default)]
struct Side {
    /// Of the edges along the two axes: xx, xy, yy.
    edges: [f64; 3],
    /// With what texture coordinates change along them, for either: x, y.
    changes: [[f64; 2]; 2],
    /// The newest corner.
    newest: Option<Anchor>,
    /// Sums over corners: how many, where along the two axes, and texture coordinates.
    corners: f64,
    at: [f64; 2],
    uv: [f64; 2],
}

/// What a projection goes on from.
#[derive(Clone, Copy)]
enum From {
    /// The mean of all corners on the side.
    Mean,
    /// The newest one.
    Newest,
    This(Anchor),
}

/// A corner whose texture coordinates are known.
#[derive(Clone, Copy)]
pub(crate) struct Anchor {
    pub(crate) at: Vec3,
    pub(crate) uv: [i32; 2],
    /// Its normal group, numbered by how it [leans](crate::mesh::orientation_class).
    pub(crate) group: u32,
}

/// What is known of the projections of a region.
pub(crate) struct UvMaps {
    sides: [[Side; SIDES]; MATERIALS],
    /// Along which of the axes that it leans to what leans so was projected last.
    last: [usize; ORIENTATION_CLASSES as usize],
    /// By place (corners of faces that moved, of new ones of which another corner is known, and of others), how far off
    /// projections from the mean, those from one corner and what else was expected were: means of logarithms, in quarter
    /// octaves × 16.
    off: [[i32; 3]; PLACES],
}

/// What was looked up for a corner.
#[derive(Clone, Copy)]
pub(crate) struct CornerLookup {
    place: usize,
    group: u32,
    /// Texture coordinates as projected by each of the axes that it leans to, from the mean of the side and from one corner.
    by_axis: [[Option<[i32; 2]>; 2]; 3],
    /// The likely axis.
    likely: Option<usize>,
    /// What else is expected.
    other: [i32; 2],
}

impl Side {
    /// Texture coordinates at `at`, as they go on from elsewhere: the gradient is that of least squares over all edges.
    fn project(&self, axis: usize, from: From, at: Vec3) -> Option<[i32; 2]> {
        let newest = self.newest?;
        let [x, y] = ACROSS[axis];
        let (origin, uv) = match from {
            From::Mean if self.corners > 0.0 => {
                (self.at.map(|sum| sum / self.corners), self.uv.map(|sum| sum / self.corners))
            }
            From::Mean | From::Newest => ([newest.at[x], newest.at[y]], newest.uv.map(f64::from)),
            From::This(corner) => ([corner.at[x], corner.at[y]], corner.uv.map(f64::from)),
        };
        let [xx, xy, yy] = self.edges;
        let determinant = xx * yy - xy * xy;
        if determinant <= 1e-3 * xx * yy {
            return None;
        }
        let [dx, dy] = [at[x] - origin[0], at[y] - origin[1]];
        let [s, t] = [dx * yy - dy * xy, dy * xx - dx * xy].map(|part| part / determinant);
        Some([0, 1].map(|k| {
            let [along, up] = self.changes[k];
            floored((uv[k] + s * along + t * up + 0.5).clamp(-1.0e9, 1.0e9))
        }))
    }
}

/// How far apart two are.
fn apart(a: [i32; 2], b: [i32; 2]) -> u32 {
    a[0].abs_diff(b[0]).saturating_add(a[1].abs_diff(b[1]))
}

/// The side of one axis, if the group leans to one alone.
fn only_side(group: u32) -> Option<(usize, usize)> {
    let ways = ways_of(group);
    let mut axes = (0..3).filter(|&axis| ways[axis] != 0);
    let axis = axes.next()?;
    axes.next().is_none().then(|| (axis, side(axis, ways[axis])))
}

fn side(axis: usize, way: i8) -> usize {
    axis * 2 + usize::from(way < 0)
}

impl Default for UvMaps {
    fn default() -> Self {
        Self { sides: Default::default(), last: [0; ORIENTATION_CLASSES as usize], off: [[0; 3]; PLACES] }
    }
}

impl UvMaps {
    /// Takes note of a face.
    pub(crate) fn face(&mut self, material: u16, corners: [Anchor; 3]) {
        let sides = &mut self.sides[usize::from(material) % MATERIALS];
        for (from, to) in [(0, 1), (1, 2), (2, 0)] {
            let (from, to) = (&corners[from], &corners[to]);
            let Some((axis, side)) = only_side(from.group) else { continue };
            let side = &mut sides[side];
            let copies = [from, to].map(|corner| corner.group >= ORIENTATION_CLASSES);
            if !copies[0] {
                side.newest = Some(*from);
                side.corners += 1.0;
                let ([x, y], [u, v]) = (ACROSS[axis].map(|axis| from.at[axis]), from.uv.map(f64::from));
                side.at = [side.at[0] + x, side.at[1] + y];
                side.uv = [side.uv[0] + u, side.uv[1] + v];
            } else if side.corners == 0.0 {
                side.newest = Some(*from);
            }
            if from.group % ORIENTATION_CLASSES != to.group % ORIENTATION_CLASSES {
                continue;
            }
            let edge = sub(to.at, from.at);
            let weight = if copies == [false; 2] { 1.0 } else { OF_COPIES };
            let [ex, ey] = ACROSS[axis].map(|axis| edge[axis] * weight);
            for (sum, product) in side.edges.iter_mut().zip([ex * ex, ex * ey, ey * ey]) {
                *sum += product;
            }
            for (k, sums) in side.changes.iter_mut().enumerate() {
                let change = weight * f64::from(to.uv[k].wrapping_sub(from.uv[k]));
                sums[0] += ex * change;
                sums[1] += ey * change;
            }
        }
    }

    /// What texture coordinates are likely at `at`, of a corner of a normal group on a face of a material: as they go on
    /// from `from` or, where that is `None` or leans elsewhere, from the newest corner on the same side. What leans to
    /// several axes may be projected along either: as `from` was, else as the last that leant so.
    pub(crate) fn look(
        &self,
        place: usize,
        (group, material): (u32, u16),
        from: Option<Anchor>,
        at: Vec3,
        other: [i32; 2],
    ) -> CornerLookup {
        let sides = &self.sides[usize::from(material) % MATERIALS];
        let ways = ways_of(group);
        let from = from.filter(|from| from.group == group % ORIENTATION_CLASSES);
        let mut likely = None;
        let mut least = NEAR;
        let by_axis = [0, 1, 2].map(|axis| {
            if ways[axis] == 0 {
                return [None; 2];
            }
            let side = &sides[side(axis, ways[axis])];
            let Some(from) = from else {
                return [From::Mean, From::Newest].map(|from| side.project(axis, from, at));
            };
            let missed = [From::Mean, From::Newest]
                .into_iter()
                .filter_map(|of| Some(apart(side.project(axis, of, from.at)?, from.uv)))
                .min();
            if let Some(missed) = missed.filter(|&missed| missed < least) {
                (likely, least) = (Some(axis), missed);
            }
            [From::Mean, From::This(from)].map(|from| side.project(axis, from, at))
        });
        if from.is_none() {
            let last = self.last[(group % ORIENTATION_CLASSES) as usize];
            let there = |axis: &usize| by_axis[*axis][0].is_some();
            likely = Some(last).filter(there).or_else(|| (0..3).find(there));
        }
        CornerLookup { place, group, by_axis, likely, other }
    }

    /// Texture coordinates as projected, or `None` where what else was expected has been nearer.
    pub(crate) fn choose(&self, looked: &CornerLookup) -> Option<[i32; 2]> {
        let [mean, corner, other] = self.off[looked.place];
        let by_axis = looked.by_axis[looked.likely?];
        (mean.min(corner) <= other).then(|| by_axis[usize::from(corner < mean)])?
    }

    /// Takes note of what a corner's texture coordinates are.
    pub(crate) fn follow(&mut self, looked: &CornerLookup, actual: [i32; 2]) {
        let CornerLookup { place, group, by_axis, likely, other } = *looked;
        let missed = |uv: Option<[i32; 2]>| uv.map_or(u32::MAX, |uv| apart(uv, actual));
        let Some(axis) = (0..3).min_by_key(|&axis| by_axis[axis].map(missed).into_iter().min()) else {
            return;
        };
        if by_axis[axis] == [None; 2] {
            return;
        }
        self.last[(group % ORIENTATION_CLASSES) as usize] = axis;
        let [mean, corner] = by_axis[likely.unwrap_or(axis)].map(missed);
        for (off, apart) in self.off[place].iter_mut().zip([mean, corner, apart(other, actual)]) {
            *off += (quarter_octaves(f64::from(apart) + 1.0) * 16 - *off) / 16;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::orientation_class::orientation_class;
    use crate::numbers::truncated;

    const UP: [f64; 3] = [0.0, 0.0, 1.0];
    const EAST: [f64; 3] = [1.0, 0.0, 0.0];

    /// A corner on a side, with the texture of a projection to thirds of cells.
    fn corner(normal: Vec3, at: Vec3) -> Anchor {
        let group = orientation_class(normal);
        let [x, y] = ACROSS[(0..3).find(|&axis| normal[axis] != 0.0).unwrap()];
        Anchor { at, uv: [truncated(at[x] / 3.0 + 100.5), truncated(2000.5 - at[y] / 3.0)], group }
    }

    fn triangle(normal: Vec3, at: Vec3) -> [Anchor; 3] {
        let [x, y] = ACROSS[(0..3).find(|&axis| normal[axis] != 0.0).unwrap()];
        let mut corners = [at; 3];
        corners[1][x] += 90.0;
        corners[2][y] += 120.0;
        corners.map(|at| corner(normal, at))
    }

    fn seen() -> UvMaps {
        let mut maps = UvMaps::default();
        for i in 0..20 {
            let at = [f64::from(i * 37 % 400), f64::from(i * 53 % 500), f64::from(i)];
            maps.face(0, triangle(UP, at));
            maps.face(0, triangle(EAST, [at[2], at[0], at[1]]));
        }
        maps
    }

    #[test]
    fn what_was_not_seen_is_not_projected() {
        let maps = UvMaps::default();
        let looked = maps.look(2, (orientation_class(UP), 0), None, [5.0; 3], [7, 7]);
        assert_eq!(maps.choose(&looked), None);
        // Another material may lie otherwise.
        let looked = seen().look(2, (orientation_class(UP), 1), None, [5.0; 3], [7, 7]);
        assert_eq!(seen().choose(&looked), None);
    }

    #[test]
    fn texture_coordinates_follow_from_the_faces_on_the_same_side() {
        let maps = seen();
        for at in [[600.0, 30.0, 4.0], [-250.0, 810.0, 90.0], [0.0, 0.0, 0.0]] {
            for normal in [UP, EAST] {
                let looked = maps.look(2, (orientation_class(normal), 0), None, at, [0, 0]);
                let (uv, meant) = (maps.choose(&looked).unwrap(), corner(normal, at).uv);
                assert!(apart(uv, meant) <= 2, "{uv:?} instead of {meant:?}");
            }
        }
    }

    #[test]
    fn what_leans_to_two_axes_is_projected_as_its_neighbour_was_or_as_the_last_was() {
        let mut maps = seen();
        let between = orientation_class([1.0, 0.0, 1.0]);
        let at = [300.0, 200.0, 40.0];
        for normal in [UP, EAST] {
            let neighbour = Anchor { group: between, ..corner(normal, [280.0, 250.0, 20.0]) };
            let looked = maps.look(1, (between, 0), Some(neighbour), at, [0, 0]);
            let meant = corner(normal, at).uv;
            assert!(apart(maps.choose(&looked).unwrap(), meant) <= 2);
            maps.follow(&looked, meant);
            let looked = maps.look(1, (between, 0), None, at, [0, 0]);
            assert!(apart(maps.choose(&looked).unwrap(), meant) <= 2);
        }
        // A neighbour that was projected in no such way says that this one is not, either.
        let strange = Anchor { at, uv: [1, 1], group: between };
        assert_eq!(maps.choose(&maps.look(1, (between, 0), Some(strange), at, [0, 0])), None);
    }

    #[test]
    fn where_projections_are_far_off_they_are_left() {
        let mut maps = seen();
        let at = [300.0, 200.0, 40.0];
        for _ in 0..30 {
            let looked = maps.look(2, (orientation_class(UP), 0), None, at, [3000, 3000]);
            maps.follow(&looked, [3000, 3001]);
        }
        assert_eq!(maps.choose(&maps.look(2, (orientation_class(UP), 0), None, at, [3000, 3000])), None);
        assert!(
            maps.choose(&maps.look(0, (orientation_class(UP), 0), None, at, [3000, 3000])).is_some(),
            "another place"
        );
    }
}
