//! Section planes: what they cut away and cap, against analytic expectations.

use glam::{DVec3, Quat};

use super::shapes::{asset, at, cube, join, opaque, quad, sphere};
use super::{headless, keep};
use crate::cpu_reference::brdf::octahedral;
use crate::cpu_reference::depth::view_ray;
use crate::frame::graph::Resource;
use crate::{
    AntiAliasing, DebugView, Drawable, Frame, Headless, Ink, Material, PassId, Placement, PnTriangles, Pose,
    SectionPlane, SectionPlanes, Settings,
};
use half::f16;

const SIZE: (u32, u32) = (120, 90);
const CLAY: [f32; 3] = [0.6, 0.3, 0.2];

fn camera() -> Pose {
    Pose::look_at(DVec3::new(0.9, 0.7, 2.4), DVec3::ZERO, DVec3::Y, 0.6)
}

fn planes(all: &[(DVec3, f64)]) -> SectionPlanes {
    let all: Vec<_> = all.iter().map(|(n, d)| SectionPlane::new(*n, *d).unwrap()).collect();
    SectionPlanes::new(&all).unwrap()
}

fn settings(sections: SectionPlanes) -> Settings {
    Settings { sections, anti_aliasing: AntiAliasing::None, ..Settings::default() }
}

/// Rays of unit depth through the pixels, world axes.
fn rays(camera: &Pose) -> impl Iterator<Item = DVec3> {
    let (camera, tan) = (*camera, camera.tan_half_fov(SIZE.0, SIZE.1));
    (0..SIZE.0 * SIZE.1).map(move |i| {
        let pixel = [(i % SIZE.0).into(), (i / SIZE.0).into()];
        camera.rotation * DVec3::from(view_ray(pixel, [SIZE.0, SIZE.1], tan.into()))
    })
}

/// What is stored of normals, roughness and occlusion, by pixel.
fn surfaces(h: &Headless) -> Vec<[f64; 4]> {
    let stored: Vec<f16> = bytemuck::pod_collect_to_vec(&h.intermediate(Resource::Normal, 8).unwrap());
    stored.chunks(4).map(|texel| [0, 1, 2, 3].map(|i| texel[i].to_f64())).collect()
}

/// What a ray meets first of a ball of radius ½ about zero that planes cut: its depth, and the plane's normal on a cap.
fn meets(from: DVec3, ray: DVec3, sections: &SectionPlanes) -> Option<(f64, Option<DVec3>)> {
    let [enters, leaves] = sections.kept_stretch(from, ray)?;
    let (a, b, c) = (ray.length_squared(), ray.dot(from), from.length_squared() - 0.25);
    let root = (b * b - a * c).sqrt();
    // NaN if the ray misses the ball.
    let [first, last] = [(-b - root) / a, (-b + root) / a];
    let depth = first.max(enters);
    if !(depth <= last && depth <= leaves) {
        return None;
    }
    let beyond = |plane: &&SectionPlane| plane.beyond(from + ray * depth).abs();
    let nearest = sections.iter().min_by(|a, b| beyond(a).total_cmp(&beyond(b)));
    Some((depth, nearest.filter(|_| enters > first).map(SectionPlane::normal)))
}

/// Compares depth and normals of a cut ball with rays; gives the numbers of pixels on its surface and on caps.
fn check_ball(h: &mut Headless, camera: Pose, settings: Settings) -> [usize; 2] {
    let material = Material { base_color: opaque(CLAY), ..Material::default() };
    let ball = asset(h, &sphere(96), material);
    let drawables = [Drawable { asset: &ball, instances: &[Placement::default()] }];
    h.frame(&Frame { settings, ..Frame::new(camera, &drawables) }).unwrap();
    let (depths, surfaces) = (h.depth().unwrap(), surfaces(h));
    let mut counts = [0; 2];
    let mut off = 0;
    for ((ray, stored), surface) in rays(&camera).zip(depths).zip(surfaces) {
        let want = meets(camera.eye, ray, &settings.sections);
        let depth = (stored > 0.0).then(|| settings.near / f64::from(stored));
        let agree = match (want, depth) {
            (Some((want, cap)), Some(got)) => {
                let normal = cap.map(|normal| octahedral(normal.to_array()));
                counts[usize::from(cap.is_some())] += 1;
                // Facets lie up to 3e-4 below the ball.
                let close = if cap.is_some() { 1e-5 } else { 3e-3 };
                let lies = normal.is_none_or(|n| (0..2).all(|i| (n[i] - surface[i]).abs() < 2e-3));
                (want - got).abs() < close * want && lies && (cap.is_some() == (surface[2] > 1.0))
            }
            (None, None) => true,
            _ => false,
        };
        off += usize::from(!agree);
    }
    // Pixels on outlines and edges.
    assert!(off < 60, "{off} of {counts:?}");
    counts
}

