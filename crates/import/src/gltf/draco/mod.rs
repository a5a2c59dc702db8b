//! Primitives that are compressed with Draco (KHR_draco_mesh_compression): all triangles, and the vertex attributes that
//! the extension lists, in one stream.
//!
//! A file may have them uncompressed too. Those are read then: they are exact, and nothing needs to be decoded.

#[cfg(feature = "draco")]
mod stream;

use std::collections::BTreeMap;
use std::rc::Rc;

use bytes::Bytes;
use gltf::json;
use gltf::json::accessor::{ComponentType, Type};
use gltf::json::mesh::Semantic;
use gltf::json::validation::Checked;
use serde::Deserialize;

use super::accessor::{Buffers, Elements};
use super::container::{DRACO, Document};
use crate::error::ImportError;

/// What a stream decodes to.
struct Decoded {
    triangles: Vec<u32>,
    points: usize,
    /// By the number that the extension calls them by.
    attributes: BTreeMap<u32, Attribute>,
}

/// One value for each point, one after the other.
struct Attribute {
    bytes: Bytes,
    components: usize,
    kind: ComponentType,
    normalised: bool,
}

/// What a stream may decode to at most, by what the file says of it elsewhere.
#[derive(Clone, Copy, Debug)]
#[cfg_attr(not(feature = "draco"), expect(dead_code, reason = "nothing is decoded, however large"))]
struct Stated {
    points: u64,
    triangles: u64,
}

/// The streams of a file that were decoded, by buffer view: a mesh may be placed often.
#[derive(Default)]
pub(super) struct Streams {
    decoded: BTreeMap<usize, Rc<Decoded>>,
}

/// A primitive's part of a stream.
pub(super) struct Compressed {
    stream: Rc<Decoded>,
    numbers: BTreeMap<String, u32>,
}

#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
struct DracoJson {
    buffer_view: usize,
    attributes: BTreeMap<String, u32>,
}

impl Streams {
    /// Decodes a primitive, if it is compressed and nowhere else.
    ///
    /// # Errors
    /// Streams that do not decode, or come to more than the primitive's accessors say.
    pub(super) fn open(
        &mut self,
        document: &Document,
        buffers: &mut Buffers<'_>,
        primitive: &json::mesh::Primitive,
        place: &str,
    ) -> Result<Option<Compressed>, ImportError> {
        let others = primitive.extensions.as_ref().map(|all| &all.others);
        let Some(said) = others.and_then(|all| all.get(DRACO)) else { return Ok(None) };
        let error = |what: String| document.error(format!("{place}: {what}"));
        let accessor = |index: usize| document.root.accessors.get(index);
        let positions = primitive.attributes.get(&Checked::Valid(Semantic::Positions));
        let positions = positions.and_then(|index| accessor(index.value()));
        // Streams without positions are no meshes; what is said elsewhere is as good.
        if positions.is_none_or(|positions| positions.buffer_view.is_some()) {
            return Ok(None);
        }
        let said = DracoJson::deserialize(said)
            .map_err(|e| error(format!("has a {DRACO} that is not understood: {e}")))?;
        let view = said.buffer_view;
        let stream = match self.decoded.get(&view) {
            Some(stream) => Rc::clone(stream),
            None => {
                let bytes = buffers.compressed_view(view)?;
                let indices = primitive.indices.and_then(|index| accessor(index.value()));
                let stated = Stated {
                    points: positions.map_or(0, |positions| positions.count.0),
                    triangles: indices.map_or(u64::MAX, |indices| indices.count.0 / 3),
                };
                let stream = decode(&bytes, stated).map_err(|what| {
                    error(format!("bufferViews[{view}] does not decode as Draco: {what}; export it again"))
                })?;
                let stream = Rc::new(stream);
                self.decoded.insert(view, Rc::clone(&stream));
                stream
            }
        };
        Ok(Some(Compressed { stream, numbers: said.attributes }))
    }
}

#[cfg(feature = "draco")]
use stream::decode;

#[cfg(not(feature = "draco"))]
fn decode(_: &Bytes, _: Stated) -> Result<Decoded, String> {
    Err("this program was built without it (the feature draco of lodestream-import)".to_owned())
}

impl Compressed {
    /// Corners, three for each triangle.
    pub(super) fn corners(&self) -> Vec<u32> {
        self.stream.triangles.clone()
    }

    /// The values of an attribute; `None` if they are not in the stream.
    ///
    /// # Errors
    /// Attributes that the stream has not, or has in another shape than their accessor says, or than is `allowed`.
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
            error(format!("attribute {number} is not in the Draco stream, or of a type that glTF has not"))
        })?;
        let shape = allowed.iter().find(|shape| {
            shape.multiplicity() == attribute.components && accessor.type_ == Checked::Valid(**shape)
        });
        if shape.is_none() {
            let components = attribute.components;
            return Err(error(format!(
                "accessors[{index}] and the {components} components of its Draco stream do not agree on a shape of \
                 {allowed:?}; export the file again"
            )));
        }
        // The accessor knows better what the numbers mean, unless it speaks of others.
        let same = matches!(accessor.component_type, Checked::Valid(kind) if kind.0 == attribute.kind);
        let normalised = if same { accessor.normalized } else { attribute.normalised };
        let (bytes, points) = (attribute.bytes.clone(), self.stream.points);
        Ok(Some(Elements::packed(bytes, points, attribute.components, attribute.kind, normalised)))
    }
}
