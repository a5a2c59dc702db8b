//! The table of a pack: kind, offset, length and hash of each blob. Its hash identifies the contents.

use std::ops::Range;

use lodestream_geometry::DecodeError;
use lodestream_geometry::pack::{BlobKind, Entry, HEAD_BYTES, Head, find};
use lodestream_scene::description::Fingerprint;
use lodestream_scene::{BlobPart, Tile};

/// Head and table of a pack.
#[derive(Debug)]
pub(super) struct Table {
    /// Head of the pack.
    pub(super) head: Head,
    pub(super) entries: Vec<Entry>,
    pub(super) fingerprint: Fingerprint,
    /// Length of the pack.
    pub(super) total_bytes: u64,
}

impl Table {
    /// Byte range of the table in a pack of `length` bytes.
    pub(super) fn range(head: &Head, length: u64) -> Result<Range<u64>, DecodeError> {
        let first = HEAD_BYTES as u64;
        let end = first.saturating_add(head.table_bytes() as u64);
        if end > length {
            return Err(DecodeError::new("pack", "the file ends within its table: it is truncated"));
        }
        Ok(first..end)
    }

    /// Parses and checks the table.
    pub(super) fn parse(head: Head, table: &[u8], length: u64) -> Result<Self, DecodeError> {
        let entries = head.parse_table(table, length)?;
        let end = entries.iter().map(|e| e.offset + u64::from(e.length)).max();
        if end.unwrap_or(HEAD_BYTES as u64) != length {
            return Err(DecodeError::new("pack", "bytes follow the last blob: the file is damaged"));
        }
        // The table holds the hash of every blob, so its own hash names the contents.
        let mut fingerprint = Fingerprint::default();
        fingerprint.copy_from_slice(&blake3::hash(table).as_bytes()[..16]);
        Ok(Self { head, entries, fingerprint, total_bytes: length })
    }

    /// The entry of a blob.
    pub(super) fn find(&self, part: BlobPart) -> Option<&Entry> {
        find(&self.entries, kind(part))
    }
}

/// A blob's name in messages.
pub(super) fn blob_name(part: BlobPart) -> String {
    match part {
        BlobPart::Base => "base mesh".into(),
        BlobPart::IndexPage(page) => format!("index page {page}"),
        BlobPart::Chunk(chunk) => format!("chunk {chunk}"),
        BlobPart::Texture { texture, level } => format!("level {level} of texture {texture}"),
        BlobPart::TextureRegions => "texture regions".into(),
        BlobPart::Tile(Tile { texture, level, tile }) => {
            format!("tile {tile} of level {level} of texture {texture}")
        }
    }
}

/// The kind of a pack's entry that holds a blob of the protocol.
pub(super) fn kind(part: BlobPart) -> BlobKind {
    match part {
        BlobPart::Base => BlobKind::Base,
        BlobPart::IndexPage(page) => BlobKind::IndexPage(page),
        BlobPart::Chunk(chunk) => BlobKind::Chunk(chunk),
        BlobPart::Texture { texture, level } => BlobKind::Texture { texture, level },
        BlobPart::TextureRegions => BlobKind::TextureRegions,
        BlobPart::Tile(Tile { texture, level, tile }) => BlobKind::Tile { texture, level, tile },
    }
}
