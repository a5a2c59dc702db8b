//! Many simultaneous clients of one server, and the server process's memory and time.

use std::sync::Arc;
use std::time::Duration;

use futures_util::StreamExt as _;
use lodestream_client::net;
use lodestream_netsim::clock::VirtualClock;
use lodestream_scene::BlobId;
use tokio::net::TcpStream;
use tokio::runtime::Builder;
use tokio::sync::mpsc;

use super::case::Case;
use crate::bare_client::BareClient;
use crate::plan::Transport;
use crate::served::{Address, Server};

/// Time before anything is counted: connections and initial bursts.
const WARM_UP: Duration = Duration::from_secs(2);
/// Bytes read at once.
const READ_BYTES: usize = 1 << 16;

/// Behaviour of the clients.
#[derive(Clone, Debug)]
pub(super) enum Role {
    /// They request these blobs and read what arrives.
    Active(Arc<Vec<BlobId>>),
    /// They send `Hello`, receive the push and stay silent.
    Idle,
    /// They send nothing; the server is a bare sender (`crate::bare_sender`).
    Listening,
}

/// Measurements of a crowd.
#[derive(Debug)]
pub(super) struct Crowd {
    /// Clients that could not connect or lost their connection.
    pub(super) failed: u32,
    /// Memory of the server before the first client and at the end of the window.
    pub(super) open_bytes: u64,
    pub(super) loaded_bytes: u64,
    /// Processor time of the server before the window and within it.
    pub(super) connect_cpu_s: f64,
    pub(super) cpu_s: f64,
    /// Wake-ups of its threads within the window.
    pub(super) wake_ups: u64,
    /// Payload bytes of each client within the window.
    pub(super) received: Vec<u64>,
    /// Times from the connect call to the first bytes of a blob, ascending.
    pub(super) first_ns: Vec<u64>,
}

impl Crowd {
    /// Runs a case's clients against a fresh server.
    pub(super) fn run(server: &Server, case: &Case, role: &Role) -> anyhow::Result<Self> {
        let open_bytes = server.memory_bytes()?;
        let cpu_before = server.cpu_s()?;
        let runtime = Builder::new_multi_thread().worker_threads(1).enable_all().build()?;
        runtime.block_on(async {
            let clock = VirtualClock::start();
            let clients: Vec<_> = (0..case.clients)
                .map(|_| tokio::spawn(client(clock, *case, server.at(), role.clone())))
                .collect();
            tokio::time::sleep(WARM_UP).await;
            let (cpu_start, woken_start) = (server.cpu_s()?, server.wake_ups()?);
            tokio::time::sleep(case.window()).await;
            let (cpu_end, woken_end) = (server.cpu_s()?, server.wake_ups()?);
            let loaded_bytes = server.memory_bytes()?;
            let (mut received, mut first_ns) = (Vec::new(), Vec::new());
            for client in clients {
                if let Some(traffic) = client.await? {
                    received.push(traffic.bytes);
                    first_ns.extend(traffic.first_ns);
                }
            }
            first_ns.sort_unstable();
            Ok(Self {
                failed: case.clients - u32::try_from(received.len())?,
                open_bytes,
                loaded_bytes,
                connect_cpu_s: cpu_start - cpu_before,
                cpu_s: cpu_end - cpu_start,
                wake_ups: woken_end.saturating_sub(woken_start),
                received,
                first_ns,
            })
        })
    }

    /// Payload bytes of all clients within the window.
    pub(super) fn bytes(&self) -> f64 {
        self.received.iter().sum::<u64>() as f64
    }

    /// Growth of the server's memory per client.
    pub(super) fn bytes_per_client(&self, case: &Case) -> f64 {
        (self.loaded_bytes as f64 - self.open_bytes as f64) / f64::from(case.clients)
    }

    /// Processor time per megabyte received.
    pub(super) fn cpu_ms_per_mb(&self) -> f64 {
        self.cpu_s * 1e3 / (self.bytes() / 1e6)
    }

