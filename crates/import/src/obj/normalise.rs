//! Checks every line of an OBJ file and rewrites the file in the subset of the format that `tobj` reads correctly: `v`
//! (with a colour, if the file has any), `vt`, `vn`, then faces with absolute indices, grouped by material and by the
//! attributes that all their corners have. Errors name their line.

use std::borrow::Cow;
use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::Path;

use crate::error::ImportError;

/// Most elements of one kind: indices and counts must fit `u32`, with room for a "none" mark.
const MAX_ELEMENTS: usize = u32::MAX as usize - 1;

/// An OBJ file rewritten for `tobj`.
#[derive(Debug, Default)]
pub(super) struct Normalised {
    /// `v`, `vt` and `vn` lines.
    pub(super) vertices: String,
    /// `usemtl N` (an index into [`Normalised::material_names`]), `o FORMAT` and `f` lines.
    pub(super) faces: String,
    /// Names of `usemtl` lines in order of first use; the empty name for faces before the first.
    pub(super) material_names: Vec<String>,
    /// Faces with at least three corners.
    pub(super) face_count: usize,
    /// Lines, points and faces with fewer than three corners, all left out.
    pub(super) left_out: usize,
    /// Vertices whose colour had values outside 0 to 1, which were clamped.
    pub(super) clamped_colors: usize,
}

/// Packs a vertex colour into one number, because the parser reads three components and no opacity; −1 without a colour.
fn pack_color(color: Option<[u8; 4]>) -> i64 {
    color.map_or(-1, |rgba| i64::from(u32::from_le_bytes(rgba)))
}

/// Inverse of [`pack_color`].
pub(super) fn unpack_color(packed: f64) -> Option<[u8; 4]> {
    (packed >= 0.0).then(|| (packed as u32).to_le_bytes())
}

/// The attributes that all corners of a face have.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) struct Format {
    pub(super) uv: bool,
    pub(super) normal: bool,
}

impl Format {
    /// As the name of a `tobj` model, which carries it through the parser.
    fn name(self) -> &'static str {
        match (self.uv, self.normal) {
            (false, false) => "v",
            (true, false) => "vt",
            (false, true) => "vn",
            (true, true) => "vtn",
        }
    }

    pub(super) fn from_name(name: &str) -> Self {
        Self { uv: name.contains('t'), normal: name.contains('n') }
    }
}

/// Lines of the file with their numbers: comments and continuations (`\` at the end) resolved.
pub(super) fn logical_lines(bytes: &[u8]) -> impl Iterator<Item = (usize, Cow<'_, str>)> {
    let bytes = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes);
    // Files from old Macs end their lines with carriage returns alone.
    let separator = if bytes.contains(&b'\n') { b'\n' } else { b'\r' };
    let mut lines = bytes.split(move |&b| b == separator).enumerate();
    std::iter::from_fn(move || {
        let (number, line) = lines.next()?;
        let mut line = String::from_utf8_lossy(line.trim_ascii());
        while line.ends_with('\\') && !line.starts_with('#') {
            let joined = line.to_mut();
            joined.pop();
            joined.push(' ');
            let Some((_, next)) = lines.next() else { break };
            joined.push_str(&String::from_utf8_lossy(next.trim_ascii()));
        }
        Some((number + 1, line))
    })
}

/// Checks and rewrites an OBJ file.
///
/// # Errors
/// The first invalid line, or a file without faces.
pub(super) fn normalise(path: &Path, bytes: &[u8]) -> Result<Normalised, ImportError> {
    if bytes.is_empty() {
        return Err(ImportError::Empty { path: path.to_owned() });
    }
    if let Some(at) = bytes.iter().position(|&b| b == 0) {
        let line = 1 + bytes[..at].iter().filter(|&&b| b == b'\n').count();
        return Err(ImportError::line(path, line, "has a zero byte, so it is not text; give an OBJ file"));
    }
    let (totals, colored) = count_elements(bytes);
    let mut reader = Reader::new(path, totals, colored);
    for (number, line) in logical_lines(bytes) {
        reader.line(number, &line)?;
    }
    reader.finish()
}

/// Elements in the whole file, since OBJ lets a positive index refer to a line further down, and whether
/// any vertex may have a colour.
fn count_elements(bytes: &[u8]) -> ([usize; 3], bool) {
    let mut counts = [0usize; 3];
    let mut colored = false;
    for (_, line) in logical_lines(bytes) {
        match keyword(&line) {
            ("v", values) => {
                counts[0] += 1;
                colored = colored || values.split_whitespace().nth(MIN_COLORED_VALUES - 1).is_some();
            }
            ("vt", _) => counts[1] += 1,
            ("vn", _) => counts[2] += 1,
            _ => {}
        }
    }
    (counts, colored)
}

/// Splits a line into its first word and the rest. Counting and reading share this, so that they agree on Unicode white
/// space too.
fn keyword(line: &str) -> (&str, &str) {
    let line = line.trim_start();
    line.split_once(char::is_whitespace).unwrap_or((line, ""))
}

