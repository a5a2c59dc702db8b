//! Steps of changes as bytes, to pass them from the worker, where they are made, to the page, where they are drawn. The
//! two have no memory in common. The encoding is that of the scene crate; it is never stored or sent over a network.

use lodestream_client::core::{Change, IndexRun, MeshChange, NewAsset, TextureChange, TexturePixels, Vertex};
use lodestream_geometry::mesh::skin::Skin;
use lodestream_geometry::refine::RenderVertex;
use lodestream_scene::animation::AnimatedModel;
use lodestream_scene::blob::Tile;
use lodestream_scene::encoding::{CodingError, Decode, Encode, Reader, SliceReader};
use lodestream_scene::instances;
use lodestream_scene::punctual_lights::{PunctualLight, Spot};
use lodestream_terrain::{HeightOverride, HeightOverrides, Mode};

/// Why bytes are no step.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum StepError {
    /// They do not follow the encoding.
    #[error("step of changes: {0}")]
    Coding(#[from] CodingError),
    /// An unknown kind of change.
    #[error("step of changes: unknown kind {0}")]
    Kind(u8),
    /// The file of a texture level, which the worker has to replace by the number of its picture.
    #[error("step of changes: a texture level that is not decoded")]
    File,
    /// Overrides that contradict each other.
    #[error("step of changes: {0}")]
    Terrain(String),
    /// An animated model that is not valid.
    #[error("step of changes: {0}")]
    Animation(String),
}

/// Finest level of a patch that can hold all places of an override.
const MAX_PATCH_LEVEL: u8 = 15;

/// The bytes of a step.
///
/// # Errors
/// A value that its decoder would refuse.
pub fn encode(step: &[Change]) -> Result<Vec<u8>, StepError> {
    let mut out = Vec::with_capacity(step.iter().map(|change| change.bytes() + 64).sum());
    length(step.len(), &mut out)?;
    for change in step {
        encode_change(change, &mut out)?;
    }
    Ok(out)
}

/// The step in these bytes.
///
/// # Errors
/// Bytes that [`encode`] did not write.
pub fn decode(bytes: &[u8]) -> Result<Vec<Change>, StepError> {
    let mut reader = SliceReader::new(bytes, usize::MAX);
    let count = count(&mut reader)?;
    let step = (0..count).map(|_| decode_change(&mut reader)).collect::<Result<_, _>>()?;
    reader.finish()?;
    Ok(step)
}

fn length(length: usize, out: &mut Vec<u8>) -> Result<(), CodingError> {
    u64::try_from(length).unwrap_or(u64::MAX).encode(out)
}

/// A value of any type.
fn get<T: Decode, R: Reader>(reader: &mut R) -> Result<T, CodingError> {
    T::decode(reader)
}

/// The number of elements of a list, each of which takes at least one byte.
fn count<R: Reader>(reader: &mut R) -> Result<usize, CodingError> {
    let count = usize::try_from(u64::decode(reader)?).unwrap_or(usize::MAX);
    if reader.has(count) { Ok(count) } else { Err(CodingError::EndsEarly) }
}

