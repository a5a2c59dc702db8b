//! Picking and bounds of parts, against a search of another kind over the source meshes.

use std::collections::BTreeMap;

use geometry::mesh::{Corner, SourceMesh};
use geometry::quantise::{QuantiseSettings, quantise};
use glam::{DQuat, DVec3};
use lodestream_geometry as geometry;
use lodestream_scene::description::{Camera, Instance};
use lodestream_scene::parts::{PartTransform, ScenePart};
use lodestream_scene::placement::Placement;
use lodestream_scene::section::{SectionPlane, SectionPlanes};

use super::super::testing::coded;
use super::super::{Hit, Ray};
use super::{Loopback, TestScene, view};

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

const PARTS: u32 = 48;

/// Bumpy spheres in a box of 8 × 8 × 8, far from zero, each a part.
fn batch() -> SourceMesh {
    let mut random = Random(1);
    let mut mesh = SourceMesh::default();
    for part in 0..PARTS {
        let (centre, size) = (4.0 * random.point() + DVec3::splat(1000.0), 0.5 + 0.3 * random.next());
        let (rings, columns) = (7, 11);
        let first = mesh.positions.len() as u32;
        for ring in 0..=rings {
            for column in 0..columns {
                let (v, u) = (f64::from(ring) / f64::from(rings), f64::from(column) / f64::from(columns));
                let (sin, cos) = (std::f64::consts::PI * v).sin_cos();
                let (y, x) = (std::f64::consts::TAU * u).sin_cos();
                let bump = size * (1.0 + 0.2 * (9.0 * u * v + f64::from(part)).sin());
                mesh.positions.push((centre + DVec3::new(x * sin, cos, y * sin) * bump).to_array());
            }
        }
        let at = |ring: u32, column: u32| Corner::at(first + ring * columns + column % columns);
        for (ring, column) in (0..rings).flat_map(|ring| (0..columns).map(move |column| (ring, column))) {
            let [a, b] = [at(ring, column), at(ring, column + 1)];
            let [c, d] = [at(ring + 1, column + 1), at(ring + 1, column)];
            mesh.faces.extend([[a, b, c], [a, c, d]]);
            mesh.materials.extend([0; 2]);
            mesh.parts.extend([part; 2]);
        }
    }
    mesh
}

