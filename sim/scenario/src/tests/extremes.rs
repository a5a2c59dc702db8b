//! Tests of extreme links: each run ends with a result, or with the reason why there is none.

use std::path::Path;
use std::sync::mpsc::sync_channel;
use std::time::Duration;

use crate::plan::{self, Plan, SceneChoice};
use crate::result::RunResult;
use crate::testing::small_scene;
use crate::{parallel, scene};

/// Real time that such a plan may take: far more than it needs.
const TIMEOUT: Duration = Duration::from_secs(120);

/// Runs a plan on another thread, so that a plan that never ends fails instead of hanging.
fn results(plan: Plan) -> Vec<RunResult> {
    let (sender, receiver) = sync_channel(1);
    std::thread::spawn(move || {
        let open = |scene: &plan::PlanScene| match scene.choice {
            SceneChoice::Empty => scene::open(&SceneChoice::Empty, None, Path::new(""), true).unwrap(),
            _ => small_scene(),
        };
        let scenes: Vec<_> = plan.scenes.iter().map(open).collect();
        let threads = std::thread::available_parallelism().unwrap();
        let _ = sender.send(parallel::run(&plan, &scenes, threads, |_| {}));
    });
    receiver.recv_timeout(TIMEOUT).expect("the run hangs, or panicked").unwrap()
}

fn run(sweep: &str) -> Vec<RunResult> {
    let text = format!(
        "scene = \"demo-small\"\nviewport_px = [640, 360]\ntime_limit_s = 3600\n[[sweep]]\n{sweep}\n"
    );
    results(plan::parse(&text, Path::new("extreme.toml")).unwrap())
}

fn assert_settled(result: &RunResult) {
    assert_eq!(result.ended, "settled", "{result}");
    assert!(result.ttq_ms.values().all(Option::is_some), "{result}");
}

#[test]
fn at_one_kilobit_per_second_a_session_ends_with_a_reason() {
    let both = run("transport = [\"quic\", \"ws\"]\nrate_bits_per_s = 1_000\nrtt_ms = 50");
    // QUIC's handshake needs packets of 1,200 bytes, 9.8 s each, and the connection is silent for more than 10 s.
    assert_eq!((both[0].ended.as_str(), both[0].ttff_ms), ("no connection: timed out", None));
    // Over TCP the server's data arrive, but its first blobs take longer than the client waits for a message.
    assert_eq!((both[1].ended.as_str(), both[1].ttff_ms), ("nothing heard for 20 s", None));
    assert!(both[1].total_bytes > 0, "{}", both[1]);
}

#[test]
fn at_sixteen_kilobits_per_second_everything_arrives() {
    for result in run("transport = [\"quic\", \"ws\"]\nrate_bits_per_s = 16_000\nrtt_ms = 50") {
        assert_settled(&result);
        let least_ms = result.total_bytes as f64 * 8e3 / 16e3;
        assert!((least_ms..least_ms * 1.25).contains(&result.settled_ms.unwrap()), "{result}: {least_ms}");
    }
}

#[test]
fn at_ten_gigabits_per_second_only_round_trips_and_timers_count() {
    for result in run("transport = [\"quic\", \"ws\"]\nrate_bits_per_s = 10_000_000_000\nrtt_ms = [0, 50]") {
        assert_settled(&result);
        let most_ms = 100.0 + 8.0 * result.rtt_ms;
        assert!(result.settled_ms.unwrap() <= most_ms, "{result}");
    }
}

#[test]
fn with_three_seconds_of_delay_each_way_a_picture_comes_after_a_few_round_trips() {
    for result in run("transport = [\"quic\", \"ws\"]\nrate_bits_per_s = 2_000_000\nrtt_ms = 6_000") {
        assert_settled(&result);
        assert!((12_000.0..=18_100.0).contains(&result.ttff_ms.unwrap()), "{result}");
        assert!(result.settled_ms.unwrap() <= 36_100.0, "{result}");
        // Every wait for an answer counts as a stall.
        assert!(result.stalls > 0 && result.stalled_ms >= 2_000.0, "{result:?}");
    }
}

#[test]
fn thirty_percent_of_loss_slows_most_sessions_and_ends_some() {
    let loss = ["loss = 0.3", "burst_loss = [{ to_bad = 0.15, to_good = 0.35 }]"];
    for (loss, least_settled) in loss.into_iter().zip([25, 18]) {
        let sweep =
            format!("transport = \"quic\"\nrate_bits_per_s = 2_000_000\nrtt_ms = 50\n{loss}\nseeds = 30");
        let results = run(&sweep);
        let settled = results.iter().filter(|result| result.ended == "settled").count();
        assert!(settled >= least_settled && results.len() == 30, "{settled} settled with {loss}");
        for result in &results {
            assert!(
                (result.loss - 0.3).abs() < 1e-9 && result.packets_lost + result.packets_lost_up > 0,
                "{result:?}"
            );
            // The others report why the connection was lost; none lasts until the time limit of an hour.
            let said =
                ["settled", "does not answer", "timed out", "closed", "reset by peer", "nothing heard"];
            assert!(said.iter().any(|said| result.ended.contains(said)), "{result}");
            assert!(result.ended_ms.unwrap() < 60_000.0, "{result}");
        }
    }
}

