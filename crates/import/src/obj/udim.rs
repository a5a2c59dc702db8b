//! UDIM texture sets: `name.<UDIM>.png` stands for one image per unit square of texture coordinates, of which 1001 is
//! the first and ten make a row.
//!
//! Each square that faces use becomes a material of its own, with the coordinates shifted into 0 to 1. A face belongs to
//! the square of its centroid. Edges are clamped: what continues beyond them is another image.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use lodestream_scene::asset::Wrap;

use super::mtl::Library;
use super::parse::Parsed;
use crate::model::{Channel, HeightMap, ImageSource, ImportedMaterial, MaterialMaps};

/// What file names have in the place of a tile's number.
const TOKEN: &str = "<UDIM>";
/// Squares in a row.
const COLUMNS: u16 = 10;
/// Rows; the last is not full.
const ROWS: u16 = 900;
/// Numbers of the first square and the last.
const FIRST: u16 = 1001;
const LAST: u16 = 9999;
/// Longest path of a set, and characters of a material's name that its tiles' materials keep: both are repeated for each
/// tile. No system opens longer paths.
const MAX_PATH_BYTES: usize = 4096;
const KEPT_NAME_CHARS: usize = 200;

/// A unit square of texture coordinates: column and row.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
struct Tile([u16; 2]);

impl Tile {
    /// The square about a point, if it has a number.
    fn at(point: [f64; 2]) -> Option<Self> {
        let [column, row] = point.map(f64::floor);
        let within = |x: f64, count: u16| (0.0..f64::from(count)).contains(&x).then_some(x as u16);
        Some(Self([within(column, COLUMNS)?, within(row, ROWS)?])).filter(|tile| tile.number() <= LAST)
    }

    /// The square of a face: that of the mean of its corners. Faces without coordinates show the first.
    fn of_face(parsed: &Parsed, corners: &[[u32; 3]]) -> Option<Self> {
        let mut sum = [0.0; 2];
        for [_, uv, _] in corners {
            let Some(index) = uv.checked_sub(1) else { return Some(Self([0, 0])) };
            let [u, v] = parsed.uvs[index as usize];
            sum = [sum[0] + f64::from(u), sum[1] + f64::from(v)];
        }
        Self::at(sum.map(|sum| sum / corners.len() as f64))
    }

    fn number(self) -> u16 {
        FIRST + self.0[0] + COLUMNS * self.0[1]
    }

    /// Texture coordinates within the square.
    fn shifted(self, [u, v]: [f32; 2]) -> [f32; 2] {
        [u - f32::from(self.0[0]), v - f32::from(self.0[1])]
    }
}

/// The image of a tile; `None` if the name, relative to the model's folder, has no token.
fn tile_image(folder: &Path, image: &ImageSource, tile: Tile) -> Option<ImageSource> {
    let below =
        image.path.strip_prefix(folder).ok().filter(|below| below.as_os_str().len() <= MAX_PATH_BYTES)?;
    let number = tile.number().to_string();
    let mut named = false;
    let parts = below.iter().map(|part| match part.to_str().filter(|part| part.contains(TOKEN)) {
        Some(part) => {
            named = true;
            PathBuf::from(part.replace(TOKEN, &number))
        }
        None => PathBuf::from(part),
    });
    let path: PathBuf = parts.collect();
    named.then(|| folder.join(path).into())
}

/// Whether an image stands for those of tiles.
pub(super) fn is_set(folder: &Path, image: &ImageSource) -> bool {
    tile_image(folder, image, Tile([0, 0])).is_some()
}

fn is_tiled(folder: &Path, material: &ImportedMaterial) -> bool {
    material.maps.images().any(|image| is_set(folder, image))
}

/// The faces of an OBJ file by material and, of tiled materials, by tile.
pub(super) struct Tiles<'a> {
    folder: &'a Path,
    /// For each material of the file, whether it has tiles.
    tiled: Vec<bool>,
    /// Numbers of the materials that faces get: of a material of the file, of its tile.
    numbers: BTreeMap<(usize, Option<Tile>), usize>,
    /// The keys of `numbers`, in the order of the faces.
    used: Vec<(usize, Option<Tile>)>,
    /// Faces of tiled materials outside of all tiles.
    outside: usize,
}

impl<'a> Tiles<'a> {
    /// Groups the faces of an OBJ file in `folder`.
    pub(super) fn new(folder: &'a Path, parsed: &Parsed, library: &Library) -> Self {
        let tiled = parsed.material_names.iter().map(|name| library.get(name));
        let tiled: Vec<bool> = tiled.map(|of| of.is_some_and(|of| is_tiled(folder, of))).collect();
        let mut this = Self { folder, tiled, numbers: BTreeMap::new(), used: Vec::new(), outside: 0 };
        if !this.tiled.contains(&true) {
            this.used = (0..this.tiled.len()).map(|material| (material, None)).collect();
            return this;
        }
        let mut corners: &[[u32; 3]] = &parsed.corners;
        for face in &parsed.faces {
            let (own, rest) = corners.split_at(face.corners);
            corners = rest;
            let tile = if this.tiled[face.material] { Tile::of_face(parsed, own) } else { None };
            this.outside += usize::from(this.tiled[face.material] && tile.is_none());
            let next = this.used.len();
            let key = (face.material, tile);
            if *this.numbers.entry(key).or_insert(next) == next {
                this.used.push(key);
            }
        }
        this
    }

