//! The pass over visible instances: screen errors and visible differences of all chunks, and the error of the picture.

use lodestream_geometry::screen::{visible_error, visible_error_at};

use super::{Drawn, Selector};
use crate::cut::Placed as CutPart;
use crate::difference::{Picture, difference_error};
use crate::instance_tree::{Instances, TreeQuery};
use crate::priority::hidden;
use crate::project::Projection;
use crate::selection::State;
use crate::state::{AssetState, Chunk};
use crate::visibility::Placed;
use lodestream_scene::blob::BlobPart;
use lodestream_scene::description::Instance;
use lodestream_scene::view::View;

/// Least visible share of a region for the visible screen error: a hundredth of its disc. Shares are square roots of
/// areas.
const MIN_VISIBLE_SHARE: f32 = 0.1;

/// Upper bound on the screen error of all visible parts with the applied blobs, in pixels; infinite while a visible
/// instance lacks its base mesh. TTQ is measured by it.
#[must_use]
pub fn max_screen_error_px(view: &View, instances: &[Instance], assets: &[AssetState]) -> f64 {
    let projection = Projection::new(view);
    let mut worst = 0.0_f64;
    for instance in instances {
        let Some(asset) = assets.get(instance.asset as usize) else { continue };
        let bounds = projection.bounds(asset.entry(), instance);
        if !bounds.visible {
            continue;
        }
        if asset.state(BlobPart::Base) != State::Applied {
            return f64::INFINITY;
        }
        let scale = f64::from(instance.placement.scale);
        worst = worst.max(projection.error_px(f64::from(asset.unknown_error()) * scale, bounds.depth));
        let local = projection.local(asset.entry(), instance);
        for chunk in asset.chunks().iter().flatten().filter(|chunk| chunk.state() != State::Applied) {
            let error = remaining_error(chunk, 1.0);
            worst = local.error_px(&chunk.info().sphere, error).map_or(worst, |(px, _)| worst.max(px));
        }
    }
    worst
}

/// Visible error that remains while a chunk is not applied, or only up to a truncation point, in the asset's units.
pub(super) fn remaining_error(chunk: &Chunk, share: f32) -> f32 {
    let info = chunk.info();
    match chunk.truncation() {
        Some(truncation) => visible_error_at(info, &info.extent(Some(truncation)), share),
        None => visible_error(info, share),
    }
}