/// Values of a vertex with a colour: x y z r g b, perhaps with opacity after them.
const MIN_COLORED_VALUES: usize = 6;

const KINDS: [&str; 3] = ["vertex", "texture coordinate", "normal"];

struct Reader<'a> {
    path: &'a Path,
    totals: [usize; 3],
    colored: bool,
    seen: [usize; 3],
    out: Normalised,
    materials: BTreeMap<String, usize>,
    material: Option<String>,
    written: Option<(usize, Format)>,
    lines: usize,
    unknown: usize,
    corners: Vec<[usize; 3]>,
}

impl<'a> Reader<'a> {
    fn new(path: &'a Path, totals: [usize; 3], colored: bool) -> Self {
        Self {
            path,
            totals,
            colored,
            seen: [0; 3],
            out: Normalised::default(),
            materials: BTreeMap::new(),
            material: None,
            written: None,
            lines: 0,
            unknown: 0,
            corners: Vec::new(),
        }
    }

    fn line(&mut self, number: usize, line: &str) -> Result<(), ImportError> {
        let (keyword, rest) = keyword(line);
        if keyword.is_empty() || keyword.starts_with('#') {
            return Ok(());
        }
        self.lines += 1;
        let values = || rest.split_once('#').map_or(rest, |(values, _)| values);
        match keyword {
            "v" => self.position(number, values()),
            "vt" => self.texture_coordinate(number, values()),
            "vn" => self.normal(number, values()),
            "f" | "fo" => self.face(number, values()),
            "l" | "p" => {
                self.out.left_out += 1;
                Ok(())
            }
            "usemtl" => {
                self.material = Some(rest.trim().to_owned());
                Ok(())
            }
            "o" | "g" | "s" | "mg" | "mtllib" | "usemap" | "maplib" | "vp" | "lod" | "bevel" | "c_interp"
            | "d_interp" | "shadow_obj" | "trace_obj" | "cstype" | "deg" | "bmat" | "step" | "curv"
            | "curv2" | "surf" | "parm" | "trim" | "hole" | "scrv" | "sp" | "end" | "con" | "call"
            | "csh" => Ok(()),
            _ => {
                self.unknown += 1;
                Ok(())
            }
        }
    }

    fn error(&self, line: usize, what: impl Into<String>) -> ImportError {
        ImportError::line(self.path, line, what)
    }

    fn numbers(&self, line: usize, kind: usize, text: &str) -> Result<([f64; 8], usize), ImportError> {
        let mut values = [0.0; 8];
        let mut count = 0;
        for word in text.split_whitespace() {
            let name = KINDS[kind];
            let value: f64 = word.parse().map_err(|_| {
                self.error(line, format!("{name} has {:?}; a number is expected", shown(word)))
            })?;
            if !value.is_finite() || value.abs() > f64::from(f32::MAX) {
                return Err(self.error(
                    line,
                    format!("{name} has the value {}; values must be finite and at most 3.4e38", shown(word)),
                ));
            }
            if count == values.len() {
                return Err(self.error(line, format!("{name} has more than {} values", values.len())));
            }
            values[count] = value;
            count += 1;
        }
        Ok((values, count))
    }

    fn count(&mut self, line: usize, kind: usize) -> Result<(), ImportError> {
        self.seen[kind] += 1;
        if self.seen[kind] > MAX_ELEMENTS {
            return Err(self.error(line, format!("is {} number {}; too many", KINDS[kind], self.seen[kind])));
        }
        Ok(())
    }

    fn position(&mut self, line: usize, text: &str) -> Result<(), ImportError> {
        let (v, count) = self.numbers(line, 0, text)?;
        let mut xyz = [v[0], v[1], v[2]];
        match count {
            0..=2 => {
                return Err(self.error(line, format!("vertex has {count} values; three are needed (x y z)")));
            }
            // x y z w; a colour takes three values or four.
            4 => {
                xyz = xyz.map(|x| x / v[3]);
                if !xyz.iter().all(|x| x.is_finite() && x.abs() <= f64::from(f32::MAX)) {
                    return Err(
                        self.error(line, format!("vertex divided by its weight {} is out of range", v[3]))
                    );
                }
            }
            _ => {}
        }
        self.count(line, 0)?;
        let _ = write!(self.out.vertices, "v {:?} {:?} {:?}", xyz[0], xyz[1], xyz[2]);
        if self.colored {
            let packed = pack_color(self.color(&v[..count]));
            let _ = write!(self.out.vertices, " {packed} 0 0");
        }
        self.out.vertices.push('\n');
        Ok(())
    }

    /// The colour among the values of a vertex, in steps of 1/255.
    fn color(&mut self, values: &[f64]) -> Option<[u8; 4]> {
        let &[_, _, _, r, g, b, ref rest @ ..] = values else { return None };
        let rgba = [r, g, b, rest.first().copied().unwrap_or(1.0)];
        if rgba.iter().any(|x| !(0.0..=1.0).contains(x)) {
            self.out.clamped_colors += 1;
        }
        Some(rgba.map(|x| (x.clamp(0.0, 1.0) * 255.0).round() as u8))
    }

