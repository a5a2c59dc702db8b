//! A terrain placed in the world: heights of its tiles, and the tiles that a view draws.

use std::sync::Arc;

use crate::{HeightOverrides, Mode, Scratch, Shape, Terrain, TerrainError};
use glam::{DQuat, DVec2, DVec3};

use super::ranges::LodRanges;
use super::regions::{MAX_REGIONS, Region, RegionRanges, merged_regions};
use super::select::{Eye, SelectedTile, select};
use super::tile::{CELL_SAMPLES, TILE_CELLS, TILE_MARGIN, TILE_SAMPLES, TileId};

/// Points to each side of the eye that are searched for the highest ground, per spacing.
const CLEARANCE_POINTS: i64 = 2;
/// Factor by which the screen error is raised while a view needs too many tiles.
pub const COARSER: f64 = 1.25;
/// Screen error allowed out of view, as a multiple of that in view.
pub const OUT_OF_VIEW: f64 = 4.0;
/// Most regions around patches with height overrides; the rest are for stamps.
const MAX_OVERRIDDEN: usize = 8;

/// A terrain with its scale in the world, and the errors of drawing it with each spacing.
#[derive(Clone, Debug)]
pub struct PlacedTerrain {
    terrain: Arc<Terrain>,
    /// World units per grid unit and per height unit.
    unit: f64,
    height_unit: f64,
    /// Error of drawing with spacing 2^s instead of 1, in grid units; holds for nearly every point of terrain without
    /// features.
    errors: Vec<f64>,
    /// Regions that stamps make rougher.
    stamped: Vec<Region>,
    /// Rectangles with height overrides (corners), and the errors there.
    overridden: Vec<([DVec2; 2], Vec<f64>)>,
    /// `stamped` and those around `overridden`.
    regions: Vec<Region>,
    /// Lowest and highest possible height, world units, before vertical exaggeration.
    bounds: [f64; 2],
    /// Vertical exaggeration.
    factor: f64,
    roots: [TileId; 4],
}

impl PlacedTerrain {
    /// Places a terrain with `unit` world units per grid unit and `height_unit` world units per height unit, and
    /// computes its errors.
    #[must_use]
    pub fn new(terrain: Arc<Terrain>, unit: f64, height_unit: f64) -> Self {
        let parameters = terrain.parameters();
        let across = parameters.finest_level + parameters.extent_log2;
        // A world smaller than a tile is one tile: beyond the world's edge, the edge's heights continue.
        let spacing = across.saturating_sub(TILE_CELLS.ilog2() as u8);
        let root = |x, y| TileId { spacing, x, y };
        let [low, high] = bounds(&terrain);
        // A spacing wider than a patch may miss anything: its error is the whole range of heights.
        let by_spacing = |levels: &[u32]| -> Vec<f64> {
            let coarsest = vec![high - low; usize::from(spacing)];
            let errors = levels.iter().rev().map(|&error| f64::from(error)).chain(coarsest);
            errors.take(usize::from(spacing) + 1).map(|error| error * height_unit / unit).collect()
        };
        let errors = by_spacing(&terrain.level_errors());
        let rough = terrain.rough_places();
        let stamped = rough.iter().map(|place| Region::new(place, by_spacing(&place.errors))).collect();
        let stamped = merged_regions(stamped, &errors, MAX_REGIONS - MAX_OVERRIDDEN);
        Self {
            bounds: [low, high].map(|h| h * height_unit),
            factor: 1.0,
            terrain,
            unit,
            height_unit,
            errors,
            regions: stamped.clone(),
            stamped,
            overridden: Vec::new(),
            roots: [root(-1, -1), root(0, -1), root(-1, 0), root(0, 0)],
        }
    }

    /// Sets the vertical exaggeration, above 0. Errors grow in proportion, so views draw finer tiles of higher terrain.
    pub fn set_vertical_exaggeration(&mut self, factor: f64) {
        self.factor = factor;
    }

    /// Lowest and highest possible height, world units.
    fn bounds(&self) -> [f64; 2] {
        self.bounds.map(|height| height * self.factor)
    }

    /// Height at a place, world units; beyond the world's edge, the edge's height.
    #[must_use]
    pub fn height(&self, x: f64, z: f64, scratch: &mut Scratch) -> f64 {
        self.terrain.height_between(x / self.unit, z / self.unit, scratch) * self.height_unit * self.factor
    }

