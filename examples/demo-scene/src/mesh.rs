//! The generator's mesh type, with the content of an OBJ file, and the solids that buildings are composed of.

use super::maths::{cos_turns, sin_turns, unit_or};
use glam::{DVec2, DVec3};

/// One corner of a face; indices into the arrays of its [`ObjMesh`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Corner {
    pub(super) position: u32,
    pub(super) uv: Option<u32>,
    pub(super) normal: u32,
}

/// Faces that follow each other in the file under one name and material.
#[derive(Clone, Debug)]
pub(super) struct Group {
    pub(super) name: String,
    pub(super) material: &'static str,
    pub(super) faces: Vec<[Corner; 3]>,
}

/// A triangle mesh as an OBJ file states it: separate indices for positions, uvs and normals.
#[derive(Clone, Debug, Default)]
pub(super) struct ObjMesh {
    pub(super) positions: Vec<DVec3>,
    pub(super) uvs: Vec<DVec2>,
    pub(super) normals: Vec<DVec3>,
    pub(super) groups: Vec<Group>,
}

impl ObjMesh {
    pub(super) fn new() -> Self {
        Self::default()
    }

    /// Starts a group; later faces belong to it.
    pub(super) fn group(&mut self, name: &str, material: &'static str) {
        self.groups.push(Group { name: name.to_owned(), material, faces: Vec::new() });
    }

    /// Gives all faces one material and name.
    pub(super) fn single(mut self, name: &str, material: &'static str) -> Self {
        let faces = self.groups.drain(..).flat_map(|group| group.faces).collect();
        self.groups.push(Group { name: name.to_owned(), material, faces });
        self
    }

    pub(super) fn faces(&self) -> usize {
        self.groups.iter().map(|group| group.faces.len()).sum()
    }

    pub(super) fn position(&mut self, p: DVec3) -> u32 {
        self.positions.push(p);
        (self.positions.len() - 1) as u32
    }

    pub(super) fn uv(&mut self, u: f64, v: f64) -> Option<u32> {
        self.uvs.push(DVec2::new(u, v));
        Some((self.uvs.len() - 1) as u32)
    }

    pub(super) fn normal(&mut self, n: DVec3) -> u32 {
        self.normals.push(unit_or(n, DVec3::Y));
        (self.normals.len() - 1) as u32
    }

    pub(super) fn face(&mut self, corners: [Corner; 3]) {
        if self.groups.is_empty() {
            self.group("part", "stone");
        }
        if let Some(group) = self.groups.last_mut() {
            group.faces.push(corners);
        }
    }

    /// A flat polygon (a convex fan, counter-clockwise) over existing positions, mapped by `map`.
    pub(super) fn flat(&mut self, positions: &[u32], map: impl Fn(DVec3, DVec3) -> DVec2) {
        let at = |mesh: &Self, i: usize| mesh.positions[positions[i] as usize];
        let mut normal = DVec3::ZERO;
        for i in 1..positions.len() - 1 {
            normal += (at(self, i) - at(self, 0)).cross(at(self, i + 1) - at(self, 0));
        }
        let normal = unit_or(normal, DVec3::Y);
        let index = self.normal(normal);
        let corners: Vec<Corner> = positions
            .iter()
            .map(|&position| {
                let uv = map(self.positions[position as usize], normal);
                Corner { position, uv: self.uv(uv.x, uv.y), normal: index }
            })
            .collect();
        for i in 1..corners.len() - 1 {
            self.face([corners[0], corners[i], corners[i + 1]]);
        }
    }

