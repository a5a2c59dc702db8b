//! Measures a tab over links in real time, for docs/browser.md. Not run with the tests:
//!
//! ```sh
//! cargo test -p lodestream-tests --lib browser::figures -- --ignored --nocapture
//! ```

use std::time::Duration;

use lodestream_daemon::{Page, PageSetting, SessionSettings};
use lodestream_scenario::plan::SceneChoice;
use lodestream_scenario::relay::{RelayLink, relay};
use tokio::net::TcpListener;

use super::checks::{in_a_worker, packs_below};
use super::devtools::WEBGPU_AND_WEBGL;
use super::page::STATS;
use super::{built_page, tab_with};
use crate::support::daemon::Server;
use crate::support::viewer::{Viewer, config};

/// Runs of each case.
const RUNS: usize = 5;

/// A relay to the server's HTTP port; it runs until the runtime ends.
fn linked(runtime: &tokio::runtime::Runtime, server: &Server, rate_bits_per_s: u64) -> std::net::SocketAddr {
    let listener = runtime.block_on(TcpListener::bind("127.0.0.1:0")).unwrap();
    let address = listener.local_addr().unwrap();
    let link = RelayLink { rate_bits_per_s, round_trip: Duration::from_millis(50), queue_bytes: 65_536 };
    runtime.spawn(relay(listener, server.http_address(), link));
    address
}

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values[values.len() / 2]
}

#[test]
#[ignore = "measures for minutes"]
fn times_over_links() {
    let folder = tempfile::tempdir().unwrap();
    let scene = lodestream_scenario::scene::open(&SceneChoice::Demo, None, folder.path(), true).unwrap();
    let page = PageSetting::Loaded(Page::load(&built_page()).unwrap());
    let server = Server::start_with(scene, SessionSettings::default(), |options| options.page = page);
    let runtime = tokio::runtime::Builder::new_multi_thread().worker_threads(1).enable_all().build().unwrap();
    for rate in [2_000_000, 16_000_000] {
        let at = linked(&runtime, &server, rate);
        // Medians of: preview, drawable and shown since navigation, drawable since connect; cold, then with a warm cache.
        for warm in [false, true] {
            let mut figures: [Vec<f64>; 4] = Default::default();
            for _ in 0..RUNS {
                // A fresh browser has an empty cache.
                let Some(mut tab) = tab_with([800, 450], WEBGPU_AND_WEBGL) else { return };
                let url = format!("http://{at}/#transport=ws");
                for visit in 0..=usize::from(warm) {
                    tab.navigate("about:blank");
                    tab.navigate(&url);
                    let shown = |stats: &serde_json::Value| stats["ttff_presented_ms"].is_f64();
                    let stats = tab.wait("the first picture", STATS, shown);
                    if visit == usize::from(warm) {
                        let names = [
                            "preview_ms",
                            "ttff_since_navigation_ms",
                            "ttff_presented_since_navigation_ms",
                            "ttff_ms",
                        ];
                        for (list, name) in figures.iter_mut().zip(names) {
                            list.push(stats[name].as_f64().unwrap());
                        }
                    }
                }
            }
            let [preview, drawable, shown, connected] = figures.map(median);
            println!(
                "{} Mbit/s, {}: preview {preview:.0} ms, drawable {drawable:.0} ms, shown {shown:.0} ms after navigation; drawable \
                 {connected:.0} ms after connect",
                rate / 1_000_000,
                if warm { "warm" } else { "cold" }
            );
        }
        let native = (0..RUNS).map(|_| {
            let address = format!("ws://{at}/").parse().unwrap();
            let mut viewer = Viewer::start(&address, config());
            let first = viewer.wait("a first frame", |status| status.stats.milestones.first_frame.is_some());
            first.stats.milestones.first_frame.unwrap().after.as_secs_f64() * 1e3
        });
        println!(
            "{} Mbit/s, native: drawable {:.0} ms after connect",
            rate / 1_000_000,
            median(native.collect())
        );
    }
}

/// Rounds of each pack; the fastest counts, since other programs only add to a time.
const ROUNDS: u32 = 7;

#[test]
#[ignore = "compiles the decoders with --release, and measures for a minute"]
fn decoding_in_a_worker() {
    let folder = tempfile::tempdir().unwrap();
    lodestream_scenario::scene::open(&SceneChoice::Demo, None, folder.path(), true).unwrap();
    let packs = packs_below(folder.path());
    let Some(found) = in_a_worker(&packs, ROUNDS, None) else { return };
    let fastest = |times: &mut dyn Iterator<Item = f64>| times.fold(f64::INFINITY, f64::min);
    let results = found["packs"].as_array().unwrap();
    let chunks: u64 = results.iter().map(|pack| pack["chunks"].as_u64().unwrap()).sum();
    let times = |pack: &serde_json::Value| {
        fastest(&mut pack["times"].as_array().unwrap().iter().map(|time| time.as_f64().unwrap()))
    };
    let worker_ms: f64 = results.iter().map(times).sum();

    let mut command = std::process::Command::new(env!("CARGO"));
    command.current_dir(concat!(env!("CARGO_MANIFEST_DIR"), "/.."));
    command.args([
        "run",
        "--quiet",
        "--release",
        "--locked",
        "-p",
        "lodestream-web",
        "--no-default-features",
    ]);
    command.args(["--features", "checks", "--example", "decode_rate", "--", &ROUNDS.to_string()]);
    for (number, pack) in packs.iter().enumerate() {
        let path = folder.path().join(format!("{number}.lsp"));
        std::fs::write(&path, pack).unwrap();
        command.arg(path);
    }
    let output = command.output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let text = String::from_utf8(output.stdout).unwrap();
    let lines: Vec<&str> = text.lines().collect();
    assert_eq!(lines.len(), packs.len(), "{text}");
    let native = |line: &&str| fastest(&mut line.split(' ').map(|time| time.parse().unwrap()));
    let native_ms: f64 = lines.iter().map(native).sum();
    let rate = |ms: f64| chunks as f64 / ms * 1e3;
    println!(
        "{chunks} chunks: {:.0} a second in a worker, {:.0} natively: {:.2} of it",
        rate(worker_ms),
        rate(native_ms),
        native_ms / worker_ms
    );
}
