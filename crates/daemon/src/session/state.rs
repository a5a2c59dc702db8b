//! What all sessions of a daemon share.

use std::net::SocketAddr;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, PoisonError, RwLock, RwLockReadGuard};
use std::time::Duration;

use lodestream_protocol::Time;
use lodestream_protocol::message::CloseCode;
use lodestream_protocol::server::ServerConfig;
use lodestream_protocol::shared_rate_limit::{Limits, RateShare, SharedRateLimit, Weight};
use lodestream_protocol::source::{SceneSource, SourceError};
use tokio::sync::watch;
use tokio::time::Instant;

use crate::admission::leases::{Lease, Leases, NoLease, default_of_address};
use crate::admission::pre_auth_pool::{AddressBlock, PreAuthPool, PreAuthSlot};
use crate::admission::session_rate::{SessionRateLimit, SessionRateLimiter};
use crate::admission::settings::AdmissionSettings;
use crate::auth::grant::{Grant, TokenError};
use crate::metrics::{Metrics, Rates, Transport};
use crate::session::damage::Damage;
use crate::session::scenes::{Scenes, Version};

/// Sessions that have not proved to be a client's: address and `Hello` are awaited. Hundreds of clients may connect at
/// once; one takes as much memory as a session at its beginning.
const MAX_UNPROVED: usize = 512;
/// HTTP connections without a session: requests that are awaited or answered.
const MAX_REQUESTS: usize = 256;

/// How long sessions may go on after shutdown has begun, by default, in seconds: what is under way on a thin link comes
/// to its end, and whoever stops a server by hand does not wait.
pub const DRAIN_SECONDS: u64 = 3;

/// Settings that all sessions share.
#[derive(Clone, Copy, Debug)]
pub struct SessionSettings {
    /// Limit of each session in bits per second; `None` for no limit.
    pub rate_bits_per_s: Option<u64>,
    /// Limit of all sessions together of one address (of IPv6: of one network of 64 bits) in bits per second, shared as
    /// [`lodestream_protocol::shared_rate_limit`] tells; `None` for no limit.
    pub rate_per_address_bits_per_s: Option<u64>,
    /// Limit of all sessions together in bits per second, shared likewise; `None` for no limit.
    pub total_rate_bits_per_s: Option<u64>,
    /// Most sessions at once, at least one; more are refused.
    pub max_sessions: u64,
    /// Most sessions at once of one address (of IPv6: of one network of 64 bits). `None`: an eighth of
    /// [`SessionSettings::max_sessions`], and at least eight.
    pub max_sessions_per_address: Option<u64>,
    /// Sessions that one such address may begin at once; an eighth of that is given back each second. `None`: as many as
    /// it may have, and at least 32.
    pub new_sessions_per_address: Option<SessionRateLimit>,
    /// How long sessions may go on with what they were asked for after shutdown has begun.
    pub drain: Duration,
}

impl SessionSettings {
    /// The rate of a session whose token says this of it.
    pub(crate) fn rate_at_most(&self, granted_bits_per_s: Option<u64>) -> Option<u64> {
        [self.rate_bits_per_s, granted_bits_per_s].into_iter().flatten().min()
    }

    /// Most sessions of one address, and how many it may begin.
    fn of_address(&self) -> (u64, SessionRateLimit) {
        let of_address = self.max_sessions_per_address.unwrap_or(default_of_address(self.max_sessions));
        (of_address, self.new_sessions_per_address.unwrap_or(SessionRateLimit::of_places(of_address)))
    }

    fn limits(&self) -> Limits {
        Limits {
            total_bits_per_s: self.total_rate_bits_per_s,
            group_bits_per_s: self.rate_per_address_bits_per_s,
        }
    }

    /// What sessions share, if anything.
    fn shared_rate_limit(&self) -> Option<Arc<SharedRateLimit>> {
        let limits = self.limits();
        (limits != Limits::default()).then(|| SharedRateLimit::new(limits))
    }
}

impl Default for SessionSettings {
    fn default() -> Self {
        Self {
            rate_bits_per_s: None,
            rate_per_address_bits_per_s: None,
            total_rate_bits_per_s: None,
            max_sessions: 1000,
            max_sessions_per_address: None,
            new_sessions_per_address: None,
            drain: Duration::from_secs(DRAIN_SECONDS),
        }
    }
}

