//! Where the surface of an asset is in its textures: what decides which tiles a view shows.
//!
//! The input's faces are gathered into regions. For each region and material it is stated how dense texture coordinates
//! are and which cells they cover. A *cell* is a tile of the finest level of the material's largest texture
//! ([`cells_of`]); coordinates beyond 0..=1 are wrapped first. Spheres are rounded outwards.

use std::ops::Range;

use lodestream_geometry::index::Sphere;

use super::tiles::{is_tiled, tile_grid};
use super::{AssetDescription, MAX_MATERIALS};
use crate::encoding::{self, CodingError, Decode, Encode, Reader, Writer};

/// Most regions of an asset.
pub const MAX_TEXTURE_REGIONS: usize = 1024;
/// Most memory that decoded regions may take, in bytes.
const MAX_MEMORY_BYTES: usize = 16 << 20;

/// The regions of an asset.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct TextureRegions {
    /// Least coordinates of the spheres' centres, relative to the asset's origin.
    pub low: [f32; 3],
    /// Longest side of the box around the centres, or the largest radius if that is longer, in the asset's units.
    pub size: f32,
    /// The regions.
    pub regions: Vec<TextureRegion>,
}

/// A part of the surface.
#[derive(Clone, Debug, PartialEq)]
pub struct TextureRegion {
    /// Bounds, the centre relative to the asset's origin.
    pub sphere: Sphere,
    /// What each material shows there.
    pub patches: Vec<TexturePatch>,
}

/// What a material shows in a region.
#[derive(Clone, Debug, PartialEq)]
pub struct TexturePatch {
    /// The material.
    pub material: u16,
    /// Area of the surface, in the asset's units.
    pub area: f32,
    /// Texture coordinates per unit: the square root of uv area over surface area.
    pub uv_per_unit: f32,
    /// Cells, row by row, in ascending runs with gaps between them.
    pub cells: Vec<Range<u16>>,
}

impl TexturePatch {
    /// Number of its cells.
    #[must_use]
    pub fn cell_count(&self) -> usize {
        self.cells.iter().map(ExactSizeIterator::len).sum()
    }
}

/// Size of the level whose tiles are a material's cells: the finest of its largest texture that has tiles; one texel
/// without.
#[must_use]
pub fn cells_of(description: &AssetDescription, material: u16) -> [u32; 2] {
    let material = description.materials.get(usize::from(material));
    let textures = material.into_iter().flat_map(super::Material::textures);
    let tiled = textures.filter_map(|texture| {
        let info = description.textures.get(usize::from(texture))?;
        let size = [info.width, info.height];
        is_tiled(info.kind, size).then_some(size)
    });
    tiled.max_by_key(|[width, height]| u64::from(*width) * u64::from(*height)).unwrap_or([1, 1])
}

impl TextureRegions {
    /// Encodes the regions; lengths and directions are rounded.
    ///
    /// # Errors
    /// Regions that [`TextureRegions::decode`] would refuse.
    pub fn encode(&self) -> Result<Vec<u8>, CodingError> {
        let bytes = encoding::encode(self)?;
        Self::decode(&bytes)?;
        Ok(bytes)
    }

    /// Decodes regions, all of `bytes`.
    ///
    /// # Errors
    /// Refuses truncated, overlong and inconsistent regions.
    pub fn decode(bytes: &[u8]) -> Result<Self, CodingError> {
        encoding::decode(bytes, MAX_MEMORY_BYTES)
    }

    /// Whether all materials and cells exist.
    #[must_use]
    pub fn fit(&self, description: &AssetDescription) -> bool {
        let fits = |patch: &TexturePatch| {
            let cells: u32 = tile_grid(cells_of(description, patch.material)).iter().product();
            let end = patch.cells.last().map_or(0, |run| u32::from(run.end));
            usize::from(patch.material) < description.materials.len().max(1) && end <= cells
        };
        self.regions.iter().flat_map(|region| &region.patches).all(fits)
    }

