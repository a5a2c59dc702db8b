//! Links of a plan, as settings of simulated links.

use std::num::NonZeroU64;
use std::path::{Path, PathBuf};

use lodestream_netsim::link::{
    AtEnd, ETHERNET_MTU_BYTES, GilbertElliott, Jitter, LinkSettings, Loss, MAX_RATE_BITS_PER_S, NS_PER_S,
    Rate,
};
use serde::Deserialize;

use super::Fault;

/// Queue of a link that does not name one.
pub(super) const DEFAULT_QUEUE_BYTES: u64 = 64 * 1024;
/// Longest trace file: a value per second for weeks.
const MAX_TRACE_BYTES: u64 = 8 << 20;
/// Longest delay, and largest jitter, in one direction.
const MAX_DELAY_MS: f64 = 1_800_000.0;
/// Smallest MTU: the packet size that every Internet host must accept (RFC 791).
const MIN_MTU_BYTES: u32 = 576;

/// A link by name: `[link.NAME]`.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct LinkFile {
    pub(super) down: Direction,
    pub(super) up: Option<Direction>,
}

/// One direction of a link, as far as it is given.
#[derive(Clone, Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Direction {
    pub(super) rate_bits_per_s: Option<u64>,
    pub(super) rate_steps: Option<Vec<StepFile>>,
    pub(super) rate_trace: Option<TraceFile>,
    pub(super) delay_ms: Option<f64>,
    pub(super) jitter_ms: Option<f64>,
    pub(super) reorder: Option<bool>,
    pub(super) loss: Option<f64>,
    pub(super) burst_loss: Option<BurstFile>,
    pub(super) queue_bytes: Option<u64>,
    pub(super) mtu_bytes: Option<u32>,
}

#[derive(Clone, Copy, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct StepFile {
    from_s: f64,
    bits_per_s: u64,
}

#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct TraceFile {
    file: PathBuf,
    at_end: AtEndFile,
}

#[derive(Clone, Copy, Debug, Deserialize)]
#[serde(rename_all = "lowercase")]
enum AtEndFile {
    Repeat,
    Hold,
}

#[derive(Clone, Copy, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct BurstFile {
    to_bad: f64,
    to_good: f64,
    #[serde(default)]
    loss_good: f64,
    #[serde(default = "all")]
    loss_bad: f64,
}

fn all() -> f64 {
    1.0
}

impl Direction {
    /// This table's values, completed by those of `other`. A rate of one kind replaces a rate of another kind, and so
    /// does loss.
    pub(super) fn or(&self, other: &Self) -> Self {
        let own_rate =
            self.rate_bits_per_s.is_some() || self.rate_steps.is_some() || self.rate_trace.is_some();
        let rates = if own_rate { self } else { other };
        let losses = if self.loss.is_some() || self.burst_loss.is_some() { self } else { other };
        Self {
            rate_bits_per_s: rates.rate_bits_per_s,
            rate_steps: rates.rate_steps.clone(),
            rate_trace: rates.rate_trace.clone(),
            delay_ms: self.delay_ms.or(other.delay_ms),
            jitter_ms: self.jitter_ms.or(other.jitter_ms),
            reorder: self.reorder.or(other.reorder),
            loss: losses.loss,
            burst_loss: losses.burst_loss,
            queue_bytes: self.queue_bytes.or(other.queue_bytes),
            mtu_bytes: self.mtu_bytes.or(other.mtu_bytes),
        }
    }

    /// The settings, without headers. Trace files are relative to `folder`.
    pub(super) fn settings(&self, folder: &Path) -> Result<LinkSettings, Fault> {
        let rate = self.rate(folder)?;
        let delay_ns = nanoseconds("delay_ms", self.delay_ms.unwrap_or(0.0))?;
        let largest_ns = nanoseconds("jitter_ms", self.jitter_ms.unwrap_or(0.0))?;
        let queue_bytes = self.queue_bytes.unwrap_or(DEFAULT_QUEUE_BYTES);
        if queue_bytes > 1 << 30 {
            return Err(Fault::new("queue_bytes", format!("{queue_bytes} is above 1 GiB")));
        }
        let mtu_bytes = self.mtu_bytes.unwrap_or(ETHERNET_MTU_BYTES);
        if !(MIN_MTU_BYTES..=65_535).contains(&mtu_bytes) {
            let message = format!("{mtu_bytes} is not a packet size from {MIN_MTU_BYTES} to 65535 bytes");
            return Err(Fault::new("mtu_bytes", message));
        }
        Ok(LinkSettings {
            rate,
            delay_ns,
            jitter: Jitter { largest_ns, reorders: self.reorder.unwrap_or(false) },
            queue_bytes,
            loss: self.loss()?,
            overhead_bytes: 0,
            mtu_bytes,
        })
    }

