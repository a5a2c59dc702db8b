//! Colours and explicit normals survive simplification, coding, refinement and undo.

use std::collections::BTreeSet;

use lodestream_geometry::Settings;
use lodestream_geometry::mesh::NO_COLOR;
use lodestream_geometry::octahedral;
use lodestream_geometry::refine::ActiveMesh;

use crate::common::{plain_faces, prepared, quantised, regions, shapes};
use crate::invariants::deltas;

#[test]
fn colours_and_normals_come_back_exactly() {
    let mesh = quantised(&shapes::painted(shapes::torus(30, 50)));
    let explicit = mesh.wedges.iter().filter(|w| w.attributes.normal.is_some()).count();
    assert!(explicit > mesh.wedges.len() / 4, "{explicit} of {}", mesh.wedges.len());
    assert!(explicit < mesh.wedges.len() * 3 / 4, "{explicit} of {}", mesh.wedges.len());
    let asset = prepared(&mesh, &regions(200));
    let (refined, _) = deltas(&asset);
    // Not assert_eq!, which would print thousands of faces.
    assert!(plain_faces(&refined.to_mesh()) == plain_faces(&mesh));
}

#[test]
fn coarse_meshes_show_colours_and_normals_of_the_model() {
    let mesh = quantised(&shapes::painted(shapes::torus(30, 50)));
    let asset = prepared(&mesh, &Settings { coarse_grid: 0.0, ..regions(200) });
    // With one grid for all levels, vertices are a subset of the input's and keep their attributes.
    let known: BTreeSet<_> = mesh
        .wedges
        .iter()
        .map(|w| (mesh.positions[w.vertex as usize], w.attributes.color, w.attributes.normal))
        .collect();
    let coarse = ActiveMesh::new(&asset.base);
    let base = coarse.to_mesh();
    assert!(base.faces.len() * 4 < mesh.faces.len());
    assert!(base.wedges.iter().any(|w| w.attributes.normal.is_some()));
    let at_vertex: BTreeSet<_> = known.iter().map(|&(p, color, _)| (p, color)).collect();
    for (slot, wedge) in (0..).zip(&base.wedges) {
        let attributes = wedge.attributes;
        let place = base.positions[wedge.vertex as usize];
        let colors: BTreeSet<_> = known.iter().map(|(_, color, _)| *color).collect();
        assert!(
            colors.contains(&attributes.color) && attributes.color != NO_COLOR,
            "{place:?} {attributes:?}"
        );
        let shown = coarse.render_vertex(slot);
        assert_eq!(shown.color, attributes.color);
        if let Some(normal) = attributes.normal {
            assert_eq!(shown.normal, octahedral::decode(normal).map(|x| x as f32));
        }
    }
    let own = |w: &&lodestream_geometry::mesh::Wedge| {
        at_vertex.contains(&(base.positions[w.vertex as usize], w.attributes.color))
    };
    assert!(
        base.wedges.iter().filter(own).count() * 2 > base.wedges.len(),
        "most wedges are the vertex's own"
    );
}

#[test]
fn an_uncoloured_mesh_pays_nothing_for_colours() {
    let plain = shapes::torus(30, 50);
    let mut white = plain.clone();
    white.colors = vec![NO_COLOR];
    for corner in white.faces.iter_mut().flatten() {
        corner.color = 0;
    }
    let bytes = |source| {
        let asset = prepared(&quantised(source), &regions(200));
        asset.base.encode().unwrap().len() + asset.chunks.iter().map(Vec::len).sum::<usize>()
    };
    assert_eq!(bytes(&plain), bytes(&white));
}