    fn check(&self) -> Result<(), CodingError> {
        let finite = self.low.iter().all(|x| x.is_finite()) && self.size >= 0.0 && self.size.is_finite();
        let in_order = |patch: &TexturePatch| {
            usize::from(patch.material) < MAX_MATERIALS
                && !patch.cells.is_empty()
                && patch.cells.iter().all(|run| run.start < run.end)
                && patch.cells.is_sorted_by(|a, b| a.end < b.start)
        };
        let patches = self.regions.iter().flat_map(|region| &region.patches);
        if finite && self.regions.len() <= MAX_TEXTURE_REGIONS && patches.clone().all(in_order) {
            Ok(())
        } else {
            Err(CodingError::value("texture regions out of range"))
        }
    }
}

/// Powers of the fourth root of two.
const ROOTS: [f32; 4] = [1.0, 1.189_207_1, std::f32::consts::SQRT_2, 1.681_792_8];

/// A length on a scale of quarters of an octave, from 2⁻³² on. By multiplication alone, so it is the same everywhere.
fn quarter_octaves(code: u8) -> f32 {
    f32::from_bits((127 - 32 + u32::from(code / 4)) << 23) * ROOTS[usize::from(code % 4)]
}

/// The code of the least length on the scale that is not below a length.
fn code_of(length: f32) -> u8 {
    (0..=u8::MAX).find(|&code| quarter_octaves(code) >= length).unwrap_or(u8::MAX)
}

/// Steps of a coordinate along the box.
const STEPS: f32 = 65_535.0;

impl Encode for TextureRegions {
    fn encode<W: Writer>(&self, writer: &mut W) -> Result<(), CodingError> {
        self.check()?;
        self.low.encode(writer)?;
        self.size.encode(writer)?;
        let size = self.size.max(f32::MIN_POSITIVE);
        u32::try_from(self.regions.len()).unwrap_or(u32::MAX).encode(writer)?;
        for region in &self.regions {
            for axis in 0..3 {
                #[expect(
                    clippy::cast_possible_truncation,
                    clippy::cast_sign_loss,
                    reason = "clamped to the range first"
                )]
                let steps = ((region.sphere.center[axis] - self.low[axis]) / size * STEPS)
                    .round()
                    .clamp(0.0, STEPS) as u16;
                steps.to_le_bytes().encode(writer)?;
            }
            // The centre moves by at most half a step along each axis.
            code_of(region.sphere.radius / size + 1.0 / STEPS).encode(writer)?;
            u16::try_from(region.patches.len()).unwrap_or(u16::MAX).encode(writer)?;
            for patch in &region.patches {
                patch.material.encode(writer)?;
                code_of(patch.area / (size * size)).encode(writer)?;
                // To the nearest: an eighth of an octave below the next.
                code_of(patch.uv_per_unit * size * 0.917).encode(writer)?;
                u16::try_from(patch.cells.len()).unwrap_or(u16::MAX).encode(writer)?;
                let mut end = 0;
                for run in &patch.cells {
                    (run.start - end).encode(writer)?;
                    (run.end - run.start - 1).encode(writer)?;
                    end = run.end;
                }
            }
        }
        Ok(())
    }
}

impl Decode for TextureRegions {
    fn decode<R: Reader>(reader: &mut R) -> Result<Self, CodingError> {
        let low = <[f32; 3]>::decode(reader)?;
        let size = f32::decode(reader)?;
        let count = u32::decode(reader)? as usize;
        if count > MAX_TEXTURE_REGIONS {
            return Err(CodingError::LimitExceeded);
        }
        reader.claim(count * size_of::<TextureRegion>())?;
        let scale = size.max(f32::MIN_POSITIVE);
        let mut regions = Vec::with_capacity(count);
        for _ in 0..count {
            let mut center = low;
            for part in &mut center {
                *part += f32::from(u16::from_le_bytes(reader.array()?)) / STEPS * scale;
            }
            let radius = quarter_octaves(u8::decode(reader)?) * scale;
            let patches = decode_patches(reader, scale)?;
            regions.push(TextureRegion { sphere: Sphere { center, radius }, patches });
        }
        let this = Self { low, size, regions };
        this.check()?;
        Ok(this)
    }
}

