//! Measures where a mesh is in its textures: densities, and the regions that decide which tiles a view shows.
//!
//! Faces that cover more than a cell are split first, so that a wall of two triangles has regions too. The pieces are
//! divided by place as a k-d tree divides points, at the median of the longest axis.

use std::collections::BTreeMap;
use std::ops::Range;

use glam::{DVec3, Vec2, Vec3};
use lodestream_geometry::index::Sphere;
use lodestream_geometry::mesh::{Corner, NONE, SourceMesh};
use lodestream_scene::asset::{
    AssetDescription, Material, TILE_SIDE, TexturePatch, TextureRegion, TextureRegions, Wrap, cells_of,
    tile_grid,
};

/// Most regions: with 512 those of a scan of 216 charts take 12 kB.
const MAX_REGIONS: usize = 512;
/// Fewest pieces of a region, if there are as many.
const MIN_PIECES: usize = 32;
/// Most times that a face is split, each time into four.
const MAX_SPLITS: u32 = 6;
/// Most pieces, unless there are more faces.
const MAX_PIECES: usize = 1 << 18;

/// Sets the densities of all textures, and gives the regions if a texture has tiles. `origin` is that of the asset.
pub(crate) fn measure(
    mesh: &SourceMesh,
    description: &mut AssetDescription,
    origin: [f64; 3],
) -> Option<TextureRegions> {
    set_densities(mesh, description);
    let cells = Cells::new(description);
    if !cells.any() {
        return None;
    }
    let pieces = pieces(mesh, &cells, DVec3::from(origin));
    let regions = regions(pieces, &cells);
    (!regions.regions.is_empty()).then_some(regions)
}

/// The sets of texture coordinates.
const SETS: [UvSet; 2] = [UvSet::First, UvSet::Second];

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum UvSet {
    First,
    Second,
}

/// Area of the surface and in texture coordinates of each set, by material.
fn set_densities(mesh: &SourceMesh, description: &mut AssetDescription) {
    let mut areas = vec![[[0.0_f64; 2]; 2]; description.materials.len().max(1)];
    for (face, material) in (0..mesh.faces.len()).zip(&mesh.materials) {
        let Some(areas) = areas.get_mut(usize::from(*material)) else { continue };
        for (area, set) in areas.iter_mut().zip(SETS) {
            if let Some((places, uvs)) = corners(mesh, face, set) {
                area[0] += (places[1] - places[0]).cross(places[2] - places[0]).length();
                area[1] += f64::from((uvs[1] - uvs[0]).perp_dot(uvs[2] - uvs[0]).abs());
            }
        }
    }
    let mut of_texture = vec![[0.0_f64; 2]; description.textures.len()];
    for (material, [first, second]) in description.materials.iter().zip(&areas) {
        let mut textures: Vec<u16> = material.textures().collect();
        textures.sort_unstable();
        textures.dedup();
        for texture in textures {
            let area = if material.second_textures().any(|of| of == texture) { second } else { first };
            (0..2).for_each(|i| of_texture[usize::from(texture)][i] += area[i]);
        }
    }
    for (info, [surface, uv]) in description.textures.iter_mut().zip(of_texture) {
        let density = (uv / surface.max(f64::MIN_POSITIVE)).sqrt() as f32;
        info.uv_per_unit = if density.is_finite() { density } else { 0.0 };
    }
}

/// Places and texture coordinates of a face's corners; `None` without texture coordinates of the set.
fn corners(mesh: &SourceMesh, face: usize, set: UvSet) -> Option<([DVec3; 3], [Vec2; 3])> {
    let corners = mesh.faces[face];
    let (all, of): (_, fn(&Corner) -> u32) = match set {
        UvSet::First => (&mesh.uvs, |corner| corner.uv),
        UvSet::Second => (&mesh.second_uvs, |corner| corner.second_uv),
    };
    if corners.iter().any(|corner| of(corner) == NONE) {
        return None;
    }
    let places = corners.map(|corner| DVec3::from(mesh.positions[corner.position as usize]));
    Some((places, corners.map(|corner| Vec2::from(all[of(&corner) as usize]))))
}

/// The cells of each material.
struct Cells {
    of_material: Vec<OfMaterial>,
}

