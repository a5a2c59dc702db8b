//! Materials: reflection against its integral, maps, holes, emission, transparency.

use glam::{DVec3, Vec3};
use half::f16;

use super::shapes::{Mesh, asset, at, fill, join, opaque, quad, sphere};
use super::{headless, keep};
use crate::cpu_reference::brdf::{Reflector, Specular, from_octahedral, from_sky};
use crate::cpu_reference::depth::view_ray;
use crate::frame::graph::Resource;
use crate::scene::material_bindings::packed_coat;
use crate::{
    Alpha, AntiAliasing, AssetGpu, DebugView, Drawable, Environment, Frame, GradientSky, Headless, Material,
    PackedVertex, PassId, Placement, Pose, Settings, Sky, TextureData, TextureKind, TextureShape, Wrap,
};

/// A target in 16-bit floating point, four numbers per pixel.
pub(super) fn halves(h: &Headless, resource: Resource) -> Vec<[f64; 4]> {
    let stored: Vec<f16> = bytemuck::pod_collect_to_vec(&h.intermediate(resource, 8).unwrap());
    stored.chunks(4).map(|texel| [0, 1, 2, 3].map(|c| texel[c].to_f64())).collect()
}

/// The value in the middle of a picture.
pub(super) fn middle(h: &Headless, resource: Resource) -> [f64; 4] {
    let (width, height) = h.size();
    halves(h, resource)[(height / 2 * width + width / 2) as usize]
}

/// A sun and an even sky.
pub(super) fn of_light(sun: f32, radiance: f32) -> Environment {
    let all = Vec3::splat(radiance);
    let plain = GradientSky { sun: Vec3::splat(sun), zenith: all, horizon: all, ground: all };
    Environment { sky: Sky::Plain(plain), ..Environment::default() }
}

pub(super) fn sky_alone(radiance: f32) -> Environment {
    of_light(0.0, radiance)
}

/// Materials only, without effects that darken light.
pub(super) fn bare() -> Settings {
    Settings { occlusion: None, shadows: None, anti_aliasing: AntiAliasing::None, ..Settings::default() }
}

pub(super) fn front() -> Pose {
    Pose::look_at(DVec3::new(0.0, 0.0, 2.0), DVec3::ZERO, DVec3::Y, 0.6)
}

/// A square from -1 to 1 that faces +z at a depth.
pub(super) fn square(z: f32) -> Mesh {
    quad([-1.0, -1.0, z], [2.0, 0.0, 0.0], [0.0, 2.0, 0.0], 1.0)
}

/// An asset with textures of 8 × 8 texels and four levels, filled with one value or with `texels`.
pub(super) fn textured(
    h: &Headless,
    mesh: &Mesh,
    material: Material,
    textures: &[(TextureKind, &[u8])],
) -> AssetGpu {
    let shapes: Vec<_> = textures
        .iter()
        .map(|(kind, texels)| TextureShape {
            levels: 1,
            ..TextureShape::full(side(texels), side(texels), *kind)
        })
        .collect();
    let mut asset = h.renderer().create_asset(h.gpu(), DVec3::ZERO, &[material], &shapes);
    for (i, (_, texels)) in textures.iter().enumerate() {
        asset.update_texture(h.gpu(), i, 0, TextureData::Rgba8(texels)).unwrap();
    }
    fill(h, &mut asset, mesh);
    asset
}

fn side(texels: &[u8]) -> u32 {
    (texels.len() / 4).isqrt() as u32
}

fn draw<'a>(h: &mut Headless, drawables: &'a [Drawable<'a>], environment: Environment) -> Vec<PassId> {
    let frame = Frame { environment, settings: bare(), ..Frame::new(front(), drawables) };
    h.frame(&frame).unwrap().passes
}

pub(super) fn close(got: [f64; 4], want: [f64; 3], tolerance: f64) {
    for c in 0..3 {
        assert!((got[c] - want[c]).abs() <= tolerance, "{got:?} {want:?}");
    }
}