/// Where a daemon stands.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Phase {
    /// It takes clients.
    Running,
    /// It takes no more clients; sessions finish what they are at.
    Draining,
    /// Nothing may go on.
    Stopped,
}

/// What may be changed while the daemon runs, and what follows from it.
struct Live {
    settings: SessionSettings,
    admission: Arc<AdmissionSettings>,
    quic: Arc<ServerConfig>,
    websocket: Arc<ServerConfig>,
    shared_rate_limit: Option<Arc<SharedRateLimit>>,
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

/// Scenes, settings and counters of a daemon; what every connection handler needs.
pub struct ServerState {
    scenes: Scenes,
    live: RwLock<Live>,
    metrics: Metrics,
    phase: watch::Sender<Phase>,
    sessions: watch::Sender<u64>,
    next_session: AtomicU64,
    leases: Arc<Leases>,
    arrivals: SessionRateLimiter,
    unproved: Arc<PreAuthPool>,
    requests: Arc<PreAuthPool>,
    damage: Damage,
    started: Instant,
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
    /// The state of a daemon that serves one scene, with the protocol's defaults for each transport.
    #[must_use]
    pub fn new(scene: Arc<dyn SceneSource>, settings: SessionSettings) -> Arc<Self> {
        Self::admitting(scene, settings, AdmissionSettings::default())
    }

    /// The same with these scenes, and with a say in who may open sessions.
    #[must_use]
    pub fn admitting(
        scenes: impl Into<Scenes>,
        settings: SessionSettings,
        admission: AdmissionSettings,
    ) -> Arc<Self> {
        let (of_address, arrivals) = settings.of_address();
        Arc::new(Self {
            scenes: scenes.into(),
            live: RwLock::new(Live::new(settings, admission)),
            metrics: Metrics::default(),
            phase: watch::Sender::new(Phase::Running),
            sessions: watch::Sender::new(0),
            next_session: AtomicU64::new(1),
            leases: Leases::new(settings.max_sessions, of_address),
            arrivals: SessionRateLimiter::new(arrivals),
            unproved: PreAuthPool::new(MAX_UNPROVED),
            requests: PreAuthPool::new(MAX_REQUESTS),
            damage: Damage::default(),
            started: Instant::now(),
        })
    }

    /// The scenes.
    #[must_use]
    pub const fn scenes(&self) -> &Scenes {
        &self.scenes
    }

    /// A thread that panicked while it held the lock left what was there before.
    fn live(&self) -> RwLockReadGuard<'_, Live> {
        self.live.read().unwrap_or_else(PoisonError::into_inner)
    }

    /// The settings.
    #[must_use]
    pub fn settings(&self) -> SessionSettings {
        self.live().settings
    }

    /// Who may open sessions.
    pub(crate) fn admission(&self) -> Arc<AdmissionSettings> {
        Arc::clone(&self.live().admission)
    }

