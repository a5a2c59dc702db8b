//! Any ancestor-closed cut, in any order, with exact undo, up to the exact input.

use std::collections::BTreeSet;

use lodestream_geometry::Settings;
use lodestream_geometry::ancestor_closed_cut::{self, Member};
use lodestream_geometry::check::check;
use lodestream_geometry::index::ChunkInfo;
use lodestream_geometry::mesh::QuantisedMesh;
use lodestream_geometry::pool::Serial;
use lodestream_geometry::prepare::Prepared;
use lodestream_geometry::random::Random;
use lodestream_geometry::refine::{ActiveMesh, ChunkDelta, ChunkError, RefineError};

use crate::common::{
    all, closed, in_blocks, plain_faces, prepared, quantised, regions, shapes, with_truncation_points,
};

/// The deltas of all chunks, decoded in order.
pub(crate) fn deltas(prepared: &Prepared) -> (ActiveMesh, Vec<ChunkDelta>) {
    let mut mesh = ActiveMesh::new(&prepared.base);
    let mut deltas = Vec::new();
    for (id, info) in prepared.infos.iter().enumerate() {
        let delta = mesh.decode(id as u32, info, &prepared.chunks[id]).unwrap();
        mesh.apply(&delta).unwrap();
        deltas.push(delta);
    }
    (mesh, deltas)
}

/// Applies a chunk, whole or up to a truncation point.
pub(crate) fn apply(
    mesh: &mut ActiveMesh,
    asset: &Prepared,
    Member { chunk, truncation }: Member,
) -> ChunkDelta {
    let (info, payload) = (&asset.infos[chunk as usize], &asset.chunks[chunk as usize]);
    // The truncation point's stated bytes must suffice.
    let needed = info.extent(truncation).payload_bytes as usize;
    let delta = mesh.decode_prefix(chunk, info, truncation, &payload[..needed]).unwrap();
    mesh.apply(&delta).unwrap();
    delta
}

fn passes_check(name: &str, mesh: &QuantisedMesh, settings: &Settings) {
    let asset = prepared(mesh, settings);
    let report = check(&asset.base, &asset.infos, &asset.chunks, 25, 9, &Serial).unwrap();
    assert_eq!(
        (report.sets, report.cracks, report.order_dependent, report.undo_errors),
        (25, 0, 0, 0),
        "{name}, regions of {}, {} chunks",
        settings.region_faces,
        asset.infos.len()
    );
}

#[test]
fn random_ancestor_closed_cuts_have_no_cracks_in_any_order() {
    for (name, source) in all() {
        let mesh = quantised(&source);
        for faces in [50, 200, 1000] {
            passes_check(name, &mesh, &regions(faces));
        }
        passes_check(name, &mesh, &with_truncation_points(100));
        passes_check(name, &mesh, &in_blocks(500, with_truncation_points(100)));
    }
}

#[test]
fn the_meshes_under_test_have_enough_chunks_to_mean_something() {
    for (name, source) in closed() {
        let mesh = quantised(&source);
        for (faces, least) in [(50, 25), (200, 8)] {
            let chunks = prepared(&mesh, &regions(faces)).infos.len();
            assert!(chunks >= least, "{name}, regions of {faces}: {chunks} chunks");
        }
    }
}

#[test]
fn closed_manifolds_keep_two_faces_at_every_edge() {
    for (name, source) in closed() {
        let mesh = quantised(&source);
        let assets = [with_truncation_points(200), in_blocks(700, with_truncation_points(200))]
            .map(|s| prepared(&mesh, &s));
        let mut random = Random::new(4);
        for asset in assets.iter().flat_map(|asset| std::iter::repeat_n(asset, 15)) {
            let set = ancestor_closed_cut::random(&asset.infos, &mut random);
            let mut active = ActiveMesh::new(&asset.base);
            for member in ancestor_closed_cut::random_order(&asset.infos, &set, &mut random) {
                apply(&mut active, asset, member);
            }
            let state = active.to_mesh();
            let mut directed: Vec<(u32, u32)> = Vec::new();
            for face in &state.faces {
                let v = face.wedges.map(|w| state.wedges[w as usize].vertex);
                directed.extend([(v[0], v[1]), (v[1], v[2]), (v[2], v[0])]);
            }
            directed.sort_unstable();
            let count = |edge: (u32, u32)| {
                directed.partition_point(|&e| e <= edge) - directed.partition_point(|&e| e < edge)
            };
            for &(a, b) in &directed {
                assert_eq!((count((a, b)), count((b, a))), (1, 1), "{name}: edge {a} {b}");
            }
        }
    }
}

