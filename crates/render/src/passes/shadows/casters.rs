//! Shadow casters of one cascade.

use glam::DVec3;
use lodestream_scene::placement::Placement;

use super::Cascade;
use crate::frame::batch::Batch;
use crate::frame::draw::{DrawList, finite};
use crate::frame::draw_groups::DrawGroups;
use crate::frame::settings::Frame;
use crate::passes::pn_triangles::PnTriangles;
use crate::scene::asset::AssetGpu;
use crate::scene::placement::InstanceRaw;
use crate::scene::terrain::TerrainPart;

/// Casters of a map, and a key of their state.
pub(crate) struct Casters<'a> {
    pub(crate) cascade: Cascade,
    nearer: &'a [Cascade],
    /// Width of the border, as a share of the side, within which the next cascade is blended in.
    margin: f64,
    pub(crate) batches: Vec<Batch<'a>>,
    /// Their draws.
    pub(crate) groups: DrawGroups<'a>,
    /// Height of the highest caster above the map's centre, along the light.
    pub(crate) top: f64,
    /// Equal for equal shadows, except for terrain that morphs while the eye moves less than a step.
    pub(crate) key: Vec<u64>,
}

impl<'a> Casters<'a> {
    /// Creates an empty list for the last of `cascades` (nearest first), with maps of `map_side` texels.
    pub(crate) fn new(cascades: &'a [Cascade], map_side: u32) -> Option<Self> {
        let (cascade, nearer) = cascades.split_last()?;
        // Widest filter on both sides, a spare texel and the blend width.
        let margin = 0.05 + 8.0 / f64::from(map_side);
        Some(Self {
            cascade: *cascade,
            nearer,
            margin,
            batches: Vec::new(),
            groups: DrawGroups::default(),
            top: cascade.above,
            key: Vec::new(),
        })
    }

    /// Height of a sphere's top above the map's centre, if it may cast a shadow that is looked up there.
    pub(crate) fn top_of(&self, eye: DVec3, centre: DVec3, radius: f64) -> Option<f64> {
        let held = || self.nearer.iter().any(|nearer| nearer.holds(eye, centre, radius, self.margin));
        self.cascade.top_of(eye, centre, radius).filter(|_| !held())
    }

    /// Adds the frame's instances that may cast shadows into the map, visible or not, to `list`.
    pub(crate) fn add_meshes<'f>(&mut self, list: &mut DrawList<'f>, frame: &Frame<'f>)
    where
        'f: 'a,
    {
        let eye = frame.camera.eye;
        let curved = frame.settings.asks_for_curves().filter(|_| !frame.settings.asks_for_ink());
        self.key.extend(curved.map(PnTriangles::key));
        for (number, drawable) in frame.drawables.iter().enumerate().filter(|(_, d)| d.asset.is_drawable()) {
            let origin = drawable.asset.origin();
            let placed = drawable.instances.iter().enumerate().filter_map(|(index, placement)| {
                let states = drawable.asset.part_states(index)?;
                let raw = finite(InstanceRaw::new(placement, origin, eye).with_states(states))?;
                let (centre, radius) = raw.sphere(drawable.asset.sphere_of(index));
                Some((placement, raw, self.top_of(eye, centre, radius)?))
            });
            let placed: Vec<_> = placed.collect();
            if placed.is_empty() {
                continue;
            }
            self.asset(drawable.asset, placed.iter().map(|(placement, _, top)| (*placement, *top)), frame);
            let batch = list.batch((drawable.asset, number), 0.0, placed.iter().map(|(_, raw, _)| *raw));
            self.batches.push(batch);
        }
    }

    /// Adds an asset's instances and their heights to the key.
    fn asset<'i>(
        &mut self,
        asset: &AssetGpu,
        instances: impl Iterator<Item = (&'i Placement, f64)>,
        frame: &Frame<'_>,
    ) {
        self.key.push(asset.stamp());
        if frame.settings.relief && frame.settings.relief_in_depth {
            // Their depth depends on the material.
            self.key.extend(asset.stamps());
        }
        if asset.is_moving(frame.time_s, frame.settings.morph_s) {
            self.key.push(u64::from(frame.time_s.to_bits()));
        }
        for (placement, top) in instances {
            self.top = self.top.max(top);
            let Placement { translation, rotation, scale } = placement;
            self.key.extend(translation.map(f64::to_bits));
            self.key.extend(rotation.iter().chain([scale]).map(|x| u64::from(x.to_bits())));
        }
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
