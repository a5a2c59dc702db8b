//! Features as an author specifies them: points and stamps on the global grid of the finest level.

use super::error::TerrainError;
use super::mode::Mode;
use super::parameters::Parameters;
use super::points::{HeightOverride, HeightOverrides, MAX_PATCH_POINTS};
use super::stamp::{MAX_STAMPS, Shape, Stamp};
use std::collections::{BTreeMap, HashSet};

/// Most points in all feature sets of a terrain.
pub const MAX_POINTS: usize = 1 << 22;

/// A height, or a change of height, at one point of the finest grid.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Point {
    /// Global column.
    pub x: i64,
    /// Global row.
    pub y: i64,
    /// Height or change, in height units.
    pub height: i32,
}

/// Features of one mode.
///
/// A fixed point has exactly the given height; an additive point has its height without points plus the given change,
/// whatever other points there are. Other points follow by diamond-square interpolation of the changes around them in
/// coarser levels. The sets of a terrain apply in order: at a point in several sets, a later fixed height replaces
/// and a later change adds. Stamps apply before all points.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct FeatureSet {
    /// How the features change heights.
    pub mode: Mode,
    /// Single points, each at most once.
    pub points: Vec<Point>,
    /// Shapes.
    pub stamps: Vec<Shape>,
}

/// Features by patch: stamps in order, and the height overrides of each patch.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Features {
    /// All stamps, in order.
    pub stamps: Vec<Stamp>,
    /// The overrides of each patch that has any, by the patch's column and row. Border points are in both patches,
    /// corner points in all four.
    pub patches: BTreeMap<(i64, i64), HeightOverrides>,
}

impl Features {
    /// Distributes sets of features to patches.
    ///
    /// # Errors
    /// If a point occurs twice in one set or is outside the world, a stamp is invalid, or there are too many. The
    /// message names set and index.
    pub fn gather(parameters: &Parameters, sets: &[FeatureSet]) -> Result<Self, TerrainError> {
        parameters.check()?;
        let total: usize = sets.iter().map(|set| set.points.len()).sum();
        if total > MAX_POINTS {
            return Err(TerrainError::TooMany { what: "points", count: total, limit: MAX_POINTS });
        }
        let total: usize = sets.iter().map(|set| set.stamps.len()).sum();
        if total > MAX_STAMPS {
            return Err(TerrainError::TooMany { what: "stamps", count: total, limit: MAX_STAMPS });
        }
        let edge = 1_i64 << (parameters.extent_log2 + parameters.finest_level);
        let mut stamps = Vec::new();
        let mut merged: BTreeMap<(i64, i64), (Mode, i32)> = BTreeMap::new();
        for (set, features) in sets.iter().enumerate() {
            let bad = |what, index, why: String| TerrainError::BadFeature { set, what, index, why };
            for (index, shape) in features.stamps.iter().enumerate() {
                let stamp = Stamp { mode: features.mode, shape: shape.clone() };
                stamp.check().map_err(|e| bad("stamp", index, e.why))?;
                stamps.push(stamp);
            }
            let mut seen = HashSet::with_capacity(features.points.len());
            for (index, point) in features.points.iter().enumerate() {
                let Point { x, y, height } = *point;
                if !(-edge..=edge).contains(&x) || !(-edge..=edge).contains(&y) {
                    return Err(bad("point", index, format!("({x}, {y}) is outside the world, ±{edge}")));
                }
                if !seen.insert((x, y)) {
                    return Err(bad("point", index, format!("({x}, {y}) is given twice")));
                }
                match (features.mode, merged.get_mut(&(y, x))) {
                    // Changes the result of the earlier set.
                    (Mode::Additive, Some((_, before))) => *before = before.saturating_add(height),
                    (mode, _) => {
                        merged.insert((y, x), (mode, height));
                    }
                }
            }
        }
        Ok(Self { stamps, patches: by_patch(parameters, merged)? })
    }
}

