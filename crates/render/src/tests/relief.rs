//! Relief mapping's shaders against their CPU references in f64, and against the surface that a height map describes.

use glam::DVec3;

use super::shapes::{fill, mips16, quad};
use super::{headless, keep};
use crate::cpu_reference::brdf;
use crate::cpu_reference::depth::view_ray;
use crate::cpu_reference::relief::height_maps::bricks;
use crate::cpu_reference::relief::methods::{Method, Prepared};
use crate::cpu_reference::relief::ray::Ray;
use crate::cpu_reference::relief::{ReliefMap, climb, reach, steps};
use crate::frame::graph::Resource;
use crate::{
    AntiAliasing, AssetGpu, Drawable, Environment, Frame, Headless, Instance, Material, Pose, ReliefMethod,
    Settings, Shadows, TextureData, TextureKind, TextureShape, Wrap,
};

/// The unit square in the plane z = 0 under bricks this deep. Its colours say where on it they lie, 256 steps along u and
/// v.
fn wall_of_coordinates(h: &Headless, relief_depth: f32) -> AssetGpu {
    tinted_wall(h, relief_depth, 0)
}

/// The same with so much blue.
fn tinted_wall(h: &Headless, relief_depth: f32, blue: u8) -> AssetGpu {
    const SIZE: u32 = 64;
    let shape = |kind, size| TextureShape::full(size, size, kind);
    let material = Material {
        base_colour: [1.0; 3],
        relief_depth,
        colour_texture: Some(0),
        height_texture: Some(1),
        ..Material::default()
    };
    let shapes = [shape(TextureKind::Colour, 256), shape(TextureKind::Height, SIZE)];
    let mut wall = h.renderer().create_asset(h.gpu(), DVec3::ZERO, &[material], &shapes);
    fill(h, &mut wall, &quad([0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], 1.0));
    for level in 0..shapes[0].levels {
        let (w, rows) = shapes[0].level_size(level);
        // Means of the texels that a coarser one covers.
        let mean = |k: u32, n: u32| (k * (256 / n) + (256 / n - 1) / 2) as u8;
        let texel = |i: u32| [mean(i % w, w), mean(i / w, rows), blue, 255];
        let pixels: Vec<u8> = (0..w * rows).flat_map(texel).collect();
        wall.update_texture(h.gpu(), 0, level, TextureData::Rgba8(&pixels)).unwrap();
    }
    for (level, heights) in mips16(&bricks(SIZE as usize)).iter().enumerate() {
        wall.update_texture(h.gpu(), 1, level as u32, TextureData::R16(heights)).unwrap();
    }
    wall
}

/// A view of the wall from its upper right, at a shallow angle.
fn oblique_view() -> Pose {
    Pose::look_at(DVec3::new(0.9, 0.75, 0.35), DVec3::new(0.45, 0.5, 0.0), DVec3::Y, 0.5)
}

/// A pixel that shows [`wall_of_coordinates`].
struct VisiblePoint {
    /// Its number.
    pixel: usize,
    /// From the eye.
    ray: DVec3,
    /// Where that meets the wall, and the place that is shown there, both in texture coordinates.
    start: [f64; 2],
    place: [f64; 2],
}

impl VisiblePoint {
    /// Whether it shows what is not near the wall's edge.
    fn is_inside(&self) -> bool {
        [self.start, self.place].iter().flatten().all(|x| (0.02..0.98).contains(x))
    }
}

/// What a frame shows of [`wall_of_coordinates`].
fn places(
    h: &mut Headless,
    wall: &AssetGpu,
    camera: Pose,
    settings: Settings,
    environment: Environment,
) -> Vec<VisiblePoint> {
    let drawables = [Drawable { asset: wall, instances: &[Instance::default()] }];
    h.frame(&Frame { settings, environment, ..Frame::new(camera, &drawables) }).unwrap();
    let (width, height) = h.size();
    let covered = h.coverage().unwrap();
    let albedo = h.intermediate(Resource::Albedo, 4).unwrap();
    let (tx, ty) = camera.tan_half_fov(width, height);
    let seen = covered.iter().enumerate().filter(|(_, covered)| **covered).map(|(i, _)| {
        let pixel = [(i % width as usize) as i64, (i / width as usize) as i64];
        let ray = (camera.rotation * DVec3::from(view_ray(pixel, [width, height], [tx, ty]))).normalize();
        let p = camera.eye + ray * (-camera.eye.z / ray.z);
        // Texel centre k holds the value k: undo the half texel. Texture space: v down.
        let place = [0, 1].map(|c| (f64::from(albedo[i * 4 + c]) + 0.5) / 256.0);
        VisiblePoint { pixel: i, ray, start: [p.x, 1.0 - p.y], place }
    });
    seen.collect()
}

