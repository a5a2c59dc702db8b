//! The mesh that a Draco stream decodes to.

use std::collections::BTreeMap;

use bytes::Bytes;
use gltf::json::accessor::ComponentType;

/// A stream that does not decode.
#[derive(Debug, thiserror::Error)]
pub(super) enum DracoError {
    #[cfg(feature = "draco")]
    #[error(
        "it has more than {triangles} triangles or {points} points, the counts of its accessors or the most for a \
         stream of {bytes} bytes"
    )]
    TooLarge { triangles: u64, points: u64, bytes: usize },
    #[cfg(feature = "draco")]
    #[error("{0}")]
    Decoder(draco_core::DracoError),
    #[cfg(not(feature = "draco"))]
    #[error("this program was built without it (the feature draco of lodestream-import)")]
    NotBuilt,
}

/// A mesh decoded from a stream.
pub(super) struct DracoMesh {
    pub(super) triangles: Vec<u32>,
    pub(super) points: usize,
    /// By the id that the extension gives them.
    pub(super) attributes: BTreeMap<u32, Attribute>,
}

/// Values of an attribute, one for each point, packed.
pub(super) struct Attribute {
    pub(super) bytes: Bytes,
    pub(super) components: usize,
    pub(super) kind: ComponentType,
    pub(super) normalised: bool,
}
