//! A terrain in the world: heights of tiles, and what a view needs of them.

use std::sync::Arc;

use glam::{DVec2, DVec3};
use lodestream_scene::pose::Pose;
use lodestream_scene::terrain::TerrainEntry;
use lodestream_terrain::{HeightOverrides, Mode, Scratch, Shape, Terrain, TerrainError};

use super::ranges::Ranges;
use super::regions::{MAX_REGIONS, Reaches, Region, worthwhile};
use super::select::{Eye, SelectedTile, select};
use super::tile::{CELL_SAMPLES, TILE_CELLS, TILE_MARGIN, TILE_SAMPLES, TileId};

/// Points to each side of the eye over which the highest ground is looked for, per spacing.
const CLEARANCE_POINTS: i64 = 2;
/// Factor between a screen error and the next one tried when a view needs too many tiles.
pub const COARSER: f64 = 1.25;
/// Screen error of ground out of view over that of what is seen.
pub const OUT_OF_VIEW: f64 = 4.0;
/// Regions of patches with listed points, at most; the rest are of stamps.
const MAX_LISTED: usize = 8;

/// A terrain and how it lies in the world.
#[derive(Clone, Debug)]
pub struct PlacedTerrain {
    terrain: Arc<Terrain>,
    /// World units per grid unit and per height unit.
    unit: f64,
    height_unit: f64,
    /// Error of drawing with spacing 2^s instead of 1 that holds for nearly every point of ground without features, in
    /// grid units.
    errors: Vec<f64>,
    /// Where stamps make it rougher.
    stamped: Vec<Region>,
    /// Where listed points do: corners of rectangles, and errors.
    listed: Vec<([DVec2; 2], Vec<f64>)>,
    /// All regions.
    regions: Vec<Region>,
    /// Lowest and highest height there can be, world units, before they are multiplied.
    bounds: [f64; 2],
    /// What heights are multiplied by.
    factor: f64,
    roots: [TileId; 4],
}

impl PlacedTerrain {
    /// The ground of a terrain whose units are those of `entry`.
    #[must_use]
    pub fn new(terrain: Arc<Terrain>, entry: &TerrainEntry) -> Self {
        let (unit, height_unit) = (f64::from(entry.unit), f64::from(entry.height_unit));
        let parameters = terrain.parameters();
        let across = parameters.finest_level + parameters.extent_log2;
        // A world smaller than a tile is one: what lies beyond its edge continues the edge.
        let spacing = across.saturating_sub(TILE_CELLS.ilog2() as u8);
        let root = |x, y| TileId { spacing, x, y };
        let [low, high] = bounds(&terrain);
        // Where not even each patch's corners are drawn, anything that heights can do is possible.
        let by_spacing = |levels: &[u32]| -> Vec<f64> {
            let coarsest = vec![high - low; usize::from(spacing)];
            let errors = levels.iter().rev().map(|&error| f64::from(error)).chain(coarsest);
            errors.take(usize::from(spacing) + 1).map(|error| error * height_unit / unit).collect()
        };
        let errors = by_spacing(&terrain.level_errors());
        let rough = terrain.rough_places();
        let stamped = rough.iter().map(|place| Region::new(place, by_spacing(&place.errors))).collect();
        let stamped = worthwhile(stamped, &errors, MAX_REGIONS - MAX_LISTED);
        Self {
            bounds: [low, high].map(|h| h * height_unit),
            factor: 1.0,
            terrain,
            unit,
            height_unit,
            errors,
            regions: stamped.clone(),
            stamped,
            listed: Vec::new(),
            roots: [root(-1, -1), root(0, -1), root(-1, 0), root(0, 0)],
        }
    }

    /// Multiplies heights, not those of before but the terrain's own, by a factor above 0. Errors grow alike, so views draw
    /// finer tiles of higher ground.
    pub fn multiply_heights(&mut self, factor: f64) {
        self.factor = factor;
    }

    /// Lowest and highest height there can be, world units.
    fn bounds(&self) -> [f64; 2] {
        self.bounds.map(|height| height * self.factor)
    }

