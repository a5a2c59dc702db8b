//! Sizes, formats, colour averages and refusals.

mod ktx2;
mod maps;
mod quality;
mod strips;

use std::io::Cursor;
use std::path::PathBuf;

use image::{DynamicImage, GrayImage, ImageFormat, Luma, Rgb, RgbImage, Rgba, RgbaImage};
use tempfile::TempDir;

use super::*;
use crate::model::{Channel, Component};
use lodestream_geometry::pool::Serial;
use lodestream_scene::asset::TextureInfo;

/// On one thread.
fn load(source: &TextureSource) -> Result<Texture, TextureError> {
    super::load(source, TextureSettings::default(), &Serial)
}

/// An image as clients decode it.
fn decoded(texture: &Texture, file: &[u8]) -> RgbaImage {
    let image = image::load_from_memory(file).unwrap();
    let info = TextureInfo {
        kind: texture.kind,
        width: texture.width_px,
        height: texture.height_px,
        planes: texture.planes,
        mean: texture.mean,
        uv_per_unit: 0.0,
        levels: Vec::new(),
    };
    let Some(planes) = info.planes().filter(|_| file.starts_with(b"RIFF")) else { return image.into_rgba8() };
    let picture = image.into_rgb8();
    let height = picture.height() / planes.stacked([1, 1])[1];
    let texels = planes.texels(picture.as_raw().as_chunks::<3>().0);
    RgbaImage::from_raw(picture.width(), height, texels).unwrap()
}

fn save(dir: &TempDir, name: &str, image: impl Into<DynamicImage>) -> PathBuf {
    let path = dir.path().join(name);
    image.into().save(&path).unwrap();
    path
}

fn color(path: PathBuf) -> TextureSource {
    TextureSource::Color { image: Some(path.into()), opacity: None, used: Opacity::Blended }
}

fn noise(x: u32, y: u32) -> u8 {
    (x.wrapping_mul(0x9E37_79B9) ^ y.wrapping_mul(0x85EB_CA6B)).wrapping_mul(0xC2B2_AE35).to_be_bytes()[0]
}

/// A thread for each task, the last started first.
struct Backwards;

impl Pool for Backwards {
    fn run(&self, count: usize, task: &(dyn Fn(usize) + Sync)) {
        std::thread::scope(|scope| {
            for i in (0..count).rev() {
                scope.spawn(move || task(i));
            }
        });
    }
}

#[test]
fn levels_halve_from_coarse_to_fine_and_are_the_same_every_time() {
    let dir = TempDir::new().unwrap();
    let image = RgbImage::from_fn(100, 37, |x, y| Rgb([noise(x, y), noise(y, x), 9]));
    let path = save(&dir, "a.png", image);
    let texture = load(&color(path.clone())).unwrap();
    let sizes: Vec<_> = texture
        .levels
        .iter()
        .map(|images| image::load_from_memory(&images[0]).map(|i| (i.width(), i.height())).unwrap())
        .collect();
    assert_eq!(sizes, [(6, 2), (12, 4), (25, 9), (50, 18), (100, 37)]);
    assert_eq!((texture.width_px, texture.height_px, texture.transparency), (100, 37, Transparency::None));
    // As on several threads that take the levels in any order.
    assert_eq!(super::load(&color(path), TextureSettings::default(), &Backwards).unwrap(), texture);
}

#[test]
fn colours_are_averaged_in_linear_light() {
    let dir = TempDir::new().unwrap();
    let image = RgbImage::from_fn(16, 16, |x, y| Rgb([if (x + y) % 2 == 0 { 255 } else { 0 }; 3]));
    let texture = load(&color(save(&dir, "a.png", image))).unwrap();
    let coarse = image::load_from_memory(&texture.levels[0][0]).unwrap().to_rgb8();
    // Half the light is 188 in sRGB, not 128.
    assert!(coarse.pixels().all(|p| p.0 == [188; 3]), "{:?}", coarse.get_pixel(0, 0));
}

#[test]
fn noisy_colour_is_webp_finely_coloured_jpeg_and_flat_png() {
    let dir = TempDir::new().unwrap();
    let format = |texture: &Texture| image::guess_format(&texture.levels.last().unwrap()[0]).unwrap();
    let noisy =
        RgbImage::from_fn(64, 64, |x, y| Rgb([noise(x, y), noise(x, y), noise(x, y) - noise(x, y) / 64]));
    let texture = load(&color(save(&dir, "n.png", noisy))).unwrap();
    assert_eq!(format(&texture), ImageFormat::WebP);
    let colourful = RgbImage::from_fn(64, 64, |x, y| Rgb([noise(x, y), noise(y, x), noise(x + 7, y)]));
    let texture = load(&color(save(&dir, "j.png", colourful))).unwrap();
    assert_eq!(format(&texture), ImageFormat::Jpeg);
    let flat = load(&color(save(&dir, "f.png", RgbImage::new(64, 64)))).unwrap();
    assert_eq!(format(&flat), ImageFormat::Png);
    let clear = RgbaImage::from_fn(64, 64, |x, y| Rgba([noise(x, y), 0, 0, if x < 32 { 0 } else { 255 }]));
    let texture = load(&color(save(&dir, "c.png", clear))).unwrap();
    assert_eq!(texture.transparency, Transparency::Holes);
    assert_eq!(format(&texture), ImageFormat::WebP);
}