#[test]
fn a_cut_ball_has_flat_caps_with_the_planes_normals_and_depths() {
    let Some(mut h) = headless(SIZE.0, SIZE.1) else { return };
    let half = check_ball(&mut h, camera(), settings(planes(&[(DVec3::new(1.0, 0.5, 0.3), 0.1)])));
    keep(&h, "section-ball");
    assert!(half[0] > 100 && half[1] > 500, "{half:?}");
    let quarter = check_ball(&mut h, camera(), settings(planes(&[(DVec3::Z, 0.0), (DVec3::X, 0.1)])));
    keep(&h, "section-two-planes");
    assert!(quarter[1] > 1000, "{quarter:?}");
    let three = [(DVec3::Z, 0.0), (DVec3::X, 0.1), (DVec3::new(0.3, 1.0, 0.2), 0.2)];
    assert!(check_ball(&mut h, camera(), settings(planes(&three)))[1] > 500);
    // Seen from behind, the cap is hidden and nothing is capped.
    let from_behind = Pose::look_at(DVec3::new(0.3, 0.4, -2.4), DVec3::ZERO, DVec3::Y, 0.6);
    let back = check_ball(&mut h, from_behind, settings(planes(&[(DVec3::Z, 0.1)])));
    assert!(back[0] > 1000 && back[1] == 0, "{back:?}");
    // A plane that misses it cuts nothing, or all.
    let whole = check_ball(&mut h, camera(), settings(planes(&[(DVec3::Z, 0.6)])));
    assert!(whole[0] > 1000 && whole[1] == 0, "{whole:?}");
    assert_eq!(check_ball(&mut h, camera(), settings(planes(&[(DVec3::Z, -0.6)]))), [0, 0]);
    // As patches of PN triangles, too.
    let pn_triangles = Some(PnTriangles::default());
    let curved = Settings { pn_triangles, ..settings(planes(&[(DVec3::new(1.0, 0.5, 0.3), 0.1)])) };
    let curved = check_ball(&mut h, camera(), curved);
    assert!(curved[0] > 100 && curved[1] > 500, "{curved:?}");
}

#[test]
fn far_from_the_origin_and_in_parallel_projection_caps_lie_on_their_plane() {
    let Some(mut h) = headless(SIZE.0, SIZE.1) else { return };
    let far = DVec3::new(3e5, -1e5, 2e5);
    let ball = asset(&h, &sphere(48), Material::default());
    let drawables = [Drawable { asset: &ball, instances: &[Placement::at(far.to_array())] }];
    let orthographic = lodestream_scene::description::Camera {
        eye: (far + camera().eye).to_array(),
        target: far.to_array(),
        up: [0.0, 1.0, 0.0],
        fov_y: 0.6,
    };
    let plane = SectionPlane::through(far + DVec3::Z * 0.1, DVec3::Z).unwrap();
    let sections = SectionPlanes::new(&[plane]).unwrap();
    for (camera, off) in [(orthographic.pose(), 1e-5), (orthographic.orthographic().pose(), 1e-3)] {
        h.frame(&Frame { settings: settings(sections), ..Frame::new(camera, &drawables) }).unwrap();
        let near = Settings::default().near;
        let mut caps = 0;
        for ((ray, stored), surface) in rays(&camera).zip(h.depth().unwrap()).zip(surfaces(&h)) {
            if surface[2] > 1.0 {
                let place = camera.eye + ray * (near / f64::from(stored));
                assert!(plane.beyond(place).abs() < off, "{}", plane.beyond(place));
                caps += 1;
            }
        }
        assert!(caps > 1000, "{caps}");
    }
}

