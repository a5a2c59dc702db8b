//! zstd compression for the codec [`Codec::Zstd`], in a crate of its own because `geometry` links no C.
//!
//! With that codec the base blob and every chunk are stored and sent as a zstd frame (RFC 8878) each. With the range
//! coder they are stored as they are, except a base blob that is smaller as a frame (zstd finds repetition that the
//! range coder misses). Readers call [`decode_base`] and [`decode_chunk`] in either case. Index pages are always
//! range-coded: sessions read them, and they are small.

#![cfg_attr(
    not(test),
    warn(
        clippy::cast_possible_truncation,
        clippy::cast_possible_wrap,
        clippy::cast_precision_loss,
        clippy::cast_sign_loss
    )
)]

mod frame;
#[cfg(feature = "files")]
pub mod whole_file;

use std::borrow::Cow;

use lodestream_geometry::base::Base;
use lodestream_geometry::index::ChunkInfo;
#[cfg(feature = "prepare")]
use lodestream_geometry::mesh::QuantisedMesh;
#[cfg(feature = "prepare")]
use lodestream_geometry::pool::{Monitor, Pool};
#[cfg(feature = "prepare")]
use lodestream_geometry::prepare::{self, Hooks, Prepared};
use lodestream_geometry::refine::{ActiveMesh, ChunkDelta, ChunkError};
use lodestream_geometry::{Codec, DecodeError};
#[cfg(feature = "prepare")]
use lodestream_geometry::{MeshError, Settings};

use frame::FrameHeader;

/// Compression level: the slowest without long tables, since a blob is compressed once. Higher levels gain nothing on
/// blobs of a few kilobytes.
#[cfg(feature = "c")]
const LEVEL: i32 = 19;
/// Magic number of a skippable frame, whose last four bits are free.
#[cfg(feature = "c")]
const SKIPPED_MAGIC: [u8; 4] = [0x50, 0x2a, 0x4d, 0x18];
/// Decompressed size allowed per frame, and additionally per compressed byte.
const FREE_BYTES: usize = 1 << 16;
const MAX_PER_BYTE: usize = 64;
/// Largest decompressed size of a frame.
const MAX_BYTES: usize = 1 << 26;

/// Decompressed size allowed for a frame of `stored` bytes.
fn limit(stored: usize) -> usize {
    stored.saturating_mul(MAX_PER_BYTE).saturating_add(FREE_BYTES).min(MAX_BYTES)
}

#[cfg(feature = "c")]
/// Compresses a blob. If it compresses better than [`decompress`] allows, a skippable frame is appended as padding.
///
/// # Errors
/// If the blob is larger than 64 MiB.
pub fn compress(plain: &[u8]) -> Result<Vec<u8>, DecodeError> {
    let fail = |why: String| DecodeError::new("compressed blob", why);
    if plain.len() > MAX_BYTES {
        return Err(fail(format!("{} bytes; at most {MAX_BYTES} are possible", plain.len())));
    }
    let mut out = zstd::bulk::compress(plain, LEVEL).map_err(|e| fail(e.to_string()))?;
    let least = plain.len().saturating_sub(FREE_BYTES).div_ceil(MAX_PER_BYTE);
    if let Some(missing) = least.checked_sub(out.len()).filter(|&m| m > 0) {
        let padding = missing.saturating_sub(8);
        out.extend(SKIPPED_MAGIC);
        let length = u32::try_from(padding).map_err(|_| fail(format!("{padding} bytes of padding")))?;
        out.extend(length.to_le_bytes());
        out.resize(out.len() + padding, 0);
    }
    Ok(out)
}

/// Decompresses a blob.
///
/// # Errors
/// If the bytes are not one frame with a stated size, the size exceeds the limit (64 KiB plus 64 bytes per byte), the
/// frame is damaged, or other data follows. Nothing is allocated before the size is checked.
pub fn decompress(stored: &[u8]) -> Result<Vec<u8>, DecodeError> {
    let fail = |why: String| DecodeError::new("compressed blob", why);
    let size = checked_size(stored).map_err(fail)?;
    let plain = decompress_frame(stored, size).map_err(fail)?;
    if plain.len() == size { Ok(plain) } else { Err(fail(format!("{} bytes of {size}", plain.len()))) }
}

