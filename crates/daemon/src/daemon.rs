//! The whole daemon: opens its sockets, serves, reloads and drains.

use std::io::Write as _;
use std::net::{Ipv4Addr, SocketAddr};
use std::path::PathBuf;
use std::sync::Arc;
use std::time::{Duration, SystemTime};

use anyhow::{Context, anyhow, bail};
use lodestream_protocol::stream::path_of_scene;
use rustls::server::ResolvesServerCert;
use tokio::net::TcpListener;
use tokio::sync::watch;
use tokio::time::timeout;
use tracing_appender::non_blocking::ErrorCounter;

use crate::admission::settings::AdmissionSettings;
use crate::http::admin::AdminPort;
use crate::lifecycle::settings_watch::SettingsReload;
use crate::lifecycle::shutdown::{Signals, StopRequests};
use crate::session::scene_watch::SceneProvider;
use crate::session::scenes::Scenes;
use crate::session::settings::SessionSettings;
use crate::session::state::ServerState;
use crate::transport::advertised_addresses::advertised_addresses;
use crate::transport::certificate::Certificate;
use crate::transport::listen::listen_tcp;
use crate::transport::live_certificate::LiveCertificate;
use crate::transport::quic_scenes::{QuicConfig, watch_alpns};
use crate::transport::tls::Tls;

/// Time for sessions' last words beyond [`SessionSettings::drain`].
const CLOSE_GRACE: Duration = Duration::from_secs(2);

/// Scenes whose addresses are printed.
const MAX_LISTED_SCENES: usize = 16;

/// What the daemon does and where.
#[derive(Clone)]
pub struct DaemonOptions {
    /// UDP address of the QUIC listener; port 0 for any. `None`: no QUIC.
    pub listen: Option<SocketAddr>,
    /// TCP address of the HTTP and WebSocket listener; port 0 for any. `None`: neither.
    pub http: Option<SocketAddr>,
    /// Whether that listener speaks TLS, with the certificate of QUIC.
    pub http_tls: bool,
    /// Where `/health`, `/ready` and `/metrics` are for who runs the server.
    pub admin: AdminPort,
    /// Folder in which the development certificate is kept.
    pub state_folder: PathBuf,
    /// PEM files of a certificate chain and its private key, in place of the development certificate. When they change,
    /// new connections get what is in them.
    pub certificate: Option<(PathBuf, PathBuf)>,
    /// Limits of the sessions.
    pub sessions: SessionSettings,
    /// Who may open sessions over HTTP.
    pub admission: AdmissionSettings,
    /// Reads anew, at SIGHUP, what [`ServerState::change`] takes.
    pub settings_reload: Option<SettingsReload>,
    /// Where scenes are looked for again while the server runs.
    pub provider: Option<Arc<dyn SceneProvider>>,
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
            http_tls: false,
            admin: AdminPort::Off,
            state_folder: state_folder.into(),
            certificate: None,
            sessions: SessionSettings::default(),
            admission: AdmissionSettings::default(),
            settings_reload: None,
            provider: None,
            dropped_log_lines: None,
        }
    }
}

/// Runs the daemon until SIGINT or SIGTERM: prints the viewer URLs, one a line, and that of the metrics, serves, and
/// drains when asked to end. A second signal ends it at once.
///
/// # Errors
/// Fails where an address or the certificate cannot be had, or where a second signal came.
pub async fn run(options: DaemonOptions, scenes: impl Into<Scenes>) -> anyhow::Result<()> {
    // Before the URLs are out: whoever reads them may ask to end at once.
    let mut signals = Signals::listen()?;
    let daemon = Daemon::bind(options, scenes).await?;
    signals.on_hangup(daemon.reloads.clone());
    for url in daemon.urls().into_iter().chain(daemon.metrics_urls()) {
        // Whoever wants none may have closed it.
        let _ = writeln!(std::io::stdout(), "{url}");
    }
    if let Some(warning) = daemon.exposure_warning() {
        tracing::warn!("{warning}");
    }
    daemon.serve(signals).await
}

