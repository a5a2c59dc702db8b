//! The JSON of a file in little memory. Of accessors, views, meshes and nodes, of which a file may have hundreds of
//! thousands, only what is imported is kept: each is parsed as the crate `gltf` has it and converted at once.

use std::collections::BTreeMap;
use std::fmt;
use std::marker::PhantomData;
use std::sync::Arc;

use gltf::json;
use gltf::json::Index;
use gltf::json::accessor::{ComponentType, Type, sparse::Sparse};
use gltf::json::mesh::{Mode, Semantic};
use gltf::json::validation::Checked;
use serde::Deserialize;
use serde::de::{Deserializer, SeqAccess, Visitor};
use serde_json::value::RawValue;
use serde_json::{Map, Value};

use super::animation_json::Animation;

/// The extension of meshes that are compressed with Draco.
pub(super) const DRACO: &str = "KHR_draco_mesh_compression";

/// Extensions of textures whose image is a WebP or AVIF file, or a KTX2 file of Basis Universal.
pub(super) const TEXTURE_WEBP: &str = "EXT_texture_webp";
pub(super) const TEXTURE_AVIF: &str = "EXT_texture_avif";
pub(super) const TEXTURE_BASISU: &str = "KHR_texture_basisu";

/// The extension of materials that is approximated.
pub(super) const SPECULAR_GLOSSINESS: &str = "KHR_materials_pbrSpecularGlossiness";

/// Extensions of materials that are shown, but for their textures.
pub(super) const TRANSMISSION: &str = "KHR_materials_transmission";
pub(super) const IOR: &str = "KHR_materials_ior";
pub(super) const SPECULAR: &str = "KHR_materials_specular";
pub(super) const CLEAR_COAT: &str = "KHR_materials_clearcoat";

/// Extensions that compress buffer views.
pub(super) const COMPRESSED_VIEWS: [&str; 2] = ["EXT_meshopt_compression", "KHR_meshopt_compression"];

/// A file's JSON.
#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct Root {
    #[serde(default)]
    pub(super) accessors: Vec<Accessor>,
    #[serde(default)]
    pub(super) animations: Vec<Animation>,
    #[serde(default)]
    pub(super) buffers: Vec<json::Buffer>,
    #[serde(default)]
    pub(super) buffer_views: Vec<View>,
    #[serde(default, deserialize_with = "count::<json::Camera, _>")]
    pub(super) cameras: usize,
    pub(super) extensions: Option<json::extensions::root::Root>,
    #[serde(default)]
    pub(super) extensions_used: Vec<String>,
    #[serde(default)]
    pub(super) extensions_required: Vec<String>,
    #[serde(default)]
    pub(super) images: Vec<json::Image>,
    #[serde(default)]
    pub(super) materials: Vec<json::Material>,
    #[serde(default)]
    pub(super) meshes: Vec<Mesh>,
    #[serde(default)]
    pub(super) nodes: Vec<Node>,
    #[serde(default)]
    pub(super) samplers: Vec<json::texture::Sampler>,
    pub(super) scene: Option<Index<json::Scene>>,
    #[serde(default)]
    pub(super) scenes: Vec<json::Scene>,
    #[serde(default)]
    pub(super) skins: Vec<json::Skin>,
    #[serde(default)]
    pub(super) textures: Vec<json::Texture>,
}

impl Root {
    /// Extensions of materials, and textures of those that are shown without them (`<extension>.<texture>`), each with the
    /// number of materials that have it.
    pub(super) fn material_extensions(&self) -> BTreeMap<String, usize> {
        let mut counts = BTreeMap::new();
        for extensions in self.materials.iter().filter_map(|material| material.extensions.as_ref()) {
            let transmission = extensions.transmission.as_ref();
            let is_mapped = transmission.is_some_and(|of| of.transmission_texture.is_some());
            let parsed = [
                (SPECULAR_GLOSSINESS, extensions.pbr_specular_glossiness.is_some()),
                ("KHR_materials_transmission.transmissionTexture", is_mapped),
            ];
            let parsed = parsed.into_iter().filter(|(_, has)| *has).map(|(name, _)| name);
            for name in parsed.chain(extensions.others.keys().map(String::as_str)) {
                *counts.entry(name.to_owned()).or_default() += 1;
            }
            let shown = [IOR, SPECULAR, CLEAR_COAT]
                .into_iter()
                .filter_map(|name| Some((name, extensions.others.get(name)?)));
            for (name, fields) in shown {
                let keys = fields.as_object().into_iter().flat_map(Map::keys);
                for texture in keys.filter(|key| key.ends_with("Texture")) {
                    *counts.entry(format!("{name}.{texture}")).or_default() += 1;
                }
            }
        }
        counts
    }