    /// Height of the ground at a place, world units; beyond the world's edge it is that of the edge.
    #[must_use]
    pub fn height(&self, x: f64, z: f64, scratch: &mut Scratch) -> f64 {
        self.terrain.height_between(x / self.unit, z / self.unit, scratch) * self.height_unit * self.factor
    }

    /// Lists points for a patch, in place of those it had. Gives the square of grid units (origin, side) whose heights may
    /// have changed. The patch's own errors are measured and count around it from here on.
    ///
    /// # Errors
    /// If there is no such patch, or a point is outside it.
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
        self.list([corner, corner + DVec2::splat(side as f64)], errors);
        Ok((origin, side))
    }

    /// Adds a rectangle with listed points to the regions; when there are many it joins the one that grows least.
    fn list(&mut self, [low, high]: [DVec2; 2], errors: Vec<f64>) {
        let union = |[a, b]: [DVec2; 2]| [a.min(low), b.max(high)];
        let area = |[a, b]: [DVec2; 2]| (b - a).x * (b - a).y;
        let growth = |at: &[DVec2; 2]| area(union(*at)) - area(*at);
        let nearest = (0..self.listed.len())
            .min_by(|&i, &j| growth(&self.listed[i].0).total_cmp(&growth(&self.listed[j].0)));
        match nearest {
            Some(i) if self.listed.len() >= MAX_LISTED || growth(&self.listed[i].0) <= 0.0 => {
                let (at, joined) = &mut self.listed[i];
                *at = union(*at);
                for (joined, error) in joined.iter_mut().zip(errors) {
                    *joined = joined.max(error);
                }
            }
            _ => self.listed.push(([low, high], errors)),
        }
        let around =
            |([low, high], errors): &([DVec2; 2], Vec<f64>)| Region::around(*low, *high, errors.clone());
        self.regions.clone_from(&self.stamped);
        self.regions.extend(worthwhile(self.listed.iter().map(around).collect(), &self.errors, MAX_LISTED));
    }

    /// Error of drawing with a spacing that holds within `reach` of a place, in grid units.
    fn error_near(&self, spacing: usize, at: DVec2, reach: f64) -> f64 {
        let near = self.regions.iter().filter(|region| region.distance(0, at) <= reach);
        near.map(|region| region.errors[spacing]).fold(self.errors[spacing], f64::max)
    }

    /// The tiles that cover the world.
    #[must_use]
    pub fn roots(&self) -> [TileId; 4] {
        self.roots
    }

    /// The terrain.
    #[must_use]
    pub fn terrain(&self) -> &Arc<Terrain> {
        &self.terrain
    }

    /// A tile's heights with its margin, rows of [`TILE_SAMPLES`], into `out`. Beyond the world's edge they are
    /// those of the edge; between points of the finest level they are those of its triangles. Cost: some 700 points of the
    /// generator.
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

    /// A square of `side`² points of a spacing from point `first` on, clamped to the world.
    fn points(&self, spacing: u8, first: [i64; 2], side: i64, scratch: &mut Scratch, out: &mut Vec<i32>) {
        out.clear();
        let level = self.terrain.finest_level() - spacing as i8;
        let Ok(edge) = self.terrain.edge(level) else { return out.resize((side * side) as usize, 0) };
        let clamp = |x: i64| x.clamp(-edge, edge);
        let [x, y] = first.map(clamp);
        let [x_end, y_end] = first.map(|x| clamp(x + side - 1));
        let (width, height) = ((x_end - x + 1) as usize, (y_end - y + 1) as usize);
        if self.terrain.window(level, x, y, width, height, scratch, out).is_err() {
            // Cannot be: the window was just clamped to what there is.
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

    /// Height of the eye over the highest ground around it, world units, not below 0: such that the distance to no
    /// point of the ground is overestimated by more than an eighth when it is taken as the hypotenuse of the distance in the
    /// plane and this. Looks at a few points of each spacing around the eye.
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
            let seen = 2.0 * CLEARANCE_POINTS as f64 * step;
            let error = self.error_near(usize::from(spacing), DVec2::from(at), seen);
            let over = eye.y - (highest + error * self.unit * self.factor);
            // PlacedTerrain further away than twice the clearance may be higher: 1 / sqrt(1 + 1/4) is 0.89.
            let reach = CLEARANCE_POINTS as f64 * step * self.unit / 2.0;
            best = best.max(over.min(reach));
        }
        best
    }

    /// Which tiles a view draws for a screen error of `target_px`, and the distances between which points of each
    /// spacing slide. If that takes more than `max_tiles`, the screen error is raised step by step, and given back.
    #[must_use]
    pub fn tiles(&self, view: &GroundView, target_px: f64, max_tiles: usize) -> Tiles {
        let sees = |tile: TileId| self.sees(view, tile);
        let eye = Eye { at: [view.eye.x / self.unit, view.eye.z / self.unit], above: view.above / self.unit };
        let mut px = target_px;
        loop {
            let reaches = Reaches::new(&self.errors, &self.regions, view.scale_px * self.factor, px);
            let end = |tile| reaches.end(tile);
            if let Some(picked) = select(&self.roots, &end, eye, max_tiles.max(64), &sees) {
                return Tiles { picked, reaches, target_px: px, unit: self.unit };
            }
            px *= COARSER;
            if px > 1e12 {
                // Even the least that must be drawn is too much: cannot be with a handful of tiles per spacing.
                return Tiles { picked: Vec::new(), reaches, target_px: px, unit: self.unit };
            }
        }
    }

    /// Which tiles out of a view lie where `matters` says so of the lowest and highest corners of a tile's column, world
    /// units, such as where shadows come from. Where [`PlacedTerrain::tiles`] with the same view draws for `target_px`, these
    /// are as good as for [`OUT_OF_VIEW`] times as much, and coarser where that takes more than `max_tiles`.
    #[must_use]
    pub fn tiles_out_of_view(
        &self,
        view: &GroundView,
        target_px: f64,
        max_tiles: usize,
        matters: &dyn Fn([DVec3; 2]) -> bool,
    ) -> Tiles {
        let eye = Eye { at: [view.eye.x / self.unit, view.eye.z / self.unit], above: view.above / self.unit };
        let scale_px = view.scale_px * self.factor;
        let reaches = |px| Reaches::new(&self.errors, &self.regions, scale_px, px);
        let seen = reaches(target_px);
        let mut px = target_px * OUT_OF_VIEW;
        loop {
            let reaches = reaches(px);
            // What is seen is divided as it is drawn, and then left out.
            let end = |tile| if self.sees(view, tile) { seen.end(tile) } else { reaches.end(tile) };
            // What is seen and does not matter is left out in any case, but its number is bounded by the view's own.
            let picked = select(&self.roots, &end, eye, usize::MAX, &|tile| matters(self.column(tile)));
            let unseen = |mut picked: SelectedTile| {
                let seen = |quadrant: u8| {
                    let divided = picked.tile.spacing > 0;
                    self.sees(view, if divided { picked.tile.child(quadrant) } else { picked.tile })
                };
                picked.quadrants &= !(0..4).filter(|q| seen(*q)).fold(0, |bits, q| bits | 1 << q);
                (picked.quadrants != 0).then_some(picked)
            };
            let picked: Vec<SelectedTile> = picked.into_iter().flatten().filter_map(unseen).collect();
            if picked.len() <= max_tiles || px > 1e12 {
                return Tiles { picked, reaches, target_px: px, unit: self.unit };
            }
            px *= COARSER;
        }
    }

    /// A tile's column from the lowest to the highest height there is: its corners, world units.
    fn column(&self, tile: TileId) -> [DVec3; 2] {
        let [x, z] = tile.origin().map(|x| x as f64 * self.unit);
        let side = tile.side() as f64 * self.unit;
        let [low, high] = self.bounds();
        [DVec3::new(x, low, z), DVec3::new(x + side, high, z + side)]
    }

    /// Whether a tile's column from the lowest to the highest height there is reaches into the view.
    fn sees(&self, view: &GroundView, tile: TileId) -> bool {
        let [low, high] = self.column(tile).map(|corner| corner - view.eye);
        view.planes.iter().all(|n| {
            let corner = DVec3::select(n.cmpge(DVec3::ZERO), high, low);
            n.dot(corner) >= 0.0
        })
    }
}

