//! What casts shadows into one map.

use glam::DVec3;

use super::Cascade;
use crate::frame::draw::{Batch, DrawList, finite, middle};
use crate::frame::settings::Frame;
use crate::passes::pn_triangles::PnTriangles;
use crate::scene::asset::AssetGpu;
use crate::scene::instance::Instance;
use crate::scene::terrain::TerrainPart;

/// What is drawn into a map, and what that depends on.
pub(crate) struct Casters<'a> {
    pub(crate) cascade: Cascade,
    nearer: &'a [Cascade],
    /// Share of a map's side at its border within which it is not all that is looked up.
    margin: f64,
    pub(crate) batches: Vec<Batch<'a>>,
    /// How far the highest of them lies above the map's middle, along the light.
    pub(crate) top: f64,
    /// Equal for equal shadows, but for ground whose points slide while the eye moves less than a map's step.
    pub(crate) key: Vec<u64>,
}

impl<'a> Casters<'a> {
    /// None yet, for the map of the last of some cascades, nearest first, that has so many texels along a side.
    pub(crate) fn new(cascades: &'a [Cascade], map_side: u32) -> Option<Self> {
        let (cascade, nearer) = cascades.split_last()?;
        // The reach of the widest lookup on both sides, a texel to spare, and the width over which maps blend.
        let margin = 0.05 + 8.0 / f64::from(map_side);
        Some(Self {
            cascade: *cascade,
            nearer,
            margin,
            batches: Vec::new(),
            top: cascade.above,
            key: Vec::new(),
        })
    }

    /// How far the top of a sphere, relative to the eye, lies above the map's middle if it may cast a shadow that is
    /// looked up there.
    pub(crate) fn top_of(&self, eye: DVec3, centre: DVec3, radius: f64) -> Option<f64> {
        let held = || self.nearer.iter().any(|nearer| nearer.holds(eye, centre, radius, self.margin));
        self.cascade.top_of(eye, centre, radius).filter(|_| !held())
    }

    /// Adds the frame's instances that may cast shadows into the map, seen or not, to what `list` uploads.
    pub(crate) fn add_meshes<'f>(&mut self, list: &mut DrawList<'f>, frame: &Frame<'f>)
    where
        'f: 'a,
    {
        let eye = frame.camera.eye;
        let curved = frame.settings.pn_triangles.filter(|_| !frame.settings.asks_for_ink());
        if let Some(PnTriangles { error_px, most }) = curved {
            self.key.push(u64::from(error_px.to_bits()) << 32 | u64::from(most));
        }
        for (number, drawable) in frame.drawables.iter().enumerate().filter(|(_, d)| d.asset.is_drawable()) {
            let (centre, radius) = drawable.asset.sphere();
            let placed = drawable.instances.iter().filter_map(|instance| {
                let raw = finite(instance.relative_to(drawable.asset.origin(), eye))?;
                let centre = middle(&raw) + instance.rotation * (centre * instance.scale);
                let top = self.top_of(eye, centre, radius * instance.scale.abs())?;
                Some((instance, raw, top))
            });
            let placed: Vec<_> = placed.collect();
            if placed.is_empty() {
                continue;
            }
            self.asset(drawable.asset, placed.iter().map(|(instance, _, top)| (*instance, *top)), frame);
            let batch = list.batch((drawable.asset, number), 0.0, placed.iter().map(|(_, raw, _)| *raw));
            self.batches.push(batch);
        }
    }

    /// Takes note of an asset's instances and of how high each reaches.
    fn asset<'i>(
        &mut self,
        asset: &AssetGpu,
        instances: impl Iterator<Item = (&'i Instance, f64)>,
        frame: &Frame<'_>,
    ) {
        self.key.push(asset.stamp());
        if frame.settings.relief && frame.settings.relief_in_depth {
            // Their depth is of the material.
            self.key.extend(asset.stamps());
        }
        if asset.is_moving(frame.time_s, frame.settings.morph_s) {
            self.key.push(u64::from(frame.time_s.to_bits()));
        }
        for (instance, top) in instances {
            self.top = self.top.max(top);
            let Instance { translation, rotation, scale } = instance;
            let place = translation.to_array().into_iter().chain(rotation.to_array()).chain([*scale]);
            self.key.extend(place.map(f64::to_bits));
        }
    }

    /// Takes note of a tile, of the stamp of its heights and of how high it reaches.
    pub(crate) fn tile(&mut self, part: &TerrainPart, stamp: u64, top: f64) {
        self.top = self.top.max(top);
        self.key.extend([stamp, part.morph[0].to_bits(), part.morph[1].to_bits()]);
        self.key
            .push(u64::from(part.spacing) << 40 | u64::from(part.quadrants) << 32 | u64::from(part.regions));
        self.key.extend(part.origin.map(i64::cast_unsigned));
    }
}