/// RMS difference of a sphere's radiance from the integral, relative to the mean.
pub(super) fn sphere_rms(
    h: &mut Headless,
    material: Material,
    environment: Environment,
    sky: impl Fn(DVec3) -> [f64; 3],
) -> f64 {
    let ball = asset(h, &sphere(96), material.clone());
    let drawables = [Drawable { asset: &ball, instances: &[Placement::default()] }];
    let camera = Pose::look_at(DVec3::new(0.0, 0.0, 3.0), DVec3::ZERO, DVec3::Y, 0.36);
    h.frame(&Frame { environment, settings: bare(), ..Frame::new(camera, &drawables) }).unwrap();
    let (width, height) = h.size();
    let (normals, radiance) = (halves(h, Resource::Normal), halves(h, Resource::Radiance));
    let tan_half_fov: [f64; 2] = camera.tan_half_fov(width, height).into();
    let to_sun = environment.to_sun.normalize().to_array();
    let Sky::Plain(plain) = environment.sky else { panic!("light that is known") };
    let sun = plain.sun.to_array().map(f64::from);
    let (mut squares, mut sum, mut count) = (0.0, 0.0, 0);
    for (i, (stored, got)) in normals.iter().zip(&radiance).enumerate() {
        // Sky has no alpha; at the sphere's edge a pixel is partly sky.
        let pixel = [(i % width as usize) as i64, (i / width as usize) as i64];
        let ray = DVec3::from(view_ray(pixel, [width, height], tan_half_fov)).normalize();
        let normal = from_octahedral([stored[0], stored[1]]);
        if got[3] < 1.0 || -ray.dot(normal.into()) < 0.15 {
            continue;
        }
        let [albedo @ .., _] = material.base_color.map(f64::from);
        let to_eye = (-ray).to_array();
        let (metal, roughness) = (f64::from(material.metallic), f64::from(material.roughness));
        let coat = packed_coat(material.clear_coat) | 0xffff_f000;
        let specular = Specular::of_words([u32::from_le_bytes(material.specular.bytes()), coat]);
        let reflector = Reflector { albedo, metal, roughness, normal, to_eye, specular };
        let from_sun = reflector.from_light(to_sun, sun);
        let from_sky = from_sky(&reflector, 32, |direction| sky(direction.into()));
        for c in 0..3 {
            let want = from_sun[c] + from_sky[c];
            squares += (got[c] - want).powi(2);
            sum += want;
            count += 1;
        }
    }
    assert!(count > 300, "too few pixels: {count}");
    (squares / f64::from(count)).sqrt() / (sum / f64::from(count))
}

#[test]
fn spheres_reflect_as_the_integral_over_all_light_says() {
    let Some(mut h) = headless(32, 32) else { return };
    let even = sky_alone(0.5);
    let sun = of_light(1.0, 0.0);
    println!("metal roughness | sun alone, an even sky: RMS in shares of the mean");
    for metallic in [0.0, 1.0] {
        for roughness in [0.1, 0.3, 0.5, 0.7, 1.0] {
            let material =
                Material { base_color: [0.8, 0.5, 0.2, 1.0], metallic, roughness, ..Material::default() };
            let by_sun = sphere_rms(&mut h, material.clone(), sun, |_| [0.0; 3]);
            let by_sky = sphere_rms(&mut h, material, even, |_| [0.5; 3]);
            println!("{metallic} {roughness} | {by_sun:.4} {by_sky:.4}");
            // For the sun only the 16 bits of stored normals cause errors, mainly in narrow lobes.
            let most = if roughness < 0.2 { 0.12 } else { 0.05 };
            assert!(by_sun < most, "{metallic} {roughness}: {by_sun}");
            assert!(by_sky < 0.1, "{metallic} {roughness}: {by_sky}");
        }
    }
}

