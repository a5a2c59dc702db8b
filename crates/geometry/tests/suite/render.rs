//! Render data: normals, texture coordinates, morph origins, dirty slots.

use std::collections::BTreeSet;

use lodestream_geometry::mesh::QuantisedMesh;
use lodestream_geometry::prepare::Prepared;
use lodestream_geometry::random::Random;
use lodestream_geometry::refine::{ActiveMesh, ChunkDelta, DirtySlots, Id, Origin, RenderVertex};

use crate::common::{all, plain_faces, prepared, quantised, regions, shapes};
use crate::invariants::deltas;

/// The wedge slots that faces use.
fn live_wedges(mesh: &ActiveMesh) -> BTreeSet<u32> {
    (0..mesh.material_count())
        .flat_map(|m| mesh.indices(m))
        .filter(|t| **t != [0; 3])
        .flatten()
        .copied()
        .collect()
}

fn full(mesh: &QuantisedMesh) -> ActiveMesh {
    deltas(&prepared(mesh, &regions(200))).0
}

fn dot(a: [f32; 3], b: [f32; 3]) -> f32 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

#[test]
fn normals_of_a_sphere_point_outwards_at_every_level() {
    let mesh = quantised(&shapes::sphere(40, 60, 0.0));
    let asset = prepared(&mesh, &regions(200));
    let deltas = deltas(&asset).1;
    let mut active = ActiveMesh::new(&asset.base);
    for at in 0..=deltas.len() {
        let least = if at == deltas.len() { 0.99 } else { 0.3 };
        for slot in live_wedges(&active) {
            let v = active.render_vertex(slot);
            let out = [0, 1, 2].map(|k| (f64::from(v.position[k]) + mesh.grid.origin[k]) as f32);
            assert!((dot(v.normal, v.normal) - 1.0).abs() < 1e-5, "{v:?}");
            assert!(dot(v.normal, out) > least, "{at} chunks: {v:?}");
        }
        if let Some(delta) = deltas.get(at) {
            active.apply(delta).unwrap();
        }
    }
}

#[test]
fn creases_of_a_cube_are_kept() {
    let active = full(&quantised(&shapes::flat_shaded(shapes::cube(2.0))));
    let wedges = live_wedges(&active);
    assert_eq!(wedges.len(), 24);
    for slot in wedges {
        let n = active.render_vertex(slot).normal;
        assert_eq!(n.iter().filter(|x| x.abs() == 1.0).count(), 1, "{n:?}");
    }
    // The same cube without source normals is smooth: one normal per corner, along the diagonals.
    let active = full(&quantised(&shapes::cube(2.0)));
    let wedges = live_wedges(&active);
    assert_eq!(wedges.len(), 8);
    for slot in wedges {
        let vertex = active.render_vertex(slot);
        assert!(vertex.smooth && vertex.normal.iter().all(|x| x.abs() > 0.2));
    }
}

#[test]
fn shading_is_smooth_across_texture_seams() {
    let asset = prepared(&quantised(&shapes::torus(40, 70)), &regions(200));
    let deltas = deltas(&asset).1;
    let mut active = ActiveMesh::new(&asset.base);
    for delta in &deltas {
        active.apply(delta).unwrap();
    }
    let mut seen: Vec<([u32; 3], RenderVertex)> = live_wedges(&active)
        .into_iter()
        .map(|slot| active.render_vertex(slot))
        .map(|v| (v.position.map(f32::to_bits), v))
        .collect();
    seen.sort_by_key(|s| s.0);
    let mut seams = 0;
    for pair in seen.windows(2).filter(|p| p[0].0 == p[1].0) {
        seams += 1;
        assert_ne!(pair[0].1.uv, pair[1].1.uv);
        assert_eq!(pair[0].1.normal, pair[1].1.normal);
        assert!(pair[0].1.smooth && pair[1].1.smooth);
    }
    assert_eq!(seams, 40 + 70 + 1);
}

#[test]
fn vertices_morph_from_where_they_or_their_ancestors_were() {
    for (name, source) in all() {
        let asset = prepared(&quantised(&source), &regions(200));
        let deltas = deltas(&asset).1;
        let mut active = ActiveMesh::new(&asset.base);
        for slot in live_wedges(&active) {
            let v = active.render_vertex(slot);
            assert_eq!(v.position, v.morph_from, "{name}: the base mesh has nothing to come from");
        }
        let place = |q: [i32; 3]| q.map(|x| ((f64::from(x) * asset.base.grid.step) as f32).to_bits());
        for delta in &deltas {
            let before = active.snapshot();
            active.apply(delta).unwrap();
            let moves = delta.moves.iter().map(|m| (place(m.to), place(m.from)));
            let expected: BTreeSet<_> = (0..delta.vertices.len())
                .map(|i| (place(delta.vertices[i].position), place(source_of(delta, i, &before.vertices))))
                .chain(moves)
                .collect();
            let got: BTreeSet<_> = live_wedges(&active)
                .into_iter()
                .filter(|&slot| active.wedge_chunk(slot) == Some(delta.chunk))
                .map(|slot| active.render_vertex(slot))
                .map(|v| (v.position.map(f32::to_bits), v.morph_from.map(f32::to_bits)))
                .collect();
            assert_eq!(got, expected, "{name}: chunk {}", delta.chunk);
        }
    }
}

