//! `lodestream-sim shown`: arguments; prints a line per frame that a window showed.

use std::path::PathBuf;

use clap::Args;
use lodestream_report::pictures::shown;

#[derive(Debug, Args)]
pub(crate) struct Shown {
    /// The folder that lodestream-viewer --frames has written
    #[arg(value_name = "DIR")]
    folder: PathBuf,
    /// Print JSON instead of text.
    #[arg(long)]
    json: bool,
}

impl Shown {
    pub(crate) fn run(&self) -> anyhow::Result<()> {
        let found = shown::judge(&self.folder)?;
        if self.json {
            println!("{}", serde_json::to_string(&found)?);
            return Ok(());
        }
        for frame in &found.frames {
            println!("{frame}");
        }
        let first = found.first_seconds;
        println!(
            "first {} s: {:.3} s of FLIP, {:.3} s of 1 − SSIM, {} against the {} (an empty window: FLIP {:.3})",
            first.until_s,
            first.flip_s,
            first.dissimilarity_s,
            first.psnr_db.map_or("equal".into(), |db| format!("{db:.1} dB on average")),
            if found.settled { "settled picture" } else { "last frame, which is not settled" },
            first.blank_flip
        );
        Ok(())
    }
}
