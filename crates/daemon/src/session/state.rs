//! State that all sessions of a daemon share.

use std::net::SocketAddr;
use std::sync::atomic::AtomicU64;
use std::sync::{Arc, OnceLock, PoisonError, RwLock, RwLockReadGuard};

use lodestream_protocol::Time;
use lodestream_protocol::server::ServerConfig;
use lodestream_protocol::shared_rate_limit::SharedRateLimit;
use lodestream_protocol::source::{SceneSource, SourceError};
use tokio::sync::watch;
use tokio::time::Instant;

use crate::auth::grant::{Grant, TokenError};
use crate::http::site::Site;
use crate::limits::leases::Leases;
use crate::limits::pre_auth_pool::{PreAuthPool, PreAuthSlot};
use crate::limits::session_rate::SessionRateLimiter;
use crate::metrics::{Metrics, Rates, Transport};
use crate::session::admission_settings::AdmissionSettings;
use crate::session::scenes::Scenes;
use crate::session::settings::SessionSettings;
use crate::session::unreadable_blobs::UnreadableBlobs;

/// Size of the pre-auth pool of sessions, whose address or `Hello` is awaited. Hundreds of clients may connect at once; a
/// slot costs the memory of a new session.
const MAX_PRE_AUTH_SESSIONS: usize = 512;
/// Size of the pre-auth pool of HTTP connections, whose request is awaited or answered.
const MAX_REQUESTS: usize = 256;

/// Phase of a daemon's life.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Phase {
    /// Clients are admitted.
    Running,
    /// No client is admitted; sessions finish their requests.
    Draining,
    /// Everything ends.
    Stopped,
}

/// Settings that a reload replaces, and values derived from them.
pub(super) struct Live {
    settings: SessionSettings,
    admission: Arc<AdmissionSettings>,
    quic: Arc<ServerConfig>,
    websocket: Arc<ServerConfig>,
    pub(super) shared_rate_limit: Option<Arc<SharedRateLimit>>,
}

impl Live {
    fn new(settings: SessionSettings, admission: AdmissionSettings) -> Self {
        let rate = settings.rate_bits_per_s;
        Self {
            settings,
            admission: Arc::new(admission),
            quic: Arc::new(ServerConfig::quic(rate)),
            websocket: Arc::new(ServerConfig::websocket(rate)),
            shared_rate_limit: settings.shared_rate_limit(),
        }
    }
}

/// Scenes, settings, limits and counters of a daemon, shared by all connections.
pub struct ServerState {
    scenes: Scenes,
    live: RwLock<Live>,
    pub(super) metrics: Metrics,
    phase: watch::Sender<Phase>,
    pub(super) sessions: watch::Sender<u64>,
    pub(super) next_session: AtomicU64,
    pub(super) leases: Arc<Leases>,
    pub(super) session_rate: SessionRateLimiter,
    pre_auth: Arc<PreAuthPool>,
    requests: Arc<PreAuthPool>,
    unreadable: UnreadableBlobs,
    pub(super) started: Instant,
    site: OnceLock<Site>,
}

impl std::fmt::Debug for ServerState {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("ServerState")
            .field("scenes", &self.scenes)
            .field("settings", &self.settings())
            .field("phase", &self.phase())
            .finish_non_exhaustive()
    }
}

impl ServerState {
    /// The state of a daemon that serves one scene to any client.
    #[must_use]
    pub fn new(scene: Arc<dyn SceneSource>, settings: SessionSettings) -> Arc<Self> {
        Self::with_admission(scene, settings, AdmissionSettings::default())
    }

    /// The state of a daemon that serves `scenes` to the clients that `admission` accepts.
    #[must_use]
    pub fn with_admission(
        scenes: impl Into<Scenes>,
        settings: SessionSettings,
        admission: AdmissionSettings,
    ) -> Arc<Self> {
        let (max_per_address, session_rate) = settings.address_limits();
        Arc::new(Self {
            scenes: scenes.into(),
            live: RwLock::new(Live::new(settings, admission)),
            metrics: Metrics::default(),
            phase: watch::Sender::new(Phase::Running),
            sessions: watch::Sender::new(0),
            next_session: AtomicU64::new(1),
            leases: Leases::new(settings.max_sessions, max_per_address),
            session_rate: SessionRateLimiter::new(session_rate),
            pre_auth: PreAuthPool::new(MAX_PRE_AUTH_SESSIONS),
            requests: PreAuthPool::new(MAX_REQUESTS),
            unreadable: UnreadableBlobs::default(),
            started: Instant::now(),
            site: OnceLock::new(),
        })
    }

    /// The scenes.
    #[must_use]
    pub const fn scenes(&self) -> &Scenes {
        &self.scenes
    }