fn instances() -> Vec<Instance> {
    let place = |at: DVec3, turn: f64, scale: f32| {
        let rotation = DQuat::from_axis_angle(DVec3::new(1.0, 2.0, -1.0).normalize(), turn);
        // About the middle of the batch.
        let middle = rotation * DVec3::splat(1000.0) * f64::from(scale);
        Instance { asset: 0, placement: Placement::new(at - middle, rotation, scale) }
    };
    vec![place(DVec3::ZERO, 0.0, 1.0), place(DVec3::new(9.0, 1.0, -2.0), 0.8, 0.7)]
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

/// A part of the source in the world.
struct SourcePart {
    part: ScenePart,
    centre: DVec3,
    radius: f64,
    faces: Vec<[DVec3; 3]>,
}

fn parts(source: &SourceMesh, instances: &[Instance]) -> Vec<SourcePart> {
    let mut parts = Vec::new();
    for (instance, placed) in (0..).zip(instances) {
        for part in 0..PARTS {
            let at = |c: Corner| placed.placement.to_world(source.positions[c.position as usize].into());
            let own = source.faces.iter().zip(&source.parts).filter(|(_, own)| **own == part);
            let faces: Vec<_> = own.map(|(face, _)| face.map(at)).collect();
            let corners = || faces.iter().flatten();
            let centre = corners().sum::<DVec3>() / corners().count() as f64;
            let radius = corners().map(|at| at.distance(centre)).fold(0.0, f64::max) + 0.01;
            parts.push(SourcePart { part: ScenePart { instance, part }, centre, radius, faces });
        }
    }
    parts
}

/// The nearest part on a ray of unit direction that is not hidden.
fn search(parts: &[SourcePart], ray: Ray, hidden: Option<ScenePart>) -> Option<(ScenePart, f64)> {
    let aside = |part: &SourcePart| (part.centre - ray.origin).cross(ray.direction).length();
    let seen = parts.iter().filter(|part| Some(part.part) != hidden && aside(part) <= part.radius);
    let met = seen.flat_map(|part| part.faces.iter().map(move |face| (part.part, face)));
    let met = met.filter_map(|(part, face)| Some((part, meeting(ray, *face)?)));
    met.min_by(|a, b| a.1.total_cmp(&b.1))
}

/// The scene, refined whole.
fn whole(source: &SourceMesh) -> Loopback {
    let mesh = quantise(source, &QuantiseSettings::default()).unwrap();
    let scene = TestScene::of(&coded(&mesh, geometry::Codec::Range), 1).with_instances(instances());
    let camera = Camera { eye: [4.0, 8.0, 30.0], target: [4.0, 0.0, 0.0], ..scene.camera() };
    let mut link = Loopback::new(scene, |_| {});
    link.connect();
    link.core.set_view(link.now, view(camera, 1e-5));
    link.settle();
    assert_eq!(link.core.mesh(0).unwrap().face_count(), mesh.faces.len());
    link
}

#[test]
fn ten_thousand_rays_meet_the_parts_of_the_source() {
    let source = batch();
    let mut link = whole(&source);
    let sent = link.sent.len();
    let parts = parts(&source, &instances());
    // Positions are on a grid: where a ray passes an edge by no more, either side is right.
    let step = link.core.mesh(0).unwrap().grid().step;
    let mut random = Random(2);
    let (mut hits, mut hidden_hits, mut near_edges) = (0, 0, 0);
    for number in 0..10_000 {
        let from = DVec3::new(4.0, 0.0, 0.0) + 25.0 * random.point().normalize();
        let toward = &parts[((random.next() + 1.0) * f64::from(PARTS)) as usize];
        let at = toward.centre + 1.2 * toward.radius * random.point();
        // Any length.
        let ray = Ray { origin: from, direction: (at - from) * (1.5 + random.next()) };
        let unit = Ray { direction: ray.direction.normalize(), ..ray };
        // Every third time what is behind the first part.
        let first = search(&parts, unit, None).filter(|_| number % 3 == 0);
        let hidden = first.map(|(part, _)| part);
        let got = link.core.pick(ray, |part| Some(part) == hidden);
        let same = |ray: Ray| match (got, search(&parts, ray, hidden)) {
            (None, None) => true,
            (Some(hit), Some((part, distance))) => {
                hit.scene_part() == Some(part) && (hit.distance - distance).abs() < 40.0 * step
            }
            _ => false,
        };
        if !same(unit) {
            near_edges += 1;
            let aside = unit.direction.any_orthonormal_vector();
            let across = unit.direction.cross(aside);
            let near = (0..16).map(|n| std::f64::consts::TAU * f64::from(n) / 16.0).flat_map(|turn| {
                let by = aside * turn.cos() + across * turn.sin();
                [1.0, 3.0].map(|steps| Ray { origin: unit.origin + by * step * steps, ..unit })
            });
            assert!(near.into_iter().any(same), "ray {number}: {got:?}, {:?}", search(&parts, unit, hidden));
        }
        let Some(hit @ Hit { place, distance, .. }) = got else { continue };
        assert!((place - (unit.origin + unit.direction * distance)).length() < 1e-9);
        hits += 1;
        hidden_hits += u32::from(hidden.is_some());
        assert!(hit.scene_part().is_some_and(|part| Some(part) != hidden));
    }
    println!("{hits} hits, {hidden_hits} behind hidden parts, {near_edges} near edges, grid step {step}");
    assert!(hits > 4000 && hidden_hits > 500 && near_edges < 100, "{hits} {hidden_hits} {near_edges}");
    // Nothing was requested.
    link.run(200);
    assert_eq!(link.sent.len(), sent);
}

#[test]
fn bounds_of_parts_are_those_of_the_source() {
    let source = batch();
    let link = whole(&source);
    let step = link.core.mesh(0).unwrap().grid().step;
    for SourcePart { part, faces, .. } in parts(&source, &instances()) {
        let bounds = link.core.part_bounds(part).unwrap();
        let low = faces.iter().flatten().copied().reduce(DVec3::min).unwrap();
        let high = faces.iter().flatten().copied().reduce(DVec3::max).unwrap();
        assert!(bounds.extent[0].distance(low) < 2.0 * step, "{part:?}: {bounds:?}, {low}");
        assert!(bounds.extent[1].distance(high) < 2.0 * step, "{part:?}: {bounds:?}, {high}");
        let farthest = faces.iter().flatten().map(|at| at.distance(bounds.centre)).fold(0.0, f64::max);
        assert!((bounds.radius - farthest).abs() < 4.0 * step, "{part:?}: {bounds:?}, {farthest}");
    }
    assert_eq!(link.core.part_bounds(ScenePart { instance: 0, part: PARTS }), None);
    assert_eq!(link.core.part_bounds(ScenePart { instance: 2, part: 0 }), None);
}

/// The source with some parts elsewhere in their instance.
fn moved_source(source: &SourceMesh, moved: &BTreeMap<ScenePart, PartTransform>) -> Vec<SourcePart> {
    let mut all = parts(source, &instances());
    for part in &mut all {
        let Some(to) = moved.get(&part.part) else { continue };
        let placement = instances()[part.part.instance as usize].placement;
        let back = placement.orientation().as_dquat().inverse();
        let into = |at: DVec3| back * (at - DVec3::from(placement.translation)) / f64::from(placement.scale);
        let place = |at: DVec3| placement.to_world(to.apply(into(at)));
        part.faces.iter_mut().for_each(|face| *face = face.map(place));
        (part.centre, part.radius) = (place(part.centre), part.radius * to.scale());
    }
    all
}

#[test]
fn moved_parts_are_met_where_they_are_without_a_byte() {
    let source = batch();
    let mut link = whole(&source);
    let sent = link.sent.len();
    let mut random = Random(5);
    // Every third part: turned and scaled about the batch's middle, and moved out of the batch.
    let moved: BTreeMap<ScenePart, PartTransform> = (0..2)
        .flat_map(|instance| (0..PARTS).step_by(3).map(move |part| ScenePart { instance, part }))
        .map(|part| {
            let turn = DQuat::from_axis_angle(random.point().normalize(), random.next());
            let (middle, scale) = (DVec3::splat(1000.0), 1.0 + 0.4 * random.next());
            let by = 6.0 * random.point().normalize();
            (part, PartTransform::new(middle + by - turn * (scale * middle), turn, scale).unwrap())
        })
        .collect();
    link.core.move_parts(&moved);
    link.run(200);
    assert_eq!(link.sent.len(), sent, "nothing was requested");
    let step = 2.0 * link.core.mesh(0).unwrap().grid().step;
    let parts = moved_source(&source, &moved);
    let (mut hits, mut moved_hits, mut others) = (0, 0, 0);
    for _ in 0..2_000 {
        let from = DVec3::new(4.0, 0.0, 0.0) + 40.0 * random.point().normalize();
        let toward = &parts[((random.next() + 1.0) * f64::from(PARTS)) as usize];
        let at = toward.centre + 1.2 * toward.radius * random.point();
        let ray = Ray { origin: from, direction: (at - from).normalize() };
        let got = link.core.pick(ray, |_| false);
        match (got, search(&parts, ray, None)) {
            (None, None) => {}
            (Some(hit), Some((part, distance)))
                if hit.scene_part() == Some(part) && (hit.distance - distance).abs() < 40.0 * step =>
            {
                hits += 1;
                moved_hits += u32::from(moved.contains_key(&part));
            }
            // Past an edge.
            _ => others += 1,
        }
    }
    println!("{hits} hits, {moved_hits} of moved parts, {others} near edges");
    assert!(hits > 800 && moved_hits > 200 && others < 40, "{hits} {moved_hits} {others}");
    for SourcePart { part, faces, .. } in &parts {
        let bounds = link.core.part_bounds(*part).unwrap();
        let low = faces.iter().flatten().copied().reduce(DVec3::min).unwrap();
        let high = faces.iter().flatten().copied().reduce(DVec3::max).unwrap();
        let off = bounds.extent[0].distance(low).max(bounds.extent[1].distance(high));
        assert!(off < 2.0 * step, "{part:?}: {bounds:?}, {low}, {high}");
    }
    link.core.move_parts(&BTreeMap::new());
    let bounds = link.core.part_bounds(ScenePart { instance: 0, part: 0 }).unwrap();
    let still = &moved_source(&source, &BTreeMap::new())[0];
    assert!(bounds.centre.distance(still.centre) < still.radius);
}

/// More instances on a ray than are searched at once.
#[test]
fn a_ray_passes_hidden_instances_to_the_last() {
    let row = (0..64).map(|n| Instance::at(0, [3.0 * f64::from(n), 0.0, 0.0])).collect();
    let mut link = Loopback::new(TestScene::new(1).with_instances(row), |_| {});
    link.connect();
    link.settle();
    // Just above the hills' lowest places.
    let ray = Ray { origin: DVec3::new(-5.0, 0.0, 0.1), direction: DVec3::X };
    let mut last = 0.0;
    for seen in [0, 1, 15, 16, 17, 40, 63] {
        let hit = link.core.pick(ray, |part| part.instance < seen).unwrap();
        assert_eq!(hit.scene_part(), Some(ScenePart { instance: seen, part: 0 }));
        assert!(hit.distance > last, "{hit:?}");
        last = hit.distance;
    }
    assert_eq!(link.core.pick(ray, |_| true), None);
    // From the other end.
    let back = Ray { origin: DVec3::new(250.0, 0.0, 0.1), direction: -DVec3::X };
    assert_eq!(link.core.pick(back, |part| part.instance > 20).unwrap().instance, 20);
    for bad in [DVec3::ZERO, DVec3::NAN, DVec3::new(f64::INFINITY, 0.0, 0.0)] {
        assert_eq!(link.core.pick(Ray { direction: bad, ..ray }, |_| false), None);
        assert_eq!(link.core.pick(Ray { origin: bad / 0.0, ..ray }, |_| false), None);
    }
}

#[test]
fn a_cut_ray_meets_what_section_planes_leave() {
    let row = (0..64).map(|n| Instance::at(0, [3.0 * f64::from(n), 0.0, 0.0])).collect();
    let mut link = Loopback::new(TestScene::new(1).with_instances(row), |_| {});
    link.connect();
    link.settle();
    let ray = Ray { origin: DVec3::new(-5.0, 0.0, 0.1), direction: DVec3::X * 2.0 };
    let pick = |planes: &[(DVec3, f64)]| {
        let planes: Vec<_> = planes.iter().map(|(n, d)| SectionPlane::new(*n, *d).unwrap()).collect();
        link.core.pick_cut(ray, &SectionPlanes::new(&planes).unwrap(), |_| false)
    };
    let first = pick(&[]).unwrap();
    assert_eq!(Some(first), link.core.pick(ray, |_| false));
    // Inside an instance: its face behind the cut is met.
    let at = first.place.x + 30.001;
    let hit = pick(&[(DVec3::NEG_X, -at)]).unwrap();
    let beyond = Ray { origin: DVec3::new(at, 0.0, 0.1), ..ray };
    let same = link.core.pick(beyond, |_| false).unwrap();
    assert_eq!((hit.instance, hit.part), (same.instance, same.part));
    assert!(hit.instance >= 10 && (hit.distance - (at + 5.0 + same.distance)).abs() < 1e-9, "{hit:?}");
    assert!((hit.place.x + 5.0 - hit.distance).abs() < 1e-9);
    // What lies behind a plane that the ray goes into is cut away.
    assert_eq!(pick(&[(DVec3::X, first.place.x - 1e-3)]), None);
    assert_eq!(pick(&[(DVec3::X, first.place.x + 1e-3)]), Some(first));
    assert_eq!(pick(&[(DVec3::Z, 0.0)]), None);
}
