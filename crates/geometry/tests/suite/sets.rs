//! Ancestor-closed cuts by budget.

use lodestream_geometry::ancestor_closed_cut::{
    AncestorClosedCut, Budget, Member, lowest_error, random, random_order,
};
use lodestream_geometry::index::ChunkInfo;
use lodestream_geometry::prepare::Prepared;
use lodestream_geometry::random::Random;
use lodestream_geometry::refine::ActiveMesh;

use crate::common::{prepared, quantised, shapes, with_truncation_points};
use crate::invariants::apply;

fn asset() -> Prepared {
    prepared(&quantised(&shapes::sphere(40, 60, 0.05)), &with_truncation_points(200))
}

fn is_closed(infos: &[ChunkInfo], set: &[Member]) -> bool {
    let whole = |chunk| set.contains(&Member { chunk, truncation: None });
    set.is_sorted_by(|a, b| a.chunk < b.chunk)
        && set.iter().all(|m| infos[m.chunk as usize].parents.iter().all(|&p| whole(p)))
}

/// Remaining error by chunk.
fn left<'a>(infos: &'a [ChunkInfo], set: &'a [Member]) -> impl Iterator<Item = f32> + 'a {
    let member = |id: usize| set.iter().find(|m| m.chunk == id as u32);
    (0..infos.len())
        .map(move |id| member(id).map_or(infos[id].error, |m| infos[id].extent(m.truncation).error))
}

#[test]
fn budgets_are_kept_and_more_is_never_worse() {
    let asset = asset();
    let head = 1000;
    let everything = lowest_error(&asset.base, &asset.infos, head, Budget::Everything);
    assert_eq!(everything.members.len(), asset.infos.len());
    assert!(everything.members.iter().all(|m| m.truncation.is_none()));
    assert_eq!(everything.error, 0.0);
    assert_eq!(everything.faces, asset.base.totals.faces);
    assert_eq!(everything.bytes, head + asset.chunks.iter().map(|c| c.len() as u64).sum::<u64>());
    let mut at_truncation_points = 0;
    for bytes in [true, false] {
        let mut last = f64::INFINITY;
        let all = if bytes { everything.bytes } else { everything.faces };
        for step in 0..60 {
            let limit = all * step / 50;
            let budget = if bytes { Budget::Bytes(limit) } else { Budget::Faces(limit) };
            let set = lowest_error(&asset.base, &asset.infos, head, budget);
            let spent = if bytes { set.bytes } else { set.faces };
            assert!(spent <= limit || set.members.is_empty(), "{spent} of {limit}");
            assert!(set.error <= last, "{budget:?}: {} after {last}", set.error);
            last = set.error;
            assert!(is_closed(&asset.infos, &set.members));
            let mut active = ActiveMesh::new(&asset.base);
            for &member in &set.members {
                apply(&mut active, &asset, member);
            }
            assert_eq!(active.face_count() as u64, set.faces);
            let payload = set.members.iter().map(|m| asset.infos[m.chunk as usize].extent(m.truncation));
            assert_eq!(set.bytes, head + payload.map(|e| u64::from(e.payload_bytes)).sum::<u64>());
            assert_eq!(set.error, f64::from(left(&asset.infos, &set.members).fold(0.0, f32::max)));
            at_truncation_points += set.members.iter().filter(|m| m.truncation.is_some()).count();
        }
        assert_eq!(last, 0.0);
    }
    assert!(at_truncation_points > 100, "only {at_truncation_points} chunks ended at a truncation");
}

/// No ancestor-closed cut within the budget has a lower stated error.
#[test]
fn no_smaller_set_states_less() {
    let asset = asset();
    let everything = lowest_error(&asset.base, &asset.infos, 0, Budget::Everything);
    let least = |error: f64| lowest_error(&asset.base, &asset.infos, 0, Budget::Error(error));
    for step in 1..50 {
        let (faces, bytes) = (everything.faces * step / 50, everything.bytes * step / 50);
        for budget in [Budget::Faces(faces), Budget::Bytes(bytes)] {
            let set = lowest_error(&asset.base, &asset.infos, 0, budget);
            let next: AncestorClosedCut = least(set.error.next_down());
            assert!(next.error < set.error || set.error == 0.0);
            let more = if budget == Budget::Faces(faces) { next.faces > faces } else { next.bytes > bytes };
            assert!(more || set.error == 0.0, "{budget:?}: {next:?}");
        }
    }
}

#[test]
fn truncation_points_make_cuts_smaller() {
    let asset = asset();
    let bare: Vec<ChunkInfo> =
        asset.infos.iter().map(|i| ChunkInfo { truncation_points: Vec::new(), ..i.clone() }).collect();
    let (mut with, mut without) = (0, 0);
    for share in 1..20 {
        let limit = f64::from(asset.base.geometric_error) / f64::from(share);
        let sets =
            [&asset.infos, &bare].map(|infos| lowest_error(&asset.base, infos, 0, Budget::Error(limit)));
        assert!(sets.iter().all(|s| s.error <= limit));
        assert!(sets[0].faces <= sets[1].faces && sets[0].bytes <= sets[1].bytes);
        (with, without) = (with + sets[0].bytes, without + sets[1].bytes);
    }
    assert!(with * 100 < without * 97, "{with} bytes with truncation points, {without} without");
}

#[test]
fn an_error_budget_takes_exactly_what_it_needs() {
    let asset = asset();
    for info in &asset.infos {
        let limit = f64::from(info.error);
        let set = lowest_error(&asset.base, &asset.infos, 0, Budget::Error(limit));
        assert!(set.error <= limit);
        assert!(is_closed(&asset.infos, &set.members));
        for member in &set.members {
            let info = &asset.infos[member.chunk as usize];
            assert!(f64::from(info.error) > limit);
            let before = member.truncation.map_or(info.truncation_points.len(), usize::from);
            assert!(
                info.truncation_points[..before].iter().all(|s| f64::from(s.error) > limit),
                "{member:?}"
            );
        }
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
        for (at, member) in order.iter().enumerate() {
            let there = |chunk| order[..at].contains(&Member { chunk, truncation: None });
            assert!(asset.infos[member.chunk as usize].parents.iter().all(|&p| there(p)));
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