#[test]
fn all_chunks_applied_give_the_input_back() {
    for (name, source) in all() {
        let mesh = quantised(&source);
        let expected = plain_faces(&mesh);
        for settings in [regions(50), regions(1000), in_blocks(600, regions(100))] {
            let asset = prepared(&mesh, &settings);
            let active = deltas(&asset).0;
            let full = active.to_mesh();
            assert!(plain_faces(&full) == expected, "{name}, {settings:?}");
            assert_eq!(full.positions.len(), mesh.positions.len(), "{name}: vertices");
            // A region does not know the wedges of its outline's vertices outside it: one that only such faces use
            // may be duplicated. The duplicate has equal attributes.
            let distinct: BTreeSet<_> = full.wedges.iter().map(|w| (w.vertex, w.attributes)).collect();
            assert_eq!(distinct.len(), mesh.wedges.len(), "{name}: wedges");
            assert!(full.wedges.len() * 100 <= mesh.wedges.len() * 101, "{name}: {}", full.wedges.len());
            assert_eq!(active.face_count(), mesh.faces.len());
            assert_eq!(active.vertex_count(), mesh.positions.len());
        }
    }
}

/// Chunks that can be applied or raised, and chunks that can be undone.
fn moves(infos: &[ChunkInfo], active: &ActiveMesh) -> (Vec<u32>, Vec<u32>) {
    let mut needed = vec![false; infos.len()];
    for (id, info) in infos.iter().enumerate() {
        if active.is_applied(id as u32) {
            for &p in &info.parents {
                needed[p as usize] = true;
            }
        }
    }
    let ids = 0..infos.len() as u32;
    let ready = |&id: &u32| {
        let whole = |chunk| active.is_applied(chunk) && active.applied_truncation(chunk).is_none();
        !whole(id) && infos[id as usize].parents.iter().all(|&p| whole(p))
    };
    let done = |&id: &u32| active.is_applied(id) && !needed[id as usize];
    (ids.clone().filter(ready).collect(), ids.filter(done).collect())
}

#[test]
fn random_walks_of_apply_and_undo_leave_no_trace() {
    for (name, source) in all() {
        let mesh = quantised(&source);
        let asset = prepared(&mesh, &with_truncation_points(200));
        let (full, whole) = deltas(&asset);
        let mut active = ActiveMesh::new(&asset.base);
        let mut applied: Vec<Option<ChunkDelta>> = vec![None; asset.infos.len()];
        let start = active.snapshot();
        let mut random = Random::new(21);
        for step in 0..6 * asset.infos.len() {
            let (up, down) = moves(&asset.infos, &active);
            // Mostly applies for a while, then mostly undoes.
            let up_first = random.below(10) < if (step / 40) % 2 == 0 { 7 } else { 3 };
            let from = if down.is_empty() || (up_first && !up.is_empty()) { &up } else { &down };
            if from.is_empty() {
                break;
            }
            let id = from[random.below(from.len())];
            let undone = applied[id as usize].take();
            if let Some(delta) = &undone {
                active.undo(delta.chunk).unwrap();
            }
            if undone.is_none() || up.contains(&id) {
                // To a random truncation point or the whole, whatever the state before.
                let truncation_points = asset.infos[id as usize].truncation_points.len();
                let truncation = random.below(2 * truncation_points + 1);
                let member = Member {
                    chunk: id,
                    truncation: (truncation < truncation_points).then_some(truncation as u8),
                };
                let delta = apply(&mut active, &asset, member);
                let canonical = delta.truncation.is_some() || delta == whole[id as usize];
                assert!(canonical, "{name}: chunk {id} after {step} steps");
                applied[id as usize] = Some(delta);
            }
            if step % 29 == 0 {
                let mut fresh = ActiveMesh::new(&asset.base);
                for delta in applied.iter().flatten() {
                    fresh.apply(delta).unwrap();
                }
                assert!(fresh.snapshot() == active.snapshot(), "{name}: after {step} steps");
                assert_eq!(fresh.face_count(), active.face_count());
                assert_eq!(fresh.applied_count(), active.applied_count());
            }
        }
        loop {
            let (_, down) = moves(&asset.infos, &active);
            let Some(&id) = down.get(random.below(down.len())) else { break };
            active.undo(id).unwrap();
            applied[id as usize] = None;
        }
        assert!(active.snapshot() == start, "{name}: not back at the base mesh");
        assert!(
            active.wedge_slots() <= 2 * full.wedge_slots() + 64,
            "{name}: {} wedge slots, {} wedges: slots are not used again",
            active.wedge_slots(),
            full.wedge_slots()
        );
    }
}

