//! What a published scene holds of a pack: base mesh, index pages, short textures, and where the rest lies.

use lodestream_geometry::DecodeError;
use lodestream_geometry::pack::BlobKind;
use lodestream_scene::published::{PackContents, PublishedError};
use lodestream_scene::{BlobPart, Tile};

use super::error::StoreError;
use super::file::PackFile;

impl PackFile {
    /// What a published scene holds of this pack. Reads all of it once. `key` is in the name of the pack's object.
    ///
    /// # Errors
    /// A blob that is missing, unreadable or damaged.
    pub fn published(&self, key: [u8; 32]) -> Result<PackContents, StoreError> {
        let base = self.read(BlobPart::Base)?;
        let mut contents = PackContents { key, bytes: self.total_bytes(), base, ..PackContents::default() };
        for entry in self.entries() {
            let read = || self.read_entry(entry);
            let added = match entry.kind {
                BlobKind::Base | BlobKind::Settings => Ok(()),
                BlobKind::IndexPage(_) => contents.add_index_page(read()?.into()),
                BlobKind::Chunk(chunk) => contents.add_chunk(chunk, entry.offset, &read()?),
                BlobKind::Texture { texture, level } => {
                    contents.add_texture(texture, level, entry.offset, read()?.into())
                }
                BlobKind::TextureRegions => {
                    contents.add_texture_regions(read()?.into());
                    Ok(())
                }
                BlobKind::Tile { texture, level, tile } => {
                    contents.add_tile(Tile { texture, level, tile }, entry.offset, &read()?)
                }
            };
            added.map_err(|why: PublishedError| self.damaged(DecodeError::new("pack", why.to_string())))?;
        }
        Ok(contents)
    }
}
