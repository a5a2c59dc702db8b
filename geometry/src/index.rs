//! What a client must know of a chunk before it asks for it: the chunk index.

use crate::error::DecodeError;
use crate::symbols::{Reader, put_varint};

/// Chunks per index page.
pub const CHUNKS_PER_PAGE: usize = 64;

/// A bounding sphere, in the asset's units, relative to the asset's own origin.
#[derive(Clone, Copy, Debug, PartialEq, Default)]
pub struct Sphere {
    /// Centre.
    pub center: [f32; 3],
    /// Radius.
    pub radius: f32,
}

/// A stopping point inside a chunk: what is there once the first `payload_bytes` of the payload are
/// decoded and applied. Legal only while no chunk that has this one as a parent is applied.
#[derive(Clone, Copy, Debug, PartialEq, Default)]
pub struct Stop {
    /// Bytes of the payload that suffice to decode up to here.
    pub payload_bytes: u32,
    /// Geometric error of the region once the chunk is applied up to here, in the asset's units:
    /// at most the chunk's own.
    pub error: f32,
    /// Vertices added up to here.
    pub vertices: u32,
    /// Wedges added up to here.
    pub wedges: u32,
    /// Faces added up to here.
    pub faces: u32,
}

/// One chunk's entry in the index. Chunks are numbered coarse to fine: parents have smaller ids.
#[derive(Clone, Debug, PartialEq, Default)]
pub struct ChunkInfo {
    /// Level that the chunk leads to; level 0 is the base mesh, so this is at least 1.
    pub level: u8,
    /// Bounds of the region's input surface and of its coarse surface.
    pub sphere: Sphere,
    /// Geometric error while the chunk is missing, in the asset's units. Never smaller than that of
    /// any chunk that has this one as a parent.
    pub error: f32,
    /// How far attributes slide while the chunk is missing, as a length in the asset's units
    /// (ARCHITECTURE.md, "Errors"): texture over the surface, and shading. Monotone like `error`.
    pub attribute_error: f32,
    /// Stopping points before the chunk's end, coarse to fine.
    pub stops: Vec<Stop>,
    /// Ids of the chunks that must be applied before this one, ascending.
    pub parents: Vec<u32>,
    /// Bytes of the payload.
    pub payload_bytes: u32,
    /// Vertices that the chunk adds (its vertex splits).
    pub vertices: u32,
    /// Wedges that the chunk adds.
    pub wedges: u32,
    /// Faces that the chunk adds.
    pub faces: u32,
}

/// The number of pages that `chunks` entries fill.
#[must_use]
pub fn page_count(chunks: usize) -> usize {
    chunks.div_ceil(CHUNKS_PER_PAGE)
}

/// Encodes the entries of one page.
///
/// Radii and errors are rounded up to 16 bits, centres to 24: the sphere still bounds, the error still
/// does, and a parent's error still is not below its child's.
#[must_use]
pub fn encode_page(infos: &[ChunkInfo], first: u32) -> Vec<u8> {
    let mut out = Vec::with_capacity(infos.len() * 24 + 1);
    put_varint(&mut out, infos.len() as u64);
    for (i, info) in infos.iter().enumerate() {
        let id = first + i as u32;
        out.push(info.level);
        for x in info.sphere.center {
            out.extend(&round24(x).to_bits().to_le_bytes()[1..]);
        }
        out.extend(&round16_up(info.sphere.radius).to_bits().to_le_bytes()[2..]);
        out.extend(&round16_up(info.error).to_bits().to_le_bytes()[2..]);
        put_varint(&mut out, info.parents.len() as u64);
        for parent in &info.parents {
            put_varint(&mut out, u64::from(id - parent));
        }
        for count in [info.payload_bytes, info.vertices, info.wedges, info.faces] {
            put_varint(&mut out, u64::from(count));
        }
    }
    out
}

/// What a reader of [`encode_page`]'s bytes will see.
#[must_use]
pub fn rounded(info: &ChunkInfo) -> ChunkInfo {
    let center = info.sphere.center.map(round24);
    let moved: f32 = (0..3).map(|k| (center[k] - info.sphere.center[k]).abs()).sum();
    let sphere = Sphere { center, radius: round16_up(info.sphere.radius + moved) };
    ChunkInfo { sphere, error: round16_up(info.error), ..info.clone() }
}

/// Drops the lowest byte.
fn round24(x: f32) -> f32 {
    f32::from_bits(x.to_bits() & 0xffff_ff00)
}

/// The least float of 16 significant bits (sign, exponent, 7 of mantissa) that is not below `x >= 0`.
fn round16_up(x: f32) -> f32 {
    let bits = x.max(0.0).to_bits();
    f32::from_bits(bits.saturating_add(0xffff).min(f32::MAX.to_bits()) & 0xffff_0000)
}

/// Decodes one index page, as sent on the wire.
///
/// `first` is the id of the page's first chunk (`page × CHUNKS_PER_PAGE`).
///
/// # Errors
/// Refuses truncated pages, counts beyond [`CHUNKS_PER_PAGE`], parents that are not older than their
/// child, and values that are not finite.
pub fn decode_page(bytes: &[u8], first: u32) -> Result<Vec<ChunkInfo>, DecodeError> {
    let mut r = Reader::new(bytes, "index page");
    let count = r.varint(CHUNKS_PER_PAGE as u64)? as usize;
    let mut infos = Vec::with_capacity(count);
    for i in 0..count {
        let id = first.checked_add(i as u32).ok_or_else(|| r.error("a chunk id is out of range"))?;
        let level = r.u8()?;
        let mut center = [0.0; 3];
        for x in &mut center {
            let [a, b, c] = r.array()?;
            *x = finite(&r, f32::from_le_bytes([0, a, b, c]))?;
        }
        let mut length = || -> Result<f32, DecodeError> {
            let [a, b] = r.array()?;
            let value = finite(&r, f32::from_le_bytes([0, 0, a, b]))?;
            if value < 0.0 { Err(r.error("a length is negative")) } else { Ok(value) }
        };
        let (radius, error) = (length()?, length()?);
        let parent_count = r.varint(r.remaining() as u64)? as usize;
        let mut parents = Vec::with_capacity(parent_count.min(64));
        for _ in 0..parent_count {
            let back = r.varint(u64::from(id))? as u32;
            let parent = id - back;
            if back == 0 || parents.last().is_some_and(|&p| p >= parent) {
                return Err(r.error(format!("chunk {id} has a parent {parent} out of order")));
            }
            parents.push(parent);
        }
        let mut number = || r.varint(u64::from(u32::MAX)).map(|n| n as u32);
        let (payload_bytes, vertices, wedges, faces) = (number()?, number()?, number()?, number()?);
        infos.push(ChunkInfo {
            level,
            sphere: Sphere { center, radius },
            error,
            attribute_error: 0.0,
            stops: Vec::new(),
            parents,
            payload_bytes,
            vertices,
            wedges,
            faces,
        });
    }
    r.end()?;
    Ok(infos)
}

fn finite(r: &Reader<'_>, value: f32) -> Result<f32, DecodeError> {
    if value.is_finite() { Ok(value) } else { Err(r.error("a number is not finite")) }
}
