//! Measures decoding and applying of a generated surface on one thread; `script/refine-wasm` runs it natively and as
//! wasm32.
//!
//! Prints the number of vertex splits, the splits per second for decoding, applying and both, and a hash of the
//! result, which must be equal on all machines. Times are the best of several runs.
#![allow(clippy::disallowed_methods, clippy::print_stdout, reason = "an example may look at the clock")]

use std::time::Instant;

use lodestream_geometry::Settings;
use lodestream_geometry::mesh::{Corner, SourceMesh};
use lodestream_geometry::pool::{Serial, Silent};
use lodestream_geometry::prepare::{Hooks, Prepared, prepare};
use lodestream_geometry::quantise::{Precision, QuantiseSettings, quantise};
use lodestream_geometry::refine::ActiveMesh;

/// Squares per side of the surface.
const SIDE: u32 = 180;
/// Number of runs.
const RUNS: u32 = 9;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let settings = QuantiseSettings { precision: Precision::Bits(12), ..QuantiseSettings::default() };
    let mesh = quantise(&surface(), &settings)?;
    let prepared = prepare(&mesh, &Settings::default(), &Hooks::new(&Serial, &Silent))?;
    let splits: u32 = prepared.infos.iter().map(|info| info.vertices).sum();
    let mut best = [f64::INFINITY; 2];
    let mut hash = 0;
    for _ in 0..RUNS {
        let (seconds, mesh) = refine(&prepared)?;
        for (best, seconds) in best.iter_mut().zip(seconds) {
            *best = best.min(seconds);
        }
        hash = hash_of(&mesh);
    }
    let per_s = |seconds: f64| f64::from(splits) / seconds;
    let [decode, apply] = best;
    println!("splits {splits}");
    println!("decode_splits_per_s {:.0}", per_s(decode));
    println!("apply_splits_per_s {:.0}", per_s(apply));
    println!("refine_splits_per_s {:.0}", per_s(decode + apply));
    println!("hash {hash:016x}");
    Ok(())
}

/// Seconds for decoding and for applying all chunks, and the resulting mesh.
fn refine(prepared: &Prepared) -> Result<([f64; 2], ActiveMesh), Box<dyn std::error::Error>> {
    let mut mesh = ActiveMesh::new(&prepared.base);
    let mut seconds = [0.0; 2];
    for (id, (info, payload)) in (0..).zip(prepared.infos.iter().zip(&prepared.chunks)) {
        let start = Instant::now();
        let delta = mesh.decode(id, info, payload)?;
        let decoded = Instant::now();
        mesh.apply(&delta)?;
        seconds[0] += decoded.duration_since(start).as_secs_f64();
        seconds[1] += decoded.elapsed().as_secs_f64();
    }
    Ok((seconds, mesh))
}

/// FNV-1a hash (64 bits) of positions and faces in slot order.
fn hash_of(mesh: &ActiveMesh) -> u64 {
    let (positions, faces) = mesh.surface();
    let positions = positions.iter().flatten().map(|x| x.to_bits());
    let words = positions.chain(faces.into_iter().flatten());
    let bytes = words.flat_map(u32::to_le_bytes);
    bytes.fold(0xcbf2_9ce4_8422_2325, |hash: u64, byte| {
        (hash ^ u64::from(byte)).wrapping_mul(0x0000_0100_0000_01b3)
    })
}

/// Rolling hills from sums and products only, identical on all machines.
fn surface() -> SourceMesh {
    let mut mesh = SourceMesh::default();
    let wave = |x: f64| {
        // A parabola per unit, alternately up and down.
        let (turn, along) = (x.floor() as i64, x - x.floor());
        let height = 4.0 * along * (1.0 - along);
        if turn % 2 == 0 { height } else { -height }
    };
    for i in 0..=SIDE {
        for j in 0..=SIDE {
            let (x, y) = (f64::from(i), f64::from(j));
            let rough = f64::from((i * 7919 + j * 104_729) % 1009) / 1009.0;
            let z = 6.0 * wave(x / 35.0) * wave(y / 45.0) + 0.6 * wave(x / 7.0 + y / 11.0) + 0.15 * rough;
            mesh.positions.push([x, y, z]);
        }
    }
    let corner = Corner::at;
    for i in 0..SIDE {
        for j in 0..SIDE {
            let a = i * (SIDE + 1) + j;
            let (b, c, d) = (a + 1, a + SIDE + 1, a + SIDE + 2);
            mesh.faces.extend([[a, c, d], [a, d, b]].map(|face| face.map(corner)));
        }
    }
    mesh.materials = vec![0; mesh.faces.len()];
    mesh
}
