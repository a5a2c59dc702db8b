//! The npm package's `<lodestream-viewer>` on another page, from a plain static web server.

use lodestream_report::image_error::image_error;
use serde_json::{Value, json};

use super::files::Files;
use super::npm::{serve_for, websocket};
use super::{built_package, image, tab};
use crate::support::PICTURE_PX;
use crate::support::picture::{Picture, draw, headless, keep};
use crate::support::scene::TestScene;

/// As of the daemon's own page.
const MAX_FLIP: f64 = 0.05;

const PAGE: &str = r#"<!doctype html>
<style>body { margin: 0 } lodestream-viewer { width: 640px; height: 360px }</style>
<script type="module">
  import './index.js';
  window.events = [];
  const viewer = document.querySelector('lodestream-viewer');
  for (const type of ['firstframe', 'settled', 'error']) {
    viewer.addEventListener(type, ({ detail }) => events.push(type === 'error' ? `error: ${detail}` : type));
  }
  window.viewer = viewer;
</script>
<lodestream-viewer><p>poster</p></lodestream-viewer>"#;

#[test]
fn the_element_shows_what_the_native_viewer_shows() {
    let (Some(mut tab), Some(mut headless)) = (tab(PICTURE_PX), headless()) else { return };
    let scene = TestScene::small();
    let files = Files::start(built_package(), PAGE.to_owned());
    let server = serve_for(scene, &files);
    tab.navigate(&format!("{}/page.html", files.origin()));
    tab.wait("the page", "typeof viewer", |kind| kind == "object");
    tab.evaluate(&format!("void viewer.setAttribute('src', '{}')", websocket(&server)));
    let stats = tab.wait("the element settles", "viewer.stats() ?? {}", |stats| stats["settled"] == true);
    assert_eq!(stats["decode_failures"], 0, "{stats}");
    tab.wait("its events", "events", |events| *events == json!(["firstframe", "settled"]));
    let native = draw(&mut headless, scene.whole());
    let image = image(&mut tab, "viewer.picture()");
    assert_eq!(image.dimensions(), native.image.dimensions());
    let shown = Picture { image, covered: native.covered.clone() };
    keep(&shown, "element");
    let flip = image_error(&shown.image, &native.image).unwrap().flip;
    println!("FLIP {flip}, {stats}");
    assert!(flip <= MAX_FLIP, "{flip}: {stats}");

    let eye = tab.evaluate(
        "(() => { const view = viewer.view; view.eye = view.eye.map((x, axis) => (x + view.target[axis]) / 2);
            viewer.setView(view); return [view.eye, viewer.view.eye]; })()",
    );
    let near = |a: &Value, b: &Value| (a.as_f64().unwrap() - b.as_f64().unwrap()).abs();
    for axis in 0..3 {
        assert!(near(&eye[0][axis], &eye[1][axis]) < 1e-6, "{eye}");
    }
    tab.wait("it settles nearer", "events.filter((type) => type === 'settled').length", |count| {
        count.as_u64().is_some_and(|count| count >= 2)
    });
    server.wait_for_sessions(1);
    tab.evaluate("viewer.remove()");
    server.wait_for_sessions(0);
    assert_eq!(tab.evaluate("[viewer.stats(), viewer.view]"), json!([null, null]));
    assert_eq!(tab.evaluate("events.filter((type) => type.startsWith('error'))"), json!([]));
    assert_eq!(tab.console, Vec::<String>::new());
    server.assert_healthy();
}

#[test]
fn an_address_that_is_none_is_an_error_event() {
    let Some(mut tab) = tab([64, 64]) else { return };
    let files = Files::start(built_package(), PAGE.to_owned());
    tab.navigate(&format!("{}/page.html", files.origin()));
    tab.wait("the page", "typeof viewer", |kind| kind == "object");
    tab.evaluate("void viewer.setAttribute('src', 'ftp://nowhere/')");
    let events = tab.wait("an error", "events", |events| events.as_array().is_some_and(|e| !e.is_empty()));
    assert!(events[0].as_str().unwrap().contains("ws://HOST:PORT/SCENE"), "{events}");
}

#[test]
fn without_webgpu_the_element_says_so_and_keeps_its_poster() {
    let Some(mut tab) = tab([640, 360]) else { return };
    let scene = TestScene::small();
    let files = Files::start(built_package(), PAGE.to_owned());
/// Asserts that a text says what is missing, and who has it.
pub(super) fn assert_names_browsers(text: &Value) {
    let text = text.as_str().unwrap_or_default();
    for part in ["WebGPU", "Chrome", "Edge", "Firefox", "Safari", "https"] {
        assert!(text.contains(part), "{part}: {text}");
    }
}

    let server = serve_for(scene, &files);
    tab.navigate(&format!("{}/page.html", files.origin()));
    tab.wait("the page", "typeof viewer", |kind| kind == "object");
    tab.evaluate("void Object.defineProperty(navigator, 'gpu', { value: undefined })");
    tab.evaluate(&format!("void viewer.setAttribute('src', '{}')", websocket(&server)));
    let events = tab.wait("an error", "events", |events| events.as_array().is_some_and(|e| !e.is_empty()));
    assert_names_browsers(&events[0]);
    let poster = "[viewer.hasAttribute('shown'), viewer.querySelector('p').checkVisibility()]";
    assert_eq!(tab.evaluate(poster), json!([false, true]));
    server.wait_for_sessions(0);
}

#[test]
fn the_camera_attribute_moves_the_camera() {
    let Some(mut tab) = tab([64, 36]) else { return };
    let scene = TestScene::small();
    let files = Files::start(built_package(), PAGE.to_owned());
    let server = serve_for(scene, &files);
    tab.navigate(&format!("{}/page.html", files.origin()));
    tab.wait("the page", "typeof viewer", |kind| kind == "object");
    let camera = |tab: &mut super::Tab, x: f64| {
        tab.evaluate(&format!("void viewer.setAttribute('camera', 'eye={x},1,5;target=0,0,0;fov=40')"));
    };
    // Before the session begins it is the start, later a move.
    camera(&mut tab, 2.0);
    tab.evaluate(&format!("void viewer.setAttribute('src', '{}')", websocket(&server)));
    let at = |x: f64| move |eye: &Value| eye[0].as_f64().is_some_and(|eye| (eye - x).abs() < 1e-6);
    tab.wait("the start", "viewer.view?.eye ?? []", at(2.0));
    camera(&mut tab, 3.0);
    tab.wait("the move", "viewer.view?.eye ?? []", at(3.0));
    server.assert_healthy();
}
