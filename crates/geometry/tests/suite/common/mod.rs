//! Deterministic generated meshes, and how tests prepare them.
#![allow(dead_code, reason = "each user needs only a part of it")]

use std::collections::BTreeMap;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, OnceLock};

use lodestream_geometry::Settings;
use lodestream_geometry::mesh::{Attributes, QuantisedMesh, SourceMesh};
use lodestream_geometry::pool::{Pool, Serial, Silent};
use lodestream_geometry::prepare::{Hooks, Prepared, prepare};
use lodestream_geometry::quantise::{Precision, QuantiseSettings, quantise};
use lodestream_geometry::random::Random;

mod bare_mesh;
pub(crate) mod shapes;

#[allow(unused_imports, reason = "each user needs only a part of it")]
pub(crate) use bare_mesh::bare;

/// Every generator with its name; meshes of a few thousand faces.
pub(crate) fn all() -> Vec<(&'static str, SourceMesh)> {
    vec![
        ("noisy sphere", shapes::sphere(40, 60, 0.05)),
        ("torus", shapes::torus(40, 70)),
        ("height field with holes", shapes::height_field(50)),
        ("boxes with seams everywhere", shapes::frigate(12)),
        ("flat-shaded sphere", shapes::flat_shaded(shapes::sphere(20, 40, 0.0))),
        ("several materials", shapes::materials(shapes::torus(30, 40), 5)),
        ("many components", shapes::components(300)),
        ("triangle soup", shapes::soup(700)),
        ("non-manifold fans", shapes::fans(60)),
        ("duplicate faces", shapes::duplicates(shapes::sphere(16, 24, 0.02))),
        ("two coincident sheets", shapes::sheets(20)),
        ("bow ties", shapes::bow_ties(120)),
        ("needles", shapes::needles(800)),
        ("medley", shapes::medley(6)),
        ("painted torus", shapes::painted(shapes::torus(30, 50))),
        ("dressed stones", shapes::stones(40)),
        ("parts of one component each", shapes::parts(shapes::frigate(12), 192)),
        ("parts that touch", shapes::parts(shapes::height_field(40), 100)),
        ("skinned torus", shapes::skinned(shapes::torus(30, 50))),
        ("lightmapped torus", shapes::lightmapped(shapes::torus(30, 50), 2)),
    ]
}

/// The generators of closed manifolds.
pub(crate) fn closed() -> Vec<(&'static str, SourceMesh)> {
    vec![
        ("noisy sphere", shapes::sphere(40, 60, 0.05)),
        ("torus", shapes::torus(40, 70)),
        ("many components", shapes::components(300)),
        ("flat-shaded sphere", shapes::flat_shaded(shapes::sphere(20, 40, 0.0))),
    ]
}

pub(crate) fn quantised(source: &SourceMesh) -> QuantisedMesh {
    with_bits(source, 14)
}

pub(crate) fn with_bits(source: &SourceMesh, bits: u8) -> QuantisedMesh {
    quantise(source, &QuantiseSettings { precision: Precision::Bits(bits), ..QuantiseSettings::default() })
        .unwrap()
}

/// Settings with regions of `faces` faces, and a minimum chunk size to match.
pub(crate) fn regions(faces: usize) -> Settings {
    Settings { region_faces: faces, min_splits: (faces / 50).max(1), ..Settings::default() }
}

/// Settings with regions of `faces` faces, and truncation points even in small chunks.
pub(crate) fn with_truncation_points(faces: usize) -> Settings {
    Settings { min_part_splits: 4, ..regions(faces) }
}

/// Settings that simplify the finest levels in blocks of `faces` faces.
pub(crate) fn in_blocks(faces: usize, settings: Settings) -> Settings {
    Settings { block_faces: faces, ..settings }
}

/// Prepares a mesh, once for all tests with the same mesh and settings; the result depends on nothing else (tests
/// `determinism` and `golden`).
pub(crate) fn prepared(mesh: &QuantisedMesh, settings: &Settings) -> Prepared {
    static CACHE: Mutex<BTreeMap<[u8; 32], Arc<OnceLock<Prepared>>>> = Mutex::new(BTreeMap::new());
    let work = || prepare(mesh, settings, &Hooks::new(&Serial, &Silent)).unwrap();
    if mesh.faces.len() > MAX_CACHED_FACES {
        return work();
    }
    let key = blake3::hash(format!("{mesh:?} {settings:?}").as_bytes());
    let kept = Arc::clone(CACHE.lock().unwrap().entry(key.into()).or_default());
    kept.get_or_init(work).clone()
}

/// Larger meshes are not cached; each is used by one test.
const MAX_CACHED_FACES: usize = 20_000;

/// A face by value: position, part and attributes per corner, rotated so that the smallest comes first, and the
/// material.
pub(crate) type PlainFace = ([([i32; 3], u32, Attributes); 3], u16);

/// The faces of a mesh, sorted, independent of numbering.
pub(crate) fn plain_faces(mesh: &QuantisedMesh) -> Vec<PlainFace> {
    let mut faces: Vec<PlainFace> = mesh
        .faces
        .iter()
        .map(|face| {
            let corners = face.wedges.map(|w| {
                let wedge = mesh.wedges[w as usize];
                let vertex = wedge.vertex as usize;
                (mesh.positions[vertex], mesh.parts.get(vertex).copied().unwrap_or(0), wedge.attributes)
            });
            let turns = [0, 1, 2].map(|k| [0, 1, 2].map(|i| corners[(i + k) % 3]));
            (*turns.iter().min().unwrap(), face.material)
        })
        .collect();
    faces.sort_unstable();
    faces
}

/// A pool of several threads that runs tasks in a random order.
pub(crate) struct Shuffled {
    pub(crate) threads: usize,
    pub(crate) seed: u64,
}

impl Pool for Shuffled {
    fn run(&self, count: usize, task: &(dyn Fn(usize) + Sync)) {
        let order = permutation(count, &mut Random::new(self.seed));
        let next = AtomicUsize::new(0);
        std::thread::scope(|scope| {
            for _ in 0..self.threads {
                scope.spawn(|| {
                    while let Some(&i) = order.get(next.fetch_add(1, Ordering::Relaxed)) {
                        task(i);
                    }
                });
            }
        });
    }
}

pub(crate) fn permutation(count: usize, random: &mut Random) -> Vec<usize> {
    let mut order: Vec<usize> = (0..count).collect();
    for i in (1..count).rev() {
        order.swap(i, random.below(i + 1));
    }
    order
}
