//! Octahedral maps of directions (Meyer et al. 2010).

use glam::{DVec2, DVec3};

/// An octahedral map: directions on an octahedron unfolded into a square, z in the centre, with a border of one texel
/// that repeats the opposite edges.
#[derive(Clone, Debug)]
pub(crate) struct Octahedral {
    /// Texels along a side, without the border.
    side: usize,
    /// Rows of `side + 2`.
    texels: Vec<DVec3>,
}

impl Octahedral {
    #[cfg(test)]
    /// Samples a function at texel centres; `side` is even.
    pub(crate) fn new(side: usize, value: impl Fn(DVec3) -> DVec3) -> Self {
        Self::of_texels(side, |x, y| value(Self::direction(side, x, y)))
    }

    /// Samples a function that is symmetric in y, half as often.
    pub(crate) fn mirrored(side: usize, value: impl Fn(DVec3) -> DVec3) -> Self {
        let half: Vec<DVec3> =
            (0..side * side / 2).map(|i| value(Self::direction(side, i % side, i / side))).collect();
        Self::of_texels(side, |x, y| half[y.min(side - 1 - y) * side + x])
    }

    fn of_texels(side: usize, value: impl Fn(usize, usize) -> DVec3) -> Self {
        let row = side + 2;
        let mut texels = vec![DVec3::ZERO; row * row];
        for i in 0..side * side {
            texels[(i / side + 1) * row + i % side + 1] = value(i % side, i / side);
        }
        // Beyond an edge lies the same edge reversed; beyond a corner the opposite corner.
        let last = side + 1;
        for i in 1..=side {
            texels[i] = texels[row + last - i];
            texels[last * row + i] = texels[side * row + last - i];
            texels[i * row] = texels[(last - i) * row + 1];
            texels[i * row + last] = texels[(last - i) * row + side];
        }
        for (corner, opposite) in [([0, 0], [side, side]), ([last, 0], [1, side])] {
            texels[corner[1] * row + corner[0]] = texels[opposite[1] * row + opposite[0]];
            let (corner, opposite) = (corner.map(|c| last - c), opposite.map(|c| last - c));
            texels[corner[1] * row + corner[0]] = texels[opposite[1] * row + opposite[0]];
        }
        Self { side, texels }
    }

    /// Halves the side; each texel is the mean of four.
    pub(crate) fn halved(&self) -> Self {
        let row = self.side + 2;
        Self::of_texels(self.side / 2, |x, y| {
            let first = (2 * y + 1) * row + 2 * x + 1;
            [0, 1, row, row + 1].iter().map(|i| self.texels[first + i]).sum::<DVec3>() * 0.25
        })
    }

    /// Scales all texels, clamped to `most`.
    pub(crate) fn scale(&mut self, factor: f64, most: f64) {
        self.texels.iter_mut().for_each(|texel| *texel = (*texel * factor).min(DVec3::splat(most)));
    }

    /// Scales the channels.
    pub(crate) fn tint(&mut self, factors: DVec3) {
        self.texels.iter_mut().for_each(|texel| *texel *= factors);
    }

    /// Texels along a side, borders included.
    pub(crate) fn bordered_side(&self) -> usize {
        self.side + 2
    }

    /// Rows of texels, borders included.
    pub(crate) fn texels(&self) -> &[DVec3] {
        &self.texels
    }

    /// Direction of a texel's middle.
    fn direction(side: usize, x: usize, y: usize) -> DVec3 {
        let place = DVec2::new(x as f64 + 0.5, y as f64 + 0.5) * (2.0 / side as f64) - 1.0;
        unfolded(place).normalize()
    }

    /// Direction, value and solid angle (steradians) of each texel.
    pub(crate) fn parts(&self) -> impl Iterator<Item = (DVec3, DVec3, f64)> {
        let (side, row) = (self.side, self.side + 2);
        (0..side * side).map(move |i| {
            let (x, y) = (i % side, i / side);
            let place = DVec2::new(x as f64 + 0.5, y as f64 + 0.5) * (2.0 / side as f64) - 1.0;
            let on = unfolded(place);
            let area = (2.0 / side as f64).powi(2);
            (on.normalize(), self.texels[(y + 1) * row + x + 1], area / on.length().powi(3))
        })
    }

    /// Bilinear lookup by direction.
    pub(crate) fn at(&self, direction: DVec3) -> DVec3 {
        let row = self.side + 2;
        let at = folded(direction) * 0.5 * self.side as f64 + (0.5 * self.side as f64 + 0.5);
        let low = at.floor().clamp(DVec2::ZERO, DVec2::splat(self.side as f64));
        let part = at - low;
        let first = low.y as usize * row + low.x as usize;
        let above = self.texels[first].lerp(self.texels[first + 1], part.x);
        above.lerp(self.texels[first + row].lerp(self.texels[first + row + 1], part.x), part.y)
    }
}

/// Maps a direction to the square −1..1.
fn folded(direction: DVec3) -> DVec2 {
    let place = direction.truncate() / (direction.x.abs() + direction.y.abs() + direction.z.abs());
    if direction.z >= 0.0 { place } else { turned(place) }
}

/// Maps the square to the octahedron.
fn unfolded(place: DVec2) -> DVec3 {
    let z = 1.0 - place.x.abs() - place.y.abs();
    if z >= 0.0 { place.extend(z) } else { turned(place).extend(z) }
}

fn turned(place: DVec2) -> DVec2 {
    let sign = |v: f64| if v >= 0.0 { 1.0 } else { -1.0 };
    DVec2::new((1.0 - place.y.abs()) * sign(place.x), (1.0 - place.x.abs()) * sign(place.y))
}

#[cfg(test)]
pub(super) mod tests {
    use std::f64::consts::PI;

    use super::*;

    /// Light from a few directions, with a step at the horizon.
    fn light(direction: DVec3) -> DVec3 {
        let glow = direction.dot(DVec3::new(0.6, 0.0, 0.8)).max(0.0).powi(20);
        let above = if direction.z > 0.0 { DVec3::new(0.2, 0.4, 0.8) } else { DVec3::splat(0.1) };
        above + DVec3::new(4.0, 3.0, 2.0) * glow
    }

    /// Directions spread evenly over the sphere.
    pub(in crate::passes::sky) fn directions(count: u32) -> impl Iterator<Item = DVec3> {
        (0..count).map(move |i| {
            let z = 1.0 - (f64::from(i) + 0.5) * 2.0 / f64::from(count);
            let (sine, cosine) = (f64::from(i) * 2.399_963).sin_cos();
            let across = (1.0 - z * z).sqrt();
            DVec3::new(across * cosine, across * sine, z)
        })
    }

    #[test]
    fn a_map_gives_back_what_went_in_across_its_edges_too() {
        let smooth = |d: DVec3| DVec3::new(1.0 + d.x, 1.0 + d.y * d.z, 1.0 + d.z);
        let map = Octahedral::new(64, smooth);
        for d in directions(5000) {
            assert!((map.at(d) - smooth(d)).length() < 3e-2, "{d}");
        }
        let angles: f64 = map.parts().map(|part| part.2).sum();
        assert!((angles / (4.0 * PI) - 1.0).abs() < 1e-3, "{angles}");
        assert!((map.halved().at(DVec3::NEG_Z) - smooth(DVec3::NEG_Z)).length() < 0.01);
    }

    #[test]
    fn mirrored_maps_are_those_of_all_texels() {
        let (whole, half) = (Octahedral::new(16, light), Octahedral::mirrored(16, light));
        assert!(whole.texels().iter().zip(half.texels()).all(|(a, b)| (*a - *b).length() < 1e-12));
    }
}