    /// Replaces a patch's height overrides and measures its errors. Returns the square (origin and side, grid units)
    /// whose heights may have changed.
    ///
    /// # Errors
    /// If there is no such patch, or an override lies outside it.
    pub fn set_points(
        &mut self,
        x: i64,
        y: i64,
        points: HeightOverrides,
        scratch: &mut Scratch,
    ) -> Result<([i64; 2], i64), TerrainError> {
        let terrain = Arc::make_mut(&mut self.terrain);
        terrain.set_points(x, y, points)?;
        let parameters = terrain.parameters();
        let n = parameters.finest_level;
        let erosion = &parameters.erosion;
        let reach = if erosion.is_on() { erosion.reach(n) } else { 0 };
        let own = terrain.patch_errors(x, y, scratch)?;
        let [low, high] = bounds(terrain).map(|h| h * self.height_unit);
        self.bounds = [self.bounds[0].min(low), self.bounds[1].max(high)];
        let (origin, side) = ([(x << n) - reach, (y << n) - reach], (1 << n) + 2 * reach);
        let levels = own.iter().rev().map(|&error| f64::from(error) * self.height_unit);
        let errors = levels.chain(std::iter::repeat(high - low)).map(|error| error / self.unit);
        let errors = errors.take(self.errors.len()).collect();
        let corner = DVec2::new(origin[0] as f64, origin[1] as f64);
        self.add_overridden([corner, corner + DVec2::splat(side as f64)], errors);
        Ok((origin, side))
    }

    /// Adds a rectangle with height overrides; past the limit it is merged into the rectangle that grows least.
    fn add_overridden(&mut self, [low, high]: [DVec2; 2], errors: Vec<f64>) {
        let union = |[a, b]: [DVec2; 2]| [a.min(low), b.max(high)];
        let area = |[a, b]: [DVec2; 2]| (b - a).x * (b - a).y;
        let growth = |at: &[DVec2; 2]| area(union(*at)) - area(*at);
        let nearest = (0..self.overridden.len())
            .min_by(|&i, &j| growth(&self.overridden[i].0).total_cmp(&growth(&self.overridden[j].0)));
        match nearest {
            Some(i) if self.overridden.len() >= MAX_OVERRIDDEN || growth(&self.overridden[i].0) <= 0.0 => {
                let (at, joined) = &mut self.overridden[i];
                *at = union(*at);
                for (joined, error) in joined.iter_mut().zip(errors) {
                    *joined = joined.max(error);
                }
            }
            _ => self.overridden.push(([low, high], errors)),
        }
        let around =
            |([low, high], errors): &([DVec2; 2], Vec<f64>)| Region::around(*low, *high, errors.clone());
        self.regions.clone_from(&self.stamped);
        self.regions.extend(merged_regions(
            self.overridden.iter().map(around).collect(),
            &self.errors,
            MAX_OVERRIDDEN,
        ));
    }

    /// Error of drawing with a spacing, valid within `reach` of a place, in grid units.
    fn error_near(&self, spacing: usize, at: DVec2, reach: f64) -> f64 {
        let near = self.regions.iter().filter(|region| region.distance(0, at) <= reach);
        near.map(|region| region.errors[spacing]).fold(self.errors[spacing], f64::max)
    }

    /// The four tiles that cover the world: the quadtree's roots.
    #[must_use]
    pub fn roots(&self) -> [TileId; 4] {
        self.roots
    }

    /// The terrain.
    #[must_use]
    pub fn terrain(&self) -> &Arc<Terrain> {
        &self.terrain
    }

