//! Inputs of a run besides its plan.

use std::ffi::OsString;
use std::path::PathBuf;

use clap::Args;
use lodestream_scenario::draco::Encoder;
use lodestream_scenario::peers;
use lodestream_scenario::plan::Plan;

// No doc comment: it would take the place of the command's own in --help.
#[derive(Debug, Args)]
pub(crate) struct Beside {
    /// Folder of the models that a plan names by file.
    #[arg(long, env = "LODESTREAM_MODELS", value_name = "DIR")]
    models: Option<PathBuf>,
    /// Nodes of view-dependent peers, instead of the file that the plan names: files (sim/peers/example.json is one)
    /// and folders of *.json, separated by colons.
    #[arg(long, env = "LODESTREAM_PEERS", value_name = "FILE|DIR[:...]")]
    peers: Option<OsString>,
    /// Factor on the errors that the peers state.
    #[arg(long, value_name = "FACTOR", value_parser = factor, requires = "peers")]
    peer_errors: Option<f32>,
    /// Draco's encoder [default: draco_encoder, where $PATH has it].
    #[arg(long, env = "LODESTREAM_DRACO_ENCODER", value_name = "FILE")]
    draco_encoder: Option<PathBuf>,
}

impl Beside {
    /// Adds them to a plan.
    ///
    /// # Errors
    /// Files that cannot be used.
    pub(crate) fn add_to(&self, plan: Plan) -> anyhow::Result<Plan> {
        let mut plan = plan.with_models(self.models.as_deref());
        if let Some(list) = &self.peers {
            let stated = peers::read_all(list)?.into_iter();
            plan = plan.with_peers(match self.peer_errors {
                Some(factor) => stated.map(|peer| peer.with_errors(factor)).collect(),
                None => stated.collect(),
            });
        }
        plan.draco = match &self.draco_encoder {
            Some(file) => Some(Encoder::at(file)?),
            None => std::env::var_os("PATH").as_deref().and_then(Encoder::on_path),
        };
        Ok(plan)
    }
}

fn factor(text: &str) -> Result<f32, String> {
    let factor = text.parse().ok().filter(|factor: &f32| (1e-3..=1e3).contains(factor));
    factor.ok_or_else(|| "is not a factor from 0.001 to 1000".to_owned())
}
