//! Keys, mouse and dropped files in the viewer's window: each changes the picture, and back.

use std::path::Path;

use image::{RgbImage, RgbaImage};

use crate::support::picture::skipped;
use crate::support::program::{Program, RUN_LIMIT, SIZE_PX};
use crate::support::shapes::ball;
use crate::support::window_pictures::{
    OTHER_PIXELS, differing, wait, wait_for, wait_for_another, wait_for_file, wait_for_share,
};
use crate::support::x11::{ESCAPE, F11, HOME, SHIFT};

/// What a headless viewer draws of a file.
fn drawn(file: &Path, folder: &Path) -> RgbImage {
    let (picture, cache) = (folder.join("picture.png"), folder.join("cache"));
    let output =
        Program::headless(file.to_str().unwrap(), &picture, &["--cache", cache.to_str().unwrap()]).end();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    image::open(&picture).unwrap().into_rgb8()
}

/// A box with different faces, of 3 × 2 × 1.
const BOX: &str = "v 0 0 0\nv 3 0 0\nv 3 2 0\nv 0 2 0\nv 0 0 1\nv 3 0 1\nv 3 2 1\nv 0 2 1\n\
    f 4 3 2 1\nf 5 6 7 8\nf 1 2 6 5\nf 2 3 7 6\nf 3 4 8 7\nf 4 1 5 8\n";

#[test]
fn dropped_files_are_shown_one_after_another_and_a_bad_one_leaves_the_picture() {
    if skipped() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    std::fs::write(at("ball.obj"), ball(30, 40)).unwrap();
    std::fs::write(at("box.obj"), BOX).unwrap();
    std::fs::write(at("bad.obj"), "v 0 0 0\nf 1 2 9\n").unwrap();
    let [first, second] = ["ball.obj", "box.obj"].map(|name| drawn(&at(name), folder.path()));
    let program = Program::in_empty_window(&["--no-overlay", "--cache", at("cache").to_str().unwrap()]);
    let window = program.window();
    let empty = window.picture(SIZE_PX);
    window.drop_files(SIZE_PX, &[&at("ball.obj")], RUN_LIMIT);
    wait_for(&window, "the first file", &first);
    assert_ne!(empty, first);
    window.drop_files(SIZE_PX, &[&at("bad.obj")], RUN_LIMIT);
    wait_for_another(&window, "a message", &first);
    wait_for(&window, "the first file again", &first);
    window.drop_files(SIZE_PX, &[&at("box.obj")], RUN_LIMIT);
    wait_for(&window, "the second file", &second);
    window.press_with_control('q');
    let ended = program.end();
    assert_eq!(ended.status.code(), Some(0), "{}", String::from_utf8_lossy(&ended.stderr));
    let left: Vec<_> = std::fs::read_dir(at("cache")).unwrap().map(|entry| entry.unwrap().path()).collect();
    assert!(left.iter().all(|path| path.extension().is_some_and(|own| own == "lsp")), "{left:?}");
}

/// Number of pixels with the tint of a selected part, and their mean column.
fn tinted(shown: &RgbImage) -> (usize, f64) {
    let is_tinted = |pixel: &image::Rgb<u8>| pixel.0[0] > pixel.0[2] + 40;
    let columns: Vec<f64> =
        shown.enumerate_pixels().filter(|(.., pixel)| is_tinted(pixel)).map(|(x, ..)| f64::from(x)).collect();
    (columns.len(), columns.iter().sum::<f64>() / columns.len() as f64)
}