    fn rate(&self, folder: &Path) -> Result<Rate, Fault> {
        match (self.rate_bits_per_s, &self.rate_steps, &self.rate_trace) {
            (Some(rate), None, None) => constant(rate),
            (None, Some(steps), None) => {
                let mut list = Vec::with_capacity(steps.len());
                for (i, step) in steps.iter().enumerate() {
                    if !(0.0..=1e6).contains(&step.from_s) {
                        let message = format!("{} is not a time from 0 to 1e6 seconds", step.from_s);
                        return Err(Fault::new(format!("rate_steps[{i}].from_s"), message));
                    }
                    list.push(((step.from_s * NS_PER_S as f64).round() as u64, step.bits_per_s));
                }
                Rate::steps(&list).map_err(|why| Fault::new("rate_steps", why.to_string()))
            }
            (None, None, Some(trace)) => trace.read(folder),
            (None, None, None) => Err(Fault::new(
                "rate_bits_per_s",
                "is missing; give it, or rate_steps, or rate_trace".to_owned(),
            )),
            _ => Err(Fault::new(
                "rate_bits_per_s",
                "there is more than one rate; keep one of rate_bits_per_s, rate_steps and rate_trace"
                    .to_owned(),
            )),
        }
    }

    fn loss(&self) -> Result<Loss, Fault> {
        match (self.loss, self.burst_loss) {
            (None, None) => Ok(Loss::NONE),
            (Some(loss), None) => probability("loss", loss).map(Loss::Random),
            (None, Some(burst)) => burst.check().map(Loss::Burst),
            (Some(_), Some(_)) => {
                Err(Fault::new("loss", "there is burst_loss too; keep one of them".to_owned()))
            }
        }
    }
}

impl BurstFile {
    fn check(&self) -> Result<GilbertElliott, Fault> {
        let Self { to_bad, to_good, loss_good, loss_bad } = *self;
        let all =
            [("to_bad", to_bad), ("to_good", to_good), ("loss_good", loss_good), ("loss_bad", loss_bad)];
        for (name, value) in all {
            probability(&format!("burst_loss.{name}"), value)?;
        }
        if to_good == 0.0 {
            let message = "0 would keep the link bad for ever; give a probability above 0".to_owned();
            return Err(Fault::new("burst_loss.to_good", message));
        }
        Ok(GilbertElliott { to_bad, to_good, loss_good, loss_bad })
    }
}

impl TraceFile {
    fn read(&self, folder: &Path) -> Result<Rate, Fault> {
        let path = folder.join(&self.file);
        let fail =
            |why: &dyn std::fmt::Display| Fault::new("rate_trace.file", format!("{}: {why}", path.display()));
        let length = std::fs::metadata(&path).map_err(|why| fail(&why))?.len();
        if length > MAX_TRACE_BYTES {
            return Err(fail(&format!("has {length} bytes; a trace has at most {MAX_TRACE_BYTES}")));
        }
        let text = std::fs::read_to_string(&path).map_err(|why| fail(&why))?;
        let at_end = match self.at_end {
            AtEndFile::Repeat => AtEnd::Repeat,
            AtEndFile::Hold => AtEnd::Hold,
        };
        Rate::parse_trace(&text, at_end).map_err(|why| fail(&why))
    }
}

fn constant(bits_per_s: u64) -> Result<Rate, Fault> {
    let rate = NonZeroU64::new(bits_per_s).filter(|rate| (1000..=MAX_RATE_BITS_PER_S).contains(&rate.get()));
    let message = || format!("{bits_per_s} is not a rate from 1e3 to 1e12 bit/s");
    rate.map(Rate::constant).ok_or_else(|| Fault::new("rate_bits_per_s", message()))
}

fn probability(field: &str, value: f64) -> Result<f64, Fault> {
    if (0.0..=1.0).contains(&value) {
        Ok(value)
    } else {
        Err(Fault::new(field, format!("{value} is not a probability from 0 to 1")))
    }
}

fn nanoseconds(field: &str, ms: f64) -> Result<u64, Fault> {
    if (0.0..=MAX_DELAY_MS).contains(&ms) {
        Ok((ms * 1e6).round() as u64)
    } else {
        Err(Fault::new(field, format!("{ms} is not a time from 0 to {MAX_DELAY_MS} ms")))
    }
}
