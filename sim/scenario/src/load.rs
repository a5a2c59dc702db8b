//! What a server's sessions cost: memory and processor time of a process of its own, in real time on loopback.
//!
//! The server is the shipped daemon in a child process ([`crate::served`]), so that its memory and time are not the
//! clients'. The clients are bare (`crate::bare_client`): they ask for all chunks of the scene and read what comes.
//! Memory depends on the allocator and processor time on the machine; both are good for how they grow.

use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

use lodestream_client::net;
use lodestream_netsim::clock::VirtualClock;
use lodestream_protocol::BlobId;
use lodestream_protocol::limits::MAX_QUEUED;
use lodestream_protocol::source::SceneSource;
use serde::Serialize;
use tokio::net::TcpStream;
use tokio::runtime::Builder;

use crate::bare_client::BareClient;
use crate::plan::Transport;
use crate::result::milliseconds;
use crate::served::{Address, Limits, Server};

/// Before anything is counted: connecting, and the bursts of the beginning.
const WARM_UP: Duration = Duration::from_secs(2);

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
    /// Memory of the server once it is ready.
    pub open_bytes: u64,
    /// Memory at the end of the window.
    pub loaded_bytes: u64,
    /// What it grew by, for each client.
    pub bytes_per_client: f64,
    /// Processor time until all had connected and two seconds had passed, in seconds.
    pub connect_cpu_s: f64,
    /// Share of a core that the server takes within the window.
    pub cpu_share: f64,
    /// Processor time for a megabyte of blobs.
    pub cpu_ms_per_mb: f64,
    /// Time from the connect call to the first bytes of a blob that half of the clients do not exceed.
    pub first_blob_p50_ms: f64,
    /// The longest.
    pub first_blob_max_ms: f64,
}

/// What a client saw.
struct Seen {
    first_ns: Option<u64>,
    /// Bytes of blobs within the window.
    bytes: u64,
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
    let server = Server::start(scene, cache, case.rate_bits_per_s, Limits::Lifted)?;
    let wanted: Arc<Vec<BlobId>> = Arc::new(chunks(source));
    let open_bytes = server.memory_bytes()?;
    let cpu_before = server.cpu_s()?;
    let window = Duration::from_secs(u64::from(case.seconds));
    let runtime = Builder::new_multi_thread().worker_threads(1).enable_all().build()?;
    let (seen, cpu_start, cpu_end, loaded_bytes) = runtime.block_on(async {
        let clock = VirtualClock::start();
        let clients: Vec<_> = (0..case.clients)
            .map(|_| tokio::spawn(client(clock, *case, server.at(), Arc::clone(&wanted))))
            .collect();
        tokio::time::sleep(WARM_UP).await;
        let cpu_start = server.cpu_s()?;
        tokio::time::sleep(window).await;
        let (cpu_end, loaded_bytes) = (server.cpu_s()?, server.memory_bytes()?);
        let mut seen = Vec::with_capacity(clients.len());
        for client in clients {
            seen.push(client.await?);
        }
        anyhow::Ok((seen, cpu_start, cpu_end, loaded_bytes))
    })?;
    let ok: Vec<&Seen> = seen.iter().flatten().collect();
    let mut first: Vec<u64> = ok.iter().filter_map(|seen| seen.first_ns).collect();
    first.sort_unstable();
    let place = |i: usize| first.get(i).map_or(f64::INFINITY, |ns| milliseconds(*ns));
    let bytes: u64 = ok.iter().map(|seen| seen.bytes).sum();
    let allowed = f64::from(case.clients) * case.rate_bits_per_s as f64 / 8.0 * window.as_secs_f64();
    Ok(Load {
        transport: case.transport,
        assets: source.header().asset_count,
        instances: source.header().instance_count,
        clients: case.clients,
        failed: case.clients - u32::try_from(ok.len())?,
        rate_bits_per_s: case.rate_bits_per_s,
        received_share: bytes as f64 / allowed,
        open_bytes,
        loaded_bytes,
        bytes_per_client: (loaded_bytes as f64 - open_bytes as f64) / f64::from(case.clients),
        connect_cpu_s: cpu_start - cpu_before,
        cpu_share: (cpu_end - cpu_start) / window.as_secs_f64(),
        cpu_ms_per_mb: (cpu_end - cpu_start) * 1e3 / (bytes as f64 / 1e6),
        first_blob_p50_ms: place(first.len().div_ceil(2).max(1) - 1),
        first_blob_max_ms: place(first.len().max(1) - 1),
    })
}

/// All chunks of a scene, as many as a session queues.
pub(crate) fn chunks(source: &Arc<dyn SceneSource>) -> Vec<BlobId> {
    let pages = (0..source.header().page_count).filter_map(|page| source.page(page));
    let assets = pages.flat_map(|page| page.assets.clone());
    let of_asset = |(asset, chunks): (u32, u32)| (0..chunks).map(move |chunk| BlobId::chunk(asset, chunk));
    (0..).zip(assets.map(|asset| asset.chunk_count)).flat_map(of_asset).take(MAX_QUEUED).collect()
}

/// One client, from its connect call to the end of the window; `None` where its connection fails.
async fn client(
    clock: VirtualClock,
    case: Case,
    Address { quic, http, pin }: Address,
    wanted: Arc<Vec<BlobId>>,
) -> Option<Seen> {
    let [from_ns, to_ns] =
        [WARM_UP, WARM_UP + Duration::from_secs(u64::from(case.seconds))].map(|t| t.as_nanos() as u64);
    let start_ns = clock.now_ns();
    let mut client = match case.transport {
        Transport::Quic => {
            let endpoint = net::endpoint(quic, net::client_config(pin).ok()?).ok()?;
            let connection = endpoint.connect(quic, "localhost").ok()?.await.ok()?;
            BareClient::over_quic(endpoint, connection, clock).await.ok()?
        }
        Transport::Ws => {
            let stream = TcpStream::connect(http).await.ok()?;
            stream.set_nodelay(true).ok()?;
            BareClient::over_websocket(stream, &http.to_string(), clock).await.ok()?
        }
    };
    client.hello().await.ok()?;
    client.want(&wanted, 1).await.ok()?;
    let mut seen = Seen { first_ns: None, bytes: 0 };
    loop {
        let arrival = tokio::select! {
            biased;
            arrival = client.next() => arrival?,
            () = clock.sleep_until(to_ns) => return Some(seen),
        };
        seen.first_ns.get_or_insert(arrival.at_ns - start_ns);
        if (from_ns..to_ns).contains(&arrival.at_ns) {
            seen.bytes += arrival.bytes;
        }
    }
}

impl std::fmt::Display for Load {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(
            f,
            "{}, {} assets, {} instances, {} clients at {} Mbit/s: {:.0} % of it received, {:.1} MB open, {:.0} kB a client, \
             {:.1} % of a core, {:.2} ms a megabyte, first blob after {:.0} ms, at most {:.0}; {} failed",
            self.transport,
            self.assets,
            self.instances,
            self.clients,
            self.rate_bits_per_s as f64 / 1e6,
            self.received_share * 100.0,
            self.open_bytes as f64 / 1e6,
            self.bytes_per_client / 1e3,
            self.cpu_share * 100.0,
            self.cpu_ms_per_mb,
            self.first_blob_p50_ms,
            self.first_blob_max_ms,
            self.failed
        )
    }
}
