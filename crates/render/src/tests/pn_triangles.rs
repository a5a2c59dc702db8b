//! PN triangles: equal to their CPU reference, without cracks, and flat where the surface is flat.

use std::collections::BTreeMap;

use glam::DVec3;
use image::RgbaImage;

use super::shapes::{Mesh, asset, at, cube, join, quad, sphere};
use super::{headless, keep};
use crate::cpu_reference::depth::view_ray;
use crate::cpu_reference::pn_triangles::{Corner, Patch};
use crate::frame::graph::Resource;
use crate::{
    AntiAliasing, AssetGpu, DebugView, Drawable, Frame, Headless, MAX_PN_LEVEL, Material, PackedVertex,
    PassId, Placement, PnTriangles, Pose, Settings, mark_smooth,
};

const NEAR: f64 = 1e-4;

fn curved(error_px: f32) -> Settings {
    Settings { pn_triangles: Some(PnTriangles { error_px, most: MAX_PN_LEVEL }), ..Settings::default() }
}

/// An icosahedron of radius ½ about the origin, with each face cut into 4 a number of times.
fn icosphere(times: u32) -> Mesh {
    let g = 0.5 * (1.0 + 5.0_f64.sqrt());
    let mut points: Vec<DVec3> = Vec::new();
    for (a, b) in [(-1.0, -g), (1.0, -g), (-1.0, g), (1.0, g)] {
        points.extend([DVec3::new(0.0, a, b), DVec3::new(a, b, 0.0), DVec3::new(b, 0.0, a)]);
    }
    let edge = 2.0;
    let near = |p: DVec3, q: DVec3| (p.distance(q) - edge).abs() < 1e-9;
    let mut faces: Vec<[usize; 3]> = Vec::new();
    for a in 0..12 {
        for b in a + 1..12 {
            for c in b + 1..12 {
                if near(points[a], points[b]) && near(points[b], points[c]) && near(points[c], points[a]) {
                    let out = (points[b] - points[a]).cross(points[c] - points[a]).dot(points[a]) > 0.0;
                    faces.push(if out { [a, b, c] } else { [a, c, b] });
                }
            }
        }
    }
    for _ in 0..times {
        let mut midways = BTreeMap::new();
        let mut midway = |a: usize, b: usize| {
            *midways.entry((a.min(b), a.max(b))).or_insert_with(|| {
                points.push((points[a].normalize() + points[b].normalize()) * 0.5);
                points.len() - 1
            })
        };
        let cut = |[a, b, c]: [usize; 3]| {
            let [p, q, r] = [midway(a, b), midway(b, c), midway(c, a)];
            [[a, p, r], [p, b, q], [r, q, c], [p, q, r]]
        };
        faces = faces.into_iter().flat_map(cut).collect();
    }
    let vertices = points.iter().map(|p| {
        let n = p.normalize().as_vec3();
        PackedVertex::new((n * 0.5).to_array(), n.to_array(), [0.5; 2])
    });
    let mut vertices: Vec<_> = vertices.collect();
    mark_smooth(&mut vertices);
    (vertices, faces.into_iter().map(|f| f.map(|i| i as u32)).collect())
}

/// The same with some flat faces, which have vertices of their own.
fn half_flat(mesh: &Mesh) -> Mesh {
    let (mut vertices, mut faces) = (mesh.0.clone(), Vec::new());
    for face in &mesh.1 {
        let [a, b, c] = face.map(|i| glam::Vec3::from(mesh.0[i as usize].position));
        if (a + b + c).z < 0.3 {
            faces.push(*face);
            continue;
        }
        let normal = (b - a).cross(c - a).normalize().to_array();
        let first = vertices.len() as u32;
        vertices.extend([a, b, c].map(|p| PackedVertex::new(p.to_array(), normal, [0.5; 2])));
        faces.push([first, first + 1, first + 2]);
    }
    mark_smooth(&mut vertices);
    (vertices, faces)
}

fn draw(
    h: &mut Headless,
    asset: &AssetGpu,
    instance: Placement,
    camera: Pose,
    settings: Settings,
) -> RgbaImage {
    let instances = [instance];
    let drawables = [Drawable { asset, instances: &instances }];
    h.frame(&Frame { settings, ..Frame::new(camera, &drawables) }).unwrap();
    h.picture().unwrap()
}

