//! Converts glTF materials to [`ImportedMaterial`]s, with the texture coordinates of their maps.

use gltf::json;
use gltf::json::extensions::material::PbrSpecularGlossiness;
use gltf::json::material::AlphaMode;
use gltf::json::validation::Checked;
use lodestream_scene::asset::{Alpha, MAX_EMISSION, MAX_NORMAL_SCALE, Material};

use super::accessor::Buffers;
use super::container::Document;
use super::maps::{Laid, Lookup, Maps, Texture};
use super::specular::{clear_coat, specular};
use crate::error::ImportError;
use crate::model::{Channel, Component, ImageSource, ImportedMaterial, MaterialMaps};

/// A material and the texture coordinates of its maps.
#[derive(Clone, Debug)]
pub(super) struct Converted {
    pub(super) imported: ImportedMaterial,
    /// Lookups by the first and the second set of texture coordinates; the second only if a map needs it.
    pub(super) lookups: [Option<Lookup>; 2],
}

/// Converts the material `index` of the file; `None` is glTF's default material.
///
/// # Errors
/// A material that does not exist. Textures that cannot be found become warnings.
pub(super) fn convert(
    document: &Document,
    index: Option<usize>,
    buffers: &mut Buffers<'_>,
    warnings: &mut Vec<String>,
) -> Result<Converted, ImportError> {
    let mut imported = ImportedMaterial::default();
    let ImportedMaterial { material, maps: images, .. } = &mut imported;
    (material.base_color, material.roughness, material.metallic) = ([1.0; 4], 1.0, 1.0);
    let Some(index) = index else {
        return Ok(Converted { imported, lookups: [None; 2] });
    };
    let Some(source) = document.root.materials.get(index) else {
        return Err(document.error(format!("materials[{index}] does not exist")));
    };
    material.name = source.name.clone().unwrap_or_else(|| format!("material-{index}"));
    let mut maps = Maps::new(document, buffers, warnings, material.name.clone());
    let extensions = source.extensions.as_ref();
    material.unlit = extensions.is_some_and(|e| e.unlit.is_some());
    // A file with both models offers metallic-roughness to readers that support it.
    match extensions.and_then(|e| e.pbr_specular_glossiness.as_ref()).filter(|_| !has_core(source)) {
        Some(glossy) => specular_glossiness(glossy, material, images, &mut maps),
        None => {
            metallic_roughness(source, material, images, &mut maps);
            let lit = extensions.filter(|_| !material.unlit);
            material.specular = lit.map(specular).unwrap_or_default();
            material.clear_coat = lit.map(clear_coat).unwrap_or_default();
        }
    }
    if !material.unlit {
        normal_occlusion_emission(source, material, images, &mut maps);
    }
    alpha(source, material, &mut maps);
    material.wrap = maps.wrap();
    Ok(Converted { lookups: maps.lookups(), imported })
}

/// An image, and whether it is laid by the second set of texture coordinates.
fn laid(map: Option<Laid>) -> (Option<ImageSource>, bool) {
    map.map_or((None, false), |Laid { image, second }| (Some(image), second))
}

/// Clamps a number to 0..=1; NaN becomes 1, the default of all factors.
fn unit(x: f32) -> f32 {
    if x.is_nan() { 1.0 } else { x.clamp(0.0, 1.0) }
}

/// Whether `pbrMetallicRoughness` differs from its defaults.
fn has_core(source: &json::Material) -> bool {
    let pbr = &source.pbr_metallic_roughness;
    pbr.base_color_texture.is_some()
        || pbr.metallic_roughness_texture.is_some()
        || pbr.base_color_factor.0 != [1.0; 4]
        || [pbr.metallic_factor.0, pbr.roughness_factor.0] != [1.0; 2]
}

