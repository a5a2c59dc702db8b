//! The lines of an OBJ file. Errors name their line.
//!
//! `tobj`, which reads the MTL files, is not used here: tobj 4 lets NaN and infinities through, makes up texture
//! coordinates for corners that have none, takes polylines for faces, overflows on some negative indices, reads neither
//! weights nor opacities, and names no line in its errors. To check a file before it is to read every value and index,
//! which leaves a second parser nothing to do.

use std::borrow::Cow;
use std::collections::BTreeMap;
use std::path::Path;

use crate::error::ImportError;
use crate::shading::FaceShading;

/// Most elements of one kind: indices and counts must fit `u32`, with room for a "none" mark.
const MAX_ELEMENTS: usize = u32::MAX as usize - 1;

/// Bad faces are left out unless they are more than one in this many, rounded up: one is left out of a small file too.
const MAX_BAD_SHARE: usize = 10;

/// The values and faces of an OBJ file.
#[derive(Debug, Default)]
pub(super) struct Parsed {
    pub(super) positions: Vec<[f64; 3]>,
    /// Colours of vertices, up to the last that has one.
    pub(super) colors: Vec<Option<[u8; 4]>>,
    pub(super) uvs: Vec<[f32; 2]>,
    pub(super) normals: Vec<[f64; 3]>,
    pub(super) faces: Vec<Face>,
    /// Corners of all faces: position, texture coordinate and normal from 1; 0 for none.
    pub(super) corners: Vec<[u32; 3]>,
    /// Names of `usemtl` lines in order of first use; the empty name for faces before the first.
    pub(super) material_names: Vec<String>,
    /// Lines, points and faces with fewer than three corners, all left out.
    pub(super) left_out: usize,
    /// Faces that name what is not there or is no number, left out, and what is wrong with the first.
    pub(super) bad_faces: usize,
    pub(super) first_bad: Option<ImportError>,
    /// Faces that name texture coordinates and normals which do not exist or are no numbers, and have none instead.
    pub(super) without: [usize; 2],
    /// Vertices whose colour had values outside 0 to 1, which were clamped.
    pub(super) clamped_colors: usize,
}

/// A face with at least three corners.
#[derive(Clone, Copy, Debug)]
pub(super) struct Face {
    /// Number of its corners, which follow those of the face before.
    pub(super) corners: usize,
    /// Index into [`Parsed::material_names`].
    pub(super) material: usize,
    /// Shading by the last `s` line, where corners have no normals.
    pub(super) shading: FaceShading,
    /// Its line in the file.
    pub(super) line: usize,
}

/// Lines of a file in UTF-8 with their numbers: comments and continuations (`\` at the end) resolved.
pub(super) fn logical_lines(bytes: &[u8]) -> impl Iterator<Item = (usize, Cow<'_, str>)> {
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

/// Parses an OBJ file.
///
/// # Errors
/// The first bad face if more than a tenth of the faces are bad, or a file without faces.
pub(super) fn parse(path: &Path, bytes: &[u8]) -> Result<Parsed, ImportError> {
    if bytes.is_empty() {
        return Err(ImportError::Empty { path: path.to_owned() });
    }
    if let Some(at) = bytes.iter().position(|&b| b == 0) {
        let line = 1 + bytes[..at].iter().filter(|&&b| b == b'\n').count();
        return Err(ImportError::line(path, line, "has a zero byte, so it is not text; give an OBJ file"));
    }
    let mut reader = Reader::new(path, count_elements(bytes));
    for (number, line) in logical_lines(bytes) {
        reader.line(number, &line)?;
    }
    reader.finish()
}

/// Elements in the whole file, since OBJ lets a positive index refer to a line further down.
fn count_elements(bytes: &[u8]) -> [usize; 3] {
    let mut counts = [0usize; 3];
    for (_, line) in logical_lines(bytes) {
        match keyword(&line).0 {
            "v" => counts[0] += 1,
            "vt" => counts[1] += 1,
            "vn" => counts[2] += 1,
            _ => {}
        }
    }
    counts
}

/// Splits a line into its first word and the rest. Counting and reading share this, so that they agree on Unicode white
/// space too.
fn keyword(line: &str) -> (&str, &str) {
    let line = line.trim_start();
    line.split_once(char::is_whitespace).unwrap_or((line, ""))
}

/// An index of a face that cannot be used.
enum IndexError {
    /// Of an element that does not exist.
    Missing(ImportError),
    /// It is none.
    NoNumber(ImportError),
}

const KINDS: [&str; 3] = ["vertex", "texture coordinate", "normal"];

struct Reader<'a> {
    path: &'a Path,
    totals: [usize; 3],
    out: Parsed,
    materials: BTreeMap<String, usize>,
    material: Option<String>,
    shading: FaceShading,
    lines: usize,
    unknown: usize,
    /// Elements that are no usable numbers, which are NaN in the lists, by kind; and the first error of each kind.
    unusable: [Unusable; 3],
}

/// Elements of one kind that are no usable numbers. They matter only to faces that use them.
#[derive(Debug, Default)]
struct Unusable {
    count: usize,
    first: Option<(u32, ImportError)>,
}

