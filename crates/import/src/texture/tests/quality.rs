//! Errors of JPEG in normal and surface maps, compared with PNG. With $LODESTREAM_MODELS, maps of the model
//! FlightHelmet too.
//!
//! ```sh
//! LODESTREAM_MODELS=… cargo test --release -p lodestream-import quality -- --nocapture
//! ```

use std::path::Path;

use image::{ExtendedColorType, Rgb, RgbImage};

use super::super::encode::Rectangle;
use super::super::{normal, surface};
use super::noise;

const SIDE_PX: u32 = 128;

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

fn jpeg(image: &RgbImage, quality: u8) -> (RgbImage, usize) {
    let bytes = whole(image).jpeg(quality).unwrap();
    (image::load_from_memory(&bytes).unwrap().to_rgb8(), bytes.len())
}

fn vector(pixel: &Rgb<u8>) -> [f64; 3] {
    let vector = pixel.0.map(|c| f64::from(c) / 127.5 - 1.0);
    let length = vector.iter().map(|c| c * c).sum::<f64>().sqrt().max(1e-9);
    vector.map(|c| c / length)
}

/// Mean, 99th percentile and maximum of the angles between two maps, in degrees.
fn angles(a: &RgbImage, b: &RgbImage) -> [f64; 3] {
    let angle = |(a, b): (&Rgb<u8>, &Rgb<u8>)| {
        let (a, b) = (vector(a), vector(b));
        let dot: f64 = a.iter().zip(b).map(|(a, b)| a * b).sum();
        dot.clamp(-1.0, 1.0).acos().to_degrees()
    };
    spread(a.pixels().zip(b.pixels()).map(angle).collect())
}

fn spread(mut values: Vec<f64>) -> [f64; 3] {
    values.sort_by(f64::total_cmp);
    let mean = values.iter().sum::<f64>() / values.len() as f64;
    [mean, values[values.len() * 99 / 100], values[values.len() - 1]]
}

#[test]
fn jpeg_turns_normals_by_less_than_is_seen() {
    let maps = generated().map(|(name, map)| (name.to_owned(), map));
    for (name, map) in maps.into_iter().chain(real("Normal.png")) {
        let lossless = whole(&map).png().unwrap().len();
        for quality in [85, 90, 95] {
            let (coded, bytes) = jpeg(&map, quality);
            let [mean, most, max] = angles(&map, &coded);
            println!("{name} {quality}: {bytes} of {lossless} bytes, {mean:.2} {most:.2} {max:.2} degrees");
            if quality == normal::JPEG_QUALITY {
                // The noise is as strong as the slopes, so it hides larger errors.
                assert!(mean < if name == "rough" { 5.0 } else { 2.5 }, "{name}: {mean}");
            }
        }
    }
}

#[test]
fn jpeg_changes_surfaces_by_less_than_is_seen() {
    for (name, map) in real("OcclusionRoughMetal.png") {
        let lossless = whole(&map).png().unwrap().len();
        for quality in [80, 85, 90] {
            let (coded, bytes) = jpeg(&map, quality);
            let off = |c: usize| {
                let pairs = map.pixels().zip(coded.pixels());
                spread(pairs.map(|(a, b)| f64::from(a.0[c].abs_diff(b.0[c]))).collect())
            };
            let [occlusion, roughness, metal] = [0, 1, 2].map(off);
            println!(
                "{name} {quality}: {bytes} of {lossless} bytes, {occlusion:.1?} {roughness:.1?} {metal:.1?}"
            );
            if quality == surface::JPEG_QUALITY {
                assert!(roughness[0] < 3.0 && metal[0] < 3.0, "{name}: {roughness:?} {metal:?}");
            }
        }
    }
}