/// Distributes points, sorted by row and column, to the patches whose closed square contains them.
fn by_patch(
    parameters: &Parameters,
    merged: BTreeMap<(i64, i64), (Mode, i32)>,
) -> Result<BTreeMap<(i64, i64), HeightOverrides>, TerrainError> {
    let n = parameters.finest_level;
    let patches = 1_i64 << parameters.extent_log2;
    let mut lists: BTreeMap<(i64, i64), Vec<HeightOverride>> = BTreeMap::new();
    for ((y, x), (mode, height)) in merged {
        for (column, local_x) in patches_of(x, n, patches) {
            for (row, local_y) in patches_of(y, n, patches) {
                let point = HeightOverride { x: local_x, y: local_y, mode, height };
                lists.entry((column, row)).or_default().push(point);
            }
        }
    }
    let whole = |(patch, list): (_, Vec<HeightOverride>)| {
        if list.len() > MAX_PATCH_POINTS {
            return Err(TerrainError::TooMany {
                what: "points of one patch",
                count: list.len(),
                limit: MAX_PATCH_POINTS,
            });
        }
        Ok((patch, HeightOverrides::new(n, list)?))
    };
    lists.into_iter().map(whole).collect()
}

/// The patches that a coordinate belongs to (two on a border), with the coordinate in each.
fn patches_of(at: i64, n: u8, patches: i64) -> impl Iterator<Item = (i64, u16)> {
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "the lowest bits, at most 12"
    )]
    let (patch, local) = (at >> n, (at & ((1 << n) - 1)) as u16);
    let before = (local == 0).then_some((patch - 1, 1_u16 << n));
    let inside = move |&(patch, _): &(i64, u16)| (-patches..patches).contains(&patch);
    std::iter::once((patch, local)).chain(before).filter(inside)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn gather(sets: &[FeatureSet]) -> Result<Features, TerrainError> {
        Features::gather(&Parameters { finest_level: 3, extent_log2: 2, ..Parameters::default() }, sets)
    }

    fn points(mode: Mode, points: &[(i64, i64, i32)]) -> FeatureSet {
        let points = points.iter().map(|&(x, y, height)| Point { x, y, height }).collect();
        FeatureSet { mode, points, stamps: Vec::new() }
    }

    #[test]
    fn points_belong_to_every_patch_whose_border_they_are_on() {
        let features = gather(&[points(Mode::Fixed, &[(8, 8, 1), (3, 0, 2), (32, -32, 3)])]).unwrap();
        let has: Vec<_> = features.patches.iter().map(|(&at, list)| (at, list.len())).collect();
        let expected = [((0, -1), 1), ((0, 0), 2), ((0, 1), 1), ((1, 0), 1), ((1, 1), 1), ((3, -4), 1)];
        assert_eq!(has, expected);
        assert_eq!(
            (features.patches[&(3, -4)].as_slice()[0].x, features.patches[&(3, -4)].as_slice()[0].y),
            (8, 0)
        );
    }

    #[test]
    fn sets_apply_in_order() {
        let at = |sets: &[FeatureSet]| {
            let point = gather(sets).unwrap().patches[&(0, 0)].as_slice()[0];
            (point.mode, point.height)
        };
        let fixed = |h| points(Mode::Fixed, &[(1, 1, h)]);
        let additive = |h| points(Mode::Additive, &[(1, 1, h)]);
        assert_eq!(at(&[fixed(5), additive(7)]), (Mode::Fixed, 12));
        assert_eq!(at(&[additive(5), additive(7)]), (Mode::Additive, 12));
        assert_eq!(at(&[additive(5), fixed(7)]), (Mode::Fixed, 7));
        assert_eq!(at(&[fixed(i32::MAX), additive(7)]), (Mode::Fixed, i32::MAX));
    }

    #[test]
    fn duplicates_outside_points_and_too_many_points_are_refused() {
        let refused =
            |list: &[(i64, i64, i32)]| gather(&[points(Mode::Fixed, list)]).unwrap_err().to_string();
        assert_eq!(
            refused(&[(1, 2, 3), (2, 1, 3), (1, 2, 4)]),
            "feature set 0: point 2: (1, 2) is given twice"
        );
        assert_eq!(
            refused(&[(1, 2, 3), (33, 1, 3)]),
            "feature set 0: point 1: (33, 1) is outside the world, ±32"
        );
        assert!(refused(&[(0, i64::MIN, 0)]).contains("outside the world"));
        let crowd = points(Mode::Fixed, &vec![(0, 0, 0); MAX_POINTS + 1]);
        assert_eq!(gather(&[crowd]).unwrap_err().to_string(), "4194305 points, at most 4194304 are possible");
    }
}