#[derive(Clone, Copy)]
struct OfMaterial {
    /// Size of the level whose tiles they are, in texels.
    size: [u32; 2],
    wrap: [Wrap; 2],
    /// Whether a texture has tiles.
    is_tiled: bool,
    /// Whether textures use each set of texture coordinates.
    uses: [bool; 2],
}

impl Cells {
    fn new(description: &AssetDescription) -> Self {
        let of = |(number, material): (u16, &Material)| {
            let size = cells_of(description, number);
            let second = material.second_textures().count();
            let uses = [material.textures().count() > second, second > 0];
            OfMaterial { size, wrap: material.wrap, is_tiled: size != [1, 1], uses }
        };
        Self { of_material: (0..).zip(&description.materials).map(of).collect() }
    }

    fn any(&self) -> bool {
        self.of_material.iter().any(|of| of.is_tiled)
    }

    fn of(&self, material: u16) -> Option<&OfMaterial> {
        self.of_material.get(usize::from(material)).filter(|of| of.is_tiled)
    }
}

impl OfMaterial {
    /// Texture coordinates of a cell's sides.
    fn cell(&self) -> Vec2 {
        Vec2::from(self.size.map(|side| TILE_SIDE as f32 / side as f32))
    }

    /// Calls `mark` for each cell that a triangle's bounds cover. Coordinates run up, rows of texels down.
    fn cover(&self, uvs: &[Vec2; 3], mut mark: impl FnMut(u16)) {
        let low = uvs[0].min(uvs[1]).min(uvs[2]);
        let high = uvs[0].max(uvs[1]).max(uvs[2]);
        let [columns, rows] = tile_grid(self.size);
        let across = covered(low.x, high.x, self.wrap[0], self.size[0]);
        let down = covered(1.0 - high.y, 1.0 - low.y, self.wrap[1], self.size[1]);
        for row in down.iter().cloned().flatten().filter(|row| *row < rows) {
            for column in across.iter().cloned().flatten().filter(|column| *column < columns) {
                mark((row * columns + column) as u16);
            }
        }
    }
}

/// The cells along an axis that coordinates from `low` to `high` cover after wrapping, in one run or two.
fn covered(low: f32, high: f32, wrap: Wrap, texels: u32) -> [Range<u32>; 2] {
    let cells = texels.div_ceil(TILE_SIDE);
    let at = |x: f32| x.clamp(0.0, 1.0) * texels as f32 / TILE_SIDE as f32;
    // What ends at a cell's side does not cover the next one.
    let run = |first: f32, last: f32| {
        let first = (at(first) as u32).min(cells - 1);
        first..(at(last).ceil() as u32).clamp(first + 1, cells)
    };
    if wrap == Wrap::Clamp {
        return [run(low, high), 0..0];
    }
    let span = high - low;
    if span.is_nan() || span >= 1.0 {
        return [0..cells, 0..0];
    }
    let (turn, last_turn) = (low.floor(), (high.ceil() - 1.0).max(low.floor()));
    let (a, b) = (low - turn, high - last_turn);
    let is_odd = turn.rem_euclid(2.0) >= 1.0;
    match (wrap, turn == last_turn) {
        (Wrap::Repeat, true) => [run(a, b), 0..0],
        (Wrap::Repeat, false) => [run(a, 1.0), run(0.0, b)],
        (_, true) if is_odd => [run(1.0 - b, 1.0 - a), 0..0],
        (_, true) => [run(a, b), 0..0],
        // Across a mirror: from an even turn at the far edge, from an odd one at the near edge.
        (_, false) if is_odd => [run(0.0, (1.0 - a).max(b)), 0..0],
        (_, false) => [run(a.min(1.0 - b), 1.0), 0..0],
    }
}

/// A triangle, or a part of one.
#[derive(Clone, Copy)]
struct Piece {
    /// Relative to the asset's origin.
    places: [Vec3; 3],
    uvs: [Vec2; 3],
    set: UvSet,
    material: u16,
}

impl Piece {
    fn middle(&self) -> Vec3 {
        (self.places[0] + self.places[1] + self.places[2]) / 3.0
    }

    /// How often it must be halved to cover about a cell.
    fn splits(&self, cell: Vec2) -> u32 {
        let low = self.uvs[0].min(self.uvs[1]).min(self.uvs[2]);
        let high = self.uvs[0].max(self.uvs[1]).max(self.uvs[2]);
        let mut span = ((high - low) / cell).max_element();
        let mut splits = 0;
        while span > 1.0 && splits < MAX_SPLITS {
            span /= 2.0;
            splits += 1;
        }
        splits
    }

