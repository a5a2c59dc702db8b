//! What a plan needs that is not in it.

use std::path::PathBuf;

use clap::Args;
use lodestream_scenario::draco::Encoder;
use lodestream_scenario::peers;
use lodestream_scenario::plan::Plan;

// No doc comment: it would take the place of the command's own in --help.
#[derive(Debug, Args)]
pub(crate) struct Beside {
    /// Folder of the models that a plan names by their files.
    #[arg(long, env = "LODESTREAM_MODELS", value_name = "DIR")]
    models: Option<PathBuf>,
    /// Nodes of view-dependent peers, instead of the file that the plan names: sim/peers/example.json is one.
    #[arg(long, env = "LODESTREAM_PEERS", value_name = "FILE")]
    peers: Option<PathBuf>,
    /// Draco's encoder [default: draco_encoder, where $PATH has it].
    #[arg(long, env = "LODESTREAM_DRACO_ENCODER", value_name = "FILE")]
    draco_encoder: Option<PathBuf>,
}

impl Beside {
    /// The plan with it.
    ///
    /// # Errors
    /// Files that cannot be used.
    pub(crate) fn add_to(&self, plan: Plan) -> anyhow::Result<Plan> {
        let mut plan = plan.with_models(self.models.as_deref());
        if let Some(file) = &self.peers {
            plan = plan.with_peers(peers::read(file)?);
        }
        plan.draco = match &self.draco_encoder {
            Some(file) => Some(Encoder::at(file)?),
            None => std::env::var_os("PATH").as_deref().and_then(Encoder::on_path),
        };
        Ok(plan)
    }
}
