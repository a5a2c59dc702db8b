//! Occlusion test: the visible share of instances and chunk regions, by a small deterministic software rasteriser.
//!
//! Coarse surfaces ([`Occluder`]) are drawn into a depth buffer some hundred pixels wide. Of a chunk's region only a
//! bounding sphere is known, which bounds its coarse surface too. The region is visible at the buffer's points that
//! lie in its sphere and nearer to its centre than to the centres of other regions of its level. If the buffer is
//! behind the middle of the sphere, the coarse surface may lack the region altogether: it does not count as hidden,
//! and its visible share grows with its error. Spheres are enlarged by the error of coarse surfaces, and occluder
//! edges are eroded by a pixel (`docs/design/viewing.md`).

mod depth;
#[cfg(test)]
mod tests;

use std::collections::HashMap;
use std::ops::Range;
use std::sync::Arc;

use glam::{DVec3, Mat3, Vec3};
use lodestream_geometry::index::Sphere;

use super::instance_tree::{IndexSet, Instances, TreeQuery};
use super::occluder::Occluder;
use super::project::Projection;
use super::state::{AssetState, Chunk};
use lodestream_scene::description::{AssetEntry, Instance};
use lodestream_scene::view::View;

use depth::{DepthBuffer, Frame};

/// Pixels along the longer side of the buffer.
const LONG_SIDE: u32 = 256;
/// Most faces drawn, of the instances with the largest screen radius.
const MAX_FACES: usize = 1 << 16;
/// Least radius of an instance that is drawn, in pixels of the buffer.
const MIN_RADIUS: f32 = 2.0;
/// Most pixels of the buffer by which edges are eroded for a moving eye.
const MAX_UNCOVERED: u32 = 8;
/// Least weight of a pixel at which the buffer is behind the middle of a region.
const MIN_THROUGH_WEIGHT: f32 = 0.01;
/// Visible share of a region's disc, per error in radii, if the buffer is behind the region's middle. An edge across
/// the disc that moves by a radius uncovers at most 2/π of it; less proved sufficient (`docs/decisions.md`).
const UNCOVERED: f32 = 0.3;
/// Radius of the middle of a region, in radii.
const CORE: f32 = 0.25;
/// A point belongs to all regions of a level up to this factor farther than the nearest, in squared distance.
const NEARLY: f32 = 1.15;
/// Added to that bound, for points at a centre, in squared radii.
const NEARLY_AT_THE_CENTRE: f32 = 0.02;

/// Most claims of one level; a region beyond counts as visible. Regions share points with few neighbours, so only an
/// index with false spheres exceeds it.
const MAX_CLAIMS: usize = 1 << 20;

/// Visibility of the scene's surfaces in one view.
#[derive(Debug, Default)]
pub struct Visibility {
    buffer: DepthBuffer,
    /// Distance of each pixel's point to its nearest region, and the turn (one level of one instance) in which it was
    /// computed. Entries of other turns are ignored, so nothing needs to be cleared.
    nearest: Vec<(u32, f32)>,
    turn: u32,
    /// The points in each region of one level of one instance, as pixel and distance, region by region.
    claims: Vec<(u32, f32)>,
    claimed: Vec<Claimed>,
    /// Computed shares of each instance, by chunk.
    known: HashMap<u32, Vec<Option<f32>>>,
    drawn: Option<Drawn>,
    /// Instances that may be in view.
    nearby: IndexSet,
}

/// The inputs that the buffer was drawn from.
#[derive(Debug)]
struct Drawn {
    view: View,
    travel: f32,
    instances: usize,
    occluders: Vec<Option<Arc<Occluder>>>,
    /// Drawn instances, ascending, with their pixel bounds. The others are too small or exceed [`MAX_FACES`], and are
    /// not tested.
    frames: Vec<(u32, Frame)>,
}

/// A region and its claims.
#[derive(Clone, Debug)]
struct Claimed {
    region: Region,
    claims: Range<usize>,
    /// Pixels per claim; `None` for a region that contains the eye.
    weight: Option<f32>,
}