#[test]
fn unlit_surfaces_show_their_colour_and_punctual_lights_add_theirs() {
    let Some(mut h) = headless(16, 16) else { return };
    let colour = [0.25, 0.5, 0.75];
    let plain = Material { base_color: opaque(colour), ..Material::default() };
    let punctual_light = Material { emission: [3.0, 0.5, 0.0], ..plain.clone() };
    let unlit = Material { unlit: true, ..punctual_light.clone() };
    let mut shown = Vec::new();
    for material in [plain, punctual_light, unlit] {
        let wall = asset(&h, &square(0.0), material.clone());
        let drawables = [Drawable { asset: &wall, instances: &[Placement::default()] }];
        let passes = draw(&mut h, &drawables, Environment::default());
        assert_eq!(passes.contains(&PassId::Emission), material.emits());
        shown.push(middle(&h, Resource::Radiance));
    }
    let [lit, punctual_light, unlit] = shown[..] else { panic!() };
    close(punctual_light, [lit[0] + 3.0, lit[1] + 0.5, lit[2]], 0.004);
    close(unlit, colour.map(f64::from), 0.004);
}

#[test]
fn surface_maps_set_roughness_metalness_and_occlusion() {
    let Some(mut h) = headless(16, 16) else { return };
    let map = [64, 128, 255, 255].repeat(64);
    let material =
        Material { roughness: 0.8, metallic: 0.5, surface_texture: Some(0), ..Material::default() };
    let wall = textured(&h, &square(0.0), material.clone(), &[(TextureKind::Surface, &map)]);
    let drawables = [Drawable { asset: &wall, instances: &[Placement::default()] }];
    draw(&mut h, &drawables, Environment::default());
    let stored = middle(&h, Resource::Normal);
    assert!((stored[2] - 0.8 * 128.0 / 255.0).abs() < 1e-3, "{stored:?}");
    assert!((stored[3] - 64.0 / 255.0).abs() < 1e-3, "{stored:?}");
    let albedo = h.intermediate(Resource::Albedo, 4).unwrap();
    assert!(albedo[8 * 16 * 4 + 8 * 4 + 3].abs_diff(128) <= 1);
    // Before the texture arrives its mean is used, and its shader variant is not needed.
    let shape = TextureShape { mean: [0.25, 0.5, 1.0], ..TextureShape::full(8, 8, TextureKind::Surface) };
    let mut wall = h.renderer().create_asset(h.gpu(), DVec3::ZERO, &[material], &[shape]);
    fill(&h, &mut wall, &square(0.0));
    let drawables = [Drawable { asset: &wall, instances: &[Placement::default()] }];
    draw(&mut h, &drawables, Environment::default());
    let stored = middle(&h, Resource::Normal);
    assert!((stored[2] - 0.4).abs() < 1e-3 && (stored[3] - 0.25).abs() < 1e-3, "{stored:?}");
}

#[test]
fn normal_maps_tilt_along_u_and_against_the_stored_v() {
    let Some(mut h) = headless(16, 16) else { return };
    let tilt = |x: f64, y: f64| {
        let z = (1.0 - x * x - y * y).sqrt();
        let texel = [x, y, z].map(|c| ((c + 1.0) * 127.5).round() as u8);
        [texel[0], texel[1], texel[2], 255].repeat(64)
    };
    // The square unchanged, with u to the left, and with u and v turned by 90°: mesh, direction of u, direction of v.
    let charts: [(Mesh, DVec3, DVec3); 3] = [
        (square(0.0), DVec3::X, DVec3::Y),
        (mapped(|[u, v]| [1.0 - u, v]), DVec3::NEG_X, DVec3::Y),
        (mapped(|[u, v]| [v, 1.0 - u]), DVec3::Y, DVec3::NEG_X),
    ];
    for (mesh, along_u, along_v) in &charts {
        for (x, y, scale) in [(0.5, 0.0, 1.0), (0.0, 0.6, 1.0), (-0.3, 0.4, 0.5), (0.3, 0.2, 0.0)] {
            let map = tilt(x, y);
            let material =
                Material { normal_texture: Some(0), normal_scale: scale as f32, ..Material::default() };
            let wall = textured(&h, mesh, material, &[(TextureKind::Normal, &map)]);
            let drawables = [Drawable { asset: &wall, instances: &[Placement::default()] }];
            draw(&mut h, &drawables, Environment::default());
            let stored = middle(&h, Resource::Normal);
            let got = DVec3::from(from_octahedral([stored[0], stored[1]]));
            let z = (1.0 - x * x - y * y).sqrt();
            let want = (scale * (x * *along_u + y * *along_v) + z * DVec3::Z).normalize();
            // Two steps of the map's bytes.
            assert!(got.distance(want) < 0.015, "{x} {y} {along_u}: {got} {want}");
        }
    }
}

