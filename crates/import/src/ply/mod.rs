//! PLY files (Turk, "The PLY Polygon File Format", 1994) to one mesh: text, and binary of both byte orders.
//!
//! The file is streamed; counts are checked against its length before memory is reserved. Positions, normals, colours and
//! texture coordinates are read from `vertex`, triangles from `face` and `tristrips`. A warning names skipped elements.
//! Comments `TextureFile` name images, whose coordinates are those of the vertices or of the faces (`texcoord`).

mod body;
mod header;
#[cfg(test)]
mod tests;
mod textured;

use std::fs::File;
use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};

use lodestream_geometry::mesh::{Corner, NONE};

use crate::error::ImportError;
use crate::file::{MAX_FILE_BYTES, check_file};
use crate::shading::{FaceShading, ShadingRuns, Unshaded};
use crate::triangulate::triangulate;
use crate::weld::Weld;
use body::Body;
use header::{Element, Header};
use textured::{FaceTexture, Materials};

/// Size of the read buffer.
const BUFFER_BYTES: usize = 1 << 16;
/// Names of the vertex properties that are read, by their index in a vertex's numbers.
const NAMES: [&[&str]; 12] = [
    &["x"],
    &["y"],
    &["z"],
    &["nx"],
    &["ny"],
    &["nz"],
    &["red", "r", "diffuse_red"],
    &["green", "g", "diffuse_green"],
    &["blue", "b", "diffuse_blue"],
    &["alpha", "a", "diffuse_alpha"],
    &["s", "u", "texture_u", "texture_s"],
    &["t", "v", "texture_v", "texture_t"],
];
// Indices of position, normal, colour and texture coordinates among these.
const POSITION: usize = 0;
const NORMAL: usize = 3;
const COLOR: usize = 6;
const ALPHA: usize = 9;
const UV: usize = 10;

/// Imports a PLY file.
pub(super) fn import(path: &Path) -> Result<Unshaded, ImportError> {
    let (length, mut reader) = open(path)?;
    let header = Header::read(path, &mut reader)?;
    header.check_counts(path, length)?;
    let mut body = Body::new(path, reader, &header, length);
    let mut reading =
        MeshReader { materials: Materials::new(path, &header.textures), ..MeshReader::default() };
    for element in &header.elements {
        match element.name.as_str() {
            "vertex" => reading.vertices(path, element, &mut body)?,
            "face" | "tristrips" => reading.faces(path, element, &mut body)?,
            _ => reading.skip(element, &mut body)?,
        }
    }
    reading.warnings.extend(body.notes());
    reading.finish(path)
}

/// The length of a file that is not empty, and its bytes.
fn open(path: &Path) -> Result<(u64, BufReader<File>), ImportError> {
    let length = check_file(path, MAX_FILE_BYTES)?;
    if length == 0 {
        return Err(ImportError::Empty { path: path.to_owned() });
    }
    let file = File::open(path).map_err(|source| ImportError::Read { path: path.to_owned(), source })?;
    Ok((length, BufReader::with_capacity(BUFFER_BYTES, file)))
}

/// The textures that the header of a PLY file names, of which `bytes` may be no more than the beginning.
pub(super) fn dependencies(path: &Path, mut bytes: &[u8]) -> Vec<PathBuf> {
    Header::read(path, &mut bytes).map(|header| textured::files(path, &header.textures)).unwrap_or_default()
}

/// As [`dependencies`], of the file at a path, of which the header alone is read.
pub(super) fn dependencies_of_file(path: &Path) -> Vec<PathBuf> {
    let header = open(path).and_then(|(_, mut reader)| Header::read(path, &mut reader));
    header.map(|header| textured::files(path, &header.textures)).unwrap_or_default()
}

/// The mesh read so far.
#[derive(Default)]
struct MeshReader {
    positions: Vec<[f64; 3]>,
    /// As many as positions, or none.
    normals: Vec<[f32; 3]>,
    colors: Vec<[u8; 4]>,
    uvs: Vec<[f32; 2]>,
    /// Corner of each vertex, once a face has used it.
    corners: Vec<Option<Corner>>,
    weld: Weld,
    materials: Materials,
    /// Number of the current face's among them.
    material: u16,
    left_out: u64,
    clamped: u64,
    skipped: Vec<String>,
    warnings: Vec<String>,
}

