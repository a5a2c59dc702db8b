//! Parts in the page: clicked, hidden, isolated and shown again by keys, moved by a script.

use image::RgbaImage;
use lodestream_bake::scene::of_files;
use lodestream_protocol::source::SceneSource as _;
use serde_json::{Value, json};

use super::devtools::Tab;
use super::page::{mouse, press, serve, settle};
use super::{image, tab};
use crate::parts::write_house;
use crate::support::PICTURE_PX;
use crate::support::scene::{TestScene, prepare_all};

const SELECTED: &str = "lodestream.selection.selected";

/// The picture, once it is final: surfaces change no pixels but their own.
fn picture(tab: &mut Tab) -> RgbaImage {
    image(tab, "lodestream.view.picture()")
}

/// Which pixels differ.
fn differing(a: &RgbaImage, b: &RgbaImage) -> Vec<bool> {
    a.pixels().zip(b.pixels()).map(|(a, b)| (0..3).any(|i| a.0[i].abs_diff(b.0[i]) > 3)).collect()
}

fn count(pixels: &[bool]) -> usize {
    pixels.iter().filter(|differs| **differs).count()
}

fn click(tab: &mut Tab, at: [f64; 2]) {
    mouse(tab, "mousePressed", at, json!({ "button": "left", "buttons": 1, "clickCount": 1 }));
    mouse(tab, "mouseReleased", at, json!({ "button": "left", "clickCount": 1 }));
}

#[test]
fn a_click_selects_a_part_and_keys_hide_isolate_fit_and_show_it() {
    let Some(mut tab) = tab(PICTURE_PX) else { return };
    let folder = tempfile::tempdir().unwrap();
    let scene = of_files(&[write_house(folder.path())]).unwrap();
    let scene = TestScene::open(&scene, prepare_all(&scene, &folder.path().join("cache")));
    let batch = scene.asset("house/parts");
    let page = scene.store.page(0).unwrap();
    let instance = page.instances.iter().position(|instance| instance.asset == batch).unwrap();
    let server = serve(&scene);
    // Part 7 is in the middle, 6 and 8 are beside it.
    let view = "eye=21.3,0.3,7;target=21.3,0.3,0;up=0,1,0;fov=50";
    settle(&mut tab, &format!("{}#{view}", server.page_url()));
    for technique in ["occlusion", "shadows", "smoothing"] {
        tab.evaluate(&format!("void lodestream.view.switch('{technique}', false)"));
    }
    // Not bytes received: answers to pings are among them.
    let blobs = |tab: &mut Tab| {
        tab.evaluate("(({ wanted_chunks, needed_bytes, faces }) => [wanted_chunks, needed_bytes, faces])(lodestream.stats())")
    };
    let before = blobs(&mut tab);
    let whole = picture(&mut tab);
    let keys = tab.evaluate("document.querySelector('#overlay .keys').textContent");
    assert!(
        ["X hides", "I shows", "Z moves", "U shows all"]
            .iter()
            .all(|key| keys.as_str().unwrap().contains(key))
    );

    let middle = PICTURE_PX.map(|side| f64::from(side) / 2.0);
    click(&mut tab, middle);
    let part = json!({ "instance": instance, "part": 7 });
    tab.wait("the part is selected", SELECTED, |selected| *selected == part);
    let tinted = differing(&whole, &picture(&mut tab));
    let own = count(&tinted);
    assert!(own > 500, "{own}");

    press(&mut tab, 'X');
    tab.wait("the part is hidden", SELECTED, Value::is_null);
    let hidden = differing(&whole, &picture(&mut tab));
    assert!(hidden.iter().zip(&tinted).all(|(hidden, own)| *own || !hidden), "only where the part was");
    assert!(10 * count(&hidden) > 9 * own, "{} of {own}", count(&hidden));
    // What is hidden is not selected.
    click(&mut tab, middle);
    press(&mut tab, 'U');
    assert_eq!(count(&differing(&whole, &picture(&mut tab))), 0, "all is shown again");

    click(&mut tab, middle);
    tab.wait("the part is selected again", SELECTED, |selected| *selected == part);
    press(&mut tab, 'I');
    let isolated = differing(&whole, &picture(&mut tab));
    assert!(count(&isolated) > own + 500, "the others are gone: {}", count(&isolated));
    press(&mut tab, 'U');
    assert_eq!(count(&differing(&whole, &picture(&mut tab))), 0, "all is shown again");

    // Half a unit upwards, and back. A matrix that is none is refused and changes nothing.
    let to = |y: f64| format!("[1,0,0,0, 0,1,0,0, 0,0,1,0, 0,{y},0,1]");
    let move_to = |matrix: &str| {
        format!(
            "(() => {{ try {{ lodestream.view.parts.move({instance}, 7, {matrix}); return 'moved'; }}
                catch (why) {{ return why.message; }} }})()"
        )
    };
    assert_eq!(tab.evaluate(&move_to(&to(0.5))), "moved");
    let moved = differing(&whole, &picture(&mut tab));
    assert!(count(&moved) > 300, "{}", count(&moved));
    // Part 20 comes before it.
    let before_it =
        format!("lodestream.view.parts.move({instance}, 20, [1,0,0,0, 0,1,0,0, 0,0,1,0, -39,0,2,1])");
    tab.evaluate(&format!("void {before_it}"));
    let [x, y] = middle;
    let found = tab.evaluate(&format!(
        "lodestream.view.parts.pick({x} * devicePixelRatio, {y} * devicePixelRatio).then((found) => found?.part)"
    ));
    assert_eq!(found, 20);
    tab.evaluate(&format!("void lodestream.view.parts.move({instance}, 20, null)"));
    for bad in ["[1]", "Array(16).fill(NaN)", "Array(16).fill(0)", &to(1e300)] {
        let why = tab.evaluate(&move_to(bad));
        assert!(why.as_str().unwrap().starts_with("the part's matrix "), "{bad}: {why}");
    }
    assert_eq!(tab.evaluate(&move_to("null")), "moved");
    assert_eq!(count(&differing(&whole, &picture(&mut tab))), 0, "moved back");
    assert_eq!(blobs(&mut tab), before, "nothing was requested");

    // The nearer view requests refinements, so it comes last.
    click(&mut tab, middle);
    tab.wait("the part is selected once more", SELECTED, |selected| *selected == part);
    let eye = "Array.from(lodestream.view.viewer.camera()).slice(0, 3)";
    let start = tab.evaluate(eye);
    press(&mut tab, 'Z');
    tab.wait("the camera moves to the part", eye, |eye| *eye != start);
    press(&mut tab, 'R');
    tab.wait("the start view", eye, |eye| *eye == start);
    assert_eq!(tab.console, Vec::<String>::new());
    server.assert_healthy();
}
