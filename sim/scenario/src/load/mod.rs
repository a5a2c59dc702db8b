//! What a server's sessions cost: memory and processor time of a process of its own, in real time on loopback.
//!
//! The server is the shipped daemon in a child process ([`crate::served`]), so that its memory and time are not the
//! clients'. The clients are bare (`crate::bare_client`): they ask for all chunks of the scene and read what comes. A
//! second server has clients that are silent after what is pushed; and instead of a third, a bare sender
//! (`crate::bare_sender`) sends the same blobs at the same pace. Memory depends on the allocator and processor time on
//! the machine; both are good for how they grow, and the latter for what it is beside that of the bare sender.

mod crowd;

use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

use lodestream_protocol::server::ServerConfig;
use lodestream_protocol::source::SceneSource;
use serde::Serialize;

use self::crowd::{Crowd, Role};
use crate::bare_client::chunks;
use crate::plan::Transport;
use crate::result::milliseconds;
use crate::served::{Server, Serving};

/// What is measured.
#[derive(Clone, Copy, Debug)]
pub struct Case {
    /// How clients and server talk.
    pub transport: Transport,
    /// How many clients there are, all at once.
    pub clients: u32,
    /// The server's limit for each.
    pub rate_bits_per_s: u64,
    /// How long is counted.
    pub seconds: u32,
}

impl Case {
    fn window(&self) -> Duration {
        Duration::from_secs(u64::from(self.seconds))
    }

    /// Bytes that the limit lets through to a client within the window.
    fn allowed_bytes(&self) -> f64 {
        self.rate_bits_per_s as f64 / 8.0 * self.window().as_secs_f64()
    }

    /// How many of them can be those of blobs: the limit is for what travels, headers and all.
    fn blob_share(&self) -> f64 {
        let config = match self.transport {
            Transport::Quic => ServerConfig::quic(None),
            Transport::Ws => ServerConfig::websocket(None),
        };
        f64::from(config.piece_bytes) / config.limiter.wire_bytes(config.piece_bytes as usize) as f64
    }
}

/// What came of it. Bytes of memory are resident ones.
#[derive(Clone, Debug, Serialize)]
pub struct Load {
    /// How clients and server talked.
    pub transport: Transport,
    /// Distinct assets.
    pub assets: u32,
    /// Instances.
    pub instances: u32,
    /// Clients.
    pub clients: u32,
    /// Clients that lost their connection or found none.
    pub failed: u32,
    /// Limit of each.
    pub rate_bits_per_s: u64,
    /// Bytes of blobs that came, over what the limits allow.
    pub received_share: f64,
    /// What came to the client with least, over the most that can come of blobs under its limit.
    pub least_share: f64,
    /// Memory of the server once it is ready.
    pub open_bytes: u64,
    /// Memory at the end of the window.
    pub loaded_bytes: u64,
    /// What it grew by, for each client.
    pub bytes_per_client: f64,
    /// The same of clients that are silent after what is pushed.
    pub idle_bytes_per_client: f64,
    /// Processor time until all had connected and two seconds had passed, in seconds.
    pub connect_cpu_s: f64,
    /// Share of a core that the server takes within the window.
    pub cpu_share: f64,
    /// Processor time for a megabyte of blobs.
    pub cpu_ms_per_mb: f64,
    /// The same of a bare sender.
    pub bare_cpu_ms_per_mb: f64,
    /// The one over the other.
    pub cpu_over_bare: f64,
    /// How often threads of the server waited and were woken, for a megabyte of blobs.
    pub wake_ups_per_mb: f64,
    /// The same of a bare sender.
    pub bare_wake_ups_per_mb: f64,
    /// Time from the connect call to the first bytes of a blob that half of the clients do not exceed.
    pub first_blob_p50_ms: f64,
    /// The longest.
    pub first_blob_max_ms: f64,
}

/// Measures a case. `scene` names the scene for the server's process, `source` is the same, opened here.
///
/// # Errors
/// What keeps the server or the clients from being started, and systems without `/proc`.
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