    /// Gives back the room that long lists grew into.
    pub(super) fn shrink_to_fit(&mut self) {
        self.accessors.shrink_to_fit();
        self.buffer_views.shrink_to_fit();
        self.meshes.shrink_to_fit();
        self.nodes.shrink_to_fit();
    }
}

/// How many elements a list has; each must be a valid `T`.
fn count<'de, T: Deserialize<'de>, D: Deserializer<'de>>(list: D) -> Result<usize, D::Error> {
    struct Count<T>(PhantomData<T>);
    impl<'de, T: Deserialize<'de>> Visitor<'de> for Count<T> {
        type Value = usize;

        fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
            f.write_str("a sequence")
        }

        fn visit_seq<A: SeqAccess<'de>>(self, mut list: A) -> Result<usize, A::Error> {
            let mut count = 0;
            while list.next_element::<T>()?.is_some() {
                count += 1;
            }
            Ok(count)
        }
    }
    list.deserialize_seq(Count(PhantomData::<T>))
}

/// A list; empty for `null`, which some programs write.
fn list_or_null<'de, T: Deserialize<'de>, D: Deserializer<'de>>(list: D) -> Result<Box<[T]>, D::Error> {
    Ok(Option::deserialize(list)?.unwrap_or_default())
}

#[derive(Deserialize)]
#[serde(from = "json::Accessor")]
pub(super) struct Accessor {
    pub(super) buffer_view: Option<Index<json::buffer::View>>,
    pub(super) byte_offset: u64,
    pub(super) count: u64,
    /// `None` if unknown.
    pub(super) component_type: Option<ComponentType>,
    /// `None` if unknown.
    pub(super) shape: Option<Type>,
    pub(super) normalized: bool,
    pub(super) sparse: Option<Box<Sparse>>,
    /// Least and largest values of the first three components, if both are stated and finite.
    pub(super) bounds: Option<Box<[[f64; 3]; 2]>>,
}

impl From<json::Accessor> for Accessor {
    fn from(accessor: json::Accessor) -> Self {
        let point = |value: Option<Value>| {
            let value = value?;
            let numbers = value.as_array()?;
            let [x, y, z] = [0, 1, 2].map(|axis| numbers.get(axis).and_then(Value::as_f64));
            Some([x?, y?, z?]).filter(|point| point.iter().all(|number| number.is_finite()))
        };
        Self {
            buffer_view: accessor.buffer_view,
            byte_offset: accessor.byte_offset.unwrap_or_default().0,
            count: accessor.count.0,
            component_type: valid(accessor.component_type).map(|kind| kind.0),
            shape: valid(accessor.type_),
            normalized: accessor.normalized,
            sparse: accessor.sparse.map(Box::new),
            bounds: point(accessor.min).zip(point(accessor.max)).map(|(low, high)| Box::new([low, high])),
        }
    }
}

fn valid<T>(checked: Checked<T>) -> Option<T> {
    match checked {
        Checked::Valid(value) => Some(value),
        Checked::Invalid => None,
    }
}

/// A buffer view.
#[derive(Deserialize)]
#[serde(from = "json::buffer::View")]
pub(super) struct View {
    pub(super) buffer: Index<json::Buffer>,
    pub(super) byte_offset: u64,
    pub(super) byte_length: u64,
    pub(super) byte_stride: Option<usize>,
    /// Name and contents of the extension that compresses it.
    pub(super) compression: Option<Box<(&'static str, Value)>>,
}

impl From<json::buffer::View> for View {
    fn from(view: json::buffer::View) -> Self {
        let mut others = view.extensions.map(|all| all.others).unwrap_or_default();
        let compression =
            COMPRESSED_VIEWS.iter().find_map(|&name| Some(Box::new((name, others.remove(name)?))));
        Self {
            buffer: view.buffer,
            byte_offset: view.byte_offset.unwrap_or_default().0,
            byte_length: view.byte_length.0,
            byte_stride: view.byte_stride.map(|stride| stride.0).filter(|&stride| stride > 0),
            compression,
        }
    }
}

#[derive(Deserialize)]
#[serde(from = "json::Mesh")]
pub(super) struct Mesh {
    pub(super) name: Option<Box<str>>,
    pub(super) extras: Option<Box<RawValue>>,
    pub(super) primitives: Arc<[Primitive]>,
    /// Weights of the morph targets, unless a node states others.
    pub(super) weights: Option<Box<[f32]>>,
    /// Set once nodes are known.
    pub(super) pose: Pose,
}

impl From<json::Mesh> for Mesh {
    fn from(mesh: json::Mesh) -> Self {
        Self {
            name: mesh.name.map(String::into_boxed_str),
            extras: mesh.extras,
            primitives: mesh.primitives.into_iter().map(Primitive::from).collect(),
            weights: mesh.weights.map(Vec::into_boxed_slice),
            pose: Pose::default(),
        }
    }
}

/// What a mesh gets its shape from, besides its vertices.
#[derive(Clone, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct Pose {
    /// Number of the skin.
    pub(super) skin: Option<usize>,
    /// Bits of the weights of the morph targets; none if all are 0.
    pub(super) weights: Box<[u32]>,
}

