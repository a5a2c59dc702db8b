//! KTX2 files: Basis Universal and plain texels, and files that are damaged.

use super::*;
use crate::model::ImageSource;

/// 14 × 10 texels in blocks of 4 × 4: red grows and opacity falls along x, green grows along y, blue is 90. Encoded by
/// basisu 2.10 as ETC1S with coarser levels, and as UASTC in a zstd frame.
const ETC1S: &[u8] = include_bytes!("etc1s.ktx2");
const UASTC: &[u8] = include_bytes!("uastc-zstd.ktx2");

fn pattern() -> RgbaImage {
    RgbaImage::from_fn(14, 10, |x, y| {
        let [column, row] = [x / 4, y / 4].map(|block| block as u8);
        Rgba([20 + 60 * column, 30 + 90 * row, 90, 255 - 60 * column])
    })
}

fn decoded(bytes: &[u8]) -> Result<DynamicImage, TextureError> {
    decode(&ImageSource { path: "a.ktx2".into(), bytes: Some(bytes.to_vec().into()) })
}

/// Asserts that a file is refused with one line that has this text.
fn refused(bytes: &[u8], why: &str) {
    let message = decoded(bytes).unwrap_err().to_string();
    assert!(message.contains(why) && message.contains("a.ktx2") && !message.contains('\n'), "{message:?}");
}

/// Vulkan's numbers of formats.
const R8_UNORM: u32 = 9;
const R8G8B8_UNORM: u32 = 23;
const R8G8B8_SRGB: u32 = 29;
const R8G8B8A8_UNORM: u32 = 37;
const R8G8B8A8_SRGB: u32 = 43;
const R16_UNORM: u32 = 70;
const BC7_SRGB_BLOCK: u32 = 146;
/// The colour model of plain texels.
const RGBSDA: u8 = 1;

/// A file of one level.
struct File {
    format: u32,
    size: [u32; 2],
    scheme: u32,
    key_values: Vec<u8>,
    level: Vec<u8>,
}

impl File {
    fn new(format: u32, size: [u32; 2], level: Vec<u8>) -> Self {
        Self { format, size, scheme: 0, key_values: Vec::new(), level }
    }

    fn bytes(&self) -> Vec<u8> {
        // Samples are not read.
        let mut description = vec![0; 28];
        description[12] = RGBSDA;
        let [width, height] = self.size;
        let numbers = [self.format, 1, width, height, 0, 0, 1, 1, self.scheme];
        let key_values = 104 + description.len() as u32;
        let places = [104, description.len() as u32, key_values, self.key_values.len() as u32, 0, 0, 0, 0];
        let start = u64::from(key_values) + self.key_values.len() as u64;
        let level = [start, self.level.len() as u64, self.level.len() as u64].map(u64::to_le_bytes).concat();
        let head = [numbers.map(u32::to_le_bytes).concat(), places.map(u32::to_le_bytes).concat(), level];
        let magic = ETC1S[..12].to_vec();
        [magic, head.concat(), description, self.key_values.clone(), self.level.clone()].concat()
    }
}

/// Mean and largest difference of two images' channels.
fn off(a: &RgbaImage, b: &RgbaImage) -> (f64, u8) {
    assert_eq!(a.dimensions(), b.dimensions());
    let differences: Vec<u8> = a.as_raw().iter().zip(b.as_raw()).map(|(a, b)| a.abs_diff(*b)).collect();
    let sum: u32 = differences.iter().map(|&d| u32::from(d)).sum();
    (f64::from(sum) / differences.len() as f64, differences.into_iter().max().unwrap())
}

/// A file with one of its header's numbers changed.
fn with_number(file: &[u8], at: usize, number: u32) -> Vec<u8> {
    let mut file = file.to_vec();
    file[at..at + 4].copy_from_slice(&number.to_le_bytes());
    file
}

/// Places of numbers in the header.
const WIDTH: usize = 20;
const HEIGHT: usize = 24;
const DEPTH: usize = 28;
const LAYERS: usize = 32;
const FACES: usize = 36;
const SCHEME: usize = 44;

#[test]
fn basis_universal_textures_show_their_picture() {
    let (mean, most) = off(&decoded(ETC1S).unwrap().to_rgba8(), &pattern());
    assert!(mean < 2.0 && most < 8, "ETC1S: {mean} in the mean, {most} at most");
    let (mean, most) = off(&decoded(UASTC).unwrap().to_rgba8(), &pattern());
    assert!(mean < 1.0 && most < 4, "UASTC: {mean} in the mean, {most} at most");
}

#[test]
fn uastc_is_read_without_zstd_too() {
    let start = u64::from_le_bytes(UASTC[80..88].try_into().unwrap()) as usize;
    let level = zstd::bulk::decompress(&UASTC[start..], 1 << 16).unwrap();
    assert_eq!(level.len(), 4 * 3 * 16);
    let mut plain = [&UASTC[..start], &level].concat();
    plain[SCHEME] = 0;
    for at in [88, 96] {
        plain[at..at + 8].copy_from_slice(&(level.len() as u64).to_le_bytes());
    }
    assert_eq!(decoded(&plain).unwrap(), decoded(UASTC).unwrap());
    plain.pop();
    refused(&plain, "cut short");
    plain[88] -= 1;
    refused(&plain, "191 bytes instead of 192");
}

