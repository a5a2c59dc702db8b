//! Detection of equal textures in a scene's assets, by fingerprint.

use std::collections::HashMap;

use lodestream_scene::description::{Fingerprint, ScenePage};
use lodestream_scene::shared::{MAX_SHARED_TEXTURES, SharedTexture};

/// Marks, in the pages' entries, textures that equal those of earlier assets. `textures` has the fingerprints for each of
/// the scene's assets, `asset_order` maps asset numbers to them.
pub(super) fn share_textures(
    pages: &mut [ScenePage],
    asset_order: &[usize],
    textures: &[Vec<(u16, Fingerprint)>],
) {
    let mut first: HashMap<Fingerprint, (u32, u16)> = HashMap::new();
    let entries = pages.iter_mut().flat_map(|page| &mut page.assets);
    for ((number, entry), &asset) in (0..).zip(entries).zip(asset_order) {
        for &(texture, contents) in textures.get(asset).into_iter().flatten() {
            match first.get(&contents) {
                Some(&(asset, of)) if entry.shared.len() < MAX_SHARED_TEXTURES => {
                    entry.shared.push(SharedTexture { texture, asset, of });
                }
                Some(_) => {}
                None => drop(first.insert(contents, (number, texture))),
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use lodestream_scene::description::AssetEntry;

    #[test]
    fn equal_textures_refer_to_the_first_of_them() {
        let page = |first_asset, count| ScenePage {
            first_asset,
            assets: vec![AssetEntry::default(); count],
            ..ScenePage::default()
        };
        let mut pages = [page(0, 2), page(2, 1)];
        // Asset 0 of the scene file has no instance.
        let numbered = |contents: &[u8]| (0..).zip(contents.iter().map(|&byte| [byte; 16])).collect();
        let textures = [&[9][..], &[1, 2], &[3, 2], &[2, 9, 3]].map(numbered);
        share_textures(&mut pages, &[2, 1, 3], &textures);
        let shared = |texture, asset, of| SharedTexture { texture, asset, of };
        assert_eq!(pages[0].assets[0].shared, []);
        assert_eq!(pages[0].assets[1].shared, [shared(1, 0, 1)]);
        assert_eq!(pages[1].assets[0].shared, [shared(0, 0, 1), shared(2, 0, 0)]);
        for page in &pages {
            page.check().unwrap();
        }
    }

    #[test]
    fn textures_beyond_the_sharing_limit_are_sent_per_asset() {
        let many: Vec<(u16, Fingerprint)> = (0..40_u8).map(|at| (at.into(), [at; 16])).collect();
        let mut page = ScenePage { assets: vec![AssetEntry::default(); 2], ..ScenePage::default() };
        share_textures(std::slice::from_mut(&mut page), &[0, 1], &[many.clone(), many]);
        assert_eq!(page.assets[1].shared.len(), MAX_SHARED_TEXTURES);
        page.check().unwrap();
    }
}
