//! Shadow maps and sunlight against rays, and their effect on the picture.

use std::io::Write;

use glam::{DQuat, DVec3};
use half::f16;

use super::shapes::{Mesh, asset, at, cube, quad, sphere};
use super::{headless, keep};
use crate::cpu_reference::depth::view_ray;
use crate::cpu_reference::surface::DepthPicture;
use crate::cpu_reference::{brdf, sunlight};
use crate::frame::graph::Resource;
use crate::image_compare::compare;
use crate::passes::shadows::map_from_world;
use crate::resources::readback::read_texture;
use crate::{
    AntiAliasing, AssetGpu, DebugView, Drawable, Environment, Frame, Headless, Material, Placement, Pose,
    Settings, Shadows,
};

/// Objects on a floor, in the sun: a cube, a ball, a floating board, and a wall.
struct Yard {
    meshes: Vec<(Mesh, Vec<Placement>)>,
    to_sun: DVec3,
}

impl Yard {
    fn new(to_sun: DVec3) -> Self {
        let turned =
            Placement { rotation: glam::Quat::from_rotation_y(0.5).into(), ..at(-0.8, 0.5, 0.2, 1.0) };
        let floor = quad([-8.0, 0.0, 8.0], [16.0, 0.0, 0.0], [0.0, 0.0, -16.0], 1.0);
        let board = quad([-0.4, 0.0, 0.3], [0.8, 0.0, 0.0], [0.0, 0.0, -0.6], 1.0);
        let wall = quad([-3.0, 0.0, -1.5], [6.0, 0.0, 0.0], [0.0, 2.0, 0.0], 1.0);
        let meshes = vec![
            (cube(), vec![turned, at(2.0, 0.1, 0.9, 0.2)]),
            (sphere(24), vec![at(0.6, 0.4, 0.3, 0.8)]),
            (floor, vec![Placement::default()]),
            (board, vec![at(1.4, 0.9, 0.2, 1.0)]),
            (wall, vec![Placement::default()]),
        ];
        Self { meshes, to_sun }
    }

    /// The same, scaled and moved.
    fn scaled(mut self, scale: f64, offset: DVec3) -> Self {
        for instance in self.meshes.iter_mut().flat_map(|(_, instances)| instances) {
            instance.translation = (offset + DVec3::from(instance.translation) * scale).into();
            instance.scale *= scale as f32;
        }
        self
    }

