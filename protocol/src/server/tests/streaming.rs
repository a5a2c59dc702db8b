//! Both sessions in a pair: a scene streams, settles, and is refined further.

use std::collections::{HashMap, HashSet};
use std::time::Duration;

use super::*;
use crate::client::Resume;
use crate::pair::Pair;
use crate::source::SceneSource as _;
use lodestream_scene::view::View;
use lodestream_select::{AssetState, State, max_screen_error_px};

#[test]
fn scene_streams_and_settles_on_both_transports() {
    let scene = MemoryScene::new(3, 4, 5);
    for config in [ServerConfig::quic(Some(2 * MBIT)), ServerConfig::websocket(Some(2 * MBIT))] {
        let mut pair = Pair::new(&scene, config, Resume::default());
        pair.run_until(Time::from_ms(20_000));
        let client_state = &pair.client_state;
        assert!(pair.selector.last().counters.settled, "{:?}", pair.selector.last().counters);
        assert!(max_screen_error_px(&pair.view, &client_state.instances, &client_state.assets) <= 1.0);
        assert!(client_state.done.is_some() && client_state.closed.is_none());
        assert_eq!(pair.client.stats().in_flight_bytes, 0);
        let mut counts = HashMap::new();
        for (_, id) in &client_state.blobs {
            *counts.entry(*id).or_insert(0) += 1;
        }
        assert!(counts.values().all(|n| *n == 1), "a blob was sent twice");
    }
}

#[test]
fn moving_camera_settles_where_it_stops_without_waste() {
    let scene = MemoryScene::new(3, 3, 6);
    let mut pair = Pair::new(&scene, ServerConfig::websocket(Some(2 * MBIT)), Resume::default());
    for step in 1..=10 {
        pair.run_until(Time::from_ms(step * 300));
        let z = 4.0 - step as f64;
        pair.view = View::look_at([0.0, 0.4, z], [0.5, 0.0, z - 2.0], [0.0, 1.0, 0.0], 0.9, [1280, 720]);
        pair.client.set_view(pair.now, pair.view);
    }
    pair.run_until(Time::from_ms(60_000));
    let client_state = &pair.client_state;
    assert!(client_state.closed.is_none() && pair.selector.last().counters.settled);
    assert!(max_screen_error_px(&pair.view, &client_state.instances, &client_state.assets) <= 1.0);
    let distinct: HashSet<_> = client_state.blobs.iter().map(|(_, id)| *id).collect();
    let again = client_state.blobs.len() - distinct.len();
    assert!(again * 20 <= client_state.blobs.len(), "{again} of {} came twice", client_state.blobs.len());
}

#[test]
fn first_frame_needs_little_more_than_its_bytes_at_the_rate() {
    let scene = MemoryScene::new(5, 4, 5);
    for rate in [2, 8, 16] {
        let config = ServerConfig::websocket(Some(rate * MBIT));
        let mut pair = Pair::new(&scene, config, Resume::default());
        pair.run_until(Time::from_ms(3000));
        let first_frame = pair.client_state.first_frame.unwrap();
        let arrivals = pair.client_state.arrivals.iter().filter(|(at, _)| *at <= first_frame);
        let bytes: u64 = arrivals.map(|(_, bytes)| *bytes as u64).sum();
        let ideal = pair.latency + Duration::from_nanos(bytes * 8000 / rate);
        let late = first_frame.since(Time::from(ideal));
        assert!(late < Duration::from_millis(15), "{rate} Mbit/s: {bytes} bytes, {late:?} late");
        // Only base meshes, pages and little else come before it.
        let bases: u64 =
            pair.scene.pages.iter().flat_map(|p| &p.assets).map(|a| u64::from(a.base_bytes)).sum();
        assert!(bytes < bases + 6000, "{bytes} bytes for {bases}");
        assert!(pair.client_state.bases_sent.is_some());
    }
}

