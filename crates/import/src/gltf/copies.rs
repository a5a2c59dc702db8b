//! Meshes of a file that are copies of others: equal up to a rotation, uniform scale, translation and mirror, vertex by
//! vertex in the order of the file. Programs that export a model often apply the transformations of repeated objects to
//! their vertices; found again, the copies become instances.
//!
//! Meshes that state other numbers of corners or other materials are not read. The others are compared by their faces and
//! by lengths that a similarity leaves in proportion, and only where these agree is a similarity fitted.

use std::collections::{BTreeMap, BTreeSet, HashMap};
use std::hash::{DefaultHasher, Hash as _, Hasher as _};

use glam::{DMat3, DMat4, DQuat, DVec3};
use gltf::json::mesh::{Mode, Semantic};
use lodestream_geometry::mesh::{Corner, SourceMesh};

use super::container::Document;
use super::mesh::Builder;
use super::root::{Mesh, Primitive};
use super::similarity::{centroid, fit, largest_distance};
use crate::error::ImportError;

/// Largest distance between a vertex of a copy and the mapped vertex of its original.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum CopyTolerance {
    /// A share of the longest side of the copy's bounds.
    Share(f64),
    /// In the file's units, before nodes place the mesh.
    Length(f64),
}

impl CopyTolerance {
    fn length(self, extent: f64) -> f64 {
        match self {
            Self::Share(share) => share * extent,
            Self::Length(length) => length,
        }
    }
}

/// Most originals whose proportions are compared with a mesh's.
const MAX_NEAR: usize = 64;
/// Largest difference of proportions of a copy, in shares of the radius by which a vertex may be off, times one more than the
/// proportion: a length is off by two of them at most and the radius by one, so a proportion `p` by `2 + p`.
const SLACK: f64 = 2.5;
/// Most originals that are fitted to a mesh.
const MAX_FITS: usize = 4;
/// Most corners read for each byte of the file's buffers, which bounds the work for meshes that share their bytes. Two are
/// usual, and some ten if the bytes are compressed.
const CORNERS_PER_BYTE: u64 = 32;
/// Largest distance between unit normals of a copy and its original: files store them in as little as 8 bits.
const NORMAL_DISTANCE: f32 = 0.02;
/// Largest difference of texture coordinates.
const UV_DISTANCE: f32 = 1e-6;

/// What two meshes must have in common to be compared: of each primitive the mode, the material, and the number of corners.
type Stated = Vec<(Option<u32>, Option<usize>, u64)>;

/// For each mesh that is a copy, its original and the map from there. Originals are no copies.
pub(super) fn of_meshes(
    document: &Document,
    placed: &BTreeSet<usize>,
    tolerance: CopyTolerance,
) -> BTreeMap<usize, (usize, DMat4)> {
    let mut copies = BTreeMap::new();
    let mut identical: HashMap<&[Primitive], usize> = HashMap::new();
    let mut groups: BTreeMap<Stated, Vec<usize>> = BTreeMap::new();
    for &number in placed {
        let mesh = document.root.meshes.get(number).filter(|mesh| mesh.pose.is_plain());
        let Some(mesh) = mesh else { continue };
        if let Some(&original) = identical.get(&*mesh.primitives) {
            copies.insert(number, (original, DMat4::IDENTITY));
            continue;
        }
        identical.insert(&mesh.primitives, number);
        if let Some(stated) = stated(document, mesh) {
            groups.entry(stated).or_default().push(number);
        }
    }
    let mut finder = Finder {
        builder: Builder::of_shapes(document),
        tolerance,
        corners: document.root.buffers.iter().map(|buffer| buffer.byte_length.0).sum::<u64>(),
    };
    finder.corners = finder.corners.saturating_mul(CORNERS_PER_BYTE);
    for group in groups.values().filter(|group| group.len() > 1) {
        finder.compare(group, &mut copies);
    }
    // An identical mesh of a copy is a copy of the same original.
    let resolved = |(original, map): (usize, DMat4)| match copies.get(&original) {
        Some(&(first, before)) => (first, map * before),
        None => (original, map),
    };
    copies.iter().map(|(&number, &copy)| (number, resolved(copy))).collect()
}

/// `None` for meshes that are not read: those with Draco streams, which take long to decode.
fn stated(document: &Document, mesh: &Mesh) -> Option<Stated> {
    let of_primitive = |primitive: &Primitive| {
        if primitive.draco.is_some() {
            return None;
        }
        let positions = primitive.attribute(&Semantic::Positions)?;
        let corners = document.root.accessors.get(primitive.indices.unwrap_or(positions).value())?.count;
        let mode = primitive.mode().map(Mode::as_gl_enum);
        Some((mode, primitive.material.map(|material| material.value()), corners))
    };
    mesh.primitives.iter().map(of_primitive).collect()
}

/// A mesh that was read and is no copy, with the lengths that its copies have in proportion.
struct Original {
    mesh: usize,
    proportions: [f64; 6],
}

