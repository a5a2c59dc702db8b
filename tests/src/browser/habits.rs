//! What people do with a page: another screen, full screen, another tab in front, keys, fingers, a picture to keep.

use serde_json::{Value, json};

use super::devtools::Tab;
use super::page::{STATS, camera, distance, drag, mouse, moved, press, serve, settle, touch};
use super::{image, tab};
use crate::support::PICTURE_PX;
use crate::support::scene::TestScene;

const CANVAS_PX: &str = "(({ width, height }) => [width, height])(document.getElementById('view'))";

/// Holds a key down, or lets go.
fn key(tab: &mut Tab, kind: &str, code: &str) {
    let number = match code {
        "ArrowLeft" => 37,
        "ArrowUp" => 38,
        "ArrowRight" => 39,
        "ArrowDown" => 40,
        letter => u32::from(letter.as_bytes()[3]),
    };
    let name = code.strip_prefix("Key").map_or_else(|| code.to_owned(), str::to_lowercase);
    let event = json!({ "type": kind, "code": code, "key": name, "windowsVirtualKeyCode": number });
    tab.call("Input.dispatchKeyEvent", event);
}

/// Holds a key until the camera satisfies a condition.
fn held(tab: &mut Tab, code: &str, what: &str, holds: impl Fn(&[f64]) -> bool) -> Vec<f64> {
    key(tab, "keyDown", code);
    moved(tab, &format!("{code} {what}"), holds);
    key(tab, "keyUp", code);
    // What was under way ends with the next frame.
    tab.evaluate("new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))");
    camera(tab)
}

fn near(a: f64, b: f64) -> bool {
    (a - b).abs() < 1e-6 * (1.0 + b.abs())
}

/// Projection of one camera's eye onto another's axis: 0 right, 1 up, 2 forward, from where that one stands.
fn along(from: &[f64], to: &[f64], axis: usize) -> f64 {
    let vector = |at: usize| glam::DVec3::from_slice(&from[at..]);
    let forward = (vector(3) - vector(0)).normalize();
    let right = forward.cross(vector(6)).normalize();
    let axes = [right, right.cross(forward), forward];
    (glam::DVec3::from_slice(to) - vector(0)).dot(axes[axis])
}

#[test]
fn the_canvas_has_the_pixels_of_the_device() {
    let Some(mut tab) = tab([200, 120]) else { return };
    let server = serve(TestScene::small());
    tab.resize([200, 120], 3.0);
    settle(&mut tab, &server.page_url());
    let is = |px: [u32; 2]| move |size: &Value| *size == json!(px);
    tab.wait("three pixels of the device for one of the page", CANVAS_PX, is([600, 360]));
    assert_eq!(image(&mut tab, "lodestream.view.picture()").dimensions(), (600, 360));
    // A zoom that keeps the page's size, or another screen: only the ratio changes.
    tab.resize([200, 120], 2.0);
    tab.wait("another ratio", CANVAS_PX, is([400, 240]));
    tab.resize([200, 120], 1.0);
    tab.wait("another one", CANVAS_PX, is([200, 120]));
    tab.resize([300, 100], 1.0);
    tab.wait("another size", CANVAS_PX, is([300, 100]));
    tab.wait("it settles", STATS, |stats| stats["settled"] == true);
    assert_eq!(image(&mut tab, "lodestream.view.picture()").dimensions(), (300, 100));
    assert_eq!(tab.console, Vec::<String>::new());
    server.assert_healthy();
}

#[test]
fn v_fills_the_screen_where_the_browser_can() {
    let Some(mut tab) = tab(PICTURE_PX) else { return };
    let server = serve(TestScene::small());
    settle(&mut tab, &server.page_url());
    let filled = "Boolean(document.fullscreenElement)";
    press(&mut tab, 'V');
    tab.wait("V fills the screen", filled, |filled| *filled == true);
    press(&mut tab, 'V');
    tab.wait("V leaves it", filled, |filled| *filled == false);
    // Phones have none, and a frame in another page may be refused it.
    for missing in ["Promise.reject(new TypeError('refused'))", "undefined"] {
        let function =
            if missing == "undefined" { "undefined".to_owned() } else { format!("() => {missing}") };
        tab.evaluate(&format!("void (Element.prototype.requestFullscreen = {function})"));
        press(&mut tab, 'V');
    }
    tab.evaluate("new Promise((done) => setTimeout(done))");
    assert_eq!(tab.console, Vec::<String>::new());
    server.assert_healthy();
}