#[test]
fn a_queue_of_one_packet_slows_a_session_and_does_not_end_it() {
    let both =
        run("transport = [\"quic\", \"ws\"]\nrate_bits_per_s = 2_000_000\nrtt_ms = 50\nqueue_bytes = 1_500");
    for result in &both {
        assert_settled(result);
    }
    // QUIC detects the full queue by losing packets; the TCP model waits for it.
    assert!(both[0].packets_dropped > 10 && both[1].packets_dropped == 0, "{both:?}");
}

#[test]
fn a_scene_without_anything_is_complete_at_once() {
    let both =
        run("transport = [\"quic\", \"ws\"]\nscene = \"empty\"\nrate_bits_per_s = 2_000_000\nrtt_ms = 50");
    for result in &both {
        assert_settled(result);
        assert_eq!((result.ttff_ms, result.settled_ms), (result.ttq_ms["1"], result.ttff_ms), "{result}");
        // Two round trips of handshake and Hello, some small packets, and timers.
        assert!((50.0..=115.0).contains(&result.settled_ms.unwrap()), "{result}");
        assert_eq!((result.usage.chunk_bytes, result.scene.as_str()), (0, "empty"));
    }
}

#[test]
fn a_link_that_dies_in_the_middle_ends_the_run_by_silence() {
    let dying = "scene = \"demo-small\"\nviewport_px = [640, 360]\ntime_limit_s = 3600\n[link.dying]\n\
                 down = { rate_steps = [{ from_s = 0, bits_per_s = 500_000 }, { from_s = 0.6, bits_per_s = 0 }, \
                 { from_s = 900_000, bits_per_s = 1 }], delay_ms = 25 }\n\
                 [[sweep]]\ntransport = [\"quic\", \"ws\"]\nlink = \"dying\"\n";
    let both = results(plan::parse(dying, Path::new("extreme.toml")).unwrap());
    assert_eq!(both[0].ended, "the server does not answer", "{}", both[0]);
    assert_eq!(both[1].ended, "nothing heard for 20 s", "{}", both[1]);
    for result in &both {
        assert!(result.ttff_ms.is_some() && result.settled_ms.is_none(), "{result}");
        assert!(result.total_bytes as f64 <= 500_000.0 / 8.0, "{result}");
        // Ten and twenty seconds after the link died, plus the time of the last messages.
        assert!(result.ended_ms.unwrap() <= 25_000.0, "{result:?}");
        // The wait for missing blobs is the stall.
        assert!(result.stalls == 1 && result.stalled_ms >= 9_000.0, "{result:?}");
    }
}

#[test]
fn a_time_limit_holds_if_the_close_message_cannot_be_sent() {
    // The client's messages take minutes on the way back, so it cannot announce that it leaves.
    let sweep = "transport = \"ws\"\nrate_bits_per_s = 2_000_000\nrtt_ms = 50\ntime_limit_s = 5\n\
                 up = { rate_steps = [{ from_s = 0, bits_per_s = 100_000 }, { from_s = 0.15, bits_per_s = 20 }] }";
    let result = &run(sweep)[0];
    assert_eq!((result.ended.as_str(), result.settled_ms), ("time limit", None), "{result}");
    assert!((5_000.0..=10_000.0).contains(&result.ended_ms.unwrap()), "{result:?}");
}

#[test]
fn a_server_that_never_answers_is_given_up_at_the_time_limit() {
    // TCP's handshake completes after 51 ms; the answer to the WebSocket upgrade never arrives.
    let mute = "scene = \"empty\"\ntime_limit_s = 5\n[link.mute]\n\
                down = { rate_steps = [{ from_s = 0, bits_per_s = 2_000_000 }, { from_s = 0.06, bits_per_s = 0 }, \
                { from_s = 900_000, bits_per_s = 1 }], delay_ms = 25 }\n\
                [[sweep]]\ntransport = \"ws\"\nlink = \"mute\"\n";
    let result = &results(plan::parse(mute, Path::new("extreme.toml")).unwrap())[0];
    assert!(result.ended.contains("gave no answer to the WebSocket request"), "{result}");
    // The plan's limit applies to opening; then the run waits for the last messages.
    assert!((5_000.0..=10_000.0).contains(&result.ended_ms.unwrap()), "{result:?}");
}

#[test]
fn the_shipped_plan_has_every_extreme_and_every_run_of_it_ends() {
    let plan = plan::read(&Path::new(env!("CARGO_MANIFEST_DIR")).join("../plans/extremes.toml")).unwrap();
    let any = |what: &dyn Fn(&plan::Case) -> bool| plan.cases.iter().any(what);
    assert!(any(&|case| case.link.down.rate.first() == 1_000));
    assert!(any(&|case| case.link.down.rate.first() == 10_000_000_000));
    assert!(any(&|case| case.link.down.delay_ns == 3_000_000_000 && case.link.up.delay_ns == 3_000_000_000));
    assert!(any(&|case| (case.link.down.loss.long_run() - 0.3).abs() < 1e-9 && case.seeds.len() >= 30));
    assert!(any(&|case| case.link.down.queue_bytes == 1_500));
    assert!(any(&|case| plan.scenes[case.scene].choice == SceneChoice::Empty));
    let runs = plan.runs();
    let results = results(plan);
    assert_eq!(results.len(), runs);
    for result in &results {
        assert!(!result.ended.is_empty() && result.ended_ms.unwrap() <= 3_661_000.0, "{result:?}");
    }
}
