//! The mesh that a Draco stream decodes to.

use std::collections::BTreeMap;

use bytes::Bytes;
use gltf::json::accessor::ComponentType;

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
