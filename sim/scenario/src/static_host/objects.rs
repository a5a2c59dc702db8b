//! A scene published into memory.

use std::collections::BTreeMap;

use bytes::Bytes;
use lodestream_client::ranges::Object;
use lodestream_protocol::source::SceneSource;
use lodestream_scene::asset::MAX_TEXTURE_LEVELS;
use lodestream_scene::published::{Contents, PackContents};
use lodestream_scene::{BlobId, BlobPart, Tile};

/// Objects of a published scene.
#[derive(Debug)]
pub(super) struct Objects {
    scene: Bytes,
    packs: BTreeMap<[u8; 32], Bytes>,
}

impl Objects {
    pub(super) fn get(&self, object: &Object) -> Option<&Bytes> {
        match object {
            Object::Scene => Some(&self.scene),
            Object::Pack(key, _) => self.packs.get(key),
        }
    }

    /// Publishes a scene.
    pub(super) fn publish(scene: &dyn SceneSource) -> anyhow::Result<Self> {
        let header = scene.header().clone();
        let pages: Vec<_> = (0..header.page_count).map_while(|page| scene.page(page)).collect();
        let (mut packs, mut contents) = (BTreeMap::new(), Vec::new());
        for page in &pages {
            for (asset, entry) in (page.first_asset..).zip(&page.assets) {
                let (pack, of) = pack(scene, asset, entry.index_pages())?;
                packs.insert(of.key, pack);
                contents.push(of);
            }
        }
        let listed = |id: fn(u32) -> BlobId| -> anyhow::Result<Vec<Bytes>> {
            let ids = (0..).map(id).take_while(|id| scene.blob_len(id).is_some());
            ids.map(|id| Ok(scene.read(&id)?)).collect()
        };
        let contents = Contents {
            terrain_directory: listed(BlobId::terrain_page)?,
            height_overrides: listed(BlobId::height_overrides)?,
            punctual_lights: scene.punctual_lights().cloned(),
            light_directory: listed(BlobId::punctual_light_directory)?,
            light_pages: listed(BlobId::punctual_light_page)?,
            parts: scene.parts(),
            part_directory: listed(BlobId::part_directory)?,
            part_pages: listed(BlobId::part_page)?,
            animations: listed(BlobId::Animation)?,
            header,
            pages: pages.iter().map(|page| (**page).clone()).collect(),
            packs: contents,
        };
        Ok(Self { scene: contents.encode()?.into(), packs })
    }
}

/// The pack of an asset, and what the published scene holds of it.
fn pack(scene: &dyn SceneSource, asset: u32, index_pages: u32) -> anyhow::Result<(Bytes, PackContents)> {
    let read = |part| scene.read(&BlobId::Asset { asset, part });
    let mut pack = Vec::new();
    let mut contents = PackContents { base: read(BlobPart::Base)?, ..PackContents::default() };
    for page in 0..index_pages {
        contents.add_index_page(read(BlobPart::IndexPage(page))?)?;
    }
    let count = contents.index.iter().map(|page| page.chunks.chunks.len()).sum::<usize>();
    for chunk in 0..u32::try_from(count)? {
        let bytes = read(BlobPart::Chunk(chunk))?;
        contents.add_chunk(chunk, pack.len() as u64, &bytes)?;
        pack.extend_from_slice(&bytes);
    }
    let has = |texture, level| scene.blob_len(&BlobId::texture(asset, texture, level)).is_some();
    for texture in (0..).take_while(|texture| has(*texture, 0)) {
        for level in (0..).take_while(|level| has(texture, *level)) {
            let bytes = read(BlobPart::Texture { texture, level })?;
            contents.add_texture(texture, level, pack.len() as u64, bytes.clone())?;
            pack.extend_from_slice(&bytes);
        }
    }
    let regions = BlobId::texture_regions(asset);
    if scene.blob_len(&regions).is_some() {
        contents.add_texture_regions(scene.read(&regions)?);
        let has = |tile| scene.blob_len(&BlobId::tile(asset, tile)).is_some();
        let first = |texture, level| Tile { texture, level, tile: 0 };
        let count = contents.textures.last().map_or(0, |last| last.place.texture + 1);
        let most = u8::try_from(MAX_TEXTURE_LEVELS)?;
        let levels = (0..count).flat_map(|texture| (0..most).map(move |level| first(texture, level)));
        for first in levels.filter(|first| has(*first)) {
            for tile in (0..).map(|tile| Tile { tile, ..first }).take_while(|tile| has(*tile)) {
                let bytes = read(BlobPart::Tile(tile))?;
                contents.add_tile(tile, pack.len() as u64, &bytes)?;
                pack.extend_from_slice(&bytes);
            }
        }
    }
    contents.bytes = pack.len() as u64;
    contents.key = *blake3::hash(&[&asset.to_le_bytes()[..], &pack].concat()).as_bytes();
    Ok((pack.into(), contents))
}
