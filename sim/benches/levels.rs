//! Memory and time of preparing a generated mesh in memory, with checkpoints in files, and again from these
//! checkpoints, in one run on one thread; the results must be equal.
//!
//! `cargo bench -p lodestream-sim --bench levels -- [land | torus] [FACES] [--block-faces N] [--ply FILE]`: a landscape
//! of 500,000 faces by default. `land` is hilly terrain with detail at every scale, `torus` a closed object with the
//! same bumps. `--ply` writes the mesh as binary PLY instead, for `lodestream-server prepare`. Times depend on the
//! machine: use ratios.

mod heap;

use std::f64::consts::TAU;
use std::io::{BufWriter, Write as _};
use std::path::PathBuf;
use std::sync::Mutex;
use std::time::Instant;

use anyhow::Context as _;
use lodestream_geometry::Settings;
use lodestream_geometry::checkpoint::{CheckpointError, CheckpointStore, Piece};
use lodestream_geometry::mesh::{Corner, QuantisedMesh, SourceMesh};
use lodestream_geometry::pool::{Monitor, Progress, Serial, Stage};
use lodestream_geometry::prepare::{Hooks, Prepared, prepare};
use lodestream_geometry::quantise::{QuantiseSettings, quantise};

/// Wavelength and height of the widest hills, in cells; each next size has a quarter of both.
const WIDEST: (usize, f64) = (64, 11.0);
/// Number of sizes of hills.
const SIZES: u32 = 4;

fn main() -> anyhow::Result<()> {
    let arguments: Vec<String> = std::env::args().skip(1).filter(|a| a != "--bench").collect();
    let ply = arguments.iter().position(|a| a == "--ply").map(|at| arguments.get(at + 1));
    let blocks = arguments.iter().position(|a| a == "--block-faces").map(|at| arguments.get(at + 1));
    let mut settings = Settings::default();
    if let Some(faces) = blocks {
        settings.block_faces = faces.context("--block-faces names a number")?.parse()?;
    }
    let torus = arguments.iter().any(|a| a == "torus");
    let faces = arguments.iter().find_map(|a| a.parse().ok()).unwrap_or(500_000_u32);
    let grid = Grid { side: (f64::from(faces) / 2.0).sqrt().round().max(3.0) as usize, torus };
    if let Some(file) = ply {
        return grid.write_ply(file.context("--ply names a file")?.as_ref());
    }
    let source = grid.source();
    let before = heap::used();
    heap::take_peak();
    let mesh = quantise(&source, &QuantiseSettings::default())?;
    let peak = heap::take_peak().saturating_sub(before) as f64;
    println!("quantising: heap {:.0} B/face beside the source", peak / mesh.faces.len() as f64);
    drop(source);
    let folder = tempfile::tempdir()?;
    let files = Files(folder.path().to_owned());
    let plain = row("in memory", (&mesh, &settings), None)?;
    let put_away = row("in files", (&mesh, &settings), Some(&files))?;
    let again = row("again from files", (&mesh, &settings), Some(&files))?;
    anyhow::ensure!(plain.0 == put_away.0 && plain.0 == again.0, "what comes out is not the same");
    let bytes = std::fs::read_dir(folder.path())?.flatten().filter_map(|file| file.metadata().ok());
    let bytes: u64 = bytes.map(|file| file.len()).sum();
    println!(
        "the same bytes; time {:.2} and {:.2} of that in memory; files {:.0} B/face",
        put_away.1 / plain.1,
        again.1 / plain.1,
        bytes as f64 / mesh.faces.len() as f64
    );
    Ok(())
}

/// Prepares once; returns the asset and the seconds.
fn row(
    name: &str,
    (mesh, settings): (&QuantisedMesh, &Settings),
    checkpoint: Option<&dyn CheckpointStore>,
) -> anyhow::Result<(Prepared, f64)> {
    let before = heap::used();
    heap::take_peak();
    let peaks = Peaks(Mutex::default());
    let hooks = Hooks::new(&Serial, &peaks);
    let start = Instant::now();
    let asset =
        prepare(mesh, settings, &checkpoint.map_or(hooks, |checkpoint| hooks.with_checkpoints(checkpoint)))?;
    let seconds = start.elapsed().as_secs_f64();
    peaks.report(Progress::default());
    let (_, peaks) = peaks.0.into_inner().unwrap_or_default();
    let faces = mesh.faces.len() as f64;
    let [simplify, measure, encode] = peaks.map(|peak| peak.saturating_sub(before) as f64 / faces);
    println!(
        "{name:<16} {faces:>9} faces, {seconds:>6.2} s, {:>4.0} k faces/s | heap, B/face: simplify {simplify:.0}, measure \
         {measure:.0}, encode {encode:.0}",
        faces / seconds / 1e3
    );
    Ok((asset, seconds))
}

/// Peak memory by stage, and the current stage.
struct Peaks(Mutex<(Stage, [usize; 3])>);

