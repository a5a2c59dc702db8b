//! Tests: selection of pieces, and whole runs of baselines.

use std::path::Path;
use std::sync::Arc;

use lodestream_geometry::index::Sphere;
use lodestream_scene::View;
use lodestream_scene::description::{AssetEntry, Camera, Instance};
use lodestream_select::Projection;

use super::library::{Content, Entry};
use super::nodes;
use super::offer::{Item, Offer, Stage, Texture};
use super::run_case;
use super::select::{ItemStates, State, select};
use crate::peers;
use crate::plan::{self, Plan};
use crate::result::RunResult;
use crate::run::certificate;
use crate::testing::results_of;

const UNIT: Sphere = Sphere { center: [0.0; 3], radius: 1.0 };

/// Assets of radius 1 side by side, `offers[i]` at x = 10 i, seen from `eye` towards −z.
fn content(offers: Vec<Offer>, eye: [f64; 3]) -> Content {
    let assets = offers.iter().map(|_| AssetEntry { sphere: UNIT, ..AssetEntry::default() }).collect();
    let instances = (0..offers.len()).map(|i| Instance::at(i as u32, [10.0 * i as f64, 0.0, 0.0])).collect();
    let target = [eye[0], eye[1], eye[2] - 1.0];
    let camera = Camera { eye, target, up: [0.0, 1.0, 0.0], fov_y: 1.0 };
    let stage = Stage { camera, textures: vec![Vec::new(); offers.len()], assets, instances };
    Content { stage: Arc::new(stage), offers }
}

fn view(content: &Content, target_px: f32) -> View {
    content.stage.camera.view([640, 360], target_px)
}

fn pieces(content: &Content, held: &ItemStates, target_px: f32) -> Vec<(u32, u32)> {
    let selection = select(content, held, &view(content, target_px));
    let piece = |item| match item {
        Item::Piece { asset, piece } => (asset, piece),
        Item::Texture(id) => panic!("{id}"),
    };
    selection.wanted.iter().map(|wanted| piece(wanted.item)).collect()
}

fn have(held: &mut ItemStates, asset: u32, piece: u32) {
    held.set(Item::Piece { asset, piece }, State::Here);
}

/// The example's peer with two roots that share a child.
fn example() -> Offer {
    let peers = peers::parse(include_str!("../../../peers/example.json"), "example").unwrap();
    nodes::offer(&peers[1], [0.0; 3])
}

#[test]
fn nodes_come_after_their_parents_and_only_as_far_as_the_view_needs_them() {
    // 329 px a unit at distance 1, and 4.2 units to the nearest point: an error of 0.2 is 16 px.
    let content = content(vec![example()], [0.0, 0.0, 5.0]);
    let mut held = ItemStates::nothing(&content);
    // Before the index arrives, its nodes are unknown.
    assert_eq!(pieces(&content, &held, 1.0), [(0, 0)]);
    have(&mut held, 0, 0);
    // Both roots, then the children; the shared child is longest, hence last of its octave.
    assert_eq!(pieces(&content, &held, 1.0), [(0, 1), (0, 2), (0, 3), (0, 5), (0, 4)]);
    // A coarse view needs only the roots.
    assert_eq!(pieces(&content, &held, 100.0), [(0, 1), (0, 2)]);
    assert!(!select(&content, &held, &view(&content, 1.0)).drawable);
    have(&mut held, 0, 1);
    assert!(!select(&content, &held, &view(&content, 1.0)).drawable, "one root alone is not drawable");
    have(&mut held, 0, 2);
    let drawn = select(&content, &held, &view(&content, 1.0));
    assert!(drawn.drawable);
    // The error is that of the nearer root under the project's projection.
    let projection = Projection::new(&view(&content, 1.0));
    let local = projection.local(&content.stage.assets[0], &content.stage.instances[0]);
    let root = &content.offers[0].pieces[1];
    let expected = local.error_px(&root.sphere, root.error).unwrap().0;
    assert!((drawn.error_px - expected).abs() < 1e-9 && expected > 15.0, "{drawn:?}, {expected}");
    // With one child here, the geometry of the other children is still drawn from the parent.
    have(&mut held, 0, 4);
    assert_eq!(select(&content, &held, &view(&content, 1.0)).error_px, drawn.error_px);
    have(&mut held, 0, 3);
    have(&mut held, 0, 5);
    let sharp = select(&content, &held, &view(&content, 1.0));
    assert_eq!((sharp.error_px, sharp.wanted.len()), (0.0, 0), "pieces without children are exact");
}

