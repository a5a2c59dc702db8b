//! No holes that the input does not have, for any ancestor-closed cut with leaves at any truncation points, for any
//! input.
//!
//! Independent of [`lodestream_geometry::check`], which compares *directed* edges: this test counts faces at
//! undirected edges. A surface ends at an edge with an odd number. Mapping each vertex of the input to its ancestor
//! in the mesh maps the input's boundary edges to edges of the mesh; modulo two, these and no others may be boundary
//! edges of the mesh. An input without boundary (closed, even if it intersects itself) has none at any time.

use std::collections::{BTreeMap, BTreeSet};

use lodestream_geometry::ancestor_closed_cut;
use lodestream_geometry::mesh::SourceMesh;
use lodestream_geometry::random::Random;
use lodestream_geometry::refine::{ActiveMesh, ChunkDelta, Id, Origin, Snapshot};

use crate::common::{all, prepared, quantised, shapes, with_bits, with_truncation_points};
use crate::invariants::{apply, deltas};

/// Undirected edges with an odd number of faces, smaller id first.
fn boundary_edges(state: &Snapshot) -> BTreeSet<(Id, Id)> {
    let vertex: BTreeMap<Id, Id> = state.wedges.iter().map(|&(wedge, vertex, _)| (wedge, vertex)).collect();
    let mut odd = BTreeSet::new();
    for (_, wedges, _) in &state.faces {
        let v = wedges.map(|w| vertex[&w]);
        for (a, b) in [(v[0], v[1]), (v[1], v[2]), (v[2], v[0])] {
            flip(&mut odd, a, b);
        }
    }
    odd
}

fn flip(odd: &mut BTreeSet<(Id, Id)>, a: Id, b: Id) {
    let edge = (a.min(b), a.max(b));
    if a != b && !odd.remove(&edge) {
        odd.insert(edge);
    }
}

/// The ancestor of an input vertex in a mesh without some of the chunks.
fn ancestor(state: &Snapshot, deltas: &[ChunkDelta], mut vertex: Id) -> Id {
    while state.vertices.binary_search_by_key(&vertex, |v| v.0).is_err() {
        let origin = deltas[vertex.owner as usize - 1].vertices[vertex.index as usize].origin;
        let Origin::Split(parent) = origin else { break };
        vertex = parent;
    }
    vertex
}

/// Tries `sets` random ancestor-closed cuts. Returns the number of boundary edges of the input.
fn no_new_holes(name: &str, source: &SourceMesh, bits: u8, region_faces: usize, sets: usize) -> usize {
    let asset = prepared(&with_bits(source, bits), &with_truncation_points(region_faces));
    let (full, deltas) = deltas(&asset);
    let input = boundary_edges(&full.snapshot());
    let mut random = Random::new(region_faces as u64);
    for set in 0..sets {
        let set = if set == 0 { Vec::new() } else { ancestor_closed_cut::random(&asset.infos, &mut random) };
        let mut mesh = ActiveMesh::new(&asset.base);
        for member in ancestor_closed_cut::random_order(&asset.infos, &set, &mut random) {
            apply(&mut mesh, &asset, member);
        }
        let state = mesh.snapshot();
        let mut expected = BTreeSet::new();
        for &(a, b) in &input {
            flip(&mut expected, ancestor(&state, &deltas, a), ancestor(&state, &deltas, b));
        }
        assert!(
            boundary_edges(&state) == expected,
            "{name}, regions of {region_faces}, {} chunks applied",
            set.len()
        );
    }
    input.len()
}

#[test]
fn boundaries_are_only_where_the_input_has_them() {
    let mut with_ends = 0;
    for (name, source) in all() {
        with_ends += usize::from(no_new_holes(name, &source, 14, 100, 6) > 0);
    }
    assert!(with_ends >= 5, "only {with_ends} of the inputs have boundaries");
}

#[test]
fn closed_meshes_never_get_holes() {
    // Giving every face twice closes any surface: no edge may ever have an odd count.
    for (name, mut source) in all() {
        source.faces.extend(source.faces.clone());
        source.materials.extend(source.materials.clone());
        source.parts.extend(source.parts.clone());
        assert_eq!(no_new_holes(name, &source, 12, 200, 3), 0, "{name}");
    }
}

/// A mesh with seams at nearly every vertex must not tear along them.
#[test]
fn a_low_poly_model_with_seams_at_nearly_every_vertex_never_tears() {
    let source = shapes::frigate(9);
    let mesh = quantised(&source);
    let mut wedges = vec![0; mesh.positions.len()];
    for wedge in &mesh.wedges {
        wedges[wedge.vertex as usize] += 1;
    }
    let on_seams = wedges.iter().filter(|&&w| w > 1).count();
    assert!(on_seams * 10 >= wedges.len() * 9, "{on_seams} of {} vertices", wedges.len());
    for region_faces in [50, 100, 400] {
        assert_eq!(no_new_holes("boxes", &source, 14, region_faces, 25), 0);
    }
}

#[test]
fn two_thousand_components_with_everything_on_them_get_no_holes() {
    let mut source = shapes::medley(4);
    let mut random = Random::new(5);
    for _ in 0..8 {
        let by = [0, 1, 2].map(|_| 6.0 * random.unit());
        source = shapes::join(source, &shapes::dust(250), by);
    }
    for region_faces in [100, 1000] {
        assert!(no_new_holes("components", &source, 10, region_faces, 6) > 0);
    }
}