#[test]
fn relief_matches_its_cpu_reference_and_the_exact_hit() {
    let Some(mut h) = headless(128, 96) else { return };
    let map = bricks(64);
    // Deep, so that a search without its binary part would be off by more than a colour step.
    let relief_depth = 0.3f32;
    let wall = wall_of_coordinates(&h, relief_depth);
    let camera = oblique_view();
    let (mut n, mut off_cpu_reference, mut off_exact, mut moved) = (0, 0, 0, 0);
    for VisiblePoint { ray, start, place: got, .. } in
        places(&mut h, &wall, camera, Settings::default(), Environment::default())
    {
        let cosine = -ray.z;
        let reach = reach(f64::from(relief_depth), cosine);
        let span = [ray.x * reach, -ray.y * reach];
        let uv = |s: f64| [0, 1].map(|a| start[a] + span[a] * s);
        let traced = uv(map.trace(start, span, steps(Settings::default().relief_steps, cosine)));
        let exact = uv(map.intersect(start, span));
        let inside = |q: [f64; 2]| q.iter().all(|x| (0.02..0.98).contains(x));
        if !inside(got) || !inside(traced) || !inside(exact) {
            continue;
        }
        let apart = |a: [f64; 2]| (a[0] - got[0]).hypot(a[1] - got[1]);
        n += 1;
        // Two steps of the 8-bit coordinates.
        off_cpu_reference += usize::from(apart(traced) > 2.0 / 256.0);
        off_exact += usize::from(apart(exact) > 2.5 / 256.0);
        moved += usize::from(apart(start) > 4.0 / 256.0);
    }
    keep(&h, "relief-accuracy");
    assert!(n > 3000, "only {n} pixels to compare");
    assert!(moved * 4 > n, "relief moved only {moved} of {n} pixels");
    assert!(off_cpu_reference * 500 < n, "{off_cpu_reference} of {n} pixels off the CPU reference");
    // Linear steps jump over some crests, which this deep a relief has at every joint.
    assert!(off_exact * 20 < n, "{off_exact} of {n} pixels off the exact hit");
}

#[test]
fn the_quadtree_draws_the_exact_hit_where_equal_steps_jump_over_crests() {
    let Some(mut h) = headless(128, 96) else { return };
    let map = bricks(64);
    let depth = 0.3;
    let wall = wall_of_coordinates(&h, depth as f32);
    let camera = oblique_view();
    let mut off = |relief_method| {
        let settings = Settings { relief_method, relief_steps: 64, ..Settings::default() };
        let (mut off, mut n) = (0, 0);
        for VisiblePoint { ray, start, place: got, .. } in
            places(&mut h, &wall, camera, settings, Environment::default())
        {
            let reach = reach(depth, -ray.z);
            let span = [ray.x * reach, -ray.y * reach];
            let s = map.intersect(start, span);
            let exact = [0, 1].map(|a| start[a] + span[a] * s);
            if [got, exact].iter().flatten().all(|x| (0.02..0.98).contains(x)) {
                n += 1;
                off += usize::from((exact[0] - got[0]).hypot(exact[1] - got[1]) > 2.5 / 256.0);
            }
        }
        assert!(n > 3000, "only {n} pixels to compare");
        off
    };
    let [quadtree, cones, steps] =
        [ReliefMethod::Quadtree, ReliefMethod::RelaxedCones, ReliefMethod::Relief].map(&mut off);
    assert!(
        quadtree * 4 < steps && cones < steps,
        "{quadtree}, {cones} and {steps} pixels off the exact hit"
    );
}