/// The CPU reference's triangles of a mesh at zero, each point with its normal.
fn tessellated(
    (vertices, faces): &Mesh,
    eye: DVec3,
    scale_px: f64,
    error_px: f64,
) -> Vec<[(DVec3, DVec3); 3]> {
    let corner = |i: u32| {
        let v = &vertices[i as usize];
        let normal = [0, 1, 2].map(|k| f64::from(v.normal[k]) / 32767.0);
        let position = DVec3::from(v.position.map(f64::from));
        Corner { position, normal: normal.into(), bends: v.normal[3] != 0 }
    };
    let of_face = |face: &[u32; 3]| {
        let patch = Patch { corners: face.map(corner) };
        let (points, triangles) = Patch::grid(patch.steps(eye, scale_px, error_px, 6));
        let points: Vec<_> = points.iter().map(|w| (patch.position(*w), patch.normal(*w))).collect();
        triangles.into_iter().map(move |t| t.map(|i| points[i]))
    };
    faces.iter().flat_map(of_face).collect()
}

/// Where a ray from the origin first meets a triangle: distance in lengths of the ray, and normal.
fn cast(triangles: &[[(DVec3, DVec3); 3]], origin: DVec3, ray: DVec3) -> Option<(f64, DVec3)> {
    let hits = triangles.iter().filter_map(|[a, b, c]| {
        let (u, v) = (b.0 - a.0, c.0 - a.0);
        let p = ray.cross(v);
        let det = u.dot(p);
        let from = origin - a.0;
        let s = from.dot(p) / det;
        let q = from.cross(u);
        let t = ray.dot(q) / det;
        let far = v.dot(q) / det;
        let inside = det.abs() > 1e-300 && s >= 0.0 && t >= 0.0 && s + t <= 1.0 && far > 0.0;
        inside.then(|| (far, a.1 * (1.0 - s - t) + b.1 * s + c.1 * t))
    });
    hits.min_by(|a, b| a.0.total_cmp(&b.0))
}

#[test]
fn flat_materials_are_not_curved() {
    let Some(mut h) = headless(64, 64) else { return };
    let ball = icosphere(1);
    let camera = Pose::look_at(DVec3::new(0.0, 0.0, 2.0), DVec3::ZERO, DVec3::Y, 0.6);
    let mut shown = |flat: bool, settings: Settings| {
        let ball = asset(&h, &ball, Material { flat, ..Material::default() });
        let drawables = [Drawable { asset: &ball, instances: &[at(0.0, 0.0, 0.0, 1.0)] }];
        h.frame(&Frame { settings, ..Frame::new(camera, &drawables) }).unwrap();
        h.picture().unwrap()
    };
    assert_eq!(shown(true, curved(0.1)), shown(true, Settings::default()));
    assert_ne!(shown(false, curved(0.1)), shown(false, Settings::default()));
}

#[test]
fn patches_match_their_cpu_reference() {
    let (width, height) = (96, 72);
    let Some(mut h) = headless(width, height) else { return };
    for (name, mesh, error) in [
        ("whole", icosphere(0), 0.25),
        ("coarse", icosphere(0), 4.0),
        ("creases", half_flat(&icosphere(1)), 0.25),
    ] {
        let ball = asset(&h, &mesh, Material::default());
        let eye = DVec3::new(0.5, 0.4, 1.1);
        let camera = Pose::look_at(eye, DVec3::ZERO, DVec3::Y, 0.9);
        let settings = Settings { near: NEAR, ..curved(error) };
        draw(&mut h, &ball, Placement::default(), camera, settings);
        keep(&h, &format!("pn-cpu_reference-{name}"));
        let (depth, normals) = (h.depth().unwrap(), h.intermediate(Resource::Normal, 8).unwrap());
        let normals: Vec<half::f16> = bytemuck::pod_collect_to_vec(&normals);
        let tan = camera.tan_half_fov(width, height);
        let scale_px = f64::from(height) / (2.0 * tan.1);
        let triangles = tessellated(&mesh, eye, scale_px, f64::from(error));
        let (mut n, mut edges, mut off_depth, mut off_normal) = (0, 0, 0.0_f64, 0.0_f64);
        for y in 0..height {
            for x in 0..width {
                let i = (y * width + x) as usize;
                let ray = view_ray([i64::from(x), i64::from(y)], [width, height], [tan.0, tan.1]);
                let ray = camera.rotation * DVec3::from(ray);
                let want = cast(&triangles, eye, ray);
                let shown = f64::from(depth[i]);
                let (Some((want, normal)), true) = (want, shown > 0.0) else {
                    // At the end of a surface a pixel's centre may be rounded to either side.
                    edges += usize::from(want.is_some() != (shown > 0.0));
                    continue;
                };
                n += 1;
                off_depth = off_depth.max((NEAR / shown - want).abs());
                let got =
                    crate::cpu_reference::brdf::from_octahedral([0, 1].map(|k| normals[4 * i + k].to_f64()));
                off_normal = off_normal.max(DVec3::from(got).angle_between(normal).to_degrees());
            }
        }
        assert!(n > 1500 && edges < 5, "{name}: {n} pixels, {edges} at edges");
        assert!(off_depth < 2e-5, "{name}: {off_depth}");
        assert!(off_normal < 0.2, "{name}: {off_normal}°");
    }
}