/// Waves of all three channels, some 30 texels long.
fn waves(side: u32) -> RgbImage {
    let wave =
        |a: u32, b: u32| (127.5 + 100.0 * (f64::from(a) / 5.0).sin() * (f64::from(b) / 7.0).cos()) as u8;
    RgbImage::from_fn(side, side, |x, y| Rgb([wave(x, y), wave(y, x + 9), wave(x + y, 3)]))
}

#[test]
fn webp_changes_colours_by_little_and_keeps_opacity() {
    let dir = TempDir::new().unwrap();
    let opaque = waves(96);
    let seen = |x: u32, y: u32| if (x / 13 + y / 11).is_multiple_of(3) { 0 } else { (55 + x + y) as u8 };
    let clear = RgbaImage::from_fn(96, 96, |x, y| {
        let [r, g, b] = opaque.get_pixel(x, y).0;
        Rgba([r, g, b, seen(x, y)])
    });
    for (name, image) in [("o.png", DynamicImage::from(opaque)), ("c.png", clear.into())] {
        let image = image.into_rgba8();
        let texture = load(&color(save(&dir, name, image.clone()))).unwrap();
        let file = &texture.levels.last().unwrap()[0];
        assert_eq!(image::guess_format(file).unwrap(), ImageFormat::WebP);
        let coded = image::load_from_memory(file).unwrap().into_rgba8();
        let (mut sum, mut count) = (0, 0);
        for (a, b) in image.pixels().zip(coded.pixels()) {
            assert_eq!(a.0[3], b.0[3]);
            if a.0[3] > 0 {
                let off = |c: usize| u32::from(a.0[c].abs_diff(b.0[c]));
                sum += off(0) + off(1) + off(2);
                count += 3;
            }
        }
        assert!(sum < 4 * count, "{name}: {} of 255 in the mean", f64::from(sum) / f64::from(count));
    }
}

#[test]
fn png_is_tried_where_a_sample_of_large_pictures_suggests_it() {
    let dir = TempDir::new().unwrap();
    let format = |name: &str, image: RgbImage| {
        image::guess_format(&load(&color(save(&dir, name, image))).unwrap().levels.last().unwrap()[0])
            .unwrap()
    };
    assert_eq!(format("w.png", waves(400)), ImageFormat::WebP);
    let checks = RgbImage::from_fn(400, 400, |x, y| Rgb([255 * ((x ^ y) % 2) as u8, 0, 90]));
    assert_eq!(format("s.png", checks), ImageFormat::Png);
}

#[test]
fn webp_files_are_read_with_and_without_loss() {
    let dir = TempDir::new().unwrap();
    let image = RgbaImage::from_fn(40, 24, |x, y| Rgba([x as u8 * 6, y as u8 * 10, 7, 255 - x as u8]));
    let lossless = load(&color(save(&dir, "a.webp", image.clone()))).unwrap();
    assert_eq!(lossless, load(&color(save(&dir, "a.png", image.clone()))).unwrap());
    let lossy = super::webp::with_alpha(&image, (40, 24), TextureSettings::default()).unwrap();
    let path = dir.path().join("named wrongly.png");
    std::fs::write(&path, &lossy).unwrap();
    let texture = load(&color(path.clone())).unwrap();
    assert_eq!((texture.width_px, texture.height_px, texture.transparency), (40, 24, Transparency::Graded));
    std::fs::write(&path, &lossy[..lossy.len() / 2]).unwrap();
    let cut = load(&color(path)).unwrap_err().to_string();
    assert!(cut.contains("not a readable PNG, JPEG, WebP, AVIF or KTX2") && !cut.contains('\n'), "{cut}");
}

#[test]
fn invisible_colours_do_not_bleed() {
    let dir = TempDir::new().unwrap();
    let image =
        RgbaImage::from_fn(
            16,
            16,
            |x, _| if x % 2 == 0 { Rgba([200, 0, 0, 255]) } else { Rgba([0, 255, 0, 0]) },
        );
    let texture = load(&color(save(&dir, "a.png", image))).unwrap();
    let coarse = image::load_from_memory(&texture.levels[0][0]).unwrap().to_rgba8();
    assert!(coarse.pixels().all(|p| p.0 == [200, 0, 0, 128]), "{:?}", coarse.get_pixel(0, 0));
}