impl Monitor for Peaks {
    fn report(&self, progress: Progress) -> bool {
        if let Ok(mut peaks) = self.0.lock() {
            let at = match peaks.0 {
                Stage::Simplify => 0,
                Stage::Measure => 1,
                Stage::Encode => 2,
            };
            peaks.1[at] = peaks.1[at].max(heap::take_peak());
            peaks.0 = progress.stage;
        }
        true
    }
}

/// One file per checkpoint.
struct Files(PathBuf);

impl CheckpointStore for Files {
    fn is_persistent(&self) -> bool {
        true
    }

    fn put(&self, piece: Piece, bytes: Vec<u8>) -> Result<(), CheckpointError> {
        std::fs::write(self.0.join(piece.to_string()), bytes).map_err(CheckpointError::new)
    }

    fn get(&self, piece: Piece) -> Result<Option<Vec<u8>>, CheckpointError> {
        let path = self.0.join(piece.to_string());
        if path.exists() { std::fs::read(path).map(Some).map_err(CheckpointError::new) } else { Ok(None) }
    }
}

/// A grid of `2 × side²` triangles: a landscape, or closed to a torus.
struct Grid {
    side: usize,
    torus: bool,
}

impl Grid {
    /// Vertices along a side.
    fn across(&self) -> usize {
        if self.torus { self.side } else { self.side + 1 }
    }

    fn positions(&self) -> impl Iterator<Item = [f64; 3]> + '_ {
        let across = self.across();
        (0..across * across).map(move |at| self.position(at / across, at % across))
    }

    fn position(&self, i: usize, j: usize) -> [f64; 3] {
        let height: f64 = (0..SIZES).map(|size| hill(i, j, size)).sum();
        if !self.torus {
            return [i as f64, j as f64, height];
        }
        let side = self.side as f64;
        let [around, across] = [i, j].map(|k| TAU * k as f64 / side);
        // Bumps fade towards the edges, so that the ends of a torus meet.
        let fade = [i, j].map(|k| (0.5 * TAU * k as f64 / side).sin()).iter().product::<f64>();
        let tube =
            side / 8.0 * (1.0 + 0.15 * (5.0 * around).sin() * (3.0 * across).cos()) + 0.2 * fade * height;
        let out = side / 3.0 + tube * across.cos();
        [out * around.cos(), out * around.sin(), tube * across.sin()]
    }

    fn triangles(&self) -> impl Iterator<Item = [u32; 3]> + '_ {
        let (side, across) = (self.side, self.across());
        (0..side * side).flat_map(move |at| {
            let (i, j) = (at / side, at % side);
            let (next_i, next_j) = ((i + 1) % across, (j + 1) % across);
            let corner = |i: usize, j: usize| (i * across + j) as u32;
            let [a, b, c, d] = [corner(i, j), corner(i, next_j), corner(next_i, j), corner(next_i, next_j)];
            [[a, c, d], [a, d, b]]
        })
    }

    fn source(&self) -> SourceMesh {
        let faces: Vec<[Corner; 3]> = self.triangles().map(|t| t.map(Corner::at)).collect();
        SourceMesh {
            positions: self.positions().collect(),
            materials: vec![0; faces.len()],
            faces,
            ..SourceMesh::default()
        }
    }

    fn write_ply(&self, path: &std::path::Path) -> anyhow::Result<()> {
        let mut out = BufWriter::new(std::fs::File::create(path)?);
        let (vertices, faces) = (self.across().pow(2), 2 * self.side.pow(2));
        write!(
            out,
            "ply\nformat binary_little_endian 1.0\nelement vertex {vertices}\nproperty float x\nproperty float y\n\
             property float z\nelement face {faces}\nproperty list uchar uint vertex_indices\nend_header\n"
        )?;
        for position in self.positions() {
            position.iter().try_for_each(|&x| out.write_all(&(x as f32).to_le_bytes()))?;
        }
        for triangle in self.triangles() {
            out.write_all(&[3])?;
            triangle.iter().try_for_each(|v| out.write_all(&v.to_le_bytes()))?;
        }
        Ok(out.flush()?)
    }
}

/// Height of the hills of one size: random at lattice points, linear in between.
fn hill(i: usize, j: usize, size: u32) -> f64 {
    let wide = (WIDEST.0 >> (2 * size)).max(1);
    let (row, column) = (i / wide, j / wide);
    let [u, v] = [i, j].map(|k| (k % wide) as f64 / wide as f64);
    let at = |row: usize, column: usize| {
        let mut hash = (row as u32).wrapping_mul(0x1656_6711) ^ (column as u32).wrapping_mul(0x27d4_eb2f);
        hash = (hash ^ size.wrapping_mul(0x9e37_79b1)).wrapping_mul(0x85eb_ca6b);
        hash = (hash ^ (hash >> 13)).wrapping_mul(0xc2b2_ae35);
        f64::from(hash >> 16) / 32768.0 - 1.0
    };
    let near = at(row, column) * (1.0 - v) + at(row, column + 1) * v;
    let far = at(row + 1, column) * (1.0 - v) + at(row + 1, column + 1) * v;
    WIDEST.1 / f64::from(4_u32.pow(size)) * (near * (1.0 - u) + far * u)
}