fn encode_change(change: &Change, out: &mut Vec<u8>) -> Result<(), StepError> {
    match change {
        Change::Scene(header) => (0_u8, header).encode(out)?,
        Change::PunctualLights { count } => (1_u8, *count).encode(out)?,
        Change::PunctualLightPage { page, punctual_lights } => {
            (2_u8, *page).encode(out)?;
            length(punctual_lights.len(), out)?;
            for light in &**punctual_lights {
                (light.position, light.intensity, light.range).encode(out)?;
                u8::from(light.spot.is_some()).encode(out)?;
                if let Some(Spot { direction, inner, outer }) = light.spot {
                    (direction, inner, outer).encode(out)?;
                }
            }
        }
        Change::Instances(list) => {
            3_u8.encode(out)?;
            instances::encode(list, out)?;
        }
        Change::Proxies(proxies) => (9_u8, proxies).encode(out)?,
        Change::Cut(cut) => (10_u8, cut).encode(out)?,
        Change::Asset(asset) => {
            (4_u8, asset.asset).encode(out)?;
            (asset.origin, asset.center, asset.radius).encode(out)?;
            (&asset.materials, &asset.textures, &asset.shared).encode(out)?;
        }
        Change::Mesh(mesh) => encode_mesh(mesh, out)?,
        Change::FirstFrame => 6_u8.encode(out)?,
        Change::Animation { number, model } => {
            let bytes = model.to_bytes().map_err(|why| StepError::Animation(why.to_string()))?;
            (12_u8, *number, bytes).encode(out)?;
        }
        &Change::TileRemoved { asset, tile: Tile { texture, level, tile } } => {
            (11_u8, asset).encode(out)?;
            (texture, level, tile).encode(out)?;
        }
        Change::Texture(texture) => {
            (7_u8, texture.asset, texture.texture, texture.level).encode(out)?;
            texture.tile.encode(out)?;
            encode_pixels(&texture.pixels, out)?;
        }
        Change::HeightOverrides { x, y, overrides } => {
            (8_u8, x.cast_unsigned(), y.cast_unsigned()).encode(out)?;
            length(overrides.as_slice().len(), out)?;
            for point in overrides.as_slice() {
                let fixed = u8::from(point.mode == Mode::Fixed);
                (point.x, point.y, fixed, point.height).encode(out)?;
            }
        }
    }
    Ok(())
}

fn decode_change<R: Reader>(reader: &mut R) -> Result<Change, StepError> {
    Ok(match u8::decode(reader)? {
        0 => Change::Scene(Decode::decode(reader)?),
        1 => Change::PunctualLights { count: u32::decode(reader)? },
        2 => {
            let page = u32::decode(reader)?;
            let lights = (0..count(reader)?).map(|_| decode_light(reader)).collect::<Result<Vec<_>, _>>()?;
            Change::PunctualLightPage { page, punctual_lights: lights.into() }
        }
        3 => Change::Instances(instances::decode(reader)?),
        9 => Change::Proxies(Decode::decode(reader)?),
        10 => Change::Cut(Decode::decode(reader)?),
        4 => Change::Asset(NewAsset {
            asset: get(reader)?,
            origin: get(reader)?,
            center: get(reader)?,
            radius: get(reader)?,
            materials: get(reader)?,
            textures: get(reader)?,
            shared: get(reader)?,
        }),
        5 => Change::Mesh(decode_mesh(reader)?),
        6 => Change::FirstFrame,
        12 => {
            let (number, bytes): (u32, Vec<u8>) = (get(reader)?, get(reader)?);
            let model =
                AnimatedModel::from_bytes(&bytes).map_err(|why| StepError::Animation(why.to_string()))?;
            Change::Animation { number, model: model.into() }
        }
        11 => Change::TileRemoved {
            asset: get(reader)?,
            tile: Tile { texture: get(reader)?, level: get(reader)?, tile: get(reader)? },
        },
        7 => Change::Texture(TextureChange {
            asset: get(reader)?,
            texture: get(reader)?,
            level: get(reader)?,
            tile: get(reader)?,
            pixels: decode_pixels(reader)?.into(),
        }),
        8 => {
            let (x, y): (u64, u64) = (get(reader)?, get(reader)?);
            let points = (0..count(reader)?).map(|_| {
                let (x, y) = (get(reader)?, get(reader)?);
                let mode = if u8::decode(reader)? == 1 { Mode::Fixed } else { Mode::Additive };
                Ok(HeightOverride { x, y, mode, height: get(reader)? })
            });
            let points = points.collect::<Result<Vec<_>, CodingError>>()?;
            let overrides = HeightOverrides::new(MAX_PATCH_LEVEL, points);
            let overrides = overrides.map_err(|why| StepError::Terrain(why.to_string()))?;
            Change::HeightOverrides { x: x.cast_signed(), y: y.cast_signed(), overrides }
        }
        kind => return Err(StepError::Kind(kind)),
    })
}

fn decode_light<R: Reader>(reader: &mut R) -> Result<PunctualLight, CodingError> {
    let (position, intensity, range) = (get(reader)?, get(reader)?, get(reader)?);
    let spot = if u8::decode(reader)? == 0 {
        None
    } else {
        Some(Spot { direction: get(reader)?, inner: get(reader)?, outer: get(reader)? })
    };
    Ok(PunctualLight { position, intensity, range, spot })
}

