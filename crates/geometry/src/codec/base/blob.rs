//! The base blob: head, description and base mesh as bytes.

use crate::asset::base::{Base, BaseBlobs, FORMAT_VERSION, MAX_CHUNKS, MAX_DESCRIPTION_BYTES, Totals};
use crate::asset::index::Sphere;
use crate::codec::base;
use crate::codec::base::mesh::{BaseFormat, BaseMesh, BothCodecs};
use crate::entropy::Codec;
use crate::entropy::bytes::{Reader, put_varint};
use crate::error::DecodeError;
use crate::mesh::{Grid, Kinds, UvGrid};
use crate::mesh::{MAX_PARTS, MAX_POSITION_BITS, MAX_UV_BITS};
use crate::numbers::id32;

/// Codec of the chunks, in the top two bits of the byte that holds the position bits.
const AXIS_ALIGNED: u8 = 0xc0;
const PLAIN: u8 = 0x80;
/// An earlier form of axis-aligned, without projected textures; no longer readable.
const AXIS_ALIGNED_V1: u8 = 0x40;
const CODED: u8 = 0xc0;
/// In the byte of attributes: the number of parts follows that of materials.
const HAS_PARTS: u8 = 0x20;
/// In the byte of attributes: bits of texture coordinates.
const UV_BITS: u8 = 0x1f;
/// In the byte of attributes, in place of the bits of texture coordinates: there is a second set, and a byte each for
/// the bits of both sets precedes their grids.
const TWO_UV_SETS: u8 = 0x1f;
/// In the byte of position bits: vertices have skins.
const HAS_SKINS: u8 = 0x20;

impl Base {
    /// Encodes the blob. Vertices, wedges and faces must be in traversal order, as [`crate::prepare::prepare`] and
    /// [`Base::decode`] return them.
    ///
    /// # Errors
    /// On more than [`crate::base::MAX_BASE_FACES`] faces and on faces with a repeated vertex.
    pub fn encode(&self) -> Result<Vec<u8>, DecodeError> {
        self.encode_as(self.codec)
    }

    /// Encodes the blob with the mesh coded by `mesh`, independent of the chunks' codec. The blob does not record
    /// which, so its container must ([`Base::decode_as`]).
    ///
    /// # Errors
    /// As [`Base::encode`].
    pub fn encode_as(&self, mesh: Codec) -> Result<Vec<u8>, DecodeError> {
        let (head, base, format) = self.parts();
        Ok([head, base::encode(&base, mesh, format)?].concat())
    }

    /// Encodes the blob with each codec, cheaper than one after the other.
    ///
    /// # Errors
    /// As [`Base::encode`].
    pub fn encode_both(&self) -> Result<BaseBlobs, DecodeError> {
        let (head, base, format) = self.parts();
        let BothCodecs { range, plain } = base::encode_both(&base, format)?;
        Ok(BaseBlobs { range: [&head[..], &range].concat(), zstd: [head, plain].concat() })
    }

    /// Bytes of the head and the description; the mesh to encode, and its format.
    fn parts(&self) -> (Vec<u8>, BaseMesh, BaseFormat) {
        let two_sets = self.second_uv_grid.bits > 0;
        let kinds = if two_sets { TWO_UV_SETS } else { self.uv_grid.bits }
            | if self.part_count > 1 { HAS_PARTS } else { 0 }
            | u8::from(self.colors) << 6
            | u8::from(self.normals) << 7;
        let coded = match self.codec {
            Codec::Range => 0,
            Codec::AxisAligned => AXIS_ALIGNED,
            Codec::Zstd => PLAIN,
        };
        let skins = if self.skinned { HAS_SKINS } else { 0 };
        let mut out = vec![FORMAT_VERSION, self.grid.bits | coded | skins, kinds, self.level_count];
        let shift = common_shift(&self.positions, self.shifts[0]);
        put_shifts(&mut out, shift, &self.shifts);
        for x in self.grid.origin.iter().chain([&self.grid.step]) {
            out.extend(x.to_le_bytes());
        }
        let uv_grids = [&self.uv_grid, &self.second_uv_grid];
        if two_sets {
            out.extend(uv_grids.map(|grid| grid.bits));
        }
        for grid in uv_grids.into_iter().filter(|grid| grid.bits > 0) {
            for x in grid.origin.iter().chain(&grid.step) {
                out.extend(x.to_le_bytes());
            }
        }
        for x in self.sphere.center.iter().chain([&self.sphere.radius, &self.diagonal, &self.geometric_error])
        {
            out.extend(x.to_le_bytes());
        }
        put_varint(&mut out, u64::from(self.chunk_count));
        put_varint(&mut out, u64::from(self.material_count));
        if self.part_count > 1 {
            put_varint(&mut out, u64::from(self.part_count));
        }
        for total in [self.totals.vertices, self.totals.wedges, self.totals.faces] {
            put_varint(&mut out, total);
        }
        put_varint(&mut out, self.description.len() as u64);
        out.extend(&self.description);
        let base = BaseMesh {
            positions: self.positions.iter().map(|p| p.map(|x| x >> shift)).collect(),
            wedges: self.wedges.clone(),
            faces: self.faces.clone(),
            parts: self.parts.clone(),
            skins: self.skins.clone(),
        };
        let bits = self.grid.bits - shift;
        let format = BaseFormat::new(bits, self.kinds(), self.material_count, self.part_count, uv_grids);
        (out, base, format)
    }

