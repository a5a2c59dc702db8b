//! Materials of the file to [`Material`]s, with the texture coordinates that they use.

use gltf::json;
use gltf::json::material::AlphaMode;
use gltf::json::texture::WrappingMode;
use gltf::json::validation::Checked;

use super::accessor::Buffers;
use super::container::{Document, Location};
use super::ignored::Ignored;
use crate::error::ImportError;
use crate::model::{ImageSource, Material};

/// A material and what its colour texture is looked up with.
#[derive(Clone, Debug)]
pub(super) struct Converted {
    pub(super) material: Material,
    /// Which TEXCOORD_n.
    pub(super) uv_set: u32,
    pub(super) uv_transform: UvTransform,
}

/// `KHR_texture_transform`: `uv' = offset + rotation × scale × uv`, `v` down.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct UvTransform {
    /// Rows of the 2 × 3 matrix.
    rows: [[f64; 3]; 2],
}

impl UvTransform {
    const IDENTITY: Self = Self { rows: [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]] };

    fn new(transform: &json::extensions::texture::TextureTransform) -> Self {
        let [ox, oy] = transform.offset.0.map(f64::from);
        let [sx, sy] = transform.scale.0.map(f64::from);
        let (sin, cos) = f64::from(transform.rotation.0).sin_cos();
        Self { rows: [[cos * sx, sin * sy, ox], [-sin * sx, cos * sy, oy]] }
    }

    /// Texture coordinates with `v` up, of those of the file.
    pub(super) fn apply(&self, [u, v]: [f64; 2]) -> [f32; 2] {
        let row = |r: [f64; 3]| r[0] * u + r[1] * v + r[2];
        [row(self.rows[0]) as f32, (1.0 - row(self.rows[1])) as f32]
    }
}

/// Converts the material `index` of the file; `None` is glTF's default material.
///
/// # Errors
/// A material that does not exist. Textures that cannot be found become warnings.
pub(super) fn convert(
    document: &Document,
    index: Option<usize>,
    buffers: &mut Buffers<'_>,
    ignored: &mut Ignored,
    warnings: &mut Vec<String>,
) -> Result<Converted, ImportError> {
    let mut converted = Converted {
        material: Material { base_color: [1.0; 3], roughness: 1.0, ..Material::default() },
        uv_set: 0,
        uv_transform: UvTransform::IDENTITY,
    };
    let Some(index) = index else { return Ok(converted) };
    let Some(source) = document.root.materials.get(index) else {
        return Err(document.error(format!("materials[{index}] does not exist")));
    };
    note_ignored(source, ignored);
    let pbr = &source.pbr_metallic_roughness;
    let factor = pbr.base_color_factor.0.map(|x| if x.is_finite() { x.clamp(0.0, 1.0) } else { 1.0 });
    let roughness = pbr.roughness_factor.0;
    let material = &mut converted.material;
    material.name = source.name.clone().unwrap_or_else(|| format!("material-{index}"));
    material.base_color = [factor[0], factor[1], factor[2]];
    material.opacity =
        if matches!(source.alpha_mode, Checked::Valid(AlphaMode::Opaque)) { 1.0 } else { factor[3] };
    material.roughness = if roughness.is_finite() { roughness.clamp(0.0, 1.0) } else { 1.0 };
    if let Some(info) = &pbr.base_color_texture {
        material.color_texture = image(document, info.index.value(), buffers, ignored, warnings);
        converted.uv_set = info.tex_coord;
        if let Some(transform) = info.extensions.as_ref().and_then(|e| e.texture_transform.as_ref()) {
            converted.uv_set = transform.tex_coord.unwrap_or(info.tex_coord);
            converted.uv_transform = UvTransform::new(transform);
        }
    }
    Ok(converted)
}

fn note_ignored(source: &json::Material, ignored: &mut Ignored) {
    let pbr = &source.pbr_metallic_roughness;
    for (what, used) in [
        ("normal textures", source.normal_texture.is_some()),
        ("occlusion textures", source.occlusion_texture.is_some()),
        ("metallic-roughness textures", pbr.metallic_roughness_texture.is_some()),
        ("emission", source.emissive_texture.is_some() || source.emissive_factor.0 != [0.0; 3]),
        ("alphaMode BLEND (drawn opaque)", source.alpha_mode == Checked::Valid(AlphaMode::Blend)),
        ("alphaMode MASK (drawn opaque)", source.alpha_mode == Checked::Valid(AlphaMode::Mask)),
    ] {
        if used {
            ignored.note(what);
        }
    }
}

/// The image of a texture; a warning and `None` where there is none.
fn image(
    document: &Document,
    texture: usize,
    buffers: &mut Buffers<'_>,
    ignored: &mut Ignored,
    warnings: &mut Vec<String>,
) -> Option<ImageSource> {
    let found = find_image(document, texture, buffers);
    if let Err(why) = &found {
        warnings.push(format!("{}: {why}; the material is drawn without it", document.path.display()));
    }
    let sampler =
        document.root.textures.get(texture)?.sampler.and_then(|s| document.root.samplers.get(s.value()));
    let repeats = |wrap| matches!(wrap, Checked::Valid(WrappingMode::Repeat));
    if sampler.is_some_and(|s| !repeats(s.wrap_s) || !repeats(s.wrap_t)) {
        ignored.note("wrapping modes other than REPEAT");
    }
    found.ok()
}

fn find_image(document: &Document, texture: usize, buffers: &mut Buffers<'_>) -> Result<ImageSource, String> {
    let root = &document.root;
    let Some(source) = root.textures.get(texture).map(|texture| texture.source.value()) else {
        return Err(format!("textures[{texture}] does not exist"));
    };
    let Some(image) = root.images.get(source) else {
        return Err(format!("textures[{texture}] has no PNG or JPEG image"));
    };
    // A name for people; no file is looked for under it.
    let label = || {
        let mut label = document.path.clone().into_os_string();
        label.push(format!("#images[{source}]"));
        label.into()
    };
    let bytes = match (&image.buffer_view, &image.uri) {
        (Some(view), _) => buffers.view(view.value()).map_err(|e| e.to_string())?.0,
        (None, Some(uri)) => match document.locate(uri).map_err(|e| format!("images[{source}]: {e}"))? {
            Location::File(path) => return Ok(ImageSource { path, bytes: None }),
            Location::Inline(bytes) => bytes,
        },
        (None, None) => return Err(format!("images[{source}] has neither a uri nor a bufferView")),
    };
    Ok(ImageSource { path: label(), bytes: Some(bytes) })
}
