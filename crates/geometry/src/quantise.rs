//! Quantisation of a source mesh: weld positions, drop unused elements, snap positions and uvs to integer grids.

#![cfg_attr(
    not(test),
    warn(
        clippy::cast_possible_truncation,
        clippy::cast_possible_wrap,
        clippy::cast_precision_loss,
        clippy::cast_sign_loss
    )
)]

mod uv_sets;

use std::collections::HashMap;
use std::hash::Hash;

use crate::error::MeshError;
use crate::mesh::normals;
use crate::mesh::skin::{Skin, mapped};
use crate::mesh::{Attributes, Face, Grid, MAX_PARTS, NO_COLOR, NONE, QuantisedMesh, SourceMesh, Wedge};
pub use crate::mesh::{MAX_POSITION_BITS, MAX_UV_BITS};
use crate::numbers::{id32, truncated};
use crate::quantise::uv_sets::UvSet;

/// Default bits per axis of the position grid: 1/16384 of the longest side, a tenth of a pixel for an
/// object that fills a 1600-pixel screen.
pub const DEFAULT_POSITION_BITS: u8 = 14;
/// Default bits per axis of the uv grid: a texel of a 4096-texel texture.
pub const DEFAULT_UV_BITS: u8 = 12;
/// Default of [`QuantiseSettings::normal_tolerance`], in degrees.
pub const DEFAULT_NORMAL_TOLERANCE: f64 = 10.0;
/// Fewest bits per axis.
pub const MIN_POSITION_BITS: u8 = 4;
/// Fewest bits per axis chosen for a tolerance; fewer would save little.
const MIN_TOLERANCE_BITS: u8 = 8;
/// Largest number of faces, positions or wedges: ids keep a few bits to spare.
const MAX_ELEMENTS: usize = 1 << 30;
/// Longest side of a mesh: spheres and errors still fit an f32.
const MAX_EXTENT: f64 = 1e38;
/// Normals of one vertex closer than this (cosine of 1°) belong to one normal group.
const SAME_NORMAL_COS: f32 = 0.999_847_7;

/// Precision of positions.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Precision {
    /// Bits per axis, [`MIN_POSITION_BITS`]`..=`[`MAX_POSITION_BITS`].
    Bits(u8),
    /// Largest distance, in the asset's units, between a source position and its grid point.
    Tolerance(f64),
}

/// Settings of [`quantise`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct QuantiseSettings {
    /// Precision of positions. More bits cost about 3 bits a vertex each.
    pub precision: Precision,
    /// Bits per axis of texture coordinates, `1..=16`, for each set.
    pub uv_bits: u8,
    /// Largest angle, in degrees, between a source normal and the normal computed from the faces, above which the
    /// normal is stored: 0 stores every normal that differs, 180 none.
    pub normal_tolerance: f64,
}

impl Default for QuantiseSettings {
    fn default() -> Self {
        Self {
            precision: Precision::Bits(DEFAULT_POSITION_BITS),
            uv_bits: DEFAULT_UV_BITS,
            normal_tolerance: DEFAULT_NORMAL_TOLERANCE,
        }
    }
}

