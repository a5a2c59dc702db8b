//! A daemon in this process, on its own thread and ports.

use std::io::{Read as _, Write as _};
use std::net::{Ipv4Addr, SocketAddr, TcpStream};
use std::sync::atomic::{AtomicU32, Ordering};
use std::sync::{Arc, Mutex, OnceLock, PoisonError};
use std::time::{Duration, Instant};

use lodestream_client::net::Address;
use lodestream_daemon::{Daemon, DaemonOptions, ServerState, SessionSettings};
use lodestream_protocol::source::SceneSource;
use tokio::sync::mpsc;
use tokio::task::JoinHandle;

use super::LIMIT;

/// Transport between client and daemon.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Transport {
    Quic,
    WebSocket,
}

impl Transport {
    pub(crate) const BOTH: [Self; 2] = [Self::Quic, Self::WebSocket];
}

/// Names of threads that panicked. A panic in a task only writes a line to standard error, so tests check this list.
fn panicked_threads() -> &'static Mutex<Vec<String>> {
    static PANICKED: OnceLock<Mutex<Vec<String>>> = OnceLock::new();
    PANICKED.get_or_init(|| {
        let before = std::panic::take_hook();
        std::panic::set_hook(Box::new(move |info| {
            let name = std::thread::current().name().unwrap_or("").to_owned();
            panicked_threads().lock().unwrap_or_else(PoisonError::into_inner).push(name);
            before(info);
        }));
        Mutex::default()
    })
}

/// State folder (with the certificate) and ports of a daemon, for a successor in the same place.
pub(crate) struct Site {
    folder: Arc<tempfile::TempDir>,
    quic: SocketAddr,
    http: SocketAddr,
}

/// A running daemon.
pub(crate) struct Server {
    runtime: Option<tokio::runtime::Runtime>,
    serving: Option<JoinHandle<anyhow::Result<()>>>,
    stop: mpsc::Sender<()>,
    threads: String,
    folder: Arc<tempfile::TempDir>,
    quic: SocketAddr,
    http: SocketAddr,
    urls: Vec<String>,
    /// Whether the HTTP port speaks TLS.
    tls: bool,
    reload: Box<dyn Fn() + Send + Sync>,
    state: Arc<ServerState>,
}

impl Server {
    /// Starts a daemon on any free ports of the loopback address.
    pub(crate) fn start(scene: Arc<dyn SceneSource>, sessions: SessionSettings) -> Self {
        Self::start_with(scene, sessions, |_| {})
    }

    /// Starts a daemon with more options.
    pub(crate) fn start_with(
        scene: Arc<dyn SceneSource>,
        sessions: SessionSettings,
        set: impl FnOnce(&mut DaemonOptions),
    ) -> Self {
        let any = SocketAddr::from((Ipv4Addr::LOCALHOST, 0));
        let site = Site { folder: Arc::new(tempfile::tempdir().unwrap()), quic: any, http: any };
        Self::start_of(site, scene, sessions, set)
    }

    /// Starts a daemon where another was, with the same certificate.
    pub(crate) fn start_at(site: Site, scene: Arc<dyn SceneSource>, sessions: SessionSettings) -> Self {
        Self::start_at_with(site, scene, sessions, |_| {})
    }

    /// The same with more options.
    pub(crate) fn start_at_with(
        site: Site,
        scene: Arc<dyn SceneSource>,
        sessions: SessionSettings,
        set: impl FnOnce(&mut DaemonOptions),
    ) -> Self {
        Self::start_of(site, scene, sessions, set)
    }

    /// The address of the page for browsers.
    pub(crate) fn page_url(&self) -> String {
        format!("http://{}/", self.http)
    }

    fn start_of(
        site: Site,
        scene: Arc<dyn SceneSource>,
        sessions: SessionSettings,
        set: impl FnOnce(&mut DaemonOptions),
    ) -> Self {
        static COUNT: AtomicU32 = AtomicU32::new(0);
        panicked_threads();
        let threads = format!("daemon-{}", COUNT.fetch_add(1, Ordering::Relaxed));
        let runtime = tokio::runtime::Builder::new_multi_thread()
            .worker_threads(1)
            .thread_name(&threads)
            .enable_all()
            .build()
            .unwrap();
        let mut options = DaemonOptions {
            listen: Some(site.quic),
            http: Some(site.http),
            sessions,
            ..DaemonOptions::new(site.folder.path())
        };
        set(&mut options);
        let tls = options.http_tls;
        let daemon = runtime.block_on(Daemon::bind(options, scene)).unwrap();
        let reload = Box::new(daemon.reload());
        let quic = daemon.quic_address().unwrap_or(site.quic);
        let http = daemon.http_address().unwrap();
        let (urls, state) = (daemon.urls(), daemon.state().clone());
        let (stop, stopped) = mpsc::channel(2);
        let serving = runtime.spawn(daemon.serve(stopped));
        let folder = site.folder;
        Self {
            runtime: Some(runtime),
            serving: Some(serving),
            stop,
            threads,
            folder,
            quic,
            http,
            urls,
            tls,
            reload,
            state,
        }
    }

