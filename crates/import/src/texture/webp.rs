//! Lossy WebP files (RFC 9649) of colours, and of grey planes one below the other.
//!
//! libwebp encodes in integers; its vectorised and plain functions give the same bytes. Its lossless code, which it
//! would use for opacity, compares sums of floating-point numbers, so `image`'s encoder, which has none, takes its place
//! at 1.1 to 1.4 times the length.

use ::webp::{Encoder, WebPConfig};
use image::codecs::webp::WebPEncoder;
use image::error::{EncodingError, ImageFormatHint};
use image::{ExtendedColorType, ImageError, ImageFormat};

use super::quality::TextureSettings;
use super::subsampling;

/// Lost chroma ([`subsampling::lost`]) above which libwebp converts to half the chroma by its slower, sharper way. It takes a
/// third of the time, and where less is lost it errs by 2 to 8 % less in 1 to 4 % more bytes, which higher quality does
/// too; above, it saves up to 0.9 dB.
const SHARP: f64 = 1.0;
/// Longest side of a WebP file, in pixels.
pub(super) const MAX_SIDE_PX: u32 = 16_383;
/// Sides of the squares in which invisible texels get one colour, up to a macroblock's.
const SQUARES_PX: [usize; 4] = [2, 4, 8, 16];
/// `VP8X`: the file has opacity.
const HAS_ALPHA: u32 = 0x10;
/// `ALPH`: not filtered, compressed.
const ALPHA_COMPRESSED: u8 = 1;
/// Bytes before the chunks of a file, and before the contents of a chunk.
const FILE_HEADER: usize = 12;
const CHUNK_HEADER: usize = 8;
/// Bytes of a lossless picture's signature and size, which `ALPH` omits.
const LOSSLESS_HEADER: usize = 5;

/// The file of an opaque picture, three bytes per pixel, neither side 0 or longer than [`MAX_SIDE_PX`], that loses so much
/// chroma.
pub(super) fn opaque(
    rgb: &[u8],
    (width, height): (u32, u32),
    lost: f64,
    settings: TextureSettings,
) -> Result<Vec<u8>, ImageError> {
    let mut config = config(settings)?;
    config.use_sharp_yuv = i32::from(lost > SHARP);
    encode(Encoder::from_rgb(rgb, width, height), &config)
}

/// The file of grey planes, a byte per pixel, one below the other. They hold numbers, so libwebp spends no bits on what
/// eyes notice (spatial noise shaping): at equal bytes the 99th percentile of normals' errors is a tenth smaller. Where
/// planes meet, errors are a sixth larger; filling up macroblocks costs more than it saves.
pub(super) fn planes(
    grey: &[u8],
    (width, height): (u32, u32),
    settings: TextureSettings,
) -> Result<Vec<u8>, ImageError> {
    let mut config = config(settings)?;
    config.sns_strength = 0;
    let rgb: Vec<u8> = grey.iter().flat_map(|&value| [value; 3]).collect();
    encode(Encoder::from_rgb(&rgb, width, height), &config)
}

fn config(settings: TextureSettings) -> Result<WebPConfig, ImageError> {
    let mut config = WebPConfig::new().map_err(|()| failed("no configuration"))?;
    config.quality = f32::from(settings.quality.get());
    config.method = i32::from(settings.effort.get());
    Ok(config)
}

fn encode(encoder: Encoder<'_>, config: &WebPConfig) -> Result<Vec<u8>, ImageError> {
    let file = encoder.encode_advanced(config);
    Ok(file.map_err(|why| failed(&format!("{why:?}")))?.to_vec())
}

/// The file of a picture with opacity, four bytes per pixel. Opacity is lossless.
pub(super) fn with_alpha(
    rgba: &[u8],
    (width, height): (u32, u32),
    settings: TextureSettings,
) -> Result<Vec<u8>, ImageError> {
    let visible = without_invisible_colors(rgba, width as usize);
    let lost = subsampling::lost(&visible, width as usize);
    let colors = opaque(&visible, (width, height), lost, settings)?;
    let alpha: Vec<u8> = rgba.as_chunks::<4>().0.iter().map(|p| p[3]).collect();
    let mut lossless = Vec::new();
    WebPEncoder::new_lossless(&mut lossless).encode(&alpha, width, height, ExtendedColorType::L8)?;
    let coded = chunk(&lossless, *b"VP8L").and_then(|chunk| chunk.get(LOSSLESS_HEADER..));
    let coded = coded.ok_or_else(|| failed("no lossless picture"))?;
    let colors = chunk(&colors, *b"VP8 ").ok_or_else(|| failed("no lossy picture"))?;
    let side = |pixels: u32| (pixels - 1).to_le_bytes();
    let canvas = [&HAS_ALPHA.to_le_bytes()[..], &side(width)[..3], &side(height)[..3]].concat();
    let mut file = b"RIFF\0\0\0\0WEBP".to_vec();
    push(&mut file, *b"VP8X", &[&canvas]);
    push(&mut file, *b"ALPH", &[&[ALPHA_COMPRESSED], coded]);
    push(&mut file, *b"VP8 ", &[colors]);
    let length = u32::try_from(file.len() - CHUNK_HEADER).map_err(|_| failed("too long"))?;
    file[4..CHUNK_HEADER].copy_from_slice(&length.to_le_bytes());
    Ok(file)
}