    /// Has these settings hold from now on: for new sessions, and what sessions share for those that share it already. By
    /// what tokens are judged stays.
    pub fn change(&self, settings: SessionSettings, admission: AdmissionSettings) {
        let (of_address, arrivals) = settings.of_address();
        self.leases.set(settings.max_sessions, of_address);
        self.arrivals.set(arrivals);
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
            of_session: settings.rate_bits_per_s,
            of_address: settings.rate_per_address_bits_per_s,
            of_all: settings.total_rate_bits_per_s,
            given: shared_rate_limit
                .map_or(0, |shared_rate_limit| shared_rate_limit.allocated_bits_per_s(self.now())),
        };
        self.metrics.render(rates, draining, self.scenes.cache_use())
    }

    pub(crate) fn config(&self, transport: Transport) -> Arc<ServerConfig> {
        let live = self.live();
        Arc::clone(match transport {
            Transport::Quic => &live.quic,
            Transport::WebSocket => &live.websocket,
        })
    }

    /// The same for a session whose token says this of its rate.
    pub(crate) fn config_of(
        &self,
        transport: Transport,
        granted_bits_per_s: Option<u64>,
    ) -> Arc<ServerConfig> {
        let settings = self.settings();
        let rate = settings.rate_at_most(granted_bits_per_s);
        if rate == settings.rate_bits_per_s {
            return self.config(transport);
        }
        Arc::new(match transport {
            Transport::Quic => ServerConfig::quic(rate),
            Transport::WebSocket => ServerConfig::websocket(rate),
        })
    }

    /// Where the daemon stands.
    #[must_use]
    pub fn phase(&self) -> Phase {
        *self.phase.borrow()
    }

    /// Begins to drain: new clients are refused, sessions end as soon as nothing is asked for, at the
    /// latest after [`SessionSettings::drain`].
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

    /// Waits until the daemon is at `phase` or beyond.
    pub async fn reached(&self, phase: Phase) {
        // Fails only where the sender is gone, and that is ours.
        let _ = self.phase.subscribe().wait_for(|now| *now >= phase).await;
    }

    /// Waits until no session is open.
    pub async fn all_sessions_ended(&self) {
        let _ = self.sessions.subscribe().wait_for(|open| *open == 0).await;
    }

    /// Lets somebody in who has proved nothing yet.
    pub(crate) fn enter_unproved(&self, peer: SocketAddr) -> PreAuthSlot {
        self.unproved.enter(peer.ip())
    }

    /// Lets an HTTP connection in, which has no session yet.
    pub(crate) fn enter_request(&self, peer: SocketAddr) -> PreAuthSlot {
        self.requests.enter(peer.ip())
    }

    /// What a token grants to who shows it for this scene, if for one; there must be something to judge it by.
    pub(crate) async fn verify_token(
        self: Arc<Self>,
        token: String,
        scene: Option<String>,
        peer: SocketAddr,
    ) -> Result<Grant, TokenError> {
        let access = self.admission().access.clone().ok_or(TokenError::Unknown)?;
        let grant = access.verify(token, scene, peer.ip()).await;
        grant.map_err(|why| self.token_refused(why))
    }

    /// The same for a session that has a grant, which goes on with that until it is known.
    pub(crate) async fn verify_next_token(
        self: Arc<Self>,
        token: String,
        scene: String,
        peer: SocketAddr,
    ) -> Result<Grant, TokenError> {
        let access = self.admission().access.clone().ok_or(TokenError::Unknown)?;
        let grant = access.verify_patiently(token, scene, peer.ip()).await;
        grant.map_err(|why| self.token_refused(why))
    }

    /// Counts that a session is refused or ended for its token.
    pub(crate) fn token_refused(&self, why: TokenError) -> TokenError {
        match why {
            TokenError::Unknown => self.metrics.access_unknown(),
            _ => self.metrics.token_refused(),
        }
        why
    }

    /// A blob that a client asked for, or was to be sent, could not be read.
    pub(crate) fn read_failed(&self, error: &SourceError) {
        if self.damage.note(error) {
            self.metrics.blob_unreadable();
        }
    }

    /// Entries of all tables that sessions write into.
    #[cfg(test)]
    pub(crate) fn entries(&self) -> [usize; 4] {
        [self.leases.len(), self.arrivals.len(), self.unproved.len(), self.requests.len()]
    }

    fn now(&self) -> Time {
        Time::from(self.started.elapsed())
    }

    /// Begins a session, unless there is no lease for its address, or that began too many lately. It has no lease itself
    /// until [`SessionGuard::take_lease`], and over QUIC does not count among those that its address began until
    /// [`SessionGuard::count`]: whoever forges an address takes nothing from its owner.
    pub(crate) fn begin_session(
        self: &Arc<Self>,
        transport: Transport,
        peer: SocketAddr,
    ) -> Result<SessionGuard, NoLease> {
        let running = if self.phase() == Phase::Running { Ok(()) } else { Err(NoLease::Draining) };
        let now = self.now();
        let proved = transport == Transport::WebSocket;
        let in_time = || {
            let (address, arrivals) = (peer.ip(), &self.arrivals);
            let may = if proved { arrivals.take(address, now) } else { arrivals.check(address, now) };
            may.then_some(()).ok_or(NoLease::TooOften)
        };
        let free = running.and_then(|()| self.leases.check(peer.ip(), now));
        if let Err(why) = free.and_then(|()| in_time()) {
            self.metrics.session_refused(why.into());
            return Err(why);
        }
        self.sessions.send_modify(|open| *open += 1);
        self.metrics.session_started(transport);
        let id = self.next_session.fetch_add(1, Ordering::Relaxed);
        let standing = SessionKind::Unproved(self.enter_unproved(peer));
        Ok(SessionGuard {
            state: Arc::clone(self),
            transport,
            id,
            peer,
            ended: CloseCode::Lost,
            asked: None,
            grant: None,
            version: None,
            counted: proved,
            standing,
        })
    }
}

