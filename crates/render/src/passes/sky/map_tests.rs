use glam::Vec3;

use super::*;
use crate::cpu_reference::sky::Sky as ReferenceSky;
use crate::passes::sky::octahedral::tests::directions;

fn air() -> (Atmosphere, AtmosphereTables) {
    let air = Atmosphere::default();
    (air, AtmosphereTables::new(f64::from(air.aerosol), air.ground.as_dvec3()))
}

fn cpu_reference(map: &SkyMap) -> ReferenceSky<'_> {
    ReferenceSky {
        up: DVec3::Z,
        side: DVec3::X,
        to_sun: DVec3::Z,
        disc: DVec3::ZERO,
        disc_radius: 1.0,
        seen: &map.seen,
        layers: &map.lobes,
        irradiance: map.irradiance,
        haze: 0.0,
    }
}

/// Root of the mean squared difference, over the mean.
fn rms(pairs: &[(DVec3, DVec3)]) -> f64 {
    let (mut squares, mut sum) = (0.0, 0.0);
    for (got, want) in pairs {
        squares += (*got - *want).length_squared();
        sum += want.element_sum();
    }
    (squares * 3.0 * pairs.len() as f64).sqrt() / sum
}

#[test]
fn ambient_light_is_the_integral_of_the_sky() {
    let (_, atmosphere) = air();
    // As photographs show it: adaptation is a factor.
    let air = Atmosphere { adaptation: 0.0, ..Atmosphere::default() };
    for sun_height in [0.9, 0.5, 0.1] {
        let map = SkyMap::of_air(&air, &atmosphere, sun_height, false);
        let pairs: Vec<_> = directions(200)
            .map(|n| {
                let sum = map.seen.parts().map(|(d, light, angle)| light * (d.dot(n).max(0.0) * angle));
                (cpu_reference(&map).ambient(n), sum.sum::<DVec3>() / PI)
            })
            .collect();
        let off = rms(&pairs);
        println!("irradiance, sun {sun_height}: RMS {off:.4} of the mean");
        assert!(off < 0.05, "{off}");
    }
}

#[test]
fn reflections_are_the_integrals_of_their_lobes() {
    let (air, atmosphere) = air();
    for sun_height in [0.7, 0.15] {
        let map = SkyMap::of_air(&air, &atmosphere, sun_height, false);
        for roughness in [0.1, 0.2, 0.3, 0.4, 0.5, 0.7, 0.8, 1.0] {
            let pairs: Vec<_> = directions(150)
                .map(|d| {
                    let truth = in_lobe(|l| map.seen.at(l), d, &lobe(roughness, 4000));
                    (cpu_reference(&map).reflected(d, roughness), truth)
                })
                .collect();
            let off = rms(&pairs);
            println!("lobes, sun {sun_height}, roughness {roughness}: RMS {off:.4} of the mean");
            assert!(off < 0.2, "{roughness}: {off}");
        }
    }
}

#[test]
fn suns_from_the_zenith_to_below_the_horizon_give_numbers() {
    let (air, atmosphere) = air();
    let mut last = f64::INFINITY;
    for degrees in
        [90.0, 89.9f64, 60.0, 30.0, 10.0, 3.0, 1.0, 0.2, 0.0, -0.3, -2.0, -6.0, -18.0, -45.0, -90.0]
    {
        for haze in [false, true] {
            let map = SkyMap::of_air(&air, &atmosphere, degrees.to_radians().sin(), haze);
            let texels = map.lobes.iter().chain([&map.seen]).flat_map(Octahedral::texels);
            let all = texels.chain(&map.irradiance).chain([&map.sun, &map.disc]);
            assert!(all.clone().all(|c| c.is_finite()), "{degrees}");
            assert!(map.seen.texels().iter().all(|c| c.min_element() >= 0.0), "{degrees}");
        }
        let map = SkyMap::of_air(&air, &atmosphere, degrees.to_radians().sin(), false);
        let [sun, up] = [map.sun, map.ambient(DVec3::Z)];
        println!("{degrees:6}°: sun {sun:.3}, from above {up:.3}, zenith {:.3}", map.seen.at(DVec3::Z));
        // Warmer as it sinks, and gone below the horizon.
        assert!(sun.z / sun.x.max(1e-9) <= last + 1e-9, "{degrees}");
        last = if sun.x > 1e-6 { sun.z / sun.x } else { last };
        assert_eq!(sun == DVec3::ZERO, degrees < -1.0, "{degrees}: {sun}");
    }
}

