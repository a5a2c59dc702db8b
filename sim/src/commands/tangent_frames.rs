//! `lodestream-sim tangent-frames`: its arguments, and a line for each surface and way.

use clap::Args;
use lodestream_report::pictures::tangent_frames::compare;

#[derive(Debug, Args)]
pub(crate) struct TangentFrames {
    /// Prints JSON instead of text.
    #[arg(long)]
    json: bool,
}

impl TangentFrames {
    pub(crate) fn run(&self) -> anyhow::Result<()> {
        let errors = compare();
        if self.json {
            println!("{}", serde_json::to_string(&errors)?);
        } else {
            errors.iter().for_each(|error| println!("{error}"));
        }
        Ok(())
    }
}