/// The square with other texture coordinates.
fn mapped(uv: impl Fn([f32; 2]) -> [f32; 2]) -> Mesh {
    let (mut vertices, faces) = square(0.0);
    for vertex in &mut vertices {
        vertex.uv = uv(vertex.uv);
    }
    (vertices, faces)
}

#[test]
fn textures_wrap_as_their_material_says() {
    let Some(mut h) = headless(16, 16) else { return };
    // Columns rise from dark to light.
    let map: Vec<u8> = (0..64).flat_map(|i| [(i % 8 * 32) as u8, 0, 0, 255]).collect();
    let mut shown = |u: f32, wrap| {
        let material = Material {
            base_color: [1.0; 4],
            unlit: true,
            base_color_texture: Some(0),
            wrap: [wrap, Wrap::Repeat],
            ..Material::default()
        };
        let mesh = mapped(|_| [u, 0.5]);
        let wall = textured(&h, &mesh, material, &[(TextureKind::Color, &map)]);
        let drawables = [Drawable { asset: &wall, instances: &[Placement::default()] }];
        draw(&mut h, &drawables, Environment::default());
        middle(&h, Resource::Radiance)[0]
    };
    let (low, high) = (shown(1.5 / 8.0, Wrap::Repeat), shown(6.5 / 8.0, Wrap::Repeat));
    assert!(low < 0.05 && high > 0.4, "{low} {high}");
    let beyond = 1.0 + 1.5 / 8.0;
    assert_eq!(shown(beyond, Wrap::Repeat), low);
    assert_eq!(shown(beyond, Wrap::Mirror), high);
    assert!(shown(beyond, Wrap::Clamp) > high);
}

#[test]
fn holes_show_what_lies_behind_and_let_the_sun_through() {
    let Some(mut h) = headless(64, 64) else { return };
    // The left half is a hole.
    let map: Vec<u8> = (0..64).flat_map(|i| if i % 8 < 4 { [255, 255, 255, 0] } else { [255; 4] }).collect();
    let leaf = Material {
        base_color: [0.0, 1.0, 0.0, 1.0],
        alpha: Alpha::Mask(0.5),
        base_color_texture: Some(0),
        unlit: true,
        ..Material::default()
    };
    let fence = textured(&h, &square(0.0), leaf, &[(TextureKind::Color, &map)]);
    let wall =
        asset(&h, &quad([-3.0, -3.0, -1.0], [6.0, 0.0, 0.0], [0.0, 6.0, 0.0], 1.0), Material::default());
    let drawables = [
        Drawable { asset: &fence, instances: &[Placement::default()] },
        Drawable { asset: &wall, instances: &[Placement::default()] },
    ];
    // The sun stands behind the eye and a little to the right: shadows fall to the left.
    let environment = Environment { to_sun: DVec3::new(0.3, 0.0, 1.0), ..Environment::default() };
    let camera = Pose::look_at(DVec3::new(0.0, 0.0, 4.0), DVec3::ZERO, DVec3::Y, 0.9);
    let settings = Settings { shadows: Settings::default().shadows, ..bare() };
    h.frame(&Frame { environment, settings, ..Frame::new(camera, &drawables) }).unwrap();
    keep(&h, "fence");
    let (width, depths) = (h.size().0, h.depth().unwrap());
    let at = |x: u32, y: u32| (y * width + x) as usize;
    // Depth at the fence and through its hole, left of the middle.
    let behind = Settings::default().near as f32 / 5.0;
    assert!((depths[at(26, 32)] - behind).abs() < behind * 0.01, "{}", depths[at(26, 32)]);
    assert!((depths[at(38, 32)] - behind * 1.25).abs() < behind * 0.01, "{}", depths[at(38, 32)]);
    // On the wall: the sun through the hole reaches further left than the fence's own shadow, seen through the hole.
    let lit = h.intermediate(Resource::Sunlight, 2).unwrap();
    let sunlight = |x: u32| lit[at(x, 32) * 2];
    assert_eq!((sunlight(22), sunlight(30)), (255, 0), "{:?}", (14..34).map(sunlight).collect::<Vec<_>>());
}

