//! Decoding without the feature `zstd`: zstd frames are errors that name the feature.

use lodestream_geometry::base::Base;
use lodestream_geometry::index::ChunkInfo;
use lodestream_geometry::refine::{ActiveMesh, ChunkDelta, ChunkError};
use lodestream_geometry::{Codec, DecodeError};

/// First bytes of a zstd frame (RFC 8878 §3.1.1). No base blob of the range coder begins with them.
const FRAME_MAGIC: [u8; 4] = [0x28, 0xb5, 0x2f, 0xfd];

fn zstd_error(subject: String) -> DecodeError {
    DecodeError::new(
        subject,
        "it is a zstd frame, and this program was built without the feature `zstd` of lodestream-client",
    )
}

pub(super) fn decode_base(stored: &[u8]) -> Result<Base, DecodeError> {
    if stored.starts_with(&FRAME_MAGIC) {
        return Err(zstd_error("base mesh".into()));
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
        Codec::Zstd => Err(zstd_error(format!("chunk {chunk}")).into()),
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
