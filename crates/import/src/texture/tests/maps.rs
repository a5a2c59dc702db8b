//! Surface and normal maps, and opacity.

use image::{DynamicImage, GrayImage, Luma, Rgb, RgbImage, Rgba, RgbaImage};
use tempfile::TempDir;

use super::super::{Level, Opacity, Texture, TextureSource, Transparency};
use super::{decoded, load, noise, save};
use crate::model::{Channel, Component, SurfaceMap};

fn finest(texture: &Texture) -> RgbaImage {
    decoded(texture, &texture.levels.last().unwrap()[0])
}

fn coarsest(texture: &Texture) -> RgbaImage {
    decoded(texture, &texture.levels[0][0])
}

#[test]
fn a_surface_is_composed_of_its_images_at_the_larger_size() {
    let dir = TempDir::new().unwrap();
    // The left half is 55/255 open, the right half fully; both are flat, so that no code changes them.
    let occlusion = GrayImage::from_fn(2, 2, |x, _| Luma([if x == 0 { 55 } else { 255 }]));
    let occlusion = save(&dir, "o.png", occlusion);
    let rough = save(&dir, "r.png", RgbImage::from_pixel(32, 16, Rgb([9, 102, 51])));
    let half = Channel { strength: 32_768, ..Channel::plain(occlusion.clone().into(), Component::Red) };
    let map = SurfaceMap {
        occlusion: Some(half),
        roughness: Some(Channel::plain(rough.clone().into(), Component::Green)),
        metallic: Some(Channel::plain(rough.clone().into(), Component::Blue)),
    };
    let texture = load(&TextureSource::Surface(map.clone())).unwrap();
    assert_eq!((texture.width_px, texture.height_px, texture.levels.len()), (32, 16, 3));
    let image = finest(&texture);
    let near = |at: (u32, u32), expected: [u8; 3]| {
        let [r, g, b, _] = image.get_pixel(at.0, at.1).0;
        let texel = [r, g, b];
        assert!(texel.iter().zip(expected).all(|(a, b)| a.abs_diff(b) <= 2), "{texel:?} {expected:?}");
    };
    // 1 + (55/255 − 1) / 2.
    near((0, 8), [155, 102, 51]);
    near((31, 8), [255, 102, 51]);
    // An eighth of the way between the centres of two texels, beyond the middle.
    near((18, 8), [(155.0_f64 + 100.0 * (18.5 / 16.0 - 0.5)).round() as u8, 102, 51]);
    assert_eq!(texture.mean, Some([205, 102, 51]));
    assert_eq!(load(&TextureSource::Surface(map)).unwrap(), texture);
    // A single channel, inverted: the others are 1.
    let glossy = Channel { inverted: true, ..Channel::plain(rough.into(), Component::Red) };
    let map = SurfaceMap { roughness: Some(glossy), ..SurfaceMap::default() };
    assert_eq!(load(&TextureSource::Surface(map)).unwrap().mean, Some([255, 246, 255]));
}

#[test]
fn channels_that_are_the_same_everywhere_take_no_bytes() {
    let dir = TempDir::new().unwrap();
    let image = RgbImage::from_fn(64, 64, |x, y| Rgb([40, 100 + noise(x, y) / 4, 90 + noise(y, x) / 4]));
    let path = save(&dir, "s.png", image.clone());
    let channel = |component| Some(Channel::plain(path.clone().into(), component));
    let (green, blue) = (Component::Green, Component::Blue);
    let rough = SurfaceMap { roughness: channel(green), ..SurfaceMap::default() };
    let metal = SurfaceMap { occlusion: channel(Component::Red), metallic: channel(blue), ..rough.clone() };
    let [rough, metal] = [rough, metal].map(|map| load(&TextureSource::Surface(map)).unwrap());
    assert_eq!([rough.planes, metal.planes], [0b010, 0b110]);
    let file = |texture: &Texture| {
        let file = texture.levels.last().unwrap()[0].clone();
        let picture = image::load_from_memory_with_format(&file, image::ImageFormat::WebP).unwrap();
        (file.len(), [picture.width(), picture.height()])
    };
    let ((one, size), (two, tall)) = (file(&rough), file(&metal));
    assert_eq!([size, tall], [[64, 64], [64, 128]]);
    assert!(one < two, "{one} {two}");
    for (texture, red, varying_blue) in [(rough, 255, false), (metal, 40, true)] {
        for (pixel, source) in finest(&texture).pixels().zip(image.pixels()) {
            let ([r, g, b, _], [_, green, blue]) = (pixel.0, source.0);
            let blue_is_near = if varying_blue { b.abs_diff(blue) < 32 } else { b == 255 };
            assert!(r == red && g.abs_diff(green) < 32 && blue_is_near, "{pixel:?} {source:?}");
        }
    }
    // Nothing varies: PNG.
    let flat = save(&dir, "f.png", RgbImage::from_pixel(300, 20, Rgb([1, 2, 3])));
    let map = SurfaceMap { roughness: Some(Channel::plain(flat.into(), green)), ..SurfaceMap::default() };
    let flat = load(&TextureSource::Surface(map)).unwrap();
    assert_eq!((flat.planes, flat.mean), (0, Some([255, 2, 255])));
    assert!(flat.levels.iter().flatten().all(|file| file.starts_with(b"\x89PNG")));
}