/// Bytes of an encoded vertex without its skin and its second set of texture coordinates.
const VERTEX_BYTES: usize = 56;
/// Bytes of an encoded skin: four joints, four weights.
const SKIN_BYTES: usize = 8;
/// Bytes of encoded texture coordinates.
const UV_BYTES: usize = 8;
/// The word of flags holds whether the vertex is smooth, its level, and from this bit on its part, which has 20 bits.
const PART_SHIFT: u32 = 9;
/// Levels of an asset are at most 255.
const MAX_LEVEL: u32 = 255;
/// Bytes of an encoded face.
const FACE_BYTES: usize = 12;

fn encode_mesh(mesh: &MeshChange, out: &mut Vec<u8>) -> Result<(), CodingError> {
    let any = |has: fn(&RenderVertex) -> bool| {
        mesh.vertices.iter().flat_map(|(_, vertices)| vertices).any(|vertex| has(&vertex.data))
    };
    let extra =
        Extra { skins: any(|v| v.skin != Skin::default()), second_uvs: any(|v| v.second_uv != [0.0; 2]) };
    (5_u8, mesh.asset, extra.flags()).encode(out)?;
    length(mesh.vertices.len(), out)?;
    for (first, vertices) in &mesh.vertices {
        first.encode(out)?;
        length(vertices.len(), out)?;
        for vertex in vertices {
            out.extend_from_slice(&vertex_bytes(vertex));
            if extra.skins {
                out.extend_from_slice(&vertex.data.skin.joints());
                out.extend_from_slice(&vertex.data.skin.weights());
            }
            if extra.second_uvs {
                vertex.data.second_uv.iter().for_each(|x| out.extend_from_slice(&x.to_le_bytes()));
            }
        }
    }
    length(mesh.indices.len(), out)?;
    for run in &mesh.indices {
        (run.material, run.first).encode(out)?;
        length(run.faces.len(), out)?;
        for index in run.faces.as_flattened() {
            out.extend_from_slice(&index.to_le_bytes());
        }
    }
    (mesh.vertex_slots, &mesh.index_slots).encode(out)
}

/// What follows each vertex.
#[derive(Clone, Copy)]
struct Extra {
    skins: bool,
    second_uvs: bool,
}

impl Extra {
    fn flags(self) -> u8 {
        u8::from(self.skins) | u8::from(self.second_uvs) << 1
    }

    fn of(flags: u8) -> Result<Self, CodingError> {
        let extra = Self { skins: flags & 1 != 0, second_uvs: flags & 2 != 0 };
        if extra.flags() == flags {
            Ok(extra)
        } else {
            Err(CodingError::value("unknown attributes of vertices"))
        }
    }

    /// Bytes of an encoded vertex.
    fn size(self) -> usize {
        VERTEX_BYTES + usize::from(self.skins) * SKIN_BYTES + usize::from(self.second_uvs) * UV_BYTES
    }
}

fn vertex_bytes(vertex: &Vertex) -> [u8; VERTEX_BYTES] {
    let Vertex { data, birth_s, level } = vertex;
    let numbers = data.position.iter().chain(&data.normal).chain(&data.uv).chain(&data.morph_from);
    let mut bytes = [0; VERTEX_BYTES];
    for (place, number) in bytes.chunks_exact_mut(4).zip(numbers.chain([birth_s])) {
        place.copy_from_slice(&number.to_le_bytes());
    }
    bytes[48..52].copy_from_slice(&data.color);
    let flags = data.part << PART_SHIFT | (level & MAX_LEVEL) << 1 | u32::from(data.smooth);
    bytes[52..].copy_from_slice(&flags.to_le_bytes());
    bytes
}

