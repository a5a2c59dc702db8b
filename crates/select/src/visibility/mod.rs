//! What a view sees of the scene's surfaces, found by a small rasteriser: pure, deterministic, some hundred pixels wide.
//!
//! Coarse surfaces ([`Occluder`]) are drawn into a buffer of depths. Of a region of the finer surface only a sphere is known,
//! which bounds its coarse surface too. It is seen as far as points in the buffer lie in its sphere, and nearer to its
//! centre than to those of the other regions of its level. Where the buffer lies behind the middle of the sphere one sees
//! through it: it is not called hidden there, and the more is expected of it the farther the surface is off without it,
//! which may lack it altogether. Spheres are larger by what coarse surfaces may be off, and edges give way by a pixel
//! (docs/design/viewing.md, "What is seen, first").

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
use lodestream_scene::description::{AssetEntry, InstanceEntry};
use lodestream_scene::view::View;

use depth::{DepthBuffer, Frame};

/// Pixels along the longer side of the buffer.
const LONG_SIDE: u32 = 256;
/// Faces that are drawn at most, of the largest instances on the screen.
const MAX_FACES: usize = 1 << 16;
/// Least radius of an instance that hides anything, in pixels of the buffer.
const LEAST_RADIUS: f32 = 2.0;
/// Pixels of the buffer by which edges give way at most for an eye that moves.
const MAX_UNCOVERED: u32 = 8;
/// What a pixel counts at least at which one sees through the middle of a region.
const SEEN_THROUGH: f32 = 0.01;
/// What share of its disc a region counts for, through whose middle one sees, for each radius that the surface is off
/// without it: an edge as long as the disc is wide that moves by a radius uncovers 2/π of it at most; less was found to
/// do (docs/decisions.md).
const UNCOVERED: f32 = 0.3;
/// Radius of that middle, in radii.
const CORE: f32 = 0.25;
/// A point belongs to regions of a level that are so much farther than the nearest, in squares.
const NEARLY: f32 = 1.15;
/// The same for points at a centre, in squared radii.
const NEARLY_AT_THE_CENTRE: f32 = 0.02;

/// Claims of one level that are kept; a region beyond counts as seen. Regions share points with some neighbours, so that
/// only an index that lies about them gets there.
const MAX_CLAIMS: usize = 1 << 20;

/// What a view sees.
#[derive(Debug, Default)]
pub struct Visibility {
    buffer: DepthBuffer,
    /// How near the point at a pixel is to the region that it is nearest to, and in which turn that was found: one level of
    /// one instance. What is of another turn does not count, so nothing needs to be cleared.
    nearest: Vec<(u32, f32)>,
    turn: u32,
    /// Of one level of one instance: the points in each region, as pixel and distance, one region after the other.
    claims: Vec<(u32, f32)>,
    claimed: Vec<Claimed>,
    /// What was found of each instance in what is drawn, by chunk.
    known: HashMap<u32, Vec<Option<f32>>>,
    drawn: Option<Drawn>,
    /// Instances that may be in view.
    nearby: IndexSet,
}

/// What a buffer shows.
#[derive(Debug)]
struct Drawn {
    view: View,
    way: f32,
    instances: usize,
    occluders: Vec<Option<Arc<Occluder>>>,
    /// The instances that are drawn, ascending, and within which pixels: the others are too small, or one too many, to say what is seen of them.
    frames: Vec<(u32, Frame)>,
}

/// A region, and what it claims.
#[derive(Clone, Debug)]
struct Claimed {
    region: Region,
    claims: Range<usize>,
    /// Pixels that each claim stands for; `None` for a region that reaches to the eye.
    weight: Option<f32>,
}

/// One instance in the axes of the view: x to the right, y downwards, z along the view, in world units.
#[derive(Clone, Copy, Debug)]
pub struct Placed {
    to_view: Mat3,
    offset: Vec3,
    scale: f32,
}

