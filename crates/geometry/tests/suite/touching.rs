//! Surfaces that touch along edges, as in scans: edges of four faces must collapse like others, or they remain while
//! everything around them is simplified.

use std::collections::BTreeMap;

use lodestream_geometry::Settings;
use lodestream_geometry::ancestor_closed_cut::{Budget, lowest_error};
use lodestream_geometry::check::check;
use lodestream_geometry::mesh::{Corner, QuantisedMesh, SourceMesh};
use lodestream_geometry::pool::Serial;
use lodestream_geometry::prepare::Prepared;

use crate::common::{prepared, quantised, shapes};

/// A surface around the origin with a smaller one inside, which touch along an edge of every `step`th face, or
/// nowhere.
fn shells(mut mesh: SourceMesh, step: Option<usize>) -> SourceMesh {
    let count = mesh.positions.len() as u32;
    let faces = mesh.faces.clone();
    let mut inner: Vec<u32> = (count..2 * count).collect();
    for face in faces.iter().step_by(step.unwrap_or(usize::MAX)).filter(|_| step.is_some()) {
        face[..2].iter().for_each(|corner| inner[corner.position as usize] = corner.position);
    }
    let smaller: Vec<[f64; 3]> = mesh.positions.iter().map(|p| p.map(|x| 0.98 * x)).collect();
    mesh.positions.extend(smaller);
    for [a, b, c] in faces {
        mesh.faces.push([a, c, b].map(|corner| Corner::at(inner[corner.position as usize])));
        mesh.materials.push(0);
    }
    mesh
}

/// Number of edges with more than two faces.
fn shared(mesh: &QuantisedMesh) -> usize {
    let mut edges: BTreeMap<[u32; 2], u32> = BTreeMap::new();
    for face in &mesh.faces {
        let [a, b, c] = face.wedges.map(|w| mesh.wedges[w as usize].vertex);
        for (a, b) in [(a, b), (b, c), (c, a)] {
            *edges.entry([a.min(b), a.max(b)]).or_default() += 1;
        }
    }
    edges.values().filter(|&&faces| faces > 2).count()
}

/// Stated error, relative to the diagonal, of the best mesh with a given number of faces.
fn error(asset: &Prepared, faces: usize) -> f64 {
    let set = lowest_error(&asset.base, &asset.infos, 0, Budget::Faces(faces as u64));
    set.error / f64::from(asset.base.diagonal)
}

#[test]
fn touching_sheets_are_simplified_like_others() {
    let sphere = shapes::sphere(50, 100, 0.004);
    let [apart, touching] = [None, Some(9)].map(|step| quantised(&shells(sphere.clone(), step)));
    assert!(shared(&touching) >= 1_000, "{} edges have more than two faces", shared(&touching));

    let budget = apart.faces.len() / 8;
    let alone = error(&prepared(&apart, &Settings::default()), budget);
    let asset = prepared(&touching, &Settings::default());
    let together = error(&asset, budget);
    assert!(together <= 3.0 * alone, "{together} of the diagonal, apart {alone}");

    let report = check(&asset.base, &asset.infos, &asset.chunks, 6, 7, &Serial).unwrap();
    assert_eq!((report.cracks, report.order_dependent, report.undo_errors), (0, 0, 0));
}
