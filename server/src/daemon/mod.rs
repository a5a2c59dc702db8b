//! The streaming daemon: QUIC and WebSocket listeners, limits, metrics, shutdown.
//!
//! | module | idea |
//! |---|---|
//! | [`quic`], [`websocket`], [`http`] | the two transports, and the HTTP port that one of them shares |
//! | [`admin`], `listen` | the port for who runs the server; TCP listeners |
//! | [`congestion`] | how much of a QUIC connection may be in flight |
//! | `drive`, `intake` | the loop between a sans-IO session and a transport; how many bytes a client may send |
//! | [`state`], [`metrics`] | what sessions share |
//! | `places`, `room` | who may have a session, and who may ask for one |
//! | `damage` | blobs that cannot be read any more |
//! | [`origin`] | which web pages may open sessions |
//! | [`certificate`], [`shutdown`] | what their names say |
//! | [`memory_scene`] | a scene made of numbers, for tests |
//!
//! [`run`] is the whole daemon. Its parts take any endpoint ([`quic::serve_quic`]) and any byte stream
//! ([`http::accept_http`], [`websocket::serve_websocket`]), and read no clock but tokio's, so a simulator
//! runs them unchanged in paused time.

pub mod admin;
pub mod certificate;
pub mod congestion;
mod damage;
mod drive;
pub mod http;
mod intake;
mod listen;
pub mod memory_scene;
pub mod metrics;
pub mod origin;
mod places;
pub mod quic;
mod quic_stream;
mod reads;
mod room;
pub mod shutdown;
pub mod state;
#[cfg(test)]
mod tests;
pub mod websocket;

use std::io::Write as _;
use std::net::{IpAddr, Ipv4Addr, Ipv6Addr, SocketAddr};
use std::path::PathBuf;
use std::sync::Arc;
use std::time::{Duration, SystemTime};

use anyhow::{Context, anyhow, bail};
use lodestream_protocol::source::SceneSource;
use tokio::net::TcpListener;
use tokio::time::timeout;
use tracing_appender::non_blocking::ErrorCounter;

use self::admin::AdminPort;
use self::certificate::Certificate;
use self::listen::listen_tcp;
use self::origin::AllowedOrigins;
use self::shutdown::{Signals, StopRequests};
pub use self::state::{ServerState, SessionSettings};

/// Time for sessions' last words beyond [`SessionSettings::drain`].
const LAST_WORDS: Duration = Duration::from_secs(2);

/// What the daemon does and where.
#[derive(Clone, Debug)]
pub struct DaemonOptions {
    /// UDP address of the QUIC listener; port 0 for any. `None`: no QUIC.
    pub listen: Option<SocketAddr>,
    /// TCP address of the HTTP and WebSocket listener; port 0 for any. `None`: neither.
    pub http: Option<SocketAddr>,
    /// Where `/health` and `/metrics` are for who runs the server.
    pub admin: AdminPort,
    /// Folder in which the development certificate is kept.
    pub state_folder: PathBuf,
    /// PEM files of a certificate chain and its private key, in place of the development certificate.
    pub certificate: Option<(PathBuf, PathBuf)>,
    /// Limits of the sessions.
    pub sessions: SessionSettings,
    /// Web pages that may open sessions over WebSocket.
    pub origins: AllowedOrigins,
    /// What counts the log's lines that were left out, if that can happen.
    pub dropped_log_lines: Option<ErrorCounter>,
}

impl DaemonOptions {
    /// The standard ports on loopback but for the admin's, no limit, the development certificate in `state_folder`.
    #[must_use]
    pub fn new(state_folder: impl Into<PathBuf>) -> Self {
        Self {
            listen: Some(SocketAddr::from((Ipv4Addr::LOCALHOST, 4433))),
            http: Some(SocketAddr::from((Ipv4Addr::LOCALHOST, 8080))),
            admin: AdminPort::Off,
            state_folder: state_folder.into(),
            certificate: None,
            sessions: SessionSettings::default(),
            origins: AllowedOrigins::default(),
            dropped_log_lines: None,
        }
    }
}

/// Runs the daemon until SIGINT or SIGTERM: prints the viewer URLs, one a line, and that of the metrics, serves, and
/// drains when asked to end. A second signal ends it at once.
///
/// # Errors
/// Fails where an address or the certificate cannot be had, or where a second signal came.
pub async fn run(options: DaemonOptions, scene: Arc<dyn SceneSource>) -> anyhow::Result<()> {
    // Before the URLs are out: whoever reads them may ask to end at once.
    let signals = Signals::listen()?;
    let daemon = Daemon::bind(options, scene).await?;
    let metrics = daemon.admin_address().map(|address| format!("http://{address}/metrics"));
    for url in daemon.urls().into_iter().chain(metrics) {
        // Whoever wants none may have closed it.
        let _ = writeln!(std::io::stdout(), "{url}");
    }
    daemon.serve(signals).await
}

/// A daemon whose sockets are open.
#[derive(Debug)]
pub struct Daemon {
    state: Arc<ServerState>,
    quic: Option<(quinn::Endpoint, SocketAddr, String)>,
    http: Option<(TcpListener, SocketAddr)>,
    admin: Option<(TcpListener, SocketAddr)>,
}