#[test]
fn heights_are_lossless_in_their_own_depth() {
    let dir = TempDir::new().unwrap();
    let shallow = GrayImage::from_fn(32, 32, |x, y| Luma([noise(x, y)]));
    let texture = load(&TextureSource::Height(save(&dir, "8.png", shallow.clone()).into())).unwrap();
    assert_eq!(image::load_from_memory(&texture.levels[2][0]).unwrap(), DynamicImage::from(shallow));
    let deep =
        image::ImageBuffer::<Luma<u16>, _>::from_fn(32, 32, |x, y| Luma([u16::from(noise(x, y)) * 251 + 3]));
    let texture = load(&TextureSource::Height(save(&dir, "16.png", deep.clone()).into())).unwrap();
    assert_eq!(image::load_from_memory(&texture.levels[2][0]).unwrap(), DynamicImage::from(deep));
    assert_eq!(texture.levels.len(), 3);
}

#[test]
fn a_normal_map_is_not_taken_for_heights() {
    let dir = TempDir::new().unwrap();
    let path = save(&dir, "n.png", RgbImage::from_pixel(8, 8, Rgb([128, 127, 255])));
    let message = load(&TextureSource::Height(path.clone().into())).unwrap_err().to_string();
    assert!(message.contains("normal map"), "{message}");
}

#[test]
fn bad_files_say_what_is_wrong_in_one_line() {
    let dir = TempDir::new().unwrap();
    let missing = load(&color(dir.path().join("none.png"))).unwrap_err().to_string();
    assert!(missing.contains("none.png: cannot be read"), "{missing}");
    let path = dir.path().join("noise.png");
    std::fs::write(&path, [7; 100]).unwrap();
    let noise = load(&color(path.clone())).unwrap_err().to_string();
    assert!(noise.contains("not a readable PNG, JPEG, WebP, AVIF or KTX2"), "{noise}");
    let mut truncated = Vec::new();
    let image = DynamicImage::from(RgbImage::from_fn(64, 64, |x, y| Rgb([noise_of(x), noise_of(y), 0])));
    image.write_to(&mut Cursor::new(&mut truncated), ImageFormat::Png).unwrap();
    truncated.truncate(truncated.len() / 2);
    std::fs::write(&path, truncated).unwrap();
    let cut = load(&color(path.clone())).unwrap_err().to_string();
    assert!(cut.contains("noise.png") && !cut.contains('\n'), "{cut}");
}

fn noise_of(x: u32) -> u8 {
    noise(x, x + 1)
}

#[test]
fn avif_files_are_read_whatever_they_are_called() {
    let dir = TempDir::new().unwrap();
    let path = dir.path().join("photo.png");
    std::fs::write(&path, include_bytes!("../avif/ramp-alpha.avif")).unwrap();
    let texture = load(&color(path.clone())).unwrap();
    assert_eq!((texture.width_px, texture.height_px), (37, 22));
    std::fs::write(&path, b"\0\0\0\x1cftypavif\0\0\0\0mif1avif").unwrap();
    let avif = load(&color(path)).unwrap_err().to_string();
    assert!(avif.contains("photo.png") && avif.contains("cut short"), "{avif}");
}

#[test]
fn absurd_sizes_are_refused_before_decoding() {
    let dir = TempDir::new().unwrap();
    let path = dir.path().join("huge.png");
    // A PNG header suffices: nothing after it may be read.
    let write = |width, height, interlaced| {
        let mut header = Vec::new();
        png_header(&mut header, (width, height), interlaced);
        std::fs::write(&path, header).unwrap();
    };
    write(MAX_SIDE_PX + 1, 1, 0);
    let error = load(&color(path.clone())).unwrap_err();
    assert!(matches!(error, TextureError::TooLarge { .. }), "{error}");
    assert!(error.to_string().contains("scale it down"));
    // Larger than what may be decoded as a whole.
    write(MAX_SIDE_PX, MAX_SIDE_PX, 1);
    let whole = load(&color(path.clone())).unwrap_err();
    write(MAX_SIDE_PX, MAX_SIDE_PX, 0);
    let heights = load(&TextureSource::Height(path.clone().into())).unwrap_err();
    let combined = load(&TextureSource::Color {
        image: Some(path.clone().into()),
        opacity: Some(Channel::plain(path.clone().into(), Component::Red)),
        used: Opacity::Blended,
    });
    for error in [whole, heights, combined.unwrap_err()] {
        assert!(matches!(error, TextureError::TooLong { .. }), "{error}");
        assert!(error.to_string().contains("make it a PNG that is not interlaced"), "{error}");
    }
}

fn png_header(out: &mut Vec<u8>, (width, height): (u32, u32), interlaced: u8) {
    let tiny = RgbImage::new(1, 1);
    DynamicImage::from(tiny).write_to(&mut Cursor::new(&mut *out), ImageFormat::Png).unwrap();
    out[16..20].copy_from_slice(&width.to_be_bytes());
    out[20..24].copy_from_slice(&height.to_be_bytes());
    out[28] = interlaced;
    let crc = crc32(&out[12..29]);
    out[29..33].copy_from_slice(&crc.to_be_bytes());
}

fn crc32(bytes: &[u8]) -> u32 {
    let mut crc = flate2::Crc::new();
    crc.update(bytes);
    crc.sum()
}
