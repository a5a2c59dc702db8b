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

use crate::http::admin::AdminPort;
use crate::http::page::PageSetting;
use crate::http::site::{Site, WebTransportOffer};
use crate::lifecycle::settings_watch::SettingsReload;
use crate::lifecycle::shutdown::{Signals, StopRequests};
use crate::session::admission_settings::AdmissionSettings;
use crate::session::scene_watch::SceneProvider;
use crate::session::scenes::Scenes;
use crate::session::settings::SessionSettings;
use crate::session::state::ServerState;
use crate::transport::advertised_addresses::advertised_addresses;
use crate::transport::certificate::Certificate;
use crate::transport::development_certificate::{DevelopmentCertificate, keep_valid};
use crate::transport::listen::listen_tcp;
use crate::transport::live_certificate::LiveCertificate;
use crate::transport::quic_scenes::{QuicConfig, watch_alpns};
use crate::transport::tls::Tls;

/// Time beyond [`SessionSettings::drain`] in which sessions may close.
const CLOSE_GRACE: Duration = Duration::from_secs(2);

/// Most scenes whose addresses are printed.
const MAX_LISTED_SCENES: usize = 16;

/// Settings of a daemon: addresses, certificate, limits.
#[derive(Clone)]
pub struct DaemonOptions {
    /// UDP address of the QUIC listener; port 0 for any. `None`: no QUIC.
    pub listen: Option<SocketAddr>,
    /// TCP address of the HTTP and WebSocket listener; port 0 for any. `None`: neither.
    pub http: Option<SocketAddr>,
    /// Whether that listener speaks TLS, with the certificate of QUIC.
    pub http_tls: bool,
    /// Address of the administration port: `/health`, `/ready`, `/metrics` and `/scenes`.
    pub admin: AdminPort,
    /// Folder in which the development certificate is kept.
    pub state_folder: PathBuf,
    /// The page for browsers, on the HTTP port.
    pub page: PageSetting,
    /// PEM files of a certificate chain and its private key, in place of the development certificate. They are read
    /// again when they change; new connections get the new certificate.
    pub certificate: Option<(PathBuf, PathBuf)>,
    /// Limits of the sessions.
    pub sessions: SessionSettings,
    /// Web pages, proxies and tokens that are accepted.
    pub admission: AdmissionSettings,
    /// Reads the settings again at SIGHUP, for [`ServerState::update_settings`].
    pub settings_reload: Option<SettingsReload>,
    /// Source of scenes while the server runs; `None` if they never change.
    pub provider: Option<Arc<dyn SceneProvider>>,
    /// Counter of dropped log lines, if the log can drop lines.
    pub dropped_log_lines: Option<ErrorCounter>,
}

impl DaemonOptions {
    /// The standard ports on loopback, no administration port, no limits, the development certificate in `state_folder`.
    #[must_use]
    pub fn new(state_folder: impl Into<PathBuf>) -> Self {
        Self {
            listen: Some(SocketAddr::from((Ipv4Addr::LOCALHOST, 4433))),
            http: Some(SocketAddr::from((Ipv4Addr::LOCALHOST, 8080))),
            http_tls: false,
            admin: AdminPort::Off,
            state_folder: state_folder.into(),
            page: PageSetting::Off,
            certificate: None,
            sessions: SessionSettings::default(),
            admission: AdmissionSettings::default(),
            settings_reload: None,
            provider: None,
            dropped_log_lines: None,
        }
    }
}

