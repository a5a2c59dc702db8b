//! Meshes that cast shadows into one map: selected anew when they or the map's cascades change.

use std::ops::Range;
use std::sync::Arc;

use glam::DVec3;
use lodestream_scene::section::SectionPlanes;

use super::Cascade;
use crate::frame::batch::Batch;
use crate::frame::draw::DrawList;
use crate::frame::placed::{PlacedDrawable, PlacedInstances, PlacedSphere};
use crate::frame::settings::Frame;
use crate::passes::pn_triangles::PnTriangles;
use crate::scene::asset::AssetGpu;
use crate::scene::placement::InstanceRaw;

/// Height of a sphere's top above the map's centre, if it may cast a shadow that is looked up there: in the last of
/// `cascades` and not in nearer ones alone. The position is relative to `eye`.
pub(crate) fn top_of(
    cascades: &[Cascade],
    margin: f64,
    eye: DVec3,
    (centre, radius): (DVec3, f64),
) -> Option<f64> {
    let (cascade, nearer) = cascades.split_last()?;
    let held = || nearer.iter().any(|nearer| nearer.holds(eye, centre, radius, margin));
    cascade.top_of(eye, centre, radius).filter(|_| !held())
}

/// What a selection depends on.
#[derive(Debug, PartialEq)]
struct SelectionInput {
    cascades: Vec<Cascade>,
    margin: f64,
    /// [`PlacedInstances::changes`].
    placed: u64,
    curved: Option<u64>,
    /// Relief writes depth.
    deep: bool,
    sections: SectionPlanes,
    /// Time of the frame in bits, while meshes morph.
    time: Option<u32>,
}

/// Selected meshes.
#[derive(Debug)]
pub(crate) struct MeshCasters {
    input: SelectionInput,
    /// Drawables with casters, each with its range of `selected`.
    drawables: Vec<(usize, Range<usize>)>,
    /// Indices of casters within their drawables.
    selected: Vec<u32>,
    /// Height of the highest caster above the map's centre, along the light.
    pub(crate) top: f64,
    /// Equal for equal shadows.
    pub(crate) key: Vec<u64>,
}

impl MeshCasters {
    /// Selects the frame's instances that may cast shadows into the map of the last cascade (nearest first), visible or
    /// not; `before` if nothing has changed since.
    pub(crate) fn select(
        (cascades, margin): (&[Cascade], f64),
        frame: &Frame<'_>,
        placed: &PlacedInstances,
        before: Option<&Arc<Self>>,
    ) -> Arc<Self> {
        let curved = frame.settings.asks_for_curves().filter(|_| !frame.settings.asks_for_ink());
        let morphs = placed.are_moving(frame.time_s, frame.settings.morph_s);
        let input = SelectionInput {
            cascades: cascades.to_vec(),
            margin,
            placed: placed.changes(),
            curved: curved.map(PnTriangles::key),
            deep: frame.settings.relief && frame.settings.relief_in_depth,
            sections: frame.settings.sections,
            time: morphs.then_some(frame.time_s.to_bits()),
        };
        if let Some(before) = before.filter(|before| before.input == input) {
            return Arc::clone(before);
        }
        let top = cascades.last().map_or(0.0, |cascade| cascade.above);
        let planes = input
            .sections
            .iter()
            .flat_map(|plane| [plane.distance()].into_iter().chain(plane.normal().to_array()));
        let key = input.curved.into_iter().chain(planes.map(f64::to_bits)).collect();
        let mut this = Self { input, drawables: Vec::new(), selected: Vec::new(), top, key };
        for (number, (drawable, placed)) in frame.drawables.iter().zip(placed.drawables()).enumerate() {
            if placed.look.is_some() {
                this.add(frame, (number, drawable.asset), &placed);
            }
        }
        Arc::new(this)
    }

    fn add(&mut self, frame: &Frame<'_>, (number, asset): (usize, &AssetGpu), placed: &PlacedDrawable<'_>) {
        let first = self.selected.len();
        let SelectionInput { cascades, margin, deep, sections, .. } = &self.input;
        let top_of = |centre, radius| top_of(cascades, *margin, DVec3::ZERO, (centre, radius));
        for cell in placed.cells {
            let all = cell.range();
            // What excludes a sphere excludes all within; one that is not a number excludes nothing.
            if all.len() > 1 && cell.centre.is_finite() && top_of(cell.centre, cell.radius).is_none() {
                continue;
            }
            for at in all {
                let PlacedSphere { centre, radius } = placed.spheres[at];
                let Some(top) = top_of(centre, radius).filter(|_| !sections.cut_sphere(centre, radius))
                else {
                    continue;
                };
                if instance(asset, placed, at, frame.camera.eye).is_some() {
                    self.top = self.top.max(top);
                    self.selected.push(at as u32);
                }
            }
        }
        let selected = first..self.selected.len();
        if selected.is_empty() {
            return;
        }
        self.key.extend([asset.stamp(), asset.hole_stamp()]);
        if *deep {
            // Their depth depends on the material.
            self.key.extend(asset.stamps());
        }
        if placed.is_moving(frame.time_s, frame.settings.morph_s) {
            self.key.push(u64::from(frame.time_s.to_bits()));
        }
        self.key.extend(self.selected[selected.clone()].iter().map(|at| placed.keys[*at as usize]));
        self.drawables.push((number, selected));
    }

    /// Adds the selected instances to `list`, for a map that is redrawn.
    pub(crate) fn draw<'a>(
        &self,
        list: &mut DrawList<'a>,
        frame: &Frame<'a>,
        placed: &PlacedInstances,
    ) -> Vec<Batch<'a>> {
        let mut batches = Vec::with_capacity(self.drawables.len());
        for (number, selected) in &self.drawables {
            let (drawable, Some(placed)) = (&frame.drawables[*number], placed.drawable(*number)) else {
                continue;
            };
            let (asset, eye) = (drawable.asset, frame.camera.eye);
            let selected = &self.selected[selected.clone()];
            let raws = selected.iter().filter_map(|at| instance(asset, &placed, *at as usize, eye));
            batches.push(list.batch((asset, *number), raws));
        }
        batches
    }
}

/// A drawn instance.
fn instance(asset: &AssetGpu, placed: &PlacedDrawable<'_>, at: usize, eye: DVec3) -> Option<InstanceRaw> {
    let instance = &placed.instances[at];
    let states = if placed.has_no_states { Some(0) } else { asset.part_states(instance.place as usize) };
    instance.raw(eye, states?)
}