#[test]
fn acceleration_textures_exist_for_repeating_maps_only() {
    let Some(mut h) = headless(96, 72) else { return };
    let gpu = h.gpu().clone();
    let mut wall = wall_of_coordinates(&h, 0.15);
    let near = oblique_view();
    // More than a texel of the height map a pixel.
    let far = Pose::look_at(DVec3::new(4.0, 0.75, 3.0), DVec3::new(0.5, 0.5, 0.0), DVec3::Y, 0.9);
    let mut picture = |wall: &AssetGpu, camera, relief_method| {
        let drawables = [Drawable { asset: wall, instances: &[Instance::default()] }];
        let settings = Settings { relief_method, relief_steps: 12, ..Settings::default() };
        h.frame(&Frame { settings, ..Frame::new(camera, &drawables) }).unwrap();
        h.picture().unwrap()
    };
    let before = picture(&wall, near, ReliefMethod::Relief);
    for way in [ReliefMethod::RelaxedCones, ReliefMethod::Quadtree] {
        assert!(picture(&wall, near, way) != before, "{}", way.name());
        assert!(picture(&wall, far, way) == picture(&wall, far, ReliefMethod::Relief), "{}", way.name());
        assert!(picture(&wall, near, ReliefMethod::Relief) == before, "after {}", way.name());
    }
    let material = Material {
        base_colour: [1.0; 3],
        relief_depth: 0.15,
        colour_texture: Some(0),
        height_texture: Some(1),
        wrap: [Wrap::Clamp, Wrap::Repeat],
        ..Material::default()
    };
    wall.set_material(&gpu, 0, material).unwrap();
    let clamped = picture(&wall, near, ReliefMethod::Relief);
    for way in [ReliefMethod::RelaxedCones, ReliefMethod::Quadtree] {
        assert!(picture(&wall, near, way) == clamped, "{}", way.name());
    }
}

#[test]
fn each_relief_method_matches_its_cpu_reference() {
    let Some(mut h) = headless(128, 96) else { return };
    let map = Prepared::new(bricks(64));
    let depth = 0.15;
    let wall = wall_of_coordinates(&h, depth as f32);
    let camera = oblique_view();
    // Few enough that terraces are wider than a step of the colours.
    let relief_steps = 12;
    for way in ReliefMethod::ALL {
        let cpu_reference = match way {
            ReliefMethod::Parallax => Method::Parallax,
            ReliefMethod::SteepParallax => Method::SteepParallax,
            ReliefMethod::ParallaxOcclusion => Method::ParallaxOcclusion,
            ReliefMethod::Relief => Method::Relief,
            ReliefMethod::RelaxedCones => Method::RelaxedConeStepping,
            ReliefMethod::Quadtree => Method::Quadtree,
        };
        let settings = Settings { relief_method: way, relief_steps, ..Settings::default() };
        let seen = places(&mut h, &wall, camera, settings, Environment::default());
        keep(&h, &format!("relief-way-{}", way.name()));
        // Off each CPU reference, its own first.
        let mut off =
            [(cpu_reference, 0), (Method::None, 0), (Method::SteepParallax, 0), (Method::Relief, 0)];
        let mut n = 0;
        for VisiblePoint { ray, start, place: got, .. } in seen {
            let cosine = -ray.z;
            let reach = reach(depth, cosine);
            let ray = Ray { start, span: [ray.x * reach, -ray.y * reach], cosine };
            // A limited offset is divided by the whole way, which the CPU reference's ray is for less.
            let ray_of = |method| match method {
                Method::Parallax => Ray { cosine: depth / reach, ..ray },
                _ => ray,
            };
            let places = off.map(|(method, _)| {
                let ray = ray_of(method);
                // Up and down the six levels over the finest comes on top.
                let levels = if method == Method::Quadtree { 12 } else { 0 };
                ray.at(method.find(&map, &ray, steps(relief_steps, cosine) + levels).at)
            });
            let inside = |q: &[f64; 2]| q.iter().all(|x| (0.02..0.98).contains(x));
            if !inside(&got) || !places.iter().all(inside) {
                continue;
            }
            n += 1;
            for (off, place) in off.iter_mut().zip(places) {
                off.1 += usize::from((place[0] - got[0]).hypot(place[1] - got[1]) > 2.0 / 256.0);
            }
        }
        assert!(n > 3000, "only {n} pixels to compare");
        assert!(off[0].1 * 100 < n, "{}: {} of {n} pixels off the CPU reference", way.name(), off[0].1);
        for (other, off) in &off[1..] {
            assert!(
                *other == cpu_reference || off * 25 > n,
                "{} draws {}: {off} of {n} differ",
                way.name(),
                other.name()
            );
        }
    }
}