fn failed(why: &str) -> ImageError {
    ImageError::Encoding(EncodingError::new(ImageFormatHint::Exact(ImageFormat::WebP), why.to_owned()))
}

/// Contents of a file's first chunk, if it has this name.
fn chunk(file: &[u8], name: [u8; 4]) -> Option<&[u8]> {
    let rest = file.get(FILE_HEADER..)?.strip_prefix(&name)?;
    let length = u32::from_le_bytes(rest.get(..4)?.try_into().ok()?);
    rest.get(4..4 + length as usize)
}

fn push(file: &mut Vec<u8>, name: [u8; 4], contents: &[&[u8]]) {
    let length: usize = contents.iter().map(|part| part.len()).sum();
    file.extend(name);
    file.extend((length as u32).to_le_bytes());
    contents.iter().for_each(|part| file.extend_from_slice(part));
    file.extend(&[0][..length % 2]);
}

/// Colours in which invisible texels have the mean colour, weighted by opacity, of the visible ones in the smallest square
/// about them that has any, or of the last such square. Chroma is stored for two by two texels, and blocks are
/// transformed as wholes, so invisible colours would change visible ones.
fn without_invisible_colors(rgba: &[u8], width: usize) -> Vec<u8> {
    let pixels = rgba.as_chunks::<4>().0;
    let mut colors: Vec<[u8; 3]> = pixels.iter().map(|&[r, g, b, _]| [r, g, b]).collect();
    let mut pending: Vec<bool> = pixels.iter().map(|p| p[3] == 0).collect();
    if pending.contains(&true) {
        SQUARES_PX.into_iter().for_each(|side| fill(pixels, width, side, &mut colors, &mut pending));
    }
    colors.into_flattened()
}

/// Fills in squares of one size.
fn fill(pixels: &[[u8; 4]], width: usize, side: usize, colors: &mut [[u8; 3]], pending: &mut [bool]) {
    let height = pixels.len() / width;
    let largest = SQUARES_PX.last() == Some(&side);
    let mut mean = [0; 3];
    for top in (0..height).step_by(side) {
        for left in (0..width).step_by(side) {
            let columns = left..width.min(left + side);
            let texels =
                || (top..height.min(top + side)).flat_map(|y| columns.clone().map(move |x| y * width + x));
            if !largest && !texels().any(|i| pending[i]) {
                continue;
            }
            let (mut sums, mut weight) = ([0u32; 3], 0u32);
            for [r, g, b, a] in texels().map(|i| pixels[i].map(u32::from)) {
                weight += a;
                sums = [sums[0] + a * r, sums[1] + a * g, sums[2] + a * b];
            }
            if weight > 0 {
                mean = sums.map(|sum| ((sum + weight / 2) / weight) as u8);
            }
            if weight > 0 || largest {
                for i in texels().filter(|&i| std::mem::take(&mut pending[i])) {
                    colors[i] = mean;
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn libwebp_reads_the_opacity_that_was_written() {
        let (width, height) = (37, 21);
        let alpha = |i: u32| if i.is_multiple_of(5) { 0 } else { (i * 7 % 256) as u8 };
        let rgba: Vec<u8> =
            (0..width * height).flat_map(|i| [90, (i % 37) as u8 * 6, 30, alpha(i)]).collect();
        let file = with_alpha(&rgba, (width, height), TextureSettings::default()).unwrap();
        let decoded = ::webp::Decoder::new(&file).decode().unwrap();
        assert!(decoded.is_alpha());
        assert_eq!((decoded.width(), decoded.height()), (width, height));
        let ours = image::load_from_memory(&file).unwrap().into_rgba8();
        for ((read, ours), wanted) in decoded.chunks(4).zip(ours.pixels()).zip(rgba.chunks(4)) {
            assert_eq!((read[3], ours.0[3]), (wanted[3], wanted[3]));
            let off = read.iter().zip(ours.0).map(|(a, b)| a.abs_diff(b)).max();
            assert!(off <= Some(2), "{read:?} {ours:?}: the decoders differ");
        }
    }

    #[test]
    fn invisible_colours_are_those_beside() {
        // Two blocks: red beside hidden green, then nothing visible.
        let rgba: Vec<u8> =
            (0..32 * 16).flat_map(|i| if i % 32 < 4 { [200, 10, 0, 255] } else { [0, 255, 0, 0] }).collect();
        let colors = without_invisible_colors(&rgba, 32);
        assert!(colors.chunks(3).all(|color| color == [200, 10, 0]));
    }
}
