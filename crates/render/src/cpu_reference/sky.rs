//! Light from the sky: `sky.wgsl`, and the integrals that it stands for.

use std::f64::consts::PI;

use glam::{DVec2, DVec3};

/// A map of directions on an octahedron unfolded into a square (Meyer et al. 2010), z in its middle, with a border of
/// one texel that repeats what lies across its edges.
#[derive(Clone, Debug)]
pub struct Octahedral {
    /// Texels along a side, without the border.
    side: usize,
    /// Rows of `side + 2`.
    texels: Vec<DVec3>,
}

impl Octahedral {
    /// Of values at the texels' middles; `side` is even.
    #[must_use]
    pub fn new(side: usize, value: impl Fn(DVec3) -> DVec3) -> Self {
        Self::of_texels(side, |x, y| value(Self::direction(side, x, y)))
    }

    /// The same where values of y and −y are equal, computed once.
    #[must_use]
    pub fn mirrored(side: usize, value: impl Fn(DVec3) -> DVec3) -> Self {
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
        // Across an edge lies the same edge, the other way round; across a corner the opposite one.
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

    /// Half as many texels along a side, each the mean of four.
    #[must_use]
    pub fn halved(&self) -> Self {
        let row = self.side + 2;
        Self::of_texels(self.side / 2, |x, y| {
            let first = (2 * y + 1) * row + 2 * x + 1;
            [0, 1, row, row + 1].iter().map(|i| self.texels[first + i]).sum::<DVec3>() * 0.25
        })
    }

    /// Multiplies all that is in it, up to a greatest value.
    pub fn scale(&mut self, factor: f64, most: f64) {
        self.texels.iter_mut().for_each(|texel| *texel = (*texel * factor).min(DVec3::splat(most)));
    }

    /// Multiplies each of red, green and blue.
    pub fn tint(&mut self, factors: DVec3) {
        self.texels.iter_mut().for_each(|texel| *texel *= factors);
    }

    /// Texels along a side, borders included.
    #[must_use]
    pub fn bordered_side(&self) -> usize {
        self.side + 2
    }

    /// Rows of texels, borders included.
    #[must_use]
    pub fn texels(&self) -> &[DVec3] {
        &self.texels
    }

    /// Direction of a texel's middle.
    fn direction(side: usize, x: usize, y: usize) -> DVec3 {
        let place = DVec2::new(x as f64 + 0.5, y as f64 + 0.5) * (2.0 / side as f64) - 1.0;
        unfolded(place).normalize()
    }

    /// Directions of texels, what is in them, and the solid angles that they cover, steradians.
    pub fn parts(&self) -> impl Iterator<Item = (DVec3, DVec3, f64)> {
        let (side, row) = (self.side, self.side + 2);
        (0..side * side).map(move |i| {
            let (x, y) = (i % side, i / side);
            let place = DVec2::new(x as f64 + 0.5, y as f64 + 0.5) * (2.0 / side as f64) - 1.0;
            let on = unfolded(place);
            let area = (2.0 / side as f64).powi(2);
            (on.normalize(), self.texels[(y + 1) * row + x + 1], area / on.length().powi(3))
        })
    }

    /// What lies in a direction, bilinear.
    #[must_use]
    pub fn at(&self, direction: DVec3) -> DVec3 {
        let row = self.side + 2;
        let at = folded(direction) * 0.5 * self.side as f64 + (0.5 * self.side as f64 + 0.5);
        let low = at.floor().clamp(DVec2::ZERO, DVec2::splat(self.side as f64));
        let part = at - low;
        let first = low.y as usize * row + low.x as usize;
        let above = self.texels[first].lerp(self.texels[first + 1], part.x);
        above.lerp(self.texels[first + row].lerp(self.texels[first + row + 1], part.x), part.y)
    }
}

/// From a direction to the square from −1 to 1.
fn folded(direction: DVec3) -> DVec2 {
    let place = direction.truncate() / (direction.x.abs() + direction.y.abs() + direction.z.abs());
    if direction.z >= 0.0 { place } else { turned(place) }
}

/// From the square to the octahedron.
fn unfolded(place: DVec2) -> DVec3 {
    let z = 1.0 - place.x.abs() - place.y.abs();
    if z >= 0.0 { place.extend(z) } else { turned(place).extend(z) }
}

fn turned(place: DVec2) -> DVec2 {
    let sign = |v: f64| if v >= 0.0 { 1.0 } else { -1.0 };
    DVec2::new((1.0 - place.y.abs()) * sign(place.x), (1.0 - place.x.abs()) * sign(place.y))
}

/// Irradiance over π of a map's light, as nine coefficients per channel of the polynomial that [`Sky::ambient`]
/// evaluates (Ramamoorthi and Hanrahan, "An Efficient Representation for Irradiance Environment Maps", 2001: error
/// about 1 % for skies).
#[must_use]
pub fn irradiance(map: &Octahedral) -> [DVec3; 9] {
    let mut sums = [DVec3::ZERO; 9];
    let mut all = 0.0;
    for (n, radiance, angle) in map.parts() {
        for (sum, basis) in sums.iter_mut().zip(harmonics(n)) {
            *sum += radiance * (basis * angle);
        }
        all += angle;
    }
    // Squares of the basis' factors, and Lambert's lobe in each order over π: 1, ⅔, ¼.
    let of = |square: f64, lobe: f64| square * lobe / PI;
    let (zero, one, two) = (of(0.25, 1.0), of(0.75, 2.0 / 3.0), of(3.75, 0.25));
    let factors = [zero, one, one, one, two, two, of(5.0 / 16.0, 0.25), two, of(15.0 / 16.0, 0.25)];
    // Texels' solid angles do not add up to exactly 4π.
    let whole = 4.0 * PI / all;
    let mut factors = factors.into_iter();
    sums.map(|sum| sum * (factors.next().unwrap_or(0.0) * whole))
}

/// Real harmonics up to order 2 without their factors, those of order 2 first by sum of indices as in the paper.
fn harmonics(n: DVec3) -> [f64; 9] {
    [1.0, n.y, n.z, n.x, n.x * n.y, n.y * n.z, 3.0 * n.z * n.z - 1.0, n.x * n.z, n.x * n.x - n.y * n.y]
}

/// What the shader knows of the sky.
#[derive(Clone, Debug)]
pub struct Sky<'a> {
    /// Unit vectors: up, across it towards where the sun stands, and to the sun.
    pub up: DVec3,
    /// See `up`.
    pub side: DVec3,
    /// See `up`.
    pub to_sun: DVec3,
    /// Radiance of the sun's disc.
    pub disc: DVec3,
    /// Angular radius of the disc, radians.
    pub disc_radius: f64,
    /// What is seen, without the disc.
    pub seen: &'a Octahedral,
    /// What is reflected, from mirrors to the roughest.
    pub layers: &'a [Octahedral],
    /// Of [`irradiance`].
    pub irradiance: [DVec3; 9],
    /// Extinction by haze, per world unit.
    pub haze: f64,
}