/// Quantises a source mesh.
///
/// Equal positions of a part with equal skins are welded into one vertex; faces with a repeated vertex are dropped, then all unused elements.
/// Distinct positions on the same grid point stay distinct vertices. Normals become normal groups: corners at a
/// vertex whose normals agree within 1° share one; where a group's normal differs from the computed one by more than
/// the tolerance, its wedges store it. A source without normals is smooth: one group per vertex. Colours split wedges
/// as uvs do. Poses become maps of grid cells.
///
/// # Errors
/// Indices out of range, coordinates that are not finite f32 numbers, meshes longer than an f32 can represent,
/// material 65535, meshes without a usable face, and tolerances that need more than [`MAX_POSITION_BITS`].
pub fn quantise(source: &SourceMesh, settings: &QuantiseSettings) -> Result<QuantisedMesh, MeshError> {
    validate(source)?;
    let Welded { vertex_of, positions, skins } =
        if source.skins.is_empty() { weld(source, |_| ()) } else { weld(source, |at| source.skins[at]) };
    let mut kept = Vec::with_capacity(source.faces.len());
    for (index, face) in source.faces.iter().enumerate() {
        let [a, b, c] = face.map(|corner| vertex_of[corner.position as usize]);
        if a != b && b != c && a != c {
            kept.push(index);
        }
    }
    if kept.is_empty() {
        return Err(MeshError::NoFaces { dropped: source.faces.len() });
    }
    if !(1..=MAX_UV_BITS).contains(&settings.uv_bits) {
        let why = format!("{} uv bits requested; 1 to {MAX_UV_BITS} are possible", settings.uv_bits);
        return Err(MeshError::BadPrecision { why });
    }
    let grid = position_grid(source, &kept, &vertex_of, &positions, settings.precision)?;
    let [first_set, second_set] = UvSet::both(source);
    let [uv_grid, second_uv_grid] =
        [first_set, second_set].map(|set| set.grid(source, &kept, settings.uv_bits));

    let mut mesh = QuantisedMesh {
        grid,
        uv_grid,
        second_uv_grid,
        positions: Vec::new(),
        wedges: Vec::new(),
        faces: Vec::new(),
        parts: Vec::new(),
        skins: Vec::new(),
        poses: source
            .poses
            .iter()
            .map(|pose| pose.iter().map(|map| in_cells(&grid, map)).collect())
            .collect(),
    };
    mesh.faces.reserve_exact(kept.len());
    let mut vertices = NewVertices::new(positions.len());
    let mut groups = NormalGroups::default();
    let mut known = WedgeTable::default();
    let parted = !source.parts.is_empty();
    for &index in &kept {
        let wedges = source.faces[index].map(|corner| {
            let welded = vertex_of[corner.position as usize];
            let part = parted.then(|| source.parts.get(index).copied().unwrap_or(0));
            let next = id32(mesh.positions.len());
            let vertex = vertices.number(welded, part, next);
            if vertex == next {
                mesh.positions.push(snap(&grid, positions[welded as usize]));
                mesh.parts.extend(part);
                mesh.skins.extend(skins.get(welded as usize));
            }
            let (group, normal) = groups.group(vertex, corner.normal, &source.normals);
            let uv = first_set.snapped(&uv_grid, &corner);
            // A grid has at most 16 bits.
            let second_uv =
                second_set.snapped(&second_uv_grid, &corner).map(|x| u16::try_from(x).unwrap_or_default());
            let color = if corner.color == NONE { NO_COLOR } else { source.colors[corner.color as usize] };
            let wedge =
                Wedge { vertex, attributes: Attributes { uv, group, color, normal: None, second_uv } };
            known.number(wedge, &mut mesh.wedges, || groups.of_wedge.extend(normal))
        });
        mesh.faces.push(Face { wedges, material: source.materials.get(index).copied().unwrap_or(0) });
    }
    if !source.normals.is_empty() {
        let meant: Vec<_> =
            groups.of_wedge.iter().map(|&at| groups.normals[at as usize].map(f64::from)).collect();
        normals::store_explicit(&mut mesh, &meant, settings.normal_tolerance);
    }
    Ok(mesh)
}

/// Numbers welded positions in order of first use; a position in several parts gets a vertex in each.
struct NewVertices {
    /// The vertex of each position of a mesh of one part; [`NONE`] for none.
    single: Vec<u32>,
    /// The vertices of a mesh of several parts, by position and part.
    by_part: HashMap<(u32, u32), u32>,
}

impl NewVertices {
    fn new(positions: usize) -> Self {
        Self { single: vec![NONE; positions], by_part: HashMap::new() }
    }

    /// The vertex of a position in a part; `next` if it is new.
    fn number(&mut self, position: u32, part: Option<u32>, next: u32) -> u32 {
        let Some(part) = part else {
            let vertex = &mut self.single[position as usize];
            *vertex = if *vertex == NONE { next } else { *vertex };
            return *vertex;
        };
        *self.by_part.entry((position, part)).or_insert(next)
    }
}

/// Normal groups of each vertex in order of first use, as linked lists in one array, since most vertices have one
/// group.
#[derive(Default)]
struct NormalGroups {
    /// First group of each vertex; [`NONE`] for none.
    first: Vec<u32>,
    /// Unit normal of each group, zero if the source gives none, and in `next` the next group of the same vertex.
    normals: Vec<[f32; 3]>,
    next: Vec<u32>,
    /// Group index of each wedge; empty if the source has no normals.
    of_wedge: Vec<u32>,
}

