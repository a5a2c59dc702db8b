//! Checkpoint stores: the result does not depend on the store, nor on how often a preparation was interrupted and
//! resumed.

use std::collections::BTreeMap;
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};

use lodestream_geometry::checkpoint::{CheckpointError, CheckpointStore, Piece};
use lodestream_geometry::mesh::QuantisedMesh;
use lodestream_geometry::pool::{Monitor, Progress, Serial, Silent};
use lodestream_geometry::prepare::{Hooks, Prepared, prepare};
use lodestream_geometry::{Codec, MeshError, Settings};

use crate::common::{all, in_blocks, prepared, quantised, regions, shapes};

/// A persistent store that fails for good after a number of pieces.
struct FailingStore {
    pieces: Mutex<BTreeMap<Piece, Vec<u8>>>,
    left: AtomicUsize,
}

impl FailingStore {
    fn new(left: usize) -> Self {
        Self { pieces: Mutex::default(), left: left.into() }
    }

    fn repaired(self, left: usize) -> Self {
        Self { left: left.into(), ..self }
    }

    /// Number of complete levels.
    fn levels(&self) -> usize {
        self.pieces.lock().unwrap().keys().filter(|piece| piece.block == Piece::END).count()
    }
}

impl CheckpointStore for FailingStore {
    fn is_persistent(&self) -> bool {
        true
    }

    fn put(&self, piece: Piece, bytes: Vec<u8>) -> Result<(), CheckpointError> {
        let take = |left: usize| left.checked_sub(1);
        if self.left.fetch_update(Ordering::Relaxed, Ordering::Relaxed, take).is_err() {
            return Err(CheckpointError::new("the disk is full"));
        }
        self.pieces.lock().unwrap().insert(piece, bytes);
        Ok(())
    }

    fn get(&self, piece: Piece) -> Result<Option<Vec<u8>>, CheckpointError> {
        Ok(self.pieces.lock().unwrap().get(&piece).cloned())
    }
}

/// Counts reports of simplification, and cancels at one.
struct CountingMonitor {
    reports: AtomicUsize,
    last: usize,
}

impl CountingMonitor {
    fn until(last: usize) -> Self {
        Self { reports: AtomicUsize::new(0), last }
    }
}

impl Monitor for CountingMonitor {
    fn report(&self, _: Progress) -> bool {
        self.reports.fetch_add(1, Ordering::Relaxed) < self.last
    }
}

fn with(mesh: &QuantisedMesh, settings: &Settings, checkpoint: &FailingStore) -> Result<Prepared, MeshError> {
    prepare(mesh, settings, &Hooks::new(&Serial, &Silent).with_checkpoints(checkpoint))
}

#[test]
fn a_preparation_resumes_after_any_storage_failure() {
    let meshes = [
        ("medley", shapes::medley(3)),
        ("painted", shapes::painted(shapes::materials(shapes::sphere(40, 60, 0.02), 3))),
        ("flat shaded", shapes::flat_shaded(shapes::height_field(50))),
        ("parts", shapes::parts(shapes::frigate(12), 192)),
    ];
    let mut ends = 0;
    for (name, source) in meshes {
        let mesh = quantised(&source);
        for (settings, step) in [
            (regions(50), 7),
            (Settings { codec: Codec::Zstd, ..regions(200) }, 5),
            (in_blocks(700, regions(100)), 11),
        ] {
            let expected = prepare(&mesh, &settings, &Hooks::new(&Serial, &Silent)).unwrap();
            for pieces in (0..).step_by(step) {
                let broken = FailingStore::new(pieces);
                let Err(why) = with(&mesh, &settings, &broken) else { break };
                assert!(why.to_string().contains("the disk is full"), "{name}: {why}");
                let again = with(&mesh, &settings, &broken.repaired(usize::MAX)).unwrap();
                assert!(again == expected, "{name}: another asset after {pieces} pieces");
                ends += 1;
            }
        }
    }
    assert!(ends > 15, "storage broke only {ends} times");
}

#[test]
fn complete_levels_are_not_computed_again() {
    let mesh = quantised(&shapes::torus(60, 80));
    let (settings, store) = (regions(200), FailingStore::new(usize::MAX));
    let whole = CountingMonitor::until(usize::MAX);
    let expected = prepare(&mesh, &settings, &Hooks::new(&Serial, &whole).with_checkpoints(&store)).unwrap();
    let levels = store.levels();
    assert!(levels > 3, "{levels} levels");
    let reports = whole.reports.into_inner();
    // Cancelled repeatedly, each time a little later.
    let mut store = FailingStore::new(usize::MAX);
    let (mut runs, mut done) = (0, 0);
    loop {
        let monitor = CountingMonitor::until(reports / 4);
        let result = prepare(&mesh, &settings, &Hooks::new(&Serial, &monitor).with_checkpoints(&store));
        runs += 1;
        match result {
            Ok(again) => {
                assert!(again == expected);
                break;
            }
            Err(why) => assert_eq!(why, MeshError::Cancelled),
        }
        if store.levels() == done {
            // The finest level takes more than a quarter of all reports.
            let monitor = CountingMonitor::until(reports / 4 * 3);
            let _ = prepare(&mesh, &settings, &Hooks::new(&Serial, &monitor).with_checkpoints(&store));
        }
        done = store.levels();
        store = store.repaired(usize::MAX);
        assert!(runs < 20, "{done} of {levels} levels after {runs} runs");
    }
    // With all levels complete only encoding remains.
    let last = CountingMonitor::until(usize::MAX);
    let again = prepare(&mesh, &settings, &Hooks::new(&Serial, &last).with_checkpoints(&store)).unwrap();
    assert!(again == expected);
    let left = last.reports.into_inner();
    assert!(left < reports / 2, "{left} reports of {reports}");
}

/// A power failure may lose earlier pieces and keep later ones.
#[test]
fn a_level_that_lacks_a_block_is_computed_again() {
    let mesh = quantised(&shapes::torus(60, 80));
    let settings = regions(200);
    let store = FailingStore::new(usize::MAX);
    let expected = with(&mesh, &settings, &store).unwrap();
    for level in 0..store.levels() as u32 {
        store.pieces.lock().unwrap().remove(&Piece { level, block: 0 });
        assert!(with(&mesh, &settings, &store).unwrap() == expected, "without level {level}");
    }
}

#[test]
fn checkpoints_of_another_mesh_are_refused_or_ignored() {
    for (name, source) in all() {
        let mesh = quantised(&source);
        let store = FailingStore::new(usize::MAX);
        with(&quantised(&shapes::torus(60, 80)), &regions(200), &store).unwrap();
        if let Ok(asset) = with(&mesh, &regions(200), &store) {
            assert!(asset == prepared(&mesh, &regions(200)), "{name}");
        }
    }
    // A block of a larger mesh refers to elements that a smaller one lacks.
    let (large, small) = (shapes::torus(60, 80), shapes::torus(30, 40));
    let (settings, store) = (in_blocks(700, regions(100)), FailingStore::new(usize::MAX));
    with(&quantised(&large), &settings, &store).unwrap();
    let why = with(&quantised(&small), &settings, &store).unwrap_err();
    assert!(why.to_string().contains("belongs to another mesh"), "{why}");
}