    /// A dressed stone: the box from `low` to `high` with its edges cut at 45° by `chamfer`. Textures are projected
    /// along the axis that a side faces; a repeat is `tile` metres long.
    pub(super) fn stone(&mut self, low: DVec3, high: DVec3, chamfer: f64, tile: f64) {
        let map = |p: DVec3, n: DVec3| box_map(p, n) / tile;
        // Three positions per corner: the corner pulled back along each of the other two axes.
        let mut ids = [[0u32; 3]; 8];
        for (corner, row) in ids.iter_mut().enumerate() {
            let side = |axis: usize| corner >> axis & 1 == 1;
            for (keep, id) in row.iter_mut().enumerate() {
                let mut p = DVec3::ZERO;
                for axis in 0..3 {
                    let inset = if axis == keep { 0.0 } else { chamfer };
                    p[axis] = if side(axis) { high[axis] - inset } else { low[axis] + inset };
                }
                *id = self.position(p);
            }
        }
        let centre = (low + high) * 0.5;
        let outwards = |mesh: &mut Self, mut face: Vec<u32>| {
            let [a, b, c] = [0, 1, 2].map(|i| mesh.positions[face[i] as usize]);
            if (b - a).cross(c - a).dot(a - centre) < 0.0 {
                face.reverse();
            }
            mesh.flat(&face, map);
        };
        for axis in 0..3 {
            let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
            let at = |side: usize, a: usize, b: usize| side << axis | a << u | b << v;
            for side in 0..2 {
                let face = [(0, 0), (1, 0), (1, 1), (0, 1)].map(|(a, b)| ids[at(side, a, b)][axis]);
                outwards(self, face.to_vec());
            }
            // The four chamfers along this axis.
            for (a, b) in [(0, 0), (1, 0), (1, 1), (0, 1)] {
                let (near, far) = (ids[at(0, a, b)], ids[at(1, a, b)]);
                outwards(self, vec![near[u], far[u], far[v], near[v]]);
            }
        }
        for row in ids {
            outwards(self, row.to_vec());
        }
    }

    /// A flat rectangle of `nu` × `nv` quads from `origin` along `u` and `v`, with normal `u × v`. A texture repeat is
    /// `tile` metres long.
    pub(super) fn sheet(&mut self, origin: DVec3, u: DVec3, v: DVec3, cells: [usize; 2], tile: f64) {
        let [nu, nv] = cells;
        let normal = self.normal(u.cross(v));
        let mut corners = Vec::with_capacity((nu + 1) * (nv + 1));
        for j in 0..=nv {
            for i in 0..=nu {
                let (s, t) = (i as f64 / nu as f64, j as f64 / nv as f64);
                let position = self.position(origin + u * s + v * t);
                let uv = self.uv(s * u.length() / tile, t * v.length() / tile);
                corners.push(Corner { position, uv, normal });
            }
        }
        for j in 0..nv {
            for i in 0..nu {
                let a = j * (nu + 1) + i;
                let (b, c, d) = (a + 1, a + nu + 2, a + nu + 1);
                self.face([corners[a], corners[b], corners[c]]);
                self.face([corners[a], corners[c], corners[d]]);
            }
        }
    }

    /// A solid of revolution about the y axis, closed at both ends by flat caps. `rows` are
    /// (radius, height) from the bottom up; without `smooth`, rows are separated by hard edges. The uv
    /// seam lies at angle 0, and `tile` is the length of a texture repeat.
    pub(super) fn lathe(&mut self, rows: &[(f64, f64)], around: usize, smooth: bool, tile: f64) {
        self.lathe_fluted(rows, around, 0, 0.0, smooth, tile);
    }

