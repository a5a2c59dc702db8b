//! Specular reflection of dielectrics and clear coats against their integral, and transmission.

use glam::DVec3;

use super::materials::{
    bare, close, front, halves, middle, of_light, sky_alone, sphere_rms, square, textured,
};
use super::shapes::{asset, at, cube, quad, sphere};
use super::{headless, keep};
use crate::cpu_reference::brdf::{self, DIELECTRIC, Reflector, from_octahedral};
use crate::cpu_reference::sky::{environment_brdf, split_sum};
use crate::frame::graph::Resource;
use crate::{
    Alpha, ClearCoat, Drawable, Environment, Frame, Headless, Material, PassId, Placement, PunctualLight,
    Reflections, Settings, Specular, TextureKind,
};

fn of(f0: [f32; 3], f90: f32) -> Material {
    let specular = Specular { f0, f90 };
    Material { base_color: [0.2, 0.5, 0.8, 1.0], roughness: 0.3, specular, ..Material::default() }
}

/// A diamond, a tinted and a weak reflection, and none.
fn all() -> [Material; 4] {
    [of([0.17; 3], 1.0), of([0.5, 0.2, 0.02], 1.0), of([0.02; 3], 0.5), of([0.0; 3], 0.0)]
}

#[test]
fn spheres_reflect_as_their_specular_factors_say() {
    let Some(mut h) = headless(32, 32) else { return };
    for material in all() {
        for metallic in [0.0, 0.5] {
            let material = Material { metallic, ..material.clone() };
            let by_sun = sphere_rms(&mut h, material.clone(), of_light(1.0, 0.0), |_| [0.0; 3]);
            let by_sky = sphere_rms(&mut h, material.clone(), sky_alone(0.5), |_| [0.5; 3]);
            println!("{:?} {metallic} | {by_sun:.4} {by_sky:.4}", material.specular);
            assert!(by_sun < 0.05 && by_sky < 0.1, "{:?} {metallic}: {by_sun} {by_sky}", material.specular);
        }
    }
}

