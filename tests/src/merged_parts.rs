//! Parts of a file that is prepared as one mesh, merged or as a batch: they are called and picked as the file has them.

use std::path::Path;

use data_encoding::BASE64;
use glam::{DMat4, DQuat, DVec3};
use lodestream_bake::scene::parse;
use lodestream_client::core::{Config, Ray, StartView};
use lodestream_daemon::SessionSettings;
use lodestream_scene::parts::ScenePart;
use serde_json::{Value, json};

use crate::support::PICTURE_PX;
use crate::support::daemon::{Server, Transport};
use crate::support::scene::{TestScene, prepare_all};
use crate::support::viewer::Viewer;

const PARTS: usize = 40;
const RAYS: usize = 10_000;

/// Splitmix64 (Steele et al. 2014), as numbers from -1 to 1.
struct Random(u64);

impl Random {
    fn next(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) >> 11) as f64 / (1_u64 << 52) as f64 - 1.0
    }

    fn point(&mut self) -> DVec3 {
        DVec3::new(self.next(), self.next(), self.next())
    }
}

/// Corners of the faces of a bumpy sphere, from pole to equator or from there to the other pole.
fn half_sphere(bumps: f64, lower: bool) -> Vec<[DVec3; 3]> {
    let (rings, columns) = (4, 9);
    let at = |ring: u32, column: u32| {
        let ring = ring + if lower { rings } else { 0 };
        let v = f64::from(ring) / f64::from(2 * rings);
        let u = f64::from(column % columns) / f64::from(columns);
        let (sin, cos) = (std::f64::consts::PI * v).sin_cos();
        let (y, x) = (std::f64::consts::TAU * u).sin_cos();
        let radius = 0.5 * (1.0 + 0.2 * (bumps * u * v).sin());
        // As the file has them.
        (DVec3::new(x * sin, cos, y * sin) * radius).as_vec3().as_dvec3()
    };
    let quads = (0..rings).flat_map(|ring| (0..columns).map(move |column| (ring, column)));
    let faces = quads.flat_map(|(ring, column)| {
        let [a, b] = [at(ring, column), at(ring, column + 1)];
        let [c, d] = [at(ring + 1, column + 1), at(ring + 1, column)];
        [[a, b, c], [a, c, d]]
    });
    faces.filter(|[a, b, c]| (*b - *a).cross(*c - *a).length() > 0.0).collect()
}

/// Writes meshes of two primitives each, placed on a floor of a site; returns the faces of each part in the scene.
fn write_site(path: &Path, count: usize) -> Vec<Vec<[DVec3; 3]>> {
    let mut random = Random(3);
    let (mut bytes, mut views, mut accessors) = (Vec::new(), vec![], vec![]);
    let (mut meshes, mut nodes, mut parts) = (vec![], vec![], Vec::new());
    for part in 0..count {
        let halves = [false, true].map(|lower| half_sphere(5.0 + part as f64, lower));
        let primitives: Vec<Value> = (0..)
            .zip(&halves)
            .map(|(material, faces)| {
                let offset = bytes.len();
                let corners = faces.as_flattened();
                bytes.extend(corners.iter().flat_map(|at| at.as_vec3().to_array()).flat_map(f32::to_le_bytes));
                views.push(json!({"buffer": 0, "byteOffset": offset, "byteLength": bytes.len() - offset}));
                let low = corners.iter().copied().reduce(DVec3::min).unwrap();
                let high = corners.iter().copied().reduce(DVec3::max).unwrap();
                accessors.push(json!({
                    "bufferView": views.len() - 1, "componentType": 5126, "type": "VEC3", "count": corners.len(),
                    "min": low.to_array(), "max": high.to_array(),
                }));
                json!({"attributes": {"POSITION": accessors.len() - 1}, "material": material})
            })
            .collect();
        meshes.push(json!({"primitives": primitives}));
        let translation = (4.0 * random.point() + DVec3::new(0.0, 0.0, 1000.0)).as_vec3();
        let axis = random.point().normalize();
        let rotation = DQuat::from_axis_angle(axis, 3.0 * random.next()).as_quat();
        let scale = glam::Vec3::splat(1.25) + (0.5 * random.point()).as_vec3();
        nodes.push(json!({
            "mesh": part, "name": format!("part {part}"), "extras": {"id": part}, "translation": translation.to_array(),
            "rotation": rotation.to_array(), "scale": scale.to_array(),
        }));
        let rotation = rotation.as_dquat().normalize();
        let to_scene =
            DMat4::from_scale_rotation_translation(scale.as_dvec3(), rotation, translation.as_dvec3());
        let faces = halves.into_iter().flatten();
        parts.push(faces.map(|face| face.map(|at| to_scene.transform_point3(at))).collect());
    }
    let children: Vec<usize> = (0..count).collect();
    nodes.push(json!({"name": "floor", "children": children}));
    nodes.push(json!({"name": "site", "children": [count]}));
    let uri = format!("data:application/octet-stream;base64,{}", BASE64.encode(&bytes));
    let file = json!({
        "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [count + 1]}], "nodes": nodes, "meshes": meshes,
        "materials": [{}, {"pbrMetallicRoughness": {"baseColorFactor": [1.0, 0.2, 0.1, 1.0]}}],
        "accessors": accessors, "bufferViews": views, "buffers": [{"byteLength": bytes.len(), "uri": uri}],
    });
    std::fs::write(path, file.to_string()).unwrap();
    parts
}

