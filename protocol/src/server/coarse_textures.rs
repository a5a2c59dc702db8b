//! The coarsest levels of textures, which the server sends unasked among the first chunks.

use std::collections::BTreeMap;

use super::refinement::Refining;
use crate::source::SceneSource;
use lodestream_scene::blob::{BlobId, BlobPart};
use lodestream_scene::description::InstanceEntry;
use lodestream_scene::view::View;
use lodestream_select::difference::Picture;
use lodestream_select::priority::refine_priority;
use lodestream_select::textures::ShownArea;
use lodestream_select::visibility::Visibility;
use lodestream_select::{AssetState, Projection, SelectSettings};

/// Most textures of an asset of which something is pushed.
const MAX_TEXTURES: u16 = 8;
/// Levels that are pushed of each, from the coarsest on: some hundred bytes together.
pub(super) const COARSE_LEVELS: u8 = 2;
/// Least radius of an asset on the screen whose textures are pushed, in pixels: with less, the mean colour may do.
const LEAST_TEXTURED_PX: f32 = 32.0;

/// What the instances of an asset in view add up to.
#[derive(Clone, Copy, Debug, Default)]
struct Seen {
    coverage_px: f32,
    foveation: f32,
    area: ShownArea,
}

/// The coarsest levels of the textures of what is visible, most urgent first, what something hides last. What they are of
/// and how dense, the server does not know: all count as blurs.
pub(super) fn coarse_textures(
    source: &dyn SceneSource,
    view: &View,
    settings: &SelectSettings,
    visibility: &Visibility,
    (numbers, instances, assets): (&[u32], &[InstanceEntry], &[AssetState]),
) -> Vec<Refining> {
    let (projection, picture) = (Projection::new(view), Picture::new(view));
    let mut seen = vec![Seen::default(); assets.len()];
    for (number, instance) in (0..).zip(instances) {
        let (Some(asset), Some(seen)) =
            (assets.get(instance.asset as usize), seen.get_mut(instance.asset as usize))
        else {
            continue;
        };
        let bounds = projection.bounds(asset.entry(), instance);
        if bounds.visible {
            let shown = visibility.shown(number, view, asset.entry(), instance);
            seen.area.add(picture.surface_px2(bounds.coverage_px), shown);
            seen.coverage_px = seen.coverage_px.max(bounds.coverage_px);
            seen.foveation = seen.foveation.max(bounds.foveation);
        }
    }
    // What several assets have in common makes the sum of the differences that it makes to each.
    let mut levels: BTreeMap<BlobId, (u32, f32, f32)> = BTreeMap::new();
    for ((&number, asset), Seen { coverage_px, foveation, area }) in
        numbers.iter().zip(assets).zip(seen).filter(|(_, seen)| seen.coverage_px >= LEAST_TEXTURED_PX)
    {
        let whole = picture.texture_px2(f32::MAX, coverage_px, settings.texture_weight.get());
        let difference_px2 = area.weigh(whole);
        for part in (0..MAX_TEXTURES)
            .flat_map(|texture| (0..COARSE_LEVELS).map(move |level| BlobPart::Texture { texture, level }))
        {
            let id = asset.entry().sent_blob(number, part);
            let Some(bytes) = source.blob_len(&id) else { continue };
            let level = levels.entry(id).or_insert((bytes, 0.0, 0.0));
            (level.1, level.2) = (level.1 + difference_px2, level.2.max(foveation));
        }
    }
    #[expect(clippy::cast_precision_loss, reason = "a priority needs no more of a length than 24 bits")]
    let of = |(id, (bytes, difference_px2, foveation)): (BlobId, (u32, f32, f32))| Refining {
        priority: refine_priority(difference_px2, bytes as f32, foveation),
        id,
        end: None,
    };
    let mut out: Vec<Refining> = levels.into_iter().map(of).collect();
    out.sort_by_key(|level| std::cmp::Reverse(level.priority));
    out
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use crate::testing::MemoryScene;
    use lodestream_select::Occluder;
    use lodestream_select::priority::is_hidden;

    fn flat(entry: &lodestream_scene::description::AssetEntry, half: f32) -> AssetState {
        let corners = [[-half, 0.0, -half], [half, 0.0, -half], [half, 0.0, half], [-half, 0.0, half]];
        let mut asset = AssetState::new(entry.clone());
        asset.set_occluder(Arc::new(Occluder::new(corners.to_vec(), vec![[0, 1, 2], [0, 2, 3]])));
        asset
    }

    #[test]
    fn textures_under_a_roof_were_pushed_before_what_is_seen() {
        let mut scene = MemoryScene::new(2, 1, 2);
        Arc::get_mut(&mut scene).unwrap().texture_levels = 4;
        let [floor, roof] = [0, 1].map(|asset| &scene.pages[0].assets[asset]);
        let assets = [flat(floor, 1.0), flat(roof, 2.5)];
        let view = View::look_at([0.0, 12.0, 0.5], [0.0; 3], [0.0, 1.0, 0.0], 0.9, [1280, 720]);
        let hidden = |height: f64| {
            let instances = [InstanceEntry::at(0, [0.0; 3]), InstanceEntry::at(1, [0.0, height, 0.0])];
            let mut visibility = Visibility::default();
            visibility.draw(&view, 0.0, instances[..].into(), &assets);
            let known = (&[0, 1][..], &instances[..], &assets[..]);
            let levels = coarse_textures(&*scene, &view, &SelectSettings::default(), &visibility, known);
            let hidden = |asset| {
                let mut of = levels.iter().filter(|level| level.id.asset() == Some(asset)).peekable();
                assert!(of.peek().is_some());
                of.all(|level| is_hidden(level.priority))
            };
            [hidden(0), hidden(1)]
        };
        assert_eq!(hidden(3.0), [true, false]);
        assert_eq!(hidden(-3.0), [false, false], "a cellar, larger than what is above it");
    }
}
