//! The finest level of KTX2 files (Khronos, "KTX File Format Specification", version 2.0): Basis Universal, ETC1S or
//! UASTC, as `KHR_texture_basisu` has it, or plain texels. Levels may be zstd frames.

use std::borrow::Cow;

use basisu::{DecodeFlags, TargetFormat, Transcoder};
use image::{DynamicImage, GrayImage, ImageBuffer, RgbImage, RgbaImage};

/// The first bytes of a file.
const MAGIC: &[u8; 12] = b"\xABKTX 20\xBB\r\n\x1A\n";
/// Lengths of the header and of a level's entry in the index that follows it (section 3), in bytes.
const HEADER_BYTES: usize = 80;
const LEVEL_BYTES: usize = 24;
/// Places of numbers in the header.
const LEVEL_COUNT: usize = 40;
const SCHEME: usize = 44;
const DESCRIPTION: usize = 48;
const KEY_VALUES: usize = 56;
/// Supercompression schemes.
const NONE: u32 = 0;
const BASIS_LZ: u32 = 1;
const ZSTANDARD: u32 = 2;
/// Colour models, in a byte of the data format description.
const MODEL_AT: usize = 12;
const MODEL_ETC1S: u8 = 163;
const MODEL_UASTC: u8 = 166;
/// Side of a block of UASTC in texels, and its length in bytes.
const BLOCK_SIDE: u32 = 4;
const BLOCK_BYTES: usize = 16;

/// How a file holds its texels.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Texels {
    Etc1s,
    Uastc,
    /// Bytes of a texel: 1, 3 or 4 channels.
    Bytes(usize),
    /// Grey of 16 bits.
    Deep,
}

/// A KTX2 file of one image, perhaps with coarser levels.
pub(super) struct Ktx2<'a> {
    bytes: &'a [u8],
    size_px: (u32, u32),
    texels: Texels,
    scheme: u32,
    /// The finest level, as it is stored.
    level: &'a [u8],
    /// The data format description.
    description: &'a [u8],
    /// Pairs of keys and values.
    key_values: &'a [u8],
}

fn number(bytes: &[u8], at: usize) -> Option<u32> {
    bytes.get(at..)?.first_chunk().map(|number| u32::from_le_bytes(*number))
}

fn long_number(bytes: &[u8], at: usize) -> Option<usize> {
    usize::try_from(u64::from_le_bytes(*bytes.get(at..)?.first_chunk()?)).ok()
}

fn section(bytes: &[u8], start: usize, length: usize) -> Option<&[u8]> {
    bytes.get(start..start.checked_add(length)?)
}

/// A section whose start and length two numbers of the header state.
fn section_at(bytes: &[u8], at: usize) -> Option<&[u8]> {
    section(bytes, number(bytes, at)? as usize, number(bytes, at + 4)? as usize)
}

impl<'a> Ktx2<'a> {
    /// Whether bytes begin as the format does.
    pub(super) fn is_one(bytes: &[u8]) -> bool {
        bytes.starts_with(MAGIC)
    }

    /// Reads the header. Nothing is decoded yet.
    ///
    /// # Errors
    /// Why the file cannot be read.
    pub(super) fn open(bytes: &'a [u8]) -> Result<Self, String> {
        let cut = || "it ends within its header or a section; it is cut short or damaged".to_owned();
        let header = bytes.get(..HEADER_BYTES).ok_or_else(cut)?;
        let [format, _, width, height, depth, layers, faces] =
            std::array::from_fn(|i| number(header, MAGIC.len() + 4 * i).unwrap_or_default());
        if depth > 0 || layers > 1 || faces != 1 {
            return Err("of KTX2 only plane images are read: no arrays, cube maps or volumes".to_owned());
        }
        let description = section_at(bytes, DESCRIPTION).ok_or_else(cut)?;
        // Numbers of Vulkan's formats.
        let texels = match (format, description.get(MODEL_AT)) {
            (0, Some(&MODEL_ETC1S)) => Texels::Etc1s,
            (0, Some(&MODEL_UASTC)) => Texels::Uastc,
            (9 | 15, _) => Texels::Bytes(1),
            (23 | 29, _) => Texels::Bytes(3),
            (37 | 43, _) => Texels::Bytes(4),
            (70, _) => Texels::Deep,
            (format, model) => {
                return Err(format!(
                    "of KTX2 only Basis Universal (ETC1S, UASTC), R8, R8G8B8, R8G8B8A8 and R16 are read, neither \
                     VkFormat {format} nor colour model {}; convert it",
                    model.copied().unwrap_or_default()
                ));
            }
        };
        let scheme = number(header, SCHEME).unwrap_or_default();
        let known = if texels == Texels::Etc1s { [BASIS_LZ; 2] } else { [NONE, ZSTANDARD] };
        if !known.contains(&scheme) {
            return Err(format!("supercompression {scheme} is not read with such texels; use zstd or none"));
        }
        // The first entry is the finest level's.
        let [start, length] = [0, 8].map(|at| long_number(bytes, HEADER_BYTES + at));
        let level =
            start.zip(length).and_then(|(start, length)| section(bytes, start, length)).ok_or_else(cut)?;
        let key_values = section_at(bytes, KEY_VALUES).ok_or_else(cut)?;
        Ok(Self { bytes, size_px: (width, height), texels, scheme, level, description, key_values })
    }