    /// Decodes a blob.
    ///
    /// # Errors
    /// For other versions, truncated data, and values out of range.
    pub fn decode(bytes: &[u8]) -> Result<Self, DecodeError> {
        Self::read(bytes, None)
    }

    /// Decodes a blob of [`Base::encode_as`].
    ///
    /// # Errors
    /// As [`Base::decode`].
    pub fn decode_as(bytes: &[u8], mesh: Codec) -> Result<Self, DecodeError> {
        Self::read(bytes, Some(mesh))
    }

    fn read(bytes: &[u8], mesh: Option<Codec>) -> Result<Self, DecodeError> {
        let mut r = Reader::new(bytes, "base mesh");
        let version = r.u8()?;
        if version != FORMAT_VERSION {
            return Err(r.error(format!("format version {version}; this program reads {FORMAT_VERSION}")));
        }
        let (bits, kinds, level_count) = (r.u8()?, r.u8()?, r.u8()?);
        let codec = match bits & CODED {
            0 => Codec::Range,
            AXIS_ALIGNED => Codec::AxisAligned,
            PLAIN => Codec::Zstd,
            AXIS_ALIGNED_V1 => {
                return Err(r.error("its axis-aligned coding is an old version: prepare the model again"));
            }
            _ => return Err(r.error("unknown codec of its chunks")),
        };
        let (bits, skinned) = (bits & !(CODED | HAS_SKINS), bits & HAS_SKINS != 0);
        let (uv_bits, colors, normals) = (kinds & UV_BITS, kinds & 0x40 != 0, kinds & 0x80 != 0);
        let two_sets = uv_bits == TWO_UV_SETS;
        if !(1..=MAX_POSITION_BITS).contains(&bits) || uv_bits > MAX_UV_BITS && !two_sets {
            return Err(r.error(format!("{bits} position bits and {uv_bits} uv bits are out of range")));
        }
        let (shift, shifts) = read_shifts(&mut r, level_count, bits)?;
        let grid = Grid { origin: [r.f64()?, r.f64()?, r.f64()?], step: r.f64()?, bits };
        let [uv_bits, second_uv_bits] = if two_sets { [r.u8()?, r.u8()?] } else { [uv_bits, 0] };
        if uv_bits > MAX_UV_BITS || second_uv_bits > MAX_UV_BITS || two_sets && second_uv_bits == 0 {
            return Err(r.error(format!("{uv_bits} and {second_uv_bits} uv bits are out of range")));
        }
        let (uv_grid, second_uv_grid) =
            (read_uv_grid(&mut r, uv_bits)?, read_uv_grid(&mut r, second_uv_bits)?);
        // Renderers use f32 positions relative to the grid's origin.
        let fits = |size: f64| size <= f64::from(f32::MAX);
        let cells = |bits: u8| f64::from(1_u32 << bits);
        let uv_fits = |grid: &UvGrid| {
            (0..2).all(|k| fits(grid.origin[k].abs() + grid.step[k].abs() * cells(grid.bits)))
        };
        if !fits(grid.step.abs() * cells(bits)) || !uv_fits(&uv_grid) || !uv_fits(&second_uv_grid) {
            return Err(r.error("its grids reach beyond 32-bit numbers"));
        }
        let sphere = Sphere { center: [r.f32()?, r.f32()?, r.f32()?], radius: r.f32()? };
        let (diagonal, geometric_error) = (r.f32()?, r.f32()?);
        if grid.step < 0.0 || sphere.radius < 0.0 || geometric_error < 0.0 {
            return Err(r.error("a length is negative"));
        }
        let chunk_count = r.varint32(MAX_CHUNKS)?;
        let material_count = r.varint32(u16::MAX.into())?;
        let material_count = u16::try_from(material_count).map_err(|_| r.error("too many materials"))?;
        let part_count = if kinds & HAS_PARTS == 0 { 1 } else { r.varint32(MAX_PARTS)? };
        if kinds & HAS_PARTS != 0 && part_count < 2 {
            return Err(r.error("it is marked as several parts and has fewer than two"));
        }
        let limit = u64::from(u32::MAX);
        let totals = Totals { vertices: r.varint(limit)?, wedges: r.varint(limit)?, faces: r.varint(limit)? };
        let length = r.varint32(id32(MAX_DESCRIPTION_BYTES))? as usize;
        let description = r.take(length)?.to_vec();
        let rest = r.remaining();
        let kinds = Kinds { uv_bits, second_uv_bits, colors, normals, skins: skinned };
        let uv_grids = [&uv_grid, &second_uv_grid];
        let format = BaseFormat::new(bits - shift, kinds, material_count, part_count, uv_grids);
        let mesh = base::decode(r.take(rest)?, mesh.unwrap_or(codec), format)?;
        Ok(Self {
            grid,
            uv_grid,
            second_uv_grid,
            sphere,
            diagonal,
            geometric_error,
            chunk_count,
            level_count,
            material_count,
            part_count,
            codec,
            colors,
            normals,
            skinned,
            totals,
            description,
            positions: mesh.positions.iter().map(|p| p.map(|x| x << shift)).collect(),
            shifts,
            wedges: mesh.wedges,
            faces: mesh.faces,
            parts: mesh.parts,
            skins: mesh.skins,
        })
    }
}

