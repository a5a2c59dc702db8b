//! Colours of a base mesh with its materials and textures, as colours of face corners.

use std::collections::BTreeMap;

use lodestream_geometry::DecodeError;
use lodestream_geometry::base::Base;
use lodestream_import::srgb::{linear_to_srgb, srgb_to_linear};
use lodestream_scene::BlobPart;
use lodestream_scene::asset::{Alpha, AssetDescription, Material, Wrap};
use lodestream_store::{PackFile, StoreError};

/// Barycentric coordinates at which the texture is sampled for the first corner: the third of the face next to it.
const SAMPLES: [[f64; 3]; 4] = [[0.8, 0.1, 0.1], [0.5, 0.4, 0.1], [0.5, 0.1, 0.4], [0.4, 0.3, 0.3]];
/// Share of a surface that must be opaque for it to be drawn.
const MIN_COVERAGE: f64 = 0.5;

/// Coarsest level of a texture, in linear light, and its mean. Red, green, blue, opacity.
struct Texels {
    size: [usize; 2],
    texels: Vec<[f64; 4]>,
    mean: [f64; 4],
}

/// Linear light of an sRGB byte.
fn linear(byte: u8) -> f64 {
    f64::from(srgb_to_linear(f32::from(byte) / 255.0))
}

impl Texels {
    fn read(pack: &PackFile, texture: u16) -> Result<Self, StoreError> {
        let bytes = pack.read(BlobPart::Texture { texture, level: 0 })?;
        let broken = |why: image::ImageError| {
            pack.damaged(DecodeError::new(format!("texture {texture}"), why.to_string()))
        };
        let image = image::load_from_memory(&bytes).map_err(broken)?.to_rgba8();
        let size = [image.width() as usize, image.height() as usize];
        let texel = |p: &image::Rgba<u8>| {
            let [r, g, b, a] = p.0;
            [linear(r), linear(g), linear(b), f64::from(a) / 255.0]
        };
        let texels: Vec<[f64; 4]> = image.pixels().map(texel).collect();
        let opacity: f64 = texels.iter().map(|texel| texel[3]).sum();
        let mut mean = [0.0; 4];
        for texel in &texels {
            // Transparent texels have no colour.
            let weight = if opacity > 0.0 { texel[3] / opacity } else { 1.0 / texels.len() as f64 };
            (0..3).for_each(|channel| mean[channel] += weight * texel[channel]);
        }
        mean[3] = opacity / texels.len().max(1) as f64;
        Ok(Self { size, texels, mean })
    }

    /// The texel at texture coordinates, of which v runs up.
    fn at(&self, uv: [f64; 2], wrap: [Wrap; 2]) -> [f64; 4] {
        let place = |x: f64, wrap: Wrap, size: usize| {
            let x = match wrap {
                Wrap::Repeat => x - x.floor(),
                Wrap::Clamp => x.clamp(0.0, 1.0),
                Wrap::Mirror => 1.0 - ((x - 2.0 * (x / 2.0).floor()) - 1.0).abs(),
            };
            ((x * size as f64) as usize).min(size.saturating_sub(1))
        };
        let [u, v] = uv;
        let (column, row) = (place(u, wrap[0], self.size[0]), place(v, wrap[1], self.size[1]));
        let row = self.size[1] - 1 - row;
        self.texels.get(row * self.size[0] + column).copied().unwrap_or(self.mean)
    }
}

