//! Mesh generators.

use std::collections::BTreeMap;

use lodestream_geometry::mesh::skin::Skin;
use lodestream_geometry::mesh::{Corner, SourceMesh};
use lodestream_geometry::random::Random;

use super::bare_mesh::bare;

/// A closed sphere of `rings` × `columns`, with radial noise.
pub(crate) fn sphere(rings: u32, columns: u32, noise: f64) -> SourceMesh {
    let mut random = Random::new(7);
    let mut positions = vec![[0.0, 0.0, 1.0]];
    for ring in 1..rings {
        for column in 0..columns {
            let polar = std::f64::consts::PI * f64::from(ring) / f64::from(rings);
            let around = std::f64::consts::TAU * f64::from(column) / f64::from(columns);
            let r = 1.0 + noise * (random.unit() - 0.5);
            positions.push([r * polar.sin() * around.cos(), r * polar.sin() * around.sin(), r * polar.cos()]);
        }
    }
    positions.push([0.0, 0.0, -1.0]);
    let south = positions.len() as u32 - 1;
    let at = |ring: u32, column: u32| 1 + (ring - 1) * columns + column % columns;
    let mut faces = Vec::new();
    for column in 0..columns {
        faces.push([0, at(1, column), at(1, column + 1)]);
        faces.push([south, at(rings - 1, column + 1), at(rings - 1, column)]);
        for ring in 1..rings - 1 {
            let (a, b) = (at(ring, column), at(ring, column + 1));
            let (c, d) = (at(ring + 1, column), at(ring + 1, column + 1));
            faces.extend([[a, c, d], [a, d, b]]);
        }
    }
    bare(positions, &faces)
}

/// A torus with a uv grid and seams in both directions.
pub(crate) fn torus(around: u32, across: u32) -> SourceMesh {
    let mut mesh = SourceMesh::default();
    for i in 0..around {
        for j in 0..across {
            let (u, v) = (
                std::f64::consts::TAU * f64::from(i) / f64::from(around),
                std::f64::consts::TAU * f64::from(j) / f64::from(across),
            );
            let r = 2.0 + (0.7 + 0.05 * (5.0 * u).sin()) * v.cos();
            mesh.positions.push([r * u.cos(), r * u.sin(), 0.7 * v.sin()]);
        }
    }
    for i in 0..=around {
        for j in 0..=across {
            mesh.uvs.push([i as f32 / around as f32, j as f32 / across as f32]);
        }
    }
    let corner = |i: u32, j: u32| Corner {
        position: (i % around) * across + j % across,
        uv: i * (across + 1) + j,
        ..Corner::at(0)
    };
    for i in 0..around {
        for j in 0..across {
            let [a, b, c, d] = [corner(i, j), corner(i + 1, j), corner(i, j + 1), corner(i + 1, j + 1)];
            mesh.faces.extend([[a, b, d], [a, d, c]]);
        }
    }
    mesh.materials = vec![0; mesh.faces.len()];
    mesh
}

/// An open, bumpy height field with holes.
pub(crate) fn height_field(size: u32) -> SourceMesh {
    let mut random = Random::new(11);
    let mut positions = Vec::new();
    for y in 0..=size {
        for x in 0..=size {
            let (fx, fy) = (f64::from(x), f64::from(y));
            let z = 2.0 * (fx * 0.3).sin() * (fy * 0.23).cos() + 0.3 * random.unit();
            positions.push([fx, fy, z]);
        }
    }
    let at = |x: u32, y: u32| y * (size + 1) + x;
    let mut faces = Vec::new();
    for y in 0..size {
        for x in 0..size {
            if (x % 13 < 3 && y % 17 < 4) || random.below(97) == 0 {
                continue;
            }
            faces.extend([
                [at(x, y), at(x + 1, y), at(x + 1, y + 1)],
                [at(x, y), at(x + 1, y + 1), at(x, y + 1)],
            ]);
        }
    }
    bare(positions, &faces)
}

