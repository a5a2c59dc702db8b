//! A small modelling language for statues: adds parts to a [`Figure`] one after another.

use super::maths::{catmull_rom, cos_turns, mix, sin_turns, unit_or};
use super::sdf::{Along, Figure, Part, Shape};
use super::skin::Skin;
use glam::{DMat3, DVec3};

/// Shorthand for a point in metres: x to the figure's left, y up, z forwards.
pub(super) const fn at(x: f64, y: f64, z: f64) -> DVec3 {
    DVec3::new(x, y, z)
}

/// Adds parts with the current skin and blend radius.
pub(super) struct Sculptor {
    figure: Figure,
    skin: Skin,
    blend: f64,
    mirrored: bool,
}

impl Sculptor {
    pub(super) fn new(seed: u64) -> Self {
        Self { figure: Figure { parts: Vec::new(), seed }, skin: Skin::Plain, blend: 0.05, mirrored: false }
    }

    /// Skin and blend radius of the parts that follow.
    pub(super) fn with(&mut self, skin: Skin, blend: f64) -> &mut Self {
        self.skin = skin;
        self.blend = blend;
        self
    }

    /// Whether the parts that follow are added twice, mirrored at x = 0.
    pub(super) fn pairs(&mut self, on: bool) -> &mut Self {
        self.mirrored = on;
        self
    }

    fn add(&mut self, shape: Shape, cut: bool) -> &mut Self {
        let (skin, blend) = (if cut { Skin::Plain } else { self.skin }, self.blend);
        if self.mirrored {
            let other = mirror(&shape);
            self.figure.parts.push(Part { shape: other, blend, cut, skin, along: None });
        }
        self.figure.parts.push(Part { shape, blend, cut, skin, along: None });
        self
    }

    /// A round cone.
    pub(super) fn limb(&mut self, a: DVec3, radius_a: f64, b: DVec3, radius_b: f64) -> &mut Self {
        self.add(Shape::RoundCone { a, b, radius_a, radius_b }, false)
    }

    /// Round cones through points with radii.
    pub(super) fn chain(&mut self, points: &[(DVec3, f64)]) -> &mut Self {
        for pair in points.windows(2) {
            self.limb(pair[0].0, pair[0].1, pair[1].0, pair[1].1);
        }
        self
    }

    pub(super) fn ball(&mut self, centre: DVec3, radius: f64) -> &mut Self {
        self.limb(centre, radius, centre, radius)
    }

    /// An ellipsoid, pitched forwards by `pitch` turns (its top leans towards +z).
    pub(super) fn egg(&mut self, centre: DVec3, radii: DVec3, pitch: f64) -> &mut Self {
        self.add(Shape::Ellipsoid { centre, radii, axes: turned(pitch, 0.0) }, false)
    }

    /// A rounded box, pitched forwards and rolled to the left.
    pub(super) fn block(&mut self, centre: DVec3, half: DVec3, round: f64, turns: [f64; 2]) -> &mut Self {
        self.add(Shape::Block { centre, half, axes: turned(turns[0], turns[1]), round }, false)
    }

    pub(super) fn cut_egg(&mut self, centre: DVec3, radii: DVec3, pitch: f64) -> &mut Self {
        self.add(Shape::Ellipsoid { centre, radii, axes: turned(pitch, 0.0) }, true)
    }

    pub(super) fn cut_limb(&mut self, a: DVec3, radius_a: f64, b: DVec3, radius_b: f64) -> &mut Self {
        self.add(Shape::RoundCone { a, b, radius_a, radius_b }, true)
    }

    /// A scaled body along the spline through `points`, its radius interpolated from `radii`, in
    /// `steps` pieces. Returns its spine: centre, radius, and direction of the back at each step.
    pub(super) fn serpent(
        &mut self,
        points: &[DVec3],
        radii: &[f64],
        steps: usize,
        columns: f64,
    ) -> Vec<(DVec3, f64, DVec3)> {
        let radius = |t: f64| {
            let x = t * (radii.len() - 1) as f64;
            let i = (x.floor() as usize).min(radii.len() - 2);
            mix(radii[i], radii[i + 1], x - i as f64)
        };
        let mut spine = Vec::with_capacity(steps + 1);
        let mut back = DVec3::Y;
        for i in 0..=steps {
            let t = i as f64 / steps as f64;
            let here = catmull_rom(points, t);
            let tangent = unit_or(catmull_rom(points, t + 1e-3) - catmull_rom(points, t - 1e-3), DVec3::Z);
            // The direction of the back follows the curve and is turned slightly upwards, so that the belly stays
            // below.
            let wish = back + DVec3::Y * 0.12;
            back = unit_or(wish - tangent * tangent.dot(wish), back);
            spine.push((here, radius(t), back));
        }
        let mut length = 0.0;
        for pair in spine.windows(2) {
            let [(a, radius_a, back), (b, radius_b, _)] = [pair[0], pair[1]];
            let middle = 0.5 * (radius_a + radius_b);
            let to = length + a.distance(b) / middle;
            let axis = unit_or(b - a, DVec3::Z);
            let back = unit_or(back - axis * axis.dot(back), DVec3::Y);
            self.figure.parts.push(Part {
                shape: Shape::RoundCone { a, b, radius_a, radius_b },
                blend: 0.004,
                cut: false,
                skin: Skin::Scales { columns, radius: middle },
                along: Some(Along { from: length, to, back }),
            });
            length = to;
        }
        spine
    }

    pub(super) fn finish(self) -> Figure {
        self.figure
    }
}

/// World to own axes for a shape pitched about x, then rolled about z.
fn turned(pitch: f64, roll: f64) -> DMat3 {
    let (s, c) = (sin_turns(pitch), cos_turns(pitch));
    let pitch = DMat3::from_cols(at(1.0, 0.0, 0.0), at(0.0, c, s), at(0.0, -s, c));
    let (s, c) = (sin_turns(roll), cos_turns(roll));
    let roll = DMat3::from_cols(at(c, s, 0.0), at(-s, c, 0.0), at(0.0, 0.0, 1.0));
    (roll * pitch).transpose()
}

fn mirror(shape: &Shape) -> Shape {
    let flip = at(-1.0, 1.0, 1.0);
    let flip_axes = |axes: &DMat3| DMat3::from_diagonal(flip) * *axes * DMat3::from_diagonal(flip);
    match shape {
        Shape::RoundCone { a, b, radius_a, radius_b } => {
            Shape::RoundCone { a: *a * flip, b: *b * flip, radius_a: *radius_a, radius_b: *radius_b }
        }
        Shape::Ellipsoid { centre, radii, axes } => {
            Shape::Ellipsoid { centre: *centre * flip, radii: *radii, axes: flip_axes(axes) }
        }
        Shape::Block { centre, half, axes, round } => {
            Shape::Block { centre: *centre * flip, half: *half, axes: flip_axes(axes), round: *round }
        }
    }
}