    fn texture_coordinate(&mut self, line: usize, text: &str) -> Result<(), ImportError> {
        let (v, count) = self.numbers(line, 1, text)?;
        if count == 0 {
            return Err(self.error(line, "texture coordinate has no values; two are needed (u v)"));
        }
        self.count(line, 1)?;
        // One value is a one-dimensional texture: v is 0.
        let _ = writeln!(self.out.vertices, "vt {:?} {:?}", v[0], v[1]);
        Ok(())
    }

    fn normal(&mut self, line: usize, text: &str) -> Result<(), ImportError> {
        let (v, count) = self.numbers(line, 2, text)?;
        if count < 3 {
            return Err(self.error(line, format!("normal has {count} values; three are needed (x y z)")));
        }
        self.count(line, 2)?;
        let _ = writeln!(self.out.vertices, "vn {:?} {:?} {:?}", v[0], v[1], v[2]);
        Ok(())
    }

    /// Converts an index of the file to an absolute one from 1; 0 if the corner has none.
    fn index(&self, line: usize, kind: usize, text: &str) -> Result<usize, ImportError> {
        let name = KINDS[kind];
        if text.is_empty() && kind > 0 {
            return Ok(0);
        }
        let index: i64 = text.parse().map_err(|_| {
            self.error(line, format!("face has {:?}; a {name} index is expected", shown(text)))
        })?;
        let (total, seen) = (self.totals[kind], self.seen[kind]);
        if index == 0 {
            return Err(self.error(line, format!("face refers to {name} 0; OBJ counts from 1")));
        }
        if index > 0 {
            return match usize::try_from(index) {
                Ok(index) if index <= total => Ok(index),
                _ => {
                    Err(self.error(line, format!("face refers to {name} {index}, but the file has {total}")))
                }
            };
        }
        match usize::try_from(index.unsigned_abs()) {
            Ok(back) if back <= seen => Ok(seen - back + 1),
            _ => Err(self.error(
                line,
                format!("face refers to {name} {index} (counting back), but only {seen} come before it"),
            )),
        }
    }

    fn face(&mut self, line: usize, text: &str) -> Result<(), ImportError> {
        let mut corners = std::mem::take(&mut self.corners);
        corners.clear();
        for corner in text.split_whitespace() {
            let mut parts = corner.split('/');
            let mut indices = [0; 3];
            for (kind, index) in indices.iter_mut().enumerate() {
                *index = self.index(line, kind, parts.next().unwrap_or(""))?;
            }
            if parts.next().is_some() {
                let corner = shown(corner);
                return Err(self.error(line, format!("face corner {corner:?} has more than three indices")));
            }
            corners.push(indices);
        }
        if corners.len() < 3 {
            self.out.left_out += 1;
        } else {
            self.write_face(line, &corners)?;
        }
        self.corners = corners;
        Ok(())
    }

    fn write_face(&mut self, line: usize, corners: &[[usize; 3]]) -> Result<(), ImportError> {
        if self.out.face_count == MAX_ELEMENTS {
            return Err(self.error(line, "is one face too many"));
        }
        self.out.face_count += 1;
        let format =
            Format { uv: corners.iter().all(|c| c[1] != 0), normal: corners.iter().all(|c| c[2] != 0) };
        let name = self.material.as_deref().unwrap_or("");
        let material = match self.materials.get(name) {
            Some(&index) => index,
            None => {
                let index = self.out.material_names.len();
                self.materials.insert(name.to_owned(), index);
                self.out.material_names.push(name.to_owned());
                index
            }
        };
        let out = &mut self.out.faces;
        if self.written != Some((material, format)) {
            let _ = writeln!(out, "usemtl {material}\no {}", format.name());
            self.written = Some((material, format));
        }
        out.push('f');
        for &[v, vt, vn] in corners {
            let _ = match (format.uv, format.normal) {
                (false, false) => write!(out, " {v}"),
                (true, false) => write!(out, " {v}/{vt}"),
                (false, true) => write!(out, " {v}//{vn}"),
                (true, true) => write!(out, " {v}/{vt}/{vn}"),
            };
        }
        out.push('\n');
        Ok(())
    }

    fn finish(self) -> Result<Normalised, ImportError> {
        if self.out.face_count > 0 {
            return Ok(self.out);
        }
        let found = if self.lines == 0 {
            "only comments and blank lines".to_owned()
        } else if self.unknown * 2 > self.lines {
            format!("{} of {} lines are not OBJ; is it an OBJ file?", self.unknown, self.lines)
        } else if self.out.left_out > 0 {
            format!("only {} points or lines and {} vertices", self.out.left_out, self.seen[0])
        } else {
            format!("{} vertices", self.seen[0])
        };
        Err(ImportError::NoFaces { path: self.path.to_owned(), found })
    }
}

/// A word for an error message: short, and printable once quoted.
fn shown(word: &str) -> String {
    let mut short: String = word.chars().take(24).collect();
    if short.len() < word.len() {
        short.push('…');
    }
    short
}