/// Larger errors lead to more and earlier requests; a piece without children stays exact.
#[test]
fn a_peer_whose_errors_are_larger_than_stated_is_fetched_further() {
    let peer = peers::parse(include_str!("../../../peers/example.json"), "example").unwrap().remove(0);
    let wanted = |factor: f32, target_px: f32| {
        let offer = nodes::offer(&peer.clone().with_errors(factor), [0.0; 3]);
        let content = content(vec![offer], [0.0, 0.0, 5.0]);
        let mut held = ItemStates::nothing(&content);
        have(&mut held, 0, 0);
        pieces(&content, &held, target_px).len()
    };
    let target_px = [40.0, 20.0, 10.0, 5.0, 2.5, 1.2].into_iter().find(|&px| wanted(1.0, px) > 1).unwrap();
    assert_eq!(wanted(1.0, target_px * 2.0), 1, "only its root is wanted");
    assert_eq!(wanted(2.0, target_px * 2.0), wanted(1.0, target_px));
    assert_eq!(wanted(1e3, target_px), peer.nodes.len(), "all nodes are wanted, at most");
}

#[test]
fn children_out_of_view_are_not_wanted_and_a_shared_child_brings_all_its_parents() {
    // Close before the left end: the right child (x from 0.25) is out of view, the left and the shared are not.
    let content = content(vec![example()], [-0.9, 0.0, 0.9]);
    let mut held = ItemStates::nothing(&content);
    have(&mut held, 0, 0);
    let wanted = pieces(&content, &held, 1.0);
    assert!(wanted.contains(&(0, 3)) && wanted.contains(&(0, 4)) && !wanted.contains(&(0, 5)), "{wanted:?}");
    let place = |piece| wanted.iter().position(|&w| w == (0, piece)).unwrap();
    assert!(place(1) < place(4) && place(2) < place(4), "{wanted:?}");
}

#[test]
fn a_chain_goes_on_while_its_error_shows() {
    let levels = [(100, 0.5), (200, 0.05), (400, 0.005), (800, 0.0)];
    let content = content(vec![Offer::chain(&levels, UNIT), Offer::chain(&levels, UNIT)], [0.0, 0.0, 5.0]);
    let mut held = ItemStates::nothing(&content);
    // 329 px at distance 1, 82 px at the nearest point: 41, 4.1, 0.41 px.
    assert_eq!(
        pieces(&content, &held, 1.0),
        [(0, 0), (0, 1), (0, 2), (1, 0)],
        "the one out of view comes last"
    );
    assert_eq!(pieces(&content, &held, 5.0), [(0, 0), (0, 1), (1, 0)]);
    assert_eq!(pieces(&content, &held, 0.1), [(0, 0), (0, 1), (0, 2), (0, 3), (1, 0)]);
    have(&mut held, 0, 1);
    assert!(!select(&content, &held, &view(&content, 1.0)).drawable, "nothing to refine yet");
    have(&mut held, 0, 0);
    let now = select(&content, &held, &view(&content, 1.0));
    assert!(now.drawable && (4.0..4.2).contains(&now.error_px), "{now:?}");
    have(&mut held, 0, 2);
    assert!(select(&content, &held, &view(&content, 1.0)).error_px < 0.5);
}

