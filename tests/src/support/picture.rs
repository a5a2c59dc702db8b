//! Pictures, and the comparison that decides whether two are equal.

use std::io::Write as _;

use image::RgbaImage;
use lodestream_client::core::Change;
use lodestream_render::image_compare::{Comparison, compare};
use lodestream_render::{Gpu, Headless, SceneView, Settings};
use lodestream_scene::animation::Moment;

use super::PICTURE_PX;

/// A picture, and which of its pixels show a surface.
pub(crate) struct Picture {
    pub(crate) image: RgbaImage,
    pub(crate) covered: Vec<bool>,
}

/// Whether tests that need a graphics adapter are skipped; prints a message if so.
pub(crate) fn skipped() -> bool {
    let skip = std::env::var("LODESTREAM_SKIP_GPU").is_ok_and(|v| v == "1");
    if skip {
        // Not `eprintln!`: the test runner would swallow it when the test "passes".
        let test = std::thread::current().name().unwrap_or("a test").to_owned();
        let _ = writeln!(std::io::stderr(), "SKIPPED, NOT PASSED (LODESTREAM_SKIP_GPU=1): {test}");
    }
    skip
}

/// A renderer, or `None` if tests that need a graphics adapter are skipped.
pub(crate) fn headless() -> Option<Headless> {
    headless_of(PICTURE_PX)
}

/// The same for pictures of another size.
pub(crate) fn headless_of([width, height]: [u32; 2]) -> Option<Headless> {
    if skipped() {
        return None;
    }
    let gpu = Gpu::headless().expect("these tests need a graphics adapter (or LODESTREAM_SKIP_GPU=1)");
    Some(Headless::new(gpu, width, height).unwrap())
}

/// Draws a renderer's changes from the scene's start camera, with all effects on, at a time after the end of every
/// morph.
pub(crate) fn draw(headless: &mut Headless, changes: Vec<Change>) -> Picture {
    draw_at(headless, changes, None)
}

/// The same at a time of a clip.
pub(crate) fn draw_at(headless: &mut Headless, changes: Vec<Change>, moment: Option<Moment>) -> Picture {
    let mut view = SceneView::new();
    view.push(changes);
    view.upload(headless.gpu(), headless.renderer(), usize::MAX, 0.0).unwrap();
    view.animate(headless.gpu(), moment).unwrap();
    let camera = view.header().expect("a scene").camera.pose();
    let settings = Settings::default();
    view.prepare_ground(headless.gpu(), &camera, headless.size(), 1.0, settings.shadows).unwrap();
    view.with_frame(camera, settings, f32::MAX, |frame| headless.frame(frame)).unwrap();
    Picture { image: headless.picture().unwrap(), covered: headless.coverage().unwrap() }
}

/// Compares pictures over the pixels that either covers, so that a hole counts.
pub(crate) fn comparison(a: &Picture, b: &Picture) -> Comparison {
    let mask: Vec<bool> = a.covered.iter().zip(&b.covered).map(|(a, b)| *a || *b).collect();
    compare(&a.image, &b.image, Some(&mask)).unwrap()
}

/// Whether two pictures count as equal.
pub(crate) fn same(comparison: &Comparison) -> bool {
    comparison.ssim >= 0.99
}

/// Writes a picture to a file for inspection.
pub(crate) fn keep(picture: &Picture, name: &str) {
    picture.image.save(file(name)).unwrap();
}

/// Writes a PNG file for inspection.
pub(crate) fn keep_file(png: &[u8], name: &str) {
    std::fs::write(file(name), png).unwrap();
}

/// Where a picture is kept.
fn file(name: &str) -> std::path::PathBuf {
    let target = std::env::var_os("CARGO_TARGET_DIR")
        .map_or_else(|| std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../target"), Into::into);
    let folder = target.join("pictures");
    std::fs::create_dir_all(&folder).unwrap();
    folder.join(format!("{name}.png"))
}
