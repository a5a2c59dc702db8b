//! Encodes what the parts of a scene are called: pages of records, and a directory of the records of each instance.

use std::ops::Range;

use bytes::Bytes;
use lodestream_scene::PartBlob;
use lodestream_scene::parts::{
    INSTANCES_PER_PAGE, MAX_RECORDS, PartInfo, PartTable, PartsError, RECORDS_PER_PAGE, encode_directory,
    encode_page,
};

/// The encoded table of a scene's parts, made once when a scene is opened; empty for a scene without one.
#[derive(Clone, Debug, Default)]
pub struct PartBlobs {
    table: Option<PartTable>,
    directory: Vec<Bytes>,
    pages: Vec<Bytes>,
}

/// A table of parts that cannot be sent.
#[derive(Debug, thiserror::Error)]
pub enum PartBlobsError {
    /// More records than the protocol numbers.
    #[error("the scene has more than {MAX_RECORDS} parts with names of their own; merge some")]
    TooMany,
    /// A record or directory that cannot be encoded.
    #[error("the parts of the scene cannot be described: {0}")]
    Refused(#[from] PartsError),
}

impl PartBlobs {
    /// Encodes the records of a scene, and which of them each instance has. Records are taken one page after the other, so
    /// that they need not all be in memory.
    ///
    /// # Errors
    /// See [`PartBlobsError`].
    pub fn new(
        instances: &[Range<u32>],
        records: impl IntoIterator<Item = PartInfo>,
    ) -> Result<Self, PartBlobsError> {
        let (mut records, mut pages, mut count) = (records.into_iter(), Vec::new(), 0_u32);
        loop {
            let page: Vec<PartInfo> = records.by_ref().take(RECORDS_PER_PAGE as usize).collect();
            if page.is_empty() {
                break;
            }
            count += page.len() as u32;
            if count > MAX_RECORDS {
                return Err(PartBlobsError::TooMany);
            }
            pages.push(Bytes::from(encode_page(&page)?));
        }
        if instances.is_empty() || count == 0 {
            return Ok(Self::default());
        }
        if instances.iter().any(|of| of.end > count) {
            return Err(PartsError::NoSuchRecords.into());
        }
        let directory = instances.chunks(INSTANCES_PER_PAGE as usize).map(encode_directory);
        let directory = directory.map(|page| page.map(Bytes::from)).collect::<Result<_, _>>()?;
        Ok(Self { table: Some(PartTable { records: count }), directory, pages })
    }

    /// A table that was encoded before, of a scene whose pages have been counted.
    pub(crate) const fn of_parts(table: Option<PartTable>, directory: Vec<Bytes>, pages: Vec<Bytes>) -> Self {
        Self { table, directory, pages }
    }

    /// The message about the table; `None` without one.
    #[must_use]
    pub const fn table(&self) -> Option<PartTable> {
        self.table
    }

    /// The pages of the directory, and the pages of records.
    #[must_use]
    pub fn parts(&self) -> (&[Bytes], &[Bytes]) {
        (&self.directory, &self.pages)
    }

    /// A blob; `None` if there is none of this number.
    #[must_use]
    pub fn get(&self, blob: PartBlob) -> Option<&Bytes> {
        match blob {
            PartBlob::DirectoryPage(page) => self.directory.get(page as usize),
            PartBlob::Page(page) => self.pages.get(page as usize),
        }
    }

    /// All bytes, for fingerprints.
    pub fn all(&self) -> impl Iterator<Item = &Bytes> {
        self.directory.iter().chain(&self.pages)
    }
}

#[cfg(test)]
mod tests {
    use lodestream_scene::parts::{decode_directory, decode_record, records_of};

    use super::*;

    fn info(number: u32) -> PartInfo {
        PartInfo { name: format!("part {number}"), ..PartInfo::default() }
    }

    #[test]
    fn every_part_of_every_instance_has_its_record() {
        // A batch of 300 parts between instances of one part.
        let ranges: Vec<Range<u32>> =
            (0..1500).map(|n| if n == 700 { 2000..2300 } else { n..n + 1 }).collect();
        let blobs = PartBlobs::new(&ranges, (0..2300).map(info)).unwrap();
        let table = blobs.table().unwrap();
        assert_eq!((table.records, blobs.directory.len(), blobs.pages.len()), (2300, 2, 9));
        for (instance, of) in (0..).zip(&ranges) {
            let page = instance / INSTANCES_PER_PAGE;
            let bytes = blobs.get(PartBlob::DirectoryPage(page)).unwrap();
            let runs = decode_directory(bytes, PartTable::on_directory_page(1500, page), 2300).unwrap();
            assert_eq!(records_of(&runs, instance % INSTANCES_PER_PAGE).as_ref(), Some(of));
        }
        for record in [0, 255, 256, 2299] {
            let page = record / RECORDS_PER_PAGE;
            let bytes = blobs.get(PartBlob::Page(page)).unwrap();
            let found = decode_record(bytes, table.on_page(page), record % RECORDS_PER_PAGE).unwrap();
            assert_eq!(found, Some(info(record)));
        }
    }

    #[test]
    fn a_scene_without_instances_has_no_table_and_records_must_exist() {
        assert_eq!(PartBlobs::new(&[], (0..3).map(info)).unwrap().all().count(), 0);
        assert!(PartBlobs::new(&[0..1, 0..4], (0..3).map(info)).is_err());
        assert!(PartBlobs::new(&[0..1, 2..2], (0..3).map(info)).is_err());
    }
}
