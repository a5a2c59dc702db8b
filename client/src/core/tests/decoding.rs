//! Decoding on lent threads: only time may depend on them.

use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};

use lodestream_geometry::pool::Pool;
use lodestream_geometry::refine::{RenderVertex, Snapshot};
use lodestream_scene::blob::BlobId;
use lodestream_scene::description::Camera;
use lodestream_select::Share;

use super::{finest, view};
use crate::core::Decoders;
use crate::core::testing::{Loopback, TestScene, prepared};

/// Runs tasks in reverse order, each on a thread; omits every fifth. Records the largest number of tasks in one call.
#[derive(Default)]
struct Wilful(AtomicUsize);

impl Pool for Wilful {
    fn run(&self, count: usize, task: &(dyn Fn(usize) + Sync)) {
        self.0.fetch_max(count, Ordering::Relaxed);
        std::thread::scope(|scope| {
            for i in (0..count).rev().filter(|i| i % 5 != 3) {
                scope.spawn(move || task(i));
            }
        });
    }
}

/// All data of a mesh, by slot, and all changes sent for it.
type Outcome = (Vec<BlobId>, u64, Snapshot, Vec<[u32; 3]>, Vec<RenderVertex>);

/// Refines everything, one chunk of which is damaged, then looks away and back.
fn outcome(decoders: Decoders, budget: u64) -> Outcome {
    let mut hills = TestScene::new(1);
    let last = u32::try_from(prepared().1.chunks.len() - 1).unwrap();
    hills.damage(BlobId::chunk(0, last));
    let mut link = Loopback::new(hills, |config| {
        config.select.keep_out_of_view = Share::NONE;
        config.decoders = decoders;
    });
    link.budget = budget;
    link.core.set_view(link.now, finest());
    link.connect();
    link.run(3000);
    let here = link.core.stats().applied_chunks;
    let away = Camera { eye: [0.0, 2.0, 300.0], ..TestScene::new(1).camera() };
    link.core.set_view(link.now, view(away, 1.0));
    link.run(400);
    assert!(link.core.stats().applied_chunks < here, "nothing was undone");
    link.core.set_view(link.now, finest());
    link.run(400);
    assert_eq!(link.core.stats().applied_chunks, here);
    let (failures, mesh) = (link.core.stats().decode_failures, link.core.mesh(0).unwrap());
    assert!(here == u64::from(last) && failures > 0, "{here} of {last} chunks, {failures} failures");
    let vertices = (0..mesh.wedge_slots()).map(|slot| mesh.render_vertex(slot)).collect();
    (link.sent.clone(), failures, mesh.snapshot(), mesh.indices(0).to_vec(), vertices)
}

#[test]
fn any_thread_pool_gives_the_same_result() {
    for budget in [u64::MAX, 2000] {
        let alone = outcome(Decoders::default(), budget);
        let pool = Arc::new(Wilful::default());
        assert!(outcome(Decoders::on(pool.clone()), budget) == alone, "a pool has changed the outcome");
        assert!(pool.0.load(Ordering::Relaxed) > 1, "no two chunks were decoded together");
    }
}