    /// Wake-ups of the server's threads per megabyte received.
    pub(super) fn wake_ups_per_mb(&self) -> f64 {
        self.wake_ups as f64 / (self.bytes() / 1e6)
    }
}

/// Measurements of one client.
struct ClientTraffic {
    first_ns: Option<u64>,
    /// Payload bytes within the window.
    bytes: u64,
}

/// Runs one client from its connect call to the end of the window; `None` if its connection fails.
async fn client(clock: VirtualClock, case: Case, at: Address, role: Role) -> Option<ClientTraffic> {
    let [from_ns, to_ns] = [WARM_UP, WARM_UP + case.window()].map(|t| t.as_nanos() as u64);
    let start_ns = clock.now_ns();
    let mut source = Source::connect(clock, case.transport, at, role).await?;
    let mut traffic = ClientTraffic { first_ns: None, bytes: 0 };
    loop {
        let (at_ns, bytes) = tokio::select! {
            biased;
            arrival = source.next() => arrival?,
            () = clock.sleep_until(to_ns) => return Some(traffic),
        };
        traffic.first_ns.get_or_insert(at_ns - start_ns);
        if (from_ns..to_ns).contains(&at_ns) {
            traffic.bytes += bytes;
        }
    }
}

/// The receiving end of a client's connection.
enum Source {
    Session(BareClient),
    Bytes(mpsc::Receiver<(u64, u64)>),
}

impl Source {
    async fn connect(
        clock: VirtualClock,
        transport: Transport,
        Address { quic, http, pin }: Address,
        role: Role,
    ) -> Option<Self> {
        let client = match transport {
            Transport::Quic => {
                let endpoint = net::endpoint(quic, net::client_config(pin).ok()?).ok()?;
                let connection = endpoint.connect(quic, "localhost").ok()?.await.ok()?;
                if matches!(role, Role::Listening) {
                    return Some(Self::stream(clock, endpoint, connection));
                }
                BareClient::over_quic(endpoint, connection, clock).await.ok()?
            }
            Transport::Ws => {
                let stream = TcpStream::connect(http).await.ok()?;
                stream.set_nodelay(true).ok()?;
                if matches!(role, Role::Listening) {
                    return Self::messages(clock, stream, &http.to_string()).await;
                }
                BareClient::over_websocket(stream, &http.to_string(), clock).await.ok()?
            }
        };
        client.hello().await.ok()?;
        if let Role::Active(wanted) = role {
            client.want(&wanted, 1).await.ok()?;
        }
        Some(Self::Session(client))
    }

    /// The bytes of the first stream of a connection.
    fn stream(clock: VirtualClock, endpoint: quinn::Endpoint, connection: quinn::Connection) -> Self {
        let (found, bytes) = mpsc::channel(16);
        tokio::spawn(async move {
            let (_endpoint, Ok(mut stream)) = (endpoint, connection.accept_uni().await) else { return };
            while let Ok(Some(chunk)) = stream.read_chunk(READ_BYTES, true).await {
                if found.send((clock.now_ns(), chunk.bytes.len() as u64)).await.is_err() {
                    return;
                }
            }
        });
        Self::Bytes(bytes)
    }

    /// The lengths of a WebSocket's messages.
    async fn messages(clock: VirtualClock, stream: TcpStream, host: &str) -> Option<Self> {
        let (mut socket, _) = tokio_tungstenite::client_async(format!("ws://{host}/"), stream).await.ok()?;
        let (found, bytes) = mpsc::channel(16);
        tokio::spawn(async move {
            while let Some(Ok(message)) = socket.next().await {
                if found.send((clock.now_ns(), message.len() as u64)).await.is_err() {
                    return;
                }
            }
        });
        Some(Self::Bytes(bytes))
    }

    /// The next arrival: time and number of bytes.
    async fn next(&mut self) -> Option<(u64, u64)> {
        match self {
            Self::Session(client) => client.next().await.map(|arrival| (arrival.at_ns, arrival.bytes)),
            Self::Bytes(bytes) => bytes.recv().await,
        }
    }
}
