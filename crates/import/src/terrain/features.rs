//! Features of a terrain as JSON: an object or a list of objects
//! `{"mode": "fixed" | "additive", "points": [[x, y, height], …], "stamps": [{"kind": …}, …]}`, on the global
//! grid of the finest level. Points and stamps may be left out. All numbers are whole.
//!
//! ```json
//! {"mode": "additive", "points": [[3, -5, 120]], "stamps": [
//!   {"kind": "ridge", "from": [0, 0], "to": [90, 40], "half_width": 12, "height": 900},
//!   {"kind": "valley", "from": [0, 0], "to": [90, 40], "half_width": 12, "depth": 900},
//!   {"kind": "crater", "centre": [50, 50], "radius": 20, "depth": 300, "rim": 80},
//!   {"kind": "plateau", "centre": [9, 9], "radius": 20, "falloff": 8, "height": 700},
//!   {"kind": "river_bed", "line": [[0, 0], [30, 10], [60, -5]], "half_width": 6, "depth": 40}]}
//! ```

use std::io::{self, Write};
use std::path::{Path, PathBuf};

use lodestream_terrain::{FeatureSet, Mode, Point, Position, Shape};
use serde::{Deserialize, Serialize};

/// Largest file that is read, in bytes: four million points fit.
const MAX_FILE_BYTES: u64 = 128 << 20;

/// The form of a [`Mode`].
#[derive(Deserialize, Serialize)]
#[serde(remote = "Mode", rename_all = "snake_case")]
enum ModeForm {
    Fixed,
    Additive,
}

#[derive(Debug, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
struct RawSet {
    #[serde(with = "ModeForm")]
    mode: Mode,
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    points: Vec<[i64; 3]>,
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    stamps: Vec<RawStamp>,
}

#[derive(Debug, Deserialize, Serialize)]
#[serde(transparent)]
struct RawStamp(#[serde(with = "ShapeForm")] Shape);

/// The form of a [`Shape`].
#[derive(Deserialize, Serialize)]
#[serde(remote = "Shape", tag = "kind", rename_all = "snake_case", deny_unknown_fields)]
enum ShapeForm {
    Ridge { from: Position, to: Position, half_width: u32, height: i32 },
    Valley { from: Position, to: Position, half_width: u32, depth: i32 },
    Crater { centre: Position, radius: u32, depth: i32, rim: i32 },
    Plateau { centre: Position, radius: u32, falloff: u32, height: i32 },
    RiverBed { line: Vec<Position>, half_width: u32, depth: i32 },
}

/// A feature file that cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum FeatureFileError {
    /// The file cannot be read.
    #[error("{}: cannot be read: {source}", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// Why.
        source: io::Error,
    },
    /// The file is larger than is read.
    #[error("{}: {bytes} bytes of features, at most {MAX_FILE_BYTES} are read; list fewer points", path.display())]
    TooLarge {
        /// The file.
        path: PathBuf,
        /// Its size.
        bytes: u64,
    },
    /// The text is not JSON, or not of the module's form.
    #[error("{}: is not a feature file: {source}; {EXPECTED}", path.display())]
    Form {
        /// The file.
        path: PathBuf,
        /// What is wrong, with line and column.
        source: serde_json::Error,
    },
    /// A point's height does not fit 32 bits.
    #[error(
        "{}: feature set {set}: point {point}: the height {height} is beyond {} to {}",
        path.display(), i32::MIN, i32::MAX
    )]
    Height {
        /// The file.
        path: PathBuf,
        /// Which set, from 0.
        set: usize,
        /// Which of its points, from 0.
        point: usize,
        /// Its height.
        height: i64,
    },
}

/// The remedy in messages: the form of a feature file.
const EXPECTED: &str = r#"write {"mode": "fixed" or "additive", "points": [[x, y, height], ...], "stamps": [...]}, or a list of such, in whole numbers"#;

/// Reads a file of features. Whether they fit a terrain is not checked yet.
///
/// # Errors
/// See [`FeatureFileError`].
pub fn read(path: &Path) -> Result<Vec<FeatureSet>, FeatureFileError> {
    let unreadable = |source| FeatureFileError::Read { path: path.to_owned(), source };
    let bytes = std::fs::metadata(path).map_err(unreadable)?.len();
    if bytes > MAX_FILE_BYTES {
        return Err(FeatureFileError::TooLarge { path: path.to_owned(), bytes });
    }
    parse(path, &std::fs::read(path).map_err(unreadable)?)
}

