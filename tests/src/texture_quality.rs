//! Bytes of textures against the error of the picture, by quality: where the default comes from. With $LODESTREAM_SCENE,
//! of a model or scene file too.
//!
//! ```sh
//! cargo test -p lodestream-tests texture_quality -- --ignored --nocapture
//! ```

use std::path::{Path, PathBuf};

use image::codecs::jpeg::JpegEncoder;
use image::{GrayImage, Luma, Rgb, RgbImage};
use lodestream_bake::scene::of_files;
use lodestream_render::Headless;
use lodestream_report::image_error::image_error;

use crate::support::picture::{Picture, draw, headless_of, keep};
use crate::support::scene::{TestScene, prepare_all};

/// At this size the globe has about a texel per pixel.
const SIZE_PX: [u32; 2] = [1280, 720];
const MAPS_PX: [u32; 2] = [2048, 1024];
const QUALITIES: [u8; 6] = [70, 75, 80, 85, 90, 95];
const LOSSLESS: u8 = 100;

/// A number from 0 to 1 of a point of a lattice, which repeats along x.
fn lattice([x, y]: [u32; 2], octave: u32) -> f64 {
    let mixed = x.wrapping_mul(0x9E37_79B9) ^ y.wrapping_mul(0x85EB_CA6B) ^ octave.wrapping_mul(0xC2B2_AE35);
    let mixed = (mixed ^ mixed >> 15).wrapping_mul(0x2C1B_3C6D);
    f64::from((mixed ^ mixed >> 12).wrapping_mul(0x297A_2D39) >> 8) / f64::from(1 << 24)
}

/// Noise of the octaves of 2^first to 2^(last − 1) cells along x, about from −1 to 1; amplitudes fall by 0.6.
fn noise([x, y]: [u32; 2], first: u32, last: u32) -> f64 {
    let mut total = 0.0;
    for octave in first..last {
        let cells = f64::from(1 << octave) / f64::from(MAPS_PX[0]);
        let at = [x, y].map(|c| (f64::from(c) + 0.5) * cells);
        let [u, v] = at.map(|c| c.fract() * c.fract() * (3.0 - 2.0 * c.fract()));
        let corner =
            |dx: u32, dy: u32| lattice([(at[0] as u32 + dx) % (1 << octave), at[1] as u32 + dy], octave);
        let row = |dy| corner(0, dy) * (1.0 - u) + corner(1, dy) * u;
        let value = row(0) * (1.0 - v) + row(1) * v;
        total += (2.0 * value - 1.0) * 0.6_f64.powi((octave - first) as i32);
    }
    total
}

/// Stone with veins and lichen, and grain of a texel.
fn colours() -> RgbImage {
    RgbImage::from_fn(MAPS_PX[0], MAPS_PX[1], |x, y| {
        let at = [x, y];
        let (tone, vein) = (120.0 + 40.0 * noise(at, 3, 10), (-60.0 * noise(at, 4, 9).powi(2)).exp());
        let lichen = (2.5 * noise(at, 5, 10) - 0.8).clamp(0.0, 1.0);
        let grain = 8.0 * lattice(at, 40);
        Rgb([[1.0, 60.0, 150.0], [0.93, 50.0, 160.0], [0.82, 45.0, 70.0]].map(|[stone, dark, moss]| {
            let stone = tone * stone * (1.0 - 0.6 * vein) + 0.6 * dark * vein;
            (stone * (1.0 - lichen) + moss * lichen + grain) as u8
        }))
    })
}

/// Bumps with scratches.
fn normals() -> RgbImage {
    let height = |x: u32, y: u32| {
        let scratch = (-200.0 * noise([x, y], 5, 8).powi(2)).exp();
        9.0 * noise([x, y], 5, 10) - 3.0 * scratch
    };
    let heights: Vec<f64> =
        (0..MAPS_PX[0] * MAPS_PX[1]).map(|i| height(i % MAPS_PX[0], i / MAPS_PX[0])).collect();
    let at = |x: u32, y: u32| heights[(y.min(MAPS_PX[1] - 1) * MAPS_PX[0] + x % MAPS_PX[0]) as usize];
    RgbImage::from_fn(MAPS_PX[0], MAPS_PX[1], |x, y| {
        let slope = [at(x, y) - at(x + 1, y), at(x, y + 1) - at(x, y), 1.0];
        let length = slope.iter().map(|c| c * c).sum::<f64>().sqrt();
        Rgb(slope.map(|c| ((c / length + 1.0) * 127.5).round() as u8))
    })
}

/// Roughness, and metal where paint is off.
fn surfaces() -> [GrayImage; 2] {
    let rough = |x, y| 110.0 + 90.0 * noise([x, y], 3, 10);
    let metal = |x, y| 128.0 + 1500.0 * (noise([x, y], 4, 9) - 0.25);
    let image = |value: &dyn Fn(u32, u32) -> f64| {
        GrayImage::from_fn(MAPS_PX[0], MAPS_PX[1], |x, y| Luma([value(x, y).clamp(0.0, 255.0) as u8]))
    };
    [image(&rough), image(&metal)]
}

