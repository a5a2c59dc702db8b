//! `lodestream-sim relay`: arguments; relays until it is interrupted.

use std::net::SocketAddr;
use std::time::Duration;

use anyhow::Context as _;
use clap::Args;
use lodestream_scenario::relay::{RelayLink, relay};
use tokio::net::TcpListener;

#[derive(Debug, Args)]
pub(crate) struct Relay {
    /// The server to relay to.
    server: SocketAddr,
    /// Where to listen.
    #[arg(long, default_value = "127.0.0.1:0")]
    listen: SocketAddr,
    /// Rate from the server to all clients, in bits per second.
    #[arg(long, default_value_t = 2_000_000, value_parser = clap::value_parser!(u64).range(1000..=100_000_000_000))]
    rate_bits_per_s: u64,
    /// Round trip.
    #[arg(long, default_value_t = 50, value_parser = clap::value_parser!(u64).range(0..=60_000))]
    rtt_ms: u64,
    /// Bytes that may wait for the link.
    #[arg(long, default_value_t = 65_536)]
    queue_bytes: u64,
}

impl Relay {
    pub(crate) fn run(&self) -> anyhow::Result<()> {
        let link = RelayLink {
            rate_bits_per_s: self.rate_bits_per_s,
            round_trip: Duration::from_millis(self.rtt_ms),
            queue_bytes: self.queue_bytes,
        };
        let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build()?;
        runtime.block_on(async {
            let listener = TcpListener::bind(self.listen).await.with_context(|| self.listen.to_string())?;
            println!("{}", listener.local_addr()?);
            Ok(relay(listener, self.server, link).await?)
        })
    }
}
