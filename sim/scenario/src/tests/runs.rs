//! Whole runs over the small demo scene.

use std::path::Path;

use crate::ledger::Use;
use crate::plan::{self, Plan, Transport};
use crate::result::to_json;
use crate::testing::{parse, results_of};
use crate::timeline::milliseconds;
use crate::timeline::{MAX_SAMPLES, Sample};

fn short_plan() -> Plan {
    plan::read(&Path::new(env!("CARGO_MANIFEST_DIR")).join("../plans/short.toml")).unwrap()
}

#[test]
fn the_same_seed_gives_the_same_bytes_of_report() {
    let plan = short_plan();
    let with = |seed| to_json(&results_of(&plan.clone().with_seed(seed))).unwrap();
    let first = with(3);
    assert_eq!(first, with(3));
    assert_ne!(first, with(4));
}

#[test]
fn results_are_possible_and_in_order() {
    let results = results_of(&short_plan());
    assert_eq!(
        results.iter().map(|r| r.transport).collect::<Vec<_>>(),
        [Transport::Quic, Transport::Quic, Transport::Ws]
    );
    for result in &results {
        assert_eq!(result.ended, "settled", "{result:?}");
        let times = [result.ttff_ms, result.ttq_ms["4"], result.ttq_ms["1"], result.settled_ms];
        let bytes = [
            result.first_frame_bytes,
            result.ttq_bytes["4"],
            result.ttq_bytes["1"],
            Some(result.total_bytes),
        ];
        assert!(times.iter().all(Option::is_some) && times.is_sorted(), "{result:?}");
        assert!(bytes.iter().all(Option::is_some) && bytes.is_sorted(), "{result:?}");
        // No byte can arrive before a round trip and its own transfer time.
        for (time, bytes) in times.iter().zip(bytes) {
            let least_ms = result.rtt_ms + bytes.unwrap() as f64 * 8e3 / result.rate_bits_per_s as f64;
            assert!(time.unwrap() >= least_ms, "{result:?}: {least_ms}");
        }
        // The first frame should follow soon: one more round trip, some timers.
        let soon_ms = 2.0 * result.rtt_ms
            + result.first_frame_bytes.unwrap() as f64 * 8e3 / result.rate_bits_per_s as f64;
        assert!(result.ttff_ms.unwrap() <= soon_ms + 20.0, "{result:?}: {soon_ms}");
        let lost = result.packets_lost + result.packets_lost_up;
        assert_eq!(lost > 0, result.loss > 0.0, "{result:?}");
        let [all, seen] = [&result.ttq_ms, &result.unoccluded_ttq_ms].map(|times| times["1"].unwrap());
        let said = format!(", 1 px {all:.0} ms (where seen {seen:.0} ms), ");
        assert!(seen <= all && result.to_string().contains(&said), "{result}");
    }
}

#[test]
fn a_faster_link_shows_the_same_scene_sooner() {
    let sweep = "transport = \"quic\"\nrate_bits_per_s = [1_000_000, 16_000_000]\nrtt_ms = [50]";
    let results = results_of(&parse("", sweep));
    assert!(results[1].settled_ms < results[0].settled_ms, "{results:?}");
    assert!(results[1].ttff_ms < results[0].ttff_ms, "{results:?}");
}

#[test]
fn a_run_ends_at_its_time_limit() {
    for transport in ["quic", "ws"] {
        let sweep = format!("transport = \"{transport}\"\nrate_bits_per_s = [100_000]\nrtt_ms = [50]");
        let result = &results_of(&parse("time_limit_s = 2", &sweep))[0];
        assert_eq!(result.ended, "time limit");
        assert_eq!((result.settled_ms, result.ttq_ms["1"]), (None, None));
        // 2 s at 100 kbit/s.
        assert!(result.total_bytes > 10_000 && result.total_bytes <= 25_000, "{result:?}");
    }
}

#[test]
fn a_dead_link_is_a_result_not_an_error() {
    let sweep = "transport = \"quic\"\nrate_bits_per_s = [2_000_000]\nrtt_ms = [50]\nloss = [1]";
    let result = &results_of(&parse("time_limit_s = 30", sweep))[0];
    assert_eq!((result.ttff_ms, result.total_bytes), (None, 0));
    assert!(!result.ended.is_empty() && result.ended != "settled", "{result:?}");
}