/// The grid of a set of texture coordinates with the given bits; nothing is stored of a set without.
fn read_uv_grid(r: &mut Reader<'_>, bits: u8) -> Result<UvGrid, DecodeError> {
    if bits == 0 {
        return Ok(UvGrid::NONE);
    }
    Ok(UvGrid { origin: [r.f64()?, r.f64()?], step: [r.f64()?, r.f64()?], bits })
}

/// Number of low bits that are zero in all coordinates, at most `most`.
fn common_shift(positions: &[[i32; 3]], most: u8) -> u8 {
    let low = positions.iter().flatten().fold(0, |all, x| all | x).trailing_zeros();
    u8::try_from(low).map_or(most, |low| low.min(most))
}

/// Writes shifts (low bits left out): the common shift of the encoded positions, the coarsest grid's, and each
/// level's decrease, half a byte each.
fn put_shifts(out: &mut Vec<u8>, own: u8, shifts: &[u8]) {
    out.push(own | shifts[0] << 4);
    let falls: Vec<u8> = shifts.windows(2).map(|pair| pair[0] - pair[1]).collect();
    out.extend(falls.chunks(2).map(|f| f[0] | f.get(1).map_or(0, |fall| fall << 4)));
}

fn read_shifts(r: &mut Reader<'_>, levels: u8, bits: u8) -> Result<(u8, Vec<u8>), DecodeError> {
    let first = r.u8()?;
    let (own, mut last) = (first & 15, first >> 4);
    if own > last || last >= bits {
        return Err(r.error(format!("grids that leave out {own} and {last} of {bits} bits are out of range")));
    }
    let mut shifts = vec![last];
    let mut byte = 0;
    for level in 0..levels {
        byte = if level % 2 == 0 { r.u8()? } else { byte >> 4 };
        last = last.checked_sub(byte & 15).ok_or_else(|| r.error("a grid is finer than the finest"))?;
        shifts.push(last);
    }
    if last != 0 && levels > 0 {
        return Err(r.error("its finest grid leaves out bits"));
    }
    Ok((own, shifts))
}