    /// Writes a tile's heights with its margin into `out`, in rows of [`TILE_SAMPLES`]. Beyond the world's edge, the
    /// edge's heights continue; between points of the finest level, heights are interpolated on its triangles. Cost:
    /// about 700 generated points.
    pub fn heights(&self, tile: TileId, scratch: &mut Scratch, out: &mut Vec<i32>) {
        let margin = i64::from(TILE_MARGIN);
        let side = i64::from(TILE_SAMPLES);
        let first = |cells: u32| [tile.x, tile.y].map(|x| i64::from(x) * i64::from(cells));
        if let Some(finer) = tile.spacing.checked_sub(1) {
            let first = first(TILE_CELLS * CELL_SAMPLES).map(|x| x - margin);
            return self.points(finer, first, side, scratch, out);
        }
        let mut points = Vec::new();
        let across = side / i64::from(CELL_SAMPLES) + 1;
        let first = first(TILE_CELLS).map(|x| x - margin / i64::from(CELL_SAMPLES));
        self.points(0, first, across, scratch, &mut points);
        out.clear();
        out.extend((0..side * side).map(|i| {
            let (x, y) = (i % side, i / side);
            let at = |x: i64, y: i64| points[(y * across + x) as usize];
            i32::midpoint(at(x / 2, y / 2), at((x + 1) / 2, (y + 1) / 2))
        }));
    }

    /// Generates a square of `side`² points of a spacing, starting at point `first`, clamped to the world.
    fn points(&self, spacing: u8, first: [i64; 2], side: i64, scratch: &mut Scratch, out: &mut Vec<i32>) {
        out.clear();
        let level = self.terrain.finest_level() - spacing as i8;
        let Ok(edge) = self.terrain.edge(level) else { return out.resize((side * side) as usize, 0) };
        let clamp = |x: i64| x.clamp(-edge, edge);
        let [x, y] = first.map(clamp);
        let [x_end, y_end] = first.map(|x| clamp(x + side - 1));
        let (width, height) = ((x_end - x + 1) as usize, (y_end - y + 1) as usize);
        if self.terrain.window(level, x, y, width, height, scratch, out).is_err() {
            // Unreachable: the window was clamped to the world above.
            out.clear();
            return out.resize((side * side) as usize, 0);
        }
        if (width as i64, height as i64) != (side, side) {
            let inside = std::mem::take(out);
            for row in 0..side {
                let from = (clamp(first[1] + row) - y) as usize * width;
                out.extend((0..side).map(|c| inside[from + (clamp(first[0] + c) - x) as usize]));
            }
        }
    }

    /// Height of the eye over the highest ground around it, world units, at least 0.
    ///
    /// The distance of any point of the terrain, taken as the hypotenuse of its distance in the plane and this height,
    /// is overestimated by at most an eighth. Examines a few points of each spacing around the eye.
    #[must_use]
    pub fn clearance(&self, eye: DVec3, scratch: &mut Scratch) -> f64 {
        let mut best = (eye.y - self.bounds()[1]).max(0.0);
        let at = [eye.x / self.unit, eye.z / self.unit];
        let mut heights = Vec::new();
        for spacing in 0..self.errors.len() as u8 {
            let step = (1_i64 << spacing) as f64;
            let first = at.map(|x| (x / step).clamp(-1e12, 1e12).floor() as i64 - CLEARANCE_POINTS);
            let side = 2 * CLEARANCE_POINTS + 2;
            self.points(spacing, first, side, scratch, &mut heights);
            let highest =
                heights.iter().copied().max().map_or(0.0, f64::from) * self.height_unit * self.factor;
            let searched = 2.0 * CLEARANCE_POINTS as f64 * step;
            let error = self.error_near(usize::from(spacing), DVec2::from(at), searched);
            let over = eye.y - (highest + error * self.unit * self.factor);
            // Terrain farther away than twice the clearance may be higher: 1 / sqrt(1 + 1/4) is 0.89.
            let reach = CLEARANCE_POINTS as f64 * step * self.unit / 2.0;
            best = best.max(over.min(reach));
        }
        best
    }

    /// Selects the tiles that a view draws for a screen error of `target_px`, with the distances over which points of
    /// each spacing morph. While that takes more than `max_tiles`, the screen error is raised by [`COARSER`]; the
    /// result says which was reached.
    #[must_use]
    pub fn tiles(&self, view: &TerrainView, target_px: f64, max_tiles: usize) -> Tiles {
        let sees = |tile: TileId| self.sees(view, tile);
        let eye = Eye { at: [view.eye.x / self.unit, view.eye.z / self.unit], above: view.above / self.unit };
        let mut px = target_px;
        loop {
            let ranges = RegionRanges::new(&self.errors, &self.regions, view.scale_px * self.factor, px);
            let end = |tile| ranges.end(tile);
            if let Some(selected) = select(&self.roots, &end, eye, max_tiles.max(64), &sees) {
                return Tiles { selected, ranges, target_px: px, unit: self.unit };
            }
            px *= COARSER;
            if px > 1e12 {
                // Unreachable: the coarsest selection is a handful of tiles per spacing.
                return Tiles { selected: Vec::new(), ranges, target_px: px, unit: self.unit };
            }
        }
    }

