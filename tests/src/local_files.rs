//! Files that the viewer prepares itself: the same picture as from a server, prepared once, bad ones left out, changed ones
//! shown anew from the same camera.

use std::fmt::Write as _;
use std::path::Path;
use std::process::Output;
use std::time::{Duration, Instant};

use image::{Rgb, RgbImage};
use lodestream_bake::preparation_settings::Effort;
use lodestream_bake::scene::of_files;
use lodestream_daemon::SessionSettings;
use lodestream_report::image_error::image_error;

use crate::support::daemon::{Server, Transport};
use crate::support::picture::skipped;
use crate::support::program::{Program, RUN_LIMIT, SIZE_PX};
use crate::support::scene::{TestScene, prepare_all};
use crate::support::shapes::ball;

/// FLIP of pictures of the same scene: rounding.
const MAX_FLIP: f64 = 0.001;

fn errors(output: &Output) -> String {
    String::from_utf8(output.stderr.clone()).unwrap()
}

/// Names in a folder.
fn names(folder: &Path) -> Vec<String> {
    let entries = std::fs::read_dir(folder).unwrap();
    entries.map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect()
}

/// From one place: what the viewer prepares is framed by its surfaces, a scene that a test opens by spheres.
const CAMERA: [&str; 2] = ["--camera", "eye=1,1,4;target=0,0,0"];

fn headless(file: &Path, cache: &Path, picture: &Path) -> Output {
    let arguments = [&CAMERA[..], &["--cache", cache.to_str().unwrap()]].concat();
    Program::headless(file.to_str().unwrap(), picture, &arguments).end()
}

#[test]
fn a_file_looks_as_a_server_shows_it_and_is_prepared_once() {
    if skipped() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    std::fs::write(at("ball.obj"), ball(60, 100)).unwrap();
    let cache = at("cache");
    let prepared = |output: &Output| errors(output).contains("prepared in");
    let first = headless(&at("ball.obj"), &cache, &at("first.png"));
    assert_eq!(first.status.code(), Some(0), "{}", errors(&first));
    assert!(prepared(&first), "{}", errors(&first));
    let packs = names(&cache);
    assert!(packs.len() == 1 && packs[0].ends_with(".lsp"), "{packs:?}");
    let second = headless(&at("ball.obj"), &cache, &at("second.png"));
    assert!(second.status.success() && !prepared(&second), "{}", errors(&second));
    assert_eq!(names(&cache), packs);

    // With the effort of packs that stay on a machine.
    let mut scene = of_files(&[at("ball.obj")]).unwrap();
    scene.assets[0].preparation_settings.effort = Some(Effort::Least);
    let scene = TestScene::open(&scene, prepare_all(&scene, &at("other cache")));
    let server = Server::start(scene.source(), SessionSettings::default());
    let streamed = Program::headless(&server.url(Transport::Quic), &at("streamed.png"), &CAMERA).end();
    assert!(streamed.status.success(), "{}", errors(&streamed));
    // The pack by itself, too, and all of the folder that has it.
    let pack = headless(&cache.join(&packs[0]), &cache, &at("pack.png"));
    assert!(pack.status.success() && !prepared(&pack), "{}", errors(&pack));
    let open = |name: &str| image::open(at(name)).unwrap().into_rgba8();
    let expected = open("streamed.png");
    for name in ["first.png", "second.png", "pack.png"] {
        let error = image_error(&open(name), &expected).unwrap();
        assert!(error.flip <= MAX_FLIP, "{name}: {error:?}");
    }
    server.assert_healthy();
}

#[test]
fn pictures_have_a_transparent_background_and_go_around() {
    if skipped() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    std::fs::write(at("ball.obj"), ball(30, 40)).unwrap();
    std::fs::write(at("path.txt"), "eye=0,0,4;target=0,0,0\neye=0,0,8;target=0,0,0\n").unwrap();
    let (file, cache) = (at("ball.obj"), at("cache"));
    let drawn = |name: &str, more: &[&str]| {
        let arguments = [&["--cache", cache.to_str().unwrap()], more].concat();
        let output = Program::headless(file.to_str().unwrap(), &at(name), &arguments).end();
        assert!(output.status.success(), "{}", errors(&output));
    };
    let open = |name: &str| image::open(at(name)).unwrap().into_rgba8();
    drawn("usual.png", &[]);
    drawn("clear.png", &["--transparent"]);
    let (usual, clear) = (open("usual.png"), open("clear.png"));
    let [width, height] = SIZE_PX;
    assert_eq!(clear.get_pixel(0, 0).0, [0; 4]);
    let middle = [usual, clear].map(|picture| picture.get_pixel(width / 2, height / 2).0);
    assert_eq!(middle[1][3], 255);
    // Dithering is left out.
    assert!((0..3).all(|i| middle[0][i].abs_diff(middle[1][i]) <= 2), "{middle:?}");
    drawn("around.png", &["--turntable", "2"]);
    assert!(open("around-0001.png") != open("around-0002.png") && !at("around-0003.png").exists());
    drawn("path.png", &["--transparent", "--camera-path", at("path.txt").to_str().unwrap()]);
    let covered = |name: &str| open(name).pixels().filter(|pixel| pixel.0[3] == 255).count() as f64;
    let ratio = covered("path-0001.png") / covered("path-0002.png");
    assert!((3.4..5.6).contains(&ratio), "twice as far is about a quarter: {ratio}");
}