impl Daemon {
    /// Opens the sockets. Must be called on a tokio runtime.
    ///
    /// # Errors
    /// Fails where an address or the certificate cannot be had.
    pub async fn bind(options: DaemonOptions, scene: Arc<dyn SceneSource>) -> anyhow::Result<Self> {
        let quic = match options.listen {
            None => None,
            Some(address) => {
                let certificate = match &options.certificate {
                    Some((chain, key)) => Certificate::from_pem_files(chain, key)?,
                    None => Certificate::load_or_create(&options.state_folder, SystemTime::now())?,
                };
                let endpoint = quinn::Endpoint::new(
                    quinn::EndpointConfig::default(),
                    Some(quic::server_config(&certificate)?),
                    quic::bind_udp(address)?,
                    Arc::new(quinn::TokioRuntime),
                )?;
                let address = endpoint.local_addr()?;
                Some((endpoint, address, certificate.fingerprint_hex()))
            }
        };
        let addressed = |listener: TcpListener| listener.local_addr().map(|address| (listener, address));
        let http = options.http.map(listen_tcp).transpose()?.map(addressed).transpose()?;
        let admin = options.admin.listen()?.map(addressed).transpose()?;
        let state = ServerState::with_origins(scene, options.sessions, options.origins);
        if let Some(dropped) = options.dropped_log_lines {
            state.metrics().watch_log(dropped);
        }
        Ok(Self { state, quic, http, admin })
    }

    /// Addresses for viewers: `quic://HOST:PORT#sha256=FINGERPRINT` (64 lowercase hexadecimal digits, the
    /// SHA-256 of the certificate's DER) and `ws://HOST:PORT/`. Where a socket listens on all addresses,
    /// the loopback address stands for them.
    #[must_use]
    pub fn urls(&self) -> Vec<String> {
        let quic = self.quic_url();
        let websocket = self.http.as_ref().map(|(_, address)| format!("ws://{}/", reachable(*address)));
        quic.into_iter().chain(websocket).collect()
    }

    fn quic_url(&self) -> Option<String> {
        let (_, address, fingerprint) = self.quic.as_ref()?;
        Some(format!("quic://{}#sha256={fingerprint}", reachable(*address)))
    }

    /// Address of the QUIC listener.
    #[must_use]
    pub fn quic_address(&self) -> Option<SocketAddr> {
        self.quic.as_ref().map(|(_, address, _)| *address)
    }

    /// Address of the HTTP and WebSocket listener.
    #[must_use]
    pub fn http_address(&self) -> Option<SocketAddr> {
        self.http.as_ref().map(|(_, address)| *address)
    }

    /// Address of the listener for who runs the server.
    #[must_use]
    pub fn admin_address(&self) -> Option<SocketAddr> {
        self.admin.as_ref().map(|(_, address)| *address)
    }

    /// What the sessions share.
    #[must_use]
    pub const fn state(&self) -> &Arc<ServerState> {
        &self.state
    }

    /// Serves until asked to end, then drains. A second request ends it at once.
    ///
    /// # Errors
    /// Fails where a listener ends by itself, or a second request came before all sessions had ended.
    pub async fn serve(self, mut stop: impl StopRequests) -> anyhow::Result<()> {
        let Self { state, quic, http, admin } = self;
        let mut listeners = tokio::task::JoinSet::new();
        if let Some((endpoint, _, _)) = quic {
            listeners.spawn(quic::serve_quic(endpoint, state.clone()));
        }
        if let Some((listener, _)) = http {
            listeners.spawn(http::serve_http(listener, state.clone()));
        }
        if let Some((listener, _)) = admin {
            listeners.spawn(admin::serve_admin(listener, state.clone()));
        }
        tracing::info!(
            scene = state.scene().header().name,
            rate_bits_per_s = state.settings().rate_bits_per_s,
            "serving"
        );
        tokio::select! {
            biased;
            () = stop.next() => {}
            // While the daemon runs none ends but by a fault.
            Some(ended) = listeners.join_next() => {
                state.stop();
                return Err(ended.err().map_or_else(|| anyhow!("it ended"), Into::into))
                    .context("a listener has failed; start the server again");
            }
        }
        tracing::info!(sessions = state.metrics().active_sessions(), "shutting down: draining");
        state.drain();
        let drained = async {
            if timeout(state.settings().drain + LAST_WORDS, state.all_sessions_ended()).await.is_err() {
                tracing::warn!("some sessions did not end in time");
            }
            state.stop();
            while listeners.join_next().await.is_some() {}
        };
        tokio::select! {
            biased;
            () = stop.next() => bail!("stopped by a second signal before all sessions had ended"),
            () = drained => {}
        }
        tracing::info!("shut down");
        Ok(())
    }
}

/// An address that can be connected to: loopback where the socket listens on all addresses.
fn reachable(address: SocketAddr) -> SocketAddr {
    let ip = match address.ip() {
        IpAddr::V4(ip) if ip.is_unspecified() => IpAddr::V4(Ipv4Addr::LOCALHOST),
        IpAddr::V6(ip) if ip.is_unspecified() => IpAddr::V6(Ipv6Addr::LOCALHOST),
        ip => ip,
    };
    SocketAddr::new(ip, address.port())
}