#[test]
fn each_key_and_button_changes_the_picture_and_back() {
    if skipped() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("box.obj");
    std::fs::write(&file, BOX).unwrap();
    let whole = drawn(&file, folder.path());
    let cache = folder.path().join("cache");
    let program =
        Program::in_window(file.to_str().unwrap(), &["--no-overlay", "--cache", cache.to_str().unwrap()]);
    let window = program.window();
    let [x, y] = SIZE_PX.map(|side| i16::try_from(side / 2).unwrap());
    window.point_at(x, y);
    wait_for(&window, "the file", &whole);
    // Panels, edges of triangles, parallel projection, a section plane, and the line over the picture, each shown and hidden
    // by its key.
    for (key, share) in
        [('h', 0.02), ('i', 0.02), ('p', 0.01), ('g', 0.02), ('t', 0.006), ('o', 0.01), ('c', 0.02)]
    {
        window.press(key);
        wait_for_share(&window, &format!("{key}: shown"), &whole, share);
        window.press(key);
        wait_for(&window, &format!("{key}: hidden"), &whole);
    }
    for key in ['o', 'h'] {
        window.press_with_control(key);
        wait_for_share(&window, &format!("control and {key}"), &whole, 0.01);
        window.press_with_control(key);
        wait_for(&window, &format!("control and {key} again"), &whole);
    }
    window.press('i');
    wait_for_another(&window, "a panel", &whole);
    window.press_symbol(ESCAPE);
    wait_for(&window, "Escape closes it", &whole);
    // Views, and the way back.
    for key in ['1', '3', '7', 'f', ' '] {
        window.press(key);
        wait_for_another(&window, &format!("{key:?}: moved"), &whole);
        window.press('0');
        wait_for(&window, &format!("{key:?}: back"), &whole);
    }
    for key in ['w', 's', 'a', 'd', 'q', 'e'] {
        window.hold(key, || wait_for_another(&window, &format!("{key:?}: moved"), &whole));
        window.press('0');
        wait_for(&window, &format!("{key:?}: back"), &whole);
    }
    window.turn_wheel(true);
    wait_for_another(&window, "nearer", &whole);
    window.turn_wheel(false);
    wait_for(&window, "away again", &whole);
    // A click selects the box, which is tinted, and a double click frames its sphere, so that it becomes smaller.
    window.click(x, y);
    let selected = wait(&window, "a selected part", |shown| tinted(shown).0 > 2_000);
    window.click(x, y);
    window.click(x, y);
    wait(&window, "a framed part", |shown| (500..tinted(&selected).0 * 9 / 10).contains(&tinted(shown).0));
    window.press('u');
    window.press('0');
    wait_for(&window, "the start view", &whole);
    // Points that are measured are drawn until Escape.
    window.press('m');
    window.click(x - 50, y);
    window.click(x + 50, y);
    wait_for_share(&window, "a measured distance", &whole, 0.0045);
    window.press_symbol(ESCAPE);
    wait_for(&window, "no measuring", &whole);
    window.wait_for_full_screen(RUN_LIMIT, || window.press_symbol(F11));
    window.wait_for_full_screen(RUN_LIMIT, || window.press_symbol(ESCAPE));
    window.press_with_control('q');
    let ended = program.end();
    assert_eq!(ended.status.code(), Some(0), "{}", String::from_utf8_lossy(&ended.stderr));
}

/// Mean difference of the pixels of two pictures, of 1,020: that of opacity, and of colours as far as they cover.
fn apart(a: &RgbaImage, b: &RgbaImage) -> f64 {
    assert_eq!(a.dimensions(), b.dimensions());
    let of_pixels = a.pixels().zip(b.pixels()).map(|(a, b)| {
        let of = |channel: usize| f64::from(a.0[channel].abs_diff(b.0[channel]));
        of(3) + f64::from(a.0[3].min(b.0[3])) / 255.0 * (of(0) + of(1) + of(2))
    });
    of_pixels.sum::<f64>() / f64::from(a.width() * a.height())
}