fn decode_patches<R: Reader>(reader: &mut R, scale: f32) -> Result<Vec<TexturePatch>, CodingError> {
    let count = usize::from(u16::decode(reader)?);
    // A patch takes at least six bytes.
    if !reader.has(6 * count) {
        return Err(CodingError::EndsEarly);
    }
    reader.claim(count * size_of::<TexturePatch>())?;
    let mut patches = Vec::with_capacity(count);
    for _ in 0..count {
        let material = u16::decode(reader)?;
        let area = quarter_octaves(u8::decode(reader)?) * scale * scale;
        let uv_per_unit = quarter_octaves(u8::decode(reader)?) / scale;
        let runs = usize::from(u16::decode(reader)?);
        if !reader.has(2 * runs) {
            return Err(CodingError::EndsEarly);
        }
        reader.claim(runs * size_of::<Range<u16>>())?;
        let mut cells = Vec::with_capacity(runs);
        let mut end = 0_u16;
        for _ in 0..runs {
            let beyond = || CodingError::value("a cell beyond the last");
            let start = end.checked_add(u16::decode(reader)?).ok_or_else(beyond)?;
            let length = u16::decode(reader)?.checked_add(1).ok_or_else(beyond)?;
            end = start.checked_add(length).ok_or_else(beyond)?;
            cells.push(start..end);
        }
        patches.push(TexturePatch { material, area, uv_per_unit, cells });
    }
    Ok(patches)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn region(center: [f32; 3]) -> TextureRegion {
        let patch = |material, cells| TexturePatch { material, area: 0.7, uv_per_unit: 3.0, cells };
        TextureRegion {
            sphere: Sphere { center, radius: 0.3 },
            patches: vec![patch(0, vec![0..3, 5..6]), patch(2, std::iter::once(900..1024).collect())],
        }
    }

    fn regions() -> TextureRegions {
        let centers = [[2.0, 0.0, 2.0], [1.0, -1.0, 2.0], [0.4, 0.48, 2.64], [1.6, 0.0, 1.2]];
        let regions = centers.map(region);
        TextureRegions { low: [0.0, -1.0, 1.0], size: 2.0, regions: regions.to_vec() }
    }

    #[test]
    fn rounded_regions_contain_the_given_ones() {
        let given = regions();
        let bytes = given.encode().unwrap();
        let back = TextureRegions::decode(&bytes).unwrap();
        assert!(bytes.len() < 35 * given.regions.len(), "{} bytes", bytes.len());
        for (given, back) in given.regions.iter().zip(&back.regions) {
            let moved: f32 =
                given.sphere.center.iter().zip(back.sphere.center).map(|(a, b)| (a - b).powi(2)).sum();
            assert!(given.sphere.radius + moved.sqrt() <= back.sphere.radius, "{back:?}");
            assert!(back.sphere.radius < 1.2 * given.sphere.radius + 1e-3);
            for (given, back) in given.patches.iter().zip(&back.patches) {
                assert_eq!((given.material, &given.cells), (back.material, &back.cells));
                for (given, back) in [(given.area, back.area), (given.uv_per_unit, back.uv_per_unit)] {
                    assert!((given / back).log2().abs() < 0.26, "{given} {back}");
                }
            }
        }
        assert_eq!(back.encode().unwrap().len(), bytes.len());
        assert_eq!(back.regions[0].patches[1].cell_count(), 124);
    }

    #[test]
    fn forged_regions_are_refused() {
        let bytes = regions().encode().unwrap();
        for length in 0..bytes.len() {
            assert!(TextureRegions::decode(&bytes[..length]).is_err(), "{length} bytes");
        }
        for at in 0..bytes.len() {
            for value in [0, 1, 127, 250, 251, 252, 255] {
                let mut forged = bytes.clone();
                forged[at] = value;
                // Any error will do, and no panic.
                let _ = TextureRegions::decode(&forged);
            }
        }
        let bad = |change: fn(&mut TextureRegions)| {
            let mut regions = regions();
            change(&mut regions);
            assert!(regions.encode().is_err());
        };
        bad(|r| r.size = f32::NAN);
        bad(|r| r.low[1] = f32::INFINITY);
        bad(|r| r.regions[0].patches[0].cells = vec![3..5, 5..7]);
        bad(|r| r.regions[0].patches[0].cells = vec![7..8, 2..3]);
        bad(|r| r.regions[0].patches[0].cells.clear());
        bad(|r| r.regions = vec![region([1.0; 3]); MAX_TEXTURE_REGIONS + 1]);
    }
}