/// A vertex from [`Extra::size`] bytes.
fn vertex(bytes: &[u8], extra: Extra) -> Vertex {
    let word = |index: usize| {
        let mut word = [0; 4];
        word.copy_from_slice(&bytes[4 * index..4 * index + 4]);
        word
    };
    let number = |index| f32::from_le_bytes(word(index));
    let flags = u32::from_le_bytes(word(13));
    let uv_word = if extra.skins { 16 } else { 14 };
    Vertex {
        data: RenderVertex {
            position: [0, 1, 2].map(number),
            normal: [3, 4, 5].map(number),
            uv: [6, 7].map(number),
            morph_from: [8, 9, 10].map(number),
            color: word(12),
            smooth: flags & 1 == 1,
            part: flags >> PART_SHIFT,
            skin: if extra.skins { skin(word(14), word(15)) } else { Skin::default() },
            second_uv: if extra.second_uvs { [uv_word, uv_word + 1].map(number) } else { [0.0; 2] },
        },
        birth_s: number(11),
        level: flags >> 1 & MAX_LEVEL,
    }
}

fn skin(joints: [u8; 4], weights: [u8; 4]) -> Skin {
    Skin::of(joints.into_iter().zip(weights)).unwrap_or_default()
}

fn decode_mesh<R: Reader>(reader: &mut R) -> Result<MeshChange, CodingError> {
    let asset = u32::decode(reader)?;
    let extra = Extra::of(u8::decode(reader)?)?;
    let size = extra.size();
    let mut bytes = Vec::new();
    let mut vertices = Vec::new();
    for _ in 0..count(reader)? {
        let first = u32::decode(reader)?;
        read_elements(reader, size, &mut bytes)?;
        vertices.push((first, bytes.chunks_exact(size).map(|bytes| vertex(bytes, extra)).collect()));
    }
    let mut indices = Vec::new();
    for _ in 0..count(reader)? {
        let (material, first) = (get(reader)?, get(reader)?);
        read_elements(reader, FACE_BYTES, &mut bytes)?;
        let index = |bytes: &[u8]| bytes.iter().rev().fold(0, |value, byte| value << 8 | u32::from(*byte));
        let face = |face: &[u8]| [0, 4, 8].map(|at| index(&face[at..at + 4]));
        indices.push(IndexRun { material, first, faces: bytes.chunks_exact(FACE_BYTES).map(face).collect() });
    }
    let (vertex_slots, index_slots) = (get(reader)?, get(reader)?);
    Ok(MeshChange { asset, vertices, indices, vertex_slots, index_slots })
}

/// Reads a counted list of elements of `size` bytes.
fn read_elements<R: Reader>(reader: &mut R, size: usize, bytes: &mut Vec<u8>) -> Result<(), CodingError> {
    let length = count(reader)?.saturating_mul(size);
    if !reader.has(length) {
        return Err(CodingError::EndsEarly);
    }
    bytes.resize(length, 0);
    reader.read(bytes)
}

/// Kind of texels that the page has under a number.
const HELD: u8 = 3;

fn encode_pixels(pixels: &TexturePixels, out: &mut Vec<u8>) -> Result<(), StepError> {
    match pixels {
        TexturePixels::Rgba8(bytes) | TexturePixels::R8(bytes) => {
            u8::from(matches!(pixels, TexturePixels::R8(_))).encode(out)?;
            length(bytes.len(), out)?;
            out.extend_from_slice(bytes);
        }
        TexturePixels::R16(texels) => {
            2_u8.encode(out)?;
            length(texels.len(), out)?;
            texels.iter().for_each(|texel| out.extend_from_slice(&texel.to_le_bytes()));
        }
        TexturePixels::Held { number, bytes } => (HELD, *number, *bytes).encode(out)?,
        TexturePixels::File { .. } => return Err(StepError::File),
    }
    Ok(())
}

fn decode_pixels<R: Reader>(reader: &mut R) -> Result<TexturePixels, StepError> {
    let kind = u8::decode(reader)?;
    if kind == HELD {
        return Ok(TexturePixels::Held { number: get(reader)?, bytes: get(reader)? });
    }
    let mut bytes = Vec::new();
    read_elements(reader, if kind == 2 { 2 } else { 1 }, &mut bytes)?;
    Ok(match kind {
        0 => TexturePixels::Rgba8(bytes),
        1 => TexturePixels::R8(bytes),
        2 => TexturePixels::R16(bytes.chunks_exact(2).map(|t| u16::from_le_bytes([t[0], t[1]])).collect()),
        kind => return Err(StepError::Kind(kind)),
    })
}

#[cfg(test)]
mod tests;