impl MeshReader {
    fn vertices<'a, R: BufRead>(
        &mut self,
        path: &Path,
        element: &'a Element,
        body: &mut Body<'a, R>,
    ) -> Result<(), ImportError> {
        let wrong = |what: String| Err(ImportError::line(path, element.line, what));
        if !self.positions.is_empty() {
            return wrong("vertices come twice; write them as one element".to_owned());
        }
        // For each property its index among the numbers; for each number the value that represents 1.
        let (mut places, mut has) = (Vec::with_capacity(element.properties.len()), [None; NAMES.len()]);
        for property in &element.properties {
            let place = NAMES.iter().position(|names| names.contains(&property.name.as_str()));
            let place = place.filter(|&place| property.length.is_none() && has[place].is_none());
            match place {
                Some(place) => has[place] = Some(property.kind.unit_value()),
                None => self.skipped.push(format!("{} of vertex", property.name)),
            }
            places.push(place);
        }
        if let Some(lacking) = (POSITION..NORMAL).find(|&place| has[place].is_none()) {
            return wrong(format!(
                "vertices have no property {:?}; x, y and z are needed",
                NAMES[lacking][0]
            ));
        }
        let all = |of: std::ops::Range<usize>| has[of].iter().all(Option::is_some);
        let (normals, colors, uvs) = (all(NORMAL..COLOR), all(COLOR..ALPHA), all(UV..NAMES.len()));
        let count = element.count as usize;
        self.positions.reserve_exact(count);
        self.normals.reserve_exact(if normals { count } else { 0 });
        self.colors.reserve_exact(if colors { count } else { 0 });
        self.uvs.reserve_exact(if uvs { count } else { 0 });
        let mut numbers = [0.0; NAMES.len()];
        for index in 0..element.count {
            body.begin(&element.name, index)?;
            for (property, place) in element.properties.iter().zip(&places) {
                match (place, property.length) {
                    (Some(place), _) => numbers[*place] = body.number(property.kind)?,
                    (None, None) => drop(body.number(property.kind)?),
                    (None, Some(length)) => {
                        for _ in 0..body.list_length(length, property.kind)? {
                            body.number(property.kind)?;
                        }
                    }
                }
            }
            body.end();
            let [x, y, z, nx, ny, nz, .., u, v] = numbers;
            let usable = |numbers: &[f64]| numbers.iter().all(|x| x.abs() <= f64::from(f32::MAX));
            if !usable(&[x, y, z]) || normals && !usable(&[nx, ny, nz]) || uvs && !usable(&[u, v]) {
                return Err(body.wrong("a position, normal or coordinate is not finite, or beyond 3.4e38"));
            }
            self.positions.push([x, y, z]);
            if normals {
                self.normals.push([nx, ny, nz].map(|x| x as f32));
            }
            if uvs {
                self.uvs.push([u, v].map(|x| x as f32));
            }
            if colors {
                let share = |place: usize| has[place].map_or(1.0, |unit_value| numbers[place] / unit_value);
                let rgba = [COLOR, COLOR + 1, COLOR + 2, ALPHA].map(share);
                self.clamped += u64::from(rgba.iter().any(|x| !(0.0..=1.0).contains(x)));
                self.colors.push(rgba.map(|x| (x.clamp(0.0, 1.0) * 255.0).round() as u8));
            }
        }
        self.corners = vec![None; count];
        Ok(())
    }

    /// Polygons, or strips of triangles.
    fn faces<'a, R: BufRead>(
        &mut self,
        path: &Path,
        element: &'a Element,
        body: &mut Body<'a, R>,
    ) -> Result<(), ImportError> {
        let is_list = |name: &str| matches!(name, "vertex_indices" | "vertex_index");
        let listed = element.properties.iter().position(|p| {
            is_list(&p.name) && p.length.is_some_and(|length| length.is_integer()) && p.kind.is_integer()
        });
        let Some(listed) = listed else {
            let what = format!("{} has no list vertex_indices of integers", element.name);
            return Err(ImportError::line(path, element.line, what));
        };
        if self.positions.is_empty() && element.count > 0 {
            let what = format!("{} comes before any vertex; write vertices first", element.name);
            return Err(ImportError::line(path, element.line, what));
        }
        let mut texture = FaceTexture::declared(element, &self.materials);
        for (place, property) in element.properties.iter().enumerate() {
            if place != listed && !texture.has(place) {
                self.skipped.push(format!("{} of {}", property.name, element.name));
            }
        }
        self.weld.mesh.faces.reserve(element.count as usize);
        self.weld.mesh.materials.reserve(element.count as usize);
        let strips = element.name == "tristrips";
        let (mut corners, mut points) = (Vec::new(), Vec::new());
        for index in 0..element.count {
            body.begin(&element.name, index)?;
            corners.clear();
            texture.clear();
            for (place, property) in element.properties.iter().enumerate() {
                let length = match property.length {
                    Some(length) => body.list_length(length, property.kind)?,
                    None => 1,
                };
                for _ in 0..length {
                    let number = body.number(property.kind)?;
                    if place != listed {
                        texture.add(place, number);
                        continue;
                    }
                    if strips && number == -1.0 {
                        self.strip(&corners);
                        corners.clear();
                    } else {
                        let corner = self.corner(number);
                        corners.push(corner.ok_or_else(|| {
                            let vertices = self.positions.len();
                            body.wrong(format!("there is no vertex {number}: there are {vertices}"))
                        })?);
                    }
                }
            }
            body.end();
            let material = self.materials.of_face(&texture);
            if let Some(uvs) = texture.uvs(corners.len()) {
                for (corner, uv) in corners.iter_mut().zip(uvs) {
                    corner.uv = self.weld.uv(uv);
                }
            }
            if material > 0 && !self.colors.is_empty() {
                // Scanners give vertices the colours that the texture shows in more detail.
                corners.iter_mut().for_each(|corner| corner.color = NONE);
            }
            self.material = material;
            match corners[..] {
                _ if strips => self.strip(&corners),
                [a, b, c] => self.triangle([a, b, c]),
                [_, _, _, ..] => {
                    points.clear();
                    points.extend(corners.iter().map(|c| self.weld.mesh.positions[c.position as usize]));
                    for triangle in triangulate(&points) {
                        self.triangle(triangle.map(|i| corners[i]));
                    }
                }
                _ => self.left_out += 1,
            }
        }
        Ok(())
    }

    /// Adds the triangles of a strip: every second one is reversed, and degenerate ones, which join strips, are skipped.
    fn strip(&mut self, corners: &[Corner]) {
        for (nth, triangle) in corners.windows(3).enumerate() {
            let [a, b, c] = if nth % 2 == 0 { [0, 1, 2] } else { [1, 0, 2] }.map(|i| triangle[i]);
            if a.position != b.position && b.position != c.position && c.position != a.position {
                self.triangle([a, b, c]);
            }
        }
    }

    fn triangle(&mut self, corners: [Corner; 3]) {
        self.weld.mesh.faces.push(corners);
        self.weld.mesh.materials.push(self.material);
    }

    /// The mesh's corner for a vertex; `None` if there is no such vertex.
    fn corner(&mut self, number: f64) -> Option<Corner> {
        // Negative and fractional numbers are not indices.
        let vertex = (number >= 0.0 && number.fract() == 0.0).then_some(number as usize)?;
        let known = self.corners.get_mut(vertex)?;
        if let Some(corner) = *known {
            return Some(corner);
        }
        let weld = &mut self.weld;
        let corner = Corner {
            position: weld.position(self.positions[vertex]),
            uv: self.uvs.get(vertex).map_or(NONE, |uv| weld.uv(*uv)),
            normal: self.normals.get(vertex).map_or(NONE, |normal| weld.normal(normal.map(f64::from))),
            color: self.colors.get(vertex).map_or(NONE, |color| weld.color(*color)),
            second_uv: NONE,
        };
        *known = Some(corner);
        Some(corner)
    }

    /// Skips an element.
    fn skip<'a, R: BufRead>(
        &mut self,
        element: &'a Element,
        body: &mut Body<'a, R>,
    ) -> Result<(), ImportError> {
        self.skipped.push(element.name.clone());
        let count = if element.properties.is_empty() { 0 } else { element.count };
        for index in 0..count {
            body.begin(&element.name, index)?;
            for property in &element.properties {
                let length = match property.length {
                    Some(length) => body.list_length(length, property.kind)?,
                    None => 1,
                };
                for _ in 0..length {
                    body.number(property.kind)?;
                }
            }
            body.end();
        }
        Ok(())
    }

    fn finish(self, path: &Path) -> Result<Unshaded, ImportError> {
        let Self {
            positions, normals, mut weld, materials, left_out, clamped, skipped, mut warnings, ..
        } = self;
        if weld.mesh.faces.is_empty() {
            let found = format!("{} vertices, {left_out} faces with fewer than 3 corners", positions.len());
            return Err(ImportError::NoFaces { path: path.to_owned(), found });
        }
        if left_out > 0 {
            warnings.push(format!("{left_out} faces with fewer than 3 corners were left out"));
        }
        if clamped > 0 {
            warnings.push(format!("{clamped} vertices have colours outside 0 to 1, which were clamped"));
        }
        if !skipped.is_empty() {
            warnings.push(format!("skipped: {skipped:?}"));
        }
        let warnings = warnings.into_iter().map(|what| format!("{}: {what}", path.display())).collect();
        let materials = materials.used(path, &mut weld.mesh.materials)?;
        let shading = if normals.is_empty() { FaceShading::Creased } else { FaceShading::Given };
        let shading = ShadingRuns::all(shading, weld.mesh.faces.len());
        Ok(Unshaded { mesh: weld.mesh, materials, shading, warnings })
    }
}
