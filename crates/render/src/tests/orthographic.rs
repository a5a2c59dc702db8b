//! Parallel projection by a long lens: what it covers, and that precision suffices for all that is computed from depth.

use glam::{DVec3, Quat};
use lodestream_scene::description::Camera;

use super::shapes::{asset, at, cube, join, opaque, quad, sphere};
use super::{headless, keep};
use crate::cpu_reference::depth::view_ray;
use crate::image_compare::compare;
use crate::{
    AmbientOcclusion, AntiAliasing, DebugView, Drawable, Frame, GradientSky, Headless, Ink, Material,
    Placement, Pose, Settings, Sky,
};

const SIZE: (u32, u32) = (320, 180);

/// Looks at zero from a direction at 3 units' distance; a picture is 2.4 high there.
fn camera(from: DVec3) -> Camera {
    let eye = (from.normalize() * 3.0).to_array();
    Camera { eye, target: [0.0; 3], up: [0.0, 1.0, 0.0], fov_y: 2.0 * 0.4_f32.atan() }
}

fn parallel(from: DVec3) -> Pose {
    camera(from).orthographic().pose()
}

fn plain() -> Settings {
    Settings { anti_aliasing: AntiAliasing::None, ..Settings::default() }
}

#[test]
fn near_and_far_faces_of_a_cube_cover_the_same_pixels() {
    let Some(mut h) = headless(SIZE.0, SIZE.1) else { return };
    // 75 pixels a unit: a cube of 2 units is 150 pixels wide, from pixel 85 to 235 and from 15 to 165, at any depth.
    let boxed = asset(&h, &cube(), Material::default());
    for z in [-1.0, 0.0, 1.0] {
        let drawables = [Drawable { asset: &boxed, instances: &[at(0.0, 0.0, z, 2.0)] }];
        h.frame(&Frame { settings: plain(), ..Frame::new(parallel(DVec3::Z), &drawables) }).unwrap();
        for (i, covered) in h.coverage().unwrap().into_iter().enumerate() {
            let (x, y) = (i as u32 % SIZE.0, i as u32 / SIZE.0);
            let inside = (85..235).contains(&x) && (15..165).contains(&y);
            assert_eq!(covered, inside, "{x}, {y} of the cube at {z}");
        }
    }
    // Its back face alone, drawn without the others, too.
    let face = quad([-1.0, -1.0, -1.0], [2.0, 0.0, 0.0], [0.0, 2.0, 0.0], 1.0);
    let face = asset(&h, &face, Material::default());
    let drawables = [Drawable { asset: &face, instances: &[Placement::default()] }];
    h.frame(&Frame { settings: plain(), ..Frame::new(parallel(DVec3::Z), &drawables) }).unwrap();
    assert_eq!(h.coverage().unwrap().into_iter().filter(|covered| *covered).count(), 150 * 150);
}

#[test]
fn depth_resolves_a_tenth_of_a_pixel() {
    let Some(mut h) = headless(SIZE.0, SIZE.1) else { return };
    let ball = asset(&h, &sphere(128), Material::default());
    let drawables = [Drawable { asset: &ball, instances: &[at(0.0, 0.0, 0.0, 2.0)] }];
    let camera = parallel(DVec3::new(0.4, 0.3, 1.0));
    h.frame(&Frame { settings: plain(), ..Frame::new(camera, &drawables) }).unwrap();
    let tan = camera.tan_half_fov(SIZE.0, SIZE.1);
    let (mut worst, mut count) = (0.0_f64, 0);
    for (i, stored) in h.depth().unwrap().into_iter().enumerate() {
        let pixel = [(i as u32 % SIZE.0).into(), (i as u32 / SIZE.0).into()];
        let ray = camera.rotation * DVec3::from(view_ray(pixel, SIZE.into(), tan.into()));
        let nearest = camera.eye + ray * (-camera.eye.dot(ray) / ray.length_squared());
        let Some(half) = (stored > 0.0).then(|| 1.0 - nearest.length_squared()).filter(|half| *half > 0.3)
        else {
            continue;
        };
        let want = (nearest - camera.eye).length() - half.sqrt();
        let got = Settings::default().near / f64::from(stored) * ray.length();
        worst = worst.max((want - got).abs() * 75.0);
        count += 1;
    }
    println!("{count} pixels, worst {worst:.4} pixels");
    // Facets lie up to 0.02 pixels below the ball.
    assert!(count > 8000 && worst < 0.1, "{worst}");
}

