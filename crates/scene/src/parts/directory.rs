//! The directory of parts: which records each instance has.

use std::ops::Range;

use super::PartsError;
use crate::encoding::{self, encode_fields};

/// Instances of a page of the directory; the last page may have fewer.
pub const INSTANCES_PER_PAGE: u32 = 1024;

/// Most memory that a decoded page may take, in bytes.
const MAX_MEMORY_BYTES: usize = 64 * 1024;

/// Consecutive instances with as many parts each, whose records follow each other. 3 to 9 bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PartRun {
    /// Number of instances, at least 1.
    pub instances: u32,
    /// Number of parts of each, at least 1.
    pub parts: u32,
    /// Record of the first one's first part.
    pub first: u32,
}

encode_fields!(PartRun { instances, parts, first });

impl PartRun {
    /// End of its records; `None` if it is empty or beyond all numbers.
    fn end(&self) -> Option<u32> {
        let records = self.instances.checked_mul(self.parts).filter(|records| *records > 0)?;
        self.first.checked_add(records)
    }
}

/// Encodes a page of the directory from the records of 1 to [`INSTANCES_PER_PAGE`] instances.
///
/// # Errors
/// If there are fewer or more instances, or one has no records.
pub fn encode_directory(records: &[Range<u32>]) -> Result<Vec<u8>, PartsError> {
    if !(1..=INSTANCES_PER_PAGE as usize).contains(&records.len()) {
        return Err(PartsError::WrongCount { got: records.len() as u64, expected: INSTANCES_PER_PAGE });
    }
    let mut runs: Vec<PartRun> = Vec::new();
    for of in records {
        let parts =
            of.end.checked_sub(of.start).filter(|parts| *parts > 0).ok_or(PartsError::NoSuchRecords)?;
        match runs.last_mut() {
            Some(run) if run.parts == parts && run.end() == Some(of.start) => run.instances += 1,
            _ => runs.push(PartRun { instances: 1, parts, first: of.start }),
        }
    }
    Ok(encoding::encode(&runs)?)
}

/// Decodes a page of the directory of `instances` instances, in a scene of so many records. Memory is bounded by the
/// length of `bytes`.
///
/// # Errors
/// If the bytes are not such a page.
pub fn decode_directory(bytes: &[u8], instances: u32, records: u32) -> Result<Vec<PartRun>, PartsError> {
    let runs: Vec<PartRun> = encoding::decode(bytes, MAX_MEMORY_BYTES)?;
    if !runs.iter().all(|run| run.end().is_some_and(|end| end <= records)) {
        return Err(PartsError::NoSuchRecords);
    }
    let got = runs.iter().map(|run| u64::from(run.instances)).sum();
    if got != u64::from(instances) || instances > INSTANCES_PER_PAGE {
        return Err(PartsError::WrongCount { got, expected: instances });
    }
    Ok(runs)
}

/// Records of the `number`-th instance of a page; `None` beyond the last.
#[must_use]
pub fn records_of(runs: &[PartRun], number: u32) -> Option<Range<u32>> {
    let mut left = number;
    for run in runs {
        if left < run.instances {
            let first = run.first.checked_add(left.checked_mul(run.parts)?)?;
            return Some(first..first.checked_add(run.parts)?);
        }
        left -= run.instances;
    }
    None
}