    fn draw<R>(&self, h: &mut Headless, run: impl FnOnce(&mut Headless, &[Drawable<'_>]) -> R) -> R {
        let clay = Material { base_color: [0.6, 0.5, 0.42, 1.0], ..Material::default() };
        let assets: Vec<_> = self.meshes.iter().map(|(mesh, _)| asset(h, mesh, clay.clone())).collect();
        let drawables: Vec<_> = assets
            .iter()
            .zip(&self.meshes)
            .map(|(asset, (_, instances))| Drawable { asset, instances })
            .collect();
        run(h, &drawables)
    }

    fn frame<'a>(&self, camera: Pose, drawables: &'a [Drawable<'a>], shadows: Shadows) -> Frame<'a> {
        let environment = Environment { to_sun: self.to_sun, ..Environment::default() };
        let settings =
            Settings { shadows: Some(shadows), anti_aliasing: AntiAliasing::None, ..Settings::default() };
        Frame { environment, settings, ..Frame::new(camera, drawables) }
    }
}

fn camera() -> Pose {
    Pose::look_at(DVec3::new(1.6, 1.5, 3.4), DVec3::new(0.1, 0.5, 0.0), DVec3::Y, 0.75)
}

const SUN: DVec3 = DVec3::new(0.55, 0.75, 0.45);

/// Triangles in the world, relative to the eye, and a sphere around them: centre and radius.
type Body = (DVec3, f64, Vec<[DVec3; 3]>);

/// Everything that rays may meet.
struct Solid(Vec<Body>);

impl Solid {
    fn new(yard: &Yard, eye: DVec3) -> Self {
        let placed = yard.meshes.iter().flat_map(|((vertices, faces), instances)| {
            instances.iter().map(move |instance| {
                let at = |i: &u32| {
                    let position = vertices[*i as usize].position.map(f64::from);
                    instance.to_world(DVec3::from(position)) - eye
                };
                let middle = instance.to_world(DVec3::ZERO) - eye;
                let triangles: Vec<_> = faces.iter().map(|face| face.each_ref().map(at)).collect();
                let radius = triangles.iter().flatten().map(|corner| corner.distance(middle));
                (middle, radius.fold(0.0, f64::max), triangles)
            })
        });
        Self(placed.collect())
    }

    /// Where a ray first meets a triangle (Möller and Trumbore, 1997): distance in lengths of `along`, and its normal
    /// towards the ray's origin.
    fn hit(&self, from: DVec3, along: DVec3, least: f64) -> Option<(f64, DVec3)> {
        let of = |[a, b, c]: &[DVec3; 3]| {
            let (ab, ac) = (*b - *a, *c - *a);
            let p = along.cross(ac);
            let determinant = ab.dot(p);
            if determinant == 0.0 {
                return None;
            }
            let u = (from - *a).dot(p) / determinant;
            let q = (from - *a).cross(ab);
            let v = along.dot(q) / determinant;
            let t = ac.dot(q) / determinant;
            let inside = u >= 0.0 && v >= 0.0 && u + v <= 1.0 && t > least;
            inside.then(|| {
                let normal = ab.cross(ac).normalize();
                (t, if normal.dot(along) > 0.0 { -normal } else { normal })
            })
        };
        let met = |(middle, radius, _): &&Body| {
            let nearest = (*middle - from).dot(along) / along.length_squared();
            (from + along * nearest.max(0.0)).distance(*middle) <= radius * (1.0 + 1e-9)
        };
        let hits = self.0.iter().filter(met).flat_map(|(.., triangles)| triangles).filter_map(of);
        hits.min_by(|a, b| a.0.total_cmp(&b.0))
    }
}

/// A picture's sunlight compared with rays.
#[derive(Debug, Default)]
struct ShadowErrors {
    pixels: usize,
    /// Pixels that are mostly lit although the ray is blocked, or mostly dark although it is not.
    wrong: usize,
    /// Pixels that are shown darker although all rays within a lookup's reach are free.
    acne: usize,
    /// Pixels that are shown lit although all rays within a lookup's reach are blocked.
    leaks: usize,
}

/// Casts rays through all pixels and on to the sun, and compares them with the picture's sunlight.
fn compare_with_rays(h: &Headless, yard: &Yard, camera: Pose, shadows: Shadows) -> ShadowErrors {
    let solid = Solid::new(yard, camera.eye);
    let (width, height) = h.size();
    let (tx, ty) = camera.tan_half_fov(width, height);
    let lit = h.intermediate(Resource::Sunlight, 2).unwrap();
    let (_, drawn) = h.renderer().shadow_maps().drawn().unwrap();
    let texel = drawn[0].0.side / f64::from(shadows.map_side);
    let sun = yard.to_sun.normalize();
    let (x, y) = sun.any_orthonormal_pair();
    let mut errors = ShadowErrors::default();
    for (i, lit) in lit.chunks(2).enumerate() {
        let pixel = [(i % width as usize) as i64, (i / width as usize) as i64];
        let along = camera.rotation * DVec3::from(view_ray(pixel, [width, height], [tx, ty]));
        let Some((t, normal)) = solid.hit(DVec3::ZERO, along, 0.0) else { continue };
        let at = along * t;
        // Starts in the surface's plane, at a distance above rounding errors.
        let reaches = |offset: DVec3| {
            let at = at + offset - sun * (offset.dot(normal) / sun.dot(normal));
            normal.dot(sun) > 0.0 && solid.hit(at + normal * (1e-9 * t), sun, 1e-6 * t).is_none()
        };
        let lit = f64::from(lit[0]) / 255.0;
        let truth = reaches(DVec3::ZERO);
        errors.pixels += 1;
        errors.wrong += usize::from((lit > 0.5) != truth);
        let reach = 1.5 * texel * sunlight::reach(shadows.filter);
        let around = [(1.0, 0.0), (-1.0, 0.0), (0.0, 1.0), (0.0, -1.0), (0.7, 0.7), (-0.7, 0.7)];
        if normal.dot(sun) > 1e-3 && around.iter().all(|(a, b)| reaches((x * *a + y * *b) * reach) == truth) {
            errors.acne += usize::from(truth && lit < 0.98);
            errors.leaks += usize::from(!truth && lit > 0.02);
        }
    }
    errors
}

/// Draws a yard and compares its shadows with rays.
fn draw_and_compare(h: &mut Headless, yard: &Yard, camera: Pose, shadows: Shadows) -> ShadowErrors {
    yard.draw(h, |h, drawables| {
        h.frame(&yard.frame(camera, drawables, shadows)).unwrap();
        compare_with_rays(h, yard, camera, shadows)
    })
}

#[test]
fn shadows_for_looking_at() {
    let Some(mut h) = headless(320, 180) else { return };
    let yard = Yard::new(SUN);
    yard.draw(&mut h, |h, drawables| {
        let frame = yard.frame(camera(), drawables, Shadows::default());
        h.frame(&frame).unwrap();
        keep(h, "shadows");
        let dark = h.picture().unwrap();
        let with = |settings| Frame { settings, ..frame };
        h.frame(&with(Settings { debug_view: DebugView::Cascade, ..frame.settings })).unwrap();
        keep(h, "shadows-cascades");
        let coloured = compare(&dark, &h.picture().unwrap(), None).unwrap();
        assert!(coloured.mean_difference > 10.0, "{coloured:?}");
        h.frame(&with(Settings { shadows: None, ..frame.settings })).unwrap();
        // Shadows only darken, and here they do.
        let bright = h.picture().unwrap();
        let all = || dark.pixels().zip(bright.pixels());
        assert!(all().all(|(with, without)| (0..3).all(|c| with[c] <= without[c] + 1)));
        let darker = all().filter(|(with, without)| with[0] + 30 < without[0]).count();
        assert!(darker > 400, "{darker} pixels are in shadow");
    });
}

/// The share of pixels on the wrong side of a shadow's edge, and errors beyond a lookup's reach. These remain at
/// silhouettes, where depth does not give the normal, and because facets are lit as flat.
#[test]
fn shadows_match_ray_casting() {
    let Some(mut h) = headless(160, 90) else { return };
    let mut say = std::io::stderr();
    for (sun, most) in [
        (SUN, 0.006),
        (DVec3::new(0.9, 0.2, 0.4), 0.012),
        (DVec3::new(-0.5, 0.4, -0.9), 0.003),
        // A sun just above the floor.
        (DVec3::new(1.0, 0.02, 0.3), 0.01),
    ] {
        for (filter, map_side) in [(1, 512), (1, 2048), (2, 1024), (2, 2048), (3, 2048)] {
            let shadows = Shadows { filter, map_side, ..Shadows::default() };
            let found = draw_and_compare(&mut h, &Yard::new(sun), camera(), shadows);
            let wrong = found.wrong as f64 / found.pixels as f64;
            writeln!(
                say,
                "sun {sun}, filter {filter}, {map_side} texels: {:.2} % wrong, {found:?}",
                100.0 * wrong
            )
            .unwrap();
            let coarser = 2048.0 / f64::from(map_side);
            assert!(wrong <= most * coarser, "{sun} {shadows:?}: {found:?}");
            assert!(found.acne * 400 <= found.pixels, "{sun} {shadows:?}: {found:?}");
            assert!(found.leaks * 4000 <= found.pixels, "{sun} {shadows:?}: {found:?}");
        }
    }
}

#[test]
fn shadows_are_as_good_at_any_scale_and_anywhere() {
    let Some(mut h) = headless(160, 90) else { return };
    let earth = DVec3::new(6.371e6, -2e5, 3.3e6);
    for (scale, offset) in [(1e-3, DVec3::ZERO), (1e3, DVec3::ZERO), (1.0, earth), (1e3, earth)] {
        let yard = Yard::new(SUN).scaled(scale, offset);
        let near = camera();
        let camera = Pose { eye: offset + near.eye * scale, ..near };
        let found = draw_and_compare(&mut h, &yard, camera, Shadows::default());
        assert!(found.pixels > 10_000, "{scale} {offset}: {found:?}");
        assert!(found.wrong * 150 <= found.pixels, "{scale} {offset}: {found:?}");
        assert!(found.acne * 400 <= found.pixels, "{scale} {offset}: {found:?}");
    }
}

/// The maps of the last frame as the CPU reference reads them, from `eye`.
fn maps<R>(h: &Headless, eye: DVec3, shadows: Shadows, read: impl FnOnce(&[sunlight::Map<'_>]) -> R) -> R {
    let (texture, drawn) = h.renderer().shadow_maps().drawn().unwrap();
    let stored: Vec<f32> = bytemuck::pod_collect_to_vec(&read_texture(h.gpu(), texture, 4).unwrap());
    let layer = (texture.width() * texture.height()) as usize;
    let maps = drawn.iter().zip(stored.chunks(layer)).map(|((cascade, top), stored)| sunlight::Map {
        stored,
        map_from_world: map_from_world(cascade, *top, eye),
        texel: cascade.side / f64::from(shadows.map_side),
    });
    read(&maps.collect::<Vec<_>>())
}

#[test]
fn sunlight_matches_its_cpu_reference() {
    let Some(mut h) = headless(160, 90) else { return };
    let yard = Yard::new(DVec3::new(0.9, 0.2, 0.4));
    let shadows = Shadows { map_side: 256, filter: 3, ..Shadows::default() };
    yard.draw(&mut h, |h, drawables| {
        let frame = yard.frame(camera(), drawables, shadows);
        h.frame(&frame).unwrap();
        let (depth, lit) = (h.depth().unwrap(), h.intermediate(Resource::Sunlight, 2).unwrap());
        let normals: Vec<f16> = bytemuck::pod_collect_to_vec(&h.intermediate(Resource::Normal, 8).unwrap());
        let (width, height) = h.size();
        let (tx, ty) = camera().tan_half_fov(width, height);
        let (size_px, near) = ([width, height], frame.settings.near);
        let picture = DepthPicture { stored: &depth, size_px, tan_half_fov: [tx, ty], near };
        let (mut sum, mut different, mut dark) = (0.0, 0, 0);
        maps(h, camera().eye, shadows, |maps| {
            for (i, lit) in lit.chunks(2).enumerate() {
                let pixel = [(i % width as usize) as i64, (i / width as usize) as i64];
                let lit_by =
                    DVec3::from(brdf::from_octahedral([0, 1].map(|c| f64::from(normals[4 * i + c]))));
                let sun = (camera().rotation, yard.to_sun);
                let want = sunlight::sunlight(&picture, pixel, sun, lit_by, maps, 3);
                let difference = (f64::from(lit[0]) / 255.0 - want).abs();
                sum += difference;
                // Comparisons of nearly equal numbers may be rounded to either side in f32.
                different += usize::from(difference > 0.02);
                dark += usize::from(want < 0.5);
            }
        });
        let pixels = depth.len();
        assert!(dark * 20 > pixels, "the scene has no shadows: {dark}");
        assert!(sum / (pixels as f64) < 0.002 && different * 100 < pixels, "{sum} {different}");
    });
}

#[test]
fn unchanged_shadow_maps_are_not_redrawn() {
    let Some(mut h) = headless(160, 90) else { return };
    let mut yard = Yard::new(SUN);
    let clay = Material::default();
    let (mesh, placed) = yard.meshes.swap_remove(1);
    let mut ball = asset(&h, &mesh, clay);
    let morphing = |birth_s| mesh.0.iter().map(move |v| v.morphing([0.0; 3], birth_s)).collect::<Vec<_>>();
    yard.draw(&mut h, |h, drawables| {
        let mut drawn = |camera: Pose, ball: &AssetGpu, instances: &[Placement], time_s: f32| {
            let all: Vec<_> =
                drawables.iter().copied().chain([Drawable { asset: ball, instances }]).collect();
            let frame = yard.frame(camera, &all, Shadows::default());
            h.frame(&Frame { time_s, ..frame }).unwrap().shadow_maps
        };
        let all = drawn(camera(), &ball, &placed, 1.0);
        assert!(all >= 1);
        assert_eq!(drawn(camera(), &ball, &placed, 2.0), 0, "time passes");
        let turned = Pose { rotation: camera().rotation * DQuat::from_rotation_y(0.3), ..camera() };
        assert_eq!(drawn(turned, &ball, &placed, 2.0), 0, "the camera turns");
        let moved =
            Placement { translation: (DVec3::from(placed[0].translation) + DVec3::X).into(), ..placed[0] };
        assert_eq!(drawn(camera(), &ball, &[moved], 2.0), 1, "what moves lies in one map alone");
        ball.update_vertices(h.gpu(), 0, &morphing(3.0)).unwrap();
        let mut drawn = |time_s: f32| {
            let all: Vec<_> =
                drawables.iter().copied().chain([Drawable { asset: &ball, instances: &placed }]).collect();
            let frame = yard.frame(camera(), &all, Shadows::default());
            h.frame(&Frame { time_s, ..frame }).unwrap().shadow_maps
        };
        for time_s in [3.0, 3.1, 3.2, 3.25] {
            assert_eq!(drawn(time_s), 1, "vertices move at {time_s} s");
        }
        assert_eq!(drawn(3.3), 0, "and have arrived");
    });
}

#[test]
fn stale_shadow_maps_are_redrawn_in_time() {
    let Some(mut h) = headless(160, 90) else { return };
    let yard = Yard::new(SUN);
    let shadows = Shadows { max_staleness: 8, ..Shadows::default() };
    yard.draw(&mut h, |h, drawables| {
        let mut drawn = |i: u32, eye: DVec3, shadows: Shadows| {
            // An instance too large for any map moves all the time.
            let moving = [at(f64::from(i) * 1e-3, -20.0, 0.0, 30.0)];
            let all = [drawables, &[Drawable { asset: drawables[0].asset, instances: &moving }]].concat();
            let frame = yard.frame(Pose { eye, ..camera() }, &all, shadows);
            let counters = h.frame(&frame).unwrap();
            (counters.shadow_maps, counters.late_shadow_maps)
        };
        let eye = camera().eye;
        let (all, _) = drawn(0, eye, shadows);
        let maps: Vec<u32> = (1..=18)
            .map(|i| {
                let (maps, late) = drawn(i, eye, shadows);
                assert_eq!(maps + late, all, "each map is redrawn or late");
                maps
            })
            .collect();
        let total: u32 = maps.iter().sum();
        assert!((all * 2..=all * 6).contains(&total), "{maps:?}");
        assert!(maps.iter().filter(|&&maps| maps == 0).count() > 9, "{maps:?}");
        assert_eq!(
            drawn(19, eye + DVec3::X * 10.0, shadows),
            (all, 0),
            "a map that moves is redrawn at once"
        );
        assert_eq!(
            drawn(20, eye + DVec3::X * 10.0, Shadows::default()),
            (all, 0),
            "without maximum staleness all are redrawn"
        );
    });
}

#[test]
fn edges_of_shadows_stay_where_they_are_while_the_camera_moves() {
    let Some(mut h) = headless(160, 90) else { return };
    let yard = Yard::new(SUN);
    let shadows = Shadows { map_side: 512, ..Shadows::default() };
    // Points on the floor in the world, and the finest map's result for each from two eye positions.
    let places: Vec<DVec3> = (0..4000)
        .map(|i| DVec3::new(f64::from(i % 80) * 0.04 - 1.6, 1e-3, f64::from(i / 80) * 0.04 - 1.0))
        .collect();
    yard.draw(&mut h, |h, drawables| {
        let seen = |h: &mut Headless, pose: Pose| -> Vec<f64> {
            h.frame(&yard.frame(pose, drawables, shadows)).unwrap();
            maps(h, pose.eye, shadows, |maps| {
                let lit = |place: &DVec3| {
                    let at = maps[0].map_from_world.transform_point3(*place - pose.eye);
                    maps[0].compared(at.truncate(), at.z)
                };
                places.iter().map(lit).collect()
            })
        };
        let first = seen(h, camera());
        assert!(first.iter().filter(|lit| **lit < 0.5).count() > 300, "no shadow falls on the floor");
        let (_, drawn) = h.renderer().shadow_maps().drawn().unwrap();
        let step = drawn[0].0.side / 16.0;
        for share in [0.3, 1.0, 2.6] {
            let pose = Pose { eye: camera().eye + DVec3::new(0.7, 0.2, -0.6) * (share * step), ..camera() };
            let moved = seen(h, pose);
            // Rasterising rounds corners to fractions of a texel, equally after a move by whole texels.
            let crawled = first.iter().zip(&moved).filter(|(a, b)| (*a - *b).abs() > 0.01).count();
            assert!(crawled * 500 <= places.len(), "after {share} steps {crawled} places have another light");
        }
    });
}