/// Number of pixels within a ball of radius ½ that show something behind its near half.
fn holes(h: &Headless, distance: f64, camera: Pose) -> usize {
    let (width, height) = h.size();
    let depth = h.depth().unwrap();
    let tan = camera.tan_half_fov(width, height);
    let pixels = (0..height).flat_map(|y| (0..width).map(move |x| (x, y)));
    let seen = pixels.filter(|&(x, y)| {
        let ray = DVec3::from(view_ray([i64::from(x), i64::from(y)], [width, height], [tan.0, tan.1]));
        // The ray's distance from the ball's centre.
        let across = distance * (ray.truncate().length() / ray.length());
        let shown = f64::from(depth[(y * width + x) as usize]);
        across < 0.3 && (shown == 0.0 || NEAR / shown > distance - 0.1)
    });
    seen.count()
}

#[test]
fn no_crack_opens_between_patches_at_any_distance() {
    let Some(mut h) = headless(160, 160) else { return };
    for (name, mesh) in
        [("smooth", icosphere(0)), ("finer", icosphere(2)), ("creases", half_flat(&icosphere(1)))]
    {
        let ball = asset(&h, &mesh, Material::default());
        let mut pictures = 0;
        for k in 0..24 {
            let distance = 0.62 * 1.15_f64.powi(k);
            let turn = DVec3::new(0.3 + f64::from(k) * 0.37, 0.2 * f64::from(k % 5) - 0.4, 1.0).normalize();
            let eye = turn * distance;
            let fov = (0.9 / distance).min(1.2);
            let camera = Pose::look_at(eye, DVec3::ZERO, DVec3::Y, fov);
            let settings = Settings { near: NEAR, occlusion: None, shadows: None, ..curved(0.1) };
            draw(&mut h, &ball, Placement::default(), camera, settings);
            let holes = holes(&h, distance, camera);
            if k == 3 {
                keep(&h, &format!("pn-cracks-{name}"));
            }
            assert_eq!(holes, 0, "{name} at {distance}");
            pictures += 1;
        }
        assert_eq!(pictures, 24);
    }
}

#[test]
fn from_within_a_ball_all_of_the_view_is_filled() {
    let Some(mut h) = headless(96, 64) else { return };
    let ball = asset(&h, &icosphere(0), Material::default());
    for (k, fov_y) in [0.1, 0.9, 2.5].into_iter().cycle().take(24).enumerate() {
        let turn = f64::from(k as u32);
        let eye = DVec3::new(0.2 * turn.sin(), 0.1 * (2.0 * turn).sin(), 0.2 * turn.cos());
        let towards = DVec3::new((0.9 * turn).cos(), (0.4 * turn).sin(), (0.9 * turn).sin());
        let camera = Pose::look_at(eye, eye + towards, DVec3::Y, fov_y);
        let settings = Settings { occlusion: None, shadows: None, ..curved(0.25) };
        draw(&mut h, &ball, Placement::default(), camera, settings);
        let empty = h.coverage().unwrap().iter().filter(|covered| !**covered).count();
        assert_eq!(empty, 0, "view {k}");
    }
}

#[test]
fn a_cube_stays_a_cube() {
    let Some(mut h) = headless(128, 96) else { return };
    let mut mesh = join(&[cube(), quad([-3.0, -0.5, -3.0], [0.0, 0.0, 6.0], [6.0, 0.0, 0.0], 1.0)]);
    mark_smooth(&mut mesh.0);
    let block = asset(&h, &mesh, Material::default());
    let turned = Placement { rotation: glam::Quat::from_rotation_y(0.6).into(), ..at(0.2, 0.1, -0.3, 1.3) };
    let camera = Pose::look_at(DVec3::new(1.5, 1.2, 2.0), DVec3::ZERO, DVec3::Y, 0.8);
    for anti_aliasing in AntiAliasing::ALL {
        let settings = Settings { anti_aliasing, ..Settings::default() };
        let plain = draw(&mut h, &block, turned, camera, settings);
        let bent = draw(&mut h, &block, turned, camera, Settings { anti_aliasing, ..curved(0.1) });
        if anti_aliasing != AntiAliasing::Temporal {
            assert!(plain == bent, "{}", anti_aliasing.name());
        }
    }
    keep(&h, "pn-cube");
}