#[test]
fn cameras_move_come_to_rest_and_see_more() {
    let sweep = "transport = \"quic\"\nrate_bits_per_s = 2_000_000\nrtt_ms = 50\n\
                 camera = [\"still\", \"orbit\", \"fly-through\", \"teleport\", \"swing\"]";
    let results = results_of(&parse("", sweep));
    let [still, orbit, fly, teleport, swing] = &results[..] else { panic!("{results:?}") };
    assert_eq!((still.rest_ms, still.rest_ttq_ms.len()), (None, 0));
    for moved in [orbit, fly, teleport, swing] {
        assert_eq!(moved.ended, "settled", "{moved:?}");
        // The first frame is the same for all; later ones show what the start view did not.
        assert_eq!(moved.ttff_ms, still.ttff_ms);
        assert!(moved.total_bytes > still.total_bytes, "{moved}");
        let (rest_ms, settled_ms) = (moved.rest_ms.unwrap(), moved.settled_ms.unwrap());
        assert!(settled_ms >= rest_ms, "{moved}");
        assert!(moved.rest_ttq_ms["1"].unwrap() <= settled_ms - rest_ms, "{moved}");
        assert!(
            moved.rest_ttq_ms["16"] <= moved.rest_ttq_ms["4"]
                && moved.rest_ttq_ms["4"] <= moved.rest_ttq_ms["1"]
        );
    }
    for slow in [orbit, fly, swing] {
        // Twelve seconds from the first frame on, in steps of 20 ms.
        let moved_ms = slow.rest_ms.unwrap() - slow.ttff_ms.unwrap();
        assert!((12_000.0..=12_025.0).contains(&moved_ms), "{slow}");
    }
    assert_eq!(teleport.rest_ms, still.settled_ms);
    // New parts after a jump need at least a round trip.
    assert!(teleport.rest_ttq_ms["1"].unwrap() >= 50.0, "{teleport}");
    // Looking back finds again what was undone meanwhile.
    assert!(swing.usage.cache_hits > 0 && swing.usage.cache_misses == 0, "{swing:?}");
}

#[test]
fn a_series_agrees_with_the_milestones() {
    for result in results_of(&short_plan()) {
        let ms = |sample: &Sample| milliseconds(sample.at_ns);
        assert!(result.series.len() > 10 && result.series.len() <= MAX_SAMPLES);
        assert!(result.series.is_sorted_by(|a, b| a.at_ns < b.at_ns && a.bytes <= b.bytes));
        let (first, last) = (result.ttff_ms.unwrap(), result.series.last().unwrap());
        // The error changes last; settling may be detected slightly later.
        assert!((ms(last)..ms(last) + 16.0).contains(&result.settled_ms.unwrap()), "{result:?}");
        assert_eq!(last.bytes, result.total_bytes);
        assert!(last.error_px.unwrap() <= 1.0);
        // Before the first frame there is no error; afterwards it reaches the qualities at their times.
        assert!(
            result.series.iter().all(|sample| sample.error_px.is_some() == (ms(sample) >= first)),
            "{result:?}"
        );
        type Error = fn(&Sample) -> Option<f64>;
        let errors: [(Error, _); 2] =
            [(|s| s.error_px, &result.ttq_ms), (|s| s.unoccluded_error_px, &result.unoccluded_ttq_ms)];
        for (error_px, times) in errors {
            for (px, at) in [(16.0, "16"), (4.0, "4"), (1.0, "1")] {
                let reached = result.series.iter().find(|s| error_px(s).is_some_and(|e| e <= px)).unwrap();
                // A sample is the last of its interval, which is at most 16 ms for a run below two seconds.
                let late = ms(reached) - times[at].unwrap();
                assert!((0.0..=16.0).contains(&late), "{px} px: {late} ms: {result:?}");
            }
        }
        // Visible parts are a subset of the parts in view.
        assert!(
            result.series.iter().all(|sample| sample.unoccluded_error_px <= sample.error_px),
            "{result:?}"
        );
    }
}