/// Finds the copies among meshes that state the same.
struct Finder<'a> {
    builder: Builder<'a>,
    tolerance: CopyTolerance,
    /// Corners that may still be read.
    corners: u64,
}

impl Finder<'_> {
    /// Adds the copies of a group, whose meshes are in order.
    fn compare(&mut self, group: &[usize], copies: &mut BTreeMap<usize, (usize, DMat4)>) {
        // By faces, then by the first proportion, whose bits have its order as it is positive.
        let mut originals: BTreeMap<([u64; 2], u64, usize), Original> = BTreeMap::new();
        let mut kept = Kept::default();
        for &number in group {
            let Some(mesh) = self.read(number) else { continue };
            let Some(shape) = Shape::of(&mesh) else { continue };
            let slack = SLACK * self.tolerance.length(shape.extent) / shape.radius;
            let faces = faces_key(&mesh);
            let [first, ..] = shape.proportions;
            let low = (first - slack * (1.0 + first)).max(0.0);
            let high = first + slack * (1.0 + first);
            let range = (faces, low.to_bits(), 0)..=(faces, high.to_bits(), usize::MAX);
            let near = originals.range(range).take(MAX_NEAR).map(|(_, original)| original);
            let mut similar: Vec<usize> = near
                .filter(|original| {
                    let pairs = original.proportions.iter().zip(shape.proportions);
                    pairs.into_iter().all(|(a, b)| (a - b).abs() <= slack * (1.0 + b))
                })
                .map(|original| original.mesh)
                .collect();
            similar.sort_unstable();
            let found = similar.into_iter().take(MAX_FITS).find_map(|original| {
                let read = self.original(original, &mut kept)?;
                Some((original, copy_of(read, &mesh, self.tolerance.length(shape.extent))?))
            });
            match found {
                Some(copy) => drop(copies.insert(number, copy)),
                None => {
                    let original = Original { mesh: number, proportions: shape.proportions };
                    originals.insert((faces, first.to_bits(), number), original);
                    kept.add(number, mesh);
                }
            }
        }
    }

    /// An original again: read, unless it is kept. Counts as read in either case, so that what is found does not depend on
    /// what is kept.
    fn original<'k>(&mut self, mesh: usize, kept: &'k mut Kept) -> Option<&'k SourceMesh> {
        if !kept.meshes.contains_key(&mesh) {
            let read = self.read(mesh)?;
            kept.add(mesh, read);
            return kept.meshes.get(&mesh);
        }
        let known = kept.meshes.get(&mesh)?;
        self.count(known).then_some(known)
    }

    /// The mesh, untransformed; `None` if it cannot be read, which is an error where it is imported, or if too much was
    /// read already.
    fn read(&mut self, mesh: usize) -> Option<SourceMesh> {
        if self.corners == 0 {
            return None;
        }
        let read: Result<SourceMesh, ImportError> = self.builder.take(mesh);
        let read = read.ok()?;
        self.count(&read);
        Some(read)
    }

    /// Counts a mesh as read; false if too much was read already.
    fn count(&mut self, mesh: &SourceMesh) -> bool {
        let enough = self.corners > 0;
        self.corners = self.corners.saturating_sub(3 * mesh.faces.len() as u64 + 1);
        enough
    }
}

/// Most corners of the originals that are kept, some 40 bytes each.
const MAX_KEPT: usize = 1 << 17;

/// Originals of a group, to be compared with further meshes.
#[derive(Default)]
struct Kept {
    meshes: HashMap<usize, SourceMesh>,
    corners: usize,
}

impl Kept {
    /// Adds an original; forgets the others where they are too many.
    fn add(&mut self, number: usize, mesh: SourceMesh) {
        let corners = 3 * mesh.faces.len();
        if self.corners + corners > MAX_KEPT {
            *self = Self::default();
        }
        self.corners += corners;
        self.meshes.insert(number, mesh);
    }
}

/// Lengths of a mesh that a similarity leaves in proportion.
struct Shape {
    /// Longest side of its bounds.
    extent: f64,
    /// Root mean square of the distances from the centroid.
    radius: f64,
    /// Lengths over the radius, from all vertices and from some by their place in the file.
    proportions: [f64; 6],
}

impl Shape {
    /// `None` for meshes without faces or extent.
    fn of(mesh: &SourceMesh) -> Option<Self> {
        let points = &mesh.positions;
        if mesh.faces.is_empty() {
            return None;
        }
        let count = points.len() as f64;
        let centre = centroid(points);
        let from_centre = |point: &[f64; 3]| (DVec3::from(*point) - centre).length();
        let between = |a: [f64; 3], b: [f64; 3]| (DVec3::from(a) - DVec3::from(b)).length();
        let radius = (points.iter().map(|point| from_centre(point).powi(2)).sum::<f64>() / count).sqrt();
        let bounds = points.iter().map(|&point| DVec3::from(point));
        let (low, high) = (bounds.clone().reduce(DVec3::min)?, bounds.reduce(DVec3::max)?);
        let extent = (high - low).max_element();
        if !(radius > 0.0 && radius.is_finite() && extent.is_finite()) {
            return None;
        }
        let steps: f64 = points.windows(2).map(|pair| between(pair[0], pair[1])).sum();
        let (first, middle, last) = (points.first()?, points.get(points.len() / 2)?, points.last()?);
        let lengths = [
            steps / count,
            points.iter().map(from_centre).sum::<f64>() / count,
            points.iter().map(from_centre).fold(0.0, f64::max),
            from_centre(first),
            between(*first, *middle),
            between(*middle, *last),
        ];
        Some(Self { extent, radius, proportions: lengths.map(|length| length / radius) })
    }
}