/// Parts of all generators, overlapping, with missing, duplicate and flipped faces, and separate uvs and materials at
/// most corners.
pub(crate) fn medley(scale: u32) -> SourceMesh {
    let mut random = Random::new(23);
    let parts = [
        frigate(scale),
        fans(5 * scale),
        bow_ties(4 * scale),
        soup(20 * scale),
        torus(4 + 2 * scale, 5 + scale),
        height_field(4 + scale),
        dust(20 * scale),
    ];
    let mut mesh = sphere(4 + scale, 6 + scale, 0.1);
    for part in &parts {
        let by = [0, 1, 2].map(|_| 2.0 * random.unit());
        mesh = join(mesh, part, by);
    }
    // Some vertices of different parts coincide.
    for i in (0..mesh.positions.len()).step_by(11) {
        mesh.positions[i] = mesh.positions[random.below(mesh.positions.len())];
    }
    let charts = mesh.uvs.len() as u32;
    mesh.uvs.extend((0..40).map(|i| [(i % 8) as f32 / 8.0, (i / 8) as f32 / 5.0]));
    for i in 0..mesh.faces.len() {
        let mut face = mesh.faces[i];
        for corner in &mut face {
            if random.below(3) > 0 {
                corner.uv = charts + random.below(40) as u32;
            }
            corner.normal = u32::MAX;
        }
        mesh.faces[i] = face;
        mesh.materials[i] = random.below(4) as u16;
        match random.below(20) {
            0 => mesh.faces[i] = [face[0], face[0], face[1]],
            1 => mesh.faces[i] = [face[0], face[2], face[1]],
            2 => {
                mesh.faces.push([face[1], face[2], face[0]]);
                mesh.materials.push(mesh.materials[i]);
            }
            3 => {
                mesh.faces.push([face[2], face[1], face[0]]);
                mesh.materials.push(3);
            }
            _ => {}
        }
    }
    mesh
}

/// Boxes of quads with separate uvs and hard edges, so that nearly every vertex is on a seam.
pub(crate) fn frigate(boxes: u32) -> SourceMesh {
    const SIDE: u32 = 4;
    let mut mesh = SourceMesh::default();
    for b in 0..boxes {
        let place = [f64::from(b) * 1.4, f64::from(b % 3) * 0.9, f64::from(b % 5) * 0.3];
        for side in 0..6 {
            let (axis, flip) = (side / 2, side % 2 == 1);
            let normal = mesh.normals.len() as u32;
            let mut n = [0.0; 3];
            n[axis] = if flip { -1.0 } else { 1.0 };
            mesh.normals.push(n);
            for i in 0..SIDE {
                for j in 0..SIDE {
                    // Charts of single quads; neighbours' uvs differ.
                    let chart = ((i * 7 + j * 3 + b) % 16) as f32;
                    let mut quad = [(i, j), (i + 1, j), (i + 1, j + 1), (i, j + 1)].map(|(i, j)| {
                        let (s, t) = (f64::from(i) / f64::from(SIDE), f64::from(j) / f64::from(SIDE));
                        let mut p = [0.0; 3];
                        p[axis] = f64::from(u8::from(!flip));
                        p[(axis + 1) % 3] = s;
                        p[(axis + 2) % 3] = t;
                        mesh.positions.push([0, 1, 2].map(|k| p[k] + place[k]));
                        mesh.uvs.push([chart * 0.06 + 0.05 * s as f32, chart * 0.03 + 0.05 * t as f32]);
                        let index = mesh.positions.len() as u32 - 1;
                        Corner { uv: index, normal, ..Corner::at(index) }
                    });
                    if flip {
                        quad.reverse();
                    }
                    mesh.faces.extend([[quad[0], quad[1], quad[2]], [quad[0], quad[2], quad[3]]]);
                    mesh.materials.extend([(side % 2) as u16; 2]);
                }
            }
        }
    }
    mesh
}