/// Parses the contents of a feature file at `path`.
fn parse(path: &Path, text: &[u8]) -> Result<Vec<FeatureSet>, FeatureFileError> {
    let list = text.iter().find(|b| !b.is_ascii_whitespace()) == Some(&b'[');
    let raw: Result<Vec<RawSet>, _> =
        if list { serde_json::from_slice(text) } else { serde_json::from_slice(text).map(|set| vec![set]) };
    let raw = raw.map_err(|source| FeatureFileError::Form { path: path.to_owned(), source })?;
    raw.into_iter().enumerate().map(|(i, set)| set.resolve(path, i)).collect()
}

/// Writes one set of features.
///
/// # Errors
/// Errors of the writer.
pub fn write(out: &mut dyn Write, set: &FeatureSet) -> io::Result<()> {
    serde_json::to_writer(&mut *out, &RawSet::from(set))?;
    out.write_all(b"\n")
}

impl RawSet {
    /// The set that is number `set` of the file at `path`.
    fn resolve(self, path: &Path, set: usize) -> Result<FeatureSet, FeatureFileError> {
        let point = |(point, [x, y, height]): (usize, [i64; 3])| match i32::try_from(height) {
            Ok(height) => Ok(Point { x, y, height }),
            Err(_) => Err(FeatureFileError::Height { path: path.to_owned(), set, point, height }),
        };
        Ok(FeatureSet {
            mode: self.mode,
            points: self.points.into_iter().enumerate().map(point).collect::<Result<_, _>>()?,
            stamps: self.stamps.into_iter().map(|RawStamp(shape)| shape).collect(),
        })
    }
}

impl From<&FeatureSet> for RawSet {
    fn from(set: &FeatureSet) -> Self {
        Self {
            mode: set.mode,
            points: set.points.iter().map(|p| [p.x, p.y, i64::from(p.height)]).collect(),
            stamps: set.stamps.iter().cloned().map(RawStamp).collect(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const ALL: &str = r#"[{"mode": "additive", "points": [[3, -5, 120]], "stamps": [
        {"kind": "ridge", "from": [0, 0], "to": [90, 40], "half_width": 12, "height": 900},
        {"kind": "valley", "from": [0, 0], "to": [90, 40], "half_width": 12, "depth": 900},
        {"kind": "crater", "centre": [50, 50], "radius": 20, "depth": 300, "rim": 80},
        {"kind": "plateau", "centre": [9, 9], "radius": 20, "falloff": 8, "height": 700},
        {"kind": "river_bed", "line": [[0, 0], [30, 10], [60, -5]], "half_width": 6, "depth": 40}]},
        {"mode": "fixed"}]"#;

    #[test]
    fn every_kind_is_read_and_written() {
        let path = Path::new("f.json");
        let sets = parse(path, ALL.as_bytes()).unwrap();
        assert_eq!((sets.len(), sets[0].stamps.len(), sets[1].mode), (2, 5, Mode::Fixed));
        assert_eq!(sets[0].points, [Point { x: 3, y: -5, height: 120 }]);
        let mut text = Vec::new();
        write(&mut text, &sets[0]).unwrap();
        assert_eq!(parse(path, &text).unwrap(), sets[..1]);
    }

    #[test]
    fn errors_name_the_place() {
        for (text, fragments) in [
            ("", &["line 1", "write {"][..]),
            (r#"{"mode": "wild"}"#, &["unknown variant `wild`", "fixed", "line 1 column"]),
            (r#"{"points": []}"#, &["missing field `mode`"]),
            (r#"{"mode": "fixed", "hills": []}"#, &["unknown field `hills`"]),
            ("{\"mode\": \"fixed\",\n\"points\": [[1, 2, 2.5]]}", &["floating point", "line 2"]),
            (r#"{"mode": "fixed", "points": [[1, 2]]}"#, &["length 2"]),
            (
                r#"{"mode": "fixed", "points": [[1, 2, 3], [1, 2, 3000000000]]}"#,
                &["set 0: point 1", "3000000000"],
            ),
            (r#"{"mode": "fixed", "stamps": [{"kind": "hole"}]}"#, &["unknown variant `hole`"]),
            (
                r#"{"mode": "fixed", "stamps": [{"kind": "crater", "centre": [1, 2], "radius": 9, "depth": 1, "rim": 1, "x": 2}]}"#,
                &["unknown field `x`"],
            ),
            (r#"[{"mode": "fixed"}"#, &["EOF"]),
        ] {
            let error = parse(Path::new("f.json"), text.as_bytes()).unwrap_err().to_string();
            assert!(error.starts_with("f.json: "), "{error}");
            for fragment in fragments {
                assert!(error.contains(fragment), "{text}: {error}");
            }
        }
    }

    #[test]
    fn a_file_that_cannot_be_read_is_named_with_the_reason() {
        let error = read(Path::new("/no/f.json")).unwrap_err();
        assert!(matches!(error, FeatureFileError::Read { .. }));
        assert!(error.to_string().starts_with("/no/f.json: cannot be read: "), "{error}");
    }
}