impl NormalGroups {
    /// The group's number within the vertex, and its index among the normals, if there are any.
    fn group(&mut self, vertex: u32, normal: u32, normals: &[[f32; 3]]) -> (u32, Option<u32>) {
        if normals.is_empty() {
            return (0, None);
        }
        if self.first.len() <= vertex as usize {
            self.first.resize(vertex as usize + 1, NONE);
        }
        let n = if normal == NONE { [0.0; 3] } else { unit(normals[normal as usize]) };
        let same = |m: [f32; 3]| m == n || m[0] * n[0] + m[1] * n[1] + m[2] * n[2] >= SAME_NORMAL_COS;
        let mut number = 0;
        let mut link = &mut self.first[vertex as usize];
        while *link != NONE {
            let at = *link;
            if same(self.normals[at as usize]) {
                return (number, Some(at));
            }
            number += 1;
            link = &mut self.next[at as usize];
        }
        let new = id32(self.normals.len());
        *link = new;
        self.normals.push(n);
        self.next.push(NONE);
        (number, Some(new))
    }
}

/// Wedges per vertex that are compared one by one; further ones are hashed.
const MAX_COMPARED: usize = 16;

/// Deduplicates wedges by vertex. Nearly all vertices have one or two wedges; comparing takes a quarter of the time
/// of hashing all.
#[derive(Default)]
struct WedgeTable {
    /// Last compared wedge of each vertex, [`NONE`] for none; in `before`, the previous one of each wedge.
    last: Vec<u32>,
    before: Vec<u32>,
    others: HashMap<Wedge, u32>,
}

impl WedgeTable {
    /// The number of a wedge; a new one is appended to `wedges`, and `added` is called.
    fn number(&mut self, wedge: Wedge, wedges: &mut Vec<Wedge>, added: impl FnOnce()) -> u32 {
        let vertex = wedge.vertex as usize;
        if self.last.len() <= vertex {
            self.last.resize(vertex + 1, NONE);
        }
        let (mut at, mut compared) = (self.last[vertex], 0);
        while at != NONE {
            if wedges[at as usize] == wedge {
                return at;
            }
            compared += 1;
            at = self.before[at as usize];
        }
        let new = id32(wedges.len());
        let many = compared == MAX_COMPARED;
        if many && let Some(&number) = self.others.get(&wedge) {
            return number;
        }
        if many {
            self.others.insert(wedge, new);
            self.before.push(NONE);
        } else {
            self.before.push(std::mem::replace(&mut self.last[vertex], new));
        }
        wedges.push(wedge);
        added();
        new
    }
}

fn unit(n: [f32; 3]) -> [f32; 3] {
    let length = (n[0] * n[0] + n[1] * n[1] + n[2] * n[2]).sqrt();
    if length > 0.0 && length.is_finite() { n.map(|x| x / length) } else { [0.0; 3] }
}

fn validate(source: &SourceMesh) -> Result<(), MeshError> {
    let counts = [
        ("faces", source.faces.len()),
        ("positions", source.positions.len()),
        ("uvs", source.uvs.len()),
        ("second uvs", source.second_uvs.len()),
    ];
    for (kind, count) in counts {
        if count > MAX_ELEMENTS {
            return Err(MeshError::TooLarge { kind, count, limit: MAX_ELEMENTS });
        }
    }
    if let Some(part) = source.parts.iter().find(|&&part| part >= MAX_PARTS) {
        return Err(MeshError::TooLarge {
            kind: "parts",
            count: *part as usize + 1,
            limit: MAX_PARTS as usize,
        });
    }
    let joints = source.skins.iter().map(|skin| skin.joint_count()).max().unwrap_or(0);
    let posed = source
        .poses
        .iter()
        .all(|pose| pose.len() >= joints && pose.iter().flatten().flatten().all(|number| number.is_finite()));
    if !posed || !(source.skins.is_empty() || source.skins.len() == source.positions.len()) {
        return Err(MeshError::BadSkins);
    }
    if source.materials.contains(&u16::MAX) {
        let limit = usize::from(u16::MAX);
        return Err(MeshError::TooLarge { kind: "materials", count: limit + 1, limit });
    }
    for (index, position) in source.positions.iter().enumerate() {
        for &value in position {
            if !value.is_finite() || value.abs() > f64::from(f32::MAX) {
                return Err(MeshError::BadCoordinate { index, value });
            }
        }
    }
    for uvs in [&source.uvs, &source.second_uvs] {
        if let Some(index) = uvs.iter().position(|uv| !uv.iter().all(|x| x.is_finite())) {
            return Err(MeshError::BadUv { index });
        }
    }
    for (face, corners) in source.faces.iter().enumerate() {
        for corner in corners {
            let checks = [
                ("position", corner.position, source.positions.len(), false),
                ("uv", corner.uv, source.uvs.len(), true),
                ("second uv", corner.second_uv, source.second_uvs.len(), true),
                ("normal", corner.normal, source.normals.len(), true),
                ("color", corner.color, source.colors.len(), true),
            ];
            for (kind, index, count, optional) in checks {
                if index as usize >= count && !(optional && index == NONE) {
                    return Err(MeshError::BadIndex { face, kind, index, count });
                }
            }
        }
    }
    Ok(())
}

