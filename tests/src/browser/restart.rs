//! A server that ends and comes again: the tab goes on, and nothing is sent twice.

use lodestream_daemon::{Page, PageSetting, SessionSettings};
use serde_json::Value;

use super::devtools::Tab;
use super::page::{STATS, serve_with, settle};
use super::{built_page, tab};
use crate::support::daemon::Server;
use crate::support::scene::TestScene;

/// The size that the server assumes before it is told: what it pushes early is never too much, so all sessions that
/// show the whole take the same bytes.
const SIZE_PX: [u32; 2] = [1280, 720];
/// Most bytes of a session for a tab that lacks nothing: greetings, the scene's header, pings; measured 560. Header and
/// base meshes are 1,500.
const NOTHING_NEW_BYTES: f64 = 1200.0;
/// Most bytes of the blob that is under way, which comes again from its beginning.
const UNDER_WAY_BYTES: f64 = 3000.0;
/// Bytes that come before the server is killed, of 31,400.
const EARLY_BYTES: f64 = 8000.0;
/// Rate at which the rest would take a minute more.
const SLOW_BITS_PER_S: u64 = 3000;

fn bytes(stats: &Value) -> f64 {
    stats["bytes"].as_f64().unwrap_or_else(|| panic!("bytes: {stats}"))
}

/// Kills a server, starts another in its place, and waits until the tab is settled in its second session.
fn restart(tab: &mut Tab, server: Server, scene: &TestScene) -> (Server, Value) {
    let site = server.kill();
    tab.wait("the loss is told", "lodestream.stats().message", Value::is_string);
    let page = PageSetting::Loaded(Page::load(&built_page()).unwrap());
    let server = Server::start_at_with(site, scene.source(), SessionSettings::default(), |options| {
        options.page = page
    });
    let after = tab.wait("the page connects again", STATS, |stats| {
        stats["connections"].as_f64() == Some(2.0)
            && stats["connection"] == "open"
            && stats["settled"] == true
    });
    (server, after)
}

#[test]
fn a_tab_goes_on_after_the_server_restarts() {
    let Some(mut tab) = tab(SIZE_PX) else { return };
    let scene = TestScene::small();
    for transport in ["ws", "webtransport"] {
        let server = serve_with(scene, SessionSettings::default());
        tab.navigate("about:blank");
        let before = settle(&mut tab, &format!("{}#transport={transport}", server.page_url()));
        let (server, after) = restart(&mut tab, server, scene);
        assert_eq!(after["faces"], before["faces"], "what was refined stays: {after}");
        let frames = |stats: &Value| stats["frame_count"].as_f64();
        assert!(frames(&after) >= frames(&before) && after["devices"] == 1, "it is the same viewer: {after}");
        let more = bytes(&after) - bytes(&before);
        println!("{transport}: {} bytes, {more} after the restart", bytes(&before));
        assert!(more < NOTHING_NEW_BYTES, "{transport}: {more} bytes after the restart: {after}");
        server.assert_healthy();
    }
}

#[test]
fn a_restart_in_mid_stream_costs_no_byte_twice() {
    let Some(mut tab) = tab(SIZE_PX) else { return };
    let scene = TestScene::small();
    for transport in ["ws", "webtransport"] {
        let server = serve_with(scene, SessionSettings::default());
        tab.navigate("about:blank");
        let once = settle(&mut tab, &format!("{}#transport={transport}", server.page_url()));
        let whole = bytes(&once);
        drop(server);

        let slow = SessionSettings { rate_bits_per_s: Some(SLOW_BITS_PER_S), ..SessionSettings::default() };
        let server = serve_with(scene, slow);
        tab.navigate("about:blank");
        tab.navigate(&format!("{}#transport={transport}", server.page_url()));
        let before = tab.wait("a part has come", STATS, |stats| stats["bytes"].as_f64() > Some(EARLY_BYTES));
        assert_eq!(before["settled"], false, "{before}");
        let (server, after) = restart(&mut tab, server, scene);
        println!(
            "{transport}: {whole} bytes in one session, {} of two, {} of them before the restart",
            bytes(&after),
            bytes(&before)
        );
        let most = whole + NOTHING_NEW_BYTES + UNDER_WAY_BYTES;
        assert!(bytes(&after) < most, "{transport}: {whole} bytes in one session: {after}");
        assert_eq!(after["faces"], once["faces"], "{after}");
        assert_eq!([&after["decode_failures"], &after["lacking_blobs"]], [0, 0], "{after}");
        server.assert_healthy();
    }
}