#[test]
fn an_image_that_cannot_be_read_leaves_the_others() {
    let dir = TempDir::new().unwrap();
    let rough = save(&dir, "r.png", RgbImage::new(8, 8));
    let missing = dir.path().join("none.png");
    let map = SurfaceMap {
        occlusion: Some(Channel::plain(missing.clone().into(), Component::Red)),
        roughness: Some(Channel::plain(rough.clone().into(), Component::Green)),
        metallic: None,
    };
    let source = TextureSource::Surface(map);
    let error = load(&source).unwrap_err();
    assert_eq!(error.path(), missing);
    let left = source.without(error.path()).unwrap();
    assert_eq!(load(&left).unwrap().mean, Some([255, 0, 255]));
    assert_eq!(left.without(&rough), None);
}

#[test]
fn coarser_normals_point_where_the_finer_do_together_and_are_unit() {
    let dir = TempDir::new().unwrap();
    // Ridges: half the normals lean left, half up; their mean lies between.
    let byte = |x: f64| ((x + 1.0) * 127.5).round() as u8;
    let ridges = RgbImage::from_fn(64, 64, |x, _| {
        let slope = [if x % 2 == 0 { -0.8 } else { 0.0 }, if x % 2 == 0 { 0.0 } else { 0.8 }, 0.6];
        Rgb(slope.map(byte))
    });
    let texture = load(&TextureSource::Normal(save(&dir, "n.png", ridges).into())).unwrap();
    assert_eq!((texture.mean, texture.levels.len()), (None, 4));
    for (level, images) in texture.levels.iter().enumerate() {
        for pixel in decoded(&texture, &images[0]).pixels() {
            let vector = pixel.0.map(|c| f64::from(c) / 127.5 - 1.0);
            let length = vector[..3].iter().map(|c| c * c).sum::<f64>().sqrt();
            assert!((length - 1.0).abs() < 0.03, "level {level}: {pixel:?} has length {length}");
        }
    }
    let coarse = coarsest(&texture).get_pixel(0, 0).0;
    let length = (0.4_f64 * 0.4 * 2.0 + 0.36).sqrt();
    let expected = [-0.4, 0.4, 0.6].map(|x| byte(x / length));
    assert!(coarse.iter().zip(expected).all(|(a, b)| a.abs_diff(b) <= 2), "{coarse:?} {expected:?}");
    // A mean without direction points out of the surface, also where opposite normals meet.
    let opposed =
        RgbImage::from_fn(16, 16, |x, _| if x % 2 == 0 { Rgb([0, 127, 127]) } else { Rgb([255, 128, 128]) });
    let texture = load(&TextureSource::Normal(save(&dir, "o.png", opposed).into())).unwrap();
    let [x, y, z, _] = coarsest(&texture).get_pixel(0, 0).0;
    assert!(x.abs_diff(128) <= 2 && y.abs_diff(128) <= 2 && z >= 253, "{x} {y} {z}");
}