impl std::fmt::Debug for Daemon {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Daemon")
            .field("state", &self.state)
            .field("urls", &self.urls())
            .finish_non_exhaustive()
    }
}

/// A daemon whose sockets are open.
pub struct Daemon {
    state: Arc<ServerState>,
    quic: Option<(quinn::Endpoint, SocketAddr, QuicConfig)>,
    http: Option<(TcpListener, SocketAddr)>,
    tls: Option<Tls>,
    admin: Option<(TcpListener, SocketAddr)>,
    /// What viewers' addresses say of the certificate.
    pin: String,
    renewed: Option<crate::transport::live_certificate::CertificateFiles>,
    provider: Option<Arc<dyn SceneProvider>>,
    settings_reload: Option<SettingsReload>,
    reloads: watch::Sender<u64>,
}

impl Daemon {
    /// Opens the sockets. Must be called on a tokio runtime.
    ///
    /// # Errors
    /// Fails where an address or the certificate cannot be had.
    pub async fn bind(options: DaemonOptions, scenes: impl Into<Scenes>) -> anyhow::Result<Self> {
        let state = ServerState::with_admission(scenes, options.sessions, options.admission);
        if let Some(dropped) = options.dropped_log_lines {
            state.metrics().watch_log(dropped);
        }
        let (mut quic, mut tls, mut renewed, mut pin) = (None, None, None, String::new());
        if options.listen.is_some() || (options.http.is_some() && options.http_tls) {
            let certificate = match &options.certificate {
                Some((chain, key)) => Certificate::from_pem_files(chain, key)?,
                None => Certificate::load_or_create(&options.state_folder, SystemTime::now())?,
            };
            // Who has a certificate made renews it, perhaps for the same key.
            pin = if options.certificate.is_some() { certificate.key_pin() } else { certificate.pin() };
            state.metrics().certificate_in_use(certificate.not_after());
            let live = LiveCertificate::new(&certificate)?;
            if let Some(address) = options.listen {
                let settings = QuicConfig::new(Arc::clone(&live))?;
                let endpoint = quinn::Endpoint::new(
                    quinn::EndpointConfig::default(),
                    Some(settings.naming(state.scenes())?),
                    crate::transport::quic::bind_udp(address)?,
                    Arc::new(quinn::TokioRuntime),
                )?;
                let address = endpoint.local_addr()?;
                quic = Some((endpoint, address, settings));
            }
            if options.http_tls {
                tls = Some(Tls::new(Arc::clone(&live) as Arc<dyn ResolvesServerCert>)?);
            }
            renewed = options.certificate.map(|(chain, key)| {
                crate::transport::live_certificate::CertificateFiles { live, chain, key }
            });
        }
        let addressed = |listener: TcpListener| listener.local_addr().map(|address| (listener, address));
        let http = options.http.map(listen_tcp).transpose()?.map(addressed).transpose()?;
        let admin = options.admin.listen()?.map(addressed).transpose()?;
        let (provider, settings_reload, reloads) =
            (options.provider, options.settings_reload, watch::Sender::new(0));
        Ok(Self { state, quic, http, tls, admin, pin, renewed, provider, settings_reload, reloads })
    }

    /// Addresses for viewers: `quic://HOST:PORT#PIN`, and `wss://HOST:PORT/#PIN` or, without TLS, `ws://HOST:PORT/`; of
    /// several scenes for each, with `/NAME`, or for the first of them where there are more than anybody reads. The
    /// pin is `sha256=` and the fingerprint of the certificate, or `spki-sha256=` and that of its key where it is one's
    /// own: 64 lowercase hexadecimal digits. Where a socket listens on all addresses, there is one for each by which this
    /// machine reaches others, of IPv6 and of IPv4.
    #[must_use]
    pub fn urls(&self) -> Vec<String> {
        let pin = &self.pin;
        let table = self.state.scenes().table();
        let names: Vec<&str> = table.names().take(MAX_LISTED_SCENES).collect();
        let paths = match names[..] {
            [_] => vec![String::new()],
            _ => names.into_iter().map(path_of_scene).collect(),
        };
        let quic = self.quic_address().into_iter().flat_map(advertised_addresses);
        let quic =
            quic.flat_map(|address| paths.iter().map(move |path| format!("quic://{address}{path}#{pin}")));
        let websocket = self.http_address().into_iter().flat_map(advertised_addresses).flat_map(|address| {
            paths.iter().map(move |path| {
                let path = path.strip_prefix('/').unwrap_or(path);
                match &self.tls {
                    Some(_) => format!("wss://{address}/{path}#{pin}"),
                    None => format!("ws://{address}/{path}"),
                }
            })
        });
        quic.chain(websocket).collect()
    }

