//! Encoding of a page of records. Neighbours have similar names and paths, so each text states how much of the record
//! before it repeats, and the rest (front coding). Placements are coded as those of instances, and left out if no record
//! of the page has one.

use super::{MAX_EXTRAS_BYTES, MAX_NAME_BYTES, MAX_PATH_BYTES, PartInfo, PartsError};
use crate::encoding::{CodingError, Decode as _, Encode as _, Reader as _, SliceReader};
use crate::instances::{self, Instance};
use crate::placement::Placement;

/// Format of a page without placements.
const TEXTS: u8 = 1;
/// Format of a page with placements before the texts.
const PLACED: u8 = 2;
/// Most bytes of an encoded placement: flags, an exponent or a long translation, a rotation and a scale.
const MAX_PLACEMENT_BYTES: usize = 1 + 25 + 16 + 4;
/// Records of a page; the last page may have fewer.
pub const RECORDS_PER_PAGE: u32 = 256;
/// Longest page: all records with the longest texts.
pub const MAX_PAGE_BYTES: usize = 4 + RECORDS_PER_PAGE as usize
    * (MAX_PLACEMENT_BYTES + 18 + MAX_NAME_BYTES + MAX_PATH_BYTES + MAX_EXTRAS_BYTES);

/// The texts of a record: what they are, and how long they may be.
const FIELDS: [(&str, usize); 3] =
    [("name", MAX_NAME_BYTES), ("path", MAX_PATH_BYTES), ("extras", MAX_EXTRAS_BYTES)];

/// Encodes a page of 1 to [`RECORDS_PER_PAGE`] records.
///
/// # Errors
/// If there are fewer or more, a text is too long, or a placement is not finite or has no size.
pub fn encode_page(records: &[PartInfo]) -> Result<Vec<u8>, PartsError> {
    if !(1..=RECORDS_PER_PAGE as usize).contains(&records.len()) {
        return Err(PartsError::WrongCount { got: records.len() as u64, expected: RECORDS_PER_PAGE });
    }
    let mut out = vec![TEXTS];
    if records.iter().any(|record| record.in_file != Placement::default()) {
        let placed = |record: &PartInfo| Instance { asset: 0, placement: record.in_file };
        let placed: Vec<Instance> = records.iter().map(placed).collect();
        check_placements(&placed)?;
        out = vec![PLACED];
        instances::encode(&placed, &mut out)?;
    }
    let mut before = [""; 3];
    for record in records {
        let texts = [&*record.name, &*record.path, record.extras.as_deref().unwrap_or_default()];
        for ((text, before), (field, limit)) in texts.iter().zip(before).zip(FIELDS) {
            if text.len() > limit {
                return Err(PartsError::TextTooLong { field, bytes: text.len(), limit });
            }
            let same = text.bytes().zip(before.bytes()).take_while(|(a, b)| a == b).count();
            // Equal bytes may end within a character.
            let (shared, rest) = text.split_at(text.floor_char_boundary(same));
            (length(shared)?, length(rest)?).encode(&mut out)?;
            out.extend_from_slice(rest.as_bytes());
        }
        before = texts;
    }
    Ok(out)
}

fn length(text: &str) -> Result<u32, PartsError> {
    u32::try_from(text.len()).map_err(|_| PartsError::Malformed(CodingError::LimitExceeded))
}

/// Checks a page that must hold `count` records.
///
/// # Errors
/// If the bytes are not such a page.
pub fn check_page(bytes: &[u8], count: u32) -> Result<(), PartsError> {
    read(bytes, count, count).map(drop)
}

/// Decodes record `number` of a page that must hold `count`; `None` beyond the last. Checks the whole page: O(its bytes).
/// Memory is that of one record and of all placements, and bounded by the length of `bytes`.
///
/// # Errors
/// If the bytes are not such a page.
pub fn decode_record(bytes: &[u8], count: u32, number: u32) -> Result<Option<PartInfo>, PartsError> {
    read(bytes, count, number)
}

fn read(bytes: &[u8], count: u32, number: u32) -> Result<Option<PartInfo>, PartsError> {
    if count == 0 || count > RECORDS_PER_PAGE {
        return Err(PartsError::WrongCount { got: count.into(), expected: RECORDS_PER_PAGE });
    }
    let mut reader = SliceReader::new(bytes, count as usize * size_of::<Instance>());
    let [version] = reader.array()?;
    let placed = match version {
        TEXTS => Vec::new(),
        PLACED => instances::decode(&mut reader)?,
        version => return Err(PartsError::Version(version)),
    };
    if version == PLACED && placed.len() != count as usize {
        return Err(PartsError::WrongCount { got: placed.len() as u64, expected: count });
    }
    check_placements(&placed)?;
    let mut texts = [const { String::new() }; 3];
    let mut found = None;
    for at in 0..count {
        for (text, (field, limit)) in texts.iter_mut().zip(FIELDS) {
            extend(text, &mut reader, field, limit)?;
        }
        if at == number {
            let [name, path, extras] = texts.clone();
            let in_file = placed.get(at as usize).map(|placed| placed.placement).unwrap_or_default();
            let extras = Some(extras).filter(|extras| !extras.is_empty());
            found = Some(PartInfo { name, path, extras, in_file });
        }
    }
    reader.finish()?;
    Ok(found)
}

fn check_placements(placed: &[Instance]) -> Result<(), PartsError> {
    let is_valid = |placed: &Instance| {
        let Placement { translation, rotation, scale } = placed.placement;
        let is_finite = translation.iter().all(|x| x.is_finite()) && rotation.iter().all(|x| x.is_finite());
        placed.asset == 0 && is_finite && scale.is_finite() && scale > 0.0
    };
    if placed.iter().all(is_valid) { Ok(()) } else { Err(PartsError::Placement) }
}

/// Reads a text that continues the one before it.
fn extend(
    text: &mut String,
    reader: &mut SliceReader<'_>,
    field: &'static str,
    limit: usize,
) -> Result<(), PartsError> {
    let [shared, rest] = [u32::decode(reader)?, u32::decode(reader)?].map(|length| length as usize);
    let bytes = shared.saturating_add(rest);
    if bytes > limit {
        return Err(PartsError::TextTooLong { field, bytes, limit });
    }
    if !text.is_char_boundary(shared) {
        return Err(PartsError::Shared(field));
    }
    if !reader.has(rest) {
        return Err(CodingError::EndsEarly.into());
    }
    let mut added = vec![0; rest];
    reader.read(&mut added)?;
    text.truncate(shared);
    text.push_str(std::str::from_utf8(&added).map_err(|_| CodingError::Utf8)?);
    Ok(())
}