/// A wall of stones with chamfered edges, flat and sharp, on a floor of another material; textures are projected
/// along the main axis of each face.
pub(crate) fn stones(count: u32) -> SourceMesh {
    let mut random = Random::new(11);
    let mut mesh = SourceMesh::default();
    for i in 0..count {
        let (row, column) = (f64::from(i / 6), f64::from(i % 6));
        let low = [2.0 * column + 0.3 * random.unit(), 0.4 * random.unit(), row];
        let high = [2.0 * column + 1.9, 1.0 + 0.2 * random.unit(), row + 0.97];
        stone(&mut mesh, low, high, 0.06);
    }
    let floor = |x: u32, y: u32| [f64::from(x) * 1.25 - 1.0, f64::from(y) * 0.5 - 3.0, 0.0];
    for (x, y) in (0..12).flat_map(|x| (0..6).map(move |y| (x, y))) {
        let quad = [floor(x, y), floor(x + 1, y), floor(x + 1, y + 1), floor(x, y + 1)];
        flat(&mut mesh, &quad, [0.0, 0.0, 1.0], 1);
    }
    mesh
}

/// A box with its edges cut off at 45°.
fn stone(mesh: &mut SourceMesh, low: [f64; 3], high: [f64; 3], chamfer: f64) {
    // By corner and axis: the corner of the side along that axis.
    let place = |corner: usize, side: usize| {
        [0, 1, 2].map(|k| {
            let inset = if k == side { 0.0 } else { chamfer };
            if corner >> k & 1 == 1 { high[k] - inset } else { low[k] + inset }
        })
    };
    let centre = [0, 1, 2].map(|k| 0.5 * (low[k] + high[k]));
    let mut out = |places: &[[f64; 3]]| flat(mesh, places, centre, 0);
    for axis in 0..3 {
        let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
        let at = |side: usize, a: usize, b: usize| side << axis | a << u | b << v;
        let around = [(0, 0), (1, 0), (1, 1), (0, 1)];
        for side in 0..2 {
            out(&around.map(|(a, b)| place(at(side, a, b), axis)));
        }
        for (a, b) in around {
            let (near, far) = (at(0, a, b), at(1, a, b));
            out(&[place(near, u), place(far, u), place(far, v), place(near, v)]);
        }
    }
    for corner in 0..8 {
        out(&[0, 1, 2].map(|side| place(corner, side)));
    }
}

/// A convex polygon facing away from `inside`, with its own normal; for a floor, `inside` is the normal.
fn flat(mesh: &mut SourceMesh, places: &[[f64; 3]], inside: [f64; 3], material: u16) {
    let minus = |a: [f64; 3], b: [f64; 3]| [0, 1, 2].map(|k| a[k] - b[k]);
    let dot = |a: [f64; 3], b: [f64; 3]| a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
    let (e, f) = (minus(places[1], places[0]), minus(places[2], places[0]));
    let n = [e[1] * f[2] - e[2] * f[1], e[2] * f[0] - e[0] * f[2], e[0] * f[1] - e[1] * f[0]];
    let way = if material == 0 { minus(places[0], inside) } else { inside };
    let turned = dot(n, way) < 0.0;
    let size = dot(n, n).sqrt() * if turned { -1.0 } else { 1.0 };
    let n = n.map(|x| x / size);
    // For a chamfer the first axis, so that rounding does not decide.
    let axis = (0..3).find(|&k| n.iter().all(|x| x.abs() < n[k].abs() + 1e-9)).unwrap_or(0);
    let normal = mesh.normals.len() as u32;
    mesh.normals.push(n.map(|x| x as f32));
    let corners: Vec<Corner> = places
        .iter()
        .map(|&p| {
            let index = mesh.positions.len() as u32;
            mesh.positions.push(p);
            let [u, v] = [p[(axis + 1) % 3], p[(axis + 2) % 3]].map(|x| (x / 2.4) as f32);
            mesh.uvs.push([if n[axis] < 0.0 { -u } else { u }, v]);
            Corner { uv: index, normal, ..Corner::at(index) }
        })
        .collect();
    for i in 1..corners.len() - 1 {
        let [a, b] = if turned { [i + 1, i] } else { [i, i + 1] };
        mesh.faces.push([corners[0], corners[a], corners[b]]);
        mesh.materials.push(material);
    }
}