    /// Selects tiles outside a view, such as shadow casters, whose bounding box satisfies `matters` (lowest and highest
    /// corner, world units). Their screen error is [`OUT_OF_VIEW`] times `target_px`, the error for which
    /// [`PlacedTerrain::tiles`] was called with the same view; more where that takes more than `max_tiles`.
    #[must_use]
    pub fn tiles_out_of_view(
        &self,
        view: &TerrainView,
        target_px: f64,
        max_tiles: usize,
        matters: &dyn Fn([DVec3; 2]) -> bool,
    ) -> Tiles {
        let eye = Eye { at: [view.eye.x / self.unit, view.eye.z / self.unit], above: view.above / self.unit };
        let scale_px = view.scale_px * self.factor;
        let ranges = |px| RegionRanges::new(&self.errors, &self.regions, scale_px, px);
        let in_view = ranges(target_px);
        let mut px = target_px * OUT_OF_VIEW;
        loop {
            let ranges = ranges(px);
            // Tiles in view are divided as they are drawn, and then left out.
            let end = |tile| if self.sees(view, tile) { in_view.end(tile) } else { ranges.end(tile) };
            // Tiles in view that do not matter are visited in vain; the view's own selection bounds their number.
            let selected =
                select(&self.roots, &end, eye, usize::MAX, &|tile| matters(self.bounding_box(tile)));
            let out_of_view = |mut part: SelectedTile| {
                let in_view = |quadrant: u8| {
                    let divided = part.tile.spacing > 0;
                    self.sees(view, if divided { part.tile.child(quadrant) } else { part.tile })
                };
                part.quadrants &= !(0..4).filter(|q| in_view(*q)).fold(0, |bits, q| bits | 1 << q);
                (part.quadrants != 0).then_some(part)
            };
            let selected: Vec<SelectedTile> =
                selected.into_iter().flatten().filter_map(out_of_view).collect();
            if selected.len() <= max_tiles || px > 1e12 {
                return Tiles { selected, ranges, target_px: px, unit: self.unit };
            }
            px *= COARSER;
        }
    }

    /// Bounding box of a tile over all possible heights: lowest and highest corner, world units.
    fn bounding_box(&self, tile: TileId) -> [DVec3; 2] {
        let [x, z] = tile.origin().map(|x| x as f64 * self.unit);
        let side = tile.side() as f64 * self.unit;
        let [low, high] = self.bounds();
        [DVec3::new(x, low, z), DVec3::new(x + side, high, z + side)]
    }

    /// Whether a tile's bounding box reaches into the view frustum.
    fn sees(&self, view: &TerrainView, tile: TileId) -> bool {
        let [low, high] = self.bounding_box(tile).map(|corner| corner - view.eye);
        view.planes.iter().all(|n| {
            let corner = DVec3::select(n.cmpge(DVec3::ZERO), high, low);
            n.dot(corner) >= 0.0
        })
    }
}

/// Lowest and highest possible height, in height units, features included.
fn bounds(terrain: &Terrain) -> [f64; 2] {
    let parameters = terrain.parameters();
    let most = parameters.worst_height() as f64;
    let (mut low, mut high) = (-most, most);
    let mut reach = |mode: Mode, from: f64, to: f64| match mode {
        Mode::Additive => {
            low += from.min(0.0);
            high += to.max(0.0);
        }
        Mode::Fixed => {
            low = low.min(from);
            high = high.max(to);
        }
    };
    for stamp in terrain.stamps() {
        let (from, to) = match stamp.shape {
            Shape::Ridge { height, .. } | Shape::Plateau { height, .. } => (height, height),
            Shape::Valley { depth, .. } | Shape::RiverBed { depth, .. } => (-depth, -depth),
            Shape::Crater { depth, rim, .. } => ((-depth).min(rim), rim.max(-depth)),
        };
        let base = f64::from(parameters.base) * f64::from(stamp.mode == Mode::Fixed);
        reach(stamp.mode, base + f64::from(from), base + f64::from(to));
    }
    // Changes at points do not add up: their neighbours take averages of them.
    let [mut least, mut greatest] = [0.0_f64; 2];
    for (x, y) in terrain.patches_with_points() {
        for point in terrain.points(x, y).map_or(&[][..], |points| points.as_slice()) {
            let height = f64::from(point.height);
            match point.mode {
                Mode::Additive => [least, greatest] = [least.min(height), greatest.max(height)],
                // The change that a fixed height makes spreads to its neighbours, on top of theirs.
                Mode::Fixed => {
                    [least, greatest] = [least.min(height - most), greatest.max(height + most)];
                }
            }
        }
    }
    [low + least, high + greatest]
}