/// What the ambient light must be: plausible beside the sun, cool in shade but not blue.
#[test]
fn white_in_shade_is_cool_but_not_blue() {
    let (air, atmosphere) = air();
    for degrees in [60.0f64, 48.0, 30.0, 15.0] {
        let height = degrees.to_radians().sin();
        let map = SkyMap::of_air(&air, &atmosphere, height, false);
        let shade = map.ambient(DVec3::Z);
        let share = luminance(shade) / luminance(shade + map.sun * height);
        let raw = SkyMap::of_air(&Atmosphere { adaptation: 0.0, ..air }, &atmosphere, height, false)
            .ambient(DVec3::Z);
        println!(
            "sun {degrees}°: shade {shade:.3} (blue/red {:.2}, unadapted {:.2}), {share:.3} of the light on level ground; sun {:.3}",
            shade.z / shade.x,
            raw.z / raw.x,
            map.sun
        );
        assert!((1.0..1.35).contains(&(shade.z / shade.x)), "{degrees}: {shade}");
        // Clear skies scatter a tenth to two fifths of what falls on level ground (Iqbal 1983).
        assert!((0.1..0.45).contains(&share), "{degrees}: {share}");
    }
}

#[test]
fn given_colours_stay_as_they_are() {
    let grey = Vec3::splat(0.25);
    let plain = GradientSky { sun: Vec3::ONE, zenith: grey, horizon: grey, ground: grey };
    let map = SkyMap::plain(&plain, false);
    for d in directions(50) {
        assert!((cpu_reference(&map).reflected(d, 0.5) - 0.25).length() < 1e-9);
        assert!((map.ambient(d) - 0.25).length() < 2e-4, "{}", map.ambient(d));
        assert_eq!(map.seen.at(d).x, 0.25);
    }
    assert_eq!((map.sun, map.disc), (DVec3::ONE, DVec3::ZERO));
}

#[test]
fn a_studio_lights_a_white_surface_as_its_exposure_supposes() {
    let studio = Studio::default();
    let map = SkyMap::studio(&studio);
    let to_key = DVec3::new(0.675, 0.0, 0.738);
    let lit = luminance(map.sun + map.ambient(to_key));
    assert!((lit / f64::from(studio::white(&studio)) - 1.0).abs() < 0.02, "{lit}");
    // Away from the key light it is darker from every side, but not dark.
    for d in directions(200) {
        let from_around = map.ambient(d).x;
        assert!((0.15..0.8).contains(&from_around), "{d}: {from_around}");
    }
    let dark = SkyMap::studio(&Studio { key: Vec3::ZERO, ..studio });
    assert_eq!(dark.ambient(DVec3::Z), map.ambient(DVec3::Z), "boxes light without a key light, too");
}

/// Best of several, since other work may share the machine.
#[test]
fn time_of_sky_maps() {
    let best = |work: &dyn Fn()| {
        let times = (0..5).map(|_| {
            let begun = std::time::Instant::now();
            work();
            begun.elapsed().as_secs_f64() * 1e3
        });
        times.fold(f64::INFINITY, f64::min)
    };
    let (air, atmosphere) = air();
    let tables = best(&|| {
        std::hint::black_box(AtmosphereTables::new(f64::from(air.aerosol), air.ground.as_dvec3()));
    });
    let map = best(&|| {
        std::hint::black_box(SkyMap::of_air(&air, &atmosphere, 0.6, true));
    });
    println!("tables of an air {tables:.1} ms, maps of a sun's height {map:.1} ms");
}