    /// Width and height, in pixels.
    pub(super) fn size(&self) -> (u32, u32) {
        self.size_px
    }

    /// Decodes the finest level. The caller has checked the size.
    ///
    /// # Errors
    /// Why it cannot be decoded.
    pub(super) fn decode(&self) -> Result<DynamicImage, String> {
        let (width, height) = self.size();
        let pixels = width as usize * height as usize;
        let image = match self.texels {
            Texels::Etc1s => self.transcoded(self.bytes)?,
            Texels::Uastc => {
                let blocks = width.div_ceil(BLOCK_SIDE) as usize * height.div_ceil(BLOCK_SIDE) as usize;
                let level = self.level(blocks * BLOCK_BYTES)?;
                self.transcoded(&self.alone(&level))?
            }
            Texels::Bytes(channels) => {
                let level = self.level(pixels * channels)?.into_owned();
                let image = match channels {
                    1 => GrayImage::from_raw(width, height, level).map(DynamicImage::from),
                    3 => RgbImage::from_raw(width, height, level).map(DynamicImage::from),
                    _ => RgbaImage::from_raw(width, height, level).map(DynamicImage::from),
                };
                image.unwrap_or_default()
            }
            Texels::Deep => {
                let level = self.level(pixels * 2)?;
                let samples =
                    level.as_chunks::<2>().0.iter().map(|sample| u16::from_le_bytes(*sample)).collect();
                ImageBuffer::from_raw(width, height, samples)
                    .map(DynamicImage::ImageLuma16)
                    .unwrap_or_default()
            }
        };
        Ok(self.turned(image))
    }

    /// The bytes of the finest level, which has exactly this length once it is decompressed.
    fn level(&self, length: usize) -> Result<Cow<'_, [u8]>, String> {
        let level = match self.scheme {
            ZSTANDARD => {
                // Reserves the length, not what the frame states.
                let plain = lodestream_compress::decompress_to(self.level, length);
                plain.map_err(|error| format!("its level is no frame of {length} bytes: {error}"))?.into()
            }
            _ => Cow::Borrowed(self.level),
        };
        if level.len() != length {
            return Err(format!("its level has {} bytes instead of {length}", level.len()));
        }
        Ok(level)
    }

    /// A file of one level of UASTC without zstd: the transcoder is given no compressed ones, whose size it would not check
    /// against ours.
    fn alone(&self, level: &[u8]) -> Vec<u8> {
        let mut header = self.bytes[..HEADER_BYTES].to_vec();
        let start = HEADER_BYTES + LEVEL_BYTES;
        let description = [start as u32, self.description.len() as u32].map(u32::to_le_bytes).concat();
        header[LEVEL_COUNT..SCHEME + 4].copy_from_slice(&[1, NONE].map(u32::to_le_bytes).concat());
        header[DESCRIPTION..KEY_VALUES].copy_from_slice(&description);
        header[KEY_VALUES..].fill(0);
        let entry = [start + self.description.len(), level.len(), level.len()];
        let entry = entry.map(|number| (number as u64).to_le_bytes()).concat();
        [&header, &entry, self.description, level].concat()
    }

    /// Decodes the finest level of a Basis Universal file.
    fn transcoded(&self, file: &[u8]) -> Result<DynamicImage, String> {
        let (width, height) = self.size();
        let transcoded =
            Transcoder::new(file).and_then(|file| file.transcode(0, TargetFormat::Rgba32, DecodeFlags::NONE));
        let texels =
            transcoded.map_err(|error| format!("its Basis Universal data cannot be decoded: {error:?}"))?;
        RgbaImage::from_raw(width, height, texels)
            .map(DynamicImage::from)
            .ok_or_else(|| "it is cut".to_owned())
    }

    /// Turns an image whose rows or columns run the other way, as `KTXorientation` states.
    fn turned(&self, mut image: DynamicImage) -> DynamicImage {
        let directions = self.value("KTXorientation").unwrap_or_default();
        if directions.first() == Some(&b'l') {
            image = image.fliph();
        }
        if directions.get(1) == Some(&b'u') {
            image = image.flipv();
        }
        image
    }

    /// The value of a key (section 3.11).
    fn value(&self, key: &str) -> Option<&'a [u8]> {
        let mut rest = self.key_values;
        while let Some(length) = number(rest, 0) {
            let length = length as usize;
            let pair = section(rest, 4, length)?;
            if let Some(value) = pair.strip_prefix(key.as_bytes()).and_then(|rest| rest.strip_prefix(b"\0")) {
                return Some(value);
            }
            rest = rest.get(4 + length.next_multiple_of(4)..).unwrap_or_default();
        }
        None
    }
}
