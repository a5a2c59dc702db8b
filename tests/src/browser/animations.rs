//! Animations play in a tab: the page moves what it draws, and the worker picks where that is.

use image::RgbaImage;
use lodestream_bake::scene::of_files;
use lodestream_report::image_error::image_error;
use lodestream_scene::animation::Moment;
use serde_json::json;

use super::page::{STATS, press, serve, settle};
use super::{image, tab};
use crate::skins::write_arm;
use crate::support::PICTURE_PX;
use crate::support::daemon::Transport;
use crate::support::picture::{Picture, draw_at, headless, keep};
use crate::support::scene::{TestScene, prepare_all};
use crate::support::viewer::{Viewer, config};

const TIME: &str = "lodestream.view.viewer.clip_time()";
const PLAYS: &str = "lodestream.view.viewer.plays()";
const BUTTON: &str =
    "(({ hidden, textContent }) => [hidden, textContent])(document.querySelector('#overlay .play'))";

#[test]
fn a_skinned_mesh_plays_pauses_and_is_picked_where_its_joints_are() {
    let (Some(mut tab), Some(mut headless)) = (tab(PICTURE_PX), headless()) else { return };
    let folder = tempfile::tempdir().unwrap();
    let scene = of_files(&[write_arm(folder.path())]).unwrap();
    let scene = TestScene::open(&scene, prepare_all(&scene, &folder.path().join("cache")));
    let server = serve(&scene);
    settle(&mut tab, &server.page_url());
    assert_eq!(tab.evaluate("lodestream.view.viewer.clip()"), "bend");
    tab.wait("the button pauses", BUTTON, |button| *button == json!([false, "Pause"]));
    let before = tab.evaluate(TIME);
    tab.wait("the clip plays", TIME, |time| *time != before);
    press(&mut tab, 'K');
    tab.wait("K pauses", PLAYS, |plays| *plays == false);
    tab.wait("the button plays", BUTTON, |button| *button == json!([false, "Play"]));
    let still = tab.evaluate(TIME);
    let frames = tab.evaluate("lodestream.view.picture().then(() => 1)");
    assert_eq!((tab.evaluate(TIME), frames), (still, json!(1)), "time stands");

    // The arm straight, and bent by a right angle: as natively at these times.
    let moment = |time_s| Some(Moment { clip: "bend".into(), time_s });
    let mut native = Viewer::start(&server.address(Transport::WebSocket), config());
    native.settle();
    let changes = &native.changes;
    let natives = [0.0, 2.0].map(|time_s| draw_at(&mut headless, changes.clone(), moment(time_s)));
    let off = |a: &RgbaImage, b: &RgbaImage| image_error(a, b).unwrap().flip;
    let apart = off(&natives[0].image, &natives[1].image);
    let pictures = [0.0, 2.0].map(|time_s| {
        tab.evaluate(&format!(
            "(lodestream.view.viewer.scrub_animation('bend', {time_s}), void lodestream.view.redraw())"
        ));
        tab.wait("it settles", STATS, |stats| stats["settled"] == true);
        image(&mut tab, "lodestream.view.picture()")
    });
    for (time_s, (shown, native)) in [0, 2].iter().zip(pictures.iter().zip(&natives)) {
        keep(
            &Picture { image: shown.clone(), covered: native.covered.clone() },
            &format!("tab-arm-{time_s}"),
        );
        let flip = off(shown, &native.image);
        println!("FLIP {flip} at {time_s} s, of two times {apart}");
        assert!(flip <= apart / 4.0, "{flip} at {time_s} s; pictures of the two times are {apart} apart");
    }

    // In the middle of what only the straight arm covers, the worker picks it as soon as it stands there.
    let differs = |x: u32, y: u32| {
        let [a, b] = [0, 1].map(|k: usize| pictures[k].get_pixel(x, y).0);
        (0..3).any(|i| a[i].abs_diff(b[i]) > 40)
    };
    let [width, height] = PICTURE_PX;
    let column = (0..width).max_by_key(|&x| (0..height / 3).filter(|&y| differs(x, y)).count()).unwrap();
    let rows: Vec<u32> = (0..height / 3).filter(|&y| differs(column, y)).collect();
    let row = rows[rows.len() / 2];
    let picked = format!("lodestream.view.parts.pick({column}, {row}).then((found) => Boolean(found))");
    tab.wait("nothing is where the arm was", &picked, |found| *found == false);
    tab.evaluate("(lodestream.view.viewer.scrub_animation('bend', 0), void lodestream.view.redraw())");
    tab.wait("the arm is picked", &picked, |found| *found == true);
    assert_eq!(tab.console, Vec::<String>::new());
    server.assert_healthy();
}