#[test]
fn nothing_is_drawn_while_the_page_is_hidden() {
    let Some(mut tab) = tab(PICTURE_PX) else { return };
    let server = serve(TestScene::small());
    settle(&mut tab, &server.page_url());
    let show = |tab: &mut Tab, hidden: bool| {
        tab.evaluate(&format!(
            "void (Object.defineProperty(document, 'hidden', {{ value: {hidden}, configurable: true }}),
            document.dispatchEvent(new Event('visibilitychange')))"
        ));
    };
    show(&mut tab, true);
    // What was asked for before is drawn; then every attempt is left.
    tab.evaluate("new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))");
    let drawn = tab.evaluate("lodestream.stats().frame_count");
    let frames = tab.evaluate(
        "(async () => {
            for (let times = 0; times < 5; times += 1) {
                lodestream.view.viewer.turn(performance.now(), 20, 0);
                lodestream.view.redraw();
                await new Promise((done) => requestAnimationFrame(done));
            }
            return lodestream.stats().frame_count;
        })()",
    );
    assert_eq!(frames, drawn, "frames of a hidden page");
    show(&mut tab, false);
    let more = |stats: &Value| stats["frame_count"].as_f64() > drawn.as_f64() && stats["settled"] == true;
    tab.wait("it goes on when it is shown again", STATS, more);
    server.assert_healthy();
}

#[test]
fn keys_turn_fly_and_hide_the_overlay() {
    let Some(mut tab) = tab(PICTURE_PX) else { return };
    let server = serve(TestScene::small());
    settle(&mut tab, &server.page_url());
    let start = camera(&mut tab);
    // Arrow keys turn about the target.
    for (code, axis) in [("ArrowLeft", 0), ("ArrowRight", 0), ("ArrowUp", 1), ("ArrowDown", 1)] {
        let before = camera(&mut tab);
        let turned = held(&mut tab, code, "turns", |now| along(&before, now, axis).abs() > 1e-3);
        assert!(
            near(distance(&turned), distance(&before)) && turned[3..6] == before[3..6],
            "{code}: {turned:?}"
        );
    }
    // Each of these moves eye and target along its axis alone.
    for (code, axis, sign) in [
        ("KeyW", 2, 1.0),
        ("KeyS", 2, -1.0),
        ("KeyD", 0, 1.0),
        ("KeyA", 0, -1.0),
        ("KeyE", 1, 1.0),
        ("KeyQ", 1, -1.0),
    ] {
        let before = camera(&mut tab);
        let flown = held(&mut tab, code, "flies", |now| sign * along(&before, now, axis) > 1e-3);
        // Up and down is the world's.
        let straight = if axis == 1 {
            near(flown[0], before[0]) && near(flown[2], before[2])
        } else {
            (0..3).filter(|&other| other != axis).all(|other| along(&before, &flown, other).abs() < 1e-6)
        };
        assert!(straight, "{code}: {flown:?} from {before:?}");
        assert!(near(distance(&flown), distance(&before)), "{code}: the target comes along");
    }
    // F: in flight a drag turns about the eye, in orbit about the target.
    press(&mut tab, 'F');
    let before = camera(&mut tab);
    drag(&mut tab, [300.0, 200.0], [340.0, 200.0]);
    let looked = moved(&mut tab, "a drag in flight looks elsewhere", |now| now[3..6] != before[3..6]);
    assert!((0..3).all(|at| near(looked[at], before[at])), "{looked:?}: the eye stays where it is");
    press(&mut tab, 'F');
    drag(&mut tab, [300.0, 200.0], [340.0, 200.0]);
    let orbited = moved(&mut tab, "a drag in orbit turns", |now| now[..3] != looked[..3]);
    assert!(near(distance(&orbited), distance(&looked)), "{orbited:?}");

    let overlay = "document.getElementById('overlay').checkVisibility()";
    for shown in [false, true] {
        press(&mut tab, 'H');
        assert_eq!(tab.evaluate(overlay), shown);
    }
    press(&mut tab, 'R');
    moved(&mut tab, "R returns", |now| now.iter().zip(&start).all(|(a, b)| near(*a, *b)));
    assert_eq!(tab.console, Vec::<String>::new());
    server.assert_healthy();
}

