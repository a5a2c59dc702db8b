//! Colours, explicit normals and parts survive simplification, coding, refinement and undo.

use std::collections::BTreeSet;

use lodestream_geometry::base::Base;
use lodestream_geometry::mesh::{NO_COLOR, SourceMesh};
use lodestream_geometry::octahedral;
use lodestream_geometry::prepare::suit;
use lodestream_geometry::refine::ActiveMesh;
use lodestream_geometry::{Codec, Settings};

use crate::common::{plain_faces, prepared, quantised, regions, shapes, with_bits};
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

#[test]
fn every_face_keeps_its_part_at_every_level() {
    // Parts at distant places, so that a face's place tells its part.
    let mut source = SourceMesh::default();
    for part in 0..40_u32 {
        let shape = if part % 2 == 0 { shapes::torus(12, 10) } else { shapes::sphere(8, 12, 0.02) };
        let faces = shape.faces.len();
        source = shapes::join(source, &shape, [20.0 * f64::from(part), 0.0, 0.0]);
        source.parts.extend(vec![part; faces]);
    }
    let mesh = with_bits(&source, 18);
    assert_eq!(mesh.part_count(), 40);
    for codec in [Codec::Range, Codec::Zstd, Codec::AxisAligned] {
        let mut mesh = mesh.clone();
        suit(&mut mesh, codec);
        let asset = prepared(&mesh, &Settings { codec, ..regions(300) });
        let base = Base::decode(&asset.base.encode().unwrap()).unwrap();
        let mut active = ActiveMesh::new(&base);
        assert_eq!(active.part_count(), 40);
        let check = |active: &ActiveMesh| {
            let mut faces = 0;
            for face in (0..active.material_count()).flat_map(|m| active.indices(m)) {
                let corners = face.map(|wedge| active.render_vertex(wedge));
                for corner in corners.iter().filter(|_| *face != [0; 3]) {
                    let place = f64::from(corner.position[0]) + base.grid.origin[0];
                    assert_eq!(f64::from(corner.part), (place / 20.0).round(), "{codec}");
                    faces += 1;
                }
            }
            faces
        };
        let coarse = check(&active);
        for (id, info) in (0..).zip(&asset.infos) {
            let delta = active.decode(id, info, &asset.chunks[id as usize]).unwrap();
            active.apply(&delta).unwrap();
            check(&active);
        }
        assert!(coarse < check(&active), "{codec}");
    }
}

#[test]
fn parts_cost_little() {
    let source = shapes::frigate(40);
    let bytes = |source: &SourceMesh| {
        let asset = prepared(&quantised(source), &regions(1000));
        asset.base.encode().unwrap().len() + asset.chunks.iter().map(Vec::len).sum::<usize>()
    };
    let (joined, parted) = (bytes(&source), bytes(&shapes::parts(source.clone(), 192)));
    assert!(parted <= joined + 2 * 40, "{parted} bytes with 40 parts, {joined} without");
}
