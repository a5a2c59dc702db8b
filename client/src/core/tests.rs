//! Tests of the core against a real server session, in virtual time.

mod animation;
mod decoding;
mod faults;
mod memory;
mod parts;
mod picking;
mod proxies;
mod punctual_lights;
mod restated;
mod shared;
mod tiles;
mod truncation_points;

use std::collections::BTreeMap;
use std::time::Duration;

use lodestream_geometry::refine::ActiveMesh;
use lodestream_scene::blob::BlobId;
use lodestream_scene::description::Camera;
use lodestream_scene::view::View;
use lodestream_select::Share;

use super::testing::{Loopback, TestScene, prepared};
use super::{Change, Config, MeshChange};

fn view(camera: Camera, target_px: f32) -> View {
    camera.view([640, 360], target_px)
}

/// A view that needs asset 0 in its finest form.
fn finest() -> View {
    view(TestScene::new(1).camera(), 1e-4)
}

#[test]
fn a_view_settles_within_its_target() {
    let mut link = Loopback::new(TestScene::new(2), |_| {});
    link.connect();
    link.settle();
    let stats = link.core.stats();
    assert!(stats.counters.max_screen_error_px <= 1.0, "{stats:?}");
    assert!(stats.applied_chunks > 3, "{stats:?}");
    assert!(stats.faces < 2 * prepared().0.faces.len() as u64, "more than the view needs");
    assert_eq!(stats.decode_failures, 0);
    assert!(link.times_sent().values().all(|n| *n == 1), "{:?}", link.times_sent());
    let m = stats.milestones;
    let first = m.first_frame.unwrap().after;
    let [q16, q4, q1] = m.quality.map(|q| q.unwrap().after);
    assert!(first <= q16 && q16 <= q4 && q4 <= q1, "{m:?}");
}

#[test]
fn small_work_budgets_still_process_every_base_mesh() {
    let mut link = Loopback::new(TestScene::new(24), |_| {});
    link.budget = 1;
    // Base meshes suffice for this view: nothing follows them that would cause another selection.
    link.core.set_view(link.now, view(TestScene::new(24).camera(), 1e6));
    link.connect_overtaken();
    link.settle();
    let stats = link.core.stats();
    assert!(stats.milestones.first_frame.is_some(), "{stats:?}");
    assert_eq!(stats.counters.drawable_instances, stats.counters.visible_instances);
}

#[test]
fn all_chunks_applied_give_the_input() {
    for source in [TestScene::new(1), TestScene::compressed()] {
        everything_of(source);
    }
}

fn everything_of(source: TestScene) {
    let mut link = Loopback::new(source, |_| {});
    link.core.set_view(link.now, finest());
    link.connect();
    link.settle();
    let mesh = link.core.mesh(0).unwrap().to_mesh();
    let (input, prepared) = prepared();
    assert_eq!(link.core.stats().applied_chunks, prepared.chunks.len() as u64);
    let faces = |m: &lodestream_geometry::mesh::QuantisedMesh| {
        let mut faces: Vec<_> = m
            .faces
            .iter()
            .map(|f| {
                let mut corners = f.wedges.map(|w| {
                    let w = m.wedges[w as usize];
                    (m.positions[w.vertex as usize], w.attributes.uv)
                });
                let least = (0..3).min_by_key(|k| corners[*k]).unwrap();
                corners.rotate_left(least);
                corners
            })
            .collect();
        faces.sort_unstable();
        faces
    };
    assert_eq!(faces(&mesh), faces(input));
}

#[test]
fn small_work_budgets_give_the_same_result() {
    let mut link = Loopback::new(TestScene::new(1), |_| {});
    link.budget = 100;
    link.core.set_view(link.now, finest());
    link.connect();
    link.settle();
    assert_eq!(link.core.stats().applied_chunks, prepared().1.chunks.len() as u64);
}

#[test]
fn chunks_out_of_view_are_undone_and_reapplied_from_the_cache() {
    let mut link = Loopback::new(TestScene::new(1), |config: &mut Config| {
        // Out of view, nothing is kept.
        config.select.keep_out_of_view = Share::NONE;
    });
    link.connect();
    link.settle();
    let (near, sent) = (link.core.stats(), link.sent.len());
    let camera = TestScene::new(1).camera();
    let away = Camera { eye: [0.0, 2.0, 300.0], ..camera };
    link.core.set_view(link.now, view(away, 1.0));
    link.run(200);
    link.settle();
    let far = link.core.stats();
    assert!(far.applied_chunks < near.applied_chunks / 2, "{far:?}");
    assert!(far.undone > 0 && far.faces < near.faces);
    link.core.set_view(link.now, view(camera, 1.0));
    link.run(200);
    link.settle();
    assert_eq!(link.core.stats().applied_chunks, near.applied_chunks);
    assert_eq!(link.sent.len(), sent, "nothing is fetched twice");
}

