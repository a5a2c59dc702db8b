//! Effect of attacks on a server: the shipped daemon with its own limits in a process of its own, in real time on
//! loopback, while some hundred untrusted peers of one address attack it and a client of another address requests a
//! blob.
//!
//! Each case is bounded in peers, bytes and seconds. Memory and processor time are the server process's alone.

mod attack;

use std::net::{IpAddr, Ipv4Addr, SocketAddr};
use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

use lodestream_netsim::clock::VirtualClock;
use lodestream_protocol::source::SceneSource;
use lodestream_scene::BlobId;
use serde::Serialize;
use tokio::net::TcpSocket;
use tokio::runtime::Builder;
use tokio::time::{Instant, sleep, sleep_until, timeout};

pub use attack::Attack;

use crate::bare_client::BareClient;
use crate::bare_client::chunks;
use crate::served::{Server, Serving};
use crate::timeline::milliseconds;

/// Time between the start of the attack and the connect call of the other client.
const ALONE: Duration = Duration::from_secs(2);
/// Length of the attack.
const STAY: Duration = Duration::from_secs(5);
/// Time from the end of the attack until memory is measured again.
const AFTER: Duration = Duration::from_secs(2);
/// Time that the other client waits.
const TIMEOUT: Duration = Duration::from_secs(10);
/// The other client's address, which differs from the attackers'; Linux accepts all of 127.0.0.0/8.
const OTHER: IpAddr = IpAddr::V4(Ipv4Addr::new(127, 0, 0, 2));
/// Rate limit of a session.
const RATE_BITS_PER_S: u64 = 16_000_000;

/// The results of a case. Bytes of memory are resident ones.
#[derive(Clone, Debug, Serialize)]
pub struct AttackOutcome {
    /// The attack.
    pub attack: &'static str,
    /// Number of untrusted peers.
    pub untrusted_peers: u32,
    /// How many of them the server still held at the end; the others were refused or closed.
    pub held: u32,
    /// Time from the other client's connect call to its first bytes of a blob, in milliseconds; absent if none came in
    /// ten seconds.
    pub other_ms: Option<f64>,
    /// Memory of the server before, the largest value seen, and two seconds after the end.
    pub before_bytes: u64,
    /// See `before_bytes`.
    pub most_bytes: u64,
    /// See `before_bytes`.
    pub after_bytes: u64,
    /// Processor time of the server, seconds.
    pub cpu_s: f64,
}

/// Runs `count` untrusted peers against a server. `scene` names the scene for the server's process; `source` is the
/// same scene, opened here.
///
/// # Errors
/// A server that cannot be started; systems without `/proc`.
pub fn measure(
    scene: &str,
    source: &Arc<dyn SceneSource>,
    cache: Option<&Path>,
    (attack, count): (Attack, u32),
) -> anyhow::Result<AttackOutcome> {
    let server = Server::start(scene, cache, RATE_BITS_PER_S, Serving::Shipped)?;
    let wanted: Arc<Vec<BlobId>> = Arc::new(chunks(source));
    let runtime = Builder::new_multi_thread().worker_threads(1).enable_all().build()?;
    runtime.block_on(async {
        let (before_bytes, cpu_before) = (server.memory_bytes()?, server.cpu_s()?);
        let end = Instant::now() + STAY;
        let untrusted_peers: Vec<_> = (0..count)
            .map(|number| tokio::spawn(attack.clone().run(server.at(), number, Arc::clone(&wanted), end)))
            .collect();
        let mut most_bytes = before_bytes;
        sleep(ALONE).await;
        most_bytes = most_bytes.max(server.memory_bytes()?);
        let other = tokio::spawn(other(server.at().http, wanted[0]));
        while Instant::now() < end {
            sleep(Duration::from_millis(200)).await;
            most_bytes = most_bytes.max(server.memory_bytes()?);
        }
        sleep_until(end).await;
        let mut held = 0;
        for untrusted_peer in untrusted_peers {
            held += u32::from(untrusted_peer.await?);
        }
        let other_ms = other.await?.map(milliseconds);
        sleep(AFTER).await;
        Ok(AttackOutcome {
            attack: attack.name(),
            untrusted_peers: count,
            held,
            other_ms,
            before_bytes,
            most_bytes,
            after_bytes: server.memory_bytes()?,
            cpu_s: server.cpu_s()? - cpu_before,
        })
    })
}

/// Nanoseconds until the other client has the first bytes of a blob.
async fn other(http: SocketAddr, blob: BlobId) -> Option<u64> {
    let clock = VirtualClock::start();
    let first = async {
        let socket = TcpSocket::new_v4().ok()?;
        socket.bind(SocketAddr::new(OTHER, 0)).ok()?;
        let stream = socket.connect(http).await.ok()?;
        stream.set_nodelay(true).ok()?;
        let mut client = BareClient::over_websocket(stream, &http.to_string(), clock).await.ok()?;
        client.hello().await.ok()?;
        client.want(&[blob], 1).await.ok()?;
        Some(client.next().await?.at_ns)
    };
    timeout(TIMEOUT, first).await.ok()?
}

impl std::fmt::Display for AttackOutcome {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let other = self.other_ms.map_or_else(|| "none".to_owned(), |ms| format!("{ms:.0} ms"));
        let [before, most, after] =
            [self.before_bytes, self.most_bytes, self.after_bytes].map(|bytes| bytes as f64 / 1e6);
        write!(
            f,
            "{} × {}: {} held; somebody else's first blob {other}; memory {before:.1} → {most:.1} → {after:.1} MB; {:.2} s \
             of a core",
            self.untrusted_peers, self.attack, self.held, self.cpu_s
        )
    }
}