#[test]
fn masks_keep_their_coverage_in_coarser_levels() {
    let dir = TempDir::new().unwrap();
    // Separate leaves on a quarter of the texels, whose means rarely reach one half. No two are alike, so few means are
    // equal.
    let leaves = RgbaImage::from_fn(128, 128, |x, y| {
        let at = u32::from(noise(x / 2, y / 2));
        Rgba([10, 200, 30, (if at < 64 { 128 + at * 127 / 64 } else { (255 - at) / 3 }) as u8])
    });
    let path = save(&dir, "leaves.png", leaves);
    let shares = |used: Opacity| {
        let source = TextureSource::Color { image: Some(path.clone().into()), opacity: None, used };
        let texture = load(&source).unwrap();
        assert_eq!(load(&source).unwrap(), texture);
        let share = |images: &Level| {
            let image = image::load_from_memory(&images[0]).unwrap().to_rgba8();
            image.pixels().filter(|p| p.0[3] >= 128).count() as f64 / image.pixels().len() as f64
        };
        texture.levels.iter().map(share).collect::<Vec<f64>>()
    };
    let tested = shares(Opacity::Tested(128));
    let whole = tested[tested.len() - 1];
    assert!((0.15..0.35).contains(&whole), "{tested:?}");
    for (level, share) in tested.iter().enumerate() {
        let texels = f64::from(8_u32 << level).powi(2);
        assert!((share - whole).abs() < 0.02 + 1.0 / texels, "level {level}: {tested:?}");
    }
    let blended = shares(Opacity::Blended);
    assert!(blended[0] < 0.5 * whole, "they vanish without: {blended:?}");
}

#[test]
fn opacity_of_zeros_and_ones_is_taken_for_a_mask() {
    let dir = TempDir::new().unwrap();
    let holes = RgbaImage::from_fn(64, 64, |x, y| Rgba([9, 9, 9, if noise(x, y) < 64 { 255 } else { 0 }]));
    let path = save(&dir, "holes.png", holes);
    let of = |used: Opacity| {
        load(&TextureSource::Color { image: Some(path.clone().into()), opacity: None, used }).unwrap()
    };
    assert_eq!(of(Opacity::Guessed).transparency, Transparency::Holes);
    assert_eq!(of(Opacity::Guessed), of(Opacity::Tested(128)));
    assert_ne!(of(Opacity::Guessed), of(Opacity::Blended));
}

#[test]
fn unused_opacity_is_dropped() {
    let dir = TempDir::new().unwrap();
    let image =
        RgbaImage::from_fn(64, 64, |x, y| Rgba([noise(x, y), noise(y, x), 7, if x < 32 { 0 } else { 255 }]));
    let path = save(&dir, "a.png", image.clone());
    let texture = load(&TextureSource::opaque(path.into())).unwrap();
    assert_eq!(texture.transparency, Transparency::None);
    let plain = save(&dir, "b.png", DynamicImage::from(image).to_rgb8());
    assert_eq!(load(&TextureSource::opaque(plain.into())).unwrap().levels, texture.levels);
}

#[test]
fn a_separate_opacity_map_replaces_the_images_alpha() {
    let dir = TempDir::new().unwrap();
    let color = save(&dir, "c.png", RgbImage::from_pixel(16, 16, Rgb([200, 100, 50])));
    let grey = GrayImage::from_fn(32, 32, |x, _| Luma([if x < 16 { 0 } else { 255 }]));
    let channel = |path: std::path::PathBuf| Channel::plain(path.into(), Component::Mask);
    let source = |image: Option<std::path::PathBuf>, opacity| TextureSource::Color {
        image: image.map(Into::into),
        opacity: Some(channel(opacity)),
        used: Opacity::Guessed,
    };
    let cut = load(&source(Some(color.clone()), save(&dir, "m.png", grey))).unwrap();
    assert_eq!((cut.width_px, cut.transparency), (32, Transparency::Holes));
    let image = finest(&cut);
    assert_eq!([image.get_pixel(0, 0).0, image.get_pixel(31, 9).0], [[200, 100, 50, 0], [200, 100, 50, 255]]);
    // Opacity in the alpha channel, without a colour.
    let graded = RgbaImage::from_fn(16, 16, |x, _| Rgba([0, 0, 0, x as u8 * 16]));
    let faded = load(&source(None, save(&dir, "g.png", graded))).unwrap();
    assert_eq!(faded.transparency, Transparency::Graded);
    assert_eq!(finest(&faded).get_pixel(8, 0).0, [255, 255, 255, 128]);
    let white =
        load(&source(Some(color), save(&dir, "w.png", GrayImage::from_pixel(4, 4, Luma([255]))))).unwrap();
    assert_eq!(white.transparency, Transparency::None);
}