/// The surface with a separate normal for every face.
pub(crate) fn flat_shaded(mut mesh: SourceMesh) -> SourceMesh {
    mesh.normals.clear();
    for face in &mut mesh.faces {
        let [a, b, c] = face.map(|corner| mesh.positions[corner.position as usize]);
        let (e, f) = ([0, 1, 2].map(|k| b[k] - a[k]), [0, 1, 2].map(|k| c[k] - a[k]));
        let n = [e[1] * f[2] - e[2] * f[1], e[2] * f[0] - e[0] * f[2], e[0] * f[1] - e[1] * f[0]];
        let size = (n[0] * n[0] + n[1] * n[1] + n[2] * n[2]).sqrt();
        for corner in face {
            corner.normal = mesh.normals.len() as u32;
        }
        mesh.normals.push(n.map(|x| (x / size) as f32));
    }
    mesh
}

/// The surface with smoothly changing colours, sharp, partly transparent stripes, and deviating normals on one side.
pub(crate) fn painted(mut mesh: SourceMesh) -> SourceMesh {
    for (i, p) in mesh.positions.iter().enumerate() {
        let shade = |x: f64| (127.5 + 40.0 * x).clamp(0.0, 255.0) as u8;
        mesh.colors.push([shade(p[0]), shade(p[1]), shade(p[2]), if i % 7 == 0 { 90 } else { 255 }]);
        let lean = if p[0] > 0.0 { 0.9 } else { 0.0 };
        let ring = (p[0] * p[0] + p[1] * p[1]).sqrt();
        let out = [0, 1].map(|k| p[k] - 2.0 * p[k] / ring);
        let n = [out[0], out[1], p[2] + lean];
        let size = (n[0] * n[0] + n[1] * n[1] + n[2] * n[2]).sqrt();
        mesh.normals.push(n.map(|x| (x / size) as f32));
    }
    let stripe = mesh.colors.len() as u32;
    mesh.colors.push([250, 20, 10, 255]);
    for (i, face) in mesh.faces.iter_mut().enumerate() {
        for corner in face {
            corner.color = if i % 20 < 2 { stripe } else { corner.position };
            corner.normal = corner.position;
        }
    }
    mesh
}

/// The surface with bands of materials.
pub(crate) fn materials(mut mesh: SourceMesh, count: u16) -> SourceMesh {
    for (i, material) in mesh.materials.iter_mut().enumerate() {
        *material = ((i / 37) % usize::from(count)) as u16;
    }
    mesh
}

/// The surface with skins of nine joints along x, each vertex between two or three.
pub(crate) fn skinned(mut mesh: SourceMesh) -> SourceMesh {
    let skin = |&[x, y, _]: &[f64; 3]| {
        let at = (x + 3.0).clamp(0.0, 6.0);
        let (low, share) = (at as u8, at - f64::from(at as u8));
        Skin::new([(low, 1.0 - share), (low + 1, share), (8, 0.2 * y.max(0.0))])
    };
    mesh.skins = mesh.positions.iter().map(skin).collect();
    mesh
}