/// Transform of one instance to view axes: x to the right, y down, z along the view, in world units.
#[derive(Clone, Copy, Debug)]
pub struct Placed {
    to_view: Mat3,
    offset: Vec3,
    scale: f32,
}

impl Placed {
    /// An instance placed in a view.
    pub fn new(view: &View, asset: &AssetEntry, instance: &Instance) -> Self {
        let turned = view.orientation().conjugate();
        let down_and_forward = Mat3::from_diagonal(Vec3::new(1.0, -1.0, -1.0));
        let from_world = down_and_forward * Mat3::from_quat(turned);
        let origin = instance.to_world(asset.origin, [0.0; 3]) - DVec3::from(view.eye);
        Self {
            to_view: from_world
                * Mat3::from_quat(instance.placement.orientation())
                * instance.placement.scale,
            offset: from_world * origin.as_vec3(),
            scale: instance.placement.scale,
        }
    }

    fn place(&self, point: [f32; 3]) -> Vec3 {
        self.to_view * Vec3::from(point) + self.offset
    }
}

impl Drawn {
    fn frame(&self, number: u32) -> Option<&Frame> {
        let at = self.frames.binary_search_by_key(&number, |(number, _)| *number).ok()?;
        Some(&self.frames[at].1)
    }

    fn shows(&self, view: &View, travel: f32, instances: usize, assets: &[AssetState]) -> bool {
        let same = |(drawn, asset): (&Option<Arc<Occluder>>, &AssetState)| match (drawn, asset.occluder()) {
            (Some(drawn), Some(known)) => Arc::ptr_eq(drawn, known),
            (None, None) => true,
            _ => false,
        };
        (self.view, self.travel, self.instances, self.occluders.len())
            == (*view, travel, instances, assets.len())
            && self.occluders.iter().zip(assets).all(same)
    }
}