/// Colours of the corners of a mesh's faces, sRGB with opacity; `None` for faces that are more transparent than not.
pub(super) fn corners(
    pack: &PackFile,
    base: &Base,
    description: &AssetDescription,
) -> Result<Vec<Option<[[u8; 4]; 3]>>, StoreError> {
    let mut textures: BTreeMap<u16, Texels> = BTreeMap::new();
    for texture in description.materials.iter().filter_map(|material| material.base_color_texture) {
        if let std::collections::btree_map::Entry::Vacant(entry) = textures.entry(texture) {
            entry.insert(Texels::read(pack, texture)?);
        }
    }
    let texture_of = |material: &Material| material.base_color_texture.and_then(|of| textures.get(&of));
    // A wedge has one colour in all its faces of one material, or seams would appear everywhere.
    let mut sums: BTreeMap<(u32, u16), ([f64; 3], f64)> = BTreeMap::new();
    let default = Material::default();
    let material_of = |number: u16| description.materials.get(usize::from(number)).unwrap_or(&default);
    for face in &base.faces {
        let material = material_of(face.material);
        let Some(texture) = texture_of(material) else { continue };
        let uv = face.wedges.map(|wedge| base.uv_grid.uv(base.wedges[wedge as usize].attributes.uv));
        let extent = |axis: usize| {
            let of = uv.map(|uv| uv[axis]);
            of.into_iter().fold(f64::MIN, f64::max) - of.into_iter().fold(f64::MAX, f64::min)
        };
        // Samples of a texture that repeats on the face would depend on chance.
        let repeats = extent(0) > 1.0 || extent(1) > 1.0;
        for corner in 0..3 {
            let (sum, weight) = sums.entry((face.wedges[corner], face.material)).or_default();
            let mut add = |[r, g, b, a]: [f64; 4]| {
                [r, g, b].into_iter().zip(&mut *sum).for_each(|(x, sum)| *sum += a * x);
                *weight += a;
            };
            if repeats {
                add(texture.mean);
                continue;
            }
            for [own, next, last] in SAMPLES {
                let of = [uv[corner], uv[(corner + 1) % 3], uv[(corner + 2) % 3]];
                let at = [0, 1].map(|axis| own * of[0][axis] + next * of[1][axis] + last * of[2][axis]);
                add(texture.at(at, material.wrap));
            }
        }
    }
    let color = |wedge: u32, number: u16| {
        let material = material_of(number);
        let own = base.wedges[wedge as usize].attributes.color;
        let sampled = match sums.get(&(wedge, number)) {
            Some((sum, weight)) if *weight > 0.0 => sum.map(|x| x / weight),
            _ => texture_of(material).map_or([1.0; 3], |texture| [0, 1, 2].map(|i| texture.mean[i])),
        };
        let rgb = [0, 1, 2]
            .map(|i| linear_to_srgb(f64::from(material.base_color[i]) * linear(own[i]) * sampled[i]));
        [rgb[0], rgb[1], rgb[2], u8::MAX]
    };
    let drawn: Vec<f64> =
        description.materials.iter().map(|material| coverage(material, texture_of(material))).collect();
    let colors = base.faces.iter().map(|face| {
        let material = material_of(face.material);
        let of_vertices = face.wedges.map(|w| f64::from(base.wedges[w as usize].attributes.color[3]) / 255.0);
        let opacity = match material.alpha {
            Alpha::Opaque => 1.0,
            _ => {
                drawn.get(usize::from(face.material)).unwrap_or(&1.0) * of_vertices.iter().sum::<f64>() / 3.0
            }
        };
        (opacity >= MIN_COVERAGE).then(|| face.wedges.map(|wedge| color(wedge, face.material)))
    });
    Ok(colors.collect())
}

/// Share of a material's surface that is opaque.
fn coverage(material: &Material, texture: Option<&Texels>) -> f64 {
    let own = f64::from(material.plain_opacity());
    match material.alpha {
        Alpha::Opaque => 1.0,
        Alpha::Blend => own * texture.map_or(1.0, |texture| texture.mean[3]),
        Alpha::Mask(cutoff) => {
            let drawn = |opacity: f64| own * opacity >= f64::from(cutoff);
            texture.map_or(f64::from(u8::from(drawn(1.0))), |texture| {
                let count = texture.texels.iter().filter(|texel| drawn(texel[3])).count();
                count as f64 / texture.texels.len().max(1) as f64
            })
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn texels(alpha: [f64; 2]) -> Texels {
        let texels = vec![[1.0, 0.0, 0.0, alpha[0]], [0.0, 0.0, 1.0, alpha[1]]];
        Texels { size: [2, 1], texels, mean: [0.5, 0.0, 0.5, (alpha[0] + alpha[1]) / 2.0] }
    }

    #[test]
    fn textures_continue_as_the_material_says() {
        let texture = texels([1.0; 2]);
        let red = |u: f64, wrap| texture.at([u, 0.5], [wrap; 2])[0] > 0.5;
        assert_eq!(
            [-0.9, -0.1, 0.1, 0.9, 1.1].map(|u| red(u, Wrap::Repeat)),
            [true, false, true, false, true]
        );
        assert_eq!([-0.9, 0.1, 1.9].map(|u| red(u, Wrap::Clamp)), [true, true, false]);
        assert_eq!(
            [-0.9, -0.1, 0.9, 1.1, 1.9].map(|u| red(u, Wrap::Mirror)),
            [false, true, false, false, true]
        );
    }

    #[test]
    fn coverage_is_the_opaque_share() {
        let with =
            |alpha, opacity| Material { alpha, base_color: [1.0, 1.0, 1.0, opacity], ..Material::default() };
        let texture = texels([1.0, 0.25]);
        assert_eq!(coverage(&with(Alpha::Opaque, 0.0), None), 1.0);
        assert_eq!(coverage(&with(Alpha::Blend, 0.5), None), 0.5);
        assert_eq!(coverage(&with(Alpha::Blend, 1.0), Some(&texture)), 0.625);
        assert_eq!(coverage(&with(Alpha::Mask(0.5), 1.0), Some(&texture)), 0.5);
        assert_eq!(coverage(&with(Alpha::Mask(0.5), 0.25), None), 0.0);
    }
}