#[test]
fn one_segment_per_edge_is_the_flat_triangle() {
    let Some(mut h) = headless(128, 96) else { return };
    let ball = asset(&h, &icosphere(1), Material { emission: [0.2; 3], ..Material::default() });
    let camera = Pose::look_at(DVec3::new(0.4, 0.6, 1.2), DVec3::ZERO, DVec3::Y, 0.8);
    let plain = draw(&mut h, &ball, Placement::default(), camera, Settings::default());
    for most in [0, 1] {
        let one = PnTriangles { error_px: 0.01, most };
        let settings = Settings { pn_triangles: Some(one), ..Settings::default() };
        assert!(plain == draw(&mut h, &ball, Placement::default(), camera, settings), "{most}");
    }
    let bent = draw(&mut h, &ball, Placement::default(), camera, curved(0.1));
    assert!(plain != bent);
}

#[test]
fn finer_patches_come_nearer_to_the_sphere() {
    let Some(mut h) = headless(128, 128) else { return };
    let camera = Pose::look_at(DVec3::new(0.0, 0.0, 2.0), DVec3::ZERO, DVec3::Y, 0.6);
    let fine = asset(&h, &icosphere(5), Material::default());
    let ball = asset(&h, &icosphere(1), Material::default());
    let truth = draw(&mut h, &fine, Placement::default(), camera, Settings::default());
    let off = |picture: &RgbaImage| {
        let pairs = picture.pixels().zip(truth.pixels());
        pairs.map(|(a, b)| (f64::from(a[1]) - f64::from(b[1])).powi(2)).sum::<f64>()
    };
    let plain = off(&draw(&mut h, &ball, Placement::default(), camera, Settings::default()));
    keep(&h, "pn-sphere-flat");
    let bent = off(&draw(&mut h, &ball, Placement::default(), camera, curved(0.25)));
    keep(&h, "pn-sphere-curved");
    println!("{plain} {bent}");
    assert!(bent * 10.0 < plain, "{bent} of {plain}");
}

#[test]
fn patches_match_the_mesh_tessellated_on_the_cpu() {
    let Some(mut h) = headless(128, 128) else { return };
    let ball = asset(&h, &half_flat(&icosphere(1)), Material::default());
    let (eye, fov_y) = (DVec3::new(0.6, 0.5, 1.9), 0.6);
    let camera = Pose::look_at(eye, DVec3::ZERO, DVec3::Y, fov_y);
    let instance = Placement { rotation: glam::Quat::from_rotation_x(0.4).into(), ..at(0.1, 0.0, 0.0, 1.2) };
    let bent = draw(&mut h, &ball, instance, camera, curved(0.25));
    let scale_px = 64.0 / camera.tan_half_fov(128, 128).1;
    let cut = PnTriangles::default().tessellated(h.gpu(), &ball, (&instance, eye, scale_px)).unwrap();
    assert!(cut.1.len() > 500, "{} triangles", cut.1.len());
    let cut = asset(&h, &cut, Material::default());
    let by_host = draw(&mut h, &cut, instance, camera, Settings::default());
    let pairs = bent.pixels().zip(by_host.pixels());
    let off = pairs.filter(|(a, b)| (0..3).any(|k| a[k].abs_diff(b[k]) > 6)).count();
    assert!(off < 10, "{off} pixels differ");
    // Flat triangles would differ in many pixels.
    let plain = draw(&mut h, &ball, instance, camera, Settings::default());
    let flat = plain.pixels().zip(by_host.pixels()).filter(|(a, b)| a[1].abs_diff(b[1]) > 6).count();
    assert!(flat > 100, "{flat} pixels of flat triangles differ");
}

#[test]
fn degenerate_input_of_patches_stays_finite() {
    let Some(mut h) = headless(96, 96) else { return };
    let (mut vertices, mut faces) = icosphere(1);
    vertices[0].normal = [0; 4];
    vertices[1] = PackedVertex::new(vertices[1].position, [f32::NAN; 3], [0.5; 2]).smooth();
    vertices[2] = PackedVertex::new(vertices[2].position, [-1.0, 0.5, 3e38], [0.5; 2]).smooth();
    vertices.push(vertices[5]);
    // Triangles without area (a corner twice by slot, or by position), and slots that were never written.
    faces.extend([[3, 3, 4], [5, vertices.len() as u32 - 1, 6], [0, 0, 0], [7, 8, 9_999]]);
    let ball = asset(&h, &(vertices, faces), Material::default());
    for instance in
        [at(0.0, 0.0, 0.0, 1.0), at(0.0, 0.0, 0.0, -1.0), at(0.0, 0.0, 0.0, 0.0), at(0.0, 0.0, 2.0, 1.0)]
    {
        for error_px in [f32::NAN, -1.0, 0.0, 0.25, f32::INFINITY] {
            let camera = Pose::look_at(DVec3::new(0.0, 0.0, 2.0), DVec3::ZERO, DVec3::Y, 0.6);
            draw(&mut h, &ball, instance, camera, curved(error_px));
            let radiance = h.intermediate(Resource::Radiance, 8).unwrap();
            let radiance: Vec<half::f16> = bytemuck::pod_collect_to_vec(&radiance);
            assert!(radiance.iter().all(|x| x.is_finite()), "{error_px} {instance:?}");
        }
    }
}

