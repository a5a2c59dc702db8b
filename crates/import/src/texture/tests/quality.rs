//! Errors of normal and surface maps, compared with JPEG of three full channels. With $LODESTREAM_MODELS, maps of the
//! model FlightHelmet too.
//!
//! ```sh
//! LODESTREAM_MODELS=… cargo test --release -p lodestream-import quality -- --nocapture
//! ```

use std::path::Path;

use image::{ExtendedColorType, Rgb, RgbImage, RgbaImage};
use lodestream_scene::asset::NORMAL_PLANES;

use super::super::encode::Rectangle;
use super::super::{TextureKind, TextureQuality, TextureSettings, webp};
use super::{Texture, Transparency, decoded, noise};

const SIDE_PX: u32 = 128;
/// Qualities of the JPEGs that are compared.
const NORMAL_JPEG: u8 = 90;
const SURFACE_JPEG: u8 = 85;

/// A normal map of 8 bits per channel from heights in texels.
fn normals(height: impl Fn(f64, f64) -> f64) -> RgbImage {
    RgbImage::from_fn(SIDE_PX, SIDE_PX, |x, y| {
        let (x, y) = (f64::from(x), f64::from(y));
        let slope = [height(x + 0.5, y) - height(x - 0.5, y), height(x, y + 0.5) - height(x, y - 0.5)];
        // y is upwards, rows run down.
        let vector = [-slope[0], slope[1], 1.0];
        let length = vector.iter().map(|c| c * c).sum::<f64>().sqrt();
        Rgb(vector.map(|c| ((c / length + 1.0) * 127.5).round() as u8))
    })
}

/// Waves, bricks with edges two texels wide, and noise on waves.
fn generated() -> [(&'static str, RgbImage); 3] {
    let waves = |x: f64, y: f64| 6.0 * (x / 9.0).sin() * (y / 13.0).cos();
    let bricks = |x: f64, y: f64| {
        let shift = if (y / 32.0).floor() % 2.0 == 0.0 { 0.0 } else { 32.0 };
        let edge = |at: f64, size: f64| (at.rem_euclid(size)).min(size - at.rem_euclid(size));
        edge(x + shift, 64.0).min(edge(y, 32.0)).min(3.0)
    };
    let rough = |x: f64, y: f64| waves(x, y) + f64::from(noise((2.0 * x) as u32, (2.0 * y) as u32)) / 600.0;
    [("waves", normals(waves)), ("bricks", normals(bricks)), ("rough", normals(rough))]
}

/// Occlusion in folds, worn roughness, and spots of metal.
fn surface() -> RgbImage {
    RgbImage::from_fn(SIDE_PX, SIDE_PX, |x, y| {
        let wave = |at: u32, length: f64| (f64::from(at) / length).sin();
        let open = 200.0 + 55.0 * wave(x, 7.0) * wave(y, 11.0);
        let worn = 120.0 + 60.0 * wave(x + y, 9.0) + f64::from(noise(x / 2, y / 2)) / 8.0;
        let metal = if wave(x, 5.0) * wave(y, 6.0) > 0.6 { 255 } else { 0 };
        Rgb([open as u8, worn as u8, metal])
    })
}

fn real(ending: &str) -> Vec<(String, RgbImage)> {
    let Some(models) = std::env::var_os("LODESTREAM_MODELS") else { return Vec::new() };
    let Ok(folder) = std::fs::read_dir(Path::new(&models).join("FlightHelmet")) else { return Vec::new() };
    let mut paths: Vec<_> = folder.filter_map(|entry| Some(entry.ok()?.path())).collect();
    paths.sort();
    paths.retain(|path| path.to_string_lossy().ends_with(ending));
    let name = |path: &Path| path.file_stem().unwrap().to_string_lossy().into_owned();
    paths.iter().map(|path| (name(path), image::open(path).unwrap().to_rgb8())).collect()
}

fn whole(image: &RgbImage) -> Rectangle<'_> {
    let (width, height) = image.dimensions();
    Rectangle { bytes: image, width, height, format: ExtendedColorType::Rgb8 }
}

fn jpeg(image: &RgbImage, quality: u8) -> (RgbaImage, usize) {
    let bytes = whole(image).jpeg(quality).unwrap();
    (image::load_from_memory(&bytes).unwrap().to_rgba8(), bytes.len())
}

