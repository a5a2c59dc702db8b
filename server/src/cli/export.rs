//! `export`: the best mesh within a budget, as OBJ.

use std::path::PathBuf;

use anyhow::Context as _;
use clap::Args;
use lodestream_compress::whole_file::write_atomically;
use lodestream_geometry::ancestor_closed_cut::{Budget, lowest_error};

use super::outcome::Outcome;
use super::preparation_settings::positive;
use super::units::parse_size;
use lodestream_bake::export_obj::write_obj;
use lodestream_store::PackFile;

/// The bound of the mesh; without one, the whole mesh is exported.
#[derive(Clone, Copy, Debug, Args)]
#[group(required = false, multiple = false)]
struct BudgetArguments {
    /// Most faces.
    #[arg(long, value_name = "N")]
    faces: Option<u64>,
    /// Largest error, in the model's units; exports the fewest chunks that reach it.
    #[arg(long, value_name = "E", value_parser = positive)]
    error: Option<f64>,
    /// Most bytes of base mesh, index pages and chunks.
    #[arg(long, value_name = "N", value_parser = parse_size)]
    bytes: Option<u64>,
}

#[derive(Debug, Args)]
pub(super) struct Arguments {
    /// The pack.
    #[arg(value_name = "FILE.lsp")]
    pack: PathBuf,
    #[command(flatten)]
    budget: BudgetArguments,
    /// The OBJ file to write.
    #[arg(short, long, value_name = "OUT.obj")]
    output: PathBuf,
}

impl BudgetArguments {
    fn resolve(self) -> Budget {
        match self {
            Self { faces: Some(faces), .. } => Budget::Faces(faces),
            Self { error: Some(error), .. } => Budget::Error(error),
            Self { bytes: Some(bytes), .. } => Budget::Bytes(bytes),
            _ => Budget::Everything,
        }
    }
}

pub(super) fn run(arguments: &Arguments) -> anyhow::Result<Outcome> {
    let path = arguments.pack.display();
    let pack = PackFile::open(&arguments.pack)?;
    let asset = pack.load()?;
    let budget = arguments.budget.resolve();
    let set = lowest_error(&asset.base, &asset.infos, asset.head_bytes(), budget);
    let least = match budget {
        Budget::Faces(limit) if set.faces > limit => Some(format!("{} faces", set.faces)),
        Budget::Bytes(limit) if set.bytes > limit => Some(format!("{} bytes", set.bytes)),
        _ => None,
    };
    if let Some(least) = least {
        anyhow::bail!("{path}: the base mesh alone takes {least}; give a larger budget");
    }
    let mesh = asset.refined(&set.members).with_context(|| path.to_string())?.to_mesh();
    write_atomically(&arguments.output, |out| write_obj(out, &mesh, &asset.description.materials))
        .with_context(|| format!("{}: cannot be written", arguments.output.display()))?;
    Ok(Outcome::good(format!(
        "{}: {} faces, {} vertices, {} chunks ({} of them up to a truncation point), {} bytes, error {}\n",
        arguments.output.display(),
        mesh.faces.len(),
        mesh.positions.len(),
        set.members.len(),
        set.members.iter().filter(|m| m.truncation.is_some()).count(),
        set.bytes,
        set.error
    )))
}
