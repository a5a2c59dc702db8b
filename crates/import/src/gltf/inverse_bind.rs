//! Inverse bind matrices: from the space in which a mesh is bound to a skin to that of each joint.

use glam::DMat4;
use gltf::json::accessor::Type;

use super::accessor::Buffers;
use super::container::Document;
use crate::error::ImportError;

/// The inverse bind matrix of each joint of a skin; the identity where the file has none.
///
/// # Errors
/// Matrices that cannot be read.
pub(super) fn inverse_bind_matrices(
    document: &Document,
    buffers: &mut Buffers<'_>,
    number: usize,
) -> Result<Vec<DMat4>, ImportError> {
    let place = format!("skins[{number}].inverseBindMatrices");
    let Some(skin) = document.root.skins.get(number) else { return Ok(Vec::new()) };
    let bound = skin.inverse_bind_matrices;
    let bound = bound.map(|accessor| buffers.open(accessor.value(), &place, &[Type::Mat4])).transpose()?;
    let matrix = |at: usize| {
        let inverse = bound.as_ref().filter(|bound| at < bound.len());
        inverse.map_or(DMat4::IDENTITY, |bound| DMat4::from_cols_array(&bound.get(at)))
    };
    Ok((0..skin.joints.len()).map(matrix).collect())
}