/// A face with its least corner first, so that files may start it anywhere.
fn canonical(face: [Corner; 3]) -> [Corner; 3] {
    let least = (0..3).min_by_key(|&i| face[i].position).unwrap_or(0);
    [0, 1, 2].map(|i| face[(least + i) % 3])
}

fn reversed([a, b, c]: [Corner; 3]) -> [Corner; 3] {
    [a, c, b]
}

/// The same for two meshes with the same faces, whichever way around these go. Equal keys prove nothing.
fn faces_key(mesh: &SourceMesh) -> [u64; 2] {
    let mut hashers = [DefaultHasher::new(), DefaultHasher::new()];
    for &face in &mesh.faces {
        for (hasher, face) in hashers.iter_mut().zip([face, reversed(face)]) {
            canonical(face).map(|corner| corner.position).hash(hasher);
        }
    }
    let mut key = hashers.map(|hasher| hasher.finish());
    key.sort_unstable();
    key
}

/// Scales and parts of a rotation that differ by less from 1 and 0 are taken for these where the tolerance allows.
const ROUNDING: f64 = 1e-5;

/// A map with simpler numbers, which take fewer bytes in a scene: without the noise of rounded vertices.
fn simple(map: &DMat4, from: &[[f64; 3]], to: &[[f64; 3]], tolerance: f64) -> DMat4 {
    let linear = DMat3::from_mat4(*map);
    let sign = linear.determinant().signum();
    let scale = linear.determinant().abs().cbrt();
    let rotation = DQuat::from_mat3(&(linear * (sign / scale)));
    let rotation = rotation.to_array().map(|part| if part.abs() < ROUNDING { 0.0 } else { part });
    let scale = if (scale - 1.0).abs() < ROUNDING { 1.0 } else { scale };
    let linear = DMat3::from_quat(DQuat::from_array(rotation).normalize()) * (scale * sign);
    let step = (tolerance / 4.0).log2().floor().exp2();
    let translation = centroid(to) - linear * centroid(from);
    let rounded = (translation / step).round() * step;
    DMat4::from_mat3_translation(linear, if rounded.is_finite() { rounded } else { translation })
}

/// The similarity that makes `original` to `copy`, if every vertex is within the tolerance and everything else is equal.
fn copy_of(original: &SourceMesh, copy: &SourceMesh, tolerance: f64) -> Option<DMat4> {
    let counts = |mesh: &SourceMesh| {
        let uvs = [mesh.uvs.len(), mesh.second_uvs.len()];
        (mesh.positions.len(), mesh.normals.len(), uvs, mesh.colors.len(), mesh.faces.len())
    };
    if counts(original) != counts(copy) || original.colors != copy.colors {
        return None;
    }
    let faces = || original.faces.iter().zip(&copy.faces);
    // The faces of a mirror image go around the other way, or it would be inside out.
    let same = faces().all(|(&a, &b)| canonical(a) == canonical(b));
    if !same && !faces().all(|(&a, &b)| canonical(reversed(a)) == canonical(b)) {
        return None;
    }
    let near = |a: &[[f32; 2]], b: &[[f32; 2]]| {
        a.iter().flatten().zip(b.iter().flatten()).all(|(a, b)| (a - b).abs() <= UV_DISTANCE)
    };
    if !near(&original.uvs, &copy.uvs) || !near(&original.second_uvs, &copy.second_uvs) {
        return None;
    }
    let (from, to) = (&original.positions, &copy.positions);
    let near = |map: &DMat4| largest_distance(map, from, to) <= tolerance;
    let moved = simple(&DMat4::from_translation(centroid(to) - centroid(from)), from, to, tolerance);
    let map = Some(moved).filter(|map| same && near(map)).or_else(|| {
        let fitted = fit(from, to, !same)?;
        Some(simple(&fitted, from, to, tolerance)).filter(near).or(Some(fitted).filter(near))
    })?;
    let linear = DMat3::from_mat4(map);
    let rotation = linear * linear.determinant().abs().cbrt().recip();
    let straight = original.normals.iter().zip(&copy.normals).all(|(a, b)| {
        (rotation.as_mat3() * glam::Vec3::from(*a) - glam::Vec3::from(*b)).length() <= NORMAL_DISTANCE
    });
    straight.then_some(map)
}