fn metallic_roughness(
    source: &json::Material,
    material: &mut Material,
    images: &mut MaterialMaps,
    maps: &mut Maps<'_, '_>,
) {
    let pbr = &source.pbr_metallic_roughness;
    material.base_color = pbr.base_color_factor.0.map(unit);
    material.roughness = unit(pbr.roughness_factor.0);
    material.metallic = unit(pbr.metallic_factor.0);
    let color = maps.image("base colour texture", pbr.base_color_texture.as_ref().map(Texture::from));
    (images.color, material.second_uv.color) = laid(color);
    if material.unlit {
        return;
    }
    let texture = pbr.metallic_roughness_texture.as_ref().map(Texture::from);
    if let Some(Laid { image, second }) = maps.image("metallic-roughness texture", texture) {
        material.second_uv.surface = second;
        images.surface.roughness = Some(Channel::plain(image.clone(), Component::Green));
        images.surface.metallic = Some(Channel::plain(image, Component::Blue));
    } else if pbr.metallic_roughness_texture.is_some() {
        // Without the map, no metal is the better guess than metal everywhere.
        material.metallic = 0.0;
    }
}

/// Approximates specular-glossiness: 1 − glossiness is the roughness; colours without textures become base colour and
/// metal, of textures the diffuse one is the base colour of what is no metal.
fn specular_glossiness(
    glossy: &PbrSpecularGlossiness,
    material: &mut Material,
    images: &mut MaterialMaps,
    maps: &mut Maps<'_, '_>,
) {
    let [r, g, b, opacity] = glossy.diffuse_factor.0.map(unit);
    material.base_color = [r, g, b, opacity];
    material.metallic = 0.0;
    let color = maps.image("diffuse texture", glossy.diffuse_texture.as_ref().map(Texture::from));
    (images.color, material.second_uv.color) = laid(color);
    let specular = glossy.specular_factor.0.map(unit);
    let is_black = [r, g, b] == [0.0; 3];
    if glossy.diffuse_texture.is_none() && (is_black || glossy.specular_glossiness_texture.is_none()) {
        let ([r, g, b], metallic) = metal_of([r, g, b], specular);
        (material.base_color, material.metallic) = ([r, g, b, opacity], metallic);
    }
    let gloss = unit(glossy.glossiness_factor.0);
    material.roughness = 1.0 - gloss;
    let texture = glossy.specular_glossiness_texture.as_ref().map(Texture::from);
    if let Some(Laid { image, second }) = maps.image("specular-glossiness texture", texture) {
        material.second_uv.surface = second;
        // Roughness is 1 − factor × texel: the factor is the channel's.
        let strength = (gloss * f32::from(u16::MAX)).round() as u16;
        let channel = Channel { image, component: Component::Alpha, inverted: true, strength };
        (images.surface.roughness, material.roughness) = (Some(channel), 1.0);
    }
}

/// Base colour and metal of a diffuse and a specular colour, all linear (Khronos, KHR_materials_pbrSpecularGlossiness,
/// `examples/convert-between-workflows`: the metal for which both models reflect as much).
fn metal_of(diffuse: [f32; 3], specular: [f32; 3]) -> ([f32; 3], f32) {
    /// Reflection of what is no metal.
    const DIELECTRIC: f32 = 0.04;
    const LEAST: f32 = 1e-6;
    let brightness = |[r, g, b]: [f32; 3]| (0.299 * r * r + 0.587 * g * g + 0.114 * b * b).sqrt();
    let not_reflected = 1.0 - specular.into_iter().fold(0.0, f32::max);
    let (dark, bright) = (brightness(diffuse), brightness(specular));
    let metallic = if bright < DIELECTRIC {
        0.0
    } else {
        let b = dark * not_reflected / (1.0 - DIELECTRIC) + bright - 2.0 * DIELECTRIC;
        let root = (b * b - 4.0 * DIELECTRIC * (DIELECTRIC - bright)).max(0.0).sqrt();
        ((root - b) / (2.0 * DIELECTRIC)).clamp(0.0, 1.0)
    };
    let base = |channel: usize| {
        let of_diffuse = diffuse[channel] * not_reflected / (1.0 - DIELECTRIC) / (1.0 - metallic).max(LEAST);
        let of_specular = (specular[channel] - DIELECTRIC * (1.0 - metallic)) / metallic.max(LEAST);
        let share = metallic * metallic;
        (of_diffuse + (of_specular - of_diffuse) * share).clamp(0.0, 1.0)
    };
    ([0, 1, 2].map(base), metallic)
}