#[test]
fn a_key_writes_pictures_of_another_size_and_without_background() {
    if skipped() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    std::fs::write(at("ball.obj"), ball(120, 160)).unwrap();
    let whole = drawn(&at("ball.obj"), folder.path());
    let (file, cache) = (at("ball.obj"), at("cache"));
    let [width, height] = SIZE_PX.map(|side| 4 * side);
    let size = format!("{width}x{height}");
    let usual = ["--transparent", "--cache", cache.to_str().unwrap()];
    // As sharp as its size asks for, and as what the window needs.
    let [fine, coarse] = ["1", "4"].map(|px| {
        let arguments = [&usual[..], &["--window", &size, "--pixel-error", px]].concat();
        let output = Program::headless(file.to_str().unwrap(), &at("clear.png"), &arguments).end();
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        image::open(at("clear.png")).unwrap().into_rgba8()
    });
    let arguments = [&["--no-overlay", "--picture-size", &size][..], &usual].concat();
    let program = Program::in_window_from(folder.path(), file.to_str().unwrap(), &arguments);
    let window = program.window();
    wait_for(&window, "the file", &whole);
    window.press_with_control('s');
    wait_for_file(&at("lodestream-001.png"));
    let written = image::open(at("lodestream-001.png")).unwrap().into_rgba8();
    assert_eq!((written.get_pixel(0, 0).0, written.get_pixel(width / 2, height / 2).0[3]), ([0; 4], 255));
    let [off, unrefined] = [&written, &coarse].map(|picture| apart(picture, &fine));
    println!("{off} of 1,020 apart in the mean; {unrefined} if it were not refined");
    assert!(3.0 * off < unrefined, "{off} of 1,020 apart in the mean; {unrefined} if it were not refined");
    wait_for(&window, "the window is as before", &whole);
    window.press_with_control('q');
    assert_eq!(program.end().status.code(), Some(0));
}

#[test]
fn a_drag_turns_the_eye_in_flight_and_keys_move_it_fast_and_write_pictures() {
    if skipped() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("box.obj");
    std::fs::write(&file, BOX).unwrap();
    let whole = drawn(&file, folder.path());
    let cache = folder.path().join("cache");
    let program = Program::in_window_from(
        folder.path(),
        file.to_str().unwrap(),
        &["--no-overlay", "--cache", cache.to_str().unwrap()],
    );
    let window = program.window();
    let [x, y] = SIZE_PX.map(|side| i16::try_from(side / 2).unwrap());
    window.point_at(x, y);
    wait_for(&window, "the file", &whole);
    // The letter alone would move back.
    window.press_with_control('s');
    let written = wait_for_file(&folder.path().join("lodestream-001.png"));
    let differs = differing(&written, &whole);
    assert!(differs <= OTHER_PIXELS, "the written picture: {differs} of the pixels differ");
    wait_for(&window, "the camera has not moved", &whole);
    for key in ['w', 's', 'a', 'd'] {
        window.hold_symbol(SHIFT, || {
            window.hold(key, || wait_for_another(&window, &format!("shift and {key:?}: moved"), &whole));
        });
        window.press_symbol(HOME);
        wait_for(&window, &format!("shift and {key:?}: back"), &whole);
    }
    window.click(x, y);
    let selected = wait(&window, "a selected part", |shown| tinted(shown).0 > 2_000);
    let (_, middle) = tinted(&selected);
    let shift = |shown: &RgbImage| (tinted(shown).1 - middle).abs();
    // The same drag turns the box about itself, and in flight the eye, by 0.2 rad.
    let drag = || window.drag([x, y], [x + 40, y]);
    for flies in [false, true, false] {
        drag();
        wait(&window, &format!("a drag, in flight: {flies}"), |shown| {
            differing(shown, &selected) > 5.0 * OTHER_PIXELS && (shift(shown) > 25.0) == flies
        });
        window.press('0');
        wait_for(&window, "the start view", &selected);
        window.press('v');
    }
    window.press_with_control('q');
    let ended = program.end();
    assert_eq!(ended.status.code(), Some(0), "{}", String::from_utf8_lossy(&ended.stderr));
}
