//! Parts in the viewer's window: a click selects one, keys hide, isolate, fit and show it.

use std::path::Path;

use image::RgbImage;
use lodestream_bake::scene::of_files;
use lodestream_daemon::SessionSettings;
use lodestream_protocol::source::SceneSource as _;
use lodestream_scene::description::{DEFAULT_AMBIENT, DEFAULT_BACKGROUND};

use crate::parts::write_house;
use crate::support::daemon::{Server, Transport};
use crate::support::picture::skipped;
use crate::support::program::Program;
use crate::support::scene::{TestScene, prepare_all};
use crate::support::window_pictures::{OTHER_PIXELS, differing, wait_for, wait_for_another, wait_for_file};
use crate::support::x11::F12;

/// Part 7 is in the middle, 6 and 8 are beside it.
const CAMERA: [&str; 2] = ["--camera", "eye=21.3,0.3,3.5;target=21.3,0.3,0;fov=50"];
/// Parts change the shadows and the occlusion of others otherwise.
const PLAIN: [&str; 3] = ["--no-overlay", "--no-shadows", "--no-ao"];
const MIDDLE: [i16; 2] = [160, 90];
/// What a headless viewer draws of the same view.
fn drawn(url: &str, folder: &Path, arguments: &[&str]) -> RgbImage {
    let picture = folder.join("picture.png");
    let output = Program::headless(url, &picture, &[&CAMERA[..], &PLAIN, arguments].concat()).end();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    image::open(&picture).unwrap().into_rgb8()
}

#[test]
fn a_click_in_the_window_selects_a_part_and_keys_hide_isolate_fit_and_show_it() {
    if skipped() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let mut scene = of_files(&[write_house(folder.path())]).unwrap();
    // Under the sky, which parts differ from more than from a studio.
    (scene.background, scene.ambient) = (DEFAULT_BACKGROUND, DEFAULT_AMBIENT);
    let test_scene = TestScene::open(&scene, prepare_all(&scene, &folder.path().join("cache")));
    let batch = test_scene.asset("house/parts");
    let page = test_scene.store.page(0).unwrap();
    let instance = page.instances.iter().position(|instance| instance.asset == batch).unwrap();
    let server = Server::start(test_scene.source(), SessionSettings::default());
    let url = server.url(Transport::Quic);
    let part = format!("{instance}:7");
    let whole = drawn(&url, folder.path(), &[]);
    let selected = drawn(&url, folder.path(), &["--tint", &format!("{part}=ff8c00")]);
    let hidden = drawn(&url, folder.path(), &["--hide", &part]);
    let isolated = drawn(&url, folder.path(), &["--isolate", &part, "--tint", &format!("{part}=ff8c00")]);
    let pictures = [&whole, &selected, &hidden, &isolated];
    for (i, one) in pictures.iter().enumerate() {
        for other in &pictures[..i] {
            assert!(differing(one, other) > 5.0 * OTHER_PIXELS, "{i}: {}", differing(one, other));
        }
    }

    let program = Program::in_window_from(folder.path(), &url, &[&CAMERA[..], &PLAIN].concat());
    let window = program.window();
    let [x, y] = MIDDLE;
    wait_for(&window, "the whole", &whole);
    window.click(x, y);
    wait_for(&window, "selected", &selected);
    window.press('x');
    wait_for(&window, "hidden", &hidden);
    window.press('u');
    wait_for(&window, "all is shown", &whole);
    window.click(x, y);
    wait_for(&window, "selected again", &selected);
    window.press('l');
    wait_for(&window, "isolated", &isolated);
    window.press('z');
    wait_for_another(&window, "the camera moves to the part", &isolated);
    window.press('r');
    wait_for(&window, "the start view", &isolated);
    window.press('u');
    wait_for(&window, "all is shown again", &whole);
    let moved = |what: &str| wait_for_another(&window, what, &whole);
    window.press('7');
    moved("from above");
    // The start view is one from the front.
    window.press('1');
    wait_for(&window, "from the front", &whole);
    window.press(' ');
    moved("the turntable");
    window.press('0');
    wait_for(&window, "the start view, at rest", &whole);
    window.point_at(x, y);
    window.press('f');
    moved("what is under the pointer");
    window.press('0');
    wait_for(&window, "the start view again", &whole);
    window.press_symbol(F12);
    let written = folder.path().join("lodestream-001.png");
    let picture = wait_for_file(&written);
    let differs = differing(&picture, &whole);
    assert!(differs <= OTHER_PIXELS, "the written picture: {differs} of the pixels differ");
    window.ask_to_close();
    let output = program.end();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    server.assert_healthy();
}
