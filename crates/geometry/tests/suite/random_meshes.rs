//! Random triangles over few points: non-manifold meshes with all kinds of one-rings, seams and edges.

use lodestream_geometry::mesh::{Corner, NONE, SourceMesh};
use lodestream_geometry::quantise::{QuantiseSettings, quantise};
use lodestream_geometry::random::Random;

use crate::common::with_bits;
use crate::extremes::survives;

/// A random mesh: points in a cube, a ball or a plane; faces between near or arbitrary points; random attributes,
/// some shared.
fn random_mesh(random: &mut Random) -> SourceMesh {
    let points = 4 + random.below(400);
    let flat = random.below(4) == 0;
    let near = random.below(3) > 0;
    let mut mesh = SourceMesh::default();
    for i in 0..points {
        let at = if near { i as f64 * 0.05 } else { 0.0 };
        let z = if flat { 0.0 } else { random.unit() };
        mesh.positions.push([random.unit() + at, random.unit(), z]);
    }
    let (uvs, normals) = (random.below(30), random.below(30));
    mesh.uvs = (0..uvs).map(|_| [random.unit() as f32, random.unit() as f32]).collect();
    mesh.normals = (0..normals).map(|_| [0, 1, 2].map(|_| random.unit() as f32 - 0.5)).collect();
    let colors = random.below(12);
    mesh.colors = (0..colors).map(|_| [0; 4].map(|_: u8| random.below(256) as u8)).collect();
    let materials = 1 + random.below(4);
    let pick = |random: &mut Random, count: usize| match count {
        0 => NONE,
        _ if random.below(8) == 0 => NONE,
        _ => random.below(count) as u32,
    };
    let density = 1 + random.below(8);
    for _ in 0..1 + random.below(points * density) {
        let first = random.below(points);
        let corner = [0, 1, 2].map(|k| {
            let position = match (near, k) {
                (_, 0) => first,
                (true, _) => (first + random.below(9)) % points,
                (false, _) => random.below(points),
            };
            Corner {
                uv: pick(random, uvs),
                normal: pick(random, normals),
                color: pick(random, colors),
                ..Corner::at(position as u32)
            }
        });
        mesh.faces.push(corner);
        mesh.materials.push(random.below(materials) as u16);
        if random.below(10) == 0 {
            mesh.faces.push([corner[2], corner[0], corner[1]]);
            mesh.materials.push(0);
        }
    }
    mesh
}

/// Adds a second set of random texture coordinates at most corners, some shared; with every third, the first set is
/// removed.
fn add_second_uvs(mesh: &mut SourceMesh, random: &mut Random) {
    let count = 1 + random.below(30);
    mesh.second_uvs = (0..count).map(|_| [random.unit() as f32, random.unit() as f32]).collect();
    let alone = random.below(3) == 0;
    for corner in mesh.faces.iter_mut().flatten() {
        if random.below(8) > 0 {
            corner.second_uv = random.below(count) as u32;
        }
        if alone {
            corner.uv = NONE;
        }
    }
}

/// `RANDOM_MESHES=N` tries N meshes instead of 60.
#[test]
fn random_non_manifold_meshes_keep_the_invariants() {
    let seeds = std::env::var("RANDOM_MESHES").ok().and_then(|n| n.parse().ok()).unwrap_or(60);
    let mut usable = 0;
    for seed in 0..seeds {
        let mut random = Random::new(seed);
        let mut source = random_mesh(&mut random);
        if seed % 2 == 1 {
            add_second_uvs(&mut source, &mut Random::new(seed));
        }
        if quantise(&source, &QuantiseSettings::default()).is_err() {
            continue;
        }
        usable += 1;
        let bits = [4, 8, 12, 14, 20][random.below(5)];
        let mesh = with_bits(&source, bits);
        let region_faces = [50, 60, 100, 300, 1000][random.below(5)];
        survives(
            &format!("random mesh {seed}, {} faces, regions of {region_faces}", mesh.faces.len()),
            &mesh,
            region_faces,
        );
    }
    assert!(usable * 2 > seeds);
}
