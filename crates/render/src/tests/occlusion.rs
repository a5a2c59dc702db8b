//! Faults that ambient occlusion from a depth buffer is known for, for every method: halos, dark plains, scales, noise, and
//! what it leaves of extreme views.

use glam::DVec3;
use image::RgbaImage;

use super::shapes::{asset, at, cube, flat_ground, quad, sphere};
use super::{headless, keep};
use crate::image_compare::compare;
use crate::rays::Rays;
use crate::{
    AmbientOcclusion, AntiAliasing, DebugView, Drawable, Frame, Headless, Instance, Material,
    OcclusionMethod, OcclusionNormals, OcclusionRadius, Pose, Settings,
};

/// Occlusion at strength 1 in place of the picture.
pub(super) fn shown(method: OcclusionMethod, radius: OcclusionRadius, samples: u32) -> Settings {
    Settings {
        debug_view: DebugView::Occlusion,
        occlusion: Some(AmbientOcclusion {
            method,
            radius,
            strength: 1.0,
            samples,
            ..AmbientOcclusion::default()
        }),
        anti_aliasing: AntiAliasing::None,
        shadows: None,
        ..Settings::default()
    }
}

pub(super) fn draw(
    h: &mut Headless,
    camera: Pose,
    drawables: &[Drawable<'_>],
    settings: Settings,
) -> RgbaImage {
    h.frame(&Frame { settings, ..Frame::new(camera, drawables) }).unwrap();
    h.picture().unwrap()
}

/// Values of pixels that show something, of 255.
pub(super) fn values(picture: &RgbaImage, covered: &[bool]) -> Vec<u8> {
    picture.pixels().zip(covered).filter(|(_, covered)| **covered).map(|(pixel, _)| pixel[0]).collect()
}

#[test]
fn a_wall_far_behind_a_pillar_has_no_halo() {
    let Some(mut h) = headless(160, 90) else { return };
    let wall =
        asset(&h, &quad([-40.0, -20.0, -20.0], [80.0, 0.0, 0.0], [0.0, 40.0, 0.0], 1.0), Material::default());
    let pillar = asset(&h, &cube(), Material::default());
    let tall = [Instance { scale: 1.0, ..at(0.0, 0.0, 0.0, 1.0) }];
    let all = [
        Drawable { asset: &wall, instances: &[Instance::default()] },
        Drawable { asset: &pillar, instances: &tall },
    ];
    let camera = Pose::look_at(DVec3::new(0.0, 0.0, 4.0), DVec3::ZERO, DVec3::Y, 0.6);
    for method in OcclusionMethod::ALL {
        let picture = draw(&mut h, camera, &all, shown(method, OcclusionRadius::World(1.0), 16));
        keep(&h, &format!("occlusion-pillar-{}", method.name()));
        let depth = h.depth().unwrap();
        // The wall is 24 away.
        let far: Vec<bool> =
            depth.iter().map(|stored| Settings::default().near / f64::from(*stored) > 10.0).collect();
        let darkest = values(&picture, &far).into_iter().min().unwrap();
        println!("{}: the wall's darkest pixel is {darkest} of 255", method.name());
        assert!(darkest >= 252, "{}: {darkest}", method.name());
    }
}

#[test]
fn flat_ground_is_open_up_to_the_horizon() {
    let Some(mut h) = headless(160, 90) else { return };
    let ground = flat_ground(&h);
    let all = [Drawable { asset: &ground, instances: &[Instance::default()] }];
    for (height, radius) in [1.7, 0.05, 60.0]
        .into_iter()
        .flat_map(|height| [(height, OcclusionRadius::Depth(0.06)), (height, OcclusionRadius::World(0.5))])
    {
        let eye = DVec3::new(0.3, height, 0.0);
        let camera = Pose::look_at(eye, eye + DVec3::new(0.1, -0.05, -1.0), DVec3::Y, 0.9);
        for method in OcclusionMethod::ALL {
            let picture = draw(&mut h, camera, &all, shown(method, radius, 16));
            let covered = h.coverage().unwrap();
            let values = values(&picture, &covered);
            let dark = values.iter().filter(|value| **value < 254).count();
            assert!(values.len() > 4000, "{} pixels of ground", values.len());
            assert_eq!(dark, 0, "{} {height} {radius:?}: of {}", method.name(), values.len());
        }
    }
}

/// A cube and a ball on a floor, all so many times as large.
struct Still {
    parts: [crate::AssetGpu; 3],
}

impl Still {
    fn new(h: &Headless) -> Self {
        let floor = quad([-3.0, 0.0, 3.0], [6.0, 0.0, 0.0], [0.0, 0.0, -6.0], 1.0);
        let of = |mesh| asset(h, mesh, Material::default());
        Self { parts: [of(&floor), of(&cube()), of(&sphere(24))] }
    }

    /// Each part with its instance.
    fn drawables<'a>(&'a self, instances: &'a [Instance]) -> Vec<Drawable<'a>> {
        let parts = self.parts.iter().zip(instances);
        parts.map(|(asset, instance)| Drawable { asset, instances: std::slice::from_ref(instance) }).collect()
    }

    fn draw(&self, h: &mut Headless, (scale, fov, moved): (f64, f64, f64), settings: Settings) -> RgbaImage {
        let (instances, camera) = Self::placed(scale, fov, moved);
        draw(h, camera, &self.drawables(&instances), Settings { near: 1e-3 * scale, ..settings })
    }

    fn placed(scale: f64, fov: f64, moved: f64) -> ([Instance; 3], Pose) {
        let place = |x, y, z, size: f64| Instance {
            translation: DVec3::new(x, y, z) * scale,
            scale: size * scale,
            ..Instance::default()
        };
        // Not within what stands there.
        let away = (1.3 / (0.5 * fov).tan()).max(2.0);
        let target = DVec3::new(0.1 + moved, 0.4, 0.0);
        let eye = target + DVec3::new(0.5, 0.6, 1.0).normalize() * away;
        let camera = Pose::look_at(eye * scale, target * scale, DVec3::Y, fov);
        ([place(0.0, 0.0, 0.0, 1.0), place(-0.4, 0.5, 0.0, 1.0), place(0.45, 0.35, 0.2, 0.7)], camera)
    }
}

#[test]
fn pictures_are_the_same_at_a_thousandth_and_a_thousand_times_the_size() {
    let Some(mut h) = headless(160, 90) else { return };
    let still = Still::new(&h);
    for method in OcclusionMethod::ALL {
        for world in [false, true] {
            let radius = |scale: f64| match world {
                true => OcclusionRadius::World(0.3 * scale as f32),
                false => OcclusionRadius::Depth(0.06),
            };
            let want = still.draw(&mut h, (1.0, 0.8, 0.0), shown(method, radius(1.0), 16));
            keep(&h, &format!("occlusion-still-{}", method.name()));
            for scale in [1e-3, 1e3] {
                let got = still.draw(&mut h, (scale, 0.8, 0.0), shown(method, radius(scale), 16));
                let found = compare(&got, &want, None).unwrap();
                assert!(found.ssim >= 0.99, "{} at {scale:e}: {found:?}", method.name());
            }
        }
    }
}

#[test]
fn views_from_a_tenth_of_a_degree_to_175_and_pictures_of_a_pixel_leave_numbers() {
    for size in [(1, 1), (1, 7), (5, 3), (97, 65)] {
        let Some(mut h) = headless(size.0, size.1) else { return };
        let still = Still::new(&h);
        for method in OcclusionMethod::ALL {
            for samples in [1, 16, 64] {
                let mut open = Vec::new();
                for degrees in [0.1, 0.2, 46.0, 175.0_f64] {
                    let settings = shown(method, OcclusionRadius::World(0.3), samples);
                    let picture = still.draw(&mut h, (1.0, degrees.to_radians(), 0.0), settings);
                    let covered = h.coverage().unwrap();
                    let values = values(&picture, &covered);
                    let sum: f64 = values.iter().map(|value| f64::from(*value)).sum();
                    // What is no number is stored as 0.
                    let black = values.iter().filter(|value| **value == 0).count();
                    assert!(black * 50 <= values.len() + 49, "{method:?} {size:?} {degrees}°: {black}");
                    open.push(sum / (255.0 * values.len().max(1) as f64));
                }
                if size == (97, 65) && samples == 16 {
                    println!("{}: open by angle of view {open:.3?}", method.name());
                    assert!((open[0] - open[1]).abs() < 0.01, "{method:?}: {open:?}");
                    // Where a radius is less than a pixel all is open.
                    assert!(open.iter().all(|open| (0.5..=1.0).contains(open)), "{method:?}: {open:?}");
                }
            }
        }
    }
}

#[test]
fn depths_from_a_millimetre_to_ten_thousand_kilometres_are_shaded_alike() {
    let Some(mut h) = headless(96, 64) else { return };
    let still = Still::new(&h);
    for method in OcclusionMethod::ALL {
        let settings = shown(method, OcclusionRadius::Depth(0.06), 16);
        let want = still.draw(&mut h, (1.0, 0.8, 0.0), settings);
        // The eye is 3.1 away from the middle of the scene at scale 1.
        for depth in [1e-3, 1.0, 1e3, 1e7] {
            let got = still.draw(&mut h, (depth / 3.1, 0.8, 0.0), settings);
            let found = compare(&got, &want, None).unwrap();
            assert!(found.ssim >= 0.99, "{} at {depth:e}: {found:?}", method.name());
        }
    }
}

/// Normals of vertices are not what occlusion is estimated with: where they choose neighbours it is nearly the same.
#[test]
fn vertices_without_normals_are_shaded_like_others() {
    let Some(mut h) = headless(96, 64) else { return };
    let (instances, camera) = Still::placed(1.0, 0.8, 0.0);
    let shoot = |h: &mut Headless, normals: bool, method, by| {
        let floor = quad([-3.0, 0.0, 3.0], [6.0, 0.0, 0.0], [0.0, 0.0, -6.0], 1.0);
        let parts = [floor, cube(), sphere(24)].map(|mut mesh| {
            if !normals {
                mesh.0.iter_mut().for_each(|vertex| vertex.normal = [0; 4]);
            }
            asset(h, &mesh, Material::default())
        });
        let drawables: Vec<_> = parts
            .iter()
            .zip(&instances)
            .map(|(asset, instance)| Drawable { asset, instances: std::slice::from_ref(instance) })
            .collect();
        let mut settings = shown(method, OcclusionRadius::Depth(0.06), 16);
        settings.occlusion.as_mut().unwrap().normals = by;
        draw(h, camera, &drawables, settings)
    };
    for method in OcclusionMethod::ALL {
        for by in OcclusionNormals::ALL {
            let (with, without) = (shoot(&mut h, true, method, by), shoot(&mut h, false, method, by));
            if by == OcclusionNormals::Drawn {
                let found = compare(&with, &without, None).unwrap();
                assert!(found.ssim >= 0.99, "{method:?}: {found:?}");
            } else {
                assert!(with == without, "{method:?}, {by:?}");
            }
        }
    }
}

/// How much a method flickers while a camera moves by a quarter of a pixel a frame: differences of frames one after the
/// other, in steps of 255.
#[test]
fn a_slow_camera_makes_little_noise() {
    let Some(mut h) = headless(160, 90) else { return };
    let still = Still::new(&h);
    let both = OcclusionMethod::ALL.into_iter().flat_map(|method| [(method, false), (method, true)]);
    for (method, half) in both.filter(|way| *way != (OcclusionMethod::HbaoPlus, true)) {
        let whole = shown(method, OcclusionRadius::World(0.3), 16);
        let occlusion = whole.occlusion.map(|occlusion| AmbientOcclusion { half, ..occlusion });
        let settings = Settings { occlusion, ..whole };
        let frames: Vec<RgbaImage> = (0..9)
            .map(|i| still.draw(&mut h, (1.0, 0.8, f64::from(i) * 0.25 * 2.6 / 90.0), settings))
            .collect();
        let covered = h.coverage().unwrap();
        let mut squares = (0.0, 0);
        for pair in frames.windows(2) {
            for ((a, b), covered) in pair[0].pixels().zip(pair[1].pixels()).zip(&covered) {
                if *covered {
                    squares = (squares.0 + f64::from(a[0].abs_diff(b[0])).powi(2), squares.1 + 1);
                }
            }
        }
        let deviation = (squares.0 / f64::from(squares.1)).sqrt();
        println!("{}, half {half}: {deviation:.2} of 255 from frame to frame", method.name());
        assert!(deviation < 9.0, "{}, half {half}: {deviation}", method.name());
    }
}

/// What a depth buffer knows of a thin post: horizons take it for a wall that reaches on behind it, sectors do not. Rays
/// say how dark it is.
#[test]
fn a_thin_post_before_a_wall_hides_too_much_by_horizons_and_less_by_sectors() {
    let Some(mut h) = headless(160, 90) else { return };
    let wall =
        asset(&h, &quad([-3.0, -2.0, 0.0], [6.0, 0.0, 0.0], [0.0, 4.0, 0.0], 1.0), Material::default());
    let post =
        asset(&h, &quad([-0.02, -2.0, 0.25], [0.04, 0.0, 0.0], [0.0, 4.0, 0.0], 1.0), Material::default());
    let here = [Instance::default()];
    let all = [Drawable { asset: &wall, instances: &here }, Drawable { asset: &post, instances: &here }];
    let camera = Pose::look_at(DVec3::new(0.0, 0.0, 3.0), DVec3::ZERO, DVec3::Y, 0.6);
    let frame = Frame::new(camera, &all);
    // Of which half is a post's thickness: less than it stands before the wall.
    let radius = OcclusionRadius::World(0.4);
    let rays = Rays::of_frame(h.gpu(), &frame).unwrap().picture([160, 90], radius, 512);
    let mean = |values: &mut dyn Iterator<Item = f64>| {
        let all: Vec<f64> = values.collect();
        all.iter().sum::<f64>() / all.len() as f64
    };
    let on_wall = |i: &usize| rays[*i].is_some_and(|seen| seen.depth > 2.9);
    let beside = |i: &usize| on_wall(i) && (50..110).contains(&(i % 160)) && (30..60).contains(&(i / 160));
    let truth = mean(&mut (0..rays.len()).filter(beside).map(|i| rays[i].unwrap().openness));
    let mut open = |method| {
        let picture = draw(&mut h, camera, &all, shown(method, radius, 32));
        keep(&h, &format!("occlusion-post-{}", OcclusionMethod::name(method)));
        mean(&mut (0..rays.len()).filter(beside).map(|i| f64::from(picture.as_raw()[4 * i]) / 255.0))
    };
    let [horizons, sectors] = [OcclusionMethod::Gtao, OcclusionMethod::Bitmask].map(&mut open);
    println!("beside a post: rays {truth:.4}, horizons {horizons:.4}, sectors {sectors:.4}");
    assert!(horizons < sectors && sectors < truth + 0.01, "{horizons} {sectors} {truth}");
    for method in OcclusionMethod::ALL {
        println!("{}: {:.4}", method.name(), open(method));
    }
}

/// Rays see what is drawn: their depth is the depth buffer's, and occlusion from it is near theirs.
#[test]
fn rays_see_the_depth_that_is_drawn() {
    let Some(mut h) = headless(120, 80) else { return };
    let still = Still::new(&h);
    let (instances, camera) = Still::placed(1.0, 0.8, 0.0);
    let drawables = still.drawables(&instances);
    let radius = OcclusionRadius::World(0.3);
    let frame =
        Frame { settings: shown(OcclusionMethod::Gtao, radius, 16), ..Frame::new(camera, &drawables) };
    h.frame(&frame).unwrap();
    let (depth, picture) = (h.depth().unwrap(), h.picture().unwrap());
    let rays = Rays::of_frame(h.gpu(), &frame).unwrap();
    assert_eq!(rays.triangles(), 2 + 12 + 24 * 48 * 2);
    let seen = rays.picture([120, 80], radius, 256);
    let (mut off, mut squares, mut count) = (0, 0.0, 0);
    for (i, seen) in seen.iter().enumerate() {
        assert_eq!(seen.is_some(), depth[i] > 0.0, "pixel {i}");
        let Some(seen) = seen else { continue };
        let drawn = frame.settings.near / f64::from(depth[i]);
        off += usize::from((drawn / seen.depth - 1.0).abs() > 1e-3);
        squares += (f64::from(picture.as_raw()[4 * i]) / 255.0 - seen.openness).powi(2);
        count += 1;
    }
    let mse = squares / f64::from(count);
    println!("{off} of {count} pixels see another depth, MSE {mse:.5}");
    assert!(off * 200 < count as usize && mse < 0.01, "{off} {mse}");
}