/// The planes of an image in WebP, decoded, and their bytes.
fn stacked(image: &RgbImage, kind: TextureKind, quality: u8) -> (RgbaImage, usize) {
    let (width, height) = image.dimensions();
    let planes = if kind == TextureKind::Normal { NORMAL_PLANES } else { 7 };
    let count = planes.count_ones();
    let grey: Vec<u8> =
        (0..count as usize).flat_map(|c| image.pixels().map(move |pixel| pixel.0[c])).collect();
    let settings = TextureSettings { quality: quality.try_into().unwrap(), ..TextureSettings::default() };
    let file = webp::planes(&grey, (width, height * count), settings).unwrap();
    let texture = Texture {
        kind,
        width_px: width,
        height_px: height,
        planes,
        transparency: Transparency::None,
        mean: None,
        levels: Vec::new(),
    };
    (decoded(&texture, &file), file.len())
}

fn vector([x, y, z]: [u8; 3]) -> [f64; 3] {
    let vector = [x, y, z].map(|c| f64::from(c) / 127.5 - 1.0);
    let length = vector.iter().map(|c| c * c).sum::<f64>().sqrt().max(1e-9);
    vector.map(|c| c / length)
}

/// Mean, 99th percentile and maximum of the angles between two maps, in degrees.
fn angles(map: &RgbImage, coded: &RgbaImage) -> [f64; 3] {
    let angle = |(a, b): (&Rgb<u8>, &image::Rgba<u8>)| {
        let [x, y, z, _] = b.0;
        let (a, b) = (vector(a.0), vector([x, y, z]));
        let dot: f64 = a.iter().zip(b).map(|(a, b)| a * b).sum();
        dot.clamp(-1.0, 1.0).acos().to_degrees()
    };
    spread(map.pixels().zip(coded.pixels()).map(angle).collect())
}

/// Of each channel mean, 99th percentile and maximum of the differences.
fn differences(map: &RgbImage, coded: &RgbaImage) -> [[f64; 3]; 3] {
    let pairs = || map.pixels().zip(coded.pixels());
    [0, 1, 2].map(|c| spread(pairs().map(|(a, b)| f64::from(a.0[c].abs_diff(b.0[c]))).collect()))
}

fn spread(mut values: Vec<f64>) -> [f64; 3] {
    values.sort_by(f64::total_cmp);
    let mean = values.iter().sum::<f64>() / values.len() as f64;
    [mean, values[values.len() * 99 / 100], values[values.len() - 1]]
}

#[test]
fn planes_turn_normals_by_no_more_than_full_jpeg_in_fewer_bytes() {
    let maps = generated().map(|(name, map)| (name.to_owned(), map));
    for (name, map) in maps.into_iter().chain(real("Normal.png")) {
        let (full, longest) = jpeg(&map, NORMAL_JPEG);
        let [mean, most, max] = angles(&map, &full);
        println!("{name} JPEG {NORMAL_JPEG}: {longest} bytes, {mean:.2} {most:.2} {max:.2} degrees");
        for quality in [75, 80, 85, 90, 95] {
            let (coded, bytes) = stacked(&map, TextureKind::Normal, quality);
            let [ours, ours_most, ours_max] = angles(&map, &coded);
            println!("{name} {quality}: {bytes} bytes, {ours:.2} {ours_most:.2} {ours_max:.2} degrees");
            if quality == TextureQuality::default().get() {
                // Smooth maps have small errors in both.
                assert!(ours <= mean.max(1.5) && ours_most <= most.max(4.0), "{name}");
                assert!(bytes < longest, "{name}");
            }
        }
    }
}

#[test]
fn planes_change_surfaces_by_no_more_than_full_jpeg_in_fewer_bytes() {
    let maps = [("generated".to_owned(), surface())];
    for (name, map) in maps.into_iter().chain(real("OcclusionRoughMetal.png")) {
        let (full, longest) = jpeg(&map, SURFACE_JPEG);
        let theirs = differences(&map, &full);
        println!("{name} JPEG {SURFACE_JPEG}: {longest} bytes, {theirs:.1?}");
        for quality in [75, 80, 85, 90, 95] {
            let (coded, bytes) = stacked(&map, TextureKind::Surface, quality);
            let ours = differences(&map, &coded);
            println!("{name} {quality}: {bytes} bytes, {ours:.1?}");
            if quality == TextureQuality::default().get() {
                let worse = (0..3).find(|&c| ours[c][0] > theirs[c][0] || ours[c][1] > theirs[c][1]);
                assert!(worse.is_none() && bytes < longest, "{name}: channel {worse:?}");
            }
        }
    }
}
