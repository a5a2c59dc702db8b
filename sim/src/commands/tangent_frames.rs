//! `lodestream-sim tangent-frames`: arguments; prints a line per surface and method.

use clap::Args;
use lodestream_report::pictures::tangent_frames::compare;

#[derive(Debug, Args)]
pub(crate) struct TangentFrames {
    /// Print JSON instead of text.
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
