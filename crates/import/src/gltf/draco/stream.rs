//! One Draco stream, by the crate `draco-core`.

use bytes::Bytes;
use draco_core::{
    DataType, DecodeLimits, DecoderBuffer, ErrorKind, Mesh, MeshDecoder, PointAttribute, PointIndex,
};
use gltf::json::accessor::ComponentType;

use super::mesh::{Attribute, DracoError, DracoMesh};
use super::stated_counts::StatedCounts;

/// Triangles and points that any stream may have, however short…
const BASE: u64 = 4096;
/// …and those for each of its bytes. With the tightest settings of Draco 1.5.5, a flat, regular grid of 980,000 triangles
/// has 27 per byte: useful meshes are accepted, and short streams cannot cause hours of work.
const PER_BYTE: u64 = 128;
/// Most bytes of a point's values: positions, normals, tangents, joints and two sets of coordinates, doubled.
const POINT_BYTES: u64 = 128;

/// Decodes a stream of at most the `stated` counts.
///
/// # Errors
/// The decoder's message, or that a limit is exceeded.
pub(super) fn decode(data: &Bytes, stated: StatedCounts) -> Result<DracoMesh, DracoError> {
    let most = PER_BYTE.saturating_mul(data.len() as u64).saturating_add(BASE);
    let (points, triangles) = (stated.points.min(most), stated.triangles.min(most));
    let limits = DecodeLimits::default()
        .with_max_points(points)
        .with_max_faces(triangles)
        .with_max_decoded_bytes(points * POINT_BYTES);
    let too_large = || DracoError::TooLarge { triangles, points, bytes: data.len() };
    let mut mesh = Mesh::new();
    MeshDecoder::new().decode(&mut DecoderBuffer::new(data).with_limits(limits), &mut mesh).map_err(
        |why| match why.kind() {
            ErrorKind::LimitExceeded => too_large(),
            _ => DracoError::Decoder(why),
        },
    )?;
    let count = mesh.num_points();
    if count as u64 > points {
        return Err(too_large());
    }
    let attributes = (0..mesh.num_attributes()).map(|index| mesh.attribute(index));
    let attributes =
        attributes.filter_map(|attribute| Some((attribute.unique_id(), in_order(attribute, count)?)));
    let attributes = attributes.collect();
    let triangles = mesh.faces().as_flattened().iter().map(|point| point.0).collect();
    Ok(DracoMesh { triangles, points: count, attributes })
}

/// An attribute's values in the order of points; `None` for a type that glTF lacks, or if values are missing.
fn in_order(attribute: &PointAttribute, points: usize) -> Option<Attribute> {
    let kind = match attribute.data_type() {
        DataType::Int8 => ComponentType::I8,
        DataType::Uint8 => ComponentType::U8,
        DataType::Int16 => ComponentType::I16,
        DataType::Uint16 => ComponentType::U16,
        DataType::Uint32 => ComponentType::U32,
        DataType::Float32 => ComponentType::F32,
        _ => return None,
    };
    let components = usize::from(attribute.num_components());
    let size = components * kind.size();
    let stride = usize::try_from(attribute.byte_stride()).ok().filter(|&stride| stride >= size)?;
    let values = attribute.buffer().data();
    let mut bytes = Vec::with_capacity(points * size);
    for point in 0..points as u32 {
        let start = (attribute.mapped_index(PointIndex(point)).0 as usize).checked_mul(stride)?;
        bytes.extend_from_slice(values.get(start..)?.get(..size)?);
    }
    Some(Attribute { bytes: bytes.into(), components, kind, normalised: attribute.normalized() })
}