#[test]
fn plain_texels_are_read_as_they_are() {
    let rgba = pattern();
    let rgb = DynamicImage::from(rgba.clone()).to_rgb8();
    let grey = DynamicImage::from(rgba.clone()).to_luma8();
    for (format, image) in [
        (R8G8B8A8_SRGB, DynamicImage::from(rgba)),
        (R8G8B8_UNORM, DynamicImage::from(rgb)),
        (R8_UNORM, DynamicImage::from(grey)),
    ] {
        let mut file = File::new(format, [14, 10], image.as_bytes().to_vec());
        assert_eq!(decoded(&file.bytes()).unwrap(), image, "{format}");
        file.level = zstd::bulk::compress(image.as_bytes(), 1).unwrap();
        file.scheme = 2;
        assert_eq!(decoded(&file.bytes()).unwrap(), image, "{format} in a zstd frame");
    }
}

#[test]
fn heights_of_16_bits_keep_them() {
    let heights: Vec<u16> = (0..32 * 32_u32).map(|i| (i * 40_503 % 65_536) as u16).collect();
    let level = heights.iter().flat_map(|h| h.to_le_bytes()).collect();
    let file = File::new(R16_UNORM, [32, 32], level).bytes();
    let image = ImageSource { path: "a.ktx2".into(), bytes: Some(file.into()) };
    let texture = load(&TextureSource::Height(image)).unwrap();
    let finest = image::load_from_memory(&texture.levels.last().unwrap()[0]).unwrap();
    assert_eq!(finest.as_luma16().unwrap().as_raw(), &heights);
}

#[test]
fn images_that_are_stored_from_below_are_turned() {
    let rgb = DynamicImage::from(pattern()).to_rgb8();
    let mut file = File::new(R8G8B8_SRGB, [14, 10], rgb.as_raw().clone());
    for (directions, turned) in [
        ("rd", DynamicImage::from(rgb.clone())),
        ("ru", DynamicImage::from(rgb.clone()).flipv()),
        ("lu", DynamicImage::from(rgb.clone()).flipv().fliph()),
    ] {
        file.key_values =
            [&18_u32.to_le_bytes()[..], b"KTXorientation\0", directions.as_bytes(), b"\0\0\0"].concat();
        assert_eq!(decoded(&file.bytes()).unwrap(), turned, "{directions}");
    }
}

#[test]
fn files_that_hold_something_else_are_refused_by_name() {
    let block = File::new(BC7_SRGB_BLOCK, [4, 4], vec![0; 16]).bytes();
    refused(&block, "neither VkFormat 146");
    for (at, number) in [(DEPTH, 2), (LAYERS, 2), (FACES, 6)] {
        refused(&with_number(ETC1S, at, number), "no arrays, cube maps or volumes");
    }
    refused(&with_number(UASTC, SCHEME, 3), "supercompression 3 is not read");
    refused(&with_number(UASTC, SCHEME, 77), "supercompression 77");
    refused(&with_number(ETC1S, SCHEME, 0), "supercompression 0");
    refused(&with_number(ETC1S, HEIGHT, 0), "no pixels");
    // The model of its texels, in the description.
    let mut file = UASTC.to_vec();
    let description = u32::from_le_bytes(file[48..52].try_into().unwrap()) as usize;
    assert_eq!(std::mem::replace(&mut file[description + 12], 130), 166);
    refused(&file, "colour model 130");
}

#[test]
fn sizes_that_lie_are_refused() {
    for (file, why) in [(UASTC, "no frame of 384 bytes"), (ETC1S, "")] {
        let _ = decoded(&with_number(file, WIDTH, 3));
        let wide = with_number(file, WIDTH, 30);
        // Which blocks a stream of ETC1S has, only decoding tells.
        if why.is_empty() {
            assert!(decoded(&wide).map_or(true, |image| image.width() == 30));
        } else {
            refused(&wide, "bytes");
        }
        for (width, height) in [(MAX_SIDE_PX + 1, 1), (MAX_SIDE_PX, MAX_SIDE_PX), (u32::MAX, u32::MAX)] {
            let huge = with_number(&with_number(file, WIDTH, width), HEIGHT, height);
            let error = decoded(&huge).unwrap_err();
            let too_large = matches!(error, TextureError::TooLarge { .. } | TextureError::TooLong { .. });
            assert!(too_large, "{error}");
        }
    }
    let file = File::new(R8G8B8A8_UNORM, [14, 10], vec![7; 14 * 10 * 4 - 1]).bytes();
    refused(&file, "559 bytes instead of 560");
}

#[test]
fn a_level_that_inflates_beyond_its_image_is_refused() {
    let mut file = File::new(R8_UNORM, [8, 8], zstd::bulk::compress(&vec![0; 64 << 20], 1).unwrap());
    file.scheme = 2;
    let file = file.bytes();
    assert!(file.len() < 10_000, "{} bytes", file.len());
    refused(&file, "no frame of 64 bytes");
}

#[test]
fn files_that_are_cut_are_refused() {
    let plain = File::new(R8_UNORM, [5, 3], vec![1; 15]).bytes();
    for file in [ETC1S, UASTC, &plain] {
        for end in 0..file.len() {
            assert!(decoded(&file[..end]).is_err(), "{end} of {} bytes", file.len());
        }
    }
}

#[test]
fn damaged_bytes_are_refused_or_change_the_picture() {
    for file in [ETC1S, UASTC] {
        for at in 12..file.len() {
            for bits in [1, 0x10, 0x80, 0xff] {
                let mut file = file.to_vec();
                file[at] ^= bits;
                let source = ImageSource { path: "a.ktx2".into(), bytes: Some(file.into()) };
                // Large sizes take long, and are tried above.
                if size(&source).is_ok_and(|(width, height)| width * height < 10_000) {
                    let _ = decode(&source);
                }
            }
        }
    }
}