/// A globe, 0.9 of the picture's height, with the maps that the lines name.
fn globe(folder: &Path, lines: &str) -> PathBuf {
    use std::fmt::Write as _;
    let (columns, rows) = (96, 48);
    let mut obj = String::from("mtllib globe.mtl\nusemtl globe\n");
    for (row, column) in (0..=rows).flat_map(|row| (0..=columns).map(move |column| (row, column))) {
        let (u, v) = (f64::from(column) / f64::from(columns), f64::from(row) / f64::from(rows));
        let (phi, theta) = (u * std::f64::consts::TAU, v * std::f64::consts::PI);
        let [x, y, z] = [-theta.sin() * phi.cos(), -theta.cos(), theta.sin() * phi.sin()];
        writeln!(obj, "v {x:.6} {y:.6} {z:.6}\nvt {u:.6} {v:.6}").unwrap();
    }
    for (row, column) in (0..rows).flat_map(|row| (0..columns).map(move |column| (row, column))) {
        let at = |row, column| 1 + row * (columns + 1) + column;
        let corners = [at(row, column), at(row, column + 1), at(row + 1, column + 1), at(row + 1, column)];
        let [a, b, c, d] = corners.map(|corner| format!("{corner}/{corner}"));
        writeln!(obj, "f {a} {b} {c} {d}").unwrap();
    }
    std::fs::write(folder.join("globe.obj"), obj).unwrap();
    std::fs::write(folder.join("globe.mtl"), format!("newmtl globe\n{lines}\n")).unwrap();
    let text = "name = \"globe\"\n[light]\ndirection = [0.5, 0.6, 0.6]\n[camera]\neye = [0.0, 0.0, 3.2]\n\
                target = [0.0, 0.0, 0.0]\nfov_y_degrees = 40.0\n[[asset]]\nname = \"globe\"\nfile = \
                \"globe.obj\"\n[[instance]]\nasset = \"globe\"\n";
    let path = folder.join("scene.toml");
    std::fs::write(&path, text).unwrap();
    path
}

/// The picture of a scene with textures of a quality, and the bytes of their files: of all levels and of the finest.
fn drawn(headless: &mut Headless, path: &Path, quality: u8) -> (Picture, [u64; 2]) {
    let cache = tempfile::tempdir().unwrap();
    let mut scene = of_files(&[path.to_owned()]).unwrap();
    for asset in &mut scene.assets {
        asset.preparation_settings.texture_quality = quality.try_into().ok();
    }
    let scene = TestScene::open(&scene, prepare_all(&scene, cache.path()));
    let mut bytes = [0; 2];
    for texture in scene.assets.iter().flat_map(|asset| &asset.description.textures) {
        for (at, level) in texture.levels.iter().enumerate() {
            let of_level = u64::from(texture.images(at)) * u64::from(level.bytes);
            bytes[0] += of_level;
            bytes[1] += if at + 1 == texture.levels.len() { of_level } else { 0 };
        }
    }
    (draw(headless, scene.whole()), bytes)
}

/// Prints bytes and FLIP of each quality.
fn chart(headless: &mut Headless, what: &str, path: &Path) -> Picture {
    let (lossless, [bytes, _]) = drawn(headless, path, LOSSLESS);
    keep(&lossless, &format!("quality-{what}"));
    println!("{what} lossless: {bytes} bytes");
    for quality in QUALITIES {
        let (picture, [bytes, finest]) = drawn(headless, path, quality);
        let error = image_error(&picture.image, &lossless.image).unwrap();
        println!("{what} {quality}: {bytes} bytes ({finest} of the finest levels), FLIP {:.4}", error.flip);
    }
    lossless
}

#[test]
#[ignore = "a chart, not a check: some minutes"]
fn bytes_and_flip_by_quality() {
    let Some(mut headless) = headless_of(SIZE_PX) else { return };
    if let Some(path) = std::env::var_os("LODESTREAM_SCENE") {
        chart(&mut headless, "scene", Path::new(&path));
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let colours = colours();
    colours.save(folder.path().join("colour.png")).unwrap();
    let path = globe(folder.path(), "map_Kd colour.png");
    let lossless = chart(&mut headless, "colours", &path);
    // JPEG: the finest level is decoded before preparation, so coarser ones are the means of its texels.
    for quality in QUALITIES {
        let mut file = Vec::new();
        JpegEncoder::new_with_quality(&mut file, quality).encode_image(&colours).unwrap();
        image::load_from_memory(&file).unwrap().save(folder.path().join("colour.png")).unwrap();
        let (picture, _) = drawn(&mut headless, &path, LOSSLESS);
        let flip = image_error(&picture.image, &lossless.image).unwrap().flip;
        println!("colours JPEG {quality}: finest level {} bytes, FLIP {flip:.4}", file.len());
    }
    normals().save(folder.path().join("normal.png")).unwrap();
    let path = globe(folder.path(), "Kd 0.6 0.6 0.6\nPr 0.4\nnorm normal.png");
    chart(&mut headless, "normals", &path);
    let [rough, metal] = surfaces();
    rough.save(folder.path().join("rough.png")).unwrap();
    metal.save(folder.path().join("metal.png")).unwrap();
    let path = globe(folder.path(), "Kd 0.6 0.5 0.4\nPr 1\nPm 1\nmap_Pr rough.png\nmap_Pm metal.png");
    chart(&mut headless, "surfaces", &path);
}
