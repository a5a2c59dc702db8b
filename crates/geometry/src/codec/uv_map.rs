//! Projected textures of axis-aligned geometry: textures are usually projected along the main axis of a face, with the
//! same map on all faces, so texture coordinates follow from positions and from known faces.

use crate::codec::model::PLACES;
use crate::codec::residual::quarter_octaves;
use crate::mesh::orientation_class::{ORIENTATION_CLASSES, signs_of};
use crate::mesh::vec3::{Vec3, sub};
use crate::numbers::floored;

/// Sides: positive and negative direction of each axis.
const SIDES: usize = 6;
/// Materials with separate maps; further ones share these.
const MATERIALS: usize = 4;

/// The other two axes of each axis.
const ACROSS: [[usize; 2]; 3] = [[1, 2], [0, 2], [0, 1]];
/// Length factor of edges at copied corners, which have the texture of the original's place: they count only until
/// other edges are known.
const COPY_EDGE_FACTOR: f64 = 1.0 / 32.0;
/// A corner whose projection is off by more cells was not projected.
const NEAR: u32 = 8;

/// Statistics of one side: how texture coordinates depend on the other two axes, as sums of products over edges,
/// which are independent of the texture's offset.
#[derive(Clone, Copy, Default)]
struct Side {
    /// Sums over edges of the two axes: xx, xy, yy.
    edges: [f64; 3],
    /// Sums of either texture coordinate's change with x and y.
    changes: [[f64; 2]; 2],
    /// The most recent corner.
    newest: Option<Anchor>,
    /// Sums over corners: count, position along the two axes, texture coordinates.
    corners: f64,
    at: [f64; 2],
    uv: [f64; 2],
}

/// The point that a projection extrapolates from.
#[derive(Clone, Copy)]
enum Origin {
    /// The mean of all corners on the side.
    Mean,
    /// The most recent corner.
    Newest,
    This(Anchor),
}

/// A corner with known texture coordinates.
#[derive(Clone, Copy)]
pub(crate) struct Anchor {
    pub(crate) at: Vec3,
    pub(crate) uv: [i32; 2],
    /// Its normal group, numbered by [orientation class](crate::mesh::orientation_class).
    pub(crate) group: u32,
}

/// The texture projections of a region.
pub(crate) struct UvMaps {
    sides: [[Side; SIDES]; MATERIALS],
    /// By orientation class: the axis of the last projection.
    last: [usize; ORIENTATION_CLASSES as usize],
    /// By place (corners of moved faces, of new faces with a known corner, and others): the recent errors of
    /// projections from the mean, of those from one corner, and of other predictions, as mean logarithms in quarter
    /// octaves × 16.
    errors: [[i32; 3]; PLACES],
}

/// The predictions for a corner.
#[derive(Clone, Copy)]
pub(crate) struct CornerLookup {
    place: usize,
    group: u32,
    /// Texture coordinates projected along each axis of its orientation class, from the side's mean and from one
    /// corner.
    by_axis: [[Option<[i32; 2]>; 2]; 3],
    /// The likely axis.
    likely: Option<usize>,
    /// The other prediction.
    other: [i32; 2],
}