/// Runs the daemon until SIGINT or SIGTERM, then drains. Prints the viewers' URLs, that of the page for browsers and that
/// of the metrics to standard output, one per line. A second signal ends the daemon at once.
///
/// # Errors
/// An address cannot be bound, the certificate cannot be read or written, or a second signal arrived.
pub async fn run(options: DaemonOptions, scenes: impl Into<Scenes>) -> anyhow::Result<()> {
    // Before the URLs are printed: a reader of them may send a signal at once.
    let mut signals = Signals::listen()?;
    let daemon = Daemon::bind(options, scenes).await?;
    signals.on_hangup(daemon.reloads.clone());
    let urls = daemon.urls().into_iter().chain(daemon.page_urls()).chain(daemon.metrics_urls());
    for url in urls {
        // Standard output may be closed.
        let _ = writeln!(std::io::stdout(), "{url}");
    }
    if let Some(absence) = daemon.state.site().page.absence() {
        tracing::info!("{absence}");
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

/// A daemon with bound sockets.
pub struct Daemon {
    state: Arc<ServerState>,
    quic: Option<(quinn::Endpoint, SocketAddr, QuicConfig)>,
    http: Option<(TcpListener, SocketAddr)>,
    tls: Option<Tls>,
    admin: Option<(TcpListener, SocketAddr)>,
    /// Fragment of the viewers' URLs that pins the certificate.
    pin: String,
    certificate_files: Option<crate::transport::live_certificate::CertificateFiles>,
    development: Option<(DevelopmentCertificate, Arc<LiveCertificate>)>,
    provider: Option<Arc<dyn SceneProvider>>,
    settings_reload: Option<SettingsReload>,
    reloads: watch::Sender<u64>,
}

impl Daemon {
    /// Binds the sockets. Must be called on a tokio runtime.
    ///
    /// # Errors
    /// An address cannot be bound, or the certificate cannot be read or written.
    pub async fn bind(options: DaemonOptions, scenes: impl Into<Scenes>) -> anyhow::Result<Self> {
        let state = ServerState::with_admission(scenes, options.sessions, options.admission);
        if let Some(dropped) = options.dropped_log_lines {
            state.metrics().watch_log(dropped);
        }
        let (mut quic, mut tls, mut certificate_files, mut pin) = (None, None, None, String::new());
        let (mut renewal, mut certificate_hashes) = (None, Vec::new());
        if options.listen.is_some() || (options.http.is_some() && options.http_tls) {
            let (mut from_files, mut development) = (None, None);
            let certificate = match &options.certificate {
                Some((chain, key)) => from_files.insert(Certificate::from_pem_files(chain, key)?),
                None => {
                    let own =
                        DevelopmentCertificate::load_or_create(&options.state_folder, SystemTime::now())?;
                    certificate_hashes = own.hashes();
                    development.insert(own).current()
                }
            };
            // Certificates are renewed, usually for the same key: pin the key.
            pin = certificate.key_pin();
            state.metrics().certificate_in_use(certificate.not_after());
            let live = LiveCertificate::new(certificate)?;
            renewal = development.map(|own| (own, Arc::clone(&live)));
            if let Some(address) = options.listen {
                let settings = QuicConfig::new(Arc::clone(&live))?;
                let endpoint = quinn::Endpoint::new(
                    quinn::EndpointConfig::default(),
                    Some(settings.server_config(state.scenes())?),
                    crate::transport::quic::bind_udp(address)?,
                    Arc::new(quinn::TokioRuntime),
                )?;
                let address = endpoint.local_addr()?;
                quic = Some((endpoint, address, settings));
            }
            if options.http_tls {
                tls = Some(Tls::new(Arc::clone(&live) as Arc<dyn ResolvesServerCert>)?);
            }
            certificate_files = options.certificate.map(|(chain, key)| {
                crate::transport::live_certificate::CertificateFiles { live, chain, key }
            });
        }
        let addressed = |listener: TcpListener| listener.local_addr().map(|address| (listener, address));
        let http = options.http.map(listen_tcp).transpose()?.map(addressed).transpose()?;
        let http_port = http.as_ref().map(|(_, address)| address.port());
        let site = Site::new(options.page, http_port);
        if let Some((_, address, _)) = &quic {
            site.offer_webtransport(WebTransportOffer { port: address.port(), certificate_hashes });
        }
        state.set_site(site);
        let admin = options.admin.listen()?.map(addressed).transpose()?;
        let (provider, settings_reload, reloads) =
            (options.provider, options.settings_reload, watch::Sender::new(0));
        Ok(Self {
            state,
            quic,
            http,
            tls,
            admin,
            pin,
            certificate_files,
            development: renewal,
            provider,
            settings_reload,
            reloads,
        })
    }

    /// URLs for viewers: `quic://HOST:PORT#PIN`, and `wss://HOST:PORT/#PIN` or, without TLS, `ws://HOST:PORT/`.
    ///
    /// With several scenes, there is one URL with the path `/NAME` for each of the first 16. The pin is `spki-sha256=`
    /// with the fingerprint of the certificate's key, which a renewed certificate keeps: 64 lowercase hexadecimal
    /// digits. A socket bound to all addresses is listed under each
    /// address from which this machine reaches other networks, IPv6 and IPv4.
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

    /// URLs of the page for browsers, if there is one.
    #[must_use]
    pub fn page_urls(&self) -> Vec<String> {
        let scheme = if self.tls.is_some() { "https" } else { "http" };
        let addresses = self.http_address().filter(|_| self.state.site().has_page()).into_iter();
        addresses.flat_map(advertised_addresses).map(|address| format!("{scheme}://{address}/")).collect()
    }

    /// URLs of the metrics on the administration port.
    pub(crate) fn metrics_urls(&self) -> Vec<String> {
        let addresses = self.admin_address().into_iter().flat_map(advertised_addresses);
        addresses.map(|address| format!("http://{address}/metrics")).collect()
    }

    /// A warning if a public address admits clients without a token, or accepts tokens without encryption.
    pub(crate) fn exposure_warning(&self) -> Option<String> {
        let public = |address: &SocketAddr| !address.ip().to_canonical().is_loopback();
        let http = self.http_address().filter(public);
        let address = self.quic_address().filter(public).or(http)?;
        if self.state.admission().access.is_none() {
            return Some(format!(
                "{address} accepts other machines without a token: anyone who reaches it may see the scene \
                 (--token-keys FILE requires tokens, --access-command and --access-url let your own program decide)"
            ));
        }
        http.filter(|_| self.tls.is_none()).map(|address| {
            format!(
                "tokens sent to {address} are not encrypted: use --http-tls, or a TLS proxy on this machine"
            )
        })
    }

    /// Returns a function that reloads files, settings and scenes, as SIGHUP does.
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

    /// Address of the administration port.
    #[must_use]
    pub fn admin_address(&self) -> Option<SocketAddr> {
        self.admin.as_ref().map(|(_, address)| *address)
    }

    /// State that the sessions share.
    #[must_use]
    pub const fn state(&self) -> &Arc<ServerState> {
        &self.state
    }

    /// Serves until the first stop request, then drains. A second request ends the daemon at once.
    ///
    /// # Errors
    /// A listener failed, or a second request came before all sessions had ended.
    pub async fn serve(self, mut stop: impl StopRequests) -> anyhow::Result<()> {
        let Self {
            state,
            quic,
            http,
            tls,
            admin,
            pin: _,
            certificate_files,
            development,
            provider,
            settings_reload,
            reloads,
        } = self;
        let mut listeners = tokio::task::JoinSet::new();
        // Aborted when this returns.
        let mut watchers = tokio::task::JoinSet::new();
        if let Some(files) = certificate_files {
            watchers.spawn(crate::transport::live_certificate::watch_certificate(
                files,
                Arc::clone(&state),
                reloads.subscribe(),
            ));
        }
        if let Some((certificate, live)) = development {
            watchers.spawn(keep_valid(certificate, live, Arc::clone(&state)));
        }
        if let Some(read) = settings_reload {
            watchers.spawn(crate::lifecycle::settings_watch::watch_settings(
                read,
                Arc::clone(&state),
                reloads.subscribe(),
            ));
        }
        if let Some(provider) = provider {
            watchers.spawn(crate::session::scene_watch::watch_scenes(
                provider,
                Arc::clone(&state),
                reloads.subscribe(),
            ));
        }
        if let Some(access) = &state.admission().access {
            watchers.spawn(Arc::clone(access).watch_files(reloads.subscribe()));
        }
        if let Some((endpoint, _, settings)) = quic {
            watchers.spawn(watch_alpns(settings, endpoint.clone(), Arc::clone(&state)));
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
            // Listeners end only after `state.stop()`, or by a fault.
            Some(ended) = listeners.join_next() => {
                state.stop();
                return Err(ended.err().map_or_else(|| anyhow!("it ended unexpectedly"), Into::into))
                    .context("a listener failed; restart the server");
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
