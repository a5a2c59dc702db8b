//! What the parts of a scene are called: name, path and extras of every placed mesh of its files, and where it is there.
//!
//! A part is named by its instance and its number within the instance: the index among the members of a batch, else 0.
//! Parts have *records*, on pages of [`RECORDS_PER_PAGE`]; instances of one model share records. A directory tells which
//! records an instance has. Both are blobs ([`crate::blob::PartBlob`]) that are sent on request only.

mod directory;
mod page;
mod transform;

use crate::encoding::{CodingError, encode_fields};
use crate::placement::Placement;

pub use directory::{INSTANCES_PER_PAGE, PartRun, decode_directory, encode_directory, records_of};
pub use page::{MAX_PAGE_BYTES, RECORDS_PER_PAGE, check_page, decode_record, encode_page};
pub use transform::{MAX_PART_TRANSLATION, PART_SCALES, PartTransform, PartTransformError};

/// Most records of a scene.
pub const MAX_RECORDS: u32 = 1 << 24;
/// Longest name, in bytes of UTF-8.
pub const MAX_NAME_BYTES: usize = 255;
/// Longest path, in bytes of UTF-8.
pub const MAX_PATH_BYTES: usize = 1024;
/// Longest extras, in bytes of UTF-8.
pub const MAX_EXTRAS_BYTES: usize = 4096;

/// A part of an instance.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct ScenePart {
    /// Number of the instance in the scene.
    pub instance: u32,
    /// Number of the part within the instance's asset; 0 for an asset that is not divided.
    pub part: u32,
}

/// What a part is called, and where it is in its file.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PartInfo {
    /// Name of its node, or of its mesh if the node has none; at most [`MAX_NAME_BYTES`]. May be empty.
    pub name: String,
    /// Names of the nodes above it, from the root, with `/` between them; at most [`MAX_PATH_BYTES`]. Nodes without a
    /// name are left out. In a scene of several models it begins with the model's name. May be empty.
    pub path: String,
    /// Its `extras` as JSON text without white space between tokens; at most [`MAX_EXTRAS_BYTES`].
    pub extras: Option<String>,
    /// Takes places in the units and axes of the part's asset to those of its file.
    pub in_file: Placement,
}

/// The table of a scene's parts: says that there is one, and its size.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PartTable {
    /// Number of records, 1 to [`MAX_RECORDS`].
    pub records: u32,
}

encode_fields!(PartTable { records });

/// An invalid table of parts, page or part.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum PartsError {
    /// None, or more than [`MAX_RECORDS`].
    #[error("a scene states {0} records of parts; 1 to {MAX_RECORDS} are allowed")]
    Records(u32),
    /// Another number of entries than the scene states.
    #[error("a page of parts or of their directory has {got} entries, but should have {expected}")]
    WrongCount {
        /// How many it has.
        got: u64,
        /// How many it should have.
        expected: u32,
    },
    /// An instance without parts, or with records that the scene does not have.
    #[error("the directory of parts gives an instance no records, or records that do not exist")]
    NoSuchRecords,
    /// A text is longer than allowed.
    #[error("the {field} of a part has {bytes} bytes; at most {limit} are allowed")]
    TextTooLong {
        /// Which text.
        field: &'static str,
        /// Its length.
        bytes: usize,
        /// The greatest allowed length.
        limit: usize,
    },
    /// A text repeats more of the text before it than there is, or ends within a character.
    #[error("the {0} of a part does not continue the one before it")]
    Shared(&'static str),
    /// A placement that is not finite, or whose scale is not above zero.
    #[error("the placement of a part in its file is not finite, or has no size")]
    Placement,
    /// An unknown format version.
    #[error("a page of parts has format version {0}; update viewer or server")]
    Version(u8),
    /// A malformed number or text, or too few or too many bytes.
    #[error("a page of parts or of their directory is malformed: {0}")]
    Malformed(#[from] CodingError),
}

impl PartTable {
    /// Checks the number of records.
    ///
    /// # Errors
    /// If it is out of range.
    pub fn check(&self) -> Result<(), PartsError> {
        let valid = (1..=MAX_RECORDS).contains(&self.records);
        if valid { Ok(()) } else { Err(PartsError::Records(self.records)) }
    }

    /// Number of pages.
    #[must_use]
    pub const fn pages(&self) -> u32 {
        self.records.div_ceil(RECORDS_PER_PAGE)
    }

    /// Number of records on a page; 0 beyond the last.
    #[must_use]
    pub fn on_page(&self, page: u32) -> u32 {
        self.records.saturating_sub(page.saturating_mul(RECORDS_PER_PAGE)).min(RECORDS_PER_PAGE)
    }

    /// Number of directory pages of a scene of so many instances.
    #[must_use]
    pub const fn directory_pages(instances: u32) -> u32 {
        instances.div_ceil(INSTANCES_PER_PAGE)
    }

    /// Number of instances on a page of the directory; 0 beyond the last.
    #[must_use]
    pub fn on_directory_page(instances: u32, page: u32) -> u32 {
        instances.saturating_sub(page.saturating_mul(INSTANCES_PER_PAGE)).min(INSTANCES_PER_PAGE)
    }
}

#[cfg(test)]
mod tests;
