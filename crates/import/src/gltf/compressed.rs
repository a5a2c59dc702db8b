//! Compressed buffer views: EXT_meshopt_compression, and KHR_meshopt_compression, which adds a version of the attribute
//! codec and a filter.
//!
//! If a file has an uncompressed fallback too, the compressed bytes are read: both must be equal, and the fallback buffer
//! may be missing.

use serde::Deserialize;

use super::root::View;
use crate::meshopt::{self, Filter, MeshoptError, Mode};

/// Location of a view's compressed bytes, and the layout of the decoded elements.
pub(super) struct CompressedView {
    pub(super) buffer: usize,
    pub(super) offset: u64,
    pub(super) length: u64,
    count: usize,
    stride: usize,
    mode: Mode,
}

#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
struct CompressionJson {
    buffer: usize,
    #[serde(default)]
    byte_offset: u64,
    byte_length: u64,
    byte_stride: usize,
    count: usize,
    mode: String,
    filter: Option<String>,
}

/// A view whose compression is invalid. The message goes on after the view's name.
#[derive(Debug, thiserror::Error)]
pub(super) enum CompressionError {
    #[error("has an {extension} that is not understood: {why}")]
    Json { extension: &'static str, why: gltf::json::Error },
    #[error("has the filter {filter:?} of {extension}, which is not known")]
    Filter { extension: &'static str, filter: String },
    #[error("has the mode {mode:?} of {extension}, which is not known")]
    Mode { extension: &'static str, mode: String },
    #[error("has indices with a filter of {extension}")]
    FilteredIndices { extension: &'static str },
}

/// Compression of a view, if any.
///
/// # Errors
/// The extension's JSON is invalid.
pub(super) fn of_view(view: &View) -> Result<Option<CompressedView>, CompressionError> {
    let Some((extension, json)) = view.compression.as_deref() else { return Ok(None) };
    let extension = *extension;
    let compression =
        CompressionJson::deserialize(json).map_err(|why| CompressionError::Json { extension, why })?;
    let filter = match compression.filter.as_deref() {
        None | Some("NONE") => None,
        Some("OCTAHEDRAL") => Some(Filter::Octahedral),
        Some("QUATERNION") => Some(Filter::Quaternion),
        Some("EXPONENTIAL") => Some(Filter::Exponential),
        Some("COLOR") => Some(Filter::Color),
        Some(other) => return Err(CompressionError::Filter { extension, filter: other.to_owned() }),
    };
    let mode = match (compression.mode.as_str(), filter) {
        ("ATTRIBUTES", filter) => Mode::Attributes(filter),
        ("TRIANGLES", None) => Mode::Triangles,
        ("INDICES", None) => Mode::Indices,
        ("TRIANGLES" | "INDICES", Some(_)) => return Err(CompressionError::FilteredIndices { extension }),
        (other, _) => return Err(CompressionError::Mode { extension, mode: other.to_owned() }),
    };
    let (buffer, offset, length) = (compression.buffer, compression.byte_offset, compression.byte_length);
    Ok(Some(CompressedView {
        buffer,
        offset,
        length,
        count: compression.count,
        stride: compression.byte_stride,
        mode,
    }))
}

impl CompressedView {
    /// Length of the decoded bytes; `None` on overflow.
    pub(super) fn unpacked_bytes(&self) -> Option<u64> {
        (self.count as u64).checked_mul(self.stride as u64)
    }

    /// Decodes the view's bytes.
    pub(super) fn unpack(&self, data: &[u8]) -> Result<Vec<u8>, MeshoptError> {
        meshopt::decode(self.mode, data, self.count, self.stride)
    }
}