impl Pose {
    /// Whether the mesh is as its vertices say.
    pub(super) fn is_plain(&self) -> bool {
        *self == Self::default()
    }
}

/// What of a primitive is imported: equal ones are equal meshes.
#[derive(PartialEq, Eq, Hash)]
pub(super) struct Primitive {
    /// By semantic, in its order.
    pub(super) attributes: Box<[(Checked<Semantic>, Index<json::Accessor>)]>,
    pub(super) indices: Option<Index<json::Accessor>>,
    pub(super) material: Option<Index<json::Material>>,
    /// OpenGL's number of the mode; `None` if unknown.
    mode: Option<u32>,
    /// Morph targets: shifts of positions and of normals.
    pub(super) targets: Box<[[Option<Index<json::Accessor>>; 2]]>,
    /// The extension [`DRACO`].
    pub(super) draco: Option<Box<Value>>,
}

impl From<json::mesh::Primitive> for Primitive {
    fn from(primitive: json::mesh::Primitive) -> Self {
        let targets = primitive.targets.into_iter().flatten();
        Self {
            attributes: primitive.attributes.into_iter().collect(),
            indices: primitive.indices,
            material: primitive.material,
            mode: valid(primitive.mode).map(Mode::as_gl_enum),
            targets: targets.map(|target| [target.positions, target.normals]).collect(),
            draco: primitive.extensions.and_then(|mut all| all.others.remove(DRACO)).map(Box::new),
        }
    }
}

impl Primitive {
    /// The accessor of an attribute.
    pub(super) fn attribute(&self, semantic: &Semantic) -> Option<Index<json::Accessor>> {
        let found = |(of, _): &&(Checked<Semantic>, _)| matches!(of, Checked::Valid(of) if of == semantic);
        self.attributes.iter().find(found).map(|&(_, accessor)| accessor)
    }

    /// Its mode; `None` if unknown.
    pub(super) fn mode(&self) -> Option<Mode> {
        use Mode::{LineLoop, LineStrip, Lines, Points, TriangleFan, TriangleStrip, Triangles};
        let all = [Points, Lines, LineLoop, LineStrip, Triangles, TriangleStrip, TriangleFan];
        all.into_iter().find(|mode| Some(mode.as_gl_enum()) == self.mode)
    }
}

/// A node. Unlike the crate `gltf`, which rounds to f32, it keeps the numbers of its transformation as written: f32 has
/// steps of half a metre at the coordinates of a map.
#[derive(Default, Deserialize)]
pub(super) struct Node {
    pub(super) name: Option<Box<str>>,
    pub(super) mesh: Option<Index<json::Mesh>>,
    pub(super) skin: Option<Index<json::Skin>>,
    pub(super) weights: Option<Box<[f32]>>,
    /// Whether its mesh follows the skin, and stands in the scene without the node's transformation.
    #[serde(skip)]
    pub(super) is_skinned: bool,
    #[serde(default, deserialize_with = "list_or_null")]
    pub(super) children: Box<[Index<json::Node>]>,
    pub(super) matrix: Option<Box<[f64; 16]>>,
    pub(super) translation: Option<[f64; 3]>,
    pub(super) rotation: Option<[f64; 4]>,
    pub(super) scale: Option<[f64; 3]>,
    pub(super) extras: Option<Box<RawValue>>,
    extensions: Option<Box<Map<String, Value>>>,
}

impl Node {
    /// The extension of a name.
    pub(super) fn extension(&self, name: &str) -> Option<&Value> {
        self.extensions.as_ref()?.get(name)
    }
}
