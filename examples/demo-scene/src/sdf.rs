//! Solids as signed distance fields: a list of rounded shapes joined by smooth unions and cuts.
//!
//! The smooth minimum is the quadratic one (Quilez, "smooth minimum"): it changes nothing where its
//! operands differ by more than the blend radius, so parts far from a point can be left out of the
//! sum when evaluating there ([`Figure::near`]).

use super::maths::{atan2_turns, unit_or};
use super::skin::Skin;
use glam::{DMat3, DVec3};

/// Shape of a part.
#[derive(Clone, Debug)]
pub(super) enum Shape {
    /// Two spheres and the cone tangent to both.
    RoundCone { a: DVec3, b: DVec3, radius_a: f64, radius_b: f64 },
    /// An ellipsoid; `axes` rotates world directions into its own.
    Ellipsoid { centre: DVec3, radii: DVec3, axes: DMat3 },
    /// A box with its edges rounded by `round`; `half` is the half size before rounding inwards.
    Block { centre: DVec3, half: DVec3, axes: DMat3, round: f64 },
}

/// Position of a part along a scaled body, for [`Skin::Scales`].
#[derive(Clone, Copy, Debug)]
pub(super) struct Along {
    /// Arc length over radius, summed from the tail, at both ends of the part.
    pub(super) from: f64,
    /// See `from`.
    pub(super) to: f64,
    /// Direction of the back, perpendicular to the part's axis.
    pub(super) back: DVec3,
}

/// One part of a figure.
#[derive(Clone, Debug)]
pub(super) struct Part {
    pub(super) shape: Shape,
    /// Blend radius with what came before, in metres.
    pub(super) blend: f64,
    /// Whether the part is cut away instead of added.
    pub(super) cut: bool,
    pub(super) skin: Skin,
    pub(super) along: Option<Along>,
}

impl Shape {
    /// Distance from `p`, and the position of the nearest point along a round cone's axis (0 to 1).
    fn distance(&self, p: DVec3) -> (f64, f64) {
        match self {
            Shape::RoundCone { a, b, radius_a, radius_b } => {
                let axis = *b - *a;
                let length2 = axis.length_squared();
                let t = if length2 > 0.0 { ((p - *a).dot(axis) / length2).clamp(0.0, 1.0) } else { 0.0 };
                ((p - *a - axis * t).length() - (radius_a + (radius_b - radius_a) * t), t)
            }
            Shape::Ellipsoid { centre, radii, axes } => {
                // Quilez's bound: exact on the surface, first-order right near it.
                let q = *axes * (p - *centre);
                let k0 = (q / *radii).length();
                let k1 = (q / (*radii * *radii)).length();
                if k1 < 1e-12 { (-radii.min_element(), 0.0) } else { (k0 * (k0 - 1.0) / k1, 0.0) }
            }
            Shape::Block { centre, half, axes, round } => {
                let q = (*axes * (p - *centre)).abs() - (*half - DVec3::splat(*round));
                (q.max(DVec3::ZERO).length() + q.max_element().min(0.0) - round, 0.0)
            }
        }
    }

    /// Corners of a box that contains the shape.
    fn bounds(&self) -> (DVec3, DVec3) {
        match self {
            Shape::RoundCone { a, b, radius_a, radius_b } => {
                let r = DVec3::splat(radius_a.max(*radius_b));
                (a.min(*b) - r, a.max(*b) + r)
            }
            Shape::Ellipsoid { centre, radii, .. } => {
                let r = DVec3::splat(radii.max_element());
                (*centre - r, *centre + r)
            }
            Shape::Block { centre, half, .. } => {
                let r = DVec3::splat(half.length());
                (*centre - r, *centre + r)
            }
        }
    }
}

impl Part {
    /// Distance including the skin's relief, which is computed only near the surface.
    fn distance(&self, p: DVec3, seed: u64) -> f64 {
        let (distance, t) = self.shape.distance(p);
        let reach = self.skin.height();
        if reach == 0.0 || distance > self.blend + 3.0 * reach {
            return distance;
        }
        let along = self.along.and_then(|along| match &self.shape {
            Shape::RoundCone { a, b, .. } => {
                let axis = unit_or(*b - *a, DVec3::Y);
                let side = axis.cross(along.back);
                let out = p - *a;
                let turns = atan2_turns(out.dot(side), out.dot(along.back));
                Some((along.from + (along.to - along.from) * t, turns))
            }
            _ => None,
        });
        distance - self.skin.relief(p, along, seed)
    }
}

/// A solid: its parts in the order in which they are joined.
#[derive(Clone, Debug, Default)]
pub(super) struct Figure {
    pub(super) parts: Vec<Part>,
    pub(super) seed: u64,
}

fn smooth_min(a: f64, b: f64, blend: f64) -> f64 {
    if blend <= 0.0 {
        return a.min(b);
    }
    let h = (blend - (a - b).abs()).max(0.0) / blend;
    a.min(b) - h * h * blend * 0.25
}

impl Figure {
    /// Signed distance at `p` over the given parts, negative inside.
    pub(super) fn distance(&self, p: DVec3, parts: &[u32]) -> f64 {
        let mut sum = 1e3;
        for &i in parts {
            let part = &self.parts[i as usize];
            let d = part.distance(p, self.seed);
            sum = if part.cut { -smooth_min(-sum, d, part.blend) } else { smooth_min(sum, d, part.blend) };
        }
        sum
    }

    /// All parts.
    pub(super) fn all(&self) -> Vec<u32> {
        (0..self.parts.len() as u32).collect()
    }

    /// The parts that affect distances within `radius` of `centre`, or nothing if no surface is there.
    ///
    /// The margins are generous (four blend radii) because several blends may follow each other.
    pub(super) fn near(&self, centre: DVec3, radius: f64) -> Option<Vec<u32>> {
        let distances: Vec<f64> = self.parts.iter().map(|part| part.shape.distance(centre).0).collect();
        let mut least = f64::MAX;
        let mut margin: f64 = 0.0;
        for (part, d) in self.parts.iter().zip(&distances) {
            margin = margin.max(part.blend + part.skin.height());
            if !part.cut {
                least = least.min(*d);
            }
        }
        if least > radius * 1.2 + margin * 2.0 {
            return None;
        }
        let limit = least.max(0.0) + radius * 2.4 + margin * 4.0;
        let parts: Vec<u32> =
            (0..self.parts.len() as u32).filter(|&i| distances[i as usize] <= limit).collect();
        // Deep inside and far from every cut there is no surface either.
        let cut_near = parts
            .iter()
            .any(|&i| self.parts[i as usize].cut && distances[i as usize] < radius * 1.2 + margin * 2.0);
        if !cut_near && least < -(radius * 1.6 + margin * 2.0) {
            return None;
        }
        Some(parts)
    }

    /// Corners of a box that holds every added part, with room for its skin.
    pub(super) fn bounds(&self) -> (DVec3, DVec3) {
        let mut low = DVec3::MAX;
        let mut high = DVec3::MIN;
        for part in self.parts.iter().filter(|part| !part.cut) {
            let (a, b) = part.shape.bounds();
            let room = DVec3::splat(part.skin.height() + part.blend * 0.25 + 0.01);
            low = low.min(a - room);
            high = high.max(b + room);
        }
        (low, high)
    }
}