#[test]
fn textures_are_wanted_by_texels_once_their_asset_is_drawn() {
    let mut content = content(vec![Offer::chain(&[(100, 0.0)], UNIT)], [0.0, 0.0, 5.0]);
    let texture = Texture { uv_per_unit: 1.0, levels: vec![(50, 8), (200, 32), (900, 128), (4000, 512)] };
    Arc::make_mut(&mut content.stage).textures = vec![vec![texture]];
    let mut held = ItemStates::nothing(&content);
    let wanted = |held: &ItemStates| {
        let selection = select(&content, held, &view(&content, 1.0));
        selection.wanted.iter().map(|w| w.bytes).collect::<Vec<_>>()
    };
    assert_eq!(wanted(&held), [100]);
    have(&mut held, 0, 0);
    assert_eq!(wanted(&held), [50, 200], "two levels at a time");
    for level in 0..2 {
        held.set(Item::Texture(lodestream_scene::BlobId::texture(0, 0, level)), State::Here);
    }
    // 82 px a unit: 128 texels are enough.
    assert_eq!(wanted(&held), [900]);
}

fn plan_of(sweep: &str) -> Plan {
    let text =
        format!("scene = \"demo-small\"\nviewport_px = [640, 360]\ntime_limit_s = 60\n[[sweep]]\n{sweep}");
    plan::parse(&text, Path::new("test.toml")).unwrap()
}

/// Runs a synthetic content over the link of a sweep.
fn run_over(sweep: &str, content: Content) -> RunResult {
    let plan = plan_of(sweep);
    let entry = Entry::Ready(Arc::new(content));
    run_case(&plan, &plan.cases[0], &entry, &certificate().unwrap(), 1).unwrap()
}

#[test]
fn a_whole_file_takes_the_time_of_its_bytes() {
    let bytes = 1_000_000_u64;
    let whole = || content(vec![Offer::chain(&[(bytes, 0.0)], UNIT)], [0.0, 0.0, 5.0]);
    let link = "rate_bits_per_s = 2_000_000\nrtt_ms = 50";
    let tcp = run_over(&format!("transport = \"ws\"\ntechnique = \"obj\"\n{link}"), whole());
    assert_eq!((tcp.ended.as_str(), tcp.total_bytes), ("settled", bytes + 160));
    // 4 µs a byte at 2 Mbit/s: the handshake's two packets of 52 bytes and a round trip; its third packet and
    // the request of 160 + 52 bytes; segments of 1,448 bytes with 52 of headers; a round trip.
    let segments = (bytes + 160).div_ceil(1448);
    let expected_ms = 100.0 + (2 * 52 + 52 + 212 + bytes + 160 + segments * 52) as f64 * 4e-3;
    let took_ms = tcp.ttff_ms.unwrap();
    // Timers are up to a millisecond late: at both ends once the connection is open, and at each arrival.
    assert!((expected_ms..=expected_ms + 4.0).contains(&took_ms), "{took_ms}, expected {expected_ms}");
    assert_eq!(tcp.ttff_ms, tcp.ttq_ms["1"], "a whole file is sharp at once");

    let quic = run_over(&format!("transport = \"quic\"\ntechnique = \"obj\"\n{link}"), whole());
    assert_eq!((quic.ended.as_str(), quic.usage.chunk_bytes), ("settled", bytes));
    // Two round trips and the bytes; headers of packets, acknowledgements and the handshake are below 8 %.
    let least_ms = 100.0 + bytes as f64 * 4e-3;
    let took_ms = quic.ttff_ms.unwrap();
    assert!(
        (least_ms..=100.0 + bytes as f64 * 4e-3 * 1.08).contains(&took_ms),
        "{took_ms}, at least {least_ms}"
    );
}