/// Undoes down to a part of the mesh and applies again, several times, compacting in small steps: the mesh is the same as
/// without, and what it holds follows what is applied.
#[test]
fn compaction_changes_nothing_but_slots_and_memory() {
    let mut compacted = 0;
    for (name, source) in all() {
        let asset = prepared(&quantised(&source), &with_truncation_points(100));
        let chunks = asset.infos.len();
        let mut active = ActiveMesh::new(&asset.base);
        let mut random = Random::new(33);
        let full = deltas(&asset).0.bytes();
        for swing in 0..6 {
            let high = chunks - random.below(chunks / 8 + 1);
            for _ in 0..8 * chunks {
                let (up, _) = moves(&asset.infos, &active);
                if active.applied_count() >= high || up.is_empty() {
                    break;
                }
                let id = up[random.below(up.len())];
                if active.is_applied(id) {
                    active.undo(id).unwrap();
                }
                apply(&mut active, &asset, Member { chunk: id, truncation: None });
                if random.below(3) == 0 && active.is_sparse() {
                    active.compact(100);
                }
            }
            let low = random.below(chunks / 4 + 1);
            while active.applied_count() > low {
                let (_, down) = moves(&asset.infos, &active);
                active.undo(down[random.below(down.len())]).unwrap();
                if random.below(3) == 0 && active.is_sparse() {
                    compacted += 1;
                    active.compact(100);
                }
            }
            let before = (active.snapshot(), plain_faces(&active.to_mesh()));
            for _ in 0..chunks {
                active.compact(100);
            }
            assert!(!active.is_sparse(), "{name}: compaction ends");
            assert!(active.snapshot() == before.0, "{name}, swing {swing}");
            let mut fresh = ActiveMesh::new(&asset.base);
            for (id, info) in (0..).zip(&asset.infos).filter(|(id, _)| active.is_applied(*id)) {
                let delta = fresh.decode(id, info, &asset.chunks[id as usize]).unwrap();
                fresh.apply(&delta).unwrap();
            }
            assert!(fresh.snapshot() == before.0 && plain_faces(&fresh.to_mesh()) == before.1, "{name}");
            let (bytes, needed) = (active.bytes(), fresh.bytes());
            assert!(
                bytes <= 2 * needed + full / 16 + (1 << 16),
                "{name}: {bytes} of {needed} bytes, full {full}"
            );
        }
        while active.applied_count() > 0 {
            let (_, down) = moves(&asset.infos, &active);
            active.undo(down[random.below(down.len())]).unwrap();
            if active.is_sparse() {
                active.compact(1000);
            }
        }
        assert!(active.snapshot() == ActiveMesh::new(&asset.base).snapshot(), "{name}");
    }
    assert!(compacted > 100, "compacted {compacted} times");
}

