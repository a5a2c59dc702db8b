//! Cost of a server's sessions: memory and processor time of its process, in real time on loopback.
//!
//! The server is the shipped daemon in a child process ([`crate::served`]), so that its memory and time are separate
//! from the clients'. Minimal clients (`crate::bare_client`) request all chunks of the scene and read what arrives. A
//! second server has clients that are silent after the push; instead of a third, a bare sender (`crate::bare_sender`)
//! sends the same blobs at the same rate. Memory depends on the allocator and processor time on the machine: compare
//! their growth, and the time with that of the bare sender.

mod case;
mod crowd;

use std::path::Path;
use std::sync::Arc;

use lodestream_protocol::source::SceneSource;
use serde::Serialize;

pub use self::case::Case;
use self::crowd::{Crowd, Role};
use crate::bare_client::chunks;
use crate::plan::Transport;
use crate::served::{Server, Serving};
use crate::timeline::milliseconds;

/// The results of a case. Bytes of memory are resident ones.
#[derive(Clone, Debug, Serialize)]
pub struct Load {
    /// Transport between clients and server.
    pub transport: Transport,
    /// Distinct assets.
    pub assets: u32,
    /// Instances.
    pub instances: u32,
    /// Clients.
    pub clients: u32,
    /// Clients that could not connect or lost their connection.
    pub failed: u32,
    /// Rate limit of each session.
    pub rate_bits_per_s: u64,
    /// Payload bytes received, as a share of the rate limits.
    pub received_share: f64,
    /// Payload bytes of the slowest client, as a share of the most that its rate limit admits.
    pub least_share: f64,
    /// Memory of the server before the first client.
    pub open_bytes: u64,
    /// Memory at the end of the window.
    pub loaded_bytes: u64,
    /// Growth per client.
    pub bytes_per_client: f64,
    /// Growth per client that is silent after the push.
    pub idle_bytes_per_client: f64,
    /// Processor time until two seconds after all had connected, in seconds.
    pub connect_cpu_s: f64,
    /// Cores that the server uses within the window.
    pub cpu_share: f64,
    /// Processor time per megabyte of payload.
    pub cpu_ms_per_mb: f64,
    /// The same for a bare sender.
    pub bare_cpu_ms_per_mb: f64,
    /// Ratio of the two.
    pub cpu_over_bare: f64,
    /// Wake-ups of the server's threads per megabyte of payload.
    pub wake_ups_per_mb: f64,
    /// The same for a bare sender.
    pub bare_wake_ups_per_mb: f64,
    /// Median time from the connect call to the first bytes of a blob.
    pub first_blob_p50_ms: f64,
    /// Longest time.
    pub first_blob_max_ms: f64,
}

/// Measures a case. `scene` names the scene for the server's process; `source` is the same scene, opened here.
///
/// # Errors
/// A server or clients that cannot be started; systems without `/proc`.
pub fn measure(
    scene: &str,
    source: &Arc<dyn SceneSource>,
    cache: Option<&Path>,
    case: &Case,
) -> anyhow::Result<Load> {
    let crowd = |serving: Serving, role: Role| {
        Crowd::run(&Server::start(scene, cache, case.rate_bits_per_s, serving)?, case, &role)
    };
    let idle = crowd(Serving::Lifted, Role::Idle)?;
    let bare = crowd(Serving::Bare, Role::Listening)?;
    let active = crowd(Serving::Lifted, Role::Active(Arc::new(chunks(source))))?;
    let place = |i: usize| active.first_ns.get(i).map_or(f64::INFINITY, |ns| milliseconds(*ns));
    let least = active.received.iter().min().map_or(0.0, |bytes| *bytes as f64);
    let firsts = active.first_ns.len();
    let cpu_ms_per_mb = active.cpu_ms_per_mb();
    let bare_cpu_ms_per_mb = bare.cpu_ms_per_mb();
    Ok(Load {
        transport: case.transport,
        assets: source.header().asset_count,
        instances: source.header().instance_count,
        clients: case.clients,
        failed: active.failed,
        rate_bits_per_s: case.rate_bits_per_s,
        received_share: active.bytes() / (f64::from(case.clients) * case.allowed_bytes()),
        least_share: least / (case.allowed_bytes() * case.blob_share()),
        open_bytes: active.open_bytes,
        loaded_bytes: active.loaded_bytes,
        bytes_per_client: active.bytes_per_client(case),
        idle_bytes_per_client: idle.bytes_per_client(case),
        connect_cpu_s: active.connect_cpu_s,
        cpu_share: active.cpu_s / case.window().as_secs_f64(),
        cpu_ms_per_mb,
        bare_cpu_ms_per_mb,
        cpu_over_bare: cpu_ms_per_mb / bare_cpu_ms_per_mb,
        wake_ups_per_mb: active.wake_ups_per_mb(),
        bare_wake_ups_per_mb: bare.wake_ups_per_mb(),
        first_blob_p50_ms: place(firsts.div_ceil(2).max(1) - 1),
        first_blob_max_ms: place(firsts.max(1) - 1),
    })
}

impl std::fmt::Display for Load {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(
            f,
            "{}, {} assets, {} instances, {} clients at {} Mbit/s: {:.0} % of it received, by the last {:.0} % of what can \
             be, {:.1} MB open, {:.0} kB a client, {:.0} an idle one, {:.1} % of a core, {:.2} ms a megabyte, {:.2} times \
             the {:.2} of a bare sender, {:.0} wake-ups a megabyte and {:.0} of that, first blob after {:.0} ms, at most {:.0}; {} failed",
            self.transport,
            self.assets,
            self.instances,
            self.clients,
            self.rate_bits_per_s as f64 / 1e6,
            self.received_share * 100.0,
            self.least_share * 100.0,
            self.open_bytes as f64 / 1e6,
            self.bytes_per_client / 1e3,
            self.idle_bytes_per_client / 1e3,
            self.cpu_share * 100.0,
            self.cpu_ms_per_mb,
            self.cpu_over_bare,
            self.bare_cpu_ms_per_mb,
            self.wake_ups_per_mb,
            self.bare_wake_ups_per_mb,
            self.first_blob_p50_ms,
            self.first_blob_max_ms,
            self.failed
        )
    }
}
