//! The published scene: one object with the description of a scene and everything that a first frame needs, read whole
//! by a daemon, or in ranges by a client from any web server. Chunks and textures stay in packs beside it.
//!
//! docs/formats.md specifies the layout. In short: a head, an *opening* that lists the *parts* of the rest, and the
//! parts. A part is a run of bytes with a hash, so that a reader can check each by itself. What a client needs first
//! comes first.
//!
//! | module | contents |
//! |---|---|
//! | `part` | a run of bytes and its hash |
//! | `tables` | lengths and hashes of adjacent blobs, and of a pack's chunks |
//! | `opening` | head and opening |
//! | `records` | a scene page with the places of its base meshes; the packs of its assets |
//! | `contents`, `write`, `read` | the whole object |
//! | `compose` | what it holds of a pack, collected in the pack's order |

mod compose;
mod contents;
mod opening;
mod part;
mod read;
mod records;
mod tables;
#[cfg(test)]
mod tests;
mod write;

pub use contents::{Contents, IndexPage, PackContents, Texture, Tiles};
pub use opening::{
    HEAD_BYTES, Head, MAX_OPENING_BYTES, Opening, PART_PAGES_PER_TABLE, PagePlace, PartPlaces, VERSION,
};
pub use part::{HASH_BYTES, Part, PartHash, part_hash};
pub use records::{AssetSource, Behind, IndexPlace, PageRecord, SourceRecord, TexturePlace, pack_name};
pub use tables::{
    BlobTable, ChunkPlace, ChunkTable, SegmentHash, TileLevel, TilePlace, TileTable, segment_hash,
};

use crate::encoding::CodingError;

/// Longest published scene, in bytes: a million instances take 40 MB.
pub const MAX_OBJECT_BYTES: u64 = 512 << 20;

/// Why bytes are not a published scene. The text completes "it is not usable: …".
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum PublishedError {
    /// Other first bytes.
    #[error("it is not a published scene")]
    OtherFile,
    /// Another layout.
    #[error("it has version {0}, and this program reads version {VERSION}: publish the scene again")]
    Version(u16),
    /// The object ends before a part that it lists.
    #[error("it ends within {0}: it is truncated")]
    Truncated(&'static str),
    /// A part's bytes do not have the stated hash.
    #[error("the hash of {0} does not match: it is damaged, or was changed while it was read")]
    Hash(&'static str),
    /// A part does not decode.
    #[error("{what}: {why}")]
    Record {
        /// The part.
        what: &'static str,
        /// Why.
        why: CodingError,
    },
    /// Parts contradict one another.
    #[error("{0}")]
    Contradiction(&'static str),
    /// Longer than [`MAX_OBJECT_BYTES`], or an opening longer than [`MAX_OPENING_BYTES`].
    #[error("it is longer than published scenes can be")]
    TooLong,
}