    /// [`ObjMesh::lathe`] with `flutes` grooves around (0: none), `depth` deep relative to the radius, and sharp edges
    /// (arrises) between them. `around` is the number of steps of a whole turn, a multiple of `flutes`.
    pub(super) fn lathe_fluted(
        &mut self,
        rows: &[(f64, f64)],
        around: usize,
        flutes: usize,
        depth: f64,
        smooth: bool,
        tile: f64,
    ) {
        let per_flute = around / flutes.max(1);
        let hollow = |i: usize| {
            if flutes == 0 {
                return 1.0;
            }
            let x = 2.0 * (i % per_flute) as f64 / per_flute as f64 - 1.0;
            1.0 - depth * (1.0 - x * x)
        };
        let place = |radius: f64, height: f64, i: usize| {
            let turns = i as f64 / around as f64;
            let r = radius * hollow(i % around);
            DVec3::new(r * sin_turns(turns), height, r * cos_turns(turns))
        };
        let mut ids = Vec::with_capacity(rows.len());
        for &(radius, height) in rows {
            ids.push((0..around).map(|i| self.position(place(radius, height, i))).collect::<Vec<u32>>());
        }
        // Texture coordinates: once around is a whole number of repeats, so that the seam matches.
        let widest = rows.iter().fold(0.0_f64, |a, r| a.max(r.0));
        let repeats = (widest * std::f64::consts::TAU / tile).round().max(1.0);
        let mut uvs = Vec::with_capacity(rows.len());
        let mut length = 0.0;
        for (j, row) in rows.iter().enumerate() {
            if j > 0 {
                let (dr, dh) = (row.0 - rows[j - 1].0, row.1 - rows[j - 1].1);
                length += (dr * dr + dh * dh).sqrt();
            }
            let v = length / tile;
            uvs.push(
                (0..=around)
                    .map(|i| self.uv(repeats * i as f64 / around as f64, v))
                    .collect::<Vec<Option<u32>>>(),
            );
        }
        for j in 0..rows.len() - 1 {
            for i in 0..around {
                let next = (i + 1) % around;
                let quad = [ids[j][i], ids[j][next], ids[j + 1][next], ids[j + 1][i]];
                let uv = [uvs[j][i], uvs[j][i + 1], uvs[j + 1][i + 1], uvs[j + 1][i]];
                let normals = [
                    self.lathe_normal(&ids, (j, i), per_flute, 1, (smooth, j)),
                    self.lathe_normal(&ids, (j, i + 1), per_flute, -1, (smooth, j)),
                    self.lathe_normal(&ids, (j + 1, i + 1), per_flute, -1, (smooth, j)),
                    self.lathe_normal(&ids, (j + 1, i), per_flute, 1, (smooth, j)),
                ];
                let corner = |k: usize| Corner { position: quad[k], uv: uv[k], normal: normals[k] };
                self.face([corner(0), corner(1), corner(2)]);
                self.face([corner(0), corner(2), corner(3)]);
            }
        }
        let map = |p: DVec3, _: DVec3| DVec2::new(p.x, p.z) / tile;
        let last = rows.len() - 1;
        for (row, flip) in [(0, true), (last, false)] {
            let centre = self.position(DVec3::new(0.0, rows[row].1, 0.0));
            for i in 0..around {
                let (a, b) = (ids[row][i], ids[row][(i + 1) % around]);
                self.flat(&if flip { [centre, b, a] } else { [centre, a, b] }, map);
            }
        }
    }

    /// Normal at lattice point (row, step) for the face on the side `towards`: central differences, one-sided at sharp
    /// edges (arrises; rows too unless `smooth`).
    fn lathe_normal(
        &mut self,
        ids: &[Vec<u32>],
        (j, i): (usize, usize),
        per_flute: usize,
        towards: i64,
        (smooth, lower): (bool, usize),
    ) -> u32 {
        let around = ids[0].len();
        let at = |mesh: &Self, j: usize, i: i64| {
            mesh.positions[ids[j][i.rem_euclid(around as i64) as usize] as usize]
        };
        let i = i as i64;
        let arris = per_flute != around && i % per_flute as i64 == 0;
        let (from, to) = match (arris, towards > 0) {
            (false, _) => (i - 1, i + 1),
            (true, true) => (i, i + 1),
            (true, false) => (i - 1, i),
        };
        let (below, above) =
            if smooth { (j.saturating_sub(1), (j + 1).min(ids.len() - 1)) } else { (lower, lower + 1) };
        let along = at(self, j, to) - at(self, j, from);
        let up = at(self, above, i) - at(self, below, i);
        self.normal(along.cross(up))
    }
}

/// Coordinates in the plane that `normal` mostly faces, so that textures keep their size on stone.
pub(super) fn box_map(p: DVec3, normal: DVec3) -> DVec2 {
    let n = normal.abs();
    if n.y >= n.x && n.y >= n.z {
        DVec2::new(p.x, -p.z)
    } else if n.x >= n.z {
        DVec2::new(if normal.x > 0.0 { -p.z } else { p.z }, p.y)
    } else {
        DVec2::new(if normal.z > 0.0 { p.x } else { -p.x }, p.y)
    }
}