/// Things on a floor, lit and shadowed.
fn stage<R>(h: &mut Headless, draw: impl FnOnce(&mut Headless, &[Drawable<'_>]) -> R) -> R {
    let clay = Material { base_color: opaque([0.6, 0.3, 0.2]), ..Material::default() };
    let floor = quad([-3.0, -0.5, 3.0], [6.0, 0.0, 0.0], [0.0, 0.0, -6.0], 1.0);
    let wall = quad([-3.0, -0.5, -1.0], [6.0, 0.0, 0.0], [0.0, 3.0, 0.0], 1.0);
    let (body, ball) = (asset(h, &cube(), clay), asset(h, &sphere(48), Material::default()));
    let around = asset(h, &join(&[floor, wall]), Material::default());
    let turned = Placement { rotation: Quat::from_rotation_y(0.4).into(), ..at(-0.5, 0.0, 0.0, 1.0) };
    draw(
        h,
        &[
            Drawable { asset: &body, instances: &[turned] },
            Drawable { asset: &ball, instances: &[at(0.8, -0.1, 0.2, 0.8)] },
            Drawable { asset: &around, instances: &[Placement::default()] },
        ],
    )
}

/// From a lens twelve times as wide as the long one, whose depths have as many more bits, each pass gives the same picture.
#[test]
fn every_pass_agrees_with_a_shorter_lens() {
    let Some(mut h) = headless(SIZE.0, SIZE.1) else { return };
    let from = DVec3::new(0.5, 0.6, 1.0);
    let long = camera(from).orthographic();
    let eye = DVec3::from(long.eye) / 12.0;
    let shorter = Camera { eye: eye.to_array(), fov_y: long.fov_y * 12.0, ..long }.pose();
    let usual = AmbientOcclusion::default();
    stage(&mut h, |h, drawables| {
        let mut shoot = |camera: Pose, settings: Settings| {
            // Shares of the depth, for the shorter lens in its own.
            let factor = (0.5 * camera.fov_y).tan() / 25_f64.to_radians().tan();
            let crate::OcclusionRadius::Depth(share) = usual.radius else { panic!("a share of the depth") };
            let own = if camera.is_orthographic() { share } else { share * factor as f32 };
            let radius = crate::OcclusionRadius::Depth(own);
            let occlusion = settings.occlusion.map(|occlusion| AmbientOcclusion { radius, ..occlusion });
            let mut frame =
                Frame { settings: Settings { occlusion, ..settings }, ..Frame::new(camera, drawables) };
            frame.environment.sky = Sky::Plain(GradientSky::default());
            h.frame(&frame).unwrap();
            h.picture().unwrap()
        };
        for debug_view in [
            DebugView::Material,
            DebugView::Normal,
            DebugView::Occlusion,
            DebugView::Sunlight,
            DebugView::Albedo,
        ] {
            let settings = Settings { debug_view, ..plain() };
            let (got, want) = (shoot(parallel(from), settings), shoot(shorter, settings));
            let found = compare(&got, &want, None).unwrap();
            println!("{}: {found:?}", debug_view.name());
            // Edges move by the remaining parallax of the shorter lens.
            assert!(found.mean_difference < 1.0, "{}: {found:?}", debug_view.name());
        }
    });
    stage(&mut h, |h, drawables| {
        let frame = Frame::new(parallel(from), drawables);
        h.frame(&Frame { settings: Settings::default(), ..frame }).unwrap();
        keep(h, "orthographic");
        h.frame(&Frame { settings: Settings { debug_view: DebugView::Occlusion, ..plain() }, ..frame })
            .unwrap();
        keep(h, "orthographic-occlusion");
    });
}

/// Edges behind a cube stay hidden: their tolerance is that of usual lenses, and not one of the long lens's depth.
#[test]
fn hidden_edges_stay_hidden() {
    let Some(mut h) = headless(SIZE.0, SIZE.1) else { return };
    let (front, back) = (asset(&h, &cube(), Material::default()), asset(&h, &cube(), Material::default()));
    let front = Drawable { asset: &front, instances: &[at(0.0, 0.0, 0.5, 1.5)] };
    let back = Drawable { asset: &back, instances: &[at(0.1, 0.1, -0.8, 0.7)] };
    for (wireframe, ink) in [(true, None), (false, Some(Ink::default()))] {
        let settings = Settings { wireframe, ink, shadows: None, occlusion: None, ..plain() };
        let mut shoot = |drawables: &[Drawable<'_>]| {
            h.frame(&Frame { settings, ..Frame::new(parallel(DVec3::Z), drawables) }).unwrap();
            h.picture().unwrap()
        };
        assert!(shoot(&[front, back]) == shoot(&[front]), "wireframe {wireframe}");
        assert!(shoot(&[front]) != shoot(&[]));
    }
}