#[test]
fn transparent_panes_blend_back_to_front_in_any_order() {
    let Some(mut h) = headless(16, 16) else { return };
    let glass = |[r, g, b]: [f32; 3], opacity| Material {
        base_color: [r, g, b, opacity],
        alpha: Alpha::Blend,
        unlit: true,
        ..Material::default()
    };
    let red = asset(&h, &square(0.2), glass([1.0, 0.0, 0.0], 0.5));
    let blue = asset(&h, &square(-0.2), glass([0.0, 0.0, 1.0], 0.25));
    let hidden = asset(&h, &square(-1.5), glass([1.0; 3], 0.5));
    let wall = asset(
        &h,
        &square(-1.0),
        Material { base_color: [0.0, 1.0, 0.0, 1.0], unlit: true, ..Material::default() },
    );
    let here = [Placement::default()];
    let all = [&red, &blue, &hidden, &wall].map(|asset| Drawable { asset, instances: &here });
    let behind = [0.0, 0.75, 0.25].map(|c: f64| c * 0.5);
    for order in [[0, 1, 2, 3], [3, 2, 1, 0], [1, 3, 0, 2]] {
        let drawables = order.map(|i| all[i]);
        let passes = draw(&mut h, &drawables, Environment::default());
        assert!(passes.contains(&PassId::Transparency));
        close(middle(&h, Resource::Radiance), [behind[0] + 0.5, behind[1], behind[2]], 0.004);
    }
    // The same asset twice, with the far instance first and last in the list.
    for instances in
        [[at(0.0, 0.0, 0.0, 1.0), at(0.0, 0.0, 0.3, 1.0)], [at(0.0, 0.0, 0.3, 1.0), at(0.0, 0.0, 0.0, 1.0)]]
    {
        let drawables = [Drawable { asset: &red, instances: &instances }, all[3]];
        draw(&mut h, &drawables, Environment::default());
        close(middle(&h, Resource::Radiance), [0.75, 0.25, 0.0], 0.004);
    }
}

#[test]
fn transparent_surfaces_are_lit_and_cast_no_shadow() {
    let Some(mut h) = headless(32, 32) else { return };
    let environment = Environment { to_sun: DVec3::Z, ..of_light(0.8, 0.2) };
    let clay = Material { base_color: [0.5, 0.5, 0.5, 1.0], ..Material::default() };
    let wall = asset(&h, &quad([-3.0, -3.0, -1.0], [6.0, 0.0, 0.0], [0.0, 6.0, 0.0], 1.0), clay.clone());
    let (here, mut shown) = ([Placement::default()], Vec::new());
    for (opacity, alpha) in [(1.0, Alpha::Opaque), (1.0, Alpha::Blend), (0.0, Alpha::Blend)] {
        let pane =
            asset(&h, &square(0.0), Material { base_color: [0.5, 0.5, 0.5, opacity], alpha, ..clay.clone() });
        let drawables = [&pane, &wall].map(|asset| Drawable { asset, instances: &here });
        for shadows in [None, Settings::default().shadows] {
            let settings = Settings { shadows, ..bare() };
            h.frame(&Frame { environment, settings, ..Frame::new(front(), &drawables) }).unwrap();
            shown.push(middle(&h, Resource::Radiance));
        }
    }
    // An opaque pane looks like an opaque material; a fully transparent one leaves the wall unchanged.
    let [opaque, .., bare_wall, in_sun] = shown[..] else { panic!() };
    for pane in &shown[..4] {
        close(*pane, [opaque[0], opaque[1], opaque[2]], 0.01);
    }
    close(in_sun, [bare_wall[0], bare_wall[1], bare_wall[2]], 0.01);
    assert!(bare_wall[0] > 0.3, "{bare_wall:?}");
}