/// Raises every chunk from truncation point to truncation point; returns the number of steps.
fn raise_all(asset: &Prepared) -> usize {
    let mut active = ActiveMesh::new(&asset.base);
    let mut raised = 0;
    for (id, (info, payload)) in (0..).zip(asset.infos.iter().zip(&asset.chunks)) {
        let not_applied = active.raise(id, info, None, payload);
        assert_eq!(not_applied, Err(ChunkError::Refine(RefineError::NotApplied(id))));
        let truncation_points: Vec<Option<u8>> =
            (0..info.truncation_points.len() as u8).map(Some).chain([None]).collect();
        apply(&mut active, asset, Member { chunk: id, truncation: truncation_points[0] });
        for truncation_points in truncation_points.windows(2) {
            let (before, slots, bytes) = (active.snapshot(), active.wedge_slots(), active.bytes());
            // Refused raises leave the mesh unchanged: damaged bytes, another chunk's, no bytes, no such truncation
            // point.
            for damaged in [&payload[..payload.len() / 9], &[0xa5; 4000], &[]] {
                let refused = active.raise(id, info, truncation_points[1], damaged);
                assert!(matches!(refused, Err(ChunkError::Decode(_))), "chunk {id}: {refused:?}");
                assert!(active.snapshot() == before && active.applied_truncation(id) == truncation_points[0]);
                assert_eq!((active.wedge_slots(), active.bytes()), (slots, bytes));
            }
            assert!(active.raise(id, info, Some(99), payload).is_err());
            let mut fresh = active.clone();
            fresh.undo(id).unwrap();
            apply(&mut fresh, asset, Member { chunk: id, truncation: truncation_points[1] });
            active.raise(id, info, truncation_points[1], payload).unwrap();
            assert!(active.snapshot() == fresh.snapshot(), "chunk {id} from {truncation_points:?}");
            assert_eq!(
                (active.face_count(), active.vertex_count()),
                (fresh.face_count(), fresh.vertex_count())
            );
            assert_eq!(active.applied_truncation(id), truncation_points[1]);
            raised += 1;
        }
        let whole = active.raise(id, info, None, payload);
        assert_eq!(whole, Err(ChunkError::Refine(RefineError::AlreadyApplied(id))));
    }
    raised
}

#[test]
fn raising_in_steps_equals_applying_at_once() {
    let mut raised = 0;
    for source in
        [shapes::medley(1), shapes::sphere(40, 60, 0.05), shapes::materials(shapes::torus(30, 40), 3)]
    {
        raised += raise_all(&prepared(&quantised(&source), &with_truncation_points(200)));
    }
    assert!(raised > 20, "only {raised} times");
}

#[test]
fn a_mesh_that_only_grows_is_the_same_and_smaller_but_undoes_nothing() {
    let asset = prepared(&quantised(&shapes::sphere(40, 60, 0.05)), &with_truncation_points(200));
    let (full, whole) = deltas(&asset);
    let mut growing = ActiveMesh::growing(&asset.base);
    whole.iter().for_each(|delta| drop(growing.apply(delta).unwrap()));
    assert!(growing.snapshot() == full.snapshot());
    let last = asset.base.chunk_count - 1;
    assert_eq!(growing.undo(last), Err(RefineError::OnlyGrows(last)));
    assert!(growing.snapshot() == full.snapshot());
    let (kept, none) = (full.bytes(), growing.bytes());
    assert!(none < kept && kept < none + none / 4, "{kept} bytes, {none} without what undoing needs");
}

