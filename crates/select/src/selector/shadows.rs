//! What is out of view and casts shadows into it.

use glam::Vec3;
use lodestream_geometry::screen::visible_error;

use super::{BIN_SHIFT, BINS, Selector, enough, threshold_within};
use crate::difference::{Picture, seen_error};
use crate::instance_tree::{Instances, TreeQuery};
use crate::priority::hidden;
use crate::project::Projection;
use crate::selection::State;
use crate::state::{AssetState, Chunk};
use lodestream_scene::blob::BlobPart;
use lodestream_scene::view::View;

/// How many pixels of a shadow count as one of a surface: its edge is no sharper than the map's texels and their filter.
const SOFTNESS: f64 = 4.0;
/// Shadows take one byte of this many that the view itself needs, at most.
const ONE_OF: u64 = 10;

impl Selector {
    /// The pass over instances for shadows: by how many pixels chunks out of view displace them.
    ///
    /// The light carries a sphere away from the sun, down to the lowest instance in view; wherever on that way it reaches
    /// into the frustum, its shadow may fall. Costs another test for each chunk of what is out of view, where the instance's
    /// own sphere passes it.
    pub(super) fn look_for_shadows(
        &mut self,
        view: &View,
        to_sun: Vec3,
        threshold: f32,
        instances: Instances<'_>,
        assets: &[AssetState],
    ) {
        let (projection, picture) = (Projection::new(view), Picture::new(view));
        let floor_px = f64::from(threshold * self.settings.undo_below.get());
        let placed = |number: &u32| {
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
            let way = to_sun * -fall;
            let Some(depth) = projection.shadow_depth(center, radius, way) else { continue };
            let scale = f64::from(instance.scale);
            let px_of = |error: f32| projection.error_px(f64::from(error) * scale, depth) / SOFTNESS;
            let seen = &mut self.seen[instance.asset as usize];
            if px_of(asset.entry().root_error) < floor_px {
                continue;
            }
            #[expect(clippy::cast_possible_truncation, reason = "to the nearest f32")]
            if !projection.sees(center, radius) {
                seen.shadow_unknown_px = seen.shadow_unknown_px.max(px_of(asset.unknown_error()) as f32);
            }
            seen.casts = true;
            if asset.state(BlobPart::Base) != State::Applied {
                continue;
            }
            let local = projection.local(asset.entry(), instance);
            let way = instance.orientation().conjugate() * way / instance.scale;
            let seeks = &mut self.chunks[seen.first_chunk..];
            for (seek, chunk) in seeks.iter_mut().zip(asset.chunks()) {
                let Some(info) = chunk.as_ref().map(Chunk::info) else { continue };
                let Some([px, px_per_unit]) = local.shadow_px(&info.sphere, visible_error(info, 0.0), way)
                else {
                    continue;
                };
                #[expect(clippy::cast_possible_truncation, reason = "to the nearest f32")]
                let [px, px_per_unit] = [px / SOFTNESS, px_per_unit / SOFTNESS].map(|x| x as f32);
                seek.own_shadow_px = seek.own_shadow_px.max(px);
                seek.shadow_px = seek.own_shadow_px;
                let seen_px = px_per_unit * seen_error(info.error, info.attribute_error, 0.0);
                let whole = picture.shape_px2(seen_px, px_per_unit * info.sphere.radius);
                seek.difference_px2 += hidden(whole);
            }
        }
    }

    /// Passes what shadows need on to parents, finds how good they may be for their share of the bytes, and lets those
    /// chunks count as wanted.
    pub(super) fn admit_shadows(&mut self, threshold: f32, assets: &[AssetState]) {
        self.histogram.clear();
        self.histogram.resize(BINS, (0, 0));
        let (truncation_points, share) =
            (self.settings.truncation_points, self.settings.attribute_share.get());
        let (mut view_faces, mut view_bytes) = (0_u64, 0_u64);
        for (seen, asset) in self.seen.iter().zip(assets) {
            if !seen.visible && !seen.casts {
                continue;
            }
            let seeks = &mut self.chunks[seen.first_chunk..];
            for (index, chunk) in asset.chunks().iter().enumerate().rev() {
                let Some(info) = chunk.as_ref().map(Chunk::info) else { continue };
                let shadow_px = seeks[index].shadow_px;
                let is_viewed = seeks[index].error_px > threshold;
                for &parent in &info.parents {
                    let parent = &mut seeks[parent as usize];
                    parent.shadow_px = parent.shadow_px.max(shadow_px);
                    parent.inner |= is_viewed;
                }
                let (faces, bytes) = (u64::from(info.faces), u64::from(info.payload_bytes));
                if is_viewed {
                    let truncation =
                        if truncation_points { enough(info, &seeks[index], threshold, share) } else { None };
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
        let bytes_left = self.settings.max_bytes.saturating_sub(view_bytes).min(view_bytes / ONE_OF);
        let needed = threshold_within(&self.histogram, faces_left, bytes_left, threshold);
        // What displaces a shadow by what is needed counts as much as what displaces a surface by the threshold.
        let weight = threshold / needed;
        let least = threshold * self.settings.undo_below.get();
        for (seen, asset) in self.seen.iter_mut().zip(assets).filter(|(seen, _)| seen.casts) {
            let unknown_px = weight * seen.shadow_unknown_px;
            seen.pages_seen &= seen.unknown_px > threshold || unknown_px <= threshold;
            seen.unknown_px = seen.unknown_px.max(unknown_px);
            for seek in &mut self.chunks[seen.first_chunk..][..asset.chunks().len()] {
                let px = weight * seek.shadow_px;
                seek.shadow_only = seek.error_px <= threshold && px > threshold;
                if px > seek.error_px && px >= least {
                    seek.error_px = px;
                    seek.own_px = seek.own_px.max(weight * seek.own_shadow_px);
                }
            }
        }
    }
}
