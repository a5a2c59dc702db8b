//! The daemon's page in a tab.

use data_encoding::BASE64;
use lodestream_bake::scene::of_files;
use lodestream_client::core::Change;
use lodestream_daemon::{Page, PageSetting, SessionSettings};
use lodestream_report::image_error::image_error;
use lodestream_scene::asset::{TextureFormat, TextureInfo};
use serde_json::{Value, json};

use super::devtools::{Tab, WEBGPU_AND_WEBGL};
use super::element::assert_names_browsers;
use super::{built_page, image, tab, tab_with};
use crate::support::PICTURE_PX;
use crate::support::daemon::Server;
use crate::support::picture::{Picture, draw, headless, keep};
use crate::support::scene::{TestScene, prepare_all};
use crate::support::shapes::write_plate;

/// Largest FLIP error of the settled tab against the settled native picture: two drivers round differently, and edges
/// are smoothed from other samples.
pub(super) const MAX_FLIP: f64 = 0.05;

pub(super) const CAMERA: &str = "Array.from(lodestream.view.viewer.camera())";
pub(super) const STATS: &str = "window.lodestream?.stats() ?? {}";

pub(super) fn serve(scene: &TestScene) -> Server {
    serve_with(scene, SessionSettings::default())
}

pub(super) fn serve_with(scene: &TestScene, sessions: SessionSettings) -> Server {
    let page = PageSetting::Loaded(Page::load(&built_page()).unwrap());
    Server::start_with(scene.source(), sessions, |options| options.page = page)
}

/// Opens the daemon's page and waits until it is settled; returns the figures.
pub(super) fn settle(tab: &mut Tab, url: &str) -> Value {
    tab.navigate(url);
    tab.wait("the page settles", STATS, |stats| stats["settled"] == true)
}

#[test]
fn a_tab_shows_what_the_native_viewer_shows() {
    let (Some(mut tab), Some(mut headless)) = (tab(PICTURE_PX), headless()) else { return };
    let scene = TestScene::small();
    let server = serve(scene);
    let stats = settle(&mut tab, &server.page_url());
    let count = |name: &str| stats[name].as_f64();
    assert_eq!([count("decode_failures"), count("lacking_blobs")], [Some(0.0); 2], "{stats}");
    assert!(stats["ttff_ms"].as_f64().unwrap() <= stats["settled_ms"].as_f64().unwrap(), "{stats}");
    // The daemon's page is cross-origin isolated.
    tab.wait("other workers decode", STATS, |stats| stats["decoders"].as_f64() >= Some(2.0));
    let native = draw(&mut headless, scene.whole());
    let image = image(&mut tab, "lodestream.view.picture()");
    assert_eq!(image.dimensions(), native.image.dimensions());
    let covered = native.covered.clone();
    let shown = Picture { image, covered };
    keep(&shown, "tab");
    keep(&native, "tab-native");
    let flip = image_error(&shown.image, &native.image).unwrap().flip;
    println!("FLIP {flip}, {stats}");
    assert!(flip <= MAX_FLIP, "{flip}: {stats}");
    assert_eq!(tab.console, Vec::<String>::new());
    server.assert_healthy();
}

#[test]
fn normals_and_surfaces_look_in_a_tab_as_natively() {
    let (Some(mut tab), Some(mut headless)) = (tab(PICTURE_PX), headless()) else { return };
    let folder = tempfile::tempdir().unwrap();
    let scene = of_files(&[write_plate(folder.path())]).unwrap();
    let scene = TestScene::open(&scene, prepare_all(&scene, &folder.path().join("cache")));
    let textures = &scene.assets[0].description.textures;
    let webp = |texture: &TextureInfo| texture.levels.last().unwrap().format == TextureFormat::WebP;
    assert!(textures.len() == 2 && textures.iter().all(webp), "{textures:?}");
    let server = serve(&scene);
    let stats = settle(&mut tab, &server.page_url());
    assert_eq!(stats["decode_failures"].as_f64(), Some(0.0), "{stats}");
    let native = draw(&mut headless, scene.whole());
    let mut bare = scene.whole();
    bare.retain(|change| !matches!(change, Change::Texture(_)));
    let bare = draw(&mut headless, bare);
    let shown = image(&mut tab, "lodestream.view.picture()");
    let off = |picture| image_error(picture, &native.image).unwrap().flip;
    let (flip, without) = (off(&shown), off(&bare.image));
    println!("FLIP {flip}, without maps {without}");
    keep(&Picture { image: shown, covered: native.covered.clone() }, "tab-maps");
    keep(&native, "tab-maps-native");
    // Highlights on bumps differ more than the surfaces of other scenes.
    assert!(flip <= without / 8.0, "{flip}, without maps {without}");
    assert_eq!(tab.console, Vec::<String>::new());
    server.assert_healthy();
}

