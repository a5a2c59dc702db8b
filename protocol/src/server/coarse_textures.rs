//! The coarsest levels of textures, which the server pushes among the first chunks.

use std::collections::BTreeMap;

use super::pushed_blob::PushedBlob;
use crate::source::SceneSource;
use lodestream_scene::blob::{BlobId, BlobPart};
use lodestream_scene::description::Instance;
use lodestream_scene::view::View;
use lodestream_select::difference::Picture;
use lodestream_select::priority::refine_priority;
use lodestream_select::textures::ShownArea;
use lodestream_select::visibility::Visibility;
use lodestream_select::{AssetState, Projection, SelectSettings};

/// Most textures of an asset of which levels are pushed.
const MAX_TEXTURES: u16 = 8;
/// Levels pushed per texture, from the coarsest on: some hundred bytes together.
pub(super) const COARSE_LEVELS: u8 = 2;
/// Least radius of an asset on the screen whose textures are pushed, in pixels. Smaller ones are drawn in the mean
/// colour.
const MIN_TEXTURED_RADIUS_PX: f32 = 32.0;

/// Sums and maxima over the visible instances of an asset.
#[derive(Clone, Copy, Debug, Default)]
struct AssetOnScreen {
    coverage_px: f32,
    foveation: f32,
    area: ShownArea,
}

/// The coarsest texture levels of visible assets, most urgent first, those of hidden assets last. The server does not
/// decode asset descriptions, so it knows neither kind nor density of a texture: each counts as a difference of the
/// mean colour.
pub(super) fn coarse_textures(
    source: &dyn SceneSource,
    view: &View,
    settings: &SelectSettings,
    visibility: &Visibility,
    (numbers, instances, assets): (&[u32], &[Instance], &[AssetState]),
) -> Vec<PushedBlob> {
    let (projection, picture) = (Projection::new(view), Picture::new(view));
    let mut on_screen = vec![AssetOnScreen::default(); assets.len()];
    for (number, instance) in (0..).zip(instances) {
        let (Some(asset), Some(sum)) =
            (assets.get(instance.asset as usize), on_screen.get_mut(instance.asset as usize))
        else {
            continue;
        };
        let bounds = projection.bounds(asset.entry(), instance);
        if bounds.visible {
            let shown = visibility.shown(number, view, asset.entry(), instance);
            sum.area.add(picture.surface_px2(bounds.coverage_px), shown);
            sum.coverage_px = sum.coverage_px.max(bounds.coverage_px);
            sum.foveation = sum.foveation.max(bounds.foveation);
        }
    }
    // The benefit of a shared texture is the sum over its assets.
    let mut levels: BTreeMap<BlobId, (u32, f32, f32)> = BTreeMap::new();
    for ((&number, asset), AssetOnScreen { coverage_px, foveation, area }) in
        numbers.iter().zip(assets).zip(on_screen).filter(|(_, sum)| sum.coverage_px >= MIN_TEXTURED_RADIUS_PX)
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
    let of = |(id, (bytes, difference_px2, foveation)): (BlobId, (u32, f32, f32))| PushedBlob {
        priority: refine_priority(difference_px2, bytes as f32, foveation),
        id,
        end: None,
    };
    let mut out: Vec<PushedBlob> = levels.into_iter().map(of).collect();
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
    fn textures_of_hidden_assets_come_last() {
        let mut scene = MemoryScene::new(2, 1, 2);
        Arc::get_mut(&mut scene).unwrap().texture_levels = 4;
        let [floor, roof] = [0, 1].map(|asset| &scene.pages[0].assets[asset]);
        let assets = [flat(floor, 1.0), flat(roof, 2.5)];
        let view = View::look_at([0.0, 12.0, 0.5], [0.0; 3], [0.0, 1.0, 0.0], 0.9, [1280, 720]);
        let hidden = |height: f64| {
            let instances = [Instance::at(0, [0.0; 3]), Instance::at(1, [0.0, height, 0.0])];
            let mut visibility = Visibility::default();
            visibility.draw(&view, 0.0, instances[..].into(), &assets);
            let visible = (&[0, 1][..], &instances[..], &assets[..]);
            let levels = coarse_textures(&*scene, &view, &SelectSettings::default(), &visibility, visible);
            let hidden = |asset| {
                let mut of = levels.iter().filter(|level| level.id.asset() == Some(asset)).peekable();
                assert!(of.peek().is_some());
                of.all(|level| is_hidden(level.priority))
            };
            [hidden(0), hidden(1)]
        };
        assert_eq!(hidden(3.0), [true, false]);
        assert_eq!(hidden(-3.0), [false, false], "a surface below the floor hides nothing");
    }
}
