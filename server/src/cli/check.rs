//! `check`: random ancestor-closed cuts must give the same mesh in any order, and the whole pack must give the model.

use std::path::PathBuf;

use anyhow::Context as _;
use clap::Args;
use lodestream_geometry::check::{CheckReport, check};
use lodestream_geometry::index::ChunkInfo;
use lodestream_import::{Part, gltf};

use super::outcome::Outcome;
use lodestream_bake::compare::{Difference, compare};
use lodestream_bake::prepare::Threads;
use lodestream_store::PackFile;

#[derive(Debug, Args)]
pub(super) struct Arguments {
    /// The pack.
    #[arg(value_name = "FILE.lsp")]
    pack: PathBuf,
    /// Number of cuts.
    #[arg(long, value_name = "N", default_value_t = 200)]
    random_sets: u32,
    /// Seed of the random cuts and orders.
    #[arg(long, value_name = "S", default_value_t = 1)]
    seed: u64,
    /// The model that the pack was prepared from; compares faces, attributes and materials.
    #[arg(long, value_name = "MODEL")]
    source: Option<PathBuf>,
    /// Only this mesh of a glTF file, as for `prepare`.
    #[arg(long, value_name = "NAME", requires = "source")]
    mesh: Option<String>,
}

pub(super) fn run(arguments: &Arguments) -> anyhow::Result<Outcome> {
    let pack = PackFile::open(&arguments.pack)?;
    pack.verify_textures()?;
    let asset = pack.load()?;
    let threads = Threads::all_cores();
    let sets = arguments.random_sets as usize;
    let report = check(&asset.base, &asset.infos, &asset.chunks, sets, arguments.seed, &threads)
        .with_context(|| arguments.pack.display().to_string())?;
    let CheckReport { sets, cracks, order_dependent, undo_errors } = report;
    let mut outcome = Outcome {
        text: format!(
            "sets {sets} cracks {cracks} order-dependent {order_dependent} undo-errors {undo_errors}\n"
        ),
        good: cracks == 0 && order_dependent == 0 && undo_errors == 0,
    };
    for line in rising_errors(asset.base.geometric_error, &asset.infos) {
        outcome.text.push_str(&line);
        outcome.good = false;
    }
    if let Some(model) = &arguments.source {
        let part = match &arguments.mesh {
            Some(name) => gltf::part_named(model, name)?,
            None => Part::Whole,
        };
        let found = compare(&pack, model, &part)?;
        let Difference { faces, missing, foreign, strange_wedges, materials } = found;
        outcome.text.push_str(&format!(
            "source faces {faces} missing {missing} foreign {foreign} strange-wedges {strange_wedges} \
             differing-materials {materials}\n"
        ));
        outcome.good &= found.none();
    }
    Ok(outcome)
}

/// A line for each chunk that states a larger error than a parent or the base mesh, and for each whose truncation
/// points' errors rise.
fn rising_errors(root: f32, infos: &[ChunkInfo]) -> Vec<String> {
    let mut lines = Vec::new();
    for (id, info) in infos.iter().enumerate() {
        let parents = info.parents.iter().filter_map(|&p| Some((p, infos.get(p as usize)?)));
        for (parent, above) in parents {
            if info.error > above.error || info.attribute_error > above.attribute_error {
                lines.push(format!("chunk {id} states a larger error than its parent {parent}\n"));
            }
        }
        // Truncation points are not compared with the error stated for the missing chunk: an intermediate state may be
        // further from the final one than the coarser mesh, and then no client stops there.
        if info.error > root || info.truncation_points.windows(2).any(|s| s[1].error > s[0].error) {
            lines.push(format!(
                "chunk {id} states a larger error than the base mesh, or its truncation points' errors rise\n"
            ));
        }
    }
    lines
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn errors_that_rise_towards_finer_chunks_are_reported() {
        let coarse = ChunkInfo { error: 2.0, attribute_error: 1.0, ..ChunkInfo::default() };
        let fine = |error, attribute_error| ChunkInfo {
            error,
            attribute_error,
            parents: vec![0],
            ..ChunkInfo::default()
        };
        assert!(rising_errors(2.0, &[coarse.clone(), fine(2.0, 1.0)]).is_empty());
        assert_eq!(rising_errors(2.0, &[coarse.clone(), fine(1.0, 1.5)]).len(), 1);
        assert_eq!(rising_errors(2.0, &[coarse.clone(), fine(3.0, 1.0)]).len(), 2);
        assert_eq!(rising_errors(1.0, &[coarse]).len(), 1);
    }
}