/// Largest FLIP error of the first stage's picture against the settled native one: it has neither textures nor shadows.
const MAX_PREVIEW_FLIP: f64 = 0.25;

#[test]
fn a_preview_is_drawn_before_the_client_is_there() {
    let tab = tab_with(PICTURE_PX, WEBGPU_AND_WEBGL);
    let (Some(mut tab), Some(mut headless)) = (tab, headless()) else { return };
    // Without WebAssembly only the first stage draws.
    let folder = tempfile::tempdir().unwrap();
    for file in std::fs::read_dir(built_page()).unwrap() {
        let file = file.unwrap();
        let name = file.file_name().into_string().unwrap();
        if !name.contains(".wasm") {
            std::fs::copy(file.path(), folder.path().join(name)).unwrap();
        }
    }
    let scene = TestScene::small();
    let page = PageSetting::Loaded(Page::load(folder.path()).unwrap());
    let server =
        Server::start_with(scene.source(), SessionSettings::default(), |options| options.page = page);
    tab.navigate(&server.page_url());
    tab.wait("the preview is drawn", STATS, |stats| stats["preview_ms"].is_f64());
    // WebGL keeps a picture only until the end of the task that drew it.
    let drawn = "lodestream.preview.then((preview) => new Promise((done) => {
        preview.draw();
        document.getElementById('preview').toBlob(done);
    }))";
    let preview = image(&mut tab, drawn);
    let native = draw(&mut headless, scene.whole());
    let covered = native.covered.clone();
    let shown = Picture { image: preview.clone(), covered };
    keep(&shown, "tab-preview");
    assert_eq!(preview.dimensions(), native.image.dimensions());
    let flip = image_error(&preview, &native.image).unwrap().flip;
    println!("FLIP {flip}");
    assert!(flip <= MAX_PREVIEW_FLIP, "{flip}");
    let eye = "lodestream.preview.then((preview) => preview.camera.slice(0, 3))";
    let before = tab.evaluate(eye);
    drag(&mut tab, [200.0, 150.0], [260.0, 170.0]);
    tab.wait("the preview turns", eye, |after| *after != before);
    // The whole page draws it, then removes it.
    let whole = serve(scene);
    tab.navigate("about:blank");
    let stats = settle(&mut tab, &whole.page_url());
    let [early, full] =
        ["preview_ms", "ttff_presented_since_navigation_ms"].map(|name| stats[name].as_f64().unwrap());
    assert!(early <= full, "{stats}");
    assert_eq!(tab.evaluate("document.getElementById('preview')"), Value::Null);
    whole.assert_healthy();
}

#[test]
fn a_tab_streams_over_each_transport() {
    let Some(mut tab) = tab(PICTURE_PX) else { return };
    let scene = TestScene::small();
    let server = serve(scene);
    for transport in ["webtransport", "ws"] {
        tab.navigate("about:blank");
        let stats = settle(&mut tab, &format!("{}#transport={transport}", server.page_url()));
        assert_eq!(stats["transport"], transport, "{stats}");
        assert_eq!(stats["decode_failures"].as_f64(), Some(0.0), "{stats}");
    }
    // Without QUIC the page falls back, without being told to.
    let page = PageSetting::Loaded(Page::load(&built_page()).unwrap());
    let without_udp = Server::start_with(scene.source(), SessionSettings::default(), |options| {
        options.page = page;
        options.listen = None;
    });
    let stats = settle(&mut tab, &without_udp.page_url());
    assert_eq!(stats["transport"], "ws", "{stats}");
    assert_eq!(tab.console, Vec::<String>::new());
    server.assert_healthy();
}

/// The file of one of the page's scripts.
pub(super) fn script(name: &str) -> String {
    let files = std::fs::read_dir(built_page()).unwrap().map(|entry| entry.unwrap().file_name());
    let begins = format!("{name}-");
    let mut names = files.map(|file| file.into_string().unwrap());
    names.find(|file| file.starts_with(&begins) && file.ends_with(".js")).expect("the page has the script")
}