#[test]
fn the_push_contains_only_blobs_that_the_client_would_request() {
    let sweep = "transport = [\"quic\", \"ws\"]\nrate_bits_per_s = 16_000_000\nrtt_ms = 300";
    let at = |px: &str| results_of(&parse(&format!("ttq_px = [{px}]"), sweep));
    for (coarse, sharp) in at("16").iter().zip(&at("1")) {
        assert!(coarse.usage.chunk_bytes < sharp.usage.chunk_bytes, "{coarse:?}\n{sharp:?}");
        for run in [coarse, sharp] {
            let Use { chunk_bytes, wasted_bytes, finer_bytes, repeated_bytes, .. } = run.usage;
            assert!(wasted_bytes + finer_bytes + repeated_bytes <= chunk_bytes, "{run:?}");
            // A settled picture draws all that its camera requested, and nothing else.
            assert_eq!(run.usage.undrawn_bytes, wasted_bytes + finer_bytes, "{run:?}");
            assert!(chunk_bytes < run.total_bytes, "{run:?}");
        }
        // The view that the server assumes until it receives another is this one, apart from the picture's size.
        let Use { wasted_bytes, finer_bytes, repeated_bytes, .. } = sharp.usage;
        assert_eq!((wasted_bytes, finer_bytes, repeated_bytes), (0, 0, 0), "{sharp:?}");
    }
}

/// The first refinement follows the base meshes within TCP's first segments, and more a round trip later: the server
/// waits neither for the client's view nor for its first requests.
#[test]
fn over_websocket_refinement_begins_with_the_first_frame() {
    let sweep = "transport = \"ws\"\nrate_bits_per_s = 16_000_000\nrtt_ms = [50, 200]";
    for run in results_of(&parse("", sweep)) {
        let first = run.ttff_ms.unwrap();
        let error_after = |ms: f64| {
            let until = run.series.iter().take_while(|s| s.at_ns as f64 * 1e-6 <= first + ms);
            until.filter_map(|s| s.error_px).last().unwrap()
        };
        assert!(error_after(run.rtt_ms * 0.6) < error_after(0.0), "{run:?}");
        assert!(run.ttq_ms["16"].unwrap() - first < run.rtt_ms + 20.0, "{run:?}");
        assert!(run.ttq_ms["1"].unwrap() - first < run.rtt_ms * 2.2 + 30.0, "{run:?}");
    }
}

#[test]
fn a_client_that_decodes_slowly_is_as_late_as_that_takes_and_no_later() {
    let sweep = "transport = [\"quic\", \"ws\"]\nrate_bits_per_s = 16_000_000\nrtt_ms = 20\ncamera = [\"still\", \"orbit\"]";
    let with = |client: &str| results_of(&parse(client, sweep));
    let free = with("");
    // So fast that a blob takes less than a nanosecond.
    let fast = with("[client]\nsplits_per_s = 1e12\n");
    for (free, fast) in free.iter().zip(&fast) {
        let (free, fast) = (free.settled_ms.unwrap(), fast.settled_ms.unwrap());
        assert!((free - fast).abs() <= 0.02 * free, "{free} and {fast} ms");
    }
    let slow = with("[client]\nsplits_per_s = 20_000\n");
    for (free, slow) in free.iter().zip(&slow) {
        // Two faces per split.
        let computing_ms = slow.applied_faces.unwrap() as f64 / 2.0 / 20.0;
        let (free_ms, slow_ms) = (free.settled_ms.unwrap(), slow.settled_ms.unwrap());
        assert!(slow_ms >= computing_ms && slow_ms > free_ms, "{slow_ms} ms, {free_ms} and {computing_ms}");
        let late = free_ms + computing_ms / 2.0..free_ms + 1.5 * computing_ms;
        assert!(slow.camera != "still" || late.contains(&slow_ms), "{slow_ms} ms, not {late:?}");
        assert!(slow.ttff_ms >= free.ttff_ms);
    }
    assert_eq!(slow, with("[client]\nsplits_per_s = 20_000\n"), "it repeats to the bit");
}
