//! STL files (3D Systems, "StereoLithography Interface Specification", 1989) to one mesh: binary and text.
//!
//! Corners at one place become one vertex. The normals of the file are not read: they follow from the winding, which
//! programs keep more reliably. Several solids are merged. The file is streamed.

mod facets;
#[cfg(test)]
mod tests;
mod text;

use std::fs::File;
use std::io::{BufRead, BufReader};
use std::path::Path;

use crate::error::ImportError;
use crate::file::{MAX_FILE_BYTES, check_file};
use crate::shading::Unshaded;
use facets::Facets;

/// Size of the read buffer, of which the first part tells text from binary.
const BUFFER_BYTES: usize = 1 << 16;
/// Bytes before the facets of a binary file: 80 of any text, and the number of facets.
const HEAD_BYTES: u64 = 84;
/// A facet of a binary file: a normal and three corners in f32, and two bytes that some programs colour it by.
const FACET_BYTES: usize = 50;

/// Imports an STL file.
///
/// # Errors
/// A file that is cut short, or of whose facets more than a tenth have corners that are not finite numbers.
pub(super) fn import(path: &Path) -> Result<Unshaded, ImportError> {
    let length = check_file(path, MAX_FILE_BYTES)?;
    if length == 0 {
        return Err(ImportError::Empty { path: path.to_owned() });
    }
    let unreadable = |source| ImportError::Read { path: path.to_owned(), source };
    let file = File::open(path).map_err(unreadable)?;
    let mut reader = BufReader::with_capacity(BUFFER_BYTES, file);
    let mut facets = Facets::new(path);
    let begin = reader.fill_buf().map_err(unreadable)?;
    match stated_facets(begin).filter(|&count| HEAD_BYTES + count * FACET_BYTES as u64 == length) {
        None if is_text(begin) => text::read(reader, &mut facets)?,
        _ => binary(reader, length, &mut facets)?,
    }
    facets.finish()
}

/// The number of facets that a binary file states.
fn stated_facets(begin: &[u8]) -> Option<u64> {
    let count = begin.get(HEAD_BYTES as usize - 4..)?.first_chunk()?;
    Some(u32::from_le_bytes(*count).into())
}

/// Whether a file that is not as long as a binary one should be is text. Binary ones may begin with the word too.
fn is_text(begin: &[u8]) -> bool {
    let begin = begin.strip_prefix(b"\xef\xbb\xbf").unwrap_or(begin).trim_ascii_start();
    begin.get(..5).is_some_and(|word| word.eq_ignore_ascii_case(b"solid"))
        && !begin.iter().take(512).any(|&byte| byte == 0)
}

fn binary(mut reader: impl BufRead, length: u64, facets: &mut Facets<'_>) -> Result<(), ImportError> {
    let path = facets.path;
    let begin = reader.fill_buf().map_err(|source| ImportError::Read { path: path.to_owned(), source })?;
    let Some(stated) = stated_facets(begin) else {
        let what =
            format!("has {length} bytes, too few for an STL file; it is truncated, or is something else");
        return Err(ImportError::stl(path, what));
    };
    let room = (length - HEAD_BYTES) / FACET_BYTES as u64;
    let is_whole = HEAD_BYTES + room * FACET_BYTES as u64 == length;
    let count = match stated {
        // Programs that write to a pipe leave the number out.
        0 | 0xffff_ffff if is_whole => room,
        _ if stated > room => {
            let what =
                format!("states {stated} facets, but has bytes for {room}: it is truncated, or no STL file");
            return Err(ImportError::stl(path, what));
        }
        _ => stated,
    };
    if count != stated {
        facets.warnings.push(format!("states {stated} facets, but has {count}, which are read"));
    } else if HEAD_BYTES + count * (FACET_BYTES as u64) < length {
        facets.warnings.push(format!("has bytes after its {count} facets, which are not read"));
    }
    let mut head = [0; HEAD_BYTES as usize];
    let mut facet = [0; FACET_BYTES];
    let unreadable = |source| ImportError::Read { path: path.to_owned(), source };
    reader.read_exact(&mut head).map_err(unreadable)?;
    for number in 0..count {
        reader.read_exact(&mut facet).map_err(unreadable)?;
        let (values, _) = facet[12..48].as_chunks();
        let value = |at: usize| f64::from(f32::from_le_bytes(values[at]));
        facets.add([0, 3, 6].map(|at| [value(at), value(at + 1), value(at + 2)]), || {
            format!("facet {number} has a corner that is not finite")
        });
    }
    Ok(())
}