/// The lowest and highest height that there can be, in height units, features included.
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
    // Changes at points do not add up: neighbours take averages of them.
    let [mut least, mut greatest] = [0.0_f64; 2];
    for (x, y) in terrain.patches_with_points() {
        for point in terrain.points(x, y).map_or(&[][..], |points| points.as_slice()) {
            let height = f64::from(point.height);
            match point.mode {
                Mode::Additive => [least, greatest] = [least.min(height), greatest.max(height)],
                // What a fixed height changes spreads to others, on top of theirs.
                Mode::Fixed => {
                    [least, greatest] = [least.min(height - most), greatest.max(height + most)];
                }
            }
        }
    }
    [low + least, high + greatest]
}

/// What of a view decides about tiles.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GroundView {
    eye: DVec3,
    /// Height over the ground around, world units.
    pub above: f64,
    /// Pixels that a length of 1 at distance 1 covers at most anywhere in the picture.
    scale_px: f64,
    /// Inward normals of the view's planes, all through the eye.
    planes: [DVec3; 5],
}

impl GroundView {
    /// The view of a camera with a picture of `size` pixels, over `ground`.
    #[must_use]
    pub fn new(ground: &PlacedTerrain, camera: &Pose, size: (u32, u32), scratch: &mut Scratch) -> Self {
        let (tx, ty) = camera.tan_half_fov(size.0, size.1);
        let plane = |x: f64, y: f64, t: f64| camera.rotation * DVec3::new(x, y, -t);
        // A length across the view at depth z covers scale / z pixels; depth is distance times the cosine of the angle
        // to the axis, which is least in the corners. An eighth more: see `clearance`.
        let corner = (1.0 + tx * tx + ty * ty).sqrt();
        Self {
            eye: camera.eye,
            above: ground.clearance(camera.eye, scratch),
            scale_px: 1.125 * corner * f64::from(size.1) / (2.0 * ty),
            planes: [
                plane(1.0, 0.0, tx),
                plane(-1.0, 0.0, tx),
                plane(0.0, 1.0, ty),
                plane(0.0, -1.0, ty),
                camera.rotation * DVec3::NEG_Z,
            ],
        }
    }
}

