//! What is wanted of an asset beside its chunks: its base mesh, its index and its textures.

use super::{Seen, Selector};
use crate::difference::Picture;
use crate::priority::{Priority, base_priority, prefetch_priority};
use crate::selection::{Selection, State, Wanted};
use crate::state::AssetState;
use crate::textures::SoughtLevel;
use lodestream_scene::blob::{BlobId, BlobPart};

impl Selector {
    /// Base meshes of what is placed, and index pages of what is in view while something behind them may be wanted. How
    /// large instances are on the screen that were not looked at, `beyond_px` says.
    pub(super) fn want_base_and_pages(
        &mut self,
        number: u32,
        asset: &AssetState,
        threshold: f32,
        picture: &Picture,
        beyond_px: impl Fn() -> f32,
    ) {
        let mut seen = self.seen[number as usize];
        let seeks_pages = (seen.visible || seen.casts)
            && asset.state(BlobPart::Base) != State::Failed
            && seen.unknown_px > threshold
            && asset.known_pages() < asset.entry().index_pages();
        if seeks_pages || asset.state(BlobPart::Base) != State::Applied {
            seen.coverage_px = seen.coverage_px.max(beyond_px());
        }
        let Selection { wanted, failed, .. } = &mut self.selection;
        let mut want = |part: BlobPart, priority: Priority| {
            let id = BlobId::Asset { asset: number, part };
            match asset.state(part) {
                State::Applied => {}
                State::Failed if seen.visible => failed.push(id),
                State::Failed => {}
                state => wanted.push(Wanted::whole(id, priority, asset.blob_bytes(part), state)),
            }
        };
        if seen.visible {
            want(BlobPart::Base, base_priority(seen.coverage_px, seen.foveation));
        } else if seen.casts || (seen.placed && self.settings.prefetch_bases) {
            want(BlobPart::Base, prefetch_priority(seen.coverage_px));
        }
        let pages = asset.entry().index_pages();
        if seeks_pages {
            // On a surface, the error falls with the square root of the number of chunks. Asking for as
            // many pages again as are known makes the number of round trips logarithmic. That is done an octave
            // beyond the threshold, less urgently: the error of what is unknown is a bound, which often stands just above
            // the threshold up to the last page, and these would come one a round trip.
            let known = asset.known_pages();
            for page in known..pages.min(known.saturating_mul(2).saturating_add(2)) {
                #[expect(clippy::cast_precision_loss, reason = "an asset has at most 2^16 pages")]
                let expected_px = seen.unknown_px * ((known + 1) as f32 / (page + 1) as f32).sqrt();
                if page > known && expected_px <= threshold / 2.0 {
                    break;
                }
                let priority = picture.page_priority(expected_px, seen.coverage_px, seen.pages_seen);
                want(BlobPart::IndexPage(page), priority);
            }
        }
    }

    /// A texture's next level is wanted while a texel of the last one covers more than a pixel.
    pub(super) fn want_textures(
        &mut self,
        number: u32,
        asset: &AssetState,
        threshold: f32,
        picture: &Picture,
    ) {
        let seen = self.seen[number as usize];
        if !seen.visible || asset.state(BlobPart::Base) != State::Applied {
            return;
        }
        for (texture, info) in (0..).zip(asset.textures()) {
            let px_per_uv = seen.px_per_unit / info.uv_per_unit.max(f32::MIN_POSITIVE);
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
                    let difference_px2 = picture.texture_px2(texel_px, seen.visible_px, weight);
                    let (asset, bytes, state) = (number, about.bytes, *state);
                    let Seen { foveation, .. } = seen;
                    let level = SoughtLevel { id, asset, bytes, state, difference_px2, foveation };
                    self.textures.seek(level);
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