impl Side {
    /// Extrapolates texture coordinates to `at`, with the least-squares gradient over all edges.
    fn project(&self, axis: usize, from: Origin, at: Vec3) -> Option<[i32; 2]> {
        let newest = self.newest?;
        let [x, y] = ACROSS[axis];
        let (origin, uv) = match from {
            Origin::Mean if self.corners > 0.0 => {
                (self.at.map(|sum| sum / self.corners), self.uv.map(|sum| sum / self.corners))
            }
            Origin::Mean | Origin::Newest => ([newest.at[x], newest.at[y]], newest.uv.map(f64::from)),
            Origin::This(corner) => ([corner.at[x], corner.at[y]], corner.uv.map(f64::from)),
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

/// Largest difference of either coordinate.
fn apart(a: [i32; 2], b: [i32; 2]) -> u32 {
    a[0].abs_diff(b[0]).saturating_add(a[1].abs_diff(b[1]))
}

/// The side of an orientation class with one axis; else `None`.
fn only_side(group: u32) -> Option<(usize, usize)> {
    let ways = signs_of(group);
    let mut axes = (0..3).filter(|&axis| ways[axis] != 0);
    let axis = axes.next()?;
    axes.next().is_none().then(|| (axis, side(axis, ways[axis])))
}

fn side(axis: usize, way: i8) -> usize {
    axis * 2 + usize::from(way < 0)
}

impl Default for UvMaps {
    fn default() -> Self {
        Self { sides: Default::default(), last: [0; ORIENTATION_CLASSES as usize], errors: [[0; 3]; PLACES] }
    }
}

impl UvMaps {
    /// Adds a face.
    pub(crate) fn add_face(&mut self, material: u16, corners: [Anchor; 3]) {
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
            let weight = if copies == [false; 2] { 1.0 } else { COPY_EDGE_FACTOR };
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

    /// Predicts texture coordinates at `at` for a corner of a normal group on a face of a material, extrapolating
    /// from `from` or, if that is `None` or has another orientation, from the most recent corner on the side. A class
    /// with several axes is projected along the axis of `from`, else along that of the class's last projection.
    pub(crate) fn predict(
        &self,
        place: usize,
        (group, material): (u32, u16),
        from: Option<Anchor>,
        at: Vec3,
        other: [i32; 2],
    ) -> CornerLookup {
        let sides = &self.sides[usize::from(material) % MATERIALS];
        let ways = signs_of(group);
        let from = from.filter(|from| from.group == group % ORIENTATION_CLASSES);
        let mut likely = None;
        let mut least = NEAR;
        let by_axis = [0, 1, 2].map(|axis| {
            if ways[axis] == 0 {
                return [None; 2];
            }
            let side = &sides[side(axis, ways[axis])];
            let Some(from) = from else {
                return [Origin::Mean, Origin::Newest].map(|from| side.project(axis, from, at));
            };
            let missed = [Origin::Mean, Origin::Newest]
                .into_iter()
                .filter_map(|of| Some(apart(side.project(axis, of, from.at)?, from.uv)))
                .min();
            if let Some(missed) = missed.filter(|&missed| missed < least) {
                (likely, least) = (Some(axis), missed);
            }
            [Origin::Mean, Origin::This(from)].map(|from| side.project(axis, from, at))
        });
        if from.is_none() {
            let last = self.last[(group % ORIENTATION_CLASSES) as usize];
            let there = |axis: &usize| by_axis[*axis][0].is_some();
            likely = Some(last).filter(there).or_else(|| (0..3).find(there));
        }
        CornerLookup { place, group, by_axis, likely, other }
    }

    /// The projected texture coordinates, or `None` if the other prediction has been more accurate.
    pub(crate) fn choose(&self, lookup: &CornerLookup) -> Option<[i32; 2]> {
        let [mean, corner, other] = self.errors[lookup.place];
        let by_axis = lookup.by_axis[lookup.likely?];
        (mean.min(corner) <= other).then(|| by_axis[usize::from(corner < mean)])?
    }

    /// Updates the errors with a corner's actual texture coordinates.
    pub(crate) fn update(&mut self, lookup: &CornerLookup, actual: [i32; 2]) {
        let CornerLookup { place, group, by_axis, likely, other } = *lookup;
        let missed = |uv: Option<[i32; 2]>| uv.map_or(u32::MAX, |uv| apart(uv, actual));
        let Some(axis) = (0..3).min_by_key(|&axis| by_axis[axis].map(missed).into_iter().min()) else {
            return;
        };
        if by_axis[axis] == [None; 2] {
            return;
        }
        self.last[(group % ORIENTATION_CLASSES) as usize] = axis;
        let [mean, corner] = by_axis[likely.unwrap_or(axis)].map(missed);
        for (errors, apart) in self.errors[place].iter_mut().zip([mean, corner, apart(other, actual)]) {
            *errors += (quarter_octaves(f64::from(apart) + 1.0) * 16 - *errors) / 16;
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

    /// A corner on a side with a projected texture, scaled by thirds of cells.
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
            maps.add_face(0, triangle(UP, at));
            maps.add_face(0, triangle(EAST, [at[2], at[0], at[1]]));
        }
        maps
    }

    #[test]
    fn unknown_materials_are_not_projected() {
        let maps = UvMaps::default();
        let lookup = maps.predict(2, (orientation_class(UP), 0), None, [5.0; 3], [7, 7]);
        assert_eq!(maps.choose(&lookup), None);
        // Another material may have another map.
        let lookup = seen().predict(2, (orientation_class(UP), 1), None, [5.0; 3], [7, 7]);
        assert_eq!(seen().choose(&lookup), None);
    }

    #[test]
    fn texture_coordinates_follow_from_the_faces_on_the_same_side() {
        let maps = seen();
        for at in [[600.0, 30.0, 4.0], [-250.0, 810.0, 90.0], [0.0, 0.0, 0.0]] {
            for normal in [UP, EAST] {
                let lookup = maps.predict(2, (orientation_class(normal), 0), None, at, [0, 0]);
                let (uv, meant) = (maps.choose(&lookup).unwrap(), corner(normal, at).uv);
                assert!(apart(uv, meant) <= 2, "{uv:?} instead of {meant:?}");
            }
        }
    }

    #[test]
    fn a_two_axis_class_uses_its_neighbours_or_the_last_axis() {
        let mut maps = seen();
        let between = orientation_class([1.0, 0.0, 1.0]);
        let at = [300.0, 200.0, 40.0];
        for normal in [UP, EAST] {
            let neighbour = Anchor { group: between, ..corner(normal, [280.0, 250.0, 20.0]) };
            let lookup = maps.predict(1, (between, 0), Some(neighbour), at, [0, 0]);
            let meant = corner(normal, at).uv;
            assert!(apart(maps.choose(&lookup).unwrap(), meant) <= 2);
            maps.update(&lookup, meant);
            let lookup = maps.predict(1, (between, 0), None, at, [0, 0]);
            assert!(apart(maps.choose(&lookup).unwrap(), meant) <= 2);
        }
        // If a neighbour was not projected, this corner is not predicted as projected either.
        let strange = Anchor { at, uv: [1, 1], group: between };
        assert_eq!(maps.choose(&maps.predict(1, (between, 0), Some(strange), at, [0, 0])), None);
    }

    #[test]
    fn inaccurate_projections_are_abandoned() {
        let mut maps = seen();
        let at = [300.0, 200.0, 40.0];
        for _ in 0..30 {
            let lookup = maps.predict(2, (orientation_class(UP), 0), None, at, [3000, 3000]);
            maps.update(&lookup, [3000, 3001]);
        }
        assert_eq!(maps.choose(&maps.predict(2, (orientation_class(UP), 0), None, at, [3000, 3000])), None);
        assert!(
            maps.choose(&maps.predict(0, (orientation_class(UP), 0), None, at, [3000, 3000])).is_some(),
            "another place"
        );
    }
}
