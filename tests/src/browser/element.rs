//! The npm package's `<lodestream-viewer>` on another page, from a plain static web server.

use lodestream_bake::scene::of_files;
use lodestream_protocol::source::SceneSource as _;
use lodestream_report::image_error::image_error;
use serde_json::{Value, json};

use super::files::Files;
use super::npm::{serve_for, websocket};
use super::{built_package, image, tab};
use crate::parts::write_house;
use crate::static_host::host::Host;
use crate::static_host::published;
use crate::support::PICTURE_PX;
use crate::support::picture::{Picture, draw, headless, keep};
use crate::support::scene::{TestScene, prepare_all};

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

/// Asserts that a text says what is missing, and who has it.
pub(super) fn assert_names_browsers(text: &Value) {
    let text = text.as_str().unwrap_or_default();
    for part in ["WebGPU", "Chrome", "Edge", "Firefox", "Safari", "https"] {
        assert!(text.contains(part), "{part}: {text}");
    }
}

#[test]
fn without_webgpu_the_element_says_so_and_keeps_its_poster() {
    let Some(mut tab) = tab([640, 360]) else { return };
    let scene = TestScene::small();
    let files = Files::start(built_package(), PAGE.to_owned());
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

#[test]
fn the_elements_methods_change_what_is_shown_of_parts() {
    let Some(mut tab) = tab(PICTURE_PX) else { return };
    let folder = tempfile::tempdir().unwrap();
    let scene = of_files(&[write_house(folder.path())]).unwrap();
    let scene = TestScene::open(&scene, prepare_all(&scene, &folder.path().join("cache")));
    let batch = scene.asset("house/parts");
    let page = scene.store.page(0).unwrap();
    let instance = page.instances.iter().position(|instance| instance.asset == batch).unwrap();
    let files = Files::start(built_package(), PAGE.to_owned());
    let server = serve_for(&scene, &files);
    tab.navigate(&format!("{}/page.html", files.origin()));
    tab.wait("the page", "typeof viewer", |kind| kind == "object");
    let nothing = "viewer.pick(1, 1).then((found) => [found, viewer.stats()])";
    assert_eq!(tab.evaluate(nothing), json!([null, null]), "without a session");
    // Part 7 is in the middle, 6 and 8 are beside it.
    tab.evaluate("void viewer.setAttribute('camera', 'eye=21.3,0.3,7;target=21.3,0.3,0;up=0,1,0;fov=50')");
    tab.evaluate(&format!("void viewer.setAttribute('src', '{}')", websocket(&server)));
    tab.wait("the element settles", "viewer.stats() ?? {}", |stats| stats["settled"] == true);
    for technique in ["occlusion", "shadows", "smoothing"] {
        tab.evaluate(&format!("void viewer.switch('{technique}', false)"));
    }
    let differing = |tab: &mut super::Tab, whole: &::image::RgbaImage| {
        let shown = image(tab, "viewer.picture()");
        let pixels = whole.pixels().zip(shown.pixels());
        pixels.filter(|(a, b)| (0..3).any(|i| a.0[i].abs_diff(b.0[i]) > 3)).count()
    };
    let whole = image(&mut tab, "viewer.picture()");
    let found = tab.evaluate("viewer.pick(320, 180)");
    assert_eq!((&found["instance"], &found["part"]), (&json!(instance), &json!(7)), "{found}");
    assert!(found["distance"].as_f64().is_some_and(|far| far > 5.0 && far < 7.0), "{found}");
    let moved = "[1,0,0,0, 0,1,0,0, 0,0,1,0, 0,0.5,0,1]";
    let mut changed = Vec::new();
    for (change, undo) in [
        ("hide(I, 7)", "hide(I, 7, false)"),
        ("tint(I, 7, '#00ff00')", "tint(I, 7, null)"),
        ("tint(I, 7, '#00ff00', 0.2)", "showAll()"),
        (&format!("move(I, 7, {moved})"), "move(I, 7, null)"),
        ("isolate([{ instance: I, part: 7 }])", "isolate(null)"),
        ("hide(I, 7)", "showAll()"),
    ] {
        let call = |what: &str| format!("void viewer.{}", what.replace('I', &instance.to_string()));
        tab.evaluate(&call(change));
        let count = differing(&mut tab, &whole);
        assert!(count > 300, "{change}: {count}");
        changed.push(count);
        tab.evaluate(&call(undo));
        assert_eq!(differing(&mut tab, &whole), 0, "{undo} after {change}");
    }
    assert!(changed[4] > changed[0], "the others are gone: {changed:?}");
    let refused = tab.evaluate(&format!(
        "(() => {{ try {{ viewer.tint({instance}, 7, 'green'); }} catch (why) {{ return why.message; }} }})()"
    ));
    assert!(refused.as_str().is_some_and(|why| why.contains("#rrggbb")), "{refused}");
    let target = tab.evaluate("viewer.view.target");
    assert_eq!(tab.evaluate(&format!("viewer.fit({instance}, 9)")), true);
    tab.wait("the camera moves to the part", "viewer.view.target", |now| *now != target);
    assert_eq!(tab.evaluate("viewer.fit(999, 0)"), false);
    assert_eq!(tab.evaluate("events.filter((type) => type.startsWith('error'))"), json!([]));
    assert_eq!(tab.console, Vec::<String>::new());
    server.assert_healthy();
}

#[test]
fn the_element_shows_a_published_scene_and_says_what_is_wrong_with_one() {
    let Some(mut tab) = tab([64, 36]) else { return };
    let files = Files::start(built_package(), PAGE.to_owned());
    let host = Host::start(published());
    tab.navigate(&format!("{}/page.html", files.origin()));
    tab.wait("the page", "typeof viewer", |kind| kind == "object");
    tab.evaluate(&format!("void viewer.setAttribute('src', '{}')", host.url("small.lss")));
    let stats = tab.wait("the element settles", "viewer.stats() ?? {}", |stats| stats["settled"] == true);
    assert_eq!((&stats["transport"], &stats["lacking_blobs"]), (&json!("http"), &json!(0)), "{stats}");
    tab.evaluate(&format!("void viewer.setAttribute('src', '{}')", host.url("missing.lss")));
    let error = "events.find((type) => type.startsWith('error')) ?? null";
    let error = tab.wait("an error", error, Value::is_string);
    assert!(error.as_str().unwrap().contains("the published scene: it is not there (status 404)"), "{error}");
}
