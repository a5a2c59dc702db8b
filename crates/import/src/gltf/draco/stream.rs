//! One Draco stream, by the crate `draco-core`.

use bytes::Bytes;
use draco_core::{
    DataType, DecodeLimits, DecoderBuffer, ErrorKind, Mesh, MeshDecoder, PointAttribute, PointIndex,
};
use gltf::json::accessor::ComponentType;

use super::{Attribute, Decoded, Stated};

/// Triangles, and points, that any stream may have…
const BASE: u64 = 4096;
/// …and for each of its bytes. A flat, even grid of 980,000 triangles comes to 27 a byte, by the tightest settings of
/// Draco 1.5.5's encoder; so no mesh of use is refused, and no few bytes make a reader work for hours.
const PER_BYTE: u64 = 128;
/// Bytes of all values of a point: positions, normals, tangents and joints, two sets of coordinates, and as much again.
const POINT_BYTES: u64 = 128;

/// Decodes a stream that holds no more than is `stated`.
///
/// # Errors
/// In a few words: what the decoder found.
pub(super) fn decode(data: &Bytes, stated: Stated) -> Result<Decoded, String> {
    let most = PER_BYTE.saturating_mul(data.len() as u64).saturating_add(BASE);
    let (points, triangles) = (stated.points.min(most), stated.triangles.min(most));
    let limits = DecodeLimits::default()
        .with_max_points(points)
        .with_max_faces(triangles)
        .with_max_decoded_bytes(points * POINT_BYTES);
    let too_much = || {
        format!(
            "it comes to more than {triangles} triangles or {points} points, which is what its accessors state, or the \
             most that {} bytes may come to",
            data.len()
        )
    };
    let mut mesh = Mesh::new();
    MeshDecoder::new().decode(&mut DecoderBuffer::new(data).with_limits(limits), &mut mesh).map_err(|e| {
        match e.kind() {
            ErrorKind::LimitExceeded => too_much(),
            _ => e.to_string(),
        }
    })?;
    let count = mesh.num_points();
    if count as u64 > points {
        return Err(too_much());
    }
    let attributes = (0..mesh.num_attributes()).map(|index| mesh.attribute(index));
    let attributes =
        attributes.filter_map(|attribute| Some((attribute.unique_id(), in_order(attribute, count)?)));
    let attributes = attributes.collect();
    let triangles = mesh.faces().as_flattened().iter().map(|point| point.0).collect();
    Ok(Decoded { triangles, points: count, attributes })
}

/// An attribute's values by point; `None` for a type that glTF has not, or where values are missing.
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