#[test]
fn bricks_do_not_swim_at_grazing_angles() {
    let Some(mut h) = headless(160, 120) else { return };
    let depth = 0.04;
    let wall = wall_of_coordinates(&h, depth as f32);
    let middle = DVec3::new(0.5, 0.5, 0.0);
    for degrees in [30.0, 55.0, 70.0, 80.0, 86.0_f64] {
        let (sine, cosine) = degrees.to_radians().sin_cos();
        let camera = Pose::look_at(middle + DVec3::new(sine, 0.0, cosine) * 4.0, middle, DVec3::Y, 0.2);
        let seen = places(&mut h, &wall, camera, Settings::default(), Environment::default());
        keep(&h, &format!("relief-{degrees}"));
        let far = |[x, y]: &[f64; 2]| (0.3..0.7).contains(x) && (0.3..0.7).contains(y);
        let shifts: Vec<f64> = seen
            .iter()
            .filter(|seen| far(&seen.start))
            .map(|VisiblePoint { start, place, .. }| (place[0] - start[0]).hypot(place[1] - start[1]) / depth)
            .collect();
        let most = shifts.iter().fold(0.0_f64, |a, b| a.max(*b));
        let mean = shifts.iter().sum::<f64>() / shifts.len() as f64;
        println!("{degrees}: along the wall by {mean:.2} depths in the mean, {most:.2} at most");
        // A step of the colours, and what a footprint of them is rounded to.
        let rounding = 1.5 / 256.0 / depth;
        assert!(
            shifts.len() > 100 && most < degrees.to_radians().tan().min(2.0) + rounding,
            "{degrees}: {most}"
        );
    }
}

/// IEEE 754 binary16 to f64.
fn half(bits: u16) -> f64 {
    let (exponent, fraction) = (i32::from(bits >> 10 & 31), f64::from(bits & 1023) / 1024.0);
    let size =
        if exponent == 0 { fraction * 2f64.powi(-14) } else { (1.0 + fraction) * 2f64.powi(exponent - 15) };
    if bits >> 15 == 1 { -size } else { size }
}

#[test]
fn relief_self_shadowing_matches_its_cpu_reference() {
    let Some(mut h) = headless(128, 96) else { return };
    let map = bricks(64);
    let depth = 0.1;
    let wall = wall_of_coordinates(&h, depth as f32);
    let camera = Pose::look_at(DVec3::new(0.5, 0.45, 0.9), DVec3::new(0.5, 0.5, 0.0), DVec3::Y, 0.6);
    for sun in [DVec3::new(0.6, 0.5, 0.4), DVec3::new(-0.7, 0.3, 0.9)] {
        let sun = sun.normalize();
        let environment = Environment { to_sun: sun, ..Environment::default() };
        let mut frames = [false, true].map(|relief_shadows| {
            let usual = Settings { shadows: None, occlusion: None, ..Settings::default() };
            let settings = Settings { relief_shadows, anti_aliasing: AntiAliasing::None, ..usual };
            let seen = places(&mut h, &wall, camera, settings, environment);
            keep(&h, if relief_shadows { "relief-shadows" } else { "relief-no-shadows" });
            let normals: Vec<half::f16> =
                bytemuck::pod_collect_to_vec(&h.intermediate(Resource::Normal, 8).unwrap());
            (seen, normals, h.picture().unwrap())
        });
        let [(_, open, bright), (seen, normals, picture)] = &mut frames;
        assert!(open.chunks(4).all(|texel| texel[3].to_f32() >= 0.0), "off, nothing is marked");
        let (mut n, mut dark, mut off_cpu_reference, mut off_truth) = (0, 0, 0, 0);
        for VisiblePoint { pixel, place, .. } in seen.iter().filter(|seen| seen.is_inside()) {
            let hidden = normals[pixel * 4 + 3].to_f32() < 0.0;
            let climb = climb(depth, [sun.x, -sun.y], sun.z);
            n += 1;
            dark += usize::from(hidden);
            off_cpu_reference += usize::from(hidden == map.sunlit(*place, climb, steps(48, sun.z)));
            off_truth += usize::from(hidden == map.sunlit(*place, climb, 2000));
            let (x, y) = ((pixel % 128) as u32, (pixel / 128) as u32);
            let darker = picture.get_pixel(x, y)[0] < bright.get_pixel(x, y)[0];
            assert!(hidden || !darker, "{x}, {y} is darker in the sun");
        }
        assert!(n > 3000 && dark * 20 > n, "{dark} of {n} pixels are hidden from {sun}");
        // Places are known to a step of 8 bits.
        assert!(off_cpu_reference * 25 < n, "{off_cpu_reference} of {n} pixels off the CPU reference");
        assert!(off_truth * 20 < n, "{off_truth} of {n} pixels off what the surface hides");
    }
}