    /// Adds the piece, split into four so many times.
    fn add(self, splits: u32, out: &mut Vec<Self>) {
        if splits == 0 {
            return out.push(self);
        }
        let [a, b, c] = [0, 1, 2];
        let place = |i: usize, j: usize| (self.places[i] + self.places[j]) / 2.0;
        let uv = |i: usize, j: usize| (self.uvs[i] + self.uvs[j]) / 2.0;
        for [[i, j], [k, l], [m, n]] in [
            [[a, a], [a, b], [a, c]],
            [[a, b], [b, b], [b, c]],
            [[a, c], [b, c], [c, c]],
            [[a, b], [b, c], [a, c]],
        ] {
            let places = [place(i, j), place(k, l), place(m, n)];
            let uvs = [uv(i, j), uv(k, l), uv(m, n)];
            Self { places, uvs, ..self }.add(splits - 1, out);
        }
    }
}

fn pieces(mesh: &SourceMesh, cells: &Cells, origin: DVec3) -> Vec<Piece> {
    let piece = &|face: usize, material: u16, set: UvSet| {
        let of = cells.of(material).filter(|of| of.uses[set as usize])?;
        let (places, uvs) = corners(mesh, face, set)?;
        Some((
            Piece { places: places.map(|place| (place - origin).as_vec3()), uvs, set, material },
            of.cell(),
        ))
    };
    let faces = || {
        let faces = (0..mesh.faces.len()).zip(&mesh.materials);
        faces.flat_map(move |(face, &material)| {
            SETS.into_iter().filter_map(move |set| piece(face, material, set))
        })
    };
    let count =
        |most: u32| faces().map(|(piece, cell)| 1_usize << (2 * piece.splits(cell).min(most))).sum::<usize>();
    let room = MAX_PIECES.max(mesh.faces.len());
    let most = (0..=MAX_SPLITS).rev().find(|&most| most == 0 || count(most) <= room).unwrap_or(0);
    let mut out = Vec::new();
    for (piece, cell) in faces() {
        piece.add(piece.splits(cell).min(most), &mut out);
    }
    out
}

fn regions(mut pieces: Vec<Piece>, cells: &Cells) -> TextureRegions {
    let most = (pieces.len() / MAX_REGIONS).max(MIN_PIECES);
    let mut regions = Vec::new();
    divide(&mut pieces, most, &mut |of| regions.extend(region(of, cells)));
    let centers = || regions.iter().map(|region: &TextureRegion| Vec3::from(region.sphere.center));
    let low = centers().reduce(Vec3::min).unwrap_or_default();
    let high = centers().reduce(Vec3::max).unwrap_or_default();
    // A single region's box has no size, and lengths are coded by it.
    let radius = regions.iter().map(|region| region.sphere.radius).fold(0.0, f32::max);
    TextureRegions { low: low.into(), size: (high - low).max_element().max(radius), regions }
}

/// Divides pieces until there are at most so many.
fn divide(pieces: &mut [Piece], most: usize, out: &mut impl FnMut(&[Piece])) {
    if pieces.len() <= most {
        return out(pieces);
    }
    let low = pieces.iter().map(Piece::middle).fold(Vec3::INFINITY, Vec3::min);
    let high = pieces.iter().map(Piece::middle).fold(Vec3::NEG_INFINITY, Vec3::max);
    let side = high - low;
    let axis = (0..3).fold(0, |best, axis| if side[axis] > side[best] { axis } else { best });
    let middle = pieces.len() / 2;
    pieces.select_nth_unstable_by(middle, |a, b| a.middle()[axis].total_cmp(&b.middle()[axis]));
    let (first, second) = pieces.split_at_mut(middle);
    divide(first, most, out);
    divide(second, most, out);
}