/// Runs the page's decoder of texture levels on a file that is `height_map`, `planes` or another picture; the texels as
/// numbers, or the error's text.
fn decoded(tab: &mut Tab, file: &[u8], [width, height]: [u32; 2], what: &str) -> Value {
    let (script, file) = (script("pictures"), BASE64.encode(file));
    tab.evaluate(&format!(
        "import('/{script}').then(({{ decode }}) => decode({{
            file: Uint8Array.from(atob('{file}'), (c) => c.charCodeAt(0)),
            width: {width}, height: {height}, {what}: true,
        }})).then(
            ({{ bitmap, texels, bits }}) => {{
                if (texels) return Array.from(bits === 16 ? new Uint16Array(texels.buffer) : texels);
                const canvas = new OffscreenCanvas(bitmap.width, bitmap.height).getContext('2d');
                canvas.drawImage(bitmap, 0, 0);
                return Array.from(canvas.getImageData(0, 0, bitmap.width, bitmap.height).data);
            }},
            (why) => String(why),
        )"
    ))
}

#[test]
fn texture_levels_decode_in_a_tab_as_they_do_natively() {
    use image::{DynamicImage, ImageBuffer, ImageFormat, Luma};
    let Some(mut tab) = tab(PICTURE_PX) else { return };
    let server = serve(TestScene::small());
    tab.navigate(&server.page_url());
    tab.wait("the page is there", "document.readyState", |state| state == "complete");
    let encoded = |image: DynamicImage, format| {
        let mut file = std::io::Cursor::new(Vec::new());
        image.write_to(&mut file, format).unwrap();
        file.into_inner()
    };
    let png = |image| encoded(image, ImageFormat::Png);
    let size = [13, 9];
    let deep = ImageBuffer::from_fn(13, 9, |x, y| Luma([(x * x * 977 + y * 7919) as u16]));
    let flat = ImageBuffer::from_fn(13, 9, |x, y| Luma([(x * x * 3 + y * 29) as u8]));
    let colours = ImageBuffer::from_fn(13, 9, |x, y| image::Rgb([x as u8 * 19, y as u8 * 28, 200]));
    let of_deep = png(DynamicImage::ImageLuma16(deep.clone()));
    assert_eq!(decoded(&mut tab, &of_deep, size, "height_map"), json!(deep.into_raw()));
    let of_flat = png(DynamicImage::ImageLuma8(flat.clone()));
    assert_eq!(decoded(&mut tab, &of_flat, size, "height_map"), json!(flat.into_raw()));
    let colours = DynamicImage::ImageRgb8(colours);
    let of_colours = png(colours.clone());
    assert_eq!(decoded(&mut tab, &of_colours, size, "picture"), json!(colours.into_rgba8().into_raw()));
    // Of planes the first bytes of pixels count.
    let grey = ImageBuffer::from_fn(13, 18, |x, y| image::Rgb([(x * x + y * 13) as u8; 3]));
    let of_planes = encoded(DynamicImage::ImageRgb8(grey.clone()), ImageFormat::WebP);
    let pixels = decoded(&mut tab, &of_planes, [13, 18], "planes");
    let first: Vec<&Value> = pixels.as_array().unwrap().iter().step_by(4).collect();
    assert_eq!(json!(first), json!(grey.pixels().map(|pixel| pixel.0[0]).collect::<Vec<u8>>()));
    // Damaged, cut, and of another size: errors, as natively.
    for (file, size, what) in [
        (&of_deep[..of_deep.len() / 2], size, "height_map"),
        (&of_deep, [13, 8], "height_map"),
        (&of_deep, [13, 10], "height_map"),
        (&of_colours, size, "height_map"),
        (b"no picture", size, "picture"),
        (&of_colours, [13, 8], "picture"),
        (&of_planes, size, "planes"),
        (&of_planes[..40], [13, 18], "planes"),
    ] {
        assert!(decoded(&mut tab, file, size, what).is_string(), "{size:?} {what}");
    }
    server.assert_healthy();
}

/// The camera's ten numbers.
pub(super) fn camera(tab: &mut Tab) -> Vec<f64> {
    let value = tab.evaluate(CAMERA);
    serde_json::from_value(value).unwrap()
}

/// Waits until the camera satisfies a condition, and returns it.
pub(super) fn moved(tab: &mut Tab, what: &str, holds: impl Fn(&[f64]) -> bool) -> Vec<f64> {
    let numbers = |value: &Value| serde_json::from_value::<Vec<f64>>(value.clone()).unwrap();
    numbers(&tab.wait(what, CAMERA, |value| holds(&numbers(value))))
}

pub(super) fn distance(camera: &[f64]) -> f64 {
    (0..3).map(|axis| (camera[axis] - camera[3 + axis]).powi(2)).sum::<f64>().sqrt()
}

