//! PN triangles: `pn_patch.wgsl`, `edge_step` of `pn_list.wgsl`, and where `pn_vertex.wgsl` puts the vertices of a grid.

use glam::DVec3;

/// Steps of grids: 1, 2, 4, … 64 pieces to an edge.
pub const STEPS: u32 = 7;

/// A corner of a patch.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Corner {
    /// Position.
    pub position: DVec3,
    /// Unit length, or zero.
    pub normal: DVec3,
    /// Whether edges bend there: no crease runs through it.
    pub bends: bool,
}

/// Offset of the control point next to `from` from the edge to `to`.
#[must_use]
pub fn bow(from: &Corner, to: DVec3) -> DVec3 {
    if from.bends { from.normal * ((to - from.position).dot(from.normal) / -3.0) } else { DVec3::ZERO }
}

/// A point of an edge's curve, so far from `a` to `b`.
#[must_use]
pub fn on_edge(a: &Corner, b: &Corner, t: f64) -> DVec3 {
    let s = 1.0 - t;
    let off = bow(a, b.position) * s + bow(b, a.position) * t;
    a.position * s + b.position * t + off * (3.0 * s * t)
}

/// A triangle as a cubic patch.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Patch {
    /// Its corners, anticlockwise from outside.
    pub corners: [Corner; 3],
}

impl Patch {
    /// Ends of the edges AB, BC and CA.
    fn edges(&self) -> [[Corner; 2]; 3] {
        let [a, b, c] = self.corners;
        [[a, b], [b, c], [c, a]]
    }

    /// The place at barycentric coordinates.
    #[must_use]
    pub fn position(&self, w: [f64; 3]) -> DVec3 {
        let flat: DVec3 = self.corners.iter().zip(w).map(|(corner, w)| corner.position * w).sum();
        let (mut off, mut middle) = (DVec3::ZERO, DVec3::ZERO);
        for (k, [from, to]) in self.edges().into_iter().enumerate() {
            let (u, v) = (w[k], w[(k + 1) % 3]);
            let bows = [bow(&from, to.position), bow(&to, from.position)];
            off += (bows[0] * u + bows[1] * v) * (3.0 * u * v);
            middle += bows[0] + bows[1];
        }
        flat + off + middle * (1.5 * w[0] * w[1] * w[2])
    }

    /// The normal there, not normalised.
    #[must_use]
    pub fn normal(&self, w: [f64; 3]) -> DVec3 {
        let mut normal: DVec3 = self.corners.iter().zip(w).map(|(corner, w)| corner.normal * (w * w)).sum();
        for (k, [from, to]) in self.edges().into_iter().enumerate() {
            let (along, both) = (to.position - from.position, from.normal + to.normal);
            let square = along.length_squared();
            let turned = if square > 0.0 { both - along * (2.0 * along.dot(both) / square) } else { both };
            normal += turned.normalize_or_zero() * (w[k] * w[(k + 1) % 3]);
        }
        normal
    }

    /// Tessellation levels of its edges for an eye at `eye`, `scale_px` pixels per unit length at distance 1 and an
    /// error in pixels.
    #[must_use]
    pub fn steps(&self, eye: DVec3, scale_px: f64, error_px: f64, most: u32) -> [u32; 3] {
        self.edges().map(|[a, b]| edge_step(&a, &b, (eye, scale_px), error_px, most))
    }

    /// Barycentric coordinates of the grid's vertices, and its triangles, for the steps of the edges.
    #[must_use]
    pub fn grid(steps: [u32; 3]) -> (Vec<[f64; 3]>, Vec<[usize; 3]>) {
        let step = steps.into_iter().max().unwrap_or(0);
        let pieces = 1_u32 << step;
        let (mut points, mut triangles) = (Vec::new(), Vec::new());
        let mut first = Vec::new();
        for c in 0..=pieces {
            first.push(points.len());
            for b in 0..=pieces - c {
                let mut w = [pieces - b - c, b, c];
                // On the first edge that it lies on, nearest to one of that edge's own points.
                if let Some(k) = [0, 1, 2].into_iter().find(|k| w[(k + 2) % 3] == 0) {
                    let width = 1 << (step - steps[k]);
                    let along = (w[(k + 1) % 3] + width / 2) / width * width;
                    w[(k + 1) % 3] = along;
                    w[k] = pieces - along;
                }
                points.push(w.map(|x| f64::from(x) / f64::from(pieces)));
            }
        }
        let at = |b: u32, c: u32| first[c as usize] + b as usize;
        for c in 0..pieces {
            for b in 0..pieces - c {
                triangles.push([at(b, c), at(b + 1, c), at(b, c + 1)]);
                if b + c + 1 < pieces {
                    triangles.push([at(b + 1, c), at(b + 1, c + 1), at(b, c + 1)]);
                }
            }
        }
        (points, triangles)
    }
}