fn region(pieces: &[Piece], cells: &Cells) -> Option<TextureRegion> {
    let places = || pieces.iter().flat_map(|piece| piece.places);
    let low = places().reduce(Vec3::min)?;
    let high = places().reduce(Vec3::max)?;
    let center = (low + high) / 2.0;
    let radius = places().map(|place| place.distance(center)).fold(0.0, f32::max);
    // Areas of the surface and in texture coordinates, by set, and the cells of both.
    let mut of_material: BTreeMap<u16, ([[f64; 2]; 2], Vec<bool>)> = BTreeMap::new();
    for piece in pieces {
        let of = cells.of(piece.material)?;
        let (areas, covered) = of_material.entry(piece.material).or_insert_with(|| {
            ([[0.0; 2]; 2], vec![false; tile_grid(of.size).iter().product::<u32>() as usize])
        });
        let [a, b, c] = piece.places;
        let [s, t, u] = piece.uvs;
        let area = &mut areas[piece.set as usize];
        area[0] += f64::from((b - a).cross(c - a).length()) / 2.0;
        area[1] += f64::from((t - s).perp_dot(u - s).abs()) / 2.0;
        of.cover(&piece.uvs, |cell| covered[usize::from(cell)] = true);
    }
    let patches = of_material.into_iter().filter_map(|(material, (areas, covered))| {
        let area = areas[0][0].max(areas[1][0]);
        let densities = areas.into_iter().filter(|[area, _]| *area > 0.0).map(|[area, uv]| uv / area);
        // Of two sets the less dense, so that no map is blurred.
        let density = densities.min_by(f64::total_cmp)?;
        let (area, uv_per_unit) = (area as f32, density.sqrt() as f32);
        Some(TexturePatch { material, area, uv_per_unit, cells: runs(&covered) })
    });
    let patches: Vec<TexturePatch> = patches.filter(|patch| !patch.cells.is_empty()).collect();
    let sphere = Sphere { center: center.into(), radius };
    (!patches.is_empty() && radius.is_finite()).then_some(TextureRegion { sphere, patches })
}

/// The runs of set flags.
fn runs(flags: &[bool]) -> Vec<Range<u16>> {
    let mut runs: Vec<Range<u16>> = Vec::new();
    for (at, _) in (0_u16..).zip(flags).filter(|(_, flag)| **flag) {
        match runs.last_mut() {
            Some(run) if run.end == at => run.end = at + 1,
            _ => runs.push(at..at + 1),
        }
    }
    runs
}

#[cfg(test)]
mod tests {
    use lodestream_geometry::mesh::Corner;
    use lodestream_scene::asset::{TextureFormat, TextureInfo, TextureKind, TextureLevel, level_size};

    use super::*;

    /// A description with one material and a texture of 4096 × 2048 texels.
    fn description(wrap: Wrap) -> AssetDescription {
        let size = [4096, 2048];
        let level = |level| {
            let [width, height] = level_size(size, 10, level);
            TextureLevel { width, height, bytes: 100, format: TextureFormat::WebP }
        };
        let texture = TextureInfo {
            kind: TextureKind::Color,
            width: size[0],
            height: size[1],
            planes: 0,
            mean: None,
            uv_per_unit: 0.0,
            levels: (0..10).map(level).collect(),
        };
        let material = Material { base_color_texture: Some(0), wrap: [wrap; 2], ..Material::default() };
        AssetDescription { materials: vec![material], textures: vec![texture], ..AssetDescription::default() }
    }