    /// How many materials the faces get.
    pub(super) fn materials(&self) -> usize {
        self.used.len()
    }

    /// Material of a face, and its texture coordinates from those of the file.
    pub(super) fn place(
        &self,
        parsed: &Parsed,
        material: usize,
        corners: &[[u32; 3]],
    ) -> (usize, impl Fn([f32; 2]) -> [f32; 2] + use<>) {
        let tile = if self.tiled[material] { Tile::of_face(parsed, corners) } else { None };
        let number = self.numbers.get(&(material, tile)).copied().unwrap_or(material);
        (number, move |uv| tile.map_or(uv, |tile| tile.shifted(uv)))
    }

    /// The materials that faces get, from those of the file. Tiles without an image are counted in a warning.
    pub(super) fn split(
        &self,
        path: &Path,
        materials: Vec<ImportedMaterial>,
        warnings: &mut Vec<String>,
    ) -> Vec<ImportedMaterial> {
        if self.numbers.is_empty() {
            return materials;
        }
        let mut images = Images { folder: self.folder, found: BTreeMap::new() };
        let one = |&(material, tile): &(usize, Option<Tile>)| {
            let of = &materials[material];
            if self.tiled[material] { images.tile(of, tile) } else { of.clone() }
        };
        let split = self.used.iter().map(one).collect();
        let missing: Vec<&PathBuf> =
            images.found.iter().filter(|(_, found)| !**found).map(|(p, _)| p).collect();
        if let Some(first) = missing.first() {
            warnings.push(format!(
                "{}: {} of {} images of UDIM tiles are missing, without which the tiles are drawn (the first is {})",
                path.display(),
                missing.len(),
                images.found.len(),
                first.display()
            ));
        }
        if self.outside > 0 {
            warnings.push(format!(
                "{}: {} faces are outside of the UDIM tiles (u from 0 to {COLUMNS}, v from 0) and are drawn without \
                 their images",
                path.display(),
                self.outside
            ));
        }
        split
    }

    /// The images of all tiles that faces use.
    pub(super) fn images(&self, parsed: &Parsed, library: &Library) -> Vec<PathBuf> {
        let mut files = BTreeSet::new();
        for &(material, tile) in &self.used {
            let Some(tile) = tile else { continue };
            let of = library.get(&parsed.material_names[material]);
            for image in of.into_iter().flat_map(|of| of.maps.images()) {
                files.extend(tile_image(self.folder, image, tile).map(|image| image.path));
            }
        }
        files.into_iter().collect()
    }
}

/// Whether any image of a library stands for those of tiles.
pub(super) fn any_set(folder: &Path, library: &Library) -> bool {
    library.values().any(|material| is_tiled(folder, material))
}

/// The images of tiles, and whether each exists.
struct Images<'a> {
    folder: &'a Path,
    found: BTreeMap<PathBuf, bool>,
}

impl Images<'_> {
    /// The material of one tile; of none, the material without its tiled maps.
    fn tile(&mut self, of: &ImportedMaterial, tile: Option<Tile>) -> ImportedMaterial {
        let mut out = of.clone();
        out.material.name = of.material.name.chars().take(KEPT_NAME_CHARS).collect();
        if let Some(tile) = tile {
            out.material.name.push_str(&format!(".{}", tile.number()));
            out.material.wrap = [Wrap::Clamp; 2];
        }
        // MTL has no occlusion.
        let MaterialMaps { color, opacity, surface, occlusion: _, normal, emission, height } = &mut out.maps;
        let mut image = |image: ImageSource| self.image(image, tile);
        *color = color.take().and_then(&mut image);
        *normal = normal.take().and_then(&mut image);
        *emission = emission.take().and_then(&mut image);
        *height = height.take().and_then(|height| Some(HeightMap { image: image(height.image)?, ..height }));
        let mut channel = |c: Option<Channel>| c.and_then(|c| Some(Channel { image: image(c.image)?, ..c }));
        *opacity = channel(opacity.take());
        surface.roughness = channel(surface.roughness.take());
        surface.metallic = channel(surface.metallic.take());
        // As of other missing maps: grey, no metal and no emission are better guesses than what the factors alone give.
        if color.is_some() != of.maps.color.is_some() && out.material.base_color[..3] == [1.0; 3] {
            let [r, g, b, _] = ImportedMaterial::default().material.base_color;
            out.material.base_color[..3].copy_from_slice(&[r, g, b]);
        }
        if surface.metallic.is_some() != of.maps.surface.metallic.is_some() {
            out.material.metallic = 0.0;
        }
        if emission.is_some() != of.maps.emission.is_some() {
            out.material.emission = [0.0; 3];
        }
        out.alpha_from_map &= opacity.is_some();
        out
    }

    /// The image itself, or that of the tile; `None` if there is no such file.
    fn image(&mut self, image: ImageSource, tile: Option<Tile>) -> Option<ImageSource> {
        let Some(first) = tile_image(self.folder, &image, tile.unwrap_or(Tile([0, 0]))) else {
            return Some(image);
        };
        tile?;
        let found = self.found.entry(first.path.clone()).or_insert_with(|| first.path.is_file());
        found.then_some(first)
    }
}