/// The tiles of a view.
#[derive(Clone, Debug)]
pub struct Tiles {
    /// Tiles and their quadrants, finest first.
    pub picked: Vec<SelectedTile>,
    /// The screen error that they are good for.
    pub target_px: f64,
    /// In grid units.
    reaches: Reaches,
    unit: f64,
}

impl Tiles {
    /// Distances at which a tile's points begin to slide and have arrived away from rough regions, world units.
    #[must_use]
    pub fn morph(&self, tile: TileId) -> [f64; 2] {
        self.reaches.plain(tile.spacing).map(|d| d * self.unit)
    }

    /// Which of [`Self::regions`] may matter to points of a tile.
    #[must_use]
    pub fn mask(&self, tile: TileId) -> u32 {
        self.reaches.mask(tile)
    }

    /// The rough regions, in world units.
    #[must_use]
    pub fn regions(&self) -> Vec<TileRegion> {
        let world = |(region, ranges): (&Region, &Ranges)| TileRegion {
            from: region.from * self.unit,
            to: region.to * self.unit,
            radius: region.radius * self.unit,
            morph: (0..ranges.len() as u8).map(|s| ranges.morph(s).map(|d| d * self.unit)).collect(),
        };
        self.reaches.regions().map(world).collect()
    }
}

/// A rough region of a view, in world units.
#[derive(Clone, Debug, PartialEq)]
pub struct TileRegion {
    /// One end of its segment.
    pub from: DVec2,
    /// The other.
    pub to: DVec2,
    /// Radius around it.
    pub radius: f64,
    /// By spacing: distances at which points in it, and in the width [`grown`] around it, begin to slide and have
    /// arrived. They shrink by [`FALLOFF`] for each unit further away.
    ///
    /// [`FALLOFF`]: super::FALLOFF
    /// [`grown`]: super::grown
    pub morph: Vec<[f64; 2]>,
}