#[test]
fn a_chain_shows_its_first_level_long_before_its_last() {
    let levels = [(2_000, 0.5), (20_000, 0.05), (200_000, 0.0)];
    let chain = content(vec![Offer::chain(&levels, UNIT)], [0.0, 0.0, 5.0]);
    for transport in ["quic", "ws"] {
        let link = "rate_bits_per_s = 2_000_000\nrtt_ms = 50";
        let run =
            run_over(&format!("transport = \"{transport}\"\ntechnique = \"chain\"\n{link}"), chain.clone());
        assert_eq!(run.ended, "settled");
        // Two round trips and little more; 41, then 4.1 px, then none. A later level does not share the link.
        assert!(run.ttff_ms.unwrap() < 140.0, "{run:?}");
        assert!(run.ttq_ms["16"].unwrap() < 100.0 + 22_000.0 * 4e-3 * 1.15 + 20.0, "{run:?}");
        assert!(run.ttq_ms["4"].unwrap() > 222_000.0 * 4e-3 && run.ttq_ms["4"] == run.ttq_ms["1"], "{run:?}");
        assert_eq!((run.usage.chunk_bytes, run.stalls), (222_000, 0));
    }
}

#[test]
fn one_at_a_time_costs_a_round_trip_each() {
    let levels = [(2_000, 0.5), (2_000, 0.4), (2_000, 0.3), (2_000, 0.0)];
    let chain = content(vec![Offer::chain(&levels, UNIT)], [0.0, 0.0, 5.0]);
    let took = |technique: &str| {
        let link = "rate_bits_per_s = 16_000_000\nrtt_ms = 100";
        let sweep = format!("transport = \"ws\"\ntechnique = \"{technique}\"\n{link}");
        run_over(&sweep, chain.clone()).settled_ms.unwrap()
    };
    let (many, one) = (took("chain"), took("seed-json"));
    assert!((300.0..330.0).contains(&(one - many)), "{many} and {one}");
}

const TECHNIQUES: &str =
    "technique = [\"lodestream\", \"nodes\", \"chain\", \"obj\", \"obj-gzip\", \"draco\", \"seed-json\"]";

#[test]
fn techniques_without_encoder_or_peers_are_reported_as_not_run() {
    let sweep =
        format!("transport = [\"quic\", \"ws\"]\nrate_bits_per_s = 8_000_000\nrtt_ms = 50\n{TECHNIQUES}");
    let results = results_of(&plan_of(&sweep));
    let row = |i: usize| &results[i];
    assert_eq!(results.len(), 14);
    for transport in 0..2 {
        let at = |i: usize| row(transport * 7 + i);
        for (i, why) in
            [(1, "not run: no file of peers"), (2, "not run: draco_encoder is not on"), (5, "not run: draco")]
        {
            assert!(at(i).ended.starts_with(why), "{:?}", at(i));
            assert_eq!((at(i).ttff_ms, at(i).total_bytes, at(i).ttq_ms["1"]), (None, 0, None));
        }
        let (ours, obj, gzip, json) = (at(0), at(3), at(4), at(6));
        for run in [ours, obj, gzip, json] {
            assert_eq!(run.ended, "settled", "{run}");
        }
        assert!(ours.ttff_ms < json.ttff_ms && ours.ttff_ms < gzip.ttff_ms && gzip.ttff_ms < obj.ttff_ms);
        assert!(gzip.total_bytes < obj.total_bytes / 2, "{gzip}, {obj}");
    }
}

#[test]
fn nodes_are_those_of_one_model() {
    let peers = peers::parse(include_str!("../../../peers/example.json"), "example").unwrap();
    let plan =
        plan_of("transport = \"quic\"\nrate_bits_per_s = 2_000_000\nrtt_ms = 50\ntechnique = \"nodes\"");
    let plan = plan.with_peers(peers.clone()).with_peers(peers);
    let results = results_of(&plan);
    assert_eq!(results.len(), 2, "a row for each peer");
    for result in &results {
        assert!(result.technique.starts_with("nodes: example, "), "{result}");
        assert!(result.ended.starts_with("not run: nodes are those of one model"), "{result}");
    }
}