fn normal_occlusion_emission(
    source: &json::Material,
    material: &mut Material,
    images: &mut MaterialMaps,
    maps: &mut Maps<'_, '_>,
) {
    if let Some(normal) = &source.normal_texture {
        if normal.scale >= 0.0 {
            let others = normal.extensions.as_ref().map(|e| &e.others);
            let texture = maps.texture_with_extensions(normal.index.value(), normal.tex_coord, others);
            (images.normal, material.second_uv.normal) = laid(maps.image("normal texture", Some(texture)));
            material.normal_scale = normal.scale.min(MAX_NORMAL_SCALE);
        } else {
            maps.warn("its normal texture has a scale below zero and is left out");
        }
    }
    if let Some(occlusion) = &source.occlusion_texture {
        let strength = unit(occlusion.strength.0);
        let others = occlusion.extensions.as_ref().map(|e| &e.others);
        let texture = maps.texture_with_extensions(occlusion.index.value(), occlusion.tex_coord, others);
        if strength > 0.0
            && let Some(Laid { image, second }) = maps.image("occlusion texture", Some(texture))
        {
            let strength = (strength * f32::from(u16::MAX)).round() as u16;
            let channel = Channel { strength, ..Channel::plain(image, Component::Red) };
            if images.surface.is_empty() {
                material.second_uv.surface = second;
            }
            // Roughness and metal may be laid otherwise.
            let same = material.second_uv.surface == second;
            *(if same { &mut images.surface.occlusion } else { &mut images.occlusion }) = Some(channel);
        }
    }
    let strength = source.extensions.as_ref().and_then(|e| e.emissive_strength.as_ref());
    let strength = strength.map_or(1.0, |s| s.emissive_strength.0);
    let strength = if strength.is_nan() { 1.0 } else { strength.clamp(0.0, MAX_EMISSION) };
    material.emission =
        source.emissive_factor.0.map(|x| if x.is_nan() { 0.0 } else { x.clamp(0.0, 1.0) * strength });
    // A factor of zero makes the texture invisible.
    if material.emission != [0.0; 3] {
        let emission = maps.image("emissive texture", source.emissive_texture.as_ref().map(Texture::from));
        (images.emission, material.second_uv.emission) = laid(emission);
        if source.emissive_texture.is_some() && images.emission.is_none() {
            material.emission = [0.0; 3];
        }
    }
}

fn alpha(source: &json::Material, material: &mut Material, maps: &mut Maps<'_, '_>) {
    match source.alpha_mode {
        Checked::Valid(AlphaMode::Mask) => {
            let cutoff = source.alpha_cutoff.map_or(0.5, |cutoff| cutoff.0);
            // "A value greater than 1.0 will render the entire material as fully transparent" (§3.9.4).
            if cutoff > 1.0 {
                material.base_color[3] = 0.0;
            }
            material.alpha = Alpha::Mask(if cutoff.is_nan() { 0.5 } else { cutoff.clamp(0.0, 1.0) });
        }
        Checked::Valid(AlphaMode::Blend) => material.alpha = Alpha::Blend,
        // The alpha of an opaque material has no effect.
        Checked::Valid(AlphaMode::Opaque) => material.base_color[3] = 1.0,
        Checked::Invalid => {
            material.base_color[3] = 1.0;
            maps.warn("its alphaMode is unknown; it is drawn opaque");
        }
    }
    let Some(transmission) = source.extensions.as_ref().and_then(|e| e.transmission.as_ref()) else { return };
    let factor = transmission.transmission_factor.0;
    // With a transmission texture, the factor alone would make the whole surface transparent.
    if factor <= 0.0 || transmission.transmission_texture.is_some() || material.unlit {
        return;
    }
    if let Alpha::Mask(_) = material.alpha {
        maps.warn("it has holes, so its transmission is left out");
    } else {
        (material.alpha, material.transmission) = (Alpha::Blend, factor.min(1.0));
    }
}