#[test]
fn strange_materials_stay_finite() {
    let Some(mut h) = headless(24, 24) else { return };
    let normals = [0, 0, 0, 0].repeat(64);
    for extreme in [0.0, 1.0, 1e30, f32::NAN] {
        for alpha in [Alpha::Opaque, Alpha::Mask(extreme), Alpha::Blend] {
            let material = Material {
                base_color: [extreme.min(1.0), extreme.min(1.0), extreme.min(1.0), extreme],
                alpha,
                roughness: extreme,
                metallic: extreme,
                emission: [extreme.min(65_504.0); 3],
                normal_scale: extreme,
                normal_texture: Some(0),
                ..Material::default()
            };
            let ball = textured(&h, &sphere(12), material.clone(), &[(TextureKind::Normal, &normals)]);
            let drawables = [Drawable { asset: &ball, instances: &[Placement::default()] }];
            h.frame(&Frame::new(front(), &drawables)).unwrap();
            let radiance = halves(&h, Resource::Radiance);
            assert!(radiance.iter().flatten().all(|x| x.is_finite()), "{material:?}");
        }
    }
}

#[test]
fn a_row_of_materials_for_looking_at() {
    let Some(mut h) = headless(640, 360) else { return };
    let gold = Material {
        base_color: [1.0, 0.77, 0.34, 1.0],
        metallic: 1.0,
        roughness: 0.25,
        ..Material::default()
    };
    let mirror = Material {
        base_color: [0.95, 0.95, 0.95, 1.0],
        metallic: 1.0,
        roughness: 0.05,
        ..Material::default()
    };
    let plastic = Material { base_color: [0.7, 0.02, 0.02, 1.0], roughness: 0.2, ..Material::default() };
    let rough = Material { roughness: 0.7, ..gold.clone() };
    let glass = Material {
        base_color: [0.7, 0.9, 1.0, 0.3],
        roughness: 0.05,
        alpha: Alpha::Blend,
        ..Material::default()
    };
    let punctual_light =
        Material { base_color: [0.1, 0.1, 0.1, 1.0], emission: [4.0, 2.0, 0.4], ..Material::default() };
    let unlit = Material { base_color: [0.1, 0.5, 0.9, 1.0], unlit: true, ..Material::default() };
    let lattice = Material {
        base_color: [0.2, 0.5, 0.2, 1.0],
        alpha: Alpha::Mask(0.5),
        base_color_texture: Some(0),
        ..Material::default()
    };
    let bumpy = Material {
        base_color: [0.5, 0.5, 0.5, 1.0],
        roughness: 0.4,
        normal_texture: Some(0),
        ..Material::default()
    };
    let holes: Vec<u8> = (0..1024)
        .flat_map(|i| [255, 255, 255, if (i % 32 / 8 + i / 256) % 2 == 0 { 255 } else { 0 }])
        .collect();
    let bumps: Vec<u8> = (0..1024)
        .flat_map(|i| {
            let slope = |t: usize| f64::from(((t % 16) as f32 / 16.0 * std::f32::consts::TAU).sin() * 0.6);
            let n = DVec3::new(slope(i % 32), slope(i / 32), 1.0).normalize();
            let texel = n.to_array().map(|c| ((c + 1.0) * 127.5) as u8);
            [texel[0], texel[1], texel[2], 255]
        })
        .collect();
    let ball = sphere(48);
    let mut assets: Vec<_> = [gold, rough, mirror, plastic, glass, punctual_light, unlit]
        .map(|material| asset(&h, &ball, material))
        .into();
    assets.push(textured(&h, &ball, lattice, &[(TextureKind::Color, &holes)]));
    assets.push(textured(&h, &ball, bumpy, &[(TextureKind::Normal, &bumps)]));
    let floor = join(&[quad([-6.0, -0.5, 4.0], [12.0, 0.0, 0.0], [0.0, 0.0, -12.0], 1.0)]);
    let floor = asset(&h, &floor, Material { base_color: [0.45, 0.42, 0.4, 1.0], ..Material::default() });
    let places: Vec<_> = (0..assets.len())
        .map(|i| [at(f64::from(i as u32 % 5) * 1.15 - 2.3, 0.0, if i < 5 { -0.7 } else { 0.7 }, 1.0)])
        .collect();
    let mut drawables: Vec<_> =
        assets.iter().zip(&places).map(|(asset, instances)| Drawable { asset, instances }).collect();
    let here = [Placement::default()];
    drawables.push(Drawable { asset: &floor, instances: &here });
    let camera = Pose::look_at(DVec3::new(0.0, 2.2, 5.2), DVec3::new(0.0, -0.1, 0.0), DVec3::Y, 0.55);
    let counters = h.frame(&Frame::new(camera, &drawables)).unwrap();
    keep(&h, "materials");
    assert!(counters.passes.contains(&PassId::Emission) && counters.passes.contains(&PassId::Transparency));
}