#[test]
fn children_require_whole_parents() {
    let asset = prepared(&quantised(&shapes::sphere(40, 60, 0.05)), &with_truncation_points(200));
    let (_, whole) = deltas(&asset);
    let mut random = Random::new(3);
    let mut tried = 0;
    for (id, info) in (0..).zip(&asset.infos) {
        // A parent with truncation points that is not an ancestor of the child's other parents.
        let Some(&parent) =
            info.parents.last().filter(|&&p| !asset.infos[p as usize].truncation_points.is_empty())
        else {
            continue;
        };
        tried += 1;
        let mut active = ActiveMesh::new(&asset.base);
        let others: BTreeSet<u32> = info.parents.iter().flat_map(|&p| ancestors(&asset.infos, p)).collect();
        for &other in others.iter().filter(|&&p| p != parent) {
            active.apply(&whole[other as usize]).unwrap();
        }
        let truncation = random.below(asset.infos[parent as usize].truncation_points.len()) as u8;
        let partial = apply(&mut active, &asset, Member { chunk: parent, truncation: Some(truncation) });
        assert_eq!(active.applied_truncation(parent), Some(truncation));
        let before = active.snapshot();
        let refusal = RefineError::PartialParent { chunk: id, parent };
        // Omitting the parent from the index does not help if the chunk builds on its elements.
        let mut blind = whole[id as usize].clone();
        blind.parents.retain(|&p| p != parent);
        match active.apply(&blind) {
            Ok(_) => drop(active.undo(id).unwrap()),
            Err(why) => assert!(why == refusal || why == RefineError::Mismatch(id), "{why}"),
        }
        // A forged parent link: the named chunk must be whole, used or not.
        let forged = ChunkDelta { chunk: id, parents: info.parents.clone(), ..ChunkDelta::default() };
        assert_eq!(active.apply(&forged), Err(refusal));
        assert!(active.apply(&whole[id as usize]).is_err());
        let why = active.decode(id, info, &asset.chunks[id as usize]).unwrap_err().to_string();
        assert!(why.contains("only up to a truncation"), "{why}");
        assert_eq!(active.apply(&partial), Err(RefineError::AlreadyApplied(parent)));
        assert!(active.snapshot() == before);
        active.undo(parent).unwrap();
        assert_eq!(active.undo(parent), Err(RefineError::NotApplied(parent)));
        apply(&mut active, &asset, Member { chunk: parent, truncation: None });
        active.apply(&whole[id as usize]).unwrap();
        assert_eq!(active.applied_truncation(parent), None);
    }
    assert!(tried >= 5, "only {tried} chunks have a parent with truncation points");
}

#[test]
fn a_dropped_parent_link_is_reported_as_order_dependence() {
    let asset = prepared(&quantised(&shapes::sphere(24, 40, 0.05)), &regions(100));
    let reported = |infos: &[ChunkInfo]| {
        check(&asset.base, infos, &asset.chunks, 20, 17, &Serial)
            .map_or(1, |r| r.order_dependent + r.cracks + r.undo_errors)
    };
    assert_eq!(reported(&asset.infos), 0);
    let mut random = Random::new(2);
    let (mut tried, mut noticed) = (0, 0);
    for id in (0..asset.infos.len()).filter(|&id| !asset.infos[id].parents.is_empty()) {
        let mut infos = asset.infos.clone();
        let at = random.below(infos[id].parents.len());
        let parent = infos[id].parents.remove(at);
        // A link implied by another parent changes nothing.
        let implied = |p: u32| ancestors(&infos, p).contains(&parent);
        if infos[id].parents.iter().any(|&p| implied(p)) {
            continue;
        }
        tried += 1;
        noticed += usize::from(reported(&infos) > 0);
    }
    assert!(tried >= 10, "only {tried} links to drop");
    assert!(noticed * 4 >= tried * 3, "{noticed} of {tried} dropped links noticed");
}

fn ancestors(infos: &[ChunkInfo], id: u32) -> Vec<u32> {
    let mut list = vec![id];
    let mut at = 0;
    while at < list.len() {
        for &p in &infos[list[at] as usize].parents {
            if !list.contains(&p) {
                list.push(p);
            }
        }
        at += 1;
    }
    list
}

#[test]
fn an_unlocked_outline_is_reported_as_cracks() {
    for (name, source) in closed() {
        let settings = Settings { unlock_outlines: true, ..regions(200) };
        let asset = prepared(&quantised(&source), &settings);
        let report = check(&asset.base, &asset.infos, &asset.chunks, 10, 9, &Serial).unwrap();
        assert!(report.cracks > 0, "{name}: {report:?}");
    }
}