/// Origin of a new vertex on the mesh without its chunk.
fn source_of(delta: &ChunkDelta, index: usize, before: &[(Id, [i32; 3], u32)]) -> [i32; 3] {
    match delta.vertices[index].origin {
        Origin::Split(p) if p.owner == delta.chunk + 1 => source_of(delta, p.index as usize, before),
        Origin::Split(p) => before[before.binary_search_by_key(&p, |v| v.0).unwrap()].1,
        Origin::Part(_) => delta.vertices[index].position,
    }
}

/// A renderer that uploads dirty slots only.
struct UploadMirror {
    vertices: Vec<Option<RenderVertex>>,
    indices: Vec<Vec<[u32; 3]>>,
}

impl UploadMirror {
    fn new(mesh: &ActiveMesh) -> Self {
        let mut mirror = Self { vertices: Vec::new(), indices: Vec::new() };
        mirror.indices = (0..mesh.material_count()).map(|m| mesh.indices(m).to_vec()).collect();
        let mut everything = DirtySlots::default();
        everything.wedges.extend(live_wedges(mesh));
        mirror.upload(mesh, &everything);
        mirror
    }

    fn upload(&mut self, mesh: &ActiveMesh, dirty: &DirtySlots) {
        self.vertices.resize(mesh.wedge_slots() as usize, None);
        for &slot in &dirty.wedges {
            self.vertices[slot as usize] = Some(mesh.render_vertex(slot));
        }
        for &(material, at) in &dirty.draws {
            let list = &mut self.indices[usize::from(material)];
            let source = mesh.indices(material);
            list.resize(source.len(), [0; 3]);
            list[at as usize] = source[at as usize];
        }
        for (m, list) in (0..).zip(&mut self.indices) {
            list.truncate(mesh.indices(m).len());
        }
    }

    fn agrees(&self, mesh: &ActiveMesh) {
        for (m, list) in self.indices.iter().enumerate() {
            assert!(list == mesh.indices(m as u16), "indices of material {m}");
        }
        for slot in live_wedges(mesh) {
            assert_eq!(self.vertices[slot as usize], Some(mesh.render_vertex(slot)), "wedge slot {slot}");
        }
    }
}

#[test]
fn dirty_slots_cover_every_change() {
    let mut total = 0;
    for (name, source) in [
        ("materials", shapes::materials(shapes::torus(30, 40), 5)),
        ("seams", shapes::frigate(12)),
        ("components", shapes::components(60)),
        ("fans", shapes::fans(60)),
    ] {
        let asset: Prepared = prepared(&quantised(&source), &regions(200));
        let deltas = deltas(&asset).1;
        let mut active = ActiveMesh::new(&asset.base);
        let mut mirror = UploadMirror::new(&active);
        let mut random = Random::new(8);
        let (mut applied, mut undone, mut compacted) = (0, 0, 0);
        for step in 0..400 {
            // Up and down.
            let up = step / 100 % 2 == 0;
            let delta = &deltas[random.below(deltas.len())];
            if up == active.is_applied(delta.chunk) && random.below(4) > 0 {
                continue;
            }
            let dirty = if active.is_applied(delta.chunk) {
                active.undo(delta.chunk).inspect(|_| undone += 1)
            } else {
                active.apply(delta).inspect(|_| applied += 1)
            };
            let Ok(dirty) = dirty else { continue };
            mirror.upload(&active, &dirty);
            mirror.agrees(&active);
            while active.is_sparse() {
                let dirty = active.compact(100);
                mirror.upload(&active, &dirty);
                mirror.agrees(&active);
                compacted += 1;
            }
        }
        assert!(applied > 5 && undone > 5, "{name}: {applied} applied, {undone} undone");
        total += compacted;
    }
    assert!(total > 10, "compacted {total} times");
}

#[test]
fn index_lists_hold_exactly_the_live_faces() {
    for (name, source) in all() {
        let asset = prepared(&quantised(&source), &regions(200));
        let deltas = deltas(&asset).1;
        let mut active = ActiveMesh::new(&asset.base);
        for step in 0..2 * deltas.len() {
            // Up to the full mesh, then down again.
            match deltas.get(step) {
                Some(delta) => active.apply(delta).unwrap(),
                None => active.undo(deltas[2 * deltas.len() - 1 - step].chunk).unwrap(),
            };
            if step % 7 > 0 {
                continue;
            }
            let state = active.to_mesh();
            let mut expected: Vec<_> = plain_faces(&state)
                .into_iter()
                .map(|(corners, material)| {
                    let place = |x: i32| ((f64::from(x) * state.grid.step) as f32).to_bits();
                    (rotated(corners.map(|c| c.0.map(place))), material)
                })
                .collect();
            let mut got: Vec<_> = (0..active.material_count())
                .flat_map(|m| active.indices(m).iter().map(move |t| (*t, m)))
                .filter(|(t, _)| *t != [0; 3])
                .map(|(t, m)| (rotated(t.map(|w| active.render_vertex(w).position.map(f32::to_bits))), m))
                .collect();
            expected.sort_unstable();
            got.sort_unstable();
            assert!(got == expected, "{name}: after {step} steps");
        }
        assert!(active.indices(active.material_count()).is_empty());
    }
}

fn rotated(c: [[u32; 3]; 3]) -> [[u32; 3]; 3] {
    [c, [c[1], c[2], c[0]], [c[2], c[0], c[1]]].into_iter().min().unwrap()
}