fn draw(h: &mut Headless, drawables: &[Drawable<'_>], environment: Environment) -> Vec<PassId> {
    let light = PunctualLight { position: [0.5, 0.5, 2.0], intensity: [2.0; 3], range: 50.0, spot: None };
    let frame = Frame { environment, settings: bare(), lights: &[light], ..Frame::new(front(), drawables) };
    h.frame(&frame).unwrap().passes
}

#[test]
fn the_target_holds_the_factors_where_they_are_seen_and_the_usual_ones_elsewhere() {
    let Some(mut h) = headless(16, 16) else { return };
    let here = [Placement::default()];
    let [diamond, ..] = all();
    let wall = asset(&h, &square(0.0), diamond.clone());
    // Before its left half.
    let plain =
        asset(&h, &quad([-1.0, -1.0, 0.1], [1.0, 0.0, 0.0], [0.0, 2.0, 0.0], 1.0), Material::default());
    let both = [&wall, &plain].map(|asset| Drawable { asset, instances: &here });
    let passes = draw(&mut h, &both, of_light(0.5, 0.5));
    assert!(passes.contains(&PassId::Specular));
    let stored = h.intermediate(Resource::Specular, 8).unwrap();
    let at = |x: usize| <[u8; 4]>::try_from(&stored[8 * (8 * 16 + x)..][..4]).unwrap();
    assert_eq!((at(4), at(12)), (Specular::default().bytes(), diamond.specular.bytes()));
    // The usual reflection is the same with and without the target.
    let left = |h: &Headless| halves(h, Resource::Radiance)[8 * 16 + 4];
    let beside = left(&h);
    assert!(!draw(&mut h, &both[1..], of_light(0.5, 0.5)).contains(&PassId::Specular));
    let [r, g, b, _] = beside;
    close(left(&h), [r, g, b], 1e-3);
}

#[test]
fn transparent_surfaces_and_reflected_ones_use_the_same_factors() {
    let Some(mut h) = headless(16, 16) else { return };
    let here = [Placement::default()];
    let environment = Environment { to_sun: DVec3::new(0.1, 0.2, 1.0), ..of_light(0.8, 0.4) };
    for material in all() {
        let shown = [Alpha::Opaque, Alpha::Blend].map(|alpha| {
            let wall = asset(&h, &square(0.0), Material { alpha, ..material.clone() });
            draw(&mut h, &[Drawable { asset: &wall, instances: &here }], environment);
            middle(&h, Resource::Radiance)
        });
        let usual = asset(&h, &square(0.0), Material { specular: Specular::default(), ..material.clone() });
        draw(&mut h, &[Drawable { asset: &usual, instances: &here }], environment);
        let [opaque, seen_through] = shown;
        // Eight bits of the opaque one's albedo.
        close(seen_through, [opaque[0], opaque[1], opaque[2]], 0.01);
        let usual = middle(&h, Resource::Radiance);
        assert!((0..3).any(|c| (usual[c] - opaque[c]).abs() > 0.03), "{opaque:?} {usual:?}");
    }
    // A block on a smooth floor: the floor's reflection of it grows with its reflectance.
    let block = asset(&h, &cube(), Material { base_color: [0.9, 0.1, 0.1, 1.0], ..Material::default() });
    let mirrored = [0.04_f32, 0.16].map(|f0| {
        let dark = Material { base_color: [0.0, 0.0, 0.0, 1.0], roughness: 0.05, ..of([f0; 3], 1.0) };
        let floor = asset(&h, &quad([-4.0, 0.0, 4.0], [8.0, 0.0, 0.0], [0.0, 0.0, -8.0], 1.0), dark);
        let block_at = [at(0.0, 0.6, -1.0, 1.0)];
        let drawables =
            [Drawable { asset: &floor, instances: &here }, Drawable { asset: &block, instances: &block_at }];
        // The block is seen, at the upper border.
        let camera = crate::Pose::look_at(DVec3::new(0.0, 1.5, 2.0), DVec3::ZERO, DVec3::Y, 0.9);
        let [without, with] = [None, Some(Reflections::default())].map(|reflections| {
            let settings = Settings { reflections, ..bare() };
            let environment = Environment { to_sun: environment.to_sun, ..of_light(0.8, 0.0) };
            h.frame(&Frame { environment, settings, ..Frame::new(camera, &drawables) }).unwrap();
            middle(&h, Resource::Radiance)[0]
        });
        with - without
    });
    assert!(mirrored[0] > 0.0 && mirrored[1] > 2.0 * mirrored[0], "{mirrored:?}");
}

fn coated(factor: f32, roughness: f32) -> Material {
    let clear_coat = ClearCoat { factor, roughness };
    Material { base_color: [0.5, 0.05, 0.02, 1.0], roughness: 0.6, clear_coat, ..Material::default() }
}

#[test]
fn coated_spheres_reflect_as_the_integral_says() {
    let Some(mut h) = headless(32, 32) else { return };
    for (factor, coat, metallic) in [(1.0, 0.3, 0.0), (1.0, 0.1, 0.0), (0.5, 0.2, 1.0), (1.0, 0.6, 0.5)] {
        let material = Material { metallic, ..coated(factor, coat) };
        let by_sun = sphere_rms(&mut h, material.clone(), of_light(1.0, 0.0), |_| [0.0; 3]);
        let by_sky = sphere_rms(&mut h, material, sky_alone(0.5), |_| [0.5; 3]);
        println!("{factor} {coat} {metallic} | {by_sun:.4} {by_sky:.4}");
        // As of materials without a coat: 16 bits of normals matter in narrow lobes.
        let most = if coat < 0.2 { 0.12 } else { 0.05 };
        assert!(by_sun < most && by_sky < 0.1, "{factor} {coat} {metallic}: {by_sun} {by_sky}");
    }
}

#[test]
fn a_coat_lies_over_the_normal_map_and_is_lit_by_all_lights() {
    let Some(mut h) = headless(16, 16) else { return };
    let here = [Placement::default()];
    let tilted =
        DVec3::new(0.4, 0.3, 0.866).normalize().to_array().map(|c| ((c + 1.0) * 127.5).round() as u8);
    let map = [tilted[0], tilted[1], tilted[2], 255].repeat(64);
    for normal_texture in [None, Some(0)] {
        let material = Material { normal_texture, ..coated(1.0, 0.4) };
        let shown = [Alpha::Opaque, Alpha::Blend].map(|alpha| {
            let material = Material { alpha, ..material.clone() };
            let wall = textured(&h, &square(0.0), material, &[(TextureKind::Normal, &map)]);
            draw(&mut h, &[Drawable { asset: &wall, instances: &here }], of_light(0.0, 0.0));
            middle(&h, Resource::Radiance)
        });
        // The opaque wall again, for what stands in the targets.
        let wall = textured(&h, &square(0.0), material, &[(TextureKind::Normal, &map)]);
        draw(&mut h, &[Drawable { asset: &wall, instances: &here }], of_light(0.0, 0.0));
        let stored = h.intermediate(Resource::Specular, 8).unwrap();
        let words: Vec<u32> = bytemuck::pod_collect_to_vec(&stored[8 * (8 * 16 + 8)..][..8]);
        let specular = brdf::Specular::of_words([words[0], words[1]]);
        let [x, y, roughness, _] = middle(&h, Resource::Normal);
        let normal = from_octahedral([x, y]);
        match normal_texture {
            None => assert_eq!(specular.coat_normal, None),
            Some(_) => {
                let coat = DVec3::from(specular.coat_normal.unwrap());
                assert!(
                    coat.distance(DVec3::Z) < 2e-3 && coat.distance(normal.into()) > 0.3,
                    "{coat} {normal:?}"
                );
            }
        }
        // The middle of the picture is 1/32 of its width right of and below the axis.
        let at = DVec3::new(1.0, -1.0, 0.0) * (2.0 * (0.3_f64).tan() / 16.0);
        let to_eye = (DVec3::new(0.0, 0.0, 2.0) - at).normalize().to_array();
        let albedo = [0.5, 0.05, 0.02];
        let reflector = Reflector { albedo, metal: 0.0, roughness, normal, to_eye, specular };
        let away = DVec3::new(0.5, 0.5, 2.0) - at;
        let light = 2.0 / std::f64::consts::PI / away.length_squared();
        let want = reflector.from_light(away.normalize().to_array(), [light; 3]);
        for got in shown {
            for c in 0..3 {
                assert!(
                    (got[c] - want[c]).abs() < 0.01 * want[c] + 2e-3,
                    "{normal_texture:?}: {shown:?} {want:?}"
                );
            }
        }
    }
}

#[test]
fn a_coated_ball_has_a_sharper_highlight_than_a_rough_one() {
    let Some(mut h) = headless(192, 96) else { return };
    let balls = [coated(1.0, 0.1), coated(0.0, 0.0)].map(|material| asset(&h, &sphere(96), material));
    let places = [[at(-0.55, 0.0, 0.0, 1.0)], [at(0.55, 0.0, 0.0, 1.0)]];
    let drawables: Vec<_> =
        balls.iter().zip(&places).map(|(asset, instances)| Drawable { asset, instances }).collect();
    let environment = Environment { to_sun: DVec3::new(0.2, 0.4, 1.0), ..of_light(1.0, 0.3) };
    let camera = crate::Pose::look_at(DVec3::new(0.0, 0.0, 6.0), DVec3::ZERO, DVec3::Y, 0.2);
    h.frame(&Frame { environment, settings: bare(), ..Frame::new(camera, &drawables) }).unwrap();
    keep(&h, "clear-coat");
    let radiance = halves(&h, Resource::Radiance);
    // Of each half: the brightest green, and how many pixels are brighter than its half.
    let highlight = |first: usize| {
        let greens: Vec<f64> = (0..96 * 96)
            .map(|i| radiance[i / 96 * 192 + first + i % 96])
            .filter(|texel| texel[3] >= 1.0)
            .map(|texel| texel[1])
            .collect();
        let brightest = greens.iter().fold(0.0, |a: f64, b| a.max(*b));
        (brightest, greens.iter().filter(|green| **green > 0.5 * brightest).count())
    };
    let ((coat, few), (rough, many)) = (highlight(0), highlight(96));
    assert!(coat > 3.0 * rough && few * 5 < many && few > 0, "{coat} {few}, {rough} {many}");
}

#[test]
fn a_pane_tints_what_is_behind_it_and_keeps_its_reflections() {
    let Some(mut h) = headless(16, 16) else { return };
    let here = [Placement::default()];
    let tint = [0.9, 0.5, 0.1];
    let walls = [0.0, 1.0, 0.25].map(|grey| {
        let material = Material { base_color: [grey, grey, grey, 1.0], unlit: true, ..Material::default() };
        asset(&h, &square(-0.5), material)
    });
    let table = split_sum();
    for (transmission, metallic, opacity) in
        [(1.0_f32, 0.0_f32, 1.0_f32), (0.6, 0.0, 1.0), (1.0, 0.5, 1.0), (1.0, 0.0, 0.5)]
    {
        let pane = Material {
            base_color: [tint[0], tint[1], tint[2], opacity],
            roughness: 0.3,
            metallic,
            alpha: Alpha::Blend,
            transmission,
            ..Material::default()
        };
        let pane = asset(&h, &square(0.0), pane);
        let to_sun = DVec3::new(0.05, 0.1, 1.0);
        let shown = [0, 1, 2].map(|wall: usize| {
            let drawables = [&pane, &walls[wall]].map(|asset| Drawable { asset, instances: &here });
            let environment = Environment { to_sun, ..of_light(1.0, 0.0) };
            h.frame(&Frame { environment, settings: bare(), ..Frame::new(front(), &drawables) }).unwrap();
            middle(&h, Resource::Radiance)
        });
        // Nearly straight on.
        let at = DVec3::new(1.0, -1.0, 0.0) * (2.0 * (0.3_f64).tan() / 16.0);
        let to_eye = (DVec3::new(0.0, 0.0, 2.0) - at).normalize();
        let [factor, added] = environment_brdf(&table, to_eye.z, 0.3);
        let albedo = tint.map(f64::from);
        let [metal, transmission, opacity] = [metallic, transmission, opacity].map(f64::from);
        let specular = brdf::Specular { base: 1.0 - transmission, ..brdf::Specular::USUAL };
        let (normal, to_eye) = ([0.0, 0.0, 1.0], to_eye.to_array());
        let reflector = Reflector { albedo, metal, roughness: 0.3, normal, to_eye, specular };
        let own = reflector.from_light(to_sun.normalize().to_array(), [1.0; 3]);
        for c in 0..3 {
            let f0 = DIELECTRIC + (albedo[c] - DIELECTRIC) * metal;
            let left = transmission * albedo[c] * (1.0 - metal) * (1.0 - f0 * factor - added);
            let left = 1.0 - opacity * (1.0 - left);
            let [black, white, grey] = shown.map(|shown| shown[c]);
            assert!((white - black - left).abs() < 4e-3, "{transmission} {metal}: {shown:?} {left}");
            assert!((grey - black - 0.25 * left).abs() < 4e-3, "{transmission} {metal}: {shown:?} {left}");
            let want = own[c] * opacity;
            assert!((black - want).abs() < 0.01 * want + 4e-3, "{transmission} {metal}: {shown:?} {own:?}");
        }
    }
}

#[test]
fn materials_of_glass_lacquer_and_gems_for_looking_at() {
    let Some(mut h) = headless(640, 240) else { return };
    let colour = |base_color: [f32; 3], roughness| Material {
        base_color: [base_color[0], base_color[1], base_color[2], 1.0],
        roughness,
        ..Material::default()
    };
    let glass =
        |base_color, transmission| Material { alpha: Alpha::Blend, transmission, ..colour(base_color, 0.05) };
    let materials = [
        colour([0.6, 0.02, 0.02], 0.5),
        Material { clear_coat: ClearCoat { factor: 1.0, roughness: 0.03 }, ..colour([0.6, 0.02, 0.02], 0.5) },
        Material { specular: Specular { f0: [0.17; 3], f90: 1.0 }, ..colour([0.05, 0.1, 0.3], 0.1) },
        Material { specular: Specular { f0: [0.0; 3], f90: 0.0 }, ..colour([0.05, 0.1, 0.3], 0.1) },
        glass([1.0; 3], 1.0),
        glass([0.9, 0.3, 0.3], 1.0),
        Material { clear_coat: ClearCoat { factor: 1.0, roughness: 0.1 }, ..glass([0.3, 0.9, 0.4], 0.7) },
    ];
    let balls = materials.map(|material| asset(&h, &sphere(64), material));
    let stripes: Vec<_> =
        (0..9).map(|i| quad([-4.0 + i as f32, -2.0, -1.2], [0.5, 0.0, 0.0], [0.0, 4.0, 0.0], 1.0)).collect();
    let stripes = asset(&h, &super::shapes::join(&stripes), colour([0.8, 0.75, 0.6], 0.9));
    let places: Vec<_> = (0..7).map(|i| [at(f64::from(i) * 1.05 - 3.15, 0.0, 0.0, 1.0)]).collect();
    let here = [Placement::default()];
    let mut drawables: Vec<_> =
        balls.iter().zip(&places).map(|(asset, instances)| Drawable { asset, instances }).collect();
    drawables.push(Drawable { asset: &stripes, instances: &here });
    let camera = crate::Pose::look_at(DVec3::new(0.0, 0.6, 7.0), DVec3::ZERO, DVec3::Y, 0.42);
    let passes = h.frame(&Frame::new(camera, &drawables)).unwrap().passes;
    keep(&h, "glass-lacquer-gems");
    assert!(passes.contains(&PassId::Specular) && passes.contains(&PassId::Transparency));
}