#[test]
fn a_bad_file_of_a_folder_is_named_and_the_others_are_shown() {
    if skipped() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    std::fs::create_dir(at("models")).unwrap();
    std::fs::write(at("models/bad.obj"), "v 0 0 0\nf 1 2 9\n").unwrap();
    let alone = headless(&at("models"), &at("cache"), &at("alone.png"));
    assert_eq!(alone.status.code(), Some(2), "{}", errors(&alone));
    assert!(errors(&alone).contains("error: ") && errors(&alone).contains("bad.obj"), "{}", errors(&alone));
    std::fs::write(at("models/ball.obj"), ball(20, 30)).unwrap();
    let both = headless(&at("models"), &at("cache"), &at("both.png"));
    assert_eq!(both.status.code(), Some(0), "{}", errors(&both));
    assert!(errors(&both).contains("skipped") && errors(&both).contains("bad.obj"), "{}", errors(&both));
    let one = headless(&at("models/ball.obj"), &at("cache"), &at("one.png"));
    assert!(one.status.success(), "{}", errors(&one));
    let open = |name: &str| image::open(at(name)).unwrap().into_rgba8();
    assert!(open("both.png") == open("one.png"));
}

#[cfg(unix)]
#[test]
fn an_interrupted_preparation_leaves_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    std::fs::write(at("ball.obj"), ball(400, 500)).unwrap();
    std::fs::create_dir(at("cache")).unwrap();
    let cache = at("cache");
    let arguments = ["--cache", cache.to_str().unwrap()];
    let program = Program::headless(at("ball.obj").to_str().unwrap(), &at("x.png"), &arguments);
    let until = Instant::now() + RUN_LIMIT;
    while names(&cache).is_empty() {
        assert!(Instant::now() < until, "the preparation did not begin");
        std::thread::sleep(Duration::from_millis(5));
    }
    program.terminate();
    let ended = program.end();
    assert_eq!(ended.status.code(), Some(128 + 15), "{}", errors(&ended));
    assert_eq!(names(&cache), Vec::<String>::new());
    assert!(!at("x.png").exists());
}

#[test]
fn a_window_that_is_closed_while_files_are_prepared_leaves_nothing() {
    if skipped() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    std::fs::write(at("ball.obj"), ball(500, 600)).unwrap();
    std::fs::create_dir(at("cache")).unwrap();
    let cache = at("cache");
    let program = Program::in_window(at("ball.obj").to_str().unwrap(), &["--cache", cache.to_str().unwrap()]);
    let window = program.window();
    let until = Instant::now() + RUN_LIMIT;
    while names(&cache).is_empty() {
        assert!(Instant::now() < until, "the preparation did not begin");
        std::thread::sleep(Duration::from_millis(5));
    }
    window.ask_to_close();
    let ended = program.end();
    assert_eq!(ended.status.code(), Some(0), "{}", errors(&ended));
    // A machine that is quick enough has written the whole pack.
    let left: Vec<String> = names(&cache).into_iter().filter(|name| !name.ends_with(".lsp")).collect();
    assert_eq!(left, Vec::<String>::new());
}

#[test]
fn a_shared_scene_looks_the_same_in_another_viewer() {
    if skipped() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    std::fs::write(at("ball.obj"), ball(30, 40)).unwrap();
    let own = headless(&at("ball.obj"), &at("cache"), &at("own.png"));
    assert!(own.status.success(), "{}", errors(&own));
    let cache = at("cache");
    let arguments = ["--share=127.0.0.1:0", "--cache", cache.to_str().unwrap()];
    let mut sharing = Program::in_window(at("ball.obj").to_str().unwrap(), &arguments);
    for (number, scheme) in ["quic://", "ws://"].into_iter().enumerate() {
        let url = sharing.line();
        assert!(url.starts_with(scheme), "{url}");
        let picture = at(&format!("{number}.png"));
        let other = Program::headless(&url, &picture, &CAMERA).end();
        assert!(other.status.success(), "{}", errors(&other));
        let [own, other] = [at("own.png"), picture].map(|picture| image::open(picture).unwrap().into_rgba8());
        let error = image_error(&own, &other).unwrap();
        assert!(error.flip <= MAX_FLIP, "{error:?}");
    }
    sharing.close();
    let ended = sharing.end();
    assert_eq!(ended.status.code(), Some(0), "{}", errors(&ended));
}

