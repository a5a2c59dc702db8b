//! MTL files to [`ImportedMaterial`]s.
//!
//! `tobj` reads the values; the pass before it drops lines that it would fail or panic on, with a
//! warning. Texture options (`-bm`, `-s`, …) are split from the file names here. Besides Wavefront's keywords, those of
//! the common extension for physically based shading are read: `Pr`, `Pm`, their maps and `norm`
//! (Exocortex, "Extending Wavefront MTL for physically-based rendering").

mod options;
mod sanitise;
#[cfg(test)]
mod tests;

use std::collections::BTreeMap;
use std::path::Path;

use lodestream_scene::asset::{Alpha, MAX_EMISSION, MAX_NORMAL_SCALE, Material};

use crate::beside::Beside;
use crate::model::{Channel, Component, HeightMap, ImageSource, ImportedMaterial, MaterialMaps, SurfaceMap};
use crate::srgb::srgb_to_linear;
use crate::text::utf8;
use options::TextureOptions;
pub(super) use options::locate;
use sanitise::sanitise;

/// Largest MTL file, in bytes.
const MAX_MTL_BYTES: u64 = 64 << 20;
/// Most warnings per file; of further ones only the number is reported.
const MAX_WARNINGS: usize = 20;

/// Materials by name; the last definition of a name is used, as in `tobj`.
pub(super) type Library = BTreeMap<String, ImportedMaterial>;

/// Reads one MTL file of a model into `library`. Unusable lines become warnings.
pub(super) fn load(beside: &Beside, path: &Path, library: &mut Library, warnings: &mut Vec<String>) {
    match crate::file::read_file(path, MAX_MTL_BYTES) {
        Ok(bytes) => parse(beside, path, &utf8(&bytes), library, warnings),
        Err(error) => warnings.push(format!("{error}; faces that use its materials become grey")),
    }
}

fn parse(beside: &Beside, path: &Path, bytes: &[u8], library: &mut Library, warnings: &mut Vec<String>) {
    let mut found = Vec::new();
    let text = sanitise(&String::from_utf8_lossy(bytes), &mut found);
    let left_out = found.len().saturating_sub(MAX_WARNINGS);
    found.truncate(MAX_WARNINGS);
    warnings.extend(found.into_iter().map(|(line, what)| format!("{}:{line}: {what}", path.display())));
    if left_out > 0 {
        warnings.push(format!("{}: {left_out} more lines were ignored", path.display()));
    }
    match tobj::load_mtl_buf(&mut text.as_bytes()) {
        Ok((materials, _)) => {
            let here = Beside::new(path);
            for material in materials {
                let mut textures = Textures { beside, here: &here, file: path, warnings };
                library.insert(material.name.clone(), convert(&material, &mut textures));
            }
        }
        Err(error) => warnings.push(format!("{}: {error}; its materials are not used", path.display())),
    }
}

/// Resolves the textures of one material; unusable ones become warnings.
struct Textures<'a> {
    beside: &'a Beside,
    here: &'a Beside,
    file: &'a Path,
    warnings: &'a mut Vec<String>,
}

impl Textures<'_> {
    fn image(&mut self, texture: Option<&TextureOptions>) -> Option<ImageSource> {
        let found = options::locate(self.beside, self.here, &texture?.file);
        found.map_err(|why| self.warn(&why.to_string())).ok().map(Into::into)
    }

    /// A channel of a texture; `otherwise` unless the line has `-imfchan`.
    fn channel(&mut self, texture: Option<&TextureOptions>, otherwise: Component) -> Option<Channel> {
        let component = texture.and_then(|t| t.component).unwrap_or(otherwise);
        Some(Channel::plain(self.image(texture)?, component))
    }

    fn warn(&mut self, what: &str) {
        self.warnings.push(format!("{}: {what}", self.file.display()));
    }
}