    /// A square of 10 units with texture coordinates up to `uv`.
    fn square(uv: f32) -> SourceMesh {
        let corner = |i: u32| Corner { uv: i, ..Corner::at(i) };
        let at = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]];
        SourceMesh {
            positions: at.map(|[x, y]| [10.0 * x + 500.0, 10.0 * y, 3.0]).to_vec(),
            uvs: at.map(|[x, y]| [x as f32 * uv, y as f32 * uv]).to_vec(),
            faces: vec![[0, 1, 2].map(corner), [0, 2, 3].map(corner)],
            materials: vec![0, 0],
            ..SourceMesh::default()
        }
    }

    #[test]
    fn regions_of_a_square_have_the_cells_of_their_place() {
        let mut description = description(Wrap::Repeat);
        let regions = measure(&square(1.0), &mut description, [500.0, 0.0, 3.0]).unwrap();
        assert!((description.textures[0].uv_per_unit - 0.1).abs() < 1e-6);
        assert!(regions.fit(&description) && regions.encode().is_ok());
        assert!((16..=128).contains(&regions.regions.len()), "{}", regions.regions.len());
        let area: f32 = regions.regions.iter().map(|region| region.patches[0].area).sum();
        assert!((area - 100.0).abs() < 1e-3);
        let mut seen = [false; 16 * 8];
        for region in &regions.regions {
            let [x, y, z] = region.sphere.center;
            let patch = &region.patches[0];
            assert!((patch.uv_per_unit - 0.1).abs() < 1e-5 && z.abs() < 1e-5);
            for cell in patch.cells.iter().cloned().flatten() {
                seen[usize::from(cell)] = true;
                // Cells are 0.625 × 1.25 units, the first at the top left.
                let (column, row) = (f32::from(cell % 16), f32::from(cell / 16));
                let off = [x - (column + 0.5) * 0.625, y - (10.0 - (row + 0.5) * 1.25)];
                assert!(off.iter().all(|off| off.abs() < region.sphere.radius + 1.3), "{cell} {off:?}");
            }
        }
        assert!(seen.iter().all(|seen| *seen));
    }

    #[test]
    fn a_single_region_keeps_its_lengths_when_coded() {
        let mut description = description(Wrap::Repeat);
        let regions = measure(&square(0.01), &mut description, [500.0, 0.0, 3.0]).unwrap();
        assert_eq!(regions.regions.len(), 1);
        let back = TextureRegions::decode(&regions.encode().unwrap()).unwrap();
        let (given, back) = (&regions.regions[0], &back.regions[0]);
        let pairs = [
            (given.sphere.radius, back.sphere.radius),
            (given.patches[0].area, back.patches[0].area),
            (given.patches[0].uv_per_unit, back.patches[0].uv_per_unit),
        ];
        assert!(pairs.iter().all(|(given, back)| (given / back).log2().abs() < 0.26), "{pairs:?}");
    }

    #[test]
    fn repeated_textures_have_all_cells_and_their_density() {
        let mut description = description(Wrap::Repeat);
        let regions = measure(&square(300.0), &mut description, [500.0, 0.0, 3.0]).unwrap();
        assert!((description.textures[0].uv_per_unit - 30.0).abs() < 1e-3);
        assert!(regions.regions.iter().all(|region| region.patches[0].cell_count() == 128));
        assert!(regions.regions.len() >= 64, "places differ in distance");
    }

    #[test]
    fn runs_follow_the_wrap_mode() {
        let all = |low, high, wrap| {
            let mut cells: Vec<u32> = covered(low, high, wrap, 1024).into_iter().flatten().collect();
            cells.sort_unstable();
            cells.dedup();
            cells
        };
        assert_eq!(all(0.1, 0.3, Wrap::Repeat), [0, 1]);
        assert_eq!(all(-0.1, 0.1, Wrap::Repeat), [0, 3]);
        assert_eq!(all(7.9, 8.3, Wrap::Repeat), [0, 1, 3]);
        assert_eq!(all(-3.0, -2.9, Wrap::Clamp), [0]);
        assert_eq!(all(0.6, 9.0, Wrap::Clamp), [2, 3]);
        assert_eq!(all(1.0, 1.2, Wrap::Mirror), [3]);
        assert_eq!(all(0.9, 1.3, Wrap::Mirror), [2, 3]);
        assert_eq!(all(1.6, 2.1, Wrap::Mirror), [0, 1]);
        assert_eq!(all(-0.1, 0.2, Wrap::Mirror), [0]);
        assert_eq!(all(2.3, 2.4, Wrap::Mirror), [1]);
        for wrap in [Wrap::Repeat, Wrap::Mirror] {
            assert_eq!(all(0.5, 1.5, wrap), [0, 1, 2, 3]);
            assert_eq!(all(f32::NAN, 0.0, wrap), [0, 1, 2, 3]);
            assert_eq!(all(f32::NEG_INFINITY, f32::INFINITY, wrap), [0, 1, 2, 3]);
        }
    }

    #[test]
    fn degenerate_meshes_have_no_regions() {
        let mut flat = square(1.0);
        flat.positions.iter_mut().for_each(|place| *place = [1.0; 3]);
        assert!(measure(&flat, &mut description(Wrap::Repeat), [0.0; 3]).is_none());
        let mut untextured = square(1.0);
        untextured.faces.iter_mut().flatten().for_each(|corner| corner.uv = NONE);
        assert!(measure(&untextured, &mut description(Wrap::Repeat), [0.0; 3]).is_none());
    }
}