/// Two balls side by side, the left one of another colour than the right one, which is green.
fn write_balls(folder: &Path, left: &str) {
    let mut obj = String::from("mtllib balls.mtl\n");
    let one = ball(40, 60);
    let vertices = one.lines().filter(|line| line.starts_with("v ")).count();
    for (number, name) in ["left", "right"].iter().enumerate() {
        writeln!(obj, "usemtl {name}").unwrap();
        for line in one.lines() {
            let words: Vec<&str> = line.split(' ').collect();
            let numbers = words[1..].iter().map(|word| word.parse::<f64>().unwrap());
            if words[0] == "v" {
                let point: Vec<f64> = numbers.collect();
                writeln!(obj, "v {} {} {}", point[0] + 3.0 * number as f64, point[1], point[2]).unwrap();
            } else {
                let corners: Vec<String> =
                    numbers.map(|corner| (corner as usize + number * vertices).to_string()).collect();
                writeln!(obj, "f {}", corners.join(" ")).unwrap();
            }
        }
    }
    std::fs::write(folder.join("balls.obj"), obj).unwrap();
    let mtl = format!("newmtl left\nKd {left}\nNs 10\nnewmtl right\nKd 0.02 0.4 0.02\nNs 10\n");
    std::fs::write(folder.join("balls.mtl"), mtl).unwrap();
}

/// Mean column of the pixels of a colour, given as which of its channels are bright; `None` with few of them.
fn middle(picture: &RgbImage, bright: [bool; 3]) -> Option<f64> {
    let is = |Rgb(pixel): &Rgb<u8>| {
        let most = *pixel.iter().max().unwrap();
        most > 30 && pixel.map(|channel| f64::from(channel) > 0.6 * f64::from(most)) == bright
    };
    let columns: Vec<f64> =
        picture.enumerate_pixels().filter(|(_, _, pixel)| is(pixel)).map(|(x, ..)| f64::from(x)).collect();
    (columns.len() > 100).then(|| columns.iter().sum::<f64>() / columns.len() as f64)
}

/// Columns between which the pointer drags the scene, some tens of degrees: the balls come closer to each other.
const DRAG: [i16; 2] = [220, 100];

const RED: [bool; 3] = [true, false, false];
const GREEN: [bool; 3] = [false, true, false];
const MAGENTA: [bool; 3] = [true, false, true];

#[test]
fn a_changed_file_is_shown_anew_from_the_same_camera() {
    if skipped() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    write_balls(folder.path(), "0.5 0.02 0.02");
    let (file, cache) = (folder.path().join("balls.obj"), folder.path().join("cache"));
    let program = Program::in_window(
        file.to_str().unwrap(),
        &["--no-overlay", "--watch", "--cache", cache.to_str().unwrap()],
    );
    let window = program.window();
    let wait = |what: &str, wanted: &dyn Fn(&RgbImage) -> bool| {
        let until = Instant::now() + RUN_LIMIT;
        loop {
            let picture = window.picture(SIZE_PX);
            if wanted(&picture) {
                return;
            }
            if Instant::now() >= until {
                picture.save(std::env::temp_dir().join("watch.png")).unwrap();
                panic!("{what} did not happen");
            }
            std::thread::sleep(Duration::from_millis(50));
        }
    };
    // How far right of the left ball the right one is.
    let apart = |picture: &RgbImage, left: [bool; 3]| Some(middle(picture, GREEN)? - middle(picture, left)?);
    wait("the first picture", &|picture| apart(picture, RED).is_some_and(|px| px > 50.0));
    let first = apart(&window.picture(SIZE_PX), RED).unwrap();
    let [from, to] = DRAG;
    window.point_at(from, 90);
    window.hold_left();
    for column in (to..from).rev().step_by(10) {
        window.point_at(column, 90);
    }
    let turned = |picture: &RgbImage, left| apart(picture, left).filter(|px| (px - first).abs() > 15.0);
    wait("the turn", &|picture| turned(picture, RED).is_some());
    // Until it rests.
    wait("rest", &|picture| {
        std::thread::sleep(Duration::from_secs(1));
        turned(picture, RED).is_some() && *picture == window.picture(SIZE_PX)
    });
    let rests = turned(&window.picture(SIZE_PX), RED).unwrap();
    write_balls(folder.path(), "0.5 0.02 0.42");
    wait("the change", &|picture| turned(picture, MAGENTA).is_some_and(|px| (px - rests).abs() < 5.0));
    program.close();
    let ended = program.end();
    assert_eq!(ended.status.code(), Some(0), "{}", errors(&ended));
    assert!(names(&cache).iter().all(|name| name.ends_with(".lsp")), "{:?}", names(&cache));
}
