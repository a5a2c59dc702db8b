//! Blobs as they are stored, without the zstd decoder: what is a frame cannot be read.

use lodestream_geometry::base::Base;
use lodestream_geometry::index::ChunkInfo;
use lodestream_geometry::refine::{ActiveMesh, ChunkDelta, ChunkError};
use lodestream_geometry::{Codec, DecodeError};

/// First bytes of a zstd frame (RFC 8878 §3.1.1). No base blob of the range coder begins so.
const FRAME_MAGIC: [u8; 4] = [0x28, 0xb5, 0x2f, 0xfd];

fn is_frame(what: String) -> DecodeError {
    DecodeError::new(
        what,
        "it is a zstd frame, and this program was built without the feature `zstd` of lodestream-client",
    )
}

pub(super) fn decode_base(stored: &[u8]) -> Result<Base, DecodeError> {
    if stored.starts_with(&FRAME_MAGIC) {
        return Err(is_frame("base mesh".into()));
    }
    Base::decode(stored)
}

pub(super) fn decode_prefix(
    mesh: &ActiveMesh,
    chunk: u32,
    info: &ChunkInfo,
    truncation: Option<u8>,
    stored: &[u8],
) -> Result<ChunkDelta, ChunkError> {
    match mesh.codec() {
        Codec::Range | Codec::AxisAligned => mesh.decode_prefix(chunk, info, truncation, stored),
        Codec::Zstd => Err(is_frame(format!("chunk {chunk}")).into()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_frame_is_refused_with_the_name_of_the_feature() {
        let frame = lodestream_compress::compress(b"a base mesh").unwrap();
        let why = decode_base(&frame).unwrap_err().to_string();
        assert!(why.contains("base mesh") && why.contains("feature `zstd`"), "{why}");
    }
}
