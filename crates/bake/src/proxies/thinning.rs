//! Leaves out components of a root's sources that the start camera does not see, where another such component is near.
//!
//! Of a city nine components of ten are behind or within others, and simplification drops almost all of them, at its full
//! cost per face.

use std::collections::BTreeMap;

use glam::DVec3;
use lodestream_scene::placement::Placement;

use super::item_buffer::ItemBuffer;
use super::mesh::Piece;
use super::start::StartView;

/// Side of a cell in which one component stays, and the largest radius of those that are left out, as shares of the
/// allowed error. A point is then within twice the radius and a cell's diagonal of what stays: two thirds of the error.
const CELL: f64 = 1.0 / 4.0;
const RADIUS: f64 = 1.0 / 8.0;

/// Components of sources, in the order in which they are added.
pub(super) struct Thinning<'a> {
    view: &'a StartView,
    error_px: f64,
    buffer: ItemBuffer,
    /// Centres and radii of bounding boxes.
    spheres: Vec<(DVec3, f64)>,
}

/// Which components stay.
pub(super) struct Kept {
    /// By component.
    is_kept: Vec<bool>,
    /// Number of the next component.
    next: usize,
    /// By how much what was left out is away from what stays, in world units.
    pub(super) error: f64,
}

impl<'a> Thinning<'a> {
    pub(super) fn new(view: &'a StartView, error_px: f64) -> Self {
        Self { view, error_px, buffer: view.item_buffer(), spheres: Vec::new() }
    }

    /// Adds a source. Cost: filling each face once.
    pub(super) fn add(&mut self, piece: &Piece, placement: &Placement) {
        let (of_face, count) = piece.components();
        let first = self.spheres.len();
        let mut bounds = vec![(DVec3::INFINITY, DVec3::NEG_INFINITY); count];
        for (triangle, component) in piece.triangles(placement).zip(of_face) {
            self.buffer.draw(triangle, first as u32 + component);
            let (low, high) = &mut bounds[component as usize];
            for point in triangle {
                (*low, *high) = (low.min(point), high.max(point));
            }
        }
        self.spheres
            .extend(bounds.into_iter().map(|(low, high)| ((low + high) / 2.0, low.distance(high) / 2.0)));
    }

    /// Those that stay: all that are seen, and of the others the large ones and the largest of each cell.
    pub(super) fn kept(self) -> Kept {
        let Self { view, error_px, buffer, spheres } = self;
        let mut is_kept: Vec<bool> =
            buffer.counts(spheres.len()).into_iter().map(|shown| view.is_shown(error_px, shown)).collect();
        let mut error = 0.0_f64;
        // The largest of each cell, by the exponent of its size.
        let mut largest: BTreeMap<(i64, [i64; 3]), usize> = BTreeMap::new();
        for (at, &(center, radius)) in spheres.iter().enumerate() {
            if is_kept[at] {
                continue;
            }
            let allowed = binary_floor(view.allowed_hidden(error_px, center, radius));
            if radius > RADIUS * allowed {
                is_kept[at] = true;
                continue;
            }
            error = error.max(2.0 * RADIUS * allowed + 3.0_f64.sqrt() * CELL * allowed);
            let cell = (center / (CELL * allowed)).to_array().map(|x| x.floor() as i64);
            let other = largest.entry((allowed.to_bits() as i64, cell)).or_insert(at);
            if spheres[*other].1 < radius {
                *other = at;
            }
        }
        largest.into_values().for_each(|at| is_kept[at] = true);
        Kept { is_kept, next: 0, error }
    }
}

impl Kept {
    /// The components of the next source that stay. Sources come in the order in which they were added.
    pub(super) fn of(&mut self, piece: Piece) -> Piece {
        let (of_face, count) = piece.components();
        let first = self.next;
        self.next += count;
        piece.some(of_face.into_iter().map(|component| self.is_kept[first + component as usize]))
    }
}

/// The largest power of two that is at most `x`, which is positive.
fn binary_floor(x: f64) -> f64 {
    f64::from_bits(x.to_bits() & !((1 << 52) - 1))
}

#[cfg(test)]
mod tests {
    use lodestream_scene::description::Camera;

    use super::*;

    #[test]
    fn of_small_components_behind_a_wall_some_stay_and_the_error_tells_how_near() {
        let camera = Camera { eye: [0.0; 3], target: [0.0, 0.0, -1.0], up: [0.0, 1.0, 0.0], fov_y: 1.0 };
        let view = StartView::new(&camera, 100.0);
        let triangle = |[x, y, z]: [f64; 3], side: f64| {
            [[0.0, 0.0], [side, 0.0], [0.0, side]].map(|[dx, dy]| DVec3::new(x + dx, y + dy, z))
        };
        let wall = Piece::of_triangles(&[triangle([-40.0, -40.0, -10.0], 120.0)]);
        let small = |i: u32| triangle([i % 10, i / 10 % 10, 20 + i / 100].map(f64::from), 0.1);
        let small: Vec<[DVec3; 3]> =
            (0..1000).map(small).map(|t| t.map(|p| DVec3::new(p.x, p.y, -p.z))).collect();
        let seen = triangle([0.0, 0.0, -5.0], 0.5);
        let large = triangle([-20.0, 0.0, -40.0], 30.0);
        let behind = Piece::of_triangles(&[&small[..], &[seen, large]].concat());
        let place = Placement::default();
        let mut thinning = Thinning::new(&view, 12.0);
        thinning.add(&behind, &place);
        thinning.add(&wall, &place);
        let mut kept = thinning.kept();
        let left: Vec<[DVec3; 3]> = kept.of(behind).triangles(&place).collect();
        assert_eq!(kept.of(wall).triangles(&place).count(), 1, "the wall is seen");
        assert!(left.contains(&seen) && left.contains(&large));
        assert!((3..200).contains(&left.len()), "{}", left.len());
        for point in small.as_flattened() {
            let distance =
                left.as_flattened().iter().map(|at| at.distance(*point)).fold(f64::INFINITY, f64::min);
            assert!(distance <= kept.error, "{point}: {distance} of {}", kept.error);
        }
        assert!(kept.error < 32.0, "{}", kept.error);
    }

    #[test]
    fn a_power_of_two_below_is_exact() {
        assert_eq!([1.0, 1.99, 8.0, 0.3].map(binary_floor), [1.0, 1.0, 8.0, 0.25]);
    }
}
