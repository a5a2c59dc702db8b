//! The atmosphere against light that is followed path by path through the same medium, with every order of scattering.

use std::f64::consts::PI;

use glam::DVec3;
use lodestream_geometry::random::Random;

use super::*;

/// Radiance in one channel of `count` paths from the ground: free paths by Woodcock tracking, light from the sun at every
/// scattering and where the ground is met, no path cut short before it carries a hundredth.
fn traced(
    air: &AtmosphereTables,
    channel: usize,
    direction: DVec3,
    sun: DVec3,
    count: u32,
    random: &mut Random,
) -> f64 {
    let most = air.medium(0.0).extinction[channel];
    let mut sum = 0.0;
    for _ in 0..count {
        let mut at = DVec3::Z * (GROUND_KM + 0.2);
        let mut ray = direction;
        let mut weight = 1.0;
        loop {
            let radius = at.length();
            let (length, ground) = ray_length(radius, ray.dot(at) / radius);
            let mut passed = 0.0;
            let medium = loop {
                passed -= (1.0 - random.unit()).ln() / most;
                if passed >= length {
                    break None;
                }
                let medium = air.medium((at + ray * passed).length() - GROUND_KM);
                if random.unit() * most < medium.extinction[channel] {
                    break Some(medium);
                }
            };
            at += ray * passed.min(length);
            let up = at.normalize();
            let light = air.sunlight(at.length(), up.dot(sun))[channel];
            match medium {
                Some(medium) => {
                    let (rayleigh, mie) = (medium.rayleigh[channel], medium.mie);
                    weight *= (rayleigh + mie) / medium.extinction[channel];
                    let share = rayleigh / (rayleigh + mie);
                    let cosine = ray.dot(sun);
                    let phase = share * rayleigh_phase(cosine) + (1.0 - share) * mie_phase(cosine);
                    sum += weight * PI * light * phase;
                    ray = scattered(ray, random.unit() < share, random);
                }
                None if ground => {
                    weight *= air.albedo[channel];
                    sum += weight * up.dot(sun).max(0.0) * light;
                    ray = (up + on_sphere(random)).normalize();
                    at = up * (GROUND_KM + 1e-6);
                }
                None => break,
            }
            if weight < 0.01 {
                break;
            }
        }
    }
    sum / f64::from(count)
}

fn on_sphere(random: &mut Random) -> DVec3 {
    let z: f64 = 2.0 * random.unit() - 1.0;
    let (sine, cosine) = (2.0 * PI * random.unit()).sin_cos();
    let across = (1.0 - z * z).max(0.0).sqrt();
    DVec3::new(across * cosine, across * sine, z)
}

/// A direction by the phase function: Rayleigh's from an even one, Cornette and Shanks' from Henyey and Greenstein's,
/// both by rejection with (1 + cos²) / 2.
fn scattered(ray: DVec3, rayleigh: bool, random: &mut Random) -> DVec3 {
    let g = MIE_G;
    let cosine = loop {
        let u: f64 = random.unit();
        let even = 2.0 * u - 1.0;
        let bent = (1.0 - g * g) / (1.0 + g * even);
        let cosine: f64 = if rayleigh { even } else { (1.0 + g * g - bent * bent) / (2.0 * g) };
        if random.unit() < 0.5 * (1.0 + cosine * cosine) {
            break cosine;
        }
    };
    let (x, y) = ray.any_orthonormal_pair();
    let (s, c) = (2.0 * PI * random.unit()).sin_cos();
    ray * cosine + (x * c + y * s) * (1.0 - cosine * cosine).max(0.0).sqrt()
}

#[test]
fn the_sky_is_that_of_followed_paths() {
    let air = AtmosphereTables::new(10.0, DVec3::new(0.22, 0.20, 0.17));
    let mut random = Random::new(7);
    let degrees = |height: f64, azimuth: f64| {
        let ((h, c), (y, x)) = (height.to_radians().sin_cos(), azimuth.to_radians().sin_cos());
        DVec3::new(c * x, c * y, h)
    };
    let (mut squares, mut count) = (0.0f64, 0.0);
    for sun_height in [60.0, 25.0, 4.0] {
        let sun = degrees(sun_height, 0.0);
        for (height, azimuth) in [(85.0, 0.0), (45.0, 90.0), (30.0, 20.0), (10.0, 180.0), (2.0, 60.0)] {
            let ray = degrees(height, azimuth);
            let ours = air.scattered(GROUND_KM + 0.2, ray.z, sun.z, ray.dot(sun)).radiance(ray.dot(sun));
            let truth = DVec3::from([0, 1, 2].map(|c| traced(&air, c, ray, sun, 20_000, &mut random)));
            let off = ours / truth - DVec3::ONE;
            println!(
                "sun {sun_height}°, ray {height}° {azimuth}°: {ours:.4}, paths {truth:.4}, off {off:.3}"
            );
            // Further orders are taken to scatter evenly; aerosol throws them forwards, which low suns and rays show most.
            assert!(off.abs().max_element() < 0.3, "{sun_height} {height} {azimuth}: {ours} {truth}");
            squares += off.length_squared();
            count += 3.0;
        }
    }
    let rms = (squares / count).sqrt();
    println!("RMS {rms:.4}");
    assert!(rms < 0.12, "{rms}");
}

#[test]
fn transmittance_is_the_integral_of_extinction() {
    let air = AtmosphereTables::new(1.0, DVec3::ZERO);
    let mut worst = 0.0f64;
    for height in [0.0, 0.2, 3.0, 12.0, 40.0] {
        for cosine in [1.0, 0.7, 0.3, 0.1, 0.03, 0.005] {
            let radius = GROUND_KM + height;
            let length = ray_length(radius, cosine).0;
            let depth: DVec3 = (0..4000)
                .map(|i| (f64::from(i) + 0.5) / 4000.0 * length)
                .map(|at| {
                    air.medium(place(radius, cosine, 0.0, 0.0, at).0 - GROUND_KM).extinction * length / 4000.0
                })
                .sum();
            worst = worst.max(
                (air.sunlight(radius, cosine.max(0.01)) - (-depth).exp()).abs().max_element()
                    * f64::from(u8::from(cosine >= 0.01)),
            );
        }
    }
    println!("transmittance: worst {worst:.5}");
    assert!(worst < 0.01, "{worst}");
}

#[test]
fn tables_of_places_give_them_back() {
    for (x, y) in [(0.0, 0.0), (0.2, 0.7), (1.0, 0.3), (0.5, 0.99)] {
        let (radius, cosine) = from_bruneton(x, y);
        let (u, v) = to_bruneton(radius, cosine);
        assert!((u - x).abs() < 1e-6 && (v - y).abs() < 1e-6, "{x} {y}: {u} {v}");
    }
}
