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
                        let names =
                            ["preview_ms", "ttff_since_navigation_ms", "ttff_presented_ms", "ttff_ms"];
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