#[test]
fn link_does_not_idle_while_blobs_are_wanted() {
    let scene = MemoryScene::new(2, 2, 6);
    for (rate, latency) in [(2, 25), (16, 25), (8, 150)] {
        let mut pair = Pair::new(&scene, ServerConfig::websocket(Some(rate * MBIT)), Resume::default());
        pair.latency = Duration::from_millis(latency);
        pair.run_until(Time::from_ms(30_000));
        let last = pair.client_state.blobs.last().unwrap().0;
        let bytes: usize = pair.client_state.arrivals.iter().map(|(_, bytes)| bytes).sum();
        let busy = Duration::from_nanos(bytes as u64 * 8000 / rate);
        let round_trip = pair.latency * 2;
        let allowed = busy.mul_f64(1.06) + round_trip * 3;
        assert!(last.since(Time::ZERO) < allowed, "{rate} Mbit/s: {last:?} for {busy:?} of bytes");
    }
}

#[test]
fn refinement_begins_without_an_idle_round_trip() {
    let scene = MemoryScene::new(1, 1, 6);
    for latency in [25, 100] {
        let mut pair = Pair::new(&scene, ServerConfig::websocket(Some(2 * MBIT)), Resume::default());
        pair.latency = Duration::from_millis(latency);
        pair.run_until(Time::from_ms(1500));
        let first = pair.client_state.arrivals.first().unwrap().0;
        assert!(first.since(Time::ZERO) < pair.latency + Duration::from_millis(5));
        let gaps = pair.client_state.arrivals.windows(2).map(|pair| (pair[1].0.since(pair[0].0), pair[0].0));
        let after_hello = gaps.filter(|(_, at)| at.since(Time::ZERO) > pair.latency * 3);
        let longest = after_hello.max().unwrap();
        assert!(longest.0 < Duration::from_millis(25), "latency {latency} ms: {longest:?}");
    }
}

/// A distant view needs only the beginnings of chunks; moving nearer fetches their rest, and nothing twice (the pair's
/// client ignores what it has).
#[test]
fn truncation_points_save_bytes_and_nearer_views_fetch_the_rest() {
    let scene = MemoryScene::new(2, 2, 5);
    let run = |truncation_points: bool| {
        let config = ServerConfig { push_after_hello_bytes: 0, ..ServerConfig::websocket(Some(4 * MBIT)) };
        let mut pair = Pair::new(&scene, config, Resume::default());
        pair.selector.settings_mut().truncation_points = truncation_points;
        let mut received = Vec::new();
        for eye in [[0.0, 12.0, 30.0], [0.0, 9.0, 22.0], [0.0, 6.0, 12.0], [0.0, 3.0, 6.0]] {
            pair.view = View { eye, ..pair.view };
            pair.run_until(pair.now + Duration::from_secs(10));
            let counters = pair.selector.last().counters;
            assert!(counters.settled, "{counters:?}");
            let worst =
                max_screen_error_px(&pair.view, &pair.client_state.instances, &pair.client_state.assets);
            let complete = pair
                .client_state
                .assets
                .iter()
                .flat_map(AssetState::chunks)
                .flatten()
                .all(|c| c.state() == State::Applied);
            assert!(worst <= 1.0 || complete, "{worst} px left");
            received.push(pair.client_state.received_bytes);
        }
        let held: u64 = pair
            .client_state
            .assets
            .iter()
            .flat_map(|asset| {
                (0..asset.chunks().len() as u32).map(|chunk| u64::from(asset.held_bytes(chunk)))
            })
            .sum();
        let rest: u64 = (0..2)
            .map(|asset| {
                let pages = (0..).map_while(|page| scene.blob_len(&BlobId::index_page(asset, page)));
                u64::from(scene.blob_len(&BlobId::base(asset)).unwrap()) + pages.map(u64::from).sum::<u64>()
            })
            .sum();
        assert!(*received.last().unwrap() <= held + rest, "{received:?}, {held} held");
        received
    };
    let (with, without) = (run(true), run(false));
    assert!(with.iter().zip(&without).all(|(a, b)| a <= b), "{with:?} against {without:?}");
    assert!(with[0] * 100 < without[0] * 90, "{with:?} against {without:?}");
}

#[test]
fn pings_keep_a_settled_session_alive() {
    let scene = MemoryScene::new(1, 1, 2);
    let mut pair = Pair::new(&scene, ServerConfig::websocket(Some(8 * MBIT)), Resume::default());
    pair.run_until(Time::from_ms(300_000));
    assert!(pair.client_state.closed.is_none() && !pair.server.is_closed());
    assert_eq!(pair.client.stats().rtt.map(|rtt| rtt.as_millis()), Some(50));
}