impl<'a> Reader<'a> {
    fn new(path: &'a Path, totals: [usize; 3]) -> Self {
        Self {
            path,
            totals,
            out: Parsed::default(),
            materials: BTreeMap::new(),
            material: None,
            shading: FaceShading::Creased,
            lines: 0,
            unknown: 0,
            unusable: Default::default(),
        }
    }

    /// Elements of each kind so far.
    fn seen(&self) -> [usize; 3] {
        [self.out.positions.len(), self.out.uvs.len(), self.out.normals.len()]
    }

    fn line(&mut self, number: usize, line: &str) -> Result<(), ImportError> {
        let (keyword, rest) = keyword(line);
        if keyword.is_empty() || keyword.starts_with('#') {
            return Ok(());
        }
        self.lines += 1;
        let values = || rest.split_once('#').map_or(rest, |(values, _)| values);
        match keyword {
            "v" => self.element(number, 0, values()),
            "vt" => self.element(number, 1, values()),
            "vn" => self.element(number, 2, values()),
            "f" | "fo" => self.face(number, values()),
            "l" | "p" => {
                self.out.left_out += 1;
                Ok(())
            }
            "usemtl" => {
                self.material = Some(rest.trim().to_owned());
                Ok(())
            }
            "s" => {
                self.shading = smoothing(values());
                Ok(())
            }
            "o" | "g" | "mg" | "mtllib" | "usemap" | "maplib" | "vp" | "lod" | "bevel" | "c_interp"
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

    /// Checks that another element of a kind may follow.
    fn check_count(&self, line: usize, kind: usize) -> Result<(), ImportError> {
        let number = self.seen()[kind] + 1;
        if number > MAX_ELEMENTS {
            return Err(self.error(line, format!("is {} number {number}; too many", KINDS[kind])));
        }
        Ok(())
    }

    /// Adds an element of a kind: NaN, with a note, if its line is no usable numbers.
    fn element(&mut self, line: usize, kind: usize, text: &str) -> Result<(), ImportError> {
        self.check_count(line, kind)?;
        let added = match kind {
            0 => self.position(line, text),
            1 => self.texture_coordinate(line, text),
            _ => self.normal(line, text),
        };
        let Err(error) = added else { return Ok(()) };
        let index = self.seen()[kind] as u32;
        match kind {
            0 => self.out.positions.push([f64::NAN; 3]),
            1 => self.out.uvs.push([f32::NAN; 2]),
            _ => self.out.normals.push([f64::NAN; 3]),
        }
        let Unusable { count, first } = &mut self.unusable[kind];
        *count += 1;
        first.get_or_insert((index, error));
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
        if let Some(color) = self.color(&v[..count]) {
            self.out.colors.resize(self.out.positions.len(), None);
            self.out.colors.push(Some(color));
        }
        self.out.positions.push(xyz);
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
        // One value is a one-dimensional texture: v is 0.
        self.out.uvs.push([v[0] as f32, v[1] as f32]);
        Ok(())
    }

    fn normal(&mut self, line: usize, text: &str) -> Result<(), ImportError> {
        let (v, count) = self.numbers(line, 2, text)?;
        if count < 3 {
            return Err(self.error(line, format!("normal has {count} values; three are needed (x y z)")));
        }
        self.out.normals.push([v[0], v[1], v[2]]);
        Ok(())
    }

    /// Converts an index of the file to an absolute one from 1; 0 if the corner has none.
    ///
    /// # Errors
    /// Indices that are no numbers, and those of elements that do not exist.
    fn index(&self, line: usize, kind: usize, text: &str) -> Result<u32, IndexError> {
        let name = KINDS[kind];
        if text.is_empty() && kind > 0 {
            return Ok(0);
        }
        let index: i64 = text.parse().map_err(|_| {
            let what = format!("face has {:?}; a {name} index is expected", shown(text));
            IndexError::NoNumber(self.error(line, what))
        })?;
        let (total, seen) = (self.totals[kind], self.seen()[kind]);
        let missing = |what: String| Err(IndexError::Missing(self.error(line, what)));
        if index == 0 {
            return missing(format!("face refers to {name} 0; OBJ counts from 1"));
        }
        if index > 0 {
            return match usize::try_from(index) {
                Ok(index) if index <= total.min(MAX_ELEMENTS) => Ok(index as u32),
                _ => missing(format!("face refers to {name} {index}, but the file has {total}")),
            };
        }
        match usize::try_from(index.unsigned_abs()) {
            Ok(back) if back <= seen => Ok((seen - back + 1) as u32),
            _ => missing(format!(
                "face refers to {name} {index} (counting back), but only {seen} come before it"
            )),
        }
    }

    /// Adds the corners of a face, and tells which of texture coordinates and normals some of them miss.
    ///
    /// # Errors
    /// Corners without a position, and what is no corner.
    fn corners(&mut self, line: usize, text: &str) -> Result<[bool; 2], ImportError> {
        let mut missing = [false; 2];
        for corner in text.split_whitespace() {
            let mut parts = corner.split('/');
            let mut indices = [0; 3];
            for (kind, index) in indices.iter_mut().enumerate() {
                *index = match self.index(line, kind, parts.next().unwrap_or("")) {
                    Ok(index) => index,
                    Err(IndexError::Missing(_)) if kind > 0 => {
                        missing[kind - 1] = true;
                        0
                    }
                    Err(IndexError::Missing(error) | IndexError::NoNumber(error)) => return Err(error),
                };
            }
            if parts.next().is_some() {
                let corner = shown(corner);
                return Err(self.error(line, format!("face corner {corner:?} has more than three indices")));
            }
            self.out.corners.push(indices);
        }
        Ok(missing)
    }

    /// Adds a face, or counts it as bad.
    fn face(&mut self, line: usize, text: &str) -> Result<(), ImportError> {
        let first = self.out.corners.len();
        let missing = match self.corners(line, text) {
            Ok(missing) => missing,
            Err(error) => {
                self.out.corners.truncate(first);
                self.out.bad_faces += 1;
                self.out.first_bad.get_or_insert(error);
                return Ok(());
            }
        };
        let corners = self.out.corners.len() - first;
        if corners < 3 {
            self.out.corners.truncate(first);
            self.out.left_out += 1;
            return Ok(());
        }
        if self.out.faces.len() == MAX_ELEMENTS {
            return Err(self.error(line, "is one face too many"));
        }
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
        for (count, missing) in self.out.without.iter_mut().zip(missing) {
            *count += usize::from(missing);
        }
        self.out.faces.push(Face { corners, material, shading: self.shading, line });
        Ok(())
    }

    /// Leaves out faces whose positions are no numbers, and of others the attributes that are none. Faces may name elements
    /// further down, so this waits for the end of the file.
    fn drop_unusable(&mut self) {
        if self.unusable.iter().all(|unusable| unusable.count == 0) {
            return;
        }
        let out = &mut self.out;
        let (positions, uvs, normals) = (&out.positions, &out.uvs, &out.normals);
        let is_nan = |kind: usize, index: u32| {
            let Some(at) = index.checked_sub(1).map(|at| at as usize) else { return false };
            match kind {
                0 => positions[at][0].is_nan(),
                1 => uvs[at][0].is_nan(),
                _ => normals[at][0].is_nan(),
            }
        };
        let corners = std::mem::take(&mut out.corners);
        let mut rest = &corners[..];
        let mut kept = Vec::with_capacity(corners.len());
        let (path, first_position) = (self.path, &mut self.unusable[0].first);
        out.faces.retain(|face| {
            let (own, behind) = rest.split_at(face.corners);
            rest = behind;
            if let Some([bad, ..]) = own.iter().find(|[position, ..]| is_nan(0, *position)) {
                out.bad_faces += 1;
                out.first_bad.get_or_insert_with(|| match first_position.take() {
                    Some((index, error)) if index + 1 == *bad => error,
                    _ => {
                        let what = format!("face refers to vertex {bad}, which is no finite numbers");
                        ImportError::line(path, face.line, what)
                    }
                });
                return false;
            }
            let lost = [1, 2].map(|kind| own.iter().any(|corner| is_nan(kind, corner[kind])));
            for (count, lost) in out.without.iter_mut().zip(lost) {
                *count += usize::from(lost);
            }
            kept.extend(own.iter().map(|&[position, uv, normal]| {
                [position, if lost[0] { 0 } else { uv }, if lost[1] { 0 } else { normal }]
            }));
            true
        });
        out.corners = kept;
    }

    fn finish(mut self) -> Result<Parsed, ImportError> {
        self.drop_unusable();
        let good = self.out.faces.len();
        let is_bad = self.out.bad_faces > (good + self.out.bad_faces).div_ceil(MAX_BAD_SHARE);
        if (is_bad || good == 0)
            && let Some(error) = self.out.first_bad.take()
        {
            return Err(error);
        }
        if !self.out.faces.is_empty() {
            return Ok(self.out);
        }
        let found = if self.lines == 0 {
            "only comments and blank lines".to_owned()
        } else if self.unknown * 2 > self.lines {
            format!("{} of {} lines are not OBJ; is it an OBJ file?", self.unknown, self.lines)
        } else if self.out.left_out > 0 {
            format!("only {} points or lines and {} vertices", self.out.left_out, self.seen()[0])
        } else {
            format!("{} vertices", self.seen()[0])
        };
        Err(ImportError::NoFaces { path: self.path.to_owned(), found })
    }
}

/// The shading of an `s` line: a group's number, or `off`. Others say nothing.
fn smoothing(text: &str) -> FaceShading {
    let word = text.split_whitespace().next().unwrap_or("");
    match word.parse() {
        Ok(0) => FaceShading::Flat,
        Ok(group) => FaceShading::Group(group),
        Err(_) if word.eq_ignore_ascii_case("off") => FaceShading::Flat,
        Err(_) if word.eq_ignore_ascii_case("on") => FaceShading::Group(1),
        Err(_) => FaceShading::Creased,
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
