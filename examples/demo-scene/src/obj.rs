//! Writes meshes as OBJ text and materials as MTL text, in fixed-point decimals.

use super::mesh::ObjMesh;
use std::collections::HashMap;
use std::io::{self, BufWriter, Write};
use std::path::Path;

/// A material as MTL describes it.
pub(super) struct Material {
    pub(super) name: &'static str,
    pub(super) diffuse: [f64; 3],
    /// Phong exponent: higher is shinier.
    pub(super) shininess: u32,
    /// Colour texture.
    pub(super) colour: Option<&'static str>,
    /// Height map; white is high.
    pub(super) height: Option<&'static str>,
}

/// The materials of the scene: one library for all assets.
pub(super) const MATERIALS: &[Material] = &[
    Material { name: "stone", diffuse: [1.0; 3], shininess: 4, colour: Some("stone.png"), height: None },
    Material { name: "tile", diffuse: [0.66, 0.36, 0.25], shininess: 6, colour: None, height: None },
    Material {
        name: "brick",
        diffuse: [1.0; 3],
        shininess: 3,
        colour: Some("brick.png"),
        height: Some("brick_height.png"),
    },
    Material {
        name: "cobble",
        diffuse: [1.0; 3],
        shininess: 6,
        colour: Some("cobble.png"),
        height: Some("cobble_height.png"),
    },
    Material { name: "marble", diffuse: [0.80, 0.77, 0.71], shininess: 24, colour: None, height: None },
    Material { name: "bronze", diffuse: [0.36, 0.47, 0.39], shininess: 60, colour: None, height: None },
    Material { name: "sandstone", diffuse: [0.72, 0.58, 0.40], shininess: 6, colour: None, height: None },
    Material { name: "rock", diffuse: [0.45, 0.43, 0.40], shininess: 3, colour: None, height: None },
];

/// Name of the material library beside the OBJ files.
pub(super) const MATERIAL_FILE: &str = "demo.mtl";

/// Writes the library with the materials named in [`MATERIALS`]. `map_Bump` names a height map, as
/// the MTL specification (Wavefront, 1995, §"Bump map") has it.
pub(super) fn write_materials(path: &Path) -> io::Result<()> {
    let mut out = BufWriter::new(std::fs::File::create(path)?);
    for material in MATERIALS {
        let [r, g, b] = material.diffuse;
        writeln!(out, "newmtl {}\nKd {r:.3} {g:.3} {b:.3}\nNs {}", material.name, material.shininess)?;
        if let Some(file) = material.colour {
            writeln!(out, "map_Kd {file}")?;
        }
        if let Some(file) = material.height {
            writeln!(out, "map_Bump {file}")?;
        }
        writeln!(out)?;
    }
    out.flush()
}

/// Appends `value` with `places` decimals. Rounding happens once, on an integer, so the text does not depend on a
/// formatting library; this is also several times faster.
fn decimal(line: &mut Vec<u8>, value: f64, places: u32) {
    let scale = 10u64.pow(places);
    let scaled = (value.abs() * scale as f64 + 0.5).floor() as u64;
    if value < 0.0 && scaled > 0 {
        line.push(b'-');
    }
    integer(line, scaled / scale);
    line.push(b'.');
    let mut digit = scale / 10;
    while digit > 0 {
        line.push(b'0' + (scaled / digit % 10) as u8);
        digit /= 10;
    }
}

fn integer(line: &mut Vec<u8>, mut value: u64) {
    let mut digits = [0u8; 20];
    let mut at = digits.len();
    loop {
        at -= 1;
        digits[at] = b'0' + (value % 10) as u8;
        value /= 10;
        if value == 0 {
            break;
        }
    }
    line.extend_from_slice(&digits[at..]);
}

/// Indices into a list of distinct tuples: `merged[i]` is the index of tuple `i`.
struct Merged {
    kept: Vec<usize>,
    merged: Vec<u64>,
}

/// Merges tuples that are equal as written, so that the file repeats none.
fn merge<const N: usize>(tuples: impl Iterator<Item = [f64; N]>) -> Merged {
    let mut seen: HashMap<[i64; N], u64> = HashMap::new();
    let mut result = Merged { kept: Vec::new(), merged: Vec::new() };
    for (i, tuple) in tuples.enumerate() {
        let next = seen.len() as u64;
        let index = *seen.entry(tuple.map(|v| (v * 1e5).round() as i64)).or_insert(next);
        if index == next {
            result.kept.push(i);
        }
        result.merged.push(index);
    }
    result
}

/// Writes `mesh`, with positions to the hundredth of a millimetre.
pub(super) fn write(path: &Path, mesh: &ObjMesh) -> io::Result<()> {
    let mut out = BufWriter::with_capacity(1 << 18, std::fs::File::create(path)?);
    writeln!(out, "mtllib {MATERIAL_FILE}")?;
    let mut line = Vec::with_capacity(96);
    let mut tuple = |out: &mut BufWriter<std::fs::File>, key: &[u8], values: &[f64]| {
        line.clear();
        line.extend_from_slice(key);
        for value in values {
            line.push(b' ');
            decimal(&mut line, *value, 5);
        }
        line.push(b'\n');
        out.write_all(&line)
    };
    let uvs = merge(mesh.uvs.iter().map(|t| t.to_array()));
    let normals = merge(mesh.normals.iter().map(|n| n.to_array()));
    for p in &mesh.positions {
        tuple(&mut out, b"v", &p.to_array())?;
    }
    for i in &uvs.kept {
        tuple(&mut out, b"vt", &mesh.uvs[*i].to_array())?;
    }
    for i in &normals.kept {
        tuple(&mut out, b"vn", &mesh.normals[*i].to_array())?;
    }
    let mut line = Vec::with_capacity(96);
    for group in &mesh.groups {
        writeln!(out, "o {}\nusemtl {}", group.name, group.material)?;
        for face in &group.faces {
            line.clear();
            line.push(b'f');
            for corner in face {
                line.push(b' ');
                integer(&mut line, u64::from(corner.position) + 1);
                line.push(b'/');
                if let Some(uv) = corner.uv {
                    integer(&mut line, uvs.merged[uv as usize] + 1);
                }
                line.push(b'/');
                integer(&mut line, normals.merged[corner.normal as usize] + 1);
            }
            line.push(b'\n');
            out.write_all(&line)?;
        }
    }
    out.flush()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn decimals_round_half_up_and_never_say_minus_zero() {
        let text = |v: f64| {
            let mut line = Vec::new();
            decimal(&mut line, v, 3);
            String::from_utf8(line).unwrap()
        };
        assert_eq!(text(0.0), "0.000");
        assert_eq!(text(-0.0001), "0.000");
        assert_eq!(text(-12.0345), "-12.035");
        assert_eq!(text(1.9996), "2.000");
    }
}