pub(super) fn mouse(tab: &mut Tab, kind: &str, [x, y]: [f64; 2], more: Value) {
    let mut event = json!({ "type": kind, "x": x, "y": y });
    for (name, value) in more.as_object().unwrap() {
        event[name] = value.clone();
    }
    tab.call("Input.dispatchMouseEvent", event);
}

/// Presses the key of a letter.
pub(super) fn press(tab: &mut Tab, letter: char) {
    for kind in ["keyDown", "keyUp"] {
        let (code, key) = (format!("Key{letter}"), letter.to_ascii_lowercase().to_string());
        let event = json!({ "type": kind, "code": code, "key": key, "windowsVirtualKeyCode": letter as u32 });
        tab.call("Input.dispatchKeyEvent", event);
    }
}

/// Drags with the left button.
pub(super) fn drag(tab: &mut Tab, from: [f64; 2], to: [f64; 2]) {
    mouse(tab, "mousePressed", from, json!({ "button": "left", "buttons": 1, "clickCount": 1 }));
    mouse(tab, "mouseMoved", to, json!({ "button": "left", "buttons": 1 }));
    mouse(tab, "mouseReleased", to, json!({ "button": "left", "clickCount": 1 }));
}

pub(super) fn touch(tab: &mut Tab, kind: &str, points: &[[f64; 2]]) {
    let points: Vec<Value> =
        points.iter().enumerate().map(|(id, [x, y])| json!({ "x": x, "y": y, "id": id })).collect();
    tab.call("Input.dispatchTouchEvent", json!({ "type": kind, "touchPoints": points }));
}

#[test]
fn drag_wheel_pinch_and_keys_move_the_camera() {
    let Some(mut tab) = tab(PICTURE_PX) else { return };
    let server = serve(TestScene::small());
    settle(&mut tab, &server.page_url());
    let start = camera(&mut tab);

    drag(&mut tab, [300.0, 200.0], [360.0, 200.0]);
    let turned = moved(&mut tab, "a drag turns the camera", |camera| camera[..3] != start[..3]);
    assert!((distance(&turned) - distance(&start)).abs() < 1e-6, "a drag keeps the distance");
    assert_eq!(turned[3..6], start[3..6]);

    mouse(&mut tab, "mouseWheel", [300.0, 200.0], json!({ "deltaX": 0, "deltaY": -300 }));
    let expected = distance(&turned) * 0.88_f64.powi(3);
    let is_at = |camera: &[f64], far: f64, by: f64| (distance(camera) - far).abs() < by * far;
    let near = moved(&mut tab, "the wheel comes nearer", |camera| is_at(camera, expected, 1e-6));

    touch(&mut tab, "touchStart", &[[250.0, 180.0], [350.0, 180.0]]);
    touch(&mut tab, "touchMove", &[[200.0, 180.0], [400.0, 180.0]]);
    touch(&mut tab, "touchEnd", &[]);
    let half = distance(&near) / 2.0;
    moved(&mut tab, "fingers twice as far apart halve the distance", |camera| is_at(camera, half, 0.01));

    press(&mut tab, 'R');
    let is_start = |camera: &[f64]| camera.iter().zip(&start).all(|(a, b)| (a - b).abs() < 1e-6);
    moved(&mut tab, "R returns to the start", is_start);
    server.assert_healthy();
}

#[test]
fn without_webgpu_the_page_names_browsers_that_have_it() {
    let Some(mut tab) = tab(PICTURE_PX) else { return };
    let server = serve(TestScene::small());
    // None at all, and a device that the browser does not use.
    let mut scripts = Vec::new();
    for without in [
        "Object.defineProperty(Navigator.prototype, 'gpu', { get: () => undefined })",
        // The first, blank document may have no such class.
        "if (globalThis.GPU) GPU.prototype.requestAdapter = async () => null",
    ] {
        for script in scripts.drain(..) {
            tab.call("Page.removeScriptToEvaluateOnNewDocument", json!({ "identifier": script }));
        }
        let added = tab.call("Page.addScriptToEvaluateOnNewDocument", json!({ "source": without }));
        scripts.push(added["identifier"].clone());
        tab.navigate("about:blank");
        tab.navigate(&server.page_url());
        let shown = "document.getElementById('message')?.textContent ?? ''";
        let text =
            tab.wait("the page says so", shown, |text| text.as_str().is_some_and(|t| t.contains("WebGPU")));
        assert_names_browsers(&text);
        // The session that began meanwhile has ended.
        server.wait_for_sessions(0);
    }
    assert_eq!(tab.console, Vec::<String>::new());
    server.assert_healthy();
}
