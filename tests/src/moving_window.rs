//! The viewer's window with a camera that moves while the scene arrives: objects do not disappear.

use std::collections::BTreeSet;
use std::fmt::Write as _;
use std::path::Path;
use std::time::{Duration, Instant};

use image::{Rgb, RgbImage};
use lodestream_bake::scene::of_files;
use lodestream_daemon::SessionSettings;

use crate::support::daemon::{Server, Transport};
use crate::support::picture::skipped;
use crate::support::program::{Program, RUN_LIMIT, SIZE_PX};
use crate::support::scene::{TestScene, prepare_all};
use crate::support::shapes::ball;

/// Slow enough that the balls are still refined while the camera moves.
const RATE_BITS_PER_S: u64 = 300_000;
/// Fewest pictures checked after the first, and chunks received by then.
const PICTURES: usize = 12;
const CHUNKS: u64 = 20;
/// Columns between which the pointer is dragged, and step size: the camera swings by 0.2 rad.
const COLUMNS: [i16; 2] = [140, 180];
const STEP: usize = 4;
/// Least visible share of an object, relative to its largest: balls turn, and are coarse at first.
const LEAST_SHARE: f64 = 0.5;

/// The colours of the balls.
const COLOURS: [(&str, &str); 4] = [
    ("red", "0.5 0.02 0.02"),
    ("green", "0.02 0.4 0.02"),
    ("yellow", "0.5 0.42 0.02"),
    ("magenta", "0.5 0.02 0.42"),
];

/// The ball whose colour a pixel has; none has that of the sky, in which blue dominates.
fn ball_of(&Rgb(pixel): &Rgb<u8>) -> Option<usize> {
    let most = *pixel.iter().max().unwrap();
    match pixel.map(|channel| f64::from(channel) > 0.6 * f64::from(most)) {
        _ if most < 30 => None,
        [true, false, false] => Some(0),
        [false, true, false] => Some(1),
        [true, true, false] => Some(2),
        [true, false, true] => Some(3),
        _ => None,
    }
}

/// Number of pixels of each ball.
fn ball_pixels(picture: &RgbImage) -> [usize; 4] {
    let mut pixels = [0; 4];
    picture.pixels().filter_map(ball_of).for_each(|ball| pixels[ball] += 1);
    pixels
}

/// Mean column of a ball's pixels.
fn middle(picture: &RgbImage, ball: usize) -> f64 {
    let columns: Vec<f64> = picture
        .enumerate_pixels()
        .filter(|(_, _, pixel)| ball_of(pixel) == Some(ball))
        .map(|(x, _, _)| f64::from(x))
        .collect();
    columns.iter().sum::<f64>() / columns.len() as f64
}

/// Four balls side by side that do not occlude each other from any position of the camera.
fn balls(folder: &Path) -> TestScene {
    let mut text = String::from(
        "name = \"balls\"\n[camera]\neye = [0.0, 0.0, 7.0]\ntarget = [0.0, 0.0, 0.0]\nfov_y_degrees = 42.0\n\
         [light]\ndirection = [0.2, 0.5, 1.0]\n",
    );
    let (mut materials, mut instances) = (String::new(), String::new());
    let places = [[-2.2, -1.1], [-0.8, 1.2], [0.8, -1.2], [2.2, 1.1]];
    for ((name, colour), [x, y]) in COLOURS.iter().zip(places) {
        writeln!(materials, "newmtl {name}\nKd {colour}\nNs 10").unwrap();
        let mesh = format!("mtllib balls.mtl\nusemtl {name}\n{}", ball(60, 100));
        std::fs::write(folder.join(format!("{name}.obj")), mesh).unwrap();
        writeln!(text, "[[asset]]\nname = \"{name}\"\nfile = \"{name}.obj\"").unwrap();
        writeln!(
            instances,
            "[[instance]]\nasset = \"{name}\"\ntranslation = [{x:.1}, {y:.1}, 0.0]\nscale = 0.6"
        )
        .unwrap();
    }
    std::fs::write(folder.join("balls.mtl"), materials).unwrap();
    let path = folder.join("scene.toml");
    std::fs::write(&path, text + &instances).unwrap();
    let scene = of_files(&[path]).unwrap();
    TestScene::open(&scene, prepare_all(&scene, &folder.join("cache")))
}

/// Number of chunks that a server has sent completely.
fn sent_chunks(server: &Server) -> u64 {
    let metrics = server.metrics();
    let line = metrics.lines().find_map(|line| line.strip_prefix("lodestream_sent_total{kind=\"chunk\"} "));
    line.map_or(0, |count| count.parse().unwrap())
}

/// Checks that no object disappears for a frame, neither while its mesh changes nor before the data for the moved
/// camera arrives.
#[test]
fn no_object_disappears_while_the_camera_moves() {
    if skipped() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let settings = SessionSettings { rate_bits_per_s: Some(RATE_BITS_PER_S), ..SessionSettings::default() };
    let server = Server::start(balls(folder.path()).source(), settings);
    let stats = folder.path().join("stats.json");
    let program = Program::in_window(
        &server.url(Transport::Quic),
        // While the camera moves, a slow device asks for 16 times as much.
        &["--no-overlay", "--pixel-error", "0.025", "--stats", stats.to_str().unwrap()],
    );
    let window = program.window();
    let [from, to] = COLUMNS;
    let mut pointer = (from..to).step_by(STEP).chain((from..to).rev().step_by(STEP)).cycle();
    window.point_at(from, 90);
    window.hold_left();
    let mut most = [0; 4];
    let (mut pictures, mut places) = (Vec::new(), BTreeSet::new());
    let mut last = RgbImage::new(1, 1);
    let until = Instant::now() + RUN_LIMIT;
    while pictures.len() <= PICTURES || sent_chunks(&server) < CHUNKS {
        assert!(Instant::now() < until, "{} pictures: {pictures:?}", pictures.len());
        window.point_at(pointer.next().unwrap(), 90);
        std::thread::sleep(Duration::from_millis(10));
        let picture = window.picture(SIZE_PX);
        if picture == last {
            continue;
        }
        let pixels = ball_pixels(&picture);
        for (ball, (&now, most)) in pixels.iter().zip(&mut most).enumerate() {
            let (name, _) = COLOURS[ball];
            assert!(
                now as f64 >= LEAST_SHARE * *most as f64,
                "{name} has {now} pixels, and had {most}: {pictures:?}"
            );
            *most = now.max(*most);
        }
        // From the first picture with all balls.
        if pixels.iter().all(|&pixels| pixels > 0) {
            pictures.push(pixels);
            places.insert(middle(&picture, 0).round() as i64);
        }
        last = picture;
    }
    println!("{} pictures, the red ball's middle at {places:?}: {pictures:?}", pictures.len());
    // They are not tiny, and the camera has moved.
    assert!(most.iter().all(|&pixels| pixels > 200), "{most:?}");
    assert!(places.len() >= 3, "the camera stood still: {places:?}");
    window.ask_to_close();
    let output = program.end();
    assert_eq!(output.status.code(), Some(0), "{}", String::from_utf8_lossy(&output.stderr));
    let stats: serde_json::Value = serde_json::from_slice(&std::fs::read(&stats).unwrap()).unwrap();
    for frame in stats["frames"].as_array().unwrap().iter().filter(|frame| frame["whole"] == true) {
        assert_eq!(frame["instances"], COLOURS.len(), "{frame}");
    }
    server.assert_healthy();
}
