//! Refinement of parts out of view that cast shadows into it.

use glam::Vec3;
use lodestream_geometry::screen::visible_error;

use super::Selector;
use super::chunks::sufficient_truncation;
use super::threshold::{BIN_SHIFT, BINS, threshold_within};
use crate::difference::{Picture, difference_error};
use crate::instance_tree::{Instances, TreeQuery};
use crate::priority::hidden;
use crate::project::Projection;
use crate::selection::State;
use crate::state::{AssetState, Chunk};
use lodestream_scene::blob::BlobPart;
use lodestream_scene::view::View;

/// Pixels of shadow displacement that count as one of a surface: shadow edges are softened by the map's texels and
/// filter.
const SOFTNESS: f64 = 4.0;
/// Shadows use at most 1/10 of the bytes that the view itself needs.
const MAX_BYTES_DIVISOR: u64 = 10;

impl Selector {
    /// Evaluates instances out of view: the displacement in pixels of the shadows that their chunks cast into view.
    ///
    /// A sphere is swept away from the sun, down to the lowest instance in view; where the swept sphere reaches into
    /// the frustum, its shadow may fall. Costs one more test per chunk of the instances whose own sphere passes it.
    pub(super) fn evaluate_shadows(
        &mut self,
        view: &View,
        to_sun: Vec3,
        threshold: f32,
        instances: Instances<'_>,
        assets: &[AssetState],
    ) {
        let (projection, picture) = (Projection::new(view), Picture::new(view));
        let floor_px = f64::from(threshold * self.settings.undo_below.get());
        let cut = &self.cut;
        let placed = |number: &u32| {
            if cut.covers(*number) {
                return None;
            }
            let instance = instances.all().get(*number as usize)?;
            Some((instance, assets.get(instance.asset as usize)?))
        };
        instances.find(&TreeQuery::in_view(&projection), &mut self.nearby);
        let bottoms = self.nearby.numbers().iter().filter_map(placed).filter_map(|(instance, asset)| {
            let (center, radius) = projection.sphere(asset.entry(), instance);
            projection.sees(center, radius).then_some(to_sun.dot(center) - radius)
        });
        let lowest = bottoms.fold(f32::INFINITY, f32::min);
        instances.find(&TreeQuery::casting(&projection, to_sun, lowest), &mut self.nearby);
        for (instance, asset) in self.nearby.numbers().iter().filter_map(placed) {
            let (center, radius) = projection.sphere(asset.entry(), instance);
            let fall = to_sun.dot(center) + radius - lowest;
            if fall.is_nan() || fall <= 0.0 {
                continue;
            }
            let sweep = to_sun * -fall;
            let Some(depth) = projection.shadow_depth(center, radius, sweep) else { continue };
            let scale = f64::from(instance.placement.scale);
            let px_of = |error: f32| projection.error_px(f64::from(error) * scale, depth) / SOFTNESS;
            let on_screen = &mut self.on_screen[instance.asset as usize];
            if px_of(asset.entry().root_error) < floor_px {
                continue;
            }
            #[expect(clippy::cast_possible_truncation, reason = "to the nearest f32")]
            if !projection.sees(center, radius) {
                on_screen.shadow_unknown_px =
                    on_screen.shadow_unknown_px.max(px_of(asset.unknown_error()) as f32);
            }
            on_screen.casts_shadow = true;
            if asset.state(BlobPart::Base) != State::Applied {
                continue;
            }
            let local = projection.local(asset.entry(), instance);
            let sweep = instance.placement.orientation().conjugate() * sweep / instance.placement.scale;
            let evaluations = &mut self.chunks[on_screen.first_chunk..];
            for (evaluation, chunk) in evaluations.iter_mut().zip(asset.chunks()) {
                let Some(info) = chunk.as_ref().map(Chunk::info) else { continue };
                let Some([px, px_per_unit]) = local.shadow_px(&info.sphere, visible_error(info, 0.0), sweep)
                else {
                    continue;
                };
                #[expect(clippy::cast_possible_truncation, reason = "to the nearest f32")]
                let [px, px_per_unit] = [px / SOFTNESS, px_per_unit / SOFTNESS].map(|x| x as f32);
                evaluation.own_shadow_px = evaluation.own_shadow_px.max(px);
                evaluation.shadow_px = evaluation.own_shadow_px;
                let error_px = px_per_unit * difference_error(info.error, info.attribute_error, 0.0);
                let whole = picture.shape_px2(error_px, px_per_unit * info.sphere.radius);
                evaluation.difference_px2 += hidden(whole);
            }
        }
    }

    /// Propagates shadow errors to parents, chooses the threshold within the shadows' share of the bytes, and raises
    /// the errors of chunks above it so that they are wanted.
    pub(super) fn admit_shadows(&mut self, threshold: f32, assets: &[AssetState]) {
        self.histogram.clear();
        self.histogram.resize(BINS, (0, 0));
        let (truncation_points, share) =
            (self.settings.truncation_points, self.settings.attribute_share.get());
        let (mut view_faces, mut view_bytes) = (0_u64, 0_u64);
        for (on_screen, asset) in self.on_screen.iter().zip(assets) {
            if !on_screen.visible && !on_screen.casts_shadow {
                continue;
            }
            let evaluations = &mut self.chunks[on_screen.first_chunk..];
            for (index, chunk) in asset.chunks().iter().enumerate().rev() {
                let Some(info) = chunk.as_ref().map(Chunk::info) else { continue };
                let shadow_px = evaluations[index].shadow_px;
                let is_viewed = evaluations[index].error_px > threshold;
                for &parent in &info.parents {
                    let parent = &mut evaluations[parent as usize];
                    parent.shadow_px = parent.shadow_px.max(shadow_px);
                    parent.has_wanted_child |= is_viewed;
                }
                let (faces, bytes) = (u64::from(info.faces), u64::from(info.payload_bytes));
                if is_viewed {
                    let truncation = if truncation_points {
                        sufficient_truncation(info, &evaluations[index], threshold, share)
                    } else {
                        None
                    };
                    view_faces += faces;
                    view_bytes += u64::from(info.extent(truncation).payload_bytes);
                } else if shadow_px > threshold {
                    let bin = &mut self.histogram[(shadow_px.to_bits() >> BIN_SHIFT) as usize % BINS];
                    bin.0 += faces;
                    bin.1 += bytes;
                }
            }
        }
        let faces_left = self.settings.max_faces.saturating_sub(view_faces);
        let bytes_left =
            self.settings.max_bytes.saturating_sub(view_bytes).min(view_bytes / MAX_BYTES_DIVISOR);
        let needed = threshold_within(&self.histogram, faces_left, bytes_left, threshold);
        // Scales displacements so that the shadows' threshold equals the view's.
        let weight = threshold / needed;
        let least = threshold * self.settings.undo_below.get();
        for (on_screen, asset) in
            self.on_screen.iter_mut().zip(assets).filter(|(on_screen, _)| on_screen.casts_shadow)
        {
            let unknown_px = weight * on_screen.shadow_unknown_px;
            on_screen.pages_visible &= on_screen.unknown_px > threshold || unknown_px <= threshold;
            on_screen.unknown_px = on_screen.unknown_px.max(unknown_px);
            for evaluation in &mut self.chunks[on_screen.first_chunk..][..asset.chunks().len()] {
                let px = weight * evaluation.shadow_px;
                evaluation.shadow_only = evaluation.error_px <= threshold && px > threshold;
                if px > evaluation.error_px && px >= least {
                    evaluation.error_px = px;
                    evaluation.own_px = evaluation.own_px.max(weight * evaluation.own_shadow_px);
                }
            }
        }
    }
}