impl Sky<'_> {
    fn axes(&self, direction: DVec3) -> DVec3 {
        DVec3::new(direction.dot(self.side), direction.dot(self.up.cross(self.side)), direction.dot(self.up))
    }

    /// Radiance seen in a direction.
    #[must_use]
    pub fn sky(&self, direction: DVec3) -> DVec3 {
        let away = direction.distance(self.to_sun) / self.disc_radius;
        let t = ((away - 0.95) / 0.1).clamp(0.0, 1.0);
        let disc = if direction.dot(self.up) >= 0.0 { 1.0 - t * t * (3.0 - 2.0 * t) } else { 0.0 };
        self.seen.at(self.axes(direction)) + self.disc * disc
    }

    /// Irradiance over π.
    #[must_use]
    pub fn ambient(&self, normal: DVec3) -> DVec3 {
        let basis = harmonics(self.axes(normal));
        let sum = self.irradiance.iter().zip(basis).map(|(c, basis)| *c * basis).sum::<DVec3>();
        sum.max(DVec3::ZERO)
    }

    /// Mean radiance in a lobe.
    #[must_use]
    pub fn reflected(&self, direction: DVec3, roughness: f64) -> DVec3 {
        let last = self.layers.len() - 1;
        let layer = roughness.clamp(0.0, 1.0) * last as f64;
        let low = layer.floor() as usize;
        let axes = self.axes(direction);
        self.layers[low].at(axes).lerp(self.layers[(low + 1).min(last)].at(axes), layer - low as f64)
    }

    /// Radiance after a distance in haze.
    #[must_use]
    pub fn hazed(&self, radiance: DVec3, ray: DVec3, distance: f64) -> DVec3 {
        self.seen.at(self.axes(ray)).lerp(radiance, (-self.haze * distance).exp())
    }
}