    // A thread that panics with the lock leaves the old values or the new ones.
    pub(super) fn live(&self) -> RwLockReadGuard<'_, Live> {
        self.live.read().unwrap_or_else(PoisonError::into_inner)
    }

    /// The settings.
    #[must_use]
    pub fn settings(&self) -> SessionSettings {
        self.live().settings
    }

    /// The settings of admission.
    pub(crate) fn admission(&self) -> Arc<AdmissionSettings> {
        Arc::clone(&self.live().admission)
    }

    /// Replaces the settings. New sessions use all of them, running sessions only the shared rate limits, and only if
    /// there were some before. [`AdmissionSettings::access`] is not replaced.
    pub fn update_settings(&self, settings: SessionSettings, admission: AdmissionSettings) {
        let (max_per_address, session_rate) = settings.address_limits();
        self.leases.set(settings.max_sessions, max_per_address);
        self.session_rate.set(session_rate);
        let mut live = self.live.write().unwrap_or_else(PoisonError::into_inner);
        let admission = AdmissionSettings { access: live.admission.access.clone(), ..admission };
        let shared = live.shared_rate_limit.take();
        *live = Live::new(settings, admission);
        if let Some(shared) = shared {
            shared.set_limits(settings.limits(), self.now());
            live.shared_rate_limit = Some(shared);
        }
    }

    /// The counters.
    #[must_use]
    pub const fn metrics(&self) -> &Metrics {
        &self.metrics
    }

    /// The counters in Prometheus' text format.
    #[must_use]
    pub fn render_metrics(&self) -> String {
        let draining = self.phase() != Phase::Running;
        let (settings, shared_rate_limit) = (self.settings(), self.live().shared_rate_limit.clone());
        let rates = Rates {
            per_session_bits_per_s: settings.rate_bits_per_s,
            per_address_bits_per_s: settings.rate_per_address_bits_per_s,
            total_bits_per_s: settings.total_rate_bits_per_s,
            assigned_bits_per_s: shared_rate_limit
                .map_or(0, |shared_rate_limit| shared_rate_limit.allocated_bits_per_s(self.now())),
        };
        self.metrics.render(rates, draining, self.scenes.cache_use())
    }

    /// The protocol's settings for a session over `transport`.
    pub(crate) fn config(&self, transport: Transport) -> Arc<ServerConfig> {
        let live = self.live();
        Arc::clone(match transport {
            Transport::Quic => &live.quic,
            Transport::WebSocket => &live.websocket,
        })
    }

    /// The same for a session whose token grants a rate.
    pub(crate) fn config_for_rate(
        &self,
        transport: Transport,
        granted_bits_per_s: Option<u64>,
    ) -> Arc<ServerConfig> {
        let settings = self.settings();
        let rate = settings.capped_rate(granted_bits_per_s);
        if rate == settings.rate_bits_per_s {
            return self.config(transport);
        }
        Arc::new(match transport {
            Transport::Quic => ServerConfig::quic(rate),
            Transport::WebSocket => ServerConfig::websocket(rate),
        })
    }

    /// The page for browsers; none until [`ServerState::set_site`].
    pub(crate) fn site(&self) -> &Site {
        self.site.get_or_init(Site::default)
    }

    /// Sets the page, before anything asks for it.
    pub(crate) fn set_site(&self, site: Site) {
        let _ = self.site.set(site);
    }

    /// The current phase.
    #[must_use]
    pub fn phase(&self) -> Phase {
        *self.phase.borrow()
    }

    /// Starts to drain: new clients are refused, and sessions end when their requests are served, at the latest after
    /// [`SessionSettings::drain`].
    pub fn drain(&self) {
        self.advance(Phase::Draining);
    }

    /// Ends everything.
    pub fn stop(&self) {
        self.advance(Phase::Stopped);
    }

    fn advance(&self, to: Phase) {
        self.phase.send_if_modified(|phase| {
            let later = to > *phase;
            *phase = to.max(*phase);
            later
        });
    }

    /// Waits until the daemon reaches `phase` or a later one.
    pub async fn wait_for_phase(&self, phase: Phase) {
        // Fails only without a sender; `self` holds it.
        let _ = self.phase.subscribe().wait_for(|now| *now >= phase).await;
    }

    /// Waits until no session is open.
    pub async fn all_sessions_ended(&self) {
        let _ = self.sessions.subscribe().wait_for(|open| *open == 0).await;
    }

    /// Takes a pre-auth slot for a session.
    pub(crate) fn enter_pre_auth(&self, peer: SocketAddr) -> PreAuthSlot {
        self.pre_auth.enter(peer.ip())
    }

    /// Takes a pre-auth slot for an HTTP connection.
    pub(crate) fn enter_request(&self, peer: SocketAddr) -> PreAuthSlot {
        self.requests.enter(peer.ip())
    }

    /// Verifies a token, for one scene if `scene` is given; counts refusals.
    pub(crate) async fn verify_token(
        self: Arc<Self>,
        token: String,
        scene: Option<String>,
        peer: SocketAddr,
    ) -> Result<Grant, TokenError> {
        let access = self.admission().access.clone().ok_or(TokenError::Unavailable)?;
        let grant = access.verify(token, scene, peer.ip()).await;
        grant.map_err(|why| self.token_refused(why))
    }

    /// Verifies a later token of a session, with retries: the session continues under its current grant meanwhile.
    pub(crate) async fn verify_next_token(
        self: Arc<Self>,
        token: String,
        scene: String,
        peer: SocketAddr,
    ) -> Result<Grant, TokenError> {
        let access = self.admission().access.clone().ok_or(TokenError::Unavailable)?;
        let grant = access.verify_with_retries(token, scene, peer.ip()).await;
        grant.map_err(|why| self.token_refused(why))
    }

    /// Counts a session that is refused or ended because of its token.
    pub(crate) fn token_refused(&self, why: TokenError) -> TokenError {
        match why {
            TokenError::Unavailable => self.metrics.access_unavailable(),
            _ => self.metrics.token_refused(),
        }
        why
    }

    /// Counts and logs a failed read of a blob.
    pub(crate) fn read_failed(&self, error: &SourceError) {
        if self.unreadable.note(error) {
            self.metrics.blob_unreadable();
        }
    }

    /// Number of entries in the tables that sessions write into.
    #[cfg(test)]
    pub(crate) fn entries(&self) -> [usize; 4] {
        [self.leases.len(), self.session_rate.len(), self.pre_auth.len(), self.requests.len()]
    }

    pub(super) fn now(&self) -> Time {
        Time::from(self.started.elapsed())
    }
}
