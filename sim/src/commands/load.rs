//! `lodestream-sim load`: arguments; prints a line per case.

use clap::Args;
use lodestream_scenario::load::{Case, measure};
use lodestream_scenario::plan::{self, Transport};
use lodestream_scenario::scene;
use lodestream_scenario::served::{Serving, serve};

use crate::arguments::{CacheFolder, transport};
use crate::print::Results;

/// Numbers may be lists separated by commas; there is a case for each combination.
#[derive(Debug, Args)]
pub(crate) struct Load {
    /// The scene, as in plans: "demo", "field:assets=100,faces=10000,instances=1000" …
    scene: String,
    /// Transports: quic, ws.
    #[arg(long, value_delimiter = ',', default_value = "quic,ws", value_parser = transport)]
    transport: Vec<Transport>,
    /// Number of simultaneous clients.
    #[arg(long, value_delimiter = ',', default_value = "1,10,100,500", value_parser = clap::value_parser!(u32).range(1..=900))]
    clients: Vec<u32>,
    /// The server's rate limit per session.
    #[arg(long, default_value_t = 2_000_000, value_parser = clap::value_parser!(u64).range(1000..=1_000_000_000))]
    rate_bits_per_s: u64,
    /// Length of the measurement, after two seconds in which clients connect.
    #[arg(long, default_value_t = 5, value_parser = clap::value_parser!(u32).range(1..=600))]
    seconds: u32,
    #[command(flatten)]
    cache: CacheFolder,
    /// Print JSON instead of text.
    #[arg(long)]
    json: bool,
    /// Serve the scene until standard input ends, as the measured process.
    #[arg(long, hide = true)]
    serve: bool,
    /// Apply the session limits of a shipped server.
    #[arg(long, hide = true)]
    shipped_limits: bool,
    /// Serve with a bare sender.
    #[arg(long, hide = true)]
    bare: bool,
}

impl Load {
    pub(crate) fn run(&self) -> anyhow::Result<()> {
        let choice = plan::scene_choice(&self.scene)?;
        let source = scene::open(&choice, None, &self.cache.path()?, true)?;
        if self.serve {
            let serving = match (self.bare, self.shipped_limits) {
                (true, _) => Serving::Bare,
                (false, true) => Serving::Shipped,
                (false, false) => Serving::Lifted,
            };
            return serve(source, self.rate_bits_per_s, serving);
        }
        let mut results = Results::new(self.json);
        for &transport in &self.transport {
            for &clients in &self.clients {
                let Self { rate_bits_per_s, seconds, .. } = *self;
                let case = Case { transport, clients, rate_bits_per_s, seconds };
                results.push(measure(&self.scene, &source, self.cache.named(), &case)?);
            }
        }
        results.finish().map(drop)
    }
}