#[test]
fn the_nearest_solid_fills_a_cut() {
    let Some(mut h) = headless(SIZE.0, SIZE.1) else { return };
    // A core in a shell, and a cube behind both: the outer solid is capped around the inner, and not the hole behind.
    let of = |[r, g, b]: [f32; 3]| Material { base_color: [r, g, b, 1.0], ..Material::default() };
    let (shell, core) =
        (asset(&h, &sphere(48), of([0.0, 1.0, 0.0])), asset(&h, &sphere(48), of([1.0, 0.0, 0.0])));
    let behind = asset(&h, &cube(), of([0.0, 0.0, 1.0]));
    let drawables = [
        Drawable { asset: &behind, instances: &[at(0.0, 0.0, -3.0, 3.0)] },
        Drawable { asset: &shell, instances: &[Placement::default()] },
        Drawable { asset: &core, instances: &[at(0.0, 0.0, 0.0, 0.4)] },
    ];
    let camera = Pose::look_at(DVec3::new(0.0, 0.0, 3.0), DVec3::ZERO, DVec3::Y, 0.6);
    let view = Settings { debug_view: DebugView::Albedo, ..settings(planes(&[(DVec3::Z, 0.05)])) };
    h.frame(&Frame { settings: view, ..Frame::new(camera, &drawables) }).unwrap();
    keep(&h, "section-nested");
    let picture = h.picture().unwrap();
    let at = |x: f64| {
        let px = f64::from(SIZE.1) / (2.0 * 0.3_f64.tan() * 2.95);
        picture.get_pixel((60.0 + x * px) as u32, 45).0
    };
    assert_eq!(
        [at(0.0), at(0.15), at(0.3), at(-0.45), at(0.6)].map(|[r, g, b, _]| [r, g, b].map(|x| x > 128)),
        [
            [true, false, false],
            [true, false, false],
            [false, true, false],
            [false, true, false],
            [false, false, true]
        ]
    );
}