impl Selector {
    /// Evaluates all visible instances: screen errors of chunks, and the error of the picture. Returns whether something has
    /// become as fine as the root that is drawn instead.
    pub(super) fn evaluate(
        &mut self,
        view: &View,
        instances: Instances<'_>,
        assets: &[AssetState],
        in_use: (u64, u64),
    ) -> bool {
        let (projection, picture) = (Projection::new(view), Picture::new(view));
        instances.find(&TreeQuery::in_view(&projection), &mut self.nearby);
        for (number, on_screen) in (0..).zip(&mut self.on_screen) {
            on_screen.placed = instances.proxies().is_none() && instances.places(number);
        }
        let drawn = self.list_drawn(instances);
        let counters = &mut self.selection.counters;
        (counters.applied_faces, counters.applied_bytes) = in_use;
        let floor_px = f64::from(view.target_px * self.settings.undo_below.get());
        let (mut worst, mut worst_unoccluded) = (0.0_f64, 0.0_f64);
        // What is missing has no error yet.
        counters.visible_instances += self.cut.missing();
        if self.cut.missing() > 0 {
            (worst, worst_unoccluded) = (f64::INFINITY, f64::INFINITY);
        }
        let mut is_visibility_drawn = false;
        let mut fine = Vec::new();
        for &Drawn { ref instance, number, is_proxy, is_moved, is_held } in &drawn {
            let Some(asset) = assets.get(instance.asset as usize) else { continue };
            let on_screen = &mut self.on_screen[instance.asset as usize];
            on_screen.placed = true;
            let bounds = projection.bounds(asset.entry(), instance);
            on_screen.coverage_px = on_screen.coverage_px.max(bounds.coverage_px);
            if !bounds.visible {
                continue;
            }
            on_screen.visible = true;
            on_screen.is_drawn |= !is_held;
            on_screen.visible_px = on_screen.visible_px.max(bounds.coverage_px);
            if !is_proxy {
                self.textures.add_instance(number, instance.asset, bounds.coverage_px);
            }
            on_screen.foveation = on_screen.foveation.max(bounds.foveation);
            counters.visible_instances += 1;
            if asset.state(BlobPart::Base) == State::Applied {
                counters.drawable_instances += 1;
            } else {
                (worst, worst_unoccluded) = (f64::INFINITY, f64::INFINITY);
            }
            let held = is_held.then(|| {
                let entry = asset.entry();
                let center = instance.to_world(entry.origin, entry.sphere.center);
                let radius = entry.sphere.radius * instance.placement.scale;
                let limit = self.cut.hold_px(&projection, center, radius).max(self.threshold_px);
                (if is_proxy { CutPart::Proxy(number) } else { CutPart::Instance(number) }, limit)
            });
            // Largest error that is seen of it, in the middle of regions as that of roots.
            let mut seen_px = 0.0_f32;
            let unknown_middle_px = bounds.px_per_unit * asset.unknown_error() * instance.placement.scale;
            let scale = f64::from(instance.placement.scale);
            let px_of = |error: f32| projection.error_px(f64::from(error) * scale, bounds.depth);
            // The finest mesh of a proxy has an error of its own.
            let proxy_px = if is_proxy { f64::from(self.cut.error_px(number)) } else { 0.0 };
            let waits = is_proxy && self.cut.waits(number);
            let with_own = |px: f64| if px > 0.0 { px + proxy_px } else { 0.0 };
            let unknown_px = if waits { 0.0 } else { with_own(px_of(asset.unknown_error())) };
            worst = worst.max(unknown_px).max(proxy_px);
            // Visible shares are kept by number, and an instance has one.
            let tests_visibility =
                self.settings.hidden_last && asset.occluder().is_some() && !is_proxy && !is_moved;
            if unknown_px > floor_px && tests_visibility {
                if !std::mem::replace(&mut is_visibility_drawn, true) {
                    self.visibility.draw(view, self.travel, instances, assets);
                }
                let shown = self.visibility.shown(number, view, asset.entry(), instance);
                on_screen.pages_visible |= shown > 0.0;
                if shown > 0.0 {
                    worst_unoccluded = worst_unoccluded.max(unknown_px);
                    seen_px = unknown_middle_px;
                }
            } else {
                on_screen.pages_visible = true;
                seen_px = unknown_middle_px;
                worst_unoccluded = worst_unoccluded.max(unknown_px).max(proxy_px);
            }
            #[expect(clippy::cast_possible_truncation, reason = "to the nearest f32")]
            {
                on_screen.unknown_px = on_screen.unknown_px.max(unknown_px as f32);
                let px_per_unit = projection.px_per_unit(asset.entry(), instance, bounds.depth);
                on_screen.px_per_unit = on_screen.px_per_unit.max(px_per_unit as f32);
            }
            // No chunk's visible error exceeds the root error, and no sphere is nearer than the asset's.
            let root_px = with_own(px_of(asset.entry().root_error));
            if root_px < floor_px {
                (worst, worst_unoccluded) = (worst.max(root_px), worst_unoccluded.max(root_px));
                on_screen.far = true;
                fine.extend(held.map(|(placed, _)| placed));
                continue;
            }
            let local = projection.local(asset.entry(), instance);
            let share = self.settings.attribute_share.get();
            counters.tested_chunks += asset.chunks().len() as u64;
            self.projected.clear();
            self.projected.extend(asset.chunks().iter().map(|chunk| {
                let info = chunk.as_ref()?.info();
                let (px, foveation) = local.error_px(&info.sphere, visible_error(info, share))?;
                Some((with_own(px), foveation))
            }));
            self.shares.clear();
            self.shares.resize(asset.chunks().len(), 1.0);
            let projected = &self.projected;
            // Chunks that are applied or too small to be wanted need no occlusion test.
            let needs_test = |number: usize, chunk: &Chunk| {
                chunk.state() != State::Applied && projected[number].is_some_and(|(px, _)| px > floor_px)
            };
            let numbered = (0..).zip(asset.chunks());
            if tests_visibility
                && numbered
                    .filter_map(|(at, chunk)| Some((at, chunk.as_ref()?)))
                    .any(|(at, c)| needs_test(at, c))
            {
                if !std::mem::replace(&mut is_visibility_drawn, true) {
                    self.visibility.draw(view, self.travel, instances, assets);
                }
                let placed = Placed::new(view, asset.entry(), instance);
                self.visibility.shares(number, &placed, asset.chunks(), needs_test, &mut self.shares);
            }
            let evaluations = &mut self.chunks[on_screen.first_chunk..];
            let about = projected.iter().zip(&self.shares);
            for ((evaluation, chunk), (projected, &shown)) in
                evaluations.iter_mut().zip(asset.chunks()).zip(about)
            {
                let (Some(chunk), &Some((px, foveation))) = (chunk, projected) else { continue };
                let info = chunk.info();
                let error = visible_error(info, share);
                if chunk.state() != State::Applied {
                    let left = remaining_error(chunk, share);
                    let left_px = if left < error {
                        proxy_px + (px - proxy_px).max(0.0) * f64::from(left / error)
                    } else {
                        px
                    };
                    worst = worst.max(left_px);
                    if shown > MIN_VISIBLE_SHARE {
                        worst_unoccluded = worst_unoccluded.max(left_px);
                        // A chunk that cannot be had must not hold up the rest.
                        if chunk.state() != State::Failed {
                            seen_px = seen_px.max(local.px_per_unit(&info.sphere) * left);
                        }
                    }
                    if waits && chunk.extent_in_use().is_none() {
                        continue;
                    }
                }
                #[expect(clippy::cast_possible_truncation, reason = "to the nearest f32")]
                {
                    evaluation.own_px = evaluation.own_px.max(px as f32);
                    evaluation.error_px = evaluation.own_px;
                    // A bound uses the nearest point, which a region around the eye has everywhere; a difference is
                    // an estimate of what most of the region shows.
                    let px_per_unit = local.px_per_unit(&info.sphere);
                    let difference_error_px =
                        px_per_unit * difference_error(info.error, info.attribute_error, share);
                    let whole = picture.shape_px2(difference_error_px, px_per_unit * info.sphere.radius);
                    evaluation.difference_px2 += if shown > 0.0 { shown * whole } else { hidden(whole) };
                }
                evaluation.foveation = evaluation.foveation.max(foveation);
            }
            fine.extend(held.filter(|(_, limit)| seen_px <= *limit).map(|(placed, _)| placed));
        }
        counters.max_screen_error_px = worst;
        counters.unoccluded_screen_error_px = worst_unoccluded;
        self.drawn = drawn;
        fine.iter().for_each(|&placed| self.cut.set_fine(placed));
        !fine.is_empty()
    }