    /// Where the metrics are, for who runs the server.
    pub(crate) fn metrics_urls(&self) -> Vec<String> {
        let addresses = self.admin_address().into_iter().flat_map(advertised_addresses);
        addresses.map(|address| format!("http://{address}/metrics")).collect()
    }

    /// Where others may come in who should perhaps not.
    pub(crate) fn exposure_warning(&self) -> Option<String> {
        let public = |address: &SocketAddr| !address.ip().to_canonical().is_loopback();
        let http = self.http_address().filter(public);
        let address = self.quic_address().filter(public).or(http)?;
        if self.state.admission().access.is_none() {
            return Some(format!(
                "{address} is for other machines too, and nobody is asked for a token: whoever reaches it may see the \
                 scene (--token-keys FILE asks for tokens, --access-command and --access-url let your own program decide)"
            ));
        }
        http.filter(|_| self.tls.is_none()).map(|address| {
            format!("tokens that come to {address} can be read on the way: --http-tls, or a proxy with TLS on this machine")
        })
    }

    /// Has files read now, as SIGHUP does.
    pub fn reload(&self) -> impl Fn() + Send + Sync + 'static {
        let reloads = self.reloads.clone();
        move || reloads.send_modify(|count| *count = count.wrapping_add(1))
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
        let Self { state, quic, http, tls, admin, pin: _, renewed, provider, settings_reload, reloads } =
            self;
        let mut listeners = tokio::task::JoinSet::new();
        // Ends with this.
        let mut renewals = tokio::task::JoinSet::new();
        if let Some(files) = renewed {
            renewals.spawn(crate::transport::live_certificate::watch_certificate(
                files,
                Arc::clone(&state),
                reloads.subscribe(),
            ));
        }
        if let Some(read) = settings_reload {
            renewals.spawn(crate::lifecycle::settings_watch::watch_settings(
                read,
                Arc::clone(&state),
                reloads.subscribe(),
            ));
        }
        if let Some(provider) = provider {
            renewals.spawn(crate::session::scene_watch::watch_scenes(
                provider,
                Arc::clone(&state),
                reloads.subscribe(),
            ));
        }
        if let Some(access) = &state.admission().access {
            renewals.spawn(Arc::clone(access).watch_files(reloads.subscribe()));
        }
        if let Some((endpoint, _, settings)) = quic {
            renewals.spawn(watch_alpns(settings, endpoint.clone(), Arc::clone(&state)));
            listeners.spawn(crate::transport::quic::serve_quic(endpoint, state.clone()));
        }
        if let Some((listener, _)) = http {
            listeners.spawn(crate::http::server::serve_http(listener, state.clone(), tls));
        }
        if let Some((listener, _)) = admin {
            listeners.spawn(crate::http::admin::serve_admin(listener, state.clone()));
        }
        tracing::info!(
            scenes = state.scenes().table().names().count(),
            rate_bits_per_s = state.settings().rate_bits_per_s,
            rate_per_address_bits_per_s = state.settings().rate_per_address_bits_per_s,
            total_rate_bits_per_s = state.settings().total_rate_bits_per_s,
            "serving"
        );
        crate::lifecycle::notify::listening();
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
        let at_most = state.settings().drain + CLOSE_GRACE;
        crate::lifecycle::notify::draining(at_most);
        let drained = async {
            if timeout(at_most, state.all_sessions_ended()).await.is_err() {
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
