//! Animated files in the viewer's window: clips play, keys choose and pause them, and another file has its own.

use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use data_encoding::BASE64;
use image::RgbImage;
use serde_json::{Value, json};

use crate::support::picture::skipped;
use crate::support::program::{Program, RUN_LIMIT, SIZE_PX};
use crate::support::shapes::ball;
use crate::support::window_pictures::{OTHER_PIXELS, differing, wait, wait_for};
use crate::support::x11::OpenWindow;

/// A clip that is at one place for a second and at another for the next.
type Clip = (&'static str, [[f32; 3]; 2]);

/// A file of two pyramids, one of which the clips move.
fn write_animated(path: &Path, clips: &[Clip]) {
    let corners = [[0.0_f32, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
    let faces = [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]];
    let positions: Vec<f32> = faces.iter().flatten().flat_map(|&corner: &usize| corners[corner]).collect();
    let mut lists = vec![positions, vec![0.0, 1.0, 2.0]];
    lists.extend(clips.iter().map(|(_, [first, second])| [*first, *second, *second].concat()));
    let (mut bytes, mut views, mut accessors) = (Vec::new(), Vec::new(), Vec::new());
    for (i, list) in lists.iter().enumerate() {
        let (kind, size) = if i == 1 { ("SCALAR", 1) } else { ("VEC3", 3) };
        views.push(json!({"buffer": 0, "byteOffset": bytes.len(), "byteLength": 4 * list.len()}));
        accessors
            .push(json!({"bufferView": i, "componentType": 5126, "type": kind, "count": list.len() / size,
            "min": [0.0, 0.0, 0.0], "max": [1.0, 1.0, 1.0]}));
        bytes.extend(list.iter().flat_map(|number| number.to_le_bytes()));
    }
    let animations: Vec<Value> = clips
        .iter()
        .enumerate()
        .map(|(i, (name, _))| {
            json!({
                "name": name, "channels": [{"sampler": 0, "target": {"node": 1, "path": "translation"}}],
                "samplers": [{"input": 1, "output": 2 + i, "interpolation": "STEP"}],
            })
        })
        .collect();
    let uri = format!("data:application/octet-stream;base64,{}", BASE64.encode(&bytes));
    let file = json!({
        "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0, 1]}],
        "nodes": [{"name": "fixed", "mesh": 0}, {"name": "moved", "mesh": 0, "translation": [2.0, 0.0, 0.0]}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}],
        "animations": animations, "accessors": accessors, "bufferViews": views,
        "buffers": [{"byteLength": bytes.len(), "uri": uri}],
    });
    std::fs::write(path, file.to_string()).unwrap();
}

const ALONG: Clip = ("along", [[1.0, 0.0, 0.0], [2.5, 0.0, 0.0]]);
const ABOVE: Clip = ("above", [[0.0, 1.0, 0.0], [1.0, 1.0, 0.0]]);
const APART: Clip = ("apart", [[1.0, 0.3, 0.0], [2.5, 0.6, 0.0]]);

/// A folder with files and the cache of their packs.
struct Files(tempfile::TempDir);

impl Files {
    fn at(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    fn cache(&self) -> String {
        self.at("cache").to_str().unwrap().to_owned()
    }

    /// What a headless viewer draws of a file.
    fn drawn(&self, file: &Path, more: &[&str]) -> RgbImage {
        let picture = self.at("picture.png");
        let cache = self.cache();
        let arguments = [&["--cache", &cache], more].concat();
        let output = Program::headless(file.to_str().unwrap(), &picture, &arguments).end();
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        image::open(&picture).unwrap().into_rgb8()
    }

    /// Both places of a clip.
    fn places(&self, file: &Path, clip: &str) -> [RgbImage; 2] {
        ["0", "1"].map(|time| self.drawn(file, &["--animation", clip, "--animation-time", time]))
    }
}

/// Waits until the window shows each of two pictures, coarsely: it is drawn with fewer pixels while a clip plays.
fn wait_for_both(window: &OpenWindow, what: &str, pictures: &[RgbImage; 2]) {
    let [first, second] = pictures;
    let apart = differing(first, second);
    assert!(apart > 10.0 * OTHER_PIXELS, "{what}: {apart}");
    for picture in [first, second, first] {
        wait(window, what, |shown| differing(shown, picture) < 0.5 * apart);
    }
}

fn end(program: Program, window: &OpenWindow) {
    window.press_with_control('q');
    let ended = program.end();
    assert_eq!(ended.status.code(), Some(0), "{}", String::from_utf8_lossy(&ended.stderr));
}

#[test]
fn keys_play_pause_and_change_the_clip() {
    if skipped() {
        return;
    }
    let files = Files(tempfile::tempdir().unwrap());
    let file = files.at("pyramids.gltf");
    write_animated(&file, &[ALONG, ABOVE]);
    let [along, above] = ["along", "above"].map(|clip| files.places(&file, clip));
    let arguments = ["--no-overlay", "--animation-time", "0", "--cache", &files.cache()];
    let program = Program::in_window(file.to_str().unwrap(), &arguments);
    let window = program.window();
    wait_for(&window, "the first clip stands", &along[0]);
    for (key, clip) in [('.', &above), ('.', &along), (',', &above), (',', &along)] {
        window.press(key);
        wait_for(&window, &format!("{key:?}: another clip"), &clip[0]);
    }
    window.press('k');
    wait_for_both(&window, "the first clip plays", &along);
    window.press('.');
    wait_for_both(&window, "the second clip plays", &above);
    window.press('k');
    let is_one = |shown: &RgbImage| above.iter().position(|one| differing(shown, one) <= OTHER_PIXELS);
    // For longer than the clip.
    let (mut shown, mut since) = (None, Instant::now());
    let until = since + RUN_LIMIT;
    while shown.is_none() || since.elapsed() < Duration::from_millis(2500) {
        assert!(Instant::now() < until, "it plays on");
        let now = is_one(&window.picture(SIZE_PX));
        if now != shown {
            (shown, since) = (now, Instant::now());
        }
        std::thread::sleep(Duration::from_millis(20));
    }
    end(program, &window);
}

#[test]
fn an_animated_file_plays_after_another_and_leaves_no_clips_to_one_without() {
    if skipped() {
        return;
    }
    let files = Files(tempfile::tempdir().unwrap());
    let [first, second, still] = ["first.gltf", "second.gltf", "ball.obj"].map(|name| files.at(name));
    write_animated(&first, &[ALONG, ABOVE]);
    write_animated(&second, &[APART]);
    std::fs::write(&still, ball(30, 40)).unwrap();
    let [along, above] = ["along", "above"].map(|clip| files.places(&first, clip));
    let apart = files.places(&second, "apart");
    let whole = files.drawn(&still, &[]);
    let program = Program::in_window(first.to_str().unwrap(), &["--cache", &files.cache()]);
    let window = program.window();
    // Without the line of text and the clip's controls.
    window.press_with_control('h');
    wait_for_both(&window, "the first file plays", &along);
    window.press('.');
    wait_for_both(&window, "its second clip plays", &above);
    window.drop_files(SIZE_PX, &[&second], RUN_LIMIT);
    wait_for_both(&window, "the second file plays", &apart);
    window.drop_files(SIZE_PX, &[&still], RUN_LIMIT);
    wait_for(&window, "a file without clips", &whole);
    window.press_with_control('h');
    let is_line = |share: f64| (OTHER_PIXELS..0.1).contains(&share);
    wait(&window, "a line of text, no controls", |shown| is_line(differing(shown, &whole)));
    end(program, &window);
}