/// Decompresses a frame of another format, whose file states the decompressed size: texels, for instance.
///
/// # Errors
/// If the bytes are not one frame that decompresses to `size` bytes. At most that and the window of a frame of that size
/// are allocated.
pub fn decompress_to(stored: &[u8], size: usize) -> Result<Vec<u8>, DecodeError> {
    let fail = |why: String| DecodeError::new("zstd frame", why);
    let header = FrameHeader::parse(stored).map_err(|why| fail(why.to_owned()))?;
    if header.content_bytes.is_some_and(|stated| stated != size as u64) {
        return Err(fail(format!("it states another size than {size} bytes")));
    }
    check_window(&header, size).map_err(fail)?;
    let plain = decompress_frame(stored, size).map_err(fail)?;
    if plain.len() == size { Ok(plain) } else { Err(fail(format!("{} bytes of {size}", plain.len()))) }
}

fn decompress_frame(stored: &[u8], size: usize) -> Result<Vec<u8>, String> {
    #[cfg(feature = "c")]
    return zstd::bulk::decompress(stored, size).map_err(|e| e.to_string());
    #[cfg(not(feature = "c"))]
    decompress_in_rust(stored, size)
}

/// Refuses a window, which a decoder reserves, that is much larger than the content: no encoder makes one.
fn check_window(header: &FrameHeader, size: usize) -> Result<(), String> {
    if header.window_bytes > size.next_power_of_two().max(FREE_BYTES) as u64 {
        return Err(format!("its window of {} bytes is larger than its content needs", header.window_bytes));
    }
    Ok(())
}

/// The decompressed size that a frame states, if it is allowed.
fn checked_size(stored: &[u8]) -> Result<usize, String> {
    let header = FrameHeader::parse(stored)?;
    let limit = limit(stored.len());
    let size = header.content_bytes.ok_or("its header lacks the decompressed size")?;
    let size = usize::try_from(size).ok().filter(|&size| size <= limit);
    let size =
        size.ok_or_else(|| format!("it claims more than the {limit} bytes that {} allow", stored.len()))?;
    check_window(&header, size)?;
    Ok(size)
}

/// Decompresses without C, for browsers: all frames, skippable ones included.
#[cfg(any(test, not(feature = "c")))]
fn decompress_in_rust(stored: &[u8], size: usize) -> Result<Vec<u8>, String> {
    let mut plain = vec![0; size];
    let length = ruzstd::decoding::FrameDecoder::new().decode_all(stored, &mut plain);
    plain.truncate(length.map_err(|why| why.to_string())?);
    Ok(plain)
}

/// Whether a blob begins with a frame. A range-coded base blob never does: its first byte is the format version.
fn is_frame(stored: &[u8]) -> bool {
    FrameHeader::is_frame(stored)
}

/// The payload that `geometry` decodes, from a stored chunk.
///
/// # Errors
/// As [`decompress`].
pub fn plain_chunk(codec: Codec, stored: &[u8]) -> Result<Cow<'_, [u8]>, DecodeError> {
    match codec {
        Codec::Range | Codec::AxisAligned => Ok(Cow::Borrowed(stored)),
        Codec::Zstd => decompress(stored).map(Cow::Owned),
    }
}

#[cfg(feature = "c")]
/// The base blob as stored: with the range coder, the smaller of the two forms.
///
/// # Errors
/// As [`Base::encode`] and [`compress`].
pub fn encode_base(base: &Base) -> Result<Vec<u8>, DecodeError> {
    match base.codec {
        Codec::Range | Codec::AxisAligned => {
            let blobs = base.encode_both()?;
            let frame = compress(&blobs.zstd)?;
            Ok(if frame.len() < blobs.range.len() { frame } else { blobs.range })
        }
        Codec::Zstd => compress(&base.encode()?),
    }
}

/// Decodes a stored base blob.
///
/// # Errors
/// As [`Base::decode`] and [`decompress`]; also if the asset's codec is zstd and the blob is not compressed.
pub fn decode_base(stored: &[u8]) -> Result<Base, DecodeError> {
    if is_frame(stored) {
        return Base::decode_as(&decompress(stored)?, Codec::Zstd);
    }
    let base = Base::decode(stored)?;
    if base.codec == Codec::Zstd {
        return Err(DecodeError::new("base mesh", "its codec is zstd, but it is not compressed"));
    }
    Ok(base)
}

