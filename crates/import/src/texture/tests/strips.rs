//! Images that are read a strip at a time.

use image::ImageBuffer;

use super::super::rows::Rows;
use super::*;

/// All rows of an image, in strips of so many.
fn rows_of(rows: &mut Rows, most: u32) -> Vec<DynamicImage> {
    let strips = std::iter::repeat_with(|| rows.next(most).unwrap());
    strips.take_while(|strip| strip.height() > 0).collect()
}

fn check(path: &std::path::Path) {
    let whole = image::open(path).unwrap();
    let mut rows = Rows::open(&path.to_owned().into()).unwrap();
    assert_eq!(rows.size(), [whole.width(), whole.height()]);
    for most in [1, 5, 64] {
        let mut top = 0;
        for strip in rows_of(&mut rows, most) {
            assert_eq!(strip, whole.crop_imm(0, top, whole.width(), strip.height()), "{}", path.display());
            top += strip.height();
        }
        assert_eq!(top, whole.height());
        rows.rewind().unwrap();
    }
}

#[test]
fn strips_are_the_rows_of_the_image() {
    let dir = TempDir::new().unwrap();
    let byte = |x, y, c: u32| noise(x + 31 * c, y);
    let word = |x, y, c: u32| u16::from(byte(x, y, c)) * 256 + u16::from(byte(y, x, c));
    let images: [DynamicImage; 8] = [
        ImageBuffer::from_fn(19, 13, |x, y| Luma([byte(x, y, 0)])).into(),
        ImageBuffer::from_fn(19, 13, |x, y| image::LumaA([byte(x, y, 0), byte(x, y, 1)])).into(),
        ImageBuffer::from_fn(19, 13, |x, y| Rgb([0, 1, 2].map(|c| byte(x, y, c)))).into(),
        ImageBuffer::from_fn(19, 13, |x, y| Rgba([0, 1, 2, 3].map(|c| byte(x, y, c)))).into(),
        ImageBuffer::from_fn(19, 13, |x, y| Luma([word(x, y, 0)])).into(),
        ImageBuffer::from_fn(19, 13, |x, y| image::LumaA([word(x, y, 0), word(x, y, 1)])).into(),
        ImageBuffer::from_fn(19, 13, |x, y| Rgb([0, 1, 2].map(|c| word(x, y, c)))).into(),
        ImageBuffer::from_fn(19, 13, |x, y| Rgba([0, 1, 2, 3].map(|c| word(x, y, c)))).into(),
    ];
    for image in images {
        check(&save(&dir, "a.png", image));
    }
    check(&save(&dir, "a.jpg", waves(40)));
    // A palette of two colours, the second half transparent; two bits a pixel.
    let path = dir.path().join("palette.png");
    let mut encoder = png::Encoder::new(std::fs::File::create(&path).unwrap(), 6, 3);
    encoder.set_color(png::ColorType::Indexed);
    encoder.set_depth(png::BitDepth::Two);
    encoder.set_palette(vec![10, 20, 30, 200, 100, 0]);
    encoder.set_trns(vec![255, 128]);
    let mut writer = encoder.write_header().unwrap();
    writer
        .write_image_data(&[0b0001_0001, 0b0100_0000, 0b0101_0000, 0b0001_0000, 0b0100_0000, 0b0101_0000])
        .unwrap();
    writer.finish().unwrap();
    check(&path);
    assert!(Rows::open(&path.into()).unwrap().has_alpha());
}

#[test]
fn textures_of_many_strips_are_the_same_on_any_number_of_threads() {
    let dir = TempDir::new().unwrap();
    let path = save(&dir, "a.png", RgbImage::from_fn(530, 771, |x, y| Rgb([noise(x, y), x as u8, 9])));
    let source = color(path);
    let texture = load(&source).unwrap();
    assert_eq!(texture.levels.iter().rev().map(Vec::len).collect::<Vec<_>>(), [12, 4, 1, 1, 1, 1, 1, 1]);
    assert!(texture.levels.iter().flatten().all(|file| !file.is_empty()));
    assert_eq!(super::super::load(&source, TextureSettings::default(), &Backwards).unwrap(), texture);
}

#[test]
fn an_image_that_is_replaced_while_it_is_read_is_an_error() {
    let dir = TempDir::new().unwrap();
    let path = save(&dir, "a.png", RgbImage::new(4, 4));
    let mut rows = Rows::open(&path.clone().into()).unwrap();
    save(&dir, "a.png", RgbImage::new(4, 5));
    let error = rows.rewind().unwrap_err().to_string();
    assert!(error.contains("it was changed while it was read"), "{error}");
}

#[test]
fn opacity_of_the_finest_level_is_kept_in_all_tiles() {
    let dir = TempDir::new().unwrap();
    // Smooth holes in the left half, nothing in the right.
    let alpha = |x: u32, y: u32| if x < 256 { ((x * 8) ^ (y * 8)) as u8 & 0xF8 } else { 0 };
    let image = RgbaImage::from_fn(512, 300, |x, y| Rgba([90, 80, 20, alpha(x, y)]));
    let source = TextureSource::Color {
        image: Some(save(&dir, "a.png", image).into()),
        opacity: None,
        used: Opacity::Tested(200),
    };
    let texture = load(&source).unwrap();
    let tile = decoded(&texture, &texture.levels.last().unwrap()[0]);
    assert_eq!((tile.width(), tile.height()), (260, 260));
    for y in 2..258 {
        for x in 2..258 {
            assert_eq!(tile.get_pixel(x, y).0[3], alpha(x - 2, y - 2), "{x} {y}");
        }
    }
}