/// Where a ray from `eye` first meets the bricks of a wall whose surface lies at `z`, moved by `by` along it: how far away,
/// unless it misses the middle of the wall.
fn far_to(map: &ReliefMap, depth: f64, (eye, ray): (DVec3, DVec3), z: f64, by: [f64; 2]) -> Option<f64> {
    let p = eye + ray * ((z - eye.z) / ray.z);
    let start = [p.x - by[0], 1.0 - (p.y - by[1])];
    let reach = depth / -ray.z;
    let span = [ray.x * reach, -ray.y * reach];
    let s = map.intersect(start, span);
    let inside = |at: f64| [0, 1].iter().all(|k| (0.05..0.95).contains(&(start[*k] + span[*k] * at)));
    (inside(0.0) && inside(s)).then(|| (p - eye).length() + reach * s)
}

#[test]
fn relief_depth_intersects_objects_correctly() {
    let Some(mut h) = headless(128, 96) else { return };
    let map = bricks(64);
    let depth = 0.12;
    let wall = wall_of_coordinates(&h, depth as f32);
    let other = tinted_wall(&h, depth as f32, 255);
    let flat = Material { base_colour: [0.0, 0.0, 1.0], ..Material::default() };
    let mut pane = h.renderer().create_asset(h.gpu(), DVec3::ZERO, &[flat], &[]);
    fill(&h, &mut pane, &quad([0.0, 0.0, -0.06], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], 1.0));
    let camera = Pose::look_at(DVec3::new(0.8, 0.65, 0.9), DVec3::new(0.5, 0.5, 0.0), DVec3::Y, 0.6);
    let by = [0.07, 0.09];
    let moved = Instance { translation: DVec3::new(by[0], by[1], -0.05), ..Instance::default() };
    let still = [Instance::default()];
    let placed = [moved];
    let of_wall = Drawable { asset: &wall, instances: &still };
    // How far away along a ray from the eye.
    type Far<'a> = &'a dyn Fn(DVec3) -> Option<f64>;
    let crossing: [(&str, Drawable<'_>, Far<'_>); 2] = [
        ("a pane", Drawable { asset: &pane, instances: &still }, &|ray| Some((-0.06 - camera.eye.z) / ray.z)),
        ("a relief", Drawable { asset: &other, instances: &placed }, &|ray| {
            far_to(&map, depth, (camera.eye, ray), -0.05, by)
        }),
    ];
    for (name, drawable, far_to_other) in crossing {
        let drawables = [of_wall, drawable];
        for relief_method in [ReliefMethod::Relief, ReliefMethod::RelaxedCones, ReliefMethod::Quadtree] {
            let mut other_shown = [0, 0];
            for relief_in_depth in [false, true] {
                let usual = Settings { shadows: None, occlusion: None, ..Settings::default() };
                let settings = Settings { relief_in_depth, relief_method, ..usual };
                h.frame(&Frame { settings, ..Frame::new(camera, &drawables) }).unwrap();
                let file = format!("relief-crosses-{}-{}", name.replace(' ', "-"), relief_method.name());
                keep(&h, &file);
                let albedo = h.intermediate(Resource::Albedo, 4).unwrap();
                let stored = h.depth().unwrap();
                let (tx, ty) = camera.tan_half_fov(128, 96);
                let (mut n, mut wrong, mut off) = (0, 0, 0);
                for (i, texel) in albedo.chunks(4).enumerate() {
                    let pixel = [(i % 128) as i64, (i / 128) as i64];
                    let ahead = DVec3::from(view_ray(pixel, [128, 96], [tx, ty]));
                    let ray = (camera.rotation * ahead).normalize();
                    let far = far_to(&map, depth, (camera.eye, ray), 0.0, [0.0; 2]);
                    let (Some(far), Some(other)) = (far, far_to_other(ray)) else { continue };
                    n += 1;
                    let shown = texel[2] > 128;
                    other_shown[usize::from(relief_in_depth)] += usize::from(shown);
                    wrong += usize::from(shown != (other < far));
                    let want = settings.near * ahead.length() / far.min(other);
                    off += usize::from((f64::from(stored[i]) / want - 1.0).abs() > 5e-3);
                }
                assert!(n > 3000, "only {n} pixels to compare");
                if relief_in_depth {
                    let way = relief_method.name();
                    assert!(wrong * 30 < n && off * 20 < n, "{name}, {way}: {wrong}, {off} of {n} wrong");
                }
            }
            let [before, crossed] = other_shown;
            assert!(before == 0 && crossed > 1000, "{name} shows in {before}, then in {crossed} pixels");
        }
    }
}