/// Where a ray meets a triangle: by the plane, and the signs of the volumes with its sides.
fn meeting(ray: Ray, [a, b, c]: [DVec3; 3]) -> Option<f64> {
    let [a, b, c] = [a, b, c].map(|corner| corner - ray.origin);
    let side = |p: DVec3, q: DVec3| ray.direction.dot(p.cross(q));
    let sides = [side(a, b), side(b, c), side(c, a)];
    let inside = sides.iter().all(|s| *s >= 0.0) || sides.iter().all(|s| *s <= 0.0);
    let normal = (b - a).cross(c - a);
    let distance = normal.dot(a) / normal.dot(ray.direction);
    (inside && distance >= 0.0 && distance.is_finite()).then_some(distance)
}

/// The nearest part of the file on a ray of unit direction.
fn search(parts: &[Vec<[DVec3; 3]>], ray: Ray) -> Option<(u32, f64)> {
    let aside = |at: DVec3| (at - ray.origin).cross(ray.direction).length();
    // No corner is farther from another than 2.2.
    let near = (0..).zip(parts).filter(|(_, faces)| aside(faces[0][0]) < 2.5);
    let met = near.flat_map(|(part, faces)| faces.iter().map(move |face| (part, meeting(ray, *face))));
    let met = met.filter_map(|(part, distance)| Some((part, distance?)));
    met.min_by(|a, b| a.1.total_cmp(&b.1))
}

#[test]
fn parts_of_a_merged_file_are_called_and_picked_as_the_file_has_them() {
    check("merge = true", "Whole");
}

#[test]
fn parts_of_a_batch_are_called_and_picked_as_the_file_has_them() {
    check("batch = 'auto'", "Batch");
}

/// Compares what is served with the file, of which a line of settings makes one asset of this kind.
fn check(settings: &str, kind: &str) {
    let folder = tempfile::tempdir().unwrap();
    let parts = write_site(&folder.path().join("site.gltf"), PARTS);
    let text =
        format!("[[asset]]\nname = 'site'\nfile = 'site.gltf'\n{settings}\n[[instance]]\nasset = 'site'\n");
    let scene = parse(&folder.path().join("scene.toml"), &text).unwrap();
    let [asset] = &scene.assets[..] else { panic!("{} assets", scene.assets.len()) };
    assert!(format!("{:?}", asset.part).starts_with(kind), "{:?}", asset.part);
    let test_scene = TestScene::open(&scene, prepare_all(&scene, &folder.path().join("cache")));
    let server = Server::start(test_scene.source(), SessionSettings::default());
    // So fine that all is wanted.
    let whole = Config::new(StartView::OfScene { viewport_px: PICTURE_PX, target_px: 1e-3 });
    let mut viewer = Viewer::start(&server.address(Transport::Quic), whole);
    for part in 0..PARTS as u32 {
        let info = viewer.part(0, part).unwrap();
        assert_eq!((&*info.name, &*info.path), (&*format!("part {part}"), "site/floor"));
        assert_eq!(info.extras, Some(json!({"id": part}).to_string()));
    }
    assert!(viewer.part(0, PARTS as u32).is_err());
    viewer.settle();

    let mut random = Random(4);
    let middle = DVec3::new(0.0, 0.0, 1000.0);
    let rays: Vec<Ray> = (0..RAYS)
        .map(|_| {
            let origin = middle + 12.0 * random.point().normalize();
            let toward = middle + 4.5 * random.point();
            Ray { origin, direction: (toward - origin).normalize() }
        })
        .collect();
    let asked = rays.clone();
    let (faces, step, hits) = viewer.ask(move |core| {
        let mesh = core.mesh(0).unwrap();
        let hits: Vec<_> = asked.into_iter().map(|ray| core.pick(ray, |_| false)).collect();
        (mesh.face_count(), mesh.grid().step, hits)
    });
    assert_eq!(faces, parts.iter().map(Vec::len).sum::<usize>(), "refined whole");
    let (mut met, mut near_edges) = (0, 0);
    for (ray, hit) in rays.into_iter().zip(hits) {
        let same = |ray: Ray| match (hit, search(&parts, ray)) {
            (None, None) => true,
            (Some(hit), Some((part, distance))) => {
                hit.scene_part() == Some(ScenePart { instance: 0, part })
                    && (hit.distance - distance).abs() < 40.0 * step
            }
            _ => false,
        };
        met += usize::from(hit.is_some());
        if same(ray) {
            continue;
        }
        // Positions are on a grid: where a ray passes an edge by no more, either side is right.
        near_edges += 1;
        let aside = ray.direction.any_orthonormal_vector();
        let across = ray.direction.cross(aside);
        let near = (0..16).map(|n| std::f64::consts::TAU * f64::from(n) / 16.0).flat_map(|turn| {
            let by = aside * turn.cos() + across * turn.sin();
            [1.0, 3.0].map(|steps| Ray { origin: ray.origin + by * step * steps, ..ray })
        });
        assert!(near.into_iter().any(same), "{ray:?}: {hit:?}, {:?}", search(&parts, ray));
    }
    println!("{met} of {RAYS} rays met a part, {near_edges} near edges, grid step {step}");
    assert!(met > RAYS / 4 && near_edges < RAYS / 50, "{met} {near_edges}");
    server.assert_healthy();
}