impl Visibility {
    /// Draws the occluders, unless the buffer is up to date. `travel` is the distance that the eye may move before
    /// requested blobs arrive, in world units; edges are eroded by what that uncovers.
    pub fn draw(&mut self, view: &View, travel: f32, instances: Instances<'_>, assets: &[AssetState]) {
        let count = instances.all().len();
        if self.drawn.as_ref().is_some_and(|drawn| drawn.shows(view, travel, count, assets)) {
            return;
        }
        self.known.clear();
        self.buffer.clear(view, LONG_SIDE);
        let projection = Projection::new(view);
        // Pixels of the buffer per pixel of the view.
        #[expect(clippy::cast_possible_truncation, reason = "to the nearest f32")]
        let px = self.buffer.scale() / projection.scale_px() as f32;
        let mut order = Vec::new();
        let mut faces = 0;
        instances.find(&TreeQuery::in_view_from(&projection, MIN_RADIUS / px), &mut self.nearby);
        for &number in self.nearby.numbers() {
            let instance = &instances.all()[number as usize];
            let Some(asset) = assets.get(instance.asset as usize) else { continue };
            let Some(occluder) = asset.occluder() else { continue };
            let bounds = projection.bounds(asset.entry(), instance);
            let radius = bounds.coverage_px * px;
            if bounds.visible && radius >= MIN_RADIUS {
                faces += occluder.faces().len();
                order.push((radius, number, instance, asset, occluder));
            }
        }
        if faces > MAX_FACES {
            // The sort is stable: instances of equal size keep their order.
            order.sort_by(|a, b| b.0.total_cmp(&a.0));
        }
        let mut left = MAX_FACES;
        let (mut corners, mut frames) = (Vec::new(), Vec::new());
        for (_, number, instance, asset, occluder) in order {
            let Some(rest) = left.checked_sub(occluder.faces().len()) else { break };
            left = rest;
            let placed = Placed::new(view, asset.entry(), instance);
            corners.clear();
            corners
                .extend(occluder.positions().iter().map(|&point| self.buffer.project(placed.place(point))));
            frames.push((number, self.buffer.frame(&corners)));
            for &[a, b, c] in occluder.faces() {
                let corner = |i: u32| corners.get(i as usize);
                if let (Some(a), Some(b), Some(c)) = (corner(a), corner(b), corner(c)) {
                    self.buffer.triangle(number, [a, b, c]);
                }
            }
        }
        self.buffer.find_points();
        let uncovered = travel * self.buffer.scale() * self.buffer.nearest();
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "saturates")]
        self.buffer.erode(1 + (uncovered.ceil() as u32).min(MAX_UNCOVERED));
        let occluders = assets.iter().map(|asset| asset.occluder().cloned()).collect();
        frames.sort_unstable_by_key(|(number, _)| *number);
        self.drawn = Some(Drawn { view: *view, travel, instances: count, occluders, frames });
    }

    /// Computes the visible share of chunk regions of an instance, 0 to 1; 0 only if hidden. Tests the chunks for
    /// which `asks` returns true; the others keep their value in `shares`.
    ///
    /// A point of the surface belongs to the region of a level to whose centre it is nearest, in radii, and to those
    /// nearly as near.
    pub fn shares(
        &mut self,
        number: u32,
        placed: &Placed,
        chunks: &[Option<Chunk>],
        asks: impl Fn(usize, &Chunk) -> bool,
        shares: &mut [f32],
    ) {
        let Some(frame) = self.drawn.as_ref().and_then(|drawn| drawn.frame(number)).cloned() else { return };
        let known = self.known.entry(number).or_default();
        known.resize(chunks.len(), None);
        let mut known = std::mem::take(known);
        let level = |chunk: &Option<Chunk>| chunk.as_ref().map_or(0, |chunk| chunk.info().level);
        let mut first = 0;
        for of_level in chunks.chunk_by(|a, b| level(a) == level(b)) {
            let numbered = || (first..).zip(of_level).filter_map(|(at, chunk)| Some((at, chunk.as_ref()?)));
            if numbered().any(|(at, chunk)| known[at].is_none() && asks(at, chunk)) {
                self.begin_turn();
                for (_, chunk) in numbered() {
                    self.claim(number, &frame, Region::new(placed, chunk));
                }
                for ((at, chunk), claimed) in numbered().zip(&self.claimed) {
                    if asks(at, chunk) {
                        known[at] = Some(self.share(claimed));
                    }
                }
            }
            first += of_level.len();
        }
        for ((share, known), (at, chunk)) in shares.iter_mut().zip(&known).zip((0..).zip(chunks)) {
            if let (Some(known), Some(chunk)) = (known, chunk)
                && asks(at, chunk)
            {
                *share = *known;
            }
        }
        self.known.insert(number, known);
    }

    /// Visible share of an instance, 0 to 1, as of a region that is its bounding sphere; 1 if it is not tested. Also
    /// small if the instance fills little of the sphere's disc.
    pub fn shown(&self, number: u32, view: &View, asset: &AssetEntry, instance: &Instance) -> f32 {
        let Some(frame) = self.drawn.as_ref().and_then(|drawn| drawn.frame(number)) else { return 1.0 };
        let placed = Placed::new(view, asset, instance);
        let (center, radius) = (placed.place(asset.sphere.center), asset.sphere.radius * placed.scale);
        let mut own = 0_u32;
        let weight = self.buffer.points_around(number, frame, center, radius, |_, _| own += 1);
        let Some(weight) = weight else { return 1.0 };
        #[expect(clippy::cast_precision_loss, reason = "fewer than the buffer has pixels")]
        let own = own as f32 * weight;
        let region = Region { center, radius, reach: radius, error: 0.0 };
        self.visible_share(own, &region, radius)
    }

    /// Visible share of a part of an instance's surface within a sphere, in the asset's units; the drawn surface errs by at
    /// most `margin`. As [`Visibility::shown`].
    pub fn region_share(&self, number: u32, placed: &Placed, sphere: &Sphere, margin: f32) -> f32 {
        let Some(frame) = self.drawn.as_ref().and_then(|drawn| drawn.frame(number)) else { return 1.0 };
        let (center, radius) = (placed.place(sphere.center), sphere.radius * placed.scale);
        let error = (margin * placed.scale).min(radius);
        let reach = radius + error;
        let mut own = 0_u32;
        let Some(weight) = self.buffer.points_around(number, frame, center, reach, |_, _| own += 1) else {
            return 1.0;
        };
        #[expect(clippy::cast_precision_loss, reason = "fewer than the buffer has pixels")]
        let own = own as f32 * weight;
        self.visible_share(own, &Region { center, radius, reach, error }, CORE * radius + error)
    }

    /// Square root of the visible share of a region's disc: from the number of its own pixels, and those where the
    /// buffer is behind its core.
    fn visible_share(&self, own: f32, region: &Region, core: f32) -> f32 {
        let radius = region.radius * self.buffer.scale() / region.center.z;
        let disc = (std::f32::consts::PI * radius * radius).max(1.0);
        let (through, of) = self.buffer.seen_through(region.center, core);
        let uncovered = (UNCOVERED * region.error / region.radius).min(1.0) * disc;
        let seen = own + (MIN_THROUGH_WEIGHT * through).max(through / of.max(1.0) * uncovered);
        (seen / disc).min(1.0).sqrt()
    }

    fn begin_turn(&mut self) {
        let next = self.turn.checked_add(1);
        if next.is_none() || self.nearest.len() != self.buffer.pixels() {
            self.nearest.clear();
            self.nearest.resize(self.buffer.pixels(), (0, f32::MAX));
        }
        self.turn = next.unwrap_or(1);
        self.claims.clear();
        self.claimed.clear();
    }

    /// Records the points of an instance that lie in a region, and their distances.
    fn claim(&mut self, number: u32, frame: &Frame, region: Region) {
        let Self { buffer, nearest, turn, claims, claimed, .. } = self;
        let first = claims.len();
        let full = first >= MAX_CLAIMS;
        let weight = buffer.points_around(number, frame, region.center, region.reach, |pixel, point| {
            let distance = region.distance(point);
            if distance <= 1.0 {
                let nearest = &mut nearest[pixel];
                if nearest.0 != *turn || distance < nearest.1 {
                    *nearest = (*turn, distance);
                }
                // Never saturates: a buffer has fewer pixels.
                claims.push((u32::try_from(pixel).unwrap_or(u32::MAX), distance));
            }
        });
        claimed.push(Claimed { region, claims: first..claims.len(), weight: weight.filter(|_| !full) });
    }

    /// Visible share as a square root, so that long thin shapes count by their length.
    fn share(&self, Claimed { region, claims, weight }: &Claimed) -> f32 {
        let belongs = |&&(pixel, distance): &&(u32, f32)| {
            distance <= NEARLY * self.nearest[pixel as usize].1 + NEARLY_AT_THE_CENTRE
        };
        #[expect(clippy::cast_precision_loss, reason = "fewer than the buffer has pixels")]
        let seen = self.claims[claims.clone()].iter().filter(belongs).count() as f32;
        let Some(weight) = weight else { return 1.0 };
        self.visible_share(seen * weight, region, CORE * region.radius + (region.reach - region.radius))
    }
}

/// A region in view axes.
#[derive(Clone, Copy, Debug)]
struct Region {
    center: Vec3,
    radius: f32,
    /// The radius plus the error of the drawn surface.
    reach: f32,
    /// Error of the surface without the chunk.
    error: f32,
}

impl Region {
    fn new(placed: &Placed, chunk: &Chunk) -> Self {
        let Sphere { center, radius } = chunk.info().sphere;
        let radius = radius * placed.scale;
        let [margin, error] = [chunk.margin(), chunk.info().error].map(|length| length * placed.scale);
        Self { center: placed.place(center), radius, reach: radius + margin, error }
    }

    /// Squared distance of a point from the centre, in radii.
    fn distance(&self, point: Vec3) -> f32 {
        (point - self.center).length_squared() / (self.reach * self.reach)
    }
}