#[test]
fn shadow_casters_out_of_view_are_refined_if_shadows_are_drawn() {
    // The second asset stands beside the view, towards the sun.
    let mut link = Loopback::new(TestScene::new(2).lit_from([1.0, 0.3, 0.0]), |_| {});
    let narrow = Camera { fov_y: 0.3, ..TestScene::new(2).camera() };
    link.core.set_view(link.now, view(narrow, 1.0));
    link.connect();
    link.settle();
    let without = link.core.stats();
    assert_eq!((without.counters.visible_instances, without.counters.shadow_bytes), (1, 0));
    link.core.set_shadows(true);
    link.run(200);
    link.settle();
    let with = link.core.stats();
    assert!(with.counters.shadow_bytes > 0 && with.applied_chunks > without.applied_chunks, "{with:?}");
    assert_eq!(with.counters.max_screen_error_px, without.counters.max_screen_error_px);
}

#[test]
fn a_cache_that_is_too_small_fetches_again_but_stays_bounded() {
    let mut link = Loopback::new(TestScene::new(1), |config: &mut Config| {
        config.select.keep_out_of_view = Share::NONE;
        config.cache_bytes = 2000;
    });
    link.connect();
    link.settle();
    let near = link.core.stats();
    let camera = TestScene::new(1).camera();
    for eye in [300.0, 3.0] {
        link.core.set_view(link.now, view(Camera { eye: [0.0, 2.0, eye], ..camera }, 1.0));
        link.run(200);
        link.settle();
        assert!(link.core.stats().cached_bytes <= 2000);
    }
    assert_eq!(link.core.stats().applied_chunks, near.applied_chunks);
    // One request per time that it was needed, and one push before anything wanted it.
    let most = link.times_sent().into_values().max().unwrap();
    assert!((2..=3).contains(&most), "{most}");
}

#[test]
fn budgets_hold() {
    let mut link = Loopback::new(TestScene::new(1), |config: &mut Config| config.select.max_faces = 1500);
    link.core.set_view(link.now, finest());
    link.connect();
    link.settle();
    let stats = link.core.stats();
    assert!(stats.counters.applied_faces <= 1500, "{stats:?}");
    assert!(stats.counters.threshold_px > 1e-4);
}

/// Render targets of a window leave less memory when it grows, and more when it shrinks.
#[test]
fn a_bound_on_memory_that_changes_undoes_chunks_and_brings_them_back() {
    let mut link = Loopback::new(TestScene::new(1), |_| {});
    link.core.set_view(link.now, finest());
    link.connect();
    link.settle();
    let full = link.core.stats();
    let mut resettled = |memory_bytes| {
        link.core.bound_memory(memory_bytes);
        link.run(200);
        link.settle();
        link.core.stats()
    };
    let bounded = resettled(1 << 20);
    assert!(bounded.faces < full.faces && bounded.undone > 0, "{bounded:?}");
    let base_alone = resettled(0);
    assert!(base_alone.faces > 0 && base_alone.faces < bounded.faces, "{base_alone:?}");
    assert_eq!(base_alone.applied_chunks, 0);
    assert_eq!(resettled(512 << 20).faces, full.faces);
}

#[test]
fn changes_rebuild_the_mesh_step_by_step() {
    let mut link = Loopback::new(TestScene::new(1), |_| {});
    link.core.set_view(link.now, finest());
    link.connect();
    let (mut vertices, mut faces) = (Vec::new(), Vec::new());
    let (mut textures, mut steps) = (0, 0);
    for round in 0..3000 {
        link.run(1);
        for change in link.core.take_changes(link.now, 20_000) {
            steps += 1;
            match change {
                Change::Mesh(mesh) => {
                    for (first, run) in mesh.vertices {
                        let end = first as usize + run.len();
                        vertices.resize(vertices.len().max(end), None);
                        for (slot, vertex) in (first as usize..).zip(run) {
                            vertices[slot] = Some(vertex);
                        }
                    }
                    for run in mesh.indices {
                        let end = run.first as usize + run.faces.len();
                        faces.resize(faces.len().max(end), [0; 3]);
                        faces[run.first as usize..end].copy_from_slice(&run.faces);
                    }
                    // Every step can be drawn: faces name only vertices that exist.
                    let known = |w: &u32| vertices.get(*w as usize).is_some_and(Option::is_some);
                    assert!(faces.iter().flatten().all(known), "round {round}");
                }
                Change::Texture(_) => textures += 1,
                _ => {}
            }
        }
    }
    assert!(link.core.is_settled() && !link.core.has_changes());
    let mesh = link.core.mesh(0).unwrap();
    assert_eq!(faces, mesh.indices(0));
    for face in &faces {
        for wedge in face {
            let vertex = vertices[*wedge as usize].unwrap();
            assert_eq!(vertex.data, mesh.render_vertex(*wedge));
        }
    }
    // Chunks far off appear at once, others morph.
    assert!(vertices.iter().flatten().any(|v| v.level > 0 && v.birth_s < 0.0));
    assert!(vertices.iter().flatten().any(|v| v.level > 1 && v.birth_s > 0.0));
    assert!(steps > 3 && textures == 3, "{steps} {textures}");
}