/// Decodes a stored chunk up to a truncation point: [`ActiveMesh::decode_prefix`].
///
/// # Errors
/// As there, and as [`decompress`].
pub fn decode_prefix(
    mesh: &ActiveMesh,
    chunk: u32,
    info: &ChunkInfo,
    truncation: Option<u8>,
    stored: &[u8],
) -> Result<ChunkDelta, ChunkError> {
    let payload = plain_chunk(mesh.codec(), stored)
        .map_err(|e| DecodeError::new(format!("chunk {chunk}"), e.to_string()))?;
    mesh.decode_prefix(chunk, info, truncation, &payload)
}

/// Decodes a stored chunk: [`ActiveMesh::decode`].
///
/// # Errors
/// As there, and as [`decompress`].
pub fn decode_chunk(
    mesh: &ActiveMesh,
    chunk: u32,
    info: &ChunkInfo,
    stored: &[u8],
) -> Result<ChunkDelta, ChunkError> {
    decode_prefix(mesh, chunk, info, None, stored)
}

#[cfg(feature = "prepare")]
/// Prepares a mesh with [`prepare::prepare`]; chunks and their stated lengths are the stored ones.
///
/// # Errors
/// As there.
pub fn prepare(
    mesh: &QuantisedMesh,
    settings: &Settings,
    pool: &dyn Pool,
    monitor: &dyn Monitor,
) -> Result<Prepared, MeshError> {
    prepare_with_hooks(mesh, settings, Hooks::new(pool, monitor))
}

#[cfg(feature = "prepare")]
/// As [`prepare()`], with all callbacks of a preparation.
///
/// # Errors
/// As there.
pub fn prepare_with_hooks(
    mesh: &QuantisedMesh,
    settings: &Settings,
    hooks: Hooks<'_>,
) -> Result<Prepared, MeshError> {
    match settings.codec {
        Codec::Range | Codec::AxisAligned => prepare::prepare(mesh, settings, &hooks),
        Codec::Zstd => prepare::prepare(mesh, settings, &hooks.with_store(&|plain| compress(&plain))),
    }
}

#[cfg(test)]
mod tests {
    use lodestream_geometry::mesh::{Corner, SourceMesh};
    use lodestream_geometry::pool::{Serial, Silent};
    use lodestream_geometry::quantise::{QuantiseSettings, quantise};

    use super::*;

    /// Bytes that hardly compress (xorshift).
    fn noise(count: usize) -> Vec<u8> {
        let mut x = 1_u32;
        let mut next = || {
            x ^= x << 13;
            x ^= x >> 17;
            x ^= x << 5;
            x as u8
        };
        (0..count).map(|_| next()).collect()
    }

    #[test]
    fn blobs_of_any_content_round_trip() {
        for plain in [Vec::new(), vec![7], noise(5000), vec![0; 3000], vec![0; 9_000_000], noise(200_000)] {
            let stored = compress(&plain).unwrap();
            assert!(plain.len() <= limit(stored.len()));
            assert_eq!(decompress(&stored).unwrap(), plain);
        }
        // Nine million zeros compress to some hundred bytes, plus padding.
        assert!(compress(&vec![0; 9_000_000]).unwrap().len() > 100_000);
        assert!(compress(&vec![0; MAX_BYTES + 1]).is_err());
    }

    #[test]
    fn the_decoder_in_rust_gives_what_the_one_in_c_gives() {
        let texts = (0..5000_u32).flat_map(|i| (i * i % 977).to_le_bytes()).collect();
        for plain in [Vec::new(), vec![7], noise(5000), vec![0; 9_000_000], texts, noise(200_000)] {
            let stored = compress(&plain).unwrap();
            assert_eq!(decompress_in_rust(&stored, checked_size(&stored).unwrap()), Ok(plain));
        }
        let good = compress(&noise(300)).unwrap();
        for length in 14..good.len() {
            let cut = decompress_in_rust(&good[..length], 300);
            assert!(cut.is_err() || cut.is_ok_and(|plain| plain.len() < 300), "{length}");
        }
    }