/// Entries of the table of the split sum along each side.
pub const SPLIT_SUM_SIDE: usize = 32;

/// The table of the split sum: square roots of cosines along rows, 0 to 1 (Fresnel's term is steep where they are small),
/// roughness down.
#[must_use]
pub fn split_sum() -> Vec<[f64; 2]> {
    let share = |i: usize| i as f64 / (SPLIT_SUM_SIDE - 1) as f64;
    (0..SPLIT_SUM_SIDE * SPLIT_SUM_SIDE)
        .map(|i| environment_brdf_exact(share(i % SPLIT_SUM_SIDE).powi(2), share(i / SPLIT_SUM_SIDE), 256))
        .collect()
}

/// What lies in that table, bilinear.
#[must_use]
pub fn environment_brdf(table: &[[f64; 2]], cosine: f64, roughness: f64) -> [f64; 2] {
    let split = |share: f64| {
        let at = share.clamp(0.0, 1.0) * (SPLIT_SUM_SIDE - 1) as f64;
        let low = (at as usize).min(SPLIT_SUM_SIDE - 2);
        (low, at - low as f64)
    };
    let ((i, u), (j, v)) = (split(cosine.max(0.0).sqrt()), split(roughness));
    let first = j * SPLIT_SUM_SIDE + i;
    let mix = |a: f64, b: f64, t: f64| a + (b - a) * t;
    [0, 1].map(|k| {
        let [a, b, c, d] = [0, 1, SPLIT_SUM_SIDE, SPLIT_SUM_SIDE + 1].map(|offset| table[first + offset][k]);
        mix(mix(a, b, u), mix(c, d, u), v)
    })
}

/// Factor on the reflectance at normal incidence, and what is added, of GGX with Smith's shadowing (height-correlated,
/// Heitz 2014) and Schlick's Fresnel term under an even sky: Karis 2013, by `count` directions of its lobe.
#[must_use]
pub fn environment_brdf_exact(cosine: f64, roughness: f64, count: u32) -> [f64; 2] {
    // At a right angle, and where nothing is rough, the limit.
    let (cosine, alpha2) = (cosine.max(1e-3), roughness.max(1e-3).powi(4));
    let eye = DVec3::new((1.0 - cosine * cosine).max(0.0).sqrt(), 0.0, cosine);
    let mut sums = [0.0; 2];
    for i in 0..count {
        let half = ggx_half(alpha2, i, count);
        let light = half * (2.0 * eye.dot(half)) - eye;
        if light.z <= 0.0 {
            continue;
        }
        let bent = |a: f64, b: f64| a * (b * b * (1.0 - alpha2) + alpha2).sqrt();
        let visible = 2.0 * light.z * cosine / (bent(light.z, cosine) + bent(cosine, light.z));
        let at = eye.dot(half).max(0.0);
        let weight = visible * at / (half.z * cosine).max(1e-9);
        let fresnel = (1.0 - at).powi(5);
        sums[0] += (1.0 - fresnel) * weight;
        sums[1] += fresnel * weight;
    }
    sums.map(|sum| sum / f64::from(count))
}

/// One of `count` half vectors around z that are spread as GGX's normals are (α² given), on a golden spiral.
#[must_use]
pub fn ggx_half(alpha2: f64, i: u32, count: u32) -> DVec3 {
    let u = (f64::from(i) + 0.5) / f64::from(count);
    let z2 = (1.0 - u) / (1.0 + (alpha2 - 1.0) * u);
    let (sine, cosine) = (f64::from(i) * PI * (3.0 - 5f64.sqrt())).sin_cos();
    let across = (1.0 - z2).max(0.0).sqrt();
    DVec3::new(across * cosine, across * sine, z2.sqrt())
}

