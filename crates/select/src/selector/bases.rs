//! The lists of base meshes, index pages and texture levels.

use super::{AssetOnScreen, Selector};
use crate::difference::Picture;
use crate::priority::{Priority, base_priority, prefetch_priority};
use crate::selection::{Selection, State, Wanted};
use crate::state::AssetState;
use crate::textures::{WantedLevel, texels_of};
use lodestream_scene::blob::{BlobId, BlobPart};

impl Selector {
    /// Lists the base mesh of an asset with instances, and its index pages while chunks on unknown pages may be wanted.
    /// `beyond_px` gives the largest radius on the screen of instances that were not evaluated.
    pub(super) fn want_base_and_pages(
        &mut self,
        number: u32,
        asset: &AssetState,
        threshold: f32,
        picture: &Picture,
        beyond_px: impl Fn() -> f32,
    ) {
        let mut on_screen = self.on_screen[number as usize];
        let wants_pages = (on_screen.visible || on_screen.casts_shadow)
            && asset.state(BlobPart::Base) != State::Failed
            && on_screen.unknown_px > threshold
            && asset.known_pages() < asset.entry().index_pages();
        if wants_pages || asset.state(BlobPart::Base) != State::Applied {
            on_screen.coverage_px = on_screen.coverage_px.max(beyond_px());
        }
        let Selection { wanted, failed, .. } = &mut self.selection;
        let mut want = |part: BlobPart, priority: Priority| {
            let id = BlobId::Asset { asset: number, part };
            match asset.state(part) {
                State::Applied => {}
                State::Failed if on_screen.visible => failed.push(id),
                State::Failed => {}
                state => wanted.push(Wanted::whole(id, priority, asset.blob_bytes(part), state)),
            }
        };
        if on_screen.visible {
            want(BlobPart::Base, base_priority(on_screen.coverage_px, on_screen.foveation));
        } else if on_screen.casts_shadow || (on_screen.placed && self.settings.prefetch_bases) {
            want(BlobPart::Base, prefetch_priority(on_screen.coverage_px));
        }
        let pages = asset.entry().index_pages();
        if wants_pages {
            // On a surface, the error falls with the square root of the number of chunks. Doubling the number of
            // known pages makes the number of round trips logarithmic. Pages up to an octave below the threshold are
            // wanted too, at lower priority: the bound on unknown errors is often just above the threshold up to the
            // last page, and these pages would otherwise come one per round trip.
            let known = asset.known_pages();
            for page in known..pages.min(known.saturating_mul(2).saturating_add(2)) {
                #[expect(clippy::cast_precision_loss, reason = "an asset has at most 2^16 pages")]
                let expected_px = on_screen.unknown_px * ((known + 1) as f32 / (page + 1) as f32).sqrt();
                if page > known && expected_px <= threshold / 2.0 {
                    break;
                }
                let priority =
                    picture.page_priority(expected_px, on_screen.coverage_px, on_screen.pages_visible);
                want(BlobPart::IndexPage(page), priority);
            }
        }
    }

    /// Lists the next levels of textures while a texel of the last one covers more than a pixel.
    pub(super) fn want_textures(
        &mut self,
        number: u32,
        asset: &AssetState,
        threshold: f32,
        picture: &Picture,
    ) {
        let on_screen = self.on_screen[number as usize];
        if !on_screen.is_drawn || asset.state(BlobPart::Base) != State::Applied {
            return;
        }
        self.want_texture_regions(number, asset, threshold, picture);
        for (texture, info) in (0..).zip(asset.textures()) {
            let px_per_uv = on_screen.px_per_unit / info.uv_per_unit.max(f32::MIN_POSITIVE);
            let mut texel_px = px_per_uv.min(f32::MAX);
            let mut pending = 0;
            for (level, (about, state)) in (0..).zip(&info.levels) {
                if texel_px <= threshold.max(1.0) || pending == 2 {
                    break;
                }
                let id = asset.entry().sent_blob(number, BlobPart::Texture { texture, level });
                if *state != State::Applied {
                    pending += 1;
                    let weight = self.settings.texture_weight.get();
                    let difference_px2 = picture.texture_px2(texel_px, on_screen.visible_px, weight);
                    let (asset, bytes, texels, state) = (number, about.bytes, texels_of(about), *state);
                    let AssetOnScreen { foveation, .. } = on_screen;
                    let level = WantedLevel { id, asset, bytes, texels, state, difference_px2, foveation };
                    self.textures.add_level(level);
                    if state == State::Failed {
                        break;
                    }
                }
                #[expect(clippy::cast_precision_loss, reason = "sides of textures are small")]
                let texels = about.width.max(about.height).max(1) as f32;
                texel_px = px_per_uv / texels;
            }
        }
    }
}