    /// The address that the daemon prints for viewers.
    pub(crate) fn url(&self, transport: Transport) -> String {
        let scheme = match transport {
            Transport::Quic => "quic",
            Transport::WebSocket => "ws",
        };
        self.url_of(scheme)
    }

    /// The address with a given scheme: quic, ws or wss.
    pub(crate) fn url_of(&self, scheme: &str) -> String {
        let begins = format!("{scheme}://");
        self.urls.iter().find(|url| url.starts_with(&begins)).unwrap().clone()
    }

    pub(crate) fn address_of(&self, scheme: &str) -> Address {
        self.url_of(scheme).parse().unwrap()
    }

    /// Reloads the daemon's files, as SIGHUP does.
    pub(crate) fn reload(&self) {
        (self.reload)();
    }

    /// The address, as a viewer parses it.
    pub(crate) fn address(&self, transport: Transport) -> Address {
        self.url(transport).parse().unwrap()
    }

    pub(crate) fn quic_address(&self) -> SocketAddr {
        self.quic
    }

    pub(crate) fn http_address(&self) -> SocketAddr {
        self.http
    }

    /// Requests a path of the HTTP port; returns the whole answer.
    pub(crate) fn get(&self, path: &str) -> std::io::Result<String> {
        let mut stream = TcpStream::connect_timeout(&self.http, Duration::from_secs(10))?;
        stream.set_read_timeout(Some(Duration::from_secs(10)))?;
        write!(stream, "GET {path} HTTP/1.1\r\nHost: s\r\nConnection: close\r\n\r\n")?;
        let mut answer = String::new();
        stream.read_to_string(&mut answer)?;
        Ok(answer)
    }

    /// The text of `/metrics`.
    pub(crate) fn metrics(&self) -> String {
        self.state.render_metrics()
    }

    /// Fails unless the daemon is up, answers `/health` with 200, and nothing in it has panicked.
    pub(crate) fn assert_healthy(&self) {
        // With TLS, `/health` is not requested; viewers check it.
        if !self.tls {
            let health = self.get("/health").unwrap();
            assert!(health.starts_with("HTTP/1.1 200"), "{health}");
        }
        assert!(!self.serving.as_ref().unwrap().is_finished(), "the daemon has ended");
        let panicked = panicked_threads().lock().unwrap_or_else(PoisonError::into_inner);
        assert!(!panicked.contains(&self.threads), "a task of the daemon has panicked");
    }

    /// Waits until the number of sessions is `sessions`.
    pub(crate) fn wait_for_sessions(&self, count: u64) {
        let until = Instant::now() + LIMIT;
        while self.state.metrics().active_sessions() != count {
            assert!(
                Instant::now() < until,
                "{} sessions, not {count}",
                self.state.metrics().active_sessions()
            );
            std::thread::sleep(Duration::from_millis(5));
        }
    }

    /// Shuts the daemon down and waits for it; returns its result and the time it took.
    pub(crate) fn stop(mut self) -> (anyhow::Result<()>, Duration) {
        let started = Instant::now();
        self.stop.try_send(()).unwrap();
        let serving = self.serving.take().unwrap();
        let runtime = self.runtime.as_ref().unwrap();
        let ended = runtime.block_on(async { tokio::time::timeout(LIMIT, serving).await });
        (ended.expect("the daemon does not end").unwrap(), started.elapsed())
    }

    /// Kills the daemon without closing connections.
    pub(crate) fn kill(mut self) -> Site {
        self.runtime.take().unwrap().shutdown_timeout(Duration::from_secs(10));
        Site { folder: self.folder.clone(), quic: self.quic, http: self.http }
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        if let Some(runtime) = self.runtime.take() {
            runtime.shutdown_background();
        }
    }
}
