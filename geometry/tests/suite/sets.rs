//! Closed sets by budget.

use lodestream_geometry::closed_set::{Budget, lowest_error, random, random_order};
use lodestream_geometry::index::ChunkInfo;
use lodestream_geometry::prepare::Prepared;
use lodestream_geometry::random::Random;
use lodestream_geometry::refine::ActiveMesh;

use crate::common::{prepared, quantised, regions, shapes};
use crate::promises::deltas;

fn asset() -> Prepared {
    prepared(&quantised(&shapes::sphere(40, 60, 0.05)), &regions(200))
}

fn is_closed(infos: &[ChunkInfo], set: &[u32]) -> bool {
    set.iter().all(|&id| infos[id as usize].parents.iter().all(|p| set.contains(p)))
}

#[test]
fn budgets_are_kept_and_more_is_never_worse() {
    let asset = asset();
    let head = 1000;
    let everything = lowest_error(&asset.base, &asset.infos, head, Budget::Everything);
    assert_eq!(everything.chunks.len(), asset.infos.len());
    assert_eq!(everything.error, 0.0);
    assert_eq!(everything.faces, asset.base.totals.faces);
    assert_eq!(everything.bytes, head + asset.chunks.iter().map(|c| c.len() as u64).sum::<u64>());
    let deltas = deltas(&asset).1;
    for bytes in [true, false] {
        let mut last = f64::INFINITY;
        let all = if bytes { everything.bytes } else { everything.faces };
        for step in 0..60 {
            let limit = all * step / 50;
            let budget = if bytes { Budget::Bytes(limit) } else { Budget::Faces(limit) };
            let set = lowest_error(&asset.base, &asset.infos, head, budget);
            let spent = if bytes { set.bytes } else { set.faces };
            assert!(spent <= limit || set.chunks.is_empty(), "{spent} of {limit}");
            assert!(set.error <= last, "{budget:?}: {} after {last}", set.error);
            last = set.error;
            assert!(is_closed(&asset.infos, &set.chunks));
            let mut active = ActiveMesh::new(&asset.base);
            for &id in &set.chunks {
                active.apply(&deltas[id as usize]).unwrap();
            }
            assert_eq!(active.face_count() as u64, set.faces);
            let missing = (0..asset.infos.len()).filter(|&id| !set.chunks.contains(&(id as u32)));
            let error = missing.map(|id| asset.infos[id].error).fold(0.0, f32::max);
            assert_eq!(set.error, f64::from(error));
        }
        assert_eq!(last, 0.0);
    }
}

#[test]
fn an_error_budget_takes_exactly_what_it_needs() {
    let asset = asset();
    for info in &asset.infos {
        let limit = f64::from(info.error);
        let set = lowest_error(&asset.base, &asset.infos, 0, Budget::Error(limit));
        assert!(set.error <= limit);
        assert!(is_closed(&asset.infos, &set.chunks));
        assert!(set.chunks.iter().all(|&id| f64::from(asset.infos[id as usize].error) > limit));
    }
}

#[test]
fn random_sets_are_closed_and_orders_respect_parents() {
    let asset = asset();
    let mut source = Random::new(1);
    let mut sizes = Vec::new();
    for _ in 0..200 {
        let set = random(&asset.infos, &mut source);
        assert!(is_closed(&asset.infos, &set));
        let order = random_order(&asset.infos, &set, &mut source);
        for (at, &id) in order.iter().enumerate() {
            assert!(asset.infos[id as usize].parents.iter().all(|p| order[..at].contains(p)));
        }
        let mut sorted = order;
        sorted.sort_unstable();
        assert_eq!(sorted, set);
        sizes.push(set.len());
    }
    sizes.sort_unstable();
    let n = asset.infos.len();
    assert!(sizes[0] * 4 < n && sizes[199] * 4 > n * 3, "{sizes:?} of {n}");
    assert!(random(&[], &mut source).is_empty());
}