fn convert(material: &tobj::Material, textures: &mut Textures<'_>) -> ImportedMaterial {
    let default = ImportedMaterial::default().material;
    let unknown = |keyword: &str| material.unknown_param.get(keyword);
    let texture = |text: Option<&String>| text.map(|text| TextureOptions::parse(text));
    let number = |keyword: &str| unknown(keyword).and_then(|text| text.parse::<f64>().ok());
    let color = texture(material.diffuse_texture.as_ref());
    let opacity_map = texture(material.dissolve_texture.as_ref());
    let [emission_map, rough, metal, normal] =
        ["map_Ke", "map_Pr", "map_Pm", "norm"].map(|k| texture(unknown(k)));
    // `disp` names a height map unambiguously, so it takes precedence over `bump`.
    let height = texture(unknown("disp").or(material.normal_texture.as_ref()));
    let name = &material.name;

    let opacity = material.dissolve.map_or(1.0, |d| d.clamp(0.0, 1.0) as f32);
    let opacity = if opacity == 0.0 {
        // An invisible material is hardly intended: some exporters write the inverse value.
        if opacity_map.is_none() {
            textures.warn(&format!("material {name:?} would be invisible (d 0 or Tr 1) and is drawn opaque"));
        }
        1.0
    } else {
        opacity
    };
    let same_file = |a: &Option<TextureOptions>| {
        a.as_ref().zip(color.as_ref()).is_some_and(|(a, color)| a.file == color.file)
    };
    let mask = if same_file(&opacity_map) { Component::Alpha } else { Component::Mask };
    let opacity_texture = textures.channel(opacity_map.as_ref(), mask);
    let normal = normal.filter(|normal| {
        if normal.bump < 0.0 {
            textures.warn(&format!(
                "the normal map of material {name:?} has a factor below zero and is left out"
            ));
        }
        normal.bump >= 0.0
    });
    let surface = SurfaceMap {
        occlusion: None,
        roughness: textures.channel(rough.as_ref(), Component::Luminance),
        metallic: textures.channel(metal.as_ref(), Component::Luminance),
    };
    let emission = textures.image(emission_map.as_ref());
    let first = [&color, &opacity_map, &rough, &metal, &normal, &emission_map, &height];
    let [r, g, b, _] = default.base_color;
    let [r, g, b] = factor(material.diffuse, color.is_some())
        .map_or([r, g, b], |rgb| rgb.map(|x| srgb_to_linear(x.clamp(0.0, 1.0) as f32)));
    let constants = Material {
        name: name.clone(),
        base_color: [r, g, b, opacity],
        roughness: match (factor(number("Pr"), rough.is_some()), material.shininess) {
            (Some(roughness), _) => roughness.clamp(0.0, 1.0) as f32,
            (None, Some(exponent)) => roughness_of(exponent),
            (None, None) => default.roughness,
        },
        // Without the map, no metal is the better guess than metal everywhere.
        metallic: match factor(number("Pm"), metal.is_some()) {
            Some(metallic) if surface.metallic.is_some() == metal.is_some() => {
                metallic.clamp(0.0, 1.0) as f32
            }
            _ => 0.0,
        },
        emission: match factor(material.emissive, emission_map.is_some()) {
            Some(rgb) if emission.is_some() == emission_map.is_some() => rgb.map(emitted),
            _ => [0.0; 3],
        },
        alpha: if opacity < 1.0 { Alpha::Blend } else { Alpha::Opaque },
        unlit: material.illumination_model == Some(0),
        wrap: first.into_iter().flatten().next().map_or(default.wrap, |texture| texture.wrap),
        normal_scale: normal.as_ref().map_or(1.0, |t| t.bump.min(MAX_NORMAL_SCALE)),
        ..Material::default()
    };
    let alpha_from_map = opacity >= 1.0 && opacity_texture.is_some();
    let maps = MaterialMaps {
        color: textures.image(color.as_ref()),
        opacity: opacity_texture,
        surface,
        occlusion: None,
        normal: textures.image(normal.as_ref()),
        emission,
        height: height.and_then(|t| Some(HeightMap { image: textures.image(Some(&t))?, scale: t.bump })),
    };
    ImportedMaterial { material: constants, maps, alpha_from_map }
}

/// The factor on a texture: 1 if none is stated, or if it is zero, which some exporters write for textured materials.
fn factor<T: Ones>(stated: Option<T>, textured: bool) -> Option<T> {
    match stated {
        Some(value) if textured && value == T::ZEROS => Some(T::ONES),
        Some(value) => Some(value),
        None => textured.then_some(T::ONES),
    }
}

trait Ones: PartialEq {
    const ZEROS: Self;
    const ONES: Self;
}

impl Ones for f64 {
    const ZEROS: Self = 0.0;
    const ONES: Self = 1.0;
}

impl Ones for [f64; 3] {
    const ZEROS: Self = [0.0; 3];
    const ONES: Self = [1.0; 3];
}

/// Linear emission of a `Ke` component: values up to 1 are sRGB-encoded as in `Kd`, larger ones linear.
fn emitted(x: f64) -> f32 {
    let x = x.clamp(0.0, f64::from(MAX_EMISSION)) as f32;
    if x <= 1.0 { srgb_to_linear(x) } else { x }
}

/// Perceptual roughness of a Phong exponent: α² = 2 / (n + 2) (Walter et al., "Microfacet models for
/// refraction", 2007, §5.2) with α = roughness² (Burley 2012). Square roots only, so that every
/// machine gets the same bits.
fn roughness_of(exponent: f64) -> f32 {
    (2.0 / (exponent.max(0.0) + 2.0)).sqrt().sqrt() as f32
}
