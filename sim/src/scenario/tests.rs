//! Whole runs over the small demo scene.

use std::path::Path;
use std::sync::{Arc, OnceLock};

use lodestream_protocol::source::SceneSource;

use super::plan::{self, Plan, SceneChoice, Transport};
use super::report::{RunResult, to_json};
use super::{run, scene};

/// The small demo scene, prepared once for all tests.
pub(super) fn small_scene() -> Arc<dyn SceneSource> {
    static SCENE: OnceLock<Arc<dyn SceneSource>> = OnceLock::new();
    let open = || {
        let cache = tempfile::tempdir().unwrap();
        // Packs stay open, so the folder may go.
        let opened: Arc<dyn SceneSource> = scene::open(&SceneChoice::DemoSmall, cache.path(), true).unwrap();
        opened
    };
    Arc::clone(SCENE.get_or_init(open))
}

fn results(plan: &Plan, seed: u64) -> Vec<RunResult> {
    run(plan, &small_scene(), seed, |_| {}).unwrap()
}

fn parse(head: &str, sweep: &str) -> Plan {
    let text = format!("scene = \"demo-small\"\nviewport_px = [640, 360]\n{head}\n[[sweep]]\n{sweep}");
    plan::parse(&text, Path::new("test.toml")).unwrap()
}

fn short_plan() -> Plan {
    plan::read(&Path::new(env!("CARGO_MANIFEST_DIR")).join("plans/short.toml")).unwrap()
}

#[test]
fn the_same_seed_gives_the_same_bytes_of_report() {
    let plan = short_plan();
    let first = to_json(&results(&plan, 3)).unwrap();
    assert_eq!(first, to_json(&results(&plan, 3)).unwrap());
    let other = to_json(&results(&plan, 4)).unwrap();
    assert_ne!(first, other);
}

#[test]
fn results_are_possible_and_in_order() {
    let results = results(&short_plan(), 1);
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
        // No byte can be here before a round trip and its own time on the link are over.
        for (time, bytes) in times.iter().zip(bytes) {
            let least_ms = result.rtt_ms + bytes.unwrap() as f64 * 8e3 / result.rate_bits_per_s as f64;
            assert!(time.unwrap() >= least_ms, "{result:?}: {least_ms}");
        }
        // And the first frame should not be long after that: one more round trip, some timers.
        let soon_ms = 2.0 * result.rtt_ms
            + result.first_frame_bytes.unwrap() as f64 * 8e3 / result.rate_bits_per_s as f64;
        assert!(result.ttff_ms.unwrap() <= soon_ms + 20.0, "{result:?}: {soon_ms}");
        assert_eq!(result.packets_lost > 0, result.loss > 0.0, "{result:?}");
    }
}

#[test]
fn a_faster_link_shows_the_same_scene_sooner() {
    let sweep = "transport = \"quic\"\nrate_bits_per_s = [1_000_000, 16_000_000]\nrtt_ms = [50]";
    let results = results(&parse("", sweep), 1);
    assert!(results[1].settled_ms < results[0].settled_ms, "{results:?}");
    assert!(results[1].ttff_ms < results[0].ttff_ms, "{results:?}");
}

#[test]
fn a_run_ends_at_its_time_limit() {
    for transport in ["quic", "ws"] {
        let sweep = format!("transport = \"{transport}\"\nrate_bits_per_s = [100_000]\nrtt_ms = [50]");
        let result = &results(&parse("time_limit_s = 2", &sweep), 1)[0];
        assert_eq!(result.ended, "time limit");
        assert_eq!((result.settled_ms, result.ttq_ms["1"]), (None, None));
        // 2 s at 100 kbit/s.
        assert!(result.total_bytes > 10_000 && result.total_bytes <= 25_000, "{result:?}");
    }
}

#[test]
fn a_dead_link_is_a_result_not_an_error() {
    let sweep = "transport = \"quic\"\nrate_bits_per_s = [2_000_000]\nrtt_ms = [50]\nloss = [1]";
    let result = &results(&parse("time_limit_s = 30", sweep), 1)[0];
    assert_eq!((result.ttff_ms, result.total_bytes), (None, 0));
    assert!(!result.ended.is_empty() && result.ended != "settled", "{result:?}");
}
