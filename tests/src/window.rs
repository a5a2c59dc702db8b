//! The viewer in a window, as people run it: what is on the screen first, and how it ends.

use std::path::Path;
use std::process::Output;
use std::sync::Arc;
use std::time::{Duration, Instant};

use lodestream_protocol::BlobId;
use lodestream_report::pictures::shown::judge;
use lodestream_server::daemon::SessionSettings;
use serde_json::Value;

use crate::support::LIMIT;
use crate::support::daemon::{Server, Transport};
use crate::support::picture::skipped;
use crate::support::scene::{Lacking, TestScene};
use crate::support::window::Window;

/// Slow, so that there is something between the first frame and the last even where drawing takes long.
const RATE_BITS_PER_S: u64 = 200_000;
/// How long the window waits for a first frame before it shows what is there.
const HELD_BACK_MS: f64 = 2000.0;

fn json(path: &Path) -> Value {
    serde_json::from_str(&std::fs::read_to_string(path).unwrap()).unwrap()
}

/// Exit code and standard error, which holds lines of the program's own alone, without colours.
fn ended(output: &Output) -> (Option<i32>, String) {
    let errors = String::from_utf8(output.stderr.clone()).unwrap();
    for line in errors.lines() {
        let ours = line.starts_with("error: ") || line.contains(" lodestream_");
        assert!(ours && !line.contains('\u{1b}'), "{line:?} is none of ours");
    }
    (output.status.code(), errors)
}

/// The first pictures lacked whole objects, which were being uploaded.
#[test]
fn the_first_frame_on_the_screen_holds_everything_and_no_later_one_lacks_it() {
    if skipped() {
        return;
    }
    let settings = SessionSettings { rate_bits_per_s: Some(RATE_BITS_PER_S), ..SessionSettings::default() };
    let server = Server::start(TestScene::small().source(), settings);
    let folder = tempfile::tempdir().unwrap();
    let (frames, stats) = (folder.path().join("frames"), folder.path().join("stats.json"));
    let window = Window::open(
        &server.url(Transport::Quic),
        &[
            "--no-overlay",
            "--exit-when-settled",
            "--frames",
            frames.to_str().unwrap(),
            "--stats",
            stats.to_str().unwrap(),
        ],
    );
    let (code, errors) = ended(&window.end());
    assert_eq!(code, Some(0), "{errors}");

    let stats = json(&stats);
    assert_eq!(
        (&stats["settled"], &stats["lacking_blobs"]),
        (&Value::from(true), &Value::from(0)),
        "{stats}"
    );
    let ms = |name: &str| stats[name].as_f64().unwrap_or_else(|| panic!("{name}: {stats}"));
    assert!(ms("ttff_ms") <= ms("ttff_presented_ms"), "{stats}");
    assert!(ms("settled_ms") <= ms("settled_presented_ms"), "{stats}");
    // Before everything was there nothing was shown, unless it took longer than anybody is made to wait.
    let shown = stats["frames"].as_array().unwrap();
    let (whole, early): (Vec<&Value>, Vec<&Value>) = shown.iter().partition(|frame| frame["whole"] == true);
    assert!(early.iter().all(|frame| frame["at_ms"].as_f64().unwrap() >= HELD_BACK_MS), "{stats}");
    let instances: Vec<u64> = whole.iter().map(|frame| frame["instances"].as_u64().unwrap()).collect();
    assert!(instances.iter().all(|&n| n == instances[0] && n > 0), "objects come or go: {instances:?}");
    assert_eq!(whole[0]["at_ms"], stats["ttff_presented_ms"]);

    let judged = judge(&frames).unwrap();
    let blank = judged.first_seconds.blank_flip;
    println!("{} frames shown, {judged:?}", shown.len());
    // Coarse, but the same things in the same places.
    assert!(judged.settled && blank > 0.5, "{judged:?}");
    let first = judged.frames.iter().find(|frame| frame.whole);
    assert!(first.is_none_or(|first| first.error.flip < 0.5 * blank), "{judged:?}");
    server.assert_healthy();
}

/// It said settled, with a screen error of 22 pixels.
#[test]
fn a_picture_that_lacks_a_chunk_for_good_is_incomplete_and_the_exit_code_says_so() {
    if skipped() {
        return;
    }
    let scene = TestScene::small();
    let ball = scene.asset("ball");
    let lacking = Lacking { scene: scene.source(), blob: BlobId::chunk(ball, 0) };
    let server = Server::start(Arc::new(lacking), SessionSettings::default());
    let folder = tempfile::tempdir().unwrap();
    let stats = folder.path().join("stats.json");
    let window = Window::open(
        &server.url(Transport::WebSocket),
        &["--exit-when-settled", "--stats", stats.to_str().unwrap()],
    );
    let (code, errors) = ended(&window.end());
    assert_eq!(code, Some(3), "{errors}");
    let missing = format!("asset {ball} chunk 0");
    assert!(errors.contains("incomplete") && errors.contains(&missing), "{errors}");
    let stats = json(&stats);
    assert_eq!(stats["settled"], false);
    assert_eq!(stats["lacking"], Value::from(vec![missing]));
    assert_eq!(stats["settled_presented_ms"], Value::Null);
}

#[cfg(unix)]
#[test]
fn a_viewer_that_is_terminated_writes_its_figures_and_leaves() {
    if skipped() {
        return;
    }
    let server = Server::start(TestScene::small().source(), SessionSettings::default());
    let folder = tempfile::tempdir().unwrap();
    let stats = folder.path().join("stats.json");
    let window = Window::open(&server.url(Transport::Quic), &["--stats", stats.to_str().unwrap()]);
    let until = Instant::now() + LIMIT;
    while !server.metrics().contains("lodestream_sessions{transport=\"quic\"} 1") {
        assert!(Instant::now() < until, "no session: {}", server.metrics());
        std::thread::sleep(Duration::from_millis(20));
    }
    window.terminate();
    let (code, errors) = ended(&window.end());
    assert_eq!(code, Some(128 + 15), "{errors}");
    assert_eq!(json(&stats)["transport"], "quic");
    server.assert_healthy();
}
