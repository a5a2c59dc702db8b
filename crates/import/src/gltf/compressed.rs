//! Buffer views that are compressed: EXT_meshopt_compression, and KHR_meshopt_compression, which has one version of
//! attributes and one filter more.
//!
//! Where a file has the bytes uncompressed too (a fallback), these are read all the same: both are to be equal, and the
//! other buffer may be missing.

use gltf::json;
use serde::Deserialize;

use crate::meshopt::{self, Damage, Filter, Mode};

pub(super) const EXTENSIONS: [&str; 2] = ["EXT_meshopt_compression", "KHR_meshopt_compression"];

/// Where a view's bytes are, and what they come to.
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

/// How a view is compressed, if it is.
///
/// # Errors
/// In a few words: what the file says of it is not understood.
pub(super) fn of_view(view: &json::buffer::View) -> Result<Option<CompressedView>, String> {
    let others = view.extensions.as_ref().map(|all| &all.others);
    let found = EXTENSIONS.iter().find_map(|&name| Some((name, others?.get(name)?)));
    let Some((name, said)) = found else { return Ok(None) };
    let said = CompressionJson::deserialize(said)
        .map_err(|e| format!("has an {name} that is not understood: {e}"))?;
    let filter = match said.filter.as_deref() {
        None | Some("NONE") => None,
        Some("OCTAHEDRAL") => Some(Filter::Octahedral),
        Some("QUATERNION") => Some(Filter::Quaternion),
        Some("EXPONENTIAL") => Some(Filter::Exponential),
        Some("COLOR") => Some(Filter::Color),
        Some(other) => return Err(format!("has the filter {other:?} of {name}, which is not known")),
    };
    let mode = match (said.mode.as_str(), filter) {
        ("ATTRIBUTES", filter) => Mode::Attributes(filter),
        ("TRIANGLES", None) => Mode::Triangles,
        ("INDICES", None) => Mode::Indices,
        ("TRIANGLES" | "INDICES", Some(_)) => return Err(format!("has indices with a filter of {name}")),
        (other, _) => return Err(format!("has the mode {other:?} of {name}, which is not known")),
    };
    let (buffer, offset, length) = (said.buffer, said.byte_offset, said.byte_length);
    Ok(Some(CompressedView { buffer, offset, length, count: said.count, stride: said.byte_stride, mode }))
}

impl CompressedView {
    /// Bytes that it comes to; `None` where no number holds them.
    pub(super) fn unpacked_bytes(&self) -> Option<u64> {
        (self.count as u64).checked_mul(self.stride as u64)
    }

    /// The view's bytes, of what it is compressed to.
    pub(super) fn unpack(&self, data: &[u8]) -> Result<Vec<u8>, Damage> {
        meshopt::decode(self.mode, data, self.count, self.stride)
    }
}
