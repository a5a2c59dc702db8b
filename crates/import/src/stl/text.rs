//! STL as text: `facet normal …`, `outer loop`, `vertex x y z` for each corner, `endloop`, `endfacet`.

use std::io::{BufRead, Read as _};

use super::facets::Facets;
use crate::error::ImportError;

/// Longest line, in bytes.
const MAX_LINE_BYTES: u64 = 1 << 16;
/// Most corners of a facet: three, or the few of programs that write polygons.
const MAX_CORNERS: usize = 1 << 10;

/// Reads all solids of a file.
///
/// # Errors
/// A file that ends within a facet, and lines that are too long.
pub(super) fn read(mut reader: impl BufRead, facets: &mut Facets<'_>) -> Result<(), ImportError> {
    let path = facets.path;
    let mut line = Vec::new();
    // Corners of the current facet, and whether one is not a number.
    let (mut corners, mut is_bad, mut within): (Vec<[f64; 3]>, _, _) = (Vec::new(), false, false);
    for number in 1.. {
        line.clear();
        let read = reader.by_ref().take(MAX_LINE_BYTES).read_until(b'\n', &mut line);
        match read.map_err(|source| ImportError::Read { path: path.to_owned(), source })? as u64 {
            0 if within => {
                return Err(ImportError::line(path, number, "the file ends within a facet: it is truncated"));
            }
            0 => break,
            MAX_LINE_BYTES => return Err(ImportError::line(path, number, "is too long; is it an STL file?")),
            _ => {}
        }
        let text = String::from_utf8_lossy(&line);
        let mut words = text.split_ascii_whitespace();
        let keyword = words.next().unwrap_or_default().to_ascii_lowercase();
        match keyword.as_str() {
            "facet" => {
                corners.clear();
                (is_bad, within) = (false, true);
            }
            "vertex" => {
                let values: Vec<f64> = words.take(3).map_while(|word| word.parse().ok()).collect();
                match values[..] {
                    [x, y, z] if corners.len() < MAX_CORNERS => corners.push([x, y, z]),
                    _ => is_bad = true,
                }
            }
            "endfacet" => {
                within = false;
                let what =
                    || format!("the facet that ends in line {number} has no three corners of finite numbers");
                match &corners[..] {
                    [first, rest @ ..] if !is_bad && rest.len() >= 2 => {
                        for pair in rest.windows(2) {
                            facets.add([*first, pair[0], pair[1]], what);
                        }
                    }
                    _ => facets.add_bad(what),
                }
            }
            // Names, loops and what else programs add.
            _ => {}
        }
    }
    Ok(())
}
