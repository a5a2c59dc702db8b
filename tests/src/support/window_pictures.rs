//! What a window shows, compared with pictures.

use std::path::Path;
use std::time::{Duration, Instant};

use image::RgbImage;

use super::program::{RUN_LIMIT, SIZE_PX};
use super::x11::OpenWindow;

/// Largest share of pixels in which a window and a headless picture of the same view differ: edges that are rounded
/// otherwise. A part covers five times as many.
pub(crate) const OTHER_PIXELS: f64 = 0.004;

/// Share of the pixels that differ.
pub(crate) fn differing(a: &RgbImage, b: &RgbImage) -> f64 {
    let differ = |(a, b): (&image::Rgb<u8>, &image::Rgb<u8>)| (0..3).any(|i| a.0[i].abs_diff(b.0[i]) > 6);
    let count = a.pixels().zip(b.pixels()).filter(|pixels| differ(*pixels)).count();
    count as f64 / f64::from(a.width() * a.height())
}

/// Waits until the window shows a picture.
pub(crate) fn wait_for(window: &OpenWindow, what: &str, expected: &RgbImage) {
    wait(window, what, |shown| differing(shown, expected) <= OTHER_PIXELS);
}

/// Waits until the window shows another picture than one, and returns it.
pub(crate) fn wait_for_another(window: &OpenWindow, what: &str, than: &RgbImage) -> RgbImage {
    wait_for_share(window, what, than, 5.0 * OTHER_PIXELS)
}

/// As [`wait_for_another`], with the least share of pixels that differ.
pub(crate) fn wait_for_share(window: &OpenWindow, what: &str, than: &RgbImage, least: f64) -> RgbImage {
    wait(window, what, |shown| differing(shown, than) >= least)
}

/// Waits until the window shows what is wanted, and returns it.
pub(crate) fn wait(window: &OpenWindow, what: &str, is_wanted: impl Fn(&RgbImage) -> bool) -> RgbImage {
    let until = Instant::now() + RUN_LIMIT;
    loop {
        let shown = window.picture(SIZE_PX);
        if is_wanted(&shown) {
            return shown;
        }
        if Instant::now() >= until {
            let kept = std::env::temp_dir().join("lodestream-window.png");
            shown.save(&kept).unwrap();
            panic!("{what}: the window shows something else: {}", kept.display());
        }
        std::thread::sleep(Duration::from_millis(20));
    }
}

/// Waits until the window has written a picture.
pub(crate) fn wait_for_file(path: &Path) -> RgbImage {
    let until = Instant::now() + RUN_LIMIT;
    // The file is empty until its picture is written.
    loop {
        match image::open(path) {
            Ok(picture) => return picture.into_rgb8(),
            Err(why) => assert!(Instant::now() < until, "no picture is written: {why}"),
        }
        std::thread::sleep(Duration::from_millis(20));
    }
}