/// What a session has.
#[derive(Debug)]
enum SessionKind {
    /// A seat among those who have not proved to be clients.
    Unproved(PreAuthSlot),
    /// A lease among the sessions.
    Leased(Lease),
}

/// A session's part in the counts; given back when dropped.
#[derive(Debug)]
pub(crate) struct SessionGuard {
    pub(crate) state: Arc<ServerState>,
    pub(crate) transport: Transport,
    /// Number of the session, from 1.
    pub(crate) id: u64,
    pub(crate) peer: SocketAddr,
    /// Why the session ended; "lost" until said otherwise.
    pub(crate) ended: CloseCode,
    /// Name of the scene that it asks for, if that was said before `Hello`.
    pub(crate) asked: Option<String>,
    /// What the token of its request grants.
    pub(crate) grant: Option<Grant>,
    /// The scene that it has, once it has one.
    pub(crate) version: Option<Arc<Version>>,
    /// Whether it is one of those that its address began.
    counted: bool,
    standing: SessionKind,
}

impl SessionGuard {
    /// Its part in what sessions share, if they share anything: `began` is when its clock did.
    pub(crate) fn share(&self, weight: Weight, began: Instant) -> Option<RateShare> {
        let began = Time::from(began.saturating_duration_since(self.state.started));
        let shared_rate_limit = self.state.live().shared_rate_limit.clone();
        shared_rate_limit.map(|shared_rate_limit| shared_rate_limit.join(self.group(), weight, began))
    }

    /// With whom it counts as one there: the sessions of its address, once that is proved. Whoever forges an address takes
    /// nothing from its owner.
    pub(crate) fn group(&self) -> Option<u128> {
        self.counted.then(|| AddressBlock::of(self.peer.ip()).number())
    }

    /// Name of the session's scene, for the log.
    pub(crate) fn scene_name(&self) -> &str {
        self.version.as_ref().map_or("none", |version| version.name())
    }

    /// Whether the session has a lease.
    pub(crate) const fn has_lease(&self) -> bool {
        matches!(self.standing, SessionKind::Leased(_))
    }

    /// Counts the session among those that its address began, once: the address is proved.
    pub(crate) fn count(&mut self) -> Result<(), NoLease> {
        if self.counted {
            return Ok(());
        }
        self.counted = true;
        if self.state.arrivals.take(self.peer.ip(), self.state.now()) {
            return Ok(());
        }
        self.state.metrics.session_refused(NoLease::TooOften.into());
        Err(NoLease::TooOften)
    }

    /// Takes a lease, once: the client has proved its address and said `Hello`.
    pub(crate) fn take_lease(&mut self) -> Result<(), NoLease> {
        if self.has_lease() {
            return Ok(());
        }
        match self.state.leases.take(self.peer.ip(), self.state.now()) {
            Ok(lease) => {
                self.standing = SessionKind::Leased(lease);
                Ok(())
            }
            Err(why) => {
                self.state.metrics.session_refused(why.into());
                Err(why)
            }
        }
    }

    /// The client comes from this address now: what the session has is that one's.
    pub(crate) fn comes_from(&mut self, peer: SocketAddr) {
        if peer.ip() != self.peer.ip()
            && let SessionKind::Leased(lease) = &self.standing
        {
            lease.moved(peer.ip());
        }
        if peer != self.peer {
            tracing::info!(from = %self.peer, to = %peer, "the client has another address");
            self.peer = peer;
        }
    }

    /// The client has asked for something: the session is of use.
    pub(crate) fn asked(&self) {
        if let SessionKind::Leased(lease) = &self.standing {
            lease.asked(self.state.now());
        }
    }

    /// Resolves, once, when another needs what this session has; says why, for the client.
    pub(crate) async fn dismissed(&self) -> &'static str {
        match &self.standing {
            SessionKind::Unproved(seat) => {
                seat.lost().await;
                "too many clients connect at once and have not said Hello"
            }
            SessionKind::Leased(lease) => {
                lease.lost().await;
                "the server is full, and others have fewer sessions or ask for more"
            }
        }
    }
}

impl Drop for SessionGuard {
    fn drop(&mut self) {
        self.state.metrics.session_ended(self.transport, self.ended);
        self.state.sessions.send_modify(|open| *open -= 1);
    }
}