/// Directions and weights of the lobe that a surface of this roughness reflects to an eye along its normal, z, which is
/// where it is mirrored too (Karis 2013).
#[must_use]
pub fn lobe(roughness: f64, count: u32) -> Vec<(DVec3, f64)> {
    let halves = (0..count).map(|i| ggx_half(roughness.powi(4), i, count));
    let lights = halves.map(|half| half * (2.0 * half.z) - DVec3::Z).filter(|light| light.z > 0.0);
    let all: Vec<_> = lights.map(|light| (light, light.z)).collect();
    let whole: f64 = all.iter().map(|(_, weight)| weight).sum();
    all.into_iter().map(|(light, weight)| (light, weight / whole)).collect()
}

/// Mean of all that is in a map in a [`lobe`] around a direction, by its texels: for lobes that are wider than these.
#[must_use]
pub fn in_wide_lobe(parts: &[(DVec3, DVec3, f64)], direction: DVec3, roughness: f64) -> DVec3 {
    let alpha2 = roughness.powi(4);
    let (mut sum, mut whole) = (DVec3::ZERO, 0.0);
    for (light, radiance, angle) in parts {
        let cosine = light.dot(direction);
        if cosine > 0.0 {
            // The half vector lies half way, so its squared cosine is (1 + cosine) / 2; GGX's π cancels.
            let spread = 0.5 * (1.0 + cosine) * (alpha2 - 1.0) + 1.0;
            let weight = angle * cosine / (spread * spread);
            sum += *radiance * weight;
            whole += weight;
        }
    }
    sum / whole.max(1e-12)
}

/// Mean of `radiance` in a [`lobe`] around a direction.
#[must_use]
pub fn in_lobe(radiance: impl Fn(DVec3) -> DVec3, direction: DVec3, lobe: &[(DVec3, f64)]) -> DVec3 {
    let (x, y) = direction.any_orthonormal_pair();
    lobe.iter().map(|(l, weight)| radiance(x * l.x + y * l.y + direction * l.z) * *weight).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Light from a few places, with a step at the horizon.
    fn light(direction: DVec3) -> DVec3 {
        let glow = direction.dot(DVec3::new(0.6, 0.0, 0.8)).max(0.0).powi(20);
        let above = if direction.z > 0.0 { DVec3::new(0.2, 0.4, 0.8) } else { DVec3::splat(0.1) };
        above + DVec3::new(4.0, 3.0, 2.0) * glow
    }

    fn directions(count: u32) -> impl Iterator<Item = DVec3> {
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

    #[test]
    fn the_table_of_the_split_sum_is_near_its_integral() {
        let table = split_sum();
        let (mut worst, mut fit_worst, mut squares, mut count) = ([0.0f64; 2], [0.0f64; 2], 0.0f64, 0.0);
        for i in 0..40 {
            for j in 0..40 {
                let (cosine, roughness) = ((f64::from(i) + 0.5) / 40.0, (f64::from(j) + 0.5) / 40.0);
                let [a, b] = environment_brdf_exact(cosine, roughness, 4000);
                let [c, d] = environment_brdf(&table, cosine, roughness);
                // The fit that the table is instead of (Karis, "Physically Based Shading on Mobile", 2014).
                let r = [(-1.0, 1.0), (-0.0275, 0.0425), (-0.572, 1.04), (0.022, -0.04)]
                    .map(|(a, b)| roughness * a + b);
                let fit = (r[0] * r[0]).min((-9.28 * cosine).exp2()) * r[0] + r[1];
                // What a dielectric and a metal make of it.
                for (k, f0) in [0.04, 0.8].into_iter().enumerate() {
                    let difference = f0 * (c - a) + d - b;
                    worst[k] = worst[k].max(difference.abs());
                    let of_fit = f0 * (-1.04 * fit + r[2] - a) + 1.04 * fit + r[3] - b;
                    fit_worst[k] = fit_worst[k].max(of_fit.abs());
                    squares += difference * difference;
                    count += 1.0;
                }
            }
        }
        let rms = (squares / count).sqrt();
        println!(
            "split sum: worst of the table {worst:.4?}, of a fit {fit_worst:.4?}, RMS of the table {rms:.5}"
        );
        assert!(worst[0] < 0.02 && worst[1] < 0.03 && rms < 0.006, "{worst:?} {rms}");
    }
}