/// The surface with a second set of texture coordinates as of a lightmap: the faces of each of `cells`³ boxes that look
/// along an axis are one chart, projected along it; the charts are packed on a grid.
pub(crate) fn lightmapped(mut mesh: SourceMesh, cells: u32) -> SourceMesh {
    let across = |axis: usize| mesh.positions.iter().map(move |p| p[axis]);
    let low = [0, 1, 2].map(|axis| across(axis).fold(f64::INFINITY, f64::min));
    let size = [0, 1, 2].map(|axis| across(axis).fold(f64::NEG_INFINITY, f64::max) - low[axis]);
    let size = size.into_iter().fold(0.0, f64::max);
    let side = (6.0 * f64::from(cells).powi(3)).sqrt().ceil();
    let mut known = BTreeMap::new();
    for face in &mut mesh.faces {
        let [a, b, c] = face.map(|corner| mesh.positions[corner.position as usize]);
        let [e, f] = [b, c].map(|p| [0, 1, 2].map(|k| p[k] - a[k]));
        let normal = [0, 1, 2].map(|k| e[(k + 1) % 3] * f[(k + 2) % 3] - e[(k + 2) % 3] * f[(k + 1) % 3]);
        let main = (0..3).max_by(|&x, &y| normal[x].abs().total_cmp(&normal[y].abs())).unwrap_or(0);
        // Where the middle is, in cells.
        let at = [0, 1, 2].map(|k| (a[k] + b[k] + c[k]) / 3.0 - low[k]);
        let cell = at.map(|x| ((x / size * f64::from(cells)) as u32).min(cells - 1));
        let chart =
            cell.into_iter().fold(main as u32 * 2 + u32::from(normal[main] < 0.0), |n, k| n * cells + k);
        for corner in face {
            let next = mesh.second_uvs.len() as u32;
            corner.second_uv = *known.entry((corner.position, chart)).or_insert(next);
            if corner.second_uv == next {
                let p = mesh.positions[corner.position as usize];
                let [x, y] = [1, 2].map(|k| {
                    let k = (main + k) % 3;
                    let inside = (p[k] - low[k]) / size * f64::from(cells) - f64::from(cell[k]);
                    0.1 + 0.8 * inside
                });
                let (column, row) = (f64::from(chart) % side, (f64::from(chart) / side).floor());
                mesh.second_uvs.push([(column + x) / side, (row + y) / side].map(|x| x as f32));
            }
        }
    }
    mesh
}

/// The surface cut into parts of `faces` faces.
pub(crate) fn parts(mut mesh: SourceMesh, faces: usize) -> SourceMesh {
    mesh.parts = (0..mesh.faces.len()).map(|face| (face / faces) as u32).collect();
    mesh
}

/// Joins two meshes, moving the second.
pub(crate) fn join(mut a: SourceMesh, b: &SourceMesh, by: [f64; 3]) -> SourceMesh {
    let (p, t, n) = (a.positions.len() as u32, a.uvs.len() as u32, a.normals.len() as u32);
    let (k, s) = (a.colors.len() as u32, a.second_uvs.len() as u32);
    a.positions.extend(b.positions.iter().map(|q| [0, 1, 2].map(|k| q[k] + by[k])));
    a.uvs.extend(&b.uvs);
    a.second_uvs.extend(&b.second_uvs);
    a.normals.extend(&b.normals);
    a.colors.extend(&b.colors);
    let shift = |index: u32, by: u32| if index == u32::MAX { index } else { index + by };
    a.faces.extend(b.faces.iter().map(|f| {
        f.map(|c| Corner {
            position: c.position + p,
            uv: shift(c.uv, t),
            second_uv: shift(c.second_uv, s),
            normal: shift(c.normal, n),
            color: shift(c.color, k),
        })
    }));
    a.materials.extend(&b.materials);
    a
}

/// `count` tetrahedra and cubes around a large sphere; all closed.
pub(crate) fn components(count: usize) -> SourceMesh {
    let mut random = Random::new(3);
    let mut mesh = sphere(24, 30, 0.02);
    let tetrahedron = bare(
        vec![[0.0; 3], [0.05, 0.0, 0.0], [0.0, 0.05, 0.0], [0.0, 0.0, 0.05]],
        &[[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]],
    );
    let cube = cube(0.04);
    for i in 0..count {
        let by = [0, 1, 2].map(|_| 3.0 * random.unit() - 1.5);
        mesh = join(mesh, if i % 2 == 0 { &tetrahedron } else { &cube }, by);
    }
    mesh
}