#[test]
fn relief_in_depth_does_not_lie_in_the_shadow_of_its_own_surface() {
    let Some(mut h) = headless(96, 72) else { return };
    let wall = wall_of_coordinates(&h, 0.1);
    let drawables = [Drawable { asset: &wall, instances: &[Instance::default()] }];
    let camera = Pose::look_at(DVec3::new(0.5, 0.45, 0.9), DVec3::new(0.5, 0.5, 0.0), DVec3::Y, 0.6);
    for to_sun in [DVec3::new(0.3, 0.4, 0.9), DVec3::new(-0.8, 0.3, 0.4)] {
        let environment = Environment { to_sun, ..Environment::default() };
        let mut sum = |shadows: Option<Shadows>| {
            let usual = Settings { occlusion: None, relief_in_depth: true, ..Settings::default() };
            h.frame(&Frame {
                environment,
                settings: Settings { shadows, ..usual },
                ..Frame::new(camera, &drawables)
            })
            .unwrap();
            h.picture().unwrap().pixels().map(|pixel| u64::from(pixel[0])).sum::<u64>() as f64
        };
        let ratio = sum(Some(Shadows::default())) / sum(None);
        assert!(ratio > 0.97, "{to_sun}: {ratio} of the light");
    }
}

#[test]
fn relief_normals_follow_the_height_map_on_any_placement() {
    const SIZE: u32 = 64;
    let (width, height) = (64, 64);
    let Some(mut h) = headless(width, height) else { return };
    let depth = 0.25;
    let material = Material { relief_depth: depth as f32, height_texture: Some(0), ..Material::default() };
    let shape = TextureShape { levels: 1, ..TextureShape::full(SIZE, SIZE, TextureKind::Height) };
    // Heights rise to the right, or downwards in the picture (v up: they fall with v).
    for (direction, want) in [(0, [-depth, 0.0, 1.0]), (1, [0.0, depth, 1.0])] {
        let ramp = |i: u32| (if direction == 0 { i % SIZE } else { i / SIZE }) * 65_535 / SIZE;
        let heights: Vec<u16> = (0..SIZE * SIZE).map(|i| ramp(i) as u16).collect();
        let mut wall = h.renderer().create_asset(h.gpu(), DVec3::ZERO, &[material], &[shape]);
        fill(&h, &mut wall, &quad([-0.5, -0.5, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], 1.0));
        wall.update_texture(h.gpu(), 0, 0, TextureData::R16(&heights)).unwrap();
        for instance in [
            Instance::default(),
            Instance {
                translation: DVec3::new(100.0, -3.0, 7.0),
                rotation: glam::DQuat::from_axis_angle(DVec3::new(1.0, 2.0, -0.5).normalize(), 1.1),
                scale: 3.0,
            },
        ] {
            let drawables = [Drawable { asset: &wall, instances: &[instance] }];
            let eye = instance.to_world(DVec3::new(0.2, -0.1, 1.3));
            let up = instance.rotation * DVec3::Y;
            let camera = Pose::look_at(eye, instance.to_world(DVec3::ZERO), up, 0.25);
            h.frame(&Frame::new(camera, &drawables)).unwrap();
            let normals = h.intermediate(Resource::Normal, 8).unwrap();
            let pixel = &normals[((height / 2 * width + width / 2) * 8) as usize..];
            let stored = [0, 1].map(|c| half(u16::from_le_bytes([pixel[2 * c], pixel[2 * c + 1]])));
            let got = brdf::from_octahedral(stored);
            let want = instance.rotation * DVec3::from(want).normalize();
            assert!((DVec3::from(got) - want).length() < 0.01, "{direction}: {got:?} {want}");
        }
    }
}
