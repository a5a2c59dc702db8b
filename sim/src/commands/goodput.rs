//! `lodestream-sim goodput`: arguments; prints a line per case.

use std::num::NonZeroU64;

use clap::Args;
use lodestream_scenario::goodput::{Case, measure};
use lodestream_scenario::plan::Transport;

use crate::arguments::transport;
use crate::print::Results;

/// Every value may be a list separated by commas; there is a case for each combination, the last list changing fastest.
#[derive(Debug, Args)]
pub(crate) struct Goodput {
    /// Transports: quic, ws.
    #[arg(long, value_delimiter = ',', default_value = "quic,ws", value_parser = transport)]
    transport: Vec<Transport>,
    /// Rates of the link in both directions.
    #[arg(long, value_delimiter = ',', default_value = "2000000,8000000,16000000", value_parser = rate)]
    rate_bits_per_s: Vec<NonZeroU64>,
    /// Round trips without queueing.
    #[arg(long, value_delimiter = ',', default_value = "50", value_parser = clap::value_parser!(u64).range(..=10_000))]
    rtt_ms: Vec<u64>,
    /// Queue lengths of the link.
    #[arg(long, value_delimiter = ',', default_value = "65536", value_parser = clap::value_parser!(u64).range(1500..=1 << 30))]
    queue_bytes: Vec<u64>,
    /// The server's rate limits as shares of the link's rate, from 0.01 to 100, or off.
    #[arg(long, value_delimiter = ',', default_value = "off", value_parser = limiter_share)]
    limiter_share: Vec<LimiterShare>,
    /// Print JSON instead of text.
    #[arg(long)]
    json: bool,
}

/// A rate limit as a share of the link's rate; `None` for none.
#[derive(Clone, Copy, Debug)]
struct LimiterShare(Option<f64>);

/// Parses a rate: at least one at which a million bytes arrive within the time limit, at most one that can be simulated
/// for ten seconds.
fn rate(text: &str) -> Result<NonZeroU64, String> {
    match text.parse::<NonZeroU64>() {
        Ok(rate) if (64_000..=20_000_000).contains(&rate.get()) => Ok(rate),
        _ => Err("a rate from 64000 to 20000000 bit/s is needed".to_owned()),
    }
}

fn limiter_share(text: &str) -> Result<LimiterShare, String> {
    match text.parse::<f64>() {
        _ if text == "off" => Ok(LimiterShare(None)),
        Ok(share) if (0.01..=100.0).contains(&share) => Ok(LimiterShare(Some(share))),
        _ => Err("off or a share from 0.01 to 100 is needed".to_owned()),
    }
}

impl Goodput {
    fn cases(&self) -> Vec<Case> {
        let mut cases = Vec::new();
        for &transport in &self.transport {
            for &rate_bits_per_s in &self.rate_bits_per_s {
                for &rtt_ms in &self.rtt_ms {
                    for &queue_bytes in &self.queue_bytes {
                        cases.extend(self.limiter_share.iter().map(|&LimiterShare(limiter_share)| Case {
                            transport,
                            rate_bits_per_s,
                            rtt_ms,
                            queue_bytes,
                            limiter_share,
                        }));
                    }
                }
            }
        }
        cases
    }

    pub(crate) fn run(&self) -> anyhow::Result<()> {
        let mut results = Results::new(self.json);
        for case in self.cases() {
            results.push(measure(&case)?);
        }
        results.finish().map(drop)
    }
}