/// A view as tile selection needs it: eye, magnification and frustum planes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TerrainView {
    eye: DVec3,
    /// Height over the highest ground around, world units ([`PlacedTerrain::clearance`]).
    pub above: f64,
    /// Most pixels that a length of 1 at distance 1 covers anywhere in the picture.
    scale_px: f64,
    /// Inward normals of the frustum's planes, which all pass through the eye.
    planes: [DVec3; 5],
}

impl TerrainView {
    /// The view over `terrain` from `eye`. `rotation` turns view space (looking along −z, y up) into the world;
    /// `tan_half_fov` are the tangents of half the horizontal and vertical field of view.
    #[must_use]
    pub fn new(
        terrain: &PlacedTerrain,
        eye: DVec3,
        rotation: DQuat,
        tan_half_fov: (f64, f64),
        height_px: u32,
        scratch: &mut Scratch,
    ) -> Self {
        let (tx, ty) = tan_half_fov;
        let plane = |x: f64, y: f64, t: f64| rotation * DVec3::new(x, y, -t);
        // A length across the view at depth z covers scale / z pixels; depth is distance times the cosine of the angle
        // to the axis, which is least in the corners. An eighth more: see `clearance`.
        let corner = (1.0 + tx * tx + ty * ty).sqrt();
        Self {
            eye,
            above: terrain.clearance(eye, scratch),
            scale_px: 1.125 * corner * f64::from(height_px) / (2.0 * ty),
            planes: [
                plane(1.0, 0.0, tx),
                plane(-1.0, 0.0, tx),
                plane(0.0, 1.0, ty),
                plane(0.0, -1.0, ty),
                rotation * DVec3::NEG_Z,
            ],
        }
    }
}

/// The tiles selected for a view.
#[derive(Clone, Debug)]
pub struct Tiles {
    /// Tiles and their quadrants, finest first.
    pub selected: Vec<SelectedTile>,
    /// Screen error that the selection reaches, in pixels.
    pub target_px: f64,
    /// In grid units.
    ranges: RegionRanges,
    unit: f64,
}

impl Tiles {
    /// Distances at which the morph of a tile's points begins and ends away from rough regions, world units.
    #[must_use]
    pub fn morph(&self, tile: TileId) -> [f64; 2] {
        self.ranges.plain(tile.spacing).map(|d| d * self.unit)
    }

    /// Bit mask of the [`Self::regions`] that may affect points of a tile.
    #[must_use]
    pub fn mask(&self, tile: TileId) -> u32 {
        self.ranges.mask(tile)
    }

    /// The rough regions, in world units.
    #[must_use]
    pub fn regions(&self) -> Vec<TileRegion> {
        let world = |(region, ranges): (&Region, &LodRanges)| TileRegion {
            from: region.from * self.unit,
            to: region.to * self.unit,
            radius: region.radius * self.unit,
            morph: (0..ranges.len() as u8).map(|s| ranges.morph(s).map(|d| d * self.unit)).collect(),
        };
        self.ranges.regions().map(world).collect()
    }
}

/// A rough region and the morph distances that it has in a view, in world units.
#[derive(Clone, Debug, PartialEq)]
pub struct TileRegion {
    /// One end of its segment.
    pub from: DVec2,
    /// The other.
    pub to: DVec2,
    /// Radius around it.
    pub radius: f64,
    /// By spacing: distances at which the morph begins and ends for points inside and within [`region_margin`]. They
    /// shrink by [`FALLOFF`] for each unit farther away.
    ///
    /// [`FALLOFF`]: super::FALLOFF
    /// [`region_margin`]: super::region_margin
    pub morph: Vec<[f64; 2]>,
}