    /// The instances that may be in view and for which no proxy stands, and the proxies that are drawn.
    fn list_drawn(&mut self, instances: Instances<'_>) -> Vec<Drawn> {
        let mut drawn = std::mem::take(&mut self.drawn);
        drawn.clear();
        let placed = |number: u32, instance: Instance| Drawn {
            instance,
            number,
            is_proxy: false,
            is_moved: false,
            is_held: false,
        };
        let moved = self.moved.iter().filter_map(|&(number, to)| {
            let instance = instances.all().get(number as usize)?;
            let placement = to.within(&instance.placement);
            Some(Drawn { is_moved: true, ..placed(number, Instance { placement, ..*instance }) })
        });
        let Some(proxies) = instances.proxies() else {
            let of = |&number: &u32| placed(number, instances.all()[number as usize]);
            drawn.extend(self.nearby.numbers().iter().map(of).chain(moved));
            return drawn;
        };
        for &number in self.nearby.numbers().iter().filter(|number| !self.cut.covers(**number)) {
            drawn.push(placed(number, instances.all()[number as usize]));
        }
        drawn.extend(moved.filter(|moved| !self.cut.covers(moved.number)));
        for &number in &self.cut.cut().proxies {
            let asset = proxies.nodes()[number as usize].proxy.asset;
            let instance = Instance::at(asset, [0.0; 3]);
            drawn.push(Drawn { is_proxy: true, ..placed(number, instance) });
        }
        // What is held is refined until it is drawn.
        for &part in self.cut.held() {
            let of = match part {
                CutPart::Instance(number) => {
                    let instance = instances.all().get(number as usize);
                    instance.map(|instance| placed(number, *instance))
                }
                CutPart::Proxy(number) => {
                    let asset = proxies.nodes()[number as usize].proxy.asset;
                    Some(Drawn { is_proxy: true, ..placed(number, Instance::at(asset, [0.0; 3])) })
                }
            };
            drawn.extend(of.map(|of| Drawn { is_held: true, ..of }));
        }
        let uncovered = (0..).zip(instances.all()).filter(|(number, _)| !self.cut.covers(*number));
        for (_, instance) in uncovered {
            if let Some(on_screen) = self.on_screen.get_mut(instance.asset as usize) {
                on_screen.placed = true;
            }
        }
        drawn
    }
}
