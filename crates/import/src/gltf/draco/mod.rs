//! Primitives compressed with Draco (KHR_draco_mesh_compression): one stream with all triangles and the vertex attributes
//! that the extension lists.
//!
//! If a file has an uncompressed fallback too, that is read: it is exact and needs no decoding.

mod mesh;
mod stated_counts;
#[cfg(feature = "draco")]
mod stream;

use std::collections::BTreeMap;
use std::rc::Rc;

use gltf::json::accessor::Type;
use gltf::json::mesh::Semantic;
use serde::Deserialize;

use super::accessor::{Buffers, Elements};
use super::container::Document;
use super::root::{DRACO, Primitive};
use crate::error::ImportError;

use mesh::DracoMesh;
use stated_counts::StatedCounts;

/// Decoded streams of a file, by buffer view: several nodes may place the same mesh.
#[derive(Default)]
pub(super) struct Streams {
    decoded: BTreeMap<usize, Rc<DracoMesh>>,
}

/// A primitive's part of a stream.
pub(super) struct Compressed {
    stream: Rc<DracoMesh>,
    numbers: BTreeMap<String, u32>,
}

#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
struct DracoJson {
    buffer_view: usize,
    attributes: BTreeMap<String, u32>,
}

impl Streams {
    /// Decodes a primitive's stream; `None` if it has none or has a fallback.
    ///
    /// # Errors
    /// Streams that do not decode, or exceed the counts of the primitive's accessors.
    pub(super) fn open(
        &mut self,
        document: &Document,
        buffers: &mut Buffers<'_>,
        primitive: &Primitive,
        place: &str,
    ) -> Result<Option<Compressed>, ImportError> {
        let Some(json) = primitive.draco.as_deref() else { return Ok(None) };
        let error = |what: String| document.error(format!("{place}: {what}"));
        let accessor = |index: usize| document.root.accessors.get(index);
        let positions = primitive.attribute(&Semantic::Positions);
        let positions = positions.and_then(|index| accessor(index.value()));
        // An accessor of positions with a buffer view is the fallback; without positions nothing is drawn.
        if positions.is_none_or(|positions| positions.buffer_view.is_some()) {
            return Ok(None);
        }
        let extension = DracoJson::deserialize(json)
            .map_err(|e| error(format!("has a {DRACO} that is not understood: {e}")))?;
        let view = extension.buffer_view;
        let stream = match self.decoded.get(&view) {
            Some(stream) => Rc::clone(stream),
            None => {
                let bytes = buffers.compressed_view(view)?;
                let indices = primitive.indices.and_then(|index| accessor(index.value()));
                let stated = StatedCounts {
                    points: positions.map_or(0, |positions| positions.count),
                    triangles: indices.map_or(u64::MAX, |indices| indices.count / 3),
                };
                let stream = decode(&bytes, stated).map_err(|what| {
                    error(format!("bufferViews[{view}] does not decode as Draco: {what}; export it again"))
                })?;
                let stream = Rc::new(stream);
                self.decoded.insert(view, Rc::clone(&stream));
                stream
            }
        };
        Ok(Some(Compressed { stream, numbers: extension.attributes }))
    }
}

#[cfg(feature = "draco")]
use stream::decode;

#[cfg(not(feature = "draco"))]
fn decode(_: &bytes::Bytes, _: StatedCounts) -> Result<DracoMesh, mesh::DracoError> {
    Err(mesh::DracoError::NotBuilt)
}

impl Compressed {
    /// Corners, three for each triangle.
    pub(super) fn corners(&self) -> Vec<u32> {
        self.stream.triangles.clone()
    }

    /// The values of an attribute; `None` if they are not in the stream.
    ///
    /// # Errors
    /// Attributes that the stream lacks, or whose shape differs from the accessor's or is not `allowed`.
    pub(super) fn attribute(
        &self,
        document: &Document,
        name: &str,
        index: usize,
        place: &str,
        allowed: &[Type],
    ) -> Result<Option<Elements>, ImportError> {
        let Some(number) = self.numbers.get(name) else { return Ok(None) };
        let error = |what: String| document.error(format!("{place}: {what}"));
        let accessor = document.root.accessors.get(index);
        let accessor = accessor.ok_or_else(|| error(format!("accessors[{index}] does not exist")))?;
        let attribute = self.stream.attributes.get(number).ok_or_else(|| {
            error(format!("attribute {number} is not in the Draco stream, or has a type that glTF lacks"))
        })?;
        let shape = allowed
            .iter()
            .find(|shape| shape.multiplicity() == attribute.components && accessor.shape == Some(**shape));
        if shape.is_none() {
            let components = attribute.components;
            return Err(error(format!(
                "accessors[{index}] and the {components} components of its Draco stream do not agree on a shape of \
                 {allowed:?}; export the file again"
            )));
        }
        // The accessor states whether values are normalised, unless its component type differs.
        let same = accessor.component_type == Some(attribute.kind);
        let normalised = if same { accessor.normalized } else { attribute.normalised };
        let (bytes, points) = (attribute.bytes.clone(), self.stream.points);
        Ok(Some(Elements::packed(bytes, points, attribute.components, attribute.kind, normalised)))
    }
}