/// Meshes are taken in the order of their refinement, not of their asset numbers: no asset near the camera waits for
/// others with lower numbers.
#[test]
fn changes_are_taken_in_the_order_of_refinement() {
    let mut link = Loopback::new(TestScene::new(3), |_| {});
    // Beside the last asset, along the row.
    let camera = Camera { eye: [9.0, 2.0, 3.0], target: [3.0, 0.0, 0.0], ..TestScene::new(3).camera() };
    link.core.set_view(link.now, view(camera, 1e-4));
    link.connect();
    while link.core.stats().milestones.first_frame.is_none() {
        link.run(1);
    }
    link.core.take_changes(link.now, usize::MAX);
    let applied = |link: &Loopback, asset| link.core.mesh(asset).map_or(0, ActiveMesh::applied_count);
    let before = [0, 1, 2].map(|asset| applied(&link, asset));
    // No changes are taken until all assets are refined further, one blob at a time.
    let mut refined: Vec<u32> = Vec::new();
    link.budget = 1;
    for _ in 0..10_000 {
        if refined.len() == 3 {
            break;
        }
        link.run(1);
        for asset in 0..3 {
            if applied(&link, asset) > before[asset as usize] && !refined.contains(&asset) {
                refined.push(asset);
            }
        }
    }
    assert!(refined.len() == 3 && refined != [0, 1, 2], "not in the order of asset numbers: {refined:?}");
    let mut given = Vec::new();
    while link.core.has_changes() {
        let step = link.core.take_changes(link.now, 1);
        assert!(!step.is_empty());
        given.extend(step.iter().filter_map(|change| match change {
            Change::Mesh(mesh) => Some(mesh.asset),
            _ => None,
        }));
    }
    assert_eq!(given, refined);
}

/// A renderer's morph takes this long; vertices with an earlier birth appear at their place.
const MORPH_S: f32 = 0.25;

/// Of each chunk, how many whole pixels its region was off without it, and whether the chunk appeared at once.
fn appearances(view: View) -> Vec<(u16, bool)> {
    let mut link = Loopback::new(TestScene::new(1), |_| {});
    link.core.set_view(link.now, view);
    link.connect();
    let mut seen = BTreeMap::new();
    for _ in 0..3000 {
        link.run(1);
        let now_s = Duration::from(link.now).as_secs_f64() as f32;
        // The selection's errors of the chunks that were applied since the last step.
        let said = link
            .core
            .selection
            .wanted
            .iter()
            .map(|wanted| (wanted.id, wanted.error_px))
            .collect::<BTreeMap<_, _>>();
        for change in link.core.take_changes(link.now, usize::MAX) {
            let Change::Mesh(MeshChange { vertices, .. }) = change else { continue };
            let mesh = link.core.mesh(0).unwrap();
            let mut new = BTreeMap::new();
            let slots = vertices.iter().flat_map(|(first, run)| (*first..).zip(run));
            for (slot, vertex) in slots.filter(|(_, vertex)| vertex.data.morph_from != vertex.data.position) {
                let Some(chunk) = mesh.wedge_chunk(slot).filter(|chunk| !seen.contains_key(chunk)) else {
                    continue;
                };
                let age_s = now_s - vertex.birth_s;
                assert!(
                    age_s == 0.0 || age_s > MORPH_S,
                    "chunk {chunk} is drawn {age_s} s after it could be"
                );
                let error_px = said[&BlobId::chunk(0, chunk)];
                let at_once = *new.entry(chunk).or_insert((error_px, age_s > MORPH_S));
                assert_eq!(at_once, (error_px, age_s > MORPH_S), "chunk {chunk} morphs only in part");
            }
            seen.append(&mut new);
        }
    }
    assert!(link.core.is_settled());
    seen.into_values().collect()
}

/// Large missing parts would otherwise fade in slowly.
#[test]
fn chunks_more_than_eight_pixels_off_appear_without_a_morph() {
    let Camera { eye: [x, y, z], .. } = TestScene::new(1).camera();
    let mut all = Vec::new();
    for away in [0.4, 0.6, 0.8, 1.0, 1.3, 1.7, 2.5] {
        let camera = Camera { eye: [away * x, away * y, away * z], ..TestScene::new(1).camera() };
        all.extend(appearances(view(camera, 0.01)));
    }
    all.sort_unstable();
    for &(error_px, at_once) in &all {
        assert_eq!(at_once, error_px > 8, "{error_px} pixels off");
    }
    // There are chunks close to the limit on both sides.
    assert!(
        all.iter().any(|(px, _)| (7..=8).contains(px)) && all.iter().any(|(px, _)| (9..=10).contains(px))
    );
}