/// Positions without repetition.
struct Welded {
    /// The welded position of each source position.
    vertex_of: Vec<u32>,
    positions: Vec<[f64; 3]>,
    /// Skins of the welded positions; empty without.
    skins: Vec<Skin>,
}

/// Welds equal positions that have the same key.
fn weld<K: Copy + Eq + Hash>(source: &SourceMesh, key: impl Fn(usize) -> K) -> Welded {
    let mut first: HashMap<([u64; 3], K), u32> = HashMap::with_capacity(source.positions.len());
    let (mut positions, mut skins) = (Vec::new(), Vec::new());
    let vertex_of = source
        .positions
        .iter()
        .enumerate()
        .map(|(at, p)| {
            // Adding +0.0 turns -0.0 into +0.0, so that the two are one position.
            *first.entry((p.map(|x| (x + 0.0).to_bits()), key(at))).or_insert_with(|| {
                positions.push(*p);
                skins.extend(source.skins.get(at));
                id32(positions.len() - 1)
            })
        })
        .collect();
    Welded { vertex_of, positions, skins }
}

/// An affine map in a grid's cells.
fn in_cells(grid: &Grid, map: &[[f64; 4]; 3]) -> [[f64; 4]; 3] {
    let step = if grid.step > 0.0 { grid.step } else { 1.0 };
    let at_origin = mapped(map, grid.origin);
    [0, 1, 2].map(|axis| {
        let [a, b, c, _] = map[axis];
        [a, b, c, (at_origin[axis] - grid.origin[axis]) / step]
    })
}

fn position_grid(
    source: &SourceMesh,
    kept: &[usize],
    vertex_of: &[u32],
    positions: &[[f64; 3]],
    precision: Precision,
) -> Result<Grid, MeshError> {
    let mut min = [f64::INFINITY; 3];
    let mut max = [f64::NEG_INFINITY; 3];
    for &face in kept {
        for corner in &source.faces[face] {
            let p = positions[vertex_of[corner.position as usize] as usize];
            for axis in 0..3 {
                min[axis] = min[axis].min(p[axis]);
                max[axis] = max[axis].max(p[axis]);
            }
        }
    }
    let extent = (0..3).map(|axis| max[axis] - min[axis]).fold(0.0, f64::max);
    if extent > MAX_EXTENT {
        return Err(MeshError::BadPrecision {
            why: format!("the mesh is {extent} long; at most {MAX_EXTENT} is possible"),
        });
    }
    let bits = match precision {
        Precision::Bits(bits) => {
            if !(MIN_POSITION_BITS..=MAX_POSITION_BITS).contains(&bits) {
                return Err(MeshError::BadPrecision {
                    why: format!(
                        "{bits} bits requested; {MIN_POSITION_BITS} to {MAX_POSITION_BITS} are possible"
                    ),
                });
            }
            bits
        }
        Precision::Tolerance(tolerance) => bits_for(extent, tolerance)?,
    };
    let cells = f64::from((1_u32 << bits) - 1);
    Ok(Grid { origin: min, step: extent / cells, bits })
}

/// The fewest bits at which half a cell's diagonal is at most `tolerance`.
fn bits_for(extent: f64, tolerance: f64) -> Result<u8, MeshError> {
    if !(tolerance > 0.0 && tolerance.is_finite()) {
        return Err(MeshError::BadPrecision {
            why: format!("the tolerance {tolerance} is not a positive length"),
        });
    }
    let half_diagonal = 3.0_f64.sqrt() * 0.5;
    for bits in MIN_TOLERANCE_BITS..=MAX_POSITION_BITS {
        let step = extent / f64::from((1_u32 << bits) - 1);
        if step * half_diagonal <= tolerance {
            return Ok(bits);
        }
    }
    Err(MeshError::BadPrecision {
        why: format!(
            "the tolerance {tolerance} needs more than {MAX_POSITION_BITS} bits for a mesh {extent} long; \
             split the mesh or allow a larger tolerance"
        ),
    })
}

fn snap(grid: &Grid, p: [f64; 3]) -> [i32; 3] {
    let top = f64::from((1_u32 << grid.bits) - 1);
    [0, 1, 2].map(|axis| truncated(((p[axis] - grid.origin[axis]) / grid.step).round().clamp(0.0, top)))
}
