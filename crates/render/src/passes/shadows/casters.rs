//! Shadow casters of one cascade.

use std::sync::Arc;

use glam::DVec3;

use super::Cascade;
use super::mesh_casters::{MeshCasters, top_of};
use crate::frame::batch::Batch;
use crate::frame::draw::DrawList;
use crate::frame::draw_groups::DrawGroups;
use crate::frame::placed::PlacedInstances;
use crate::frame::settings::Frame;
use crate::scene::terrain::TerrainPart;

/// Casters of a map, and a key of their state.
pub(crate) struct Casters<'a> {
    pub(crate) cascade: Cascade,
    /// The cascade after nearer ones.
    cascades: &'a [Cascade],
    /// Width of the border, as a share of the side, within which the next cascade is blended in.
    margin: f64,
    pub(crate) meshes: Arc<MeshCasters>,
    /// Mesh casters, if the map is redrawn.
    pub(crate) batches: Vec<Batch<'a>>,
    /// Their draws.
    pub(crate) groups: DrawGroups<'a>,
    /// Height of the highest caster above the map's centre, along the light.
    pub(crate) top: f64,
    /// Equal for equal shadows of terrain, except if it morphs while the eye moves less than a step.
    pub(crate) key: Vec<u64>,
}

impl<'a> Casters<'a> {
    /// Selects meshes for the last of `cascades` (nearest first), with maps of `map_side` texels; `before` are those
    /// of the frame before.
    pub(crate) fn new(
        (cascades, map_side): (&'a [Cascade], u32),
        frame: &Frame<'_>,
        placed: &PlacedInstances,
        before: Option<&Arc<MeshCasters>>,
    ) -> Option<Self> {
        let cascade = *cascades.last()?;
        // Widest filter on both sides, a spare texel and the blend width.
        let margin = 0.05 + 8.0 / f64::from(map_side);
        let meshes = MeshCasters::select((cascades, margin), frame, placed, before);
        let (batches, groups, top) = (Vec::new(), DrawGroups::default(), meshes.top);
        Some(Self { cascade, cascades, margin, meshes, batches, groups, top, key: Vec::new() })
    }

    /// Height of a sphere's top above the map's centre, if it may cast a shadow that is looked up there.
    pub(crate) fn top_of(&self, eye: DVec3, centre: DVec3, radius: f64) -> Option<f64> {
        top_of(self.cascades, self.margin, eye, (centre, radius))
    }

    /// Adds the meshes to `list`, for a map that is redrawn.
    pub(crate) fn add_meshes(
        &mut self,
        list: &mut DrawList<'a>,
        frame: &Frame<'a>,
        placed: &PlacedInstances,
    ) {
        self.batches = self.meshes.draw(list, frame, placed);
    }

    /// Adds a tile with the stamp and top of its heights.
    pub(crate) fn tile(&mut self, part: &TerrainPart, stamp: u64, top: f64) {
        self.top = self.top.max(top);
        self.key.extend([stamp, part.morph[0].to_bits(), part.morph[1].to_bits()]);
        self.key
            .push(u64::from(part.spacing) << 40 | u64::from(part.quadrants) << 32 | u64::from(part.regions));
        self.key.extend(part.origin.map(i64::cast_unsigned));
    }
}