impl Placed {
    /// An instance placed in a view.
    pub fn new(view: &View, asset: &AssetEntry, instance: &InstanceEntry) -> Self {
        let turned = view.orientation().conjugate();
        let down_and_forward = Mat3::from_diagonal(Vec3::new(1.0, -1.0, -1.0));
        let from_world = down_and_forward * Mat3::from_quat(turned);
        let origin = instance.to_world(asset.origin, [0.0; 3]) - DVec3::from(view.eye);
        Self {
            to_view: from_world * Mat3::from_quat(instance.orientation()) * instance.scale,
            offset: from_world * origin.as_vec3(),
            scale: instance.scale,
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

    fn shows(&self, view: &View, way: f32, instances: usize, assets: &[AssetState]) -> bool {
        let same = |(drawn, asset): (&Option<Arc<Occluder>>, &AssetState)| match (drawn, asset.occluder()) {
            (Some(drawn), Some(known)) => Arc::ptr_eq(drawn, known),
            (None, None) => true,
            _ => false,
        };
        (self.view, self.way, self.instances, self.occluders.len()) == (*view, way, instances, assets.len())
            && self.occluders.iter().zip(assets).all(same)
    }
}

impl Visibility {
    /// Draws what hides, unless the buffer shows it already. `way`: how far the eye may get, in world units, until what is
    /// seen now matters; edges give way by what that uncovers.
    pub fn draw(&mut self, view: &View, way: f32, instances: Instances<'_>, assets: &[AssetState]) {
        let count = instances.all().len();
        if self.drawn.as_ref().is_some_and(|drawn| drawn.shows(view, way, count, assets)) {
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
        instances.find(&TreeQuery::in_view_from(&projection, LEAST_RADIUS / px), &mut self.nearby);
        for &number in self.nearby.numbers() {
            let instance = &instances.all()[number as usize];
            let Some(asset) = assets.get(instance.asset as usize) else { continue };
            let Some(occluder) = asset.occluder() else { continue };
            let bounds = projection.bounds(asset.entry(), instance);
            let radius = bounds.coverage_px * px;
            if bounds.visible && radius >= LEAST_RADIUS {
                faces += occluder.faces().len();
                order.push((radius, number, instance, asset, occluder));
            }
        }
        if faces > MAX_FACES {
            // Stable, so instances as large keep their order.
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
        let uncovered = way * self.buffer.scale() * self.buffer.nearest();
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "saturates")]
        self.buffer.erode(1 + (uncovered.ceil() as u32).min(MAX_UNCOVERED));
        let occluders = assets.iter().map(|asset| asset.occluder().cloned()).collect();
        frames.sort_unstable_by_key(|(number, _)| *number);
        self.drawn = Some(Drawn { view: *view, way, instances: count, occluders, frames });
    }

    /// How much of each chunk's region is seen of an instance, 0 to 1; 0 only where it is hidden. Asked are the chunks for
    /// which `asks` says so; the others keep what `shares` had.
    ///
    /// The regions of a level share the surface out among them: a point belongs to those in whose sphere it lies nearest to
    /// the centre, measured by radii, and to the others that are nearly as near.
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

    /// How much of an instance is seen, 0 to 1, as of a region that is all of its bounding sphere; 1 where that is not
    /// judged. Small too where it fills little of the sphere's disc.
    pub fn shown(&self, number: u32, view: &View, asset: &AssetEntry, instance: &InstanceEntry) -> f32 {
        let Some(frame) = self.drawn.as_ref().and_then(|drawn| drawn.frame(number)) else { return 1.0 };
        let placed = Placed::new(view, asset, instance);
        let (center, radius) = (placed.place(asset.sphere.center), asset.sphere.radius * placed.scale);
        let mut own = 0_u32;
        let weight = self.buffer.points_around(number, frame, center, radius, |_, _| own += 1);
        let Some(weight) = weight else { return 1.0 };
        #[expect(clippy::cast_precision_loss, reason = "fewer than the buffer has pixels")]
        let own = own as f32 * weight;
        let region = Region { center, radius, reach: radius, error: 0.0 };
        self.seen_of_disc(own, &region, radius)
    }

    /// The root of the share of a region's disc that so many pixels of its own and those in which one sees its core come to.
    fn seen_of_disc(&self, own: f32, region: &Region, core: f32) -> f32 {
        let radius = region.radius * self.buffer.scale() / region.center.z;
        let disc = (std::f32::consts::PI * radius * radius).max(1.0);
        let (through, of) = self.buffer.seen_through(region.center, core);
        let uncovered = (UNCOVERED * region.error / region.radius).min(1.0) * disc;
        let seen = own + (SEEN_THROUGH * through).max(through / of.max(1.0) * uncovered);
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

    /// Notes which points of an instance lie in a region, and how near they are to it.
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
                // Saturates far beyond what a buffer has.
                claims.push((u32::try_from(pixel).unwrap_or(u32::MAX), distance));
            }
        });
        claimed.push(Claimed { region, claims: first..claims.len(), weight: weight.filter(|_| !full) });
    }

    /// The root, so that outlines of what is long and thin count by their length.
    fn share(&self, Claimed { region, claims, weight }: &Claimed) -> f32 {
        let belongs = |&&(pixel, distance): &&(u32, f32)| {
            distance <= NEARLY * self.nearest[pixel as usize].1 + NEARLY_AT_THE_CENTRE
        };
        #[expect(clippy::cast_precision_loss, reason = "fewer than the buffer has pixels")]
        let seen = self.claims[claims.clone()].iter().filter(belongs).count() as f32;
        let Some(weight) = weight else { return 1.0 };
        self.seen_of_disc(seen * weight, region, CORE * region.radius + (region.reach - region.radius))
    }
}

/// A region in the axes of the view.
#[derive(Clone, Copy, Debug)]
struct Region {
    center: Vec3,
    radius: f32,
    /// The radius, and what is drawn may be off.
    reach: f32,
    /// What the surface is off without the chunk.
    error: f32,
}

impl Region {
    fn new(placed: &Placed, chunk: &Chunk) -> Self {
        let Sphere { center, radius } = chunk.info().sphere;
        let radius = radius * placed.scale;
        let [margin, error] = [chunk.margin(), chunk.info().error].map(|length| length * placed.scale);
        Self { center: placed.place(center), radius, reach: radius + margin, error }
    }

    /// How far a point is from the centre, in radii, squared.
    fn distance(&self, point: Vec3) -> f32 {
        (point - self.center).length_squared() / (self.reach * self.reach)
    }
}
