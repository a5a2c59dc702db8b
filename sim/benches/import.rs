//! Time and memory of reading a mesh with normals and colours from each format.
//!
//! `cargo bench -p lodestream-sim --bench import -- [FACES]`; a million faces by default. One thread, the best of
//! three, with the file in the system's cache; times depend on the machine: use ratios. `--json` prints an object per
//! line.

mod heap;

use std::fmt::Write as _;
use std::path::Path;
use std::time::Instant;

use anyhow::Context as _;

/// Number of times that each file is read.
const RUNS: usize = 3;

/// Results for a format.
#[derive(serde::Serialize)]
struct Row {
    format: &'static str,
    faces: usize,
    file_bytes: usize,
    seconds: f64,
    faces_per_s: f64,
    bytes_per_s: f64,
    /// Peak memory, and the part of it that is the mesh.
    heap_bytes: usize,
    mesh_bytes: usize,
}

fn main() -> anyhow::Result<()> {
    let arguments: Vec<String> = std::env::args().skip(1).filter(|a| a != "--bench").collect();
    let json = arguments.iter().any(|a| a == "--json");
    let faces = match arguments.iter().find(|a| !a.starts_with('-')) {
        Some(faces) => faces.parse().with_context(|| format!("{faces:?} is not a number of faces"))?,
        None => 1_000_000_u32,
    };
    let field = Field { side: (f64::from(faces) / 2.0).sqrt().round().max(1.0) as u32 };
    let folder = tempfile::tempdir()?;
    for (format, name, bytes) in [
        ("OBJ", "a.obj", field.obj()),
        ("PLY, text", "a.ply", field.ply("ascii")),
        ("PLY, little-endian", "a.ply", field.ply("binary_little_endian")),
        ("PLY, big-endian", "a.ply", field.ply("binary_big_endian")),
    ] {
        let path = folder.path().join(name);
        std::fs::write(&path, &bytes)?;
        let file_bytes = bytes.len();
        drop(bytes);
        let row = row(format, &path, file_bytes)?;
        if json {
            println!("{}", serde_json::to_string(&row)?);
        } else {
            println!(
                "{format:<20} {:>8} faces, {:>6.1} MB: {:>5.2} s, {:>6.0} k faces/s, {:>6.1} MB/s, heap {:>4.0} B/face, of them \
                 mesh {:>3.0}",
                row.faces,
                file_bytes as f64 / 1e6,
                row.seconds,
                row.faces_per_s / 1e3,
                row.bytes_per_s / 1e6,
                row.heap_bytes as f64 / row.faces as f64,
                row.mesh_bytes as f64 / row.faces as f64
            );
        }
    }
    Ok(())
}

fn row(format: &'static str, path: &Path, file_bytes: usize) -> anyhow::Result<Row> {
    let (mut seconds, mut heap_bytes, mut mesh_bytes, mut faces) = (f64::INFINITY, 0, 0, 0);
    for _ in 0..RUNS {
        let before = heap::used();
        heap::take_peak();
        let start = Instant::now();
        let imported = lodestream_import::import(path)?;
        seconds = seconds.min(start.elapsed().as_secs_f64());
        heap_bytes = heap::take_peak() - before;
        mesh_bytes = heap::used() - before;
        faces = imported.mesh.faces.len();
    }
    let per_s = |count: usize| count as f64 / seconds;
    let (faces_per_s, bytes_per_s) = (per_s(faces), per_s(file_bytes));
    Ok(Row { format, faces, file_bytes, seconds, faces_per_s, bytes_per_s, heap_bytes, mesh_bytes })
}

/// A hilly terrain of `2 × side²` faces.
struct Field {
    side: u32,
}

impl Field {
    /// Place, normal and colour of each vertex.
    fn vertices(&self) -> impl Iterator<Item = ([f32; 3], [f32; 3], [u8; 3])> {
        let points = self.side + 1;
        (0..points * points).map(move |n| {
            let (x, y) = ((n / points) as f32, (n % points) as f32);
            let z = 6.0 * (x * 0.09).sin() * (y * 0.07).cos();
            let slope =
                [-0.54 * (x * 0.09).cos() * (y * 0.07).cos(), 0.42 * (x * 0.09).sin() * (y * 0.07).sin()];
            let length = (slope[0] * slope[0] + slope[1] * slope[1] + 1.0).sqrt();
            let normal = [slope[0] / length, slope[1] / length, 1.0 / length];
            ([x, y, z], normal, [n as u8, (n >> 8) as u8, 128])
        })
    }

    fn faces(&self) -> impl Iterator<Item = [u32; 3]> {
        let (side, points) = (self.side, self.side + 1);
        (0..side * side).flat_map(move |n| {
            let a = n / side * points + n % side;
            [[a, a + points, a + points + 1], [a, a + points + 1, a + 1]]
        })
    }

    fn obj(&self) -> Vec<u8> {
        let mut out = String::new();
        for ([x, y, z], [nx, ny, nz], rgb) in self.vertices() {
            let [r, g, b] = rgb.map(|x| f64::from(x) / 255.0);
            let _ = writeln!(out, "v {x} {y} {z} {r:.4} {g:.4} {b:.4}\nvn {nx} {ny} {nz}");
        }
        for face in self.faces() {
            let [a, b, c] = face.map(|corner| corner + 1);
            let _ = writeln!(out, "f {a}//{a} {b}//{b} {c}//{c}");
        }
        out.into_bytes()
    }

    fn ply(&self, format: &str) -> Vec<u8> {
        let (points, faces) = ((self.side + 1).pow(2), 2 * self.side.pow(2));
        let floats: String =
            ["x", "y", "z", "nx", "ny", "nz"].map(|n| format!("property float {n}\n")).concat();
        let colors: String = ["red", "green", "blue"].map(|n| format!("property uchar {n}\n")).concat();
        let mut out = format!(
            "ply\nformat {format} 1.0\nelement vertex {points}\n{floats}{colors}element face {faces}\nproperty list uchar int \
             vertex_indices\nend_header\n"
        )
        .into_bytes();
        let big = format == "binary_big_endian";
        let ordered =
            |number: [u8; 4]| if big { [number[3], number[2], number[1], number[0]] } else { number };
        for (place, normal, rgb) in self.vertices() {
            let numbers = place.iter().chain(&normal);
            if format == "ascii" {
                let words: Vec<String> =
                    numbers.map(ToString::to_string).chain(rgb.iter().map(ToString::to_string)).collect();
                out.extend(format!("{}\n", words.join(" ")).bytes());
            } else {
                numbers.for_each(|x| out.extend(ordered(x.to_le_bytes())));
                out.extend(rgb);
            }
        }
        for face in self.faces() {
            if format == "ascii" {
                out.extend(format!("3 {} {} {}\n", face[0], face[1], face[2]).bytes());
            } else {
                out.push(3);
                face.iter().for_each(|corner| out.extend(ordered(corner.to_le_bytes())));
            }
        }
        out
    }
}
