//! Integrals of a sky's light that shaders look up: irradiance as spherical harmonics (Ramamoorthi and Hanrahan 2001),
//! GGX lobes and the table of the split sum (Karis 2013).

use std::f64::consts::PI;

use glam::DVec3;

use super::octahedral::Octahedral;

/// Irradiance over π of a map, as nine spherical-harmonic coefficients per channel for [`ambient`] (Ramamoorthi and
/// Hanrahan, "An Efficient Representation for Irradiance Environment Maps", 2001: error about 1 % for skies).
pub(crate) fn irradiance(map: &Octahedral) -> [DVec3; 9] {
    let mut sums = [DVec3::ZERO; 9];
    let mut all = 0.0;
    for (n, radiance, angle) in map.parts() {
        for (sum, basis) in sums.iter_mut().zip(harmonics(n)) {
            *sum += radiance * (basis * angle);
        }
        all += angle;
    }
    // Squared normalisation of the basis, and the cosine lobe's coefficient of each order over π: 1, ⅔, ¼.
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

/// Irradiance over π on a surface with this normal, from the coefficients of [`irradiance`].
pub(crate) fn ambient(coefficients: &[DVec3; 9], normal: DVec3) -> DVec3 {
    let sum = coefficients.iter().zip(harmonics(normal)).map(|(c, basis)| *c * basis).sum::<DVec3>();
    sum.max(DVec3::ZERO)
}

/// Side of the split-sum table.
pub(crate) const SPLIT_SUM_SIDE: usize = 32;

/// The split-sum table: square root of the cosine along rows, 0 to 1 (Fresnel is steep at small cosines), roughness
/// down.
pub(crate) fn split_sum() -> Vec<[f64; 2]> {
    let share = |i: usize| i as f64 / (SPLIT_SUM_SIDE - 1) as f64;
    (0..SPLIT_SUM_SIDE * SPLIT_SUM_SIDE)
        .map(|i| environment_brdf_exact(share(i % SPLIT_SUM_SIDE).powi(2), share(i / SPLIT_SUM_SIDE), 256))
        .collect()
}

/// Scale and bias on the reflectance at normal incidence of GGX with height-correlated Smith shadowing (Heitz 2014)
/// and Schlick's Fresnel term under a uniform sky (Karis 2013), integrated with `count` samples.
pub(crate) fn environment_brdf_exact(cosine: f64, roughness: f64, count: u32) -> [f64; 2] {
    // Clamp grazing angles and zero roughness to the limit.
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

/// The i-th of `count` half vectors around z, distributed as GGX normals (given α²) on a golden spiral.
pub(crate) fn ggx_half(alpha2: f64, i: u32, count: u32) -> DVec3 {
    let u = (f64::from(i) + 0.5) / f64::from(count);
    let z2 = (1.0 - u) / (1.0 + (alpha2 - 1.0) * u);
    let (sine, cosine) = (f64::from(i) * PI * (3.0 - 5f64.sqrt())).sin_cos();
    let across = (1.0 - z2).max(0.0).sqrt();
    DVec3::new(across * cosine, across * sine, z2.sqrt())
}

/// Directions and weights of the reflection lobe of a roughness, with eye and normal along z (Karis 2013).
pub(crate) fn lobe(roughness: f64, count: u32) -> Vec<(DVec3, f64)> {
    let halves = (0..count).map(|i| ggx_half(roughness.powi(4), i, count));
    let lights = halves.map(|half| half * (2.0 * half.z) - DVec3::Z).filter(|light| light.z > 0.0);
    let all: Vec<_> = lights.map(|light| (light, light.z)).collect();
    let whole: f64 = all.iter().map(|(_, weight)| weight).sum();
    all.into_iter().map(|(light, weight)| (light, weight / whole)).collect()
}

/// Mean of a map in a [`lobe`] around a direction, summed over texels: for lobes wider than these.
pub(crate) fn in_wide_lobe(parts: &[(DVec3, DVec3, f64)], direction: DVec3, roughness: f64) -> DVec3 {
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
pub(crate) fn in_lobe(radiance: impl Fn(DVec3) -> DVec3, direction: DVec3, lobe: &[(DVec3, f64)]) -> DVec3 {
    let (x, y) = direction.any_orthonormal_pair();
    lobe.iter().map(|(l, weight)| radiance(x * l.x + y * l.y + direction * l.z) * *weight).sum()
}