#[test]
fn all_passes_meet_the_same_patches() {
    let Some(mut h) = headless(96, 96) else { return };
    let camera = Pose::look_at(DVec3::new(0.0, 0.3, 2.0), DVec3::ZERO, DVec3::Y, 0.6);
    let mesh = icosphere(0);
    let punctual_light = asset(&h, &mesh, Material { emission: [4.0, 0.0, 0.0], ..Material::default() });
    let settings =
        Settings { shadows: None, occlusion: None, anti_aliasing: AntiAliasing::None, ..curved(0.1) };
    let picture = draw(&mut h, &punctual_light, Placement::default(), camera, settings);
    keep(&h, "pn-emission");
    let covered = h.coverage().unwrap();
    let dark = picture.pixels().zip(&covered).filter(|(pixel, covered)| **covered && pixel[0] < 240).count();
    assert_eq!(dark, 0, "pixels without emission of {}", covered.iter().filter(|c| **c).count());

    // Motion vectors of a moving instance point to where it was drawn.
    let ball = asset(&h, &mesh, Material::default());
    let seen = Settings { debug_view: DebugView::Motion, ..settings };
    draw(&mut h, &ball, at(-0.05, 0.0, 0.0, 1.0), camera, seen);
    let moved = draw(&mut h, &ball, at(0.0, 0.0, 0.0, 1.0), camera, seen);
    keep(&h, "pn-motion");
    let covered = h.coverage().unwrap();
    let still =
        moved.pixels().zip(&covered).filter(|(p, covered)| **covered && p[0].abs_diff(p[2]) < 8).count();
    assert_eq!(still, 0, "pixels without motion");

    // Wireframe, overdraw, transparency, and shadows of several instances.
    let glass =
        Material { base_color: [0.7, 0.7, 0.7, 0.5], alpha: crate::Alpha::Blend, ..Material::default() };
    let glass = asset(&h, &mesh, glass);
    let instances = [at(-0.4, 0.0, 0.3, 0.7), at(0.4, 0.0, -0.3, 0.7), at(0.0, 0.3, 0.0, 0.4)];
    let floor =
        asset(&h, &quad([-3.0, -0.5, -3.0], [0.0, 0.0, 6.0], [6.0, 0.0, 0.0], 1.0), Material::default());
    let drawables = [
        Drawable { asset: &floor, instances: &[at(0.0, 0.0, 0.0, 1.0)] },
        Drawable { asset: &glass, instances: &instances },
        Drawable { asset: &ball, instances: &instances[..2] },
    ];
    for settings in [
        Settings { wireframe: true, ..curved(0.25) },
        curved(0.25),
        Settings { debug_view: DebugView::Overdraw, ..curved(0.25) },
        Settings { anti_aliasing: AntiAliasing::Temporal, ..curved(0.25) },
    ] {
        let frame = Frame { settings, ..Frame::new(camera, &drawables) };
        let counters = h.frame(&frame).unwrap();
        assert!(counters.passes.contains(&PassId::Patches));
        keep(&h, &format!("pn-passes-{}-{}", settings.debug_view.name(), settings.wireframe));
        let flat = Frame { settings: Settings { pn_triangles: None, ..settings }, ..frame };
        assert!(!h.frame(&flat).unwrap().passes.contains(&PassId::Patches));
    }
}

#[test]
fn pictures_are_the_same_each_time() {
    let Some(mut h) = headless(96, 96) else { return };
    let ball = asset(&h, &sphere(6), Material::default());
    let camera = Pose::look_at(DVec3::new(0.3, 0.5, 1.2), DVec3::ZERO, DVec3::Y, 0.9);
    let first = draw(&mut h, &ball, Placement::default(), camera, curved(0.25));
    for _ in 0..5 {
        assert!(first == draw(&mut h, &ball, Placement::default(), camera, curved(0.25)));
    }
}