/// A cube on a floor, drawn with everything.
fn stage<R>(h: &mut Headless, draw: impl FnOnce(&mut Headless, &[Drawable<'_>]) -> R) -> R {
    let clay = Material { base_color: opaque(CLAY), emission: [0.1, 0.0, 0.0], ..Material::default() };
    let glass =
        Material { base_color: [0.2, 0.4, 0.6, 0.4], alpha: crate::Alpha::Blend, ..Material::default() };
    let floor = quad([-4.0, -0.6, 4.0], [8.0, 0.0, 0.0], [0.0, 0.0, -8.0], 1.0);
    let (body, floor) = (asset(h, &cube(), clay), asset(h, &floor, Material::default()));
    let glass = asset(h, &sphere(24), glass);
    let turned = Placement { rotation: Quat::from_rotation_y(0.4).into(), ..Placement::default() };
    let drawables = [
        Drawable { asset: &body, instances: &[turned] },
        Drawable { asset: &glass, instances: &[at(0.9, 0.0, 0.0, 0.8)] },
        Drawable { asset: &floor, instances: &[Placement::default()] },
    ];
    draw(h, &drawables)
}

#[test]
fn planes_that_cut_nothing_leave_the_picture_as_it_is() {
    let Some(mut h) = headless(SIZE.0, SIZE.1) else { return };
    let camera = Pose::look_at(DVec3::new(1.2, 1.4, 3.2), DVec3::ZERO, DVec3::Y, 0.6);
    stage(&mut h, |h, drawables| {
        let mut shoot = |sections, ink: Option<Ink>, wireframe| {
            let settings = Settings { sections, ink, wireframe, ..Settings::default() };
            let counters = h.frame(&Frame { settings, ..Frame::new(camera, drawables) }).unwrap();
            (h.picture().unwrap(), counters.passes.contains(&PassId::Caps))
        };
        let beside = planes(&[(DVec3::Y, 50.0), (DVec3::new(0.5, 0.0, 1.0), 70.0)]);
        for (ink, wireframe) in [(None, false), (None, true), (Some(Ink::default()), false)] {
            let (whole, capped) = shoot(SectionPlanes::NONE, ink, wireframe);
            assert!(!capped);
            let (same, capped) = shoot(beside, ink, wireframe);
            assert!(capped && whole == same);
        }
    });
}

#[test]
fn what_is_cut_away_is_in_no_pass() {
    let Some(mut h) = headless(SIZE.0, SIZE.1) else { return };
    let camera = Pose::look_at(DVec3::new(1.2, 1.4, 3.2), DVec3::ZERO, DVec3::Y, 0.6);
    // All but the floor.
    let sections = planes(&[(DVec3::Y, -0.55)]);
    stage(&mut h, |h, drawables| {
        let floor = &drawables[2..];
        for ink in [None, Some(Ink::default())] {
            for (wireframe, debug_view) in
                [(false, DebugView::Material), (true, DebugView::Material), (false, DebugView::Overdraw)]
            {
                let mut shoot = |drawables: &[Drawable<'_>]| {
                    let settings = Settings { sections, ink, wireframe, debug_view, ..Settings::default() };
                    h.frame(&Frame { settings, ..Frame::new(camera, drawables) }).unwrap();
                    h.picture().unwrap()
                };
                let (all, alone) = (shoot(drawables), shoot(floor));
                let apart =
                    all.pixels().zip(alone.pixels()).filter(|(a, b)| (0..3).any(|c| a[c].abs_diff(b[c]) > 6));
                let apart = apart.count();
                // Shadow maps cover what the cube's bounds do.
                assert!(apart < 10, "{apart} with {ink:?}, {wireframe}, {debug_view:?}");
            }
        }
        // What is cut away casts no shadow, and the rest does: of pixels that show the floor, before and after.
        let mut floor_is_lit = |sections| {
            let settings = Settings { debug_view: DebugView::Sunlight, ..settings(sections) };
            h.frame(&Frame { settings, ..Frame::new(camera, drawables) }).unwrap();
            let is_floor = |ray: DVec3, stored: f32| {
                let place = camera.eye + ray * (settings.near / f64::from(stored));
                (place.y + 0.6).abs() < 1e-3
            };
            let floor = rays(&camera).zip(h.depth().unwrap()).map(|(ray, stored)| is_floor(ray, stored));
            let picture = h.picture().unwrap();
            floor.zip(picture.pixels().map(|p| p[0] > 128)).collect::<Vec<_>>()
        };
        let (whole, half) = (floor_is_lit(SectionPlanes::NONE), floor_is_lit(planes(&[(DVec3::Y, -0.25)])));
        let both = || whole.iter().zip(&half).filter(|(a, b)| a.0 && b.0);
        let count = |lit: [bool; 2]| both().filter(|(a, b)| [a.1, b.1] == lit).count();
        let counts = [[false, false], [false, true], [true, false]].map(count);
        assert!(counts[0] > 30 && counts[1] > 30 && counts[2] < 5, "{counts:?}");
    });
}

#[test]
fn a_cut_picture_at_rest_converges_and_a_moved_plane_changes_it_at_once() {
    let Some(mut h) = headless(SIZE.0, SIZE.1) else { return };
    let camera = Pose::look_at(DVec3::new(1.2, 1.4, 3.2), DVec3::ZERO, DVec3::Y, 0.6);
    stage(&mut h, |h, drawables| {
        let mut shoot = |height: f64| {
            let sections = planes(&[(DVec3::Y, height)]);
            let settings =
                Settings { sections, anti_aliasing: AntiAliasing::Temporal, ..Settings::default() };
            let counters = h.frame(&Frame { settings, ..Frame::new(camera, drawables) }).unwrap();
            counters.still_frames
        };
        assert_eq!([0.1, 0.1, 0.1, 0.2, 0.2].map(&mut shoot), [1, 2, 3, 1, 2]);
        keep(h, "section-stage");
    });
}

#[test]
fn two_joined_cubes_are_capped_as_one_mesh() {
    let Some(mut h) = headless(SIZE.0, SIZE.1) else { return };
    let mut other = cube();
    for vertex in &mut other.0 {
        vertex.position[0] += 1.5;
    }
    let both = asset(&h, &join(&[cube(), other]), Material::default());
    let drawables = [Drawable { asset: &both, instances: &[at(-0.75, 0.0, 0.0, 1.0)] }];
    let camera = Pose::look_at(DVec3::new(0.0, 0.0, 5.0), DVec3::ZERO, DVec3::Y, 0.6);
    h.frame(&Frame { settings: settings(planes(&[(DVec3::Z, 0.0)])), ..Frame::new(camera, &drawables) })
        .unwrap();
    let caps: Vec<_> = surfaces(&h).iter().map(|surface| surface[2] > 1.0).collect();
    let row = &caps[(45 * SIZE.0) as usize..(46 * SIZE.0) as usize];
    let edges = row.windows(2).filter(|pair| pair[0] != pair[1]).count();
    assert_eq!(edges, 4, "{row:?}");
}
