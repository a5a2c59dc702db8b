//! The images of one material's maps, by which of two sets of texture coordinates each is laid, and their wrap modes.

use gltf::json;
use gltf::json::extensions::texture::TextureTransform;
use gltf::json::texture::WrappingMode;
use gltf::json::validation::Checked;
use lodestream_scene::asset::Wrap;
use serde_json::{Map, Value};

use super::accessor::Buffers;
use super::container::{Document, Location};
use super::root::{TEXTURE_AVIF, TEXTURE_BASISU, TEXTURE_WEBP};
use crate::model::ImageSource;

/// `KHR_texture_transform`: `uv' = offset + rotation × scale × uv`, `v` down.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct UvTransform {
    /// Rows of the 2 × 3 matrix.
    rows: [[f64; 3]; 2],
}

impl UvTransform {
    pub(super) const IDENTITY: Self = Self { rows: [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]] };

    /// `None` if a component is not finite.
    fn new(transform: &TextureTransform) -> Option<Self> {
        let [ox, oy] = transform.offset.0.map(f64::from);
        let [sx, sy] = transform.scale.0.map(f64::from);
        let (sin, cos) = f64::from(transform.rotation.0).sin_cos();
        let rows = [[cos * sx, sin * sy, ox], [-sin * sx, cos * sy, oy]];
        rows.iter().flatten().all(|x| x.is_finite()).then_some(Self { rows })
    }

    /// Transforms the file's texture coordinates and turns `v` up.
    pub(super) fn apply(&self, [u, v]: [f64; 2]) -> [f32; 2] {
        let row = |r: [f64; 3]| r[0] * u + r[1] * v + r[2];
        [row(self.rows[0]) as f32, (1.0 - row(self.rows[1])) as f32]
    }
}

/// A reference to a texture of the file.
#[derive(Clone, Debug)]
pub(super) struct Texture {
    pub(super) index: usize,
    pub(super) uv_set: u32,
    pub(super) transform: Option<TextureTransform>,
}

/// How maps are looked up: by a TEXCOORD_n set with a transformation. A mesh has two such lookups, with the transformation
/// applied.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Lookup {
    /// Number of the TEXCOORD_n set.
    pub(super) uv_set: u32,
    pub(super) transform: UvTransform,
}

impl Default for Lookup {
    fn default() -> Self {
        Self { uv_set: 0, transform: UvTransform::IDENTITY }
    }
}

/// An image, and whether it is laid by the second set of texture coordinates.
pub(super) struct Laid {
    pub(super) image: ImageSource,
    pub(super) second: bool,
}

