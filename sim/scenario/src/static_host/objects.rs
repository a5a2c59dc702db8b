//! A scene published into memory.

use std::collections::BTreeMap;

use anyhow::Context as _;
use bytes::Bytes;
use lodestream_client::ranges::Object;
use lodestream_geometry::index::{CHUNKS_PER_PAGE, decode_stated_page};
use lodestream_protocol::source::SceneSource;
use lodestream_scene::published::{
    ChunkPlace, ChunkTable, Contents, IndexPage, PackContents, Texture, TexturePlace, part_hash,
};
use lodestream_scene::{BlobId, BlobPart};

/// Longest texture level that the published scene has a copy of, and levels of which it may; as a store publishes.
const MAX_COPY_BYTES: usize = 2048;
const COPIED_LEVELS: u8 = 2;

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
        let bytes = read(BlobPart::IndexPage(page))?;
        let first = page * u32::try_from(CHUNKS_PER_PAGE)?;
        let mut table = ChunkTable { offset: pack.len() as u64, chunks: Vec::new() };
        for (chunk, info) in (first..).zip(&decode_stated_page(&bytes, first)?.chunks) {
            let bytes = read(BlobPart::Chunk(chunk))?;
            pack.extend_from_slice(&bytes);
            let place = ChunkPlace::of(info).hashed(&bytes);
            table.chunks.push(place.context("a chunk is not as long as its index page says")?);
        }
        contents.index.push(IndexPage { bytes, chunks: table });
    }
    contents.textures_offset = pack.len() as u64;
    for texture in 0.. {
        let levels = (0..)
            .map_while(|level| read(BlobPart::Texture { texture, level }).ok().map(|bytes| (level, bytes)));
        let before = contents.textures.len();
        for (level, bytes) in levels {
            pack.extend_from_slice(&bytes);
            let place =
                TexturePlace { texture, level, bytes: u32::try_from(bytes.len())?, hash: part_hash(&bytes) };
            let copied = level < COPIED_LEVELS && bytes.len() <= MAX_COPY_BYTES;
            contents.textures.push(Texture { place, copy: copied.then_some(bytes) });
        }
        if contents.textures.len() == before {
            break;
        }
    }
    contents.bytes = pack.len() as u64;
    contents.key = *blake3::hash(&[&asset.to_le_bytes()[..], &pack].concat()).as_bytes();
    Ok((pack.into(), contents))
}