/// The tessellation level of an edge: the least whose chords are within the error everywhere, at the nearer end's
/// distance, clamped to `most`.
#[must_use]
pub fn edge_step(a: &Corner, b: &Corner, (eye, scale_px): (DVec3, f64), error_px: f64, most: u32) -> u32 {
    let (o, p) = (bow(a, b.position), bow(b, a.position));
    // The ends of the second derivative, which is linear.
    let bend = 6.0 * (p - 2.0 * o).length().max((o - 2.0 * p).length());
    let distance = a.position.distance(eye).min(b.position.distance(eye));
    let allowed = 8.0 * error_px * distance / scale_px;
    (0..most).find(|step| bend <= allowed * f64::from(1_u32 << (2 * step))).unwrap_or(most)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn corner(position: [f64; 3], normal: [f64; 3]) -> Corner {
        Corner { position: position.into(), normal: DVec3::from(normal).normalize_or_zero(), bends: true }
    }

    /// An eighth of the sphere.
    fn eighth() -> Patch {
        let axes = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
        Patch { corners: axes.map(|axis| corner(axis, axis)) }
    }

    #[test]
    fn control_points_match_the_paper() {
        let patch = eighth();
        let [a, b, c] = patch.corners;
        // Equations 3 and the two for b111, as the paper has them.
        let near = |p: Corner, q: Corner| {
            let w = (q.position - p.position).dot(p.normal);
            (2.0 * p.position + q.position - w * p.normal) / 3.0
        };
        let six = [near(a, b), near(b, a), near(b, c), near(c, b), near(c, a), near(a, c)];
        let e = six.iter().sum::<DVec3>() / 6.0;
        let v = (a.position + b.position + c.position) / 3.0;
        let b111 = e + (e - v) / 2.0;
        for [u, v] in [[0.2, 0.3], [0.6, 0.1], [1.0 / 3.0, 1.0 / 3.0]] {
            let w: f64 = 1.0 - u - v;
            let bezier = a.position * w.powi(3)
                + b.position * f64::powi(u, 3)
                + c.position * f64::powi(v, 3)
                + 3.0 * (six[0] * w * w * u + six[1] * w * u * u)
                + 3.0 * (six[2] * u * u * v + six[3] * u * v * v)
                + 3.0 * (six[4] * v * v * w + six[5] * v * w * w)
                + 6.0 * b111 * w * u * v;
            assert!(bezier.distance(patch.position([w, u, v])) < 1e-12);
        }
    }

    #[test]
    fn a_patch_is_near_the_sphere_that_its_corners_are_of() {
        // Corners 34° apart.
        let corners = [[2.0, 1.0, 1.0], [1.0, 2.0, 1.0], [1.0, 1.0, 2.0]];
        let patch = Patch { corners: corners.map(|p| corner(DVec3::from(p).normalize().to_array(), p)) };
        let (points, _) = Patch::grid([5; 3]);
        let off = points.iter().map(|w| (patch.position(*w).length() - 1.0).abs()).fold(0.0, f64::max);
        // The flat triangle is off by 0.057.
        assert!(off < 0.006, "{off}");
        let normals = points.iter().map(|w| patch.position(*w).normalize().dot(patch.normal(*w).normalize()));
        assert!(normals.fold(1.0, f64::min) > 0.99);
    }

    #[test]
    fn edges_of_patches_are_the_edges_alone() {
        let patch = eighth();
        let [a, b, _] = patch.corners;
        for t in [0.0, 0.25, 0.7, 1.0] {
            assert!(patch.position([1.0 - t, t, 0.0]).distance(on_edge(&a, &b, t)) < 1e-15);
        }
    }

    #[test]
    fn patches_without_bend_are_flat() {
        let mut patch = eighth();
        patch.corners.iter_mut().for_each(|corner| corner.bends = false);
        let [a, b, c] = patch.corners.map(|corner| corner.position);
        assert!(patch.position([0.5, 0.3, 0.2]).distance(a * 0.5 + b * 0.3 + c * 0.2) < 1e-15);
        assert_eq!(patch.steps(DVec3::ONE, 1e9, 0.01, 6), [0; 3]);
        // A plane with its own normals has one piece per edge too.
        let z = [0.0, 0.0, 1.0];
        let plane = Patch { corners: [[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]].map(|p| corner(p, z)) };
        assert_eq!(plane.steps(DVec3::ONE, 1e9, 0.01, 6), [0; 3]);
    }

    #[test]
    fn chords_are_as_near_to_the_curve_as_a_step_says() {
        let [a, b, _] = eighth().corners;
        let eye = DVec3::new(3.0, 2.0, 1.0);
        let mut steps = Vec::new();
        for error_px in [0.1, 1.0, 10.0] {
            let step = edge_step(&a, &b, (eye, 500.0), error_px, 6);
            let pieces = 1 << step;
            let px = 500.0 / a.position.distance(eye).min(b.position.distance(eye));
            let off = |piece: u32, t: f64| {
                let at = |t: f64| on_edge(&a, &b, (f64::from(piece) + t) / f64::from(pieces));
                at(t).distance(at(0.0).lerp(at(1.0), t)) * px
            };
            let most = (0..pieces)
                .flat_map(|k| (1..16).map(move |t| off(k, f64::from(t) / 16.0)))
                .fold(0.0, f64::max);
            assert!(most <= error_px, "{most} of {error_px} at step {step}");
            steps.push(step);
        }
        assert!(steps.is_sorted_by(|a, b| a > b), "{steps:?}");
        assert_eq!(edge_step(&a, &b, (eye, 1e9), 0.1, 6), 6, "at most that");
    }

    #[test]
    fn degenerate_patches_stay_finite() {
        let zero = corner([1.0, 2.0, 3.0], [0.0; 3]);
        let patch = Patch { corners: [zero; 3] };
        assert_eq!(patch.position([0.2, 0.3, 0.5]), zero.position);
        assert_eq!(patch.normal([0.2, 0.3, 0.5]), DVec3::ZERO);
        assert_eq!(patch.steps(zero.position, 1e9, 0.01, 6), [0; 3]);
    }

    #[test]
    fn both_triangles_of_an_edge_have_its_points_however_fine_the_rest_is() {
        for steps in [[0, 2, 3], [3, 0, 0], [1, 1, 1], [0, 0, 5], [0; 3]] {
            let (points, triangles) = Patch::grid(steps);
            for (k, step) in steps.into_iter().enumerate() {
                let on = points.iter().filter(|w| w[(k + 2) % 3] == 0.0);
                let mut along: Vec<f64> = on.map(|w| w[(k + 1) % 3]).collect();
                along.sort_by(f64::total_cmp);
                along.dedup();
                let pieces = 1 << step;
                let own: Vec<f64> = (0..=pieces).map(|i| f64::from(i) / f64::from(pieces)).collect();
                assert_eq!(along, own, "edge {k} of {steps:?}");
            }
            // No triangle is turned over, and together they cover the patch once.
            let area = |t: &[usize; 3]| {
                let [p, q, r] = t.map(|i| points[i]);
                (q[1] - p[1]) * (r[2] - p[2]) - (q[2] - p[2]) * (r[1] - p[1])
            };
            assert!(triangles.iter().all(|t| area(t) >= 0.0), "{steps:?}");
            assert!((triangles.iter().map(area).sum::<f64>() - 1.0).abs() < 1e-12, "{steps:?}");
        }
    }
}