/// The faces of a mesh apart, with their own normals.
fn faceted(mesh: &Mesh) -> Mesh {
    let corners = mesh.1.iter().flat_map(|face| {
        let places = face.map(|slot| Vec3::from(mesh.0[slot as usize].position));
        let normal = (places[1] - places[0]).cross(places[2] - places[0]).normalize_or_zero();
        places.map(|place| PackedVertex::new(place.to_array(), normal.to_array(), [0.0; 2]))
    });
    let corners: Vec<_> = corners.collect();
    let faces = (0..mesh.1.len() as u32).map(|face| [0, 1, 2].map(|corner| 3 * face + corner)).collect();
    (corners, faces)
}

#[test]
fn flat_materials_have_the_normals_of_their_faces() {
    let Some(mut h) = headless(96, 96) else { return };
    let ball = sphere(6);
    let apart = faceted(&ball);
    for alpha in [Alpha::Opaque, Alpha::Mask(0.5), Alpha::Blend] {
        let material = Material { alpha, ..Material::default() };
        let flat = asset(&h, &ball, Material { flat: true, ..material.clone() });
        let smooth = asset(&h, &ball, material.clone());
        let wanted = asset(&h, &apart, material);
        // From near and far, turned, and from within.
        let turned = Placement { rotation: [0.2, 0.5, -0.1, 0.8333], ..at(0.0, 0.0, 0.0, 1.0) };
        let views = [
            (1.3, at(0.0, 0.0, 0.0, 1.0)),
            (1.3, turned),
            (1.3e-3, at(0.0, 0.0, 0.0, 1e-3)),
            (1.3e4, at(0.0, 0.0, 0.0, 1e4)),
            (0.1, at(0.0, 0.0, 0.0, 1.0)),
        ];
        for (distance, placement) in views {
            let eye = DVec3::new(0.3, 0.4, 0.85) * distance;
            let mut shown = |asset: &AssetGpu| {
                let drawables = [Drawable { asset, instances: &[placement] }];
                let view = if alpha == Alpha::Blend { DebugView::Material } else { DebugView::Normal };
                let frame = Frame {
                    environment: of_light(2.0, 0.3),
                    settings: Settings { debug_view: view, ..bare() },
                    ..Frame::new(Pose::look_at(eye, DVec3::ZERO, DVec3::Y, 0.9), &drawables)
                };
                h.frame(&frame).unwrap();
                h.picture().unwrap()
            };
            let [flat, smooth, wanted] = [&flat, &smooth, &wanted].map(&mut shown);
            let differ = |a: &image::RgbaImage, b: &image::RgbaImage| {
                let far =
                    |(a, b): (&image::Rgba<u8>, &image::Rgba<u8>)| (0..3).any(|c| a[c].abs_diff(b[c]) > 3);
                a.pixels().zip(b.pixels()).filter(|pair| far(*pair)).count()
            };
            assert!(differ(&flat, &wanted) < 10, "{alpha:?} {distance}: {}", differ(&flat, &wanted));
            assert!(differ(&smooth, &wanted) > 1000, "{alpha:?} {distance}: {}", differ(&smooth, &wanted));
        }
    }
}