/// The maps of one material; missing ones become warnings.
pub(super) struct Maps<'a, 'b> {
    document: &'a Document,
    buffers: &'a mut Buffers<'b>,
    warnings: &'a mut Vec<String>,
    material: String,
    /// Lookups of the maps so far, each with the first map that has it.
    lookups: [Option<(&'static str, Lookup)>; 2],
    /// Wrap modes of the first map, with its name.
    wrap: Option<(&'static str, [Wrap; 2])>,
}

impl<'a, 'b> Maps<'a, 'b> {
    pub(super) fn new(
        document: &'a Document,
        buffers: &'a mut Buffers<'b>,
        warnings: &'a mut Vec<String>,
        material: String,
    ) -> Self {
        Self { document, buffers, warnings, material, lookups: [None; 2], wrap: None }
    }

    /// The lookups by the first and the second set of texture coordinates.
    pub(super) fn lookups(&self) -> [Option<Lookup>; 2] {
        self.lookups.map(|known| known.map(|(_, lookup)| lookup))
    }

    /// Wrap modes of the maps.
    pub(super) fn wrap(&self) -> [Wrap; 2] {
        self.wrap.map_or([Wrap::Repeat; 2], |(_, wrap)| wrap)
    }

    pub(super) fn warn(&mut self, what: &str) {
        self.warnings.push(format!("{}: material {:?}: {what}", self.document.path.display(), self.material));
    }

    /// A reference whose extensions the crate `gltf` does not parse.
    pub(super) fn texture_with_extensions(
        &mut self,
        index: usize,
        uv_set: u32,
        extensions: Option<&Map<String, Value>>,
    ) -> Texture {
        let transform = extensions.and_then(|all| all.get("KHR_texture_transform"));
        let transform = transform.and_then(|value| {
            let parsed = serde_json::from_value(value.clone());
            parsed.map_err(|e| self.warn(&format!("a KHR_texture_transform is not used: {e}"))).ok()
        });
        Texture { index, uv_set, transform }
    }

    /// The image of a map, which messages call `what`. The first image that is found sets the first lookup, the first one
    /// with another lookup the second.
    pub(super) fn image(&mut self, what: &'static str, texture: Option<Texture>) -> Option<Laid> {
        let texture = texture?;
        let uv_set = texture.transform.as_ref().and_then(|t| t.tex_coord).unwrap_or(texture.uv_set);
        let transform = match texture.transform.as_ref().map(UvTransform::new) {
            Some(None) => {
                self.warn(&format!("the transformation of its {what} is not finite and is not used"));
                UvTransform::IDENTITY
            }
            Some(Some(transform)) => transform,
            None => UvTransform::IDENTITY,
        };
        let lookup = Lookup { uv_set, transform };
        let place = self.lookups.iter().position(|known| known.is_none_or(|(_, known)| known == lookup));
        let Some(place) = place else {
            let [first, second] = self.lookups.map(|known| known.map_or("", |(what, _)| what));
            self.warn(&format!(
                "its {what} has other texture coordinates than its {first} and its {second}, and is left out; use at most \
                 two kinds"
            ));
            return None;
        };
        let image = match find_image(self.document, texture.index, self.buffers) {
            Ok(image) => image,
            Err(why) => {
                self.warn(&format!("{why}; it is drawn without its {what}"));
                return None;
            }
        };
        let wrap = wrap(self.document, texture.index);
        match self.wrap {
            Some((other, known)) if known != wrap => {
                self.warn(&format!("its {what} wraps differently from its {other}, whose wrap mode is used"));
            }
            Some(_) => {}
            None => self.wrap = Some((what, wrap)),
        }
        self.lookups[place].get_or_insert((what, lookup));
        Some(Laid { image, second: place == 1 })
    }
}

impl From<&json::texture::Info> for Texture {
    fn from(info: &json::texture::Info) -> Self {
        let transform = info.extensions.as_ref().and_then(|e| e.texture_transform.clone());
        Self { index: info.index.value(), uv_set: info.tex_coord, transform }
    }
}

/// Wrap modes of a texture's sampler; repeat if it states none or an unknown one.
fn wrap(document: &Document, texture: usize) -> [Wrap; 2] {
    let sampler = document.root.textures.get(texture).and_then(|t| t.sampler);
    let Some(sampler) = sampler.and_then(|s| document.root.samplers.get(s.value())) else {
        return [Wrap::Repeat; 2];
    };
    [sampler.wrap_s, sampler.wrap_t].map(|mode| match mode {
        Checked::Valid(WrappingMode::ClampToEdge) => Wrap::Clamp,
        Checked::Valid(WrappingMode::MirroredRepeat) => Wrap::Mirror,
        Checked::Valid(WrappingMode::Repeat) | Checked::Invalid => Wrap::Repeat,
    })
}

fn find_image(document: &Document, texture: usize, buffers: &mut Buffers<'_>) -> Result<ImageSource, String> {
    let root = &document.root;
    let Some(stated) = root.textures.get(texture) else {
        return Err(format!("textures[{texture}] does not exist"));
    };
    let extension = |name: &str| stated.extensions.as_ref()?.others.get(name);
    // An extension's image is what the author prefers; the texture's own is for programs that cannot read it.
    let source = [TEXTURE_WEBP, TEXTURE_BASISU, TEXTURE_AVIF].into_iter().find_map(extension);
    let source = source.and_then(|of| of.get("source")?.as_u64()?.try_into().ok());
    let source = source.unwrap_or_else(|| stated.source.value());
    let Some(image) = root.images.get(source) else {
        return Err(format!("textures[{texture}] has no PNG, JPEG, WebP, AVIF or KTX2 image"));
    };
    // A name for messages; no file has it.
    let label = || {
        let mut label = document.path.clone().into_os_string();
        label.push(format!("#images[{source}]"));
        label.into()
    };
    let bytes = match (&image.buffer_view, &image.uri) {
        (Some(view), _) => buffers.image(view.value()).map_err(|e| e.to_string())?,
        (None, Some(uri)) => match document.locate(uri).map_err(|e| format!("images[{source}]: {e}"))? {
            Location::File(path) => return Ok(ImageSource { path, bytes: None }),
            Location::Inline(bytes) => bytes,
        },
        (None, None) => return Err(format!("images[{source}] has neither a uri nor a bufferView")),
    };
    Ok(ImageSource { path: label(), bytes: Some(bytes) })
}