    #[test]
    fn frames_of_other_formats_have_the_size_that_their_file_states() {
        // More than a blob may be per stored byte.
        let plain = vec![7; 1 << 24];
        let frame = zstd::bulk::compress(&plain, 3).unwrap();
        assert!(decompress(&frame).is_err());
        assert_eq!(decompress_to(&frame, plain.len()).unwrap(), plain);
        let unstated = zstd::stream::encode_all(&plain[..3000], 1).unwrap();
        for (frame, size) in [(&frame, 1 << 20), (&frame, 1 << 30), (&unstated, 2999), (&unstated, 3001)] {
            assert!(decompress_to(frame, size).is_err(), "{size}");
        }
        assert!(decompress_to(&frame[..frame.len() - 1], plain.len()).is_err());
        assert!(decompress_to(b"no frame", 8).is_err());
    }

    #[test]
    fn a_window_much_larger_than_the_content_is_refused() {
        // No single segment, a window of 2^30 bytes, four bytes of size.
        let frame = [&compress(b"").unwrap()[..4], &[0x80, 20 << 3], &100_u32.to_le_bytes()].concat();
        assert!(decompress(&frame).unwrap_err().to_string().contains("window"));
    }

    /// Unconnected triangles.
    fn tiles(positions: Vec<[f64; 3]>) -> QuantisedMesh {
        let count = (positions.len() / 3) as u32;
        let corner = Corner::at;
        let source = SourceMesh {
            positions,
            faces: (0..count).map(|i| [3 * i, 3 * i + 1, 3 * i + 2].map(corner)).collect(),
            materials: vec![0; count as usize],
            ..SourceMesh::default()
        };
        quantise(&source, &QuantiseSettings::default()).unwrap()
    }

    #[test]
    fn a_base_mesh_is_stored_as_what_is_smaller_and_read_as_either() {
        let corners = [[0.0, 0.0, 0.0], [9.0, 0.0, 2.0], [2.0, 9.0, 5.0]];
        let tile = |i: u32| {
            let at = [f64::from(i % 16) * 16.0, f64::from(i / 16) * 16.0, 0.0];
            corners.map(|c: [f64; 3]| [0, 1, 2].map(|k| at[k] + c[k]))
        };
        let alike = (0..200).flat_map(tile).collect();
        let unlike = noise(1800).chunks_exact(3).map(|c| [0, 1, 2].map(|k| f64::from(c[k]))).collect();
        let settings = Settings { base_error: 0.0, ..Settings::default() };
        for (mesh, framed) in [(tiles(alike), true), (tiles(unlike), false)] {
            let base = prepare(&mesh, &settings, &Serial, &Silent).unwrap().base;
            assert_eq!((base.codec, base.faces.len()), (Codec::Range, 200));
            let stored = encode_base(&base).unwrap();
            assert_eq!(is_frame(&stored), framed, "{} bytes", stored.len());
            assert!(decode_base(&stored).unwrap() == base);
        }
    }

    #[test]
    fn bombs_are_refused_before_anything_is_reserved() {
        for size in [1 << 20, 9_000_000, 100 << 20] {
            let bomb = zstd::bulk::compress(&vec![0; size], LEVEL).unwrap();
            let why = decompress(&bomb).unwrap_err().to_string();
            assert!(why.contains("allow"), "{why}");
        }
        // A bare frame header that claims 2^60 bytes: single segment, eight bytes of size.
        let mut forged = compress(b"").unwrap()[..4].to_vec();
        forged.push(0xe0);
        forged.extend((1_u64 << 60).to_le_bytes());
        assert!(decompress(&forged).unwrap_err().to_string().contains("allow"));
    }

    #[test]
    fn truncated_damaged_and_false_frames_are_refused() {
        let good = compress(&noise(300)).unwrap();
        for length in 0..good.len() {
            assert!(decompress(&good[..length]).is_err(), "{length}");
        }
        assert!(decompress(&[&good[..], &good[..]].concat()).is_err(), "two frames");
        assert!(decompress(&[&good[..], b"more"].concat()).is_err());
        let mut other = good;
        other[0] ^= 1;
        assert!(decompress(&other).unwrap_err().to_string().contains("not a zstd frame"));
        // A stream without a stated size.
        let unsized_frame = zstd::stream::encode_all(&noise(300)[..], LEVEL).unwrap();
        assert!(decompress(&unsized_frame).unwrap_err().to_string().contains("size"));
    }
}