/// `count` ellipsoids of 36 faces, of sizes 1 to 7, scattered around a sphere, like the parts of a building.
pub(crate) fn crowd(count: usize) -> SourceMesh {
    let mut random = Random::new(11);
    let mut mesh = sphere(30, 40, 0.0);
    for _ in 0..count {
        let size = 0.02 * (1.0 + 6.0 * random.unit() * random.unit());
        let stretch = [0.3 + 0.7 * random.unit(), 0.3 + 0.7 * random.unit(), 1.0];
        let mut part = sphere(4, 6, 0.0);
        for p in &mut part.positions {
            *p = [0, 1, 2].map(|k| p[k] * stretch[k] * size);
        }
        let at = loop {
            let at = [0, 1, 2].map(|_| 3.0 * random.unit() - 1.5);
            if at.iter().map(|x| x * x).sum::<f64>() > 1.0 {
                break at;
            }
        };
        mesh = join(mesh, &part, at);
    }
    mesh
}

/// A sphere without the faces around every 23rd vertex.
pub(crate) fn perforated(rings: u32, columns: u32) -> SourceMesh {
    let mut mesh = sphere(rings, columns, 0.02);
    let keep: Vec<bool> = mesh.faces.iter().map(|f| f.iter().all(|c| c.position % 23 != 11)).collect();
    let mut kept = keep.iter();
    mesh.faces.retain(|_| *kept.next().unwrap());
    mesh.materials.truncate(mesh.faces.len());
    mesh
}

/// `count` separate tetrahedra, spread evenly in a cube.
pub(crate) fn dust(count: u32) -> SourceMesh {
    let mut random = Random::new(17);
    let side = f64::from(count).cbrt();
    let mut positions = Vec::new();
    let mut faces = Vec::new();
    for _ in 0..count {
        let at = [0, 1, 2].map(|_| side * random.unit());
        let first = positions.len() as u32;
        let corners = [[0.0; 3], [0.3, 0.0, 0.0], [0.0, 0.3, 0.0], [0.0, 0.0, 0.3]];
        positions.extend(corners.map(|c| [0, 1, 2].map(|k| at[k] + c[k])));
        faces.extend([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]].map(|f| f.map(|i| first + i)));
    }
    bare(positions, &faces)
}

/// A closed cube of twelve faces.
pub(crate) fn cube(size: f64) -> SourceMesh {
    let positions = (0..8).map(|i| [0, 1, 2].map(|k| f64::from((i >> k) & 1) * size)).collect();
    let quads = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
    let faces: Vec<[u32; 3]> = quads.iter().flat_map(|q| [[q[0], q[1], q[2]], [q[0], q[2], q[3]]]).collect();
    bare(positions, &faces)
}

/// A closed box with a corner at the origin.
pub(crate) fn slab(sides: [f64; 3]) -> SourceMesh {
    let mut mesh = cube(1.0);
    for p in &mut mesh.positions {
        *p = [0, 1, 2].map(|k| p[k] * sides[k]);
    }
    mesh
}

/// Unconnected triangles.
pub(crate) fn soup(count: u32) -> SourceMesh {
    let mut random = Random::new(5);
    let mut positions = Vec::new();
    for _ in 0..count {
        let at = [0, 1, 2].map(|_| random.unit() * 10.0);
        for _ in 0..3 {
            positions.push(at.map(|x| x + random.unit()));
        }
    }
    let faces: Vec<[u32; 3]> = (0..count).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect();
    bare(positions, &faces)
}