#[test]
fn a_right_drag_and_two_fingers_move_the_scene() {
    let Some(mut tab) = tab(PICTURE_PX) else { return };
    let server = serve(TestScene::small());
    settle(&mut tab, &server.page_url());
    let shifted = |before: &[f64], after: &[f64]| {
        let by = |at: usize| after[at] - before[at];
        (0..3).all(|axis| near(by(axis), by(3 + axis))) && (0..3).any(|axis| by(axis).abs() > 1e-3)
    };
    let before = camera(&mut tab);
    let right = |buttons: u32| json!({ "button": "right", "buttons": buttons, "clickCount": 1 });
    mouse(&mut tab, "mousePressed", [300.0, 200.0], right(2));
    mouse(&mut tab, "mouseMoved", [360.0, 230.0], right(2));
    mouse(&mut tab, "mouseReleased", [360.0, 230.0], right(0));
    let after = moved(&mut tab, "a right drag moves eye and target", |now| shifted(&before, now));
    // The scene goes with the pointer, so the eye goes against it.
    assert!(along(&before, &after, 0) < 0.0 && along(&before, &after, 1) > 0.0, "{after:?} from {before:?}");

    let before = after;
    touch(&mut tab, "touchStart", &[[250.0, 180.0], [350.0, 180.0]]);
    touch(&mut tab, "touchMove", &[[290.0, 180.0], [390.0, 180.0]]);
    touch(&mut tab, "touchEnd", &[]);
    let after = moved(&mut tab, "two fingers move eye and target", |now| shifted(&before, now));
    assert!(along(&before, &after, 0) < 0.0 && near(distance(&after), distance(&before)), "{after:?}");
    server.assert_healthy();
}

#[test]
fn p_keeps_the_picture() {
    let Some(mut tab) = tab(PICTURE_PX) else { return };
    let folder = tempfile::tempdir().unwrap();
    tab.call("Page.setDownloadBehavior", json!({ "behavior": "allow", "downloadPath": folder.path() }));
    let server = serve(TestScene::small());
    settle(&mut tab, &server.page_url());
    let expected = image(&mut tab, "lodestream.view.picture()");
    press(&mut tab, 'P');
    let file = folder.path().join("lodestream.png");
    // The browser renames it once it is whole.
    tab.wait("the file is there", "null", |_| file.exists());
    let kept = ::image::open(file).unwrap().to_rgba8();
    assert_eq!(kept.dimensions(), (PICTURE_PX[0], PICTURE_PX[1]));
    assert!(kept == expected, "it is another picture than the page's");
    server.assert_healthy();
}

#[test]
fn phones_take_less_memory() {
    let Some(mut tab) = tab([390, 844]) else { return };
    let server = serve(TestScene::small());
    let cap = |tab: &mut Tab, address: &str| {
        tab.navigate("about:blank");
        tab.navigate(address);
        let stats = tab.wait("the page", STATS, |stats| stats["memory_cap_bytes"].is_number());
        stats["memory_cap_bytes"].as_u64().unwrap() >> 20
    };
    let url = server.page_url();
    assert_eq!(cap(&mut tab, &url), 512);
    tab.be_a_phone([390, 844], 3.0);
    assert_eq!(cap(&mut tab, &url), 256);
    assert_eq!(cap(&mut tab, &format!("{url}#memory=100")), 100);
    // A touch screen of a desk's size.
    tab.be_a_phone([1600, 1000], 1.0);
    assert_eq!(cap(&mut tab, &url), 512);
    server.assert_healthy();
}
