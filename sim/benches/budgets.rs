//! Error of meshes of any number of faces: ancestor-closed cuts of a prepared model against meshoptimizer's `simplify`
//! (subset placement) of the same mesh, in one run.
//!
//! `cargo bench -p lodestream-sim --bench budgets -- [MODEL.obj…]` takes the named models, else those in the folder
//! `LODESTREAM_MODELS`, else a generated mesh. Positions only, at 12 bits. Distances are RMS over 200,000 points on
//! each surface, the larger of both directions, relative to the diagonal: they are reproducible. `--json` prints an
//! object per line.

mod models;

use lodestream_assess::measure::{self, Surface};
use lodestream_geometry::Settings;
use lodestream_geometry::ancestor_closed_cut::{Budget, lowest_error};
use lodestream_geometry::mesh::{Corner, QuantisedMesh, SourceMesh};
use lodestream_geometry::pool::{Serial, Silent};
use lodestream_geometry::prepare::{Hooks, prepare};
use lodestream_geometry::refine::ActiveMesh;

/// Target face counts, in percent.
const BUDGETS: [usize; 7] = [1, 2, 5, 10, 20, 35, 50];

fn main() -> anyhow::Result<()> {
    let json = std::env::args().any(|a| a == "--json");
    if !json {
        println!(
            "{:<16} {:>4} | {:>8} {:>8} | {:>8} {:>8} | {:>6} {:>6} | {:>8}",
            "model", "%", "faces", "RMS", "peer", "RMS", "ratio", "most", "moving"
        );
    }
    for (model, _, mesh) in models::quantised(positions_only)? {
        for row in rows(&model, &mesh)? {
            if json { println!("{}", serde_json::to_string(&row)?) } else { row.print() }
        }
    }
    Ok(())
}

/// Results for a model and a target.
#[derive(serde::Serialize)]
struct Row {
    model: String,
    percent: usize,
    faces: usize,
    /// RMS distance relative to the diagonal.
    rms: f64,
    peer_faces: usize,
    peer_rms: f64,
    rms_over_peer: f64,
    max_over_peer: f64,
    /// meshoptimizer with vertices that it moves.
    moving_rms: f64,
}

impl Row {
    fn print(&self) {
        println!(
            "{:<16} {:>4} | {:>8} {:>8.1} | {:>8} {:>8.1} | {:>6.2} {:>6.2} | {:>8.1}",
            self.model,
            self.percent,
            self.faces,
            self.rms * 1e5,
            self.peer_faces,
            self.peer_rms * 1e5,
            self.rms_over_peer,
            self.max_over_peer,
            self.moving_rms * 1e5
        );
    }
}

fn rows(model: &str, mesh: &QuantisedMesh) -> anyhow::Result<Vec<Row>> {
    let prepared = prepare(mesh, &Settings::default(), &Hooks::new(&Serial, &Silent))?;
    let input = surface(mesh);
    let mut rows = Vec::new();
    for percent in BUDGETS {
        let budget = mesh.faces.len() * percent / 100;
        let set = lowest_error(&prepared.base, &prepared.infos, 0, Budget::Faces(budget as u64));
        if set.faces > budget as u64 {
            continue; // The base mesh alone has more.
        }
        let mut active = ActiveMesh::new(&prepared.base);
        for member in &set.members {
            let info = &prepared.infos[member.chunk as usize];
            let delta = active.decode_prefix(
                member.chunk,
                info,
                member.truncation,
                &prepared.chunks[member.chunk as usize],
            )?;
            active.apply(&delta)?;
        }
        let ours = surface(&active.to_mesh());
        let (peer, moving) = (meshoptimizer(&input, budget, false)?, meshoptimizer(&input, budget, true)?);
        let distance = |coarse| measure::compare(&input, coarse, &measure::Settings::default());
        let [here, there, moving_there] = [distance(&ours)?, distance(&peer)?, distance(&moving)?];
        rows.push(Row {
            model: model.to_owned(),
            percent,
            faces: ours.triangles.len(),
            rms: here.rms,
            peer_faces: peer.triangles.len(),
            peer_rms: there.rms,
            rms_over_peer: here.rms / there.rms,
            max_over_peer: here.max / there.max,
            moving_rms: moving_there.rms,
        });
    }
    Ok(rows)
}

fn positions_only(mesh: &mut SourceMesh) {
    for corner in mesh.faces.iter_mut().flatten() {
        *corner = Corner::at(corner.position);
    }
    mesh.uvs.clear();
    mesh.second_uvs.clear();
    mesh.normals.clear();
    mesh.colors.clear();
    mesh.materials.fill(0);
}

/// The triangles of a mesh, in the model's units.
fn surface(mesh: &QuantisedMesh) -> Surface {
    Surface {
        positions: mesh.positions.iter().map(|&p| mesh.grid.position(p)).collect(),
        triangles: mesh.faces.iter().map(|f| f.wedges.map(|w| mesh.wedges[w as usize].vertex)).collect(),
    }
}

/// meshoptimizer's simplification to at most `faces` faces, with original or moved vertices.
fn meshoptimizer(input: &Surface, faces: usize, moving: bool) -> anyhow::Result<Surface> {
    let mut indices: Vec<u32> = input.triangles.as_flattened().to_vec();
    let mut positions: Vec<[f32; 3]> = input.positions.iter().map(|p| p.map(|x| x as f32)).collect();
    let (target, options) = (faces * 3, meshopt::SimplifyOptions::None);
    if moving {
        let left = meshopt::simplify_with_update(
            &mut indices,
            &mut positions,
            &mut [],
            &[],
            0,
            None,
            target,
            f32::MAX,
            options,
            None,
        );
        indices.truncate(left);
    } else {
        let bytes: Vec<u8> = positions.iter().flatten().flat_map(|x| x.to_ne_bytes()).collect();
        let vertices = meshopt::VertexDataAdapter::new(&bytes, 12, 0)?;
        indices = meshopt::simplify(&indices, &vertices, target, f32::MAX, options, None);
    }
    let positions = positions.iter().map(|p| p.map(f64::from)).collect();
    Ok(Surface { positions, triangles: indices.as_chunks().0.to_vec() })
}
