//! Textures that assets share, as stated by scene pages: requested once, applied to all.

use std::collections::BTreeMap;

use lodestream_scene::blob::BlobId;
use lodestream_scene::description::AssetEntry;
use lodestream_select::AssetState;

/// Why an asset's list of shared textures is invalid.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub(crate) enum SharedTextureError {
    #[error("an asset shares a texture of a later asset")]
    LaterAsset,
    #[error("an asset shares a texture that its owner shares from another asset")]
    Chain,
}

/// Textures shared by several assets.
#[derive(Debug, Default)]
pub(crate) struct SharedTextures {
    /// By asset and texture that is requested: the others that share it.
    others: BTreeMap<(u32, u16), Vec<(u32, u16)>>,
}

impl SharedTextures {
    /// Adds the shared textures of asset `number`; `known` are the assets before it.
    ///
    /// # Errors
    /// The entry refers to a later asset or to a texture that is itself shared.
    pub(crate) fn add(
        &mut self,
        number: u32,
        entry: &AssetEntry,
        known: &[AssetState],
    ) -> Result<(), SharedTextureError> {
        for shared in &entry.shared {
            let first = (shared.asset, shared.of);
            let sent_as = if shared.asset == number {
                entry.sent_as(number, shared.of)
            } else {
                let owner = known.get(shared.asset as usize).ok_or(SharedTextureError::LaterAsset)?;
                owner.entry().sent_as(shared.asset, shared.of)
            };
            if sent_as != first {
                return Err(SharedTextureError::Chain);
            }
            self.others.entry(first).or_default().push((number, shared.texture));
        }
        Ok(())
    }

    /// All blobs with the bytes of a requested one, itself first.
    pub(crate) fn same(&self, id: BlobId) -> impl Iterator<Item = BlobId> + use<'_> {
        let image = id.asset().zip(id.part()).and_then(|(asset, part)| Some((asset, part, part.texture()?)));
        let others =
            image.and_then(|(asset, part, texture)| Some((self.others.get(&(asset, texture))?, part)));
        let others = others.into_iter().flat_map(|(others, part)| {
            let of = move |&(asset, texture): &(u32, u16)| BlobId::Asset {
                asset,
                part: part.with_texture(texture),
            };
            others.iter().map(of)
        });
        std::iter::once(id).chain(others)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use lodestream_scene::shared::SharedTexture;

    fn sharing(shared: &[(u16, u32, u16)]) -> AssetEntry {
        let of = |&(texture, asset, of): &(u16, u32, u16)| SharedTexture { texture, asset, of };
        AssetEntry { shared: shared.iter().map(of).collect(), ..AssetEntry::default() }
    }

    #[test]
    fn sharers_are_found_from_the_requested_texture() {
        let mut textures = SharedTextures::default();
        let entries = [sharing(&[]), sharing(&[(0, 0, 2)]), sharing(&[(1, 0, 2), (3, 2, 0)])];
        let mut known = Vec::new();
        for (number, entry) in (0..).zip(entries) {
            textures.add(number, &entry, &known).unwrap();
            known.push(AssetState::new(entry));
        }
        let same = |id| textures.same(id).collect::<Vec<_>>();
        let level = |asset, texture| BlobId::texture(asset, texture, 4);
        assert_eq!(same(level(0, 2)), [level(0, 2), level(1, 0), level(2, 1)]);
        assert_eq!(same(level(2, 0)), [level(2, 0), level(2, 3)]);
        assert_eq!(same(level(0, 0)), [level(0, 0)]);
        assert_eq!(same(BlobId::base(0)), [BlobId::base(0)]);
    }

    #[test]
    fn a_chain_of_shared_textures_is_an_error() {
        let mut textures = SharedTextures::default();
        let known = [AssetState::new(sharing(&[])), AssetState::new(sharing(&[(0, 0, 0)]))];
        assert!(textures.add(2, &sharing(&[(0, 1, 0)]), &known).is_err());
        assert!(textures.add(2, &sharing(&[(0, 7, 0)]), &known).is_err());
        assert!(textures.add(2, &sharing(&[(1, 0, 0), (2, 2, 1)]), &known).is_err());
        textures.add(2, &sharing(&[(0, 1, 1)]), &known).unwrap();
    }
}