/// Edges with three to seven faces, joined end to end and crossing.
pub(crate) fn fans(books: u32) -> SourceMesh {
    let mut random = Random::new(13);
    let mut positions = Vec::new();
    let mut faces = Vec::new();
    for b in 0..books {
        let z = f64::from(b);
        positions.push([0.0, 0.0, z]);
        let spine = positions.len() as u32 - 1;
        let pages = 3 + random.below(5) as u32;
        for page in 0..pages {
            let angle = std::f64::consts::TAU * f64::from(page) / f64::from(pages) + z;
            let r = 1.0 + random.unit();
            positions.push([r * angle.cos(), r * angle.sin(), z + 0.5]);
            positions.push([2.0 * r * angle.cos(), 2.0 * r * angle.sin(), z + 0.2]);
            let leaf = positions.len() as u32 - 2;
            if b + 1 < books {
                faces.push([spine, leaf, spine + 2 * pages + 1]);
            }
            faces.push([spine, leaf + 1, leaf]);
            if random.below(3) == 0 {
                faces.push([spine, leaf, leaf + 1]);
            }
        }
    }
    bare(positions, &faces)
}

/// Every face twice, every third one also flipped.
pub(crate) fn duplicates(mut mesh: SourceMesh) -> SourceMesh {
    for (i, face) in mesh.faces.clone().into_iter().enumerate() {
        mesh.faces.push([face[1], face[2], face[0]]);
        mesh.materials.push(0);
        if i % 3 == 0 {
            mesh.faces.push([face[0], face[2], face[1]]);
            mesh.materials.push(0);
        }
    }
    mesh
}

/// Two coincident sheets, one of them flipped; welding joins them at every vertex.
pub(crate) fn sheets(size: u32) -> SourceMesh {
    let mut mesh = height_field(size);
    for mut face in mesh.faces.clone() {
        face.reverse();
        mesh.faces.push(face);
        mesh.materials.push(1);
    }
    mesh
}

/// Pairs of cones that share only their tips, in a row where neighbouring rims touch.
pub(crate) fn bow_ties(count: u32) -> SourceMesh {
    const RIM: u32 = 6;
    let mut positions = Vec::new();
    let mut faces = Vec::new();
    for i in 0..count {
        let tip = positions.len() as u32;
        let x = f64::from(i) * 2.0;
        positions.push([x, 0.0, 0.0]);
        for side in [-1.0, 1.0] {
            let first = positions.len() as u32;
            for j in 0..RIM {
                let angle = std::f64::consts::TAU * f64::from(j) / f64::from(RIM);
                positions.push([x + side, angle.cos(), angle.sin()]);
                let (a, b) = (first + j, first + (j + 1) % RIM);
                faces.push(if side > 0.0 { [tip, b, a] } else { [tip, a, b] });
            }
        }
    }
    bare(positions, &faces)
}

/// A strip of triangles a million times longer than wide.
pub(crate) fn needles(count: u32) -> SourceMesh {
    let positions =
        (0..count + 2).map(|i| [f64::from(i % 2), f64::from(i) * 1e-6, 1e-7 * f64::from(i % 5)]).collect();
    let faces: Vec<[u32; 3]> =
        (0..count).map(|i| if i % 2 == 0 { [i, i + 1, i + 2] } else { [i + 1, i, i + 2] }).collect();
    bare(positions, &faces)
}

/// A disk of `valence` faces around one vertex.
pub(crate) fn hub(valence: u32) -> SourceMesh {
    let mut positions = vec![[0.0, 0.0, 0.3]];
    for i in 0..valence {
        let angle = std::f64::consts::TAU * f64::from(i) / f64::from(valence);
        positions.push([angle.cos(), angle.sin(), 0.01 * f64::from(i % 7)]);
    }
    let faces: Vec<[u32; 3]> = (0..valence).map(|i| [0, 1 + i, 1 + (i + 1) % valence]).collect();
    bare(positions, &faces)
}

/// The mesh, scaled and then translated.
pub(crate) fn placed(mut mesh: SourceMesh, scale: f64, by: f64) -> SourceMesh {
    for p in &mut mesh.positions {
        *p = p.map(|x| x * scale + by);
    }
    mesh
}
