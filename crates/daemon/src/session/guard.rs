//! One session's entries in the daemon's tables and counters.

use std::net::SocketAddr;
use std::sync::Arc;
use std::sync::atomic::Ordering;

use lodestream_protocol::Time;
use lodestream_protocol::message::CloseCode;
use lodestream_protocol::shared_rate_limit::{RateShare, Weight};
use tokio::time::Instant;

use crate::admission::leases::{Lease, LeaseError};
use crate::admission::pre_auth_pool::{AddressBlock, PreAuthSlot};
use crate::auth::grant::Grant;
use crate::metrics::Transport;
use crate::session::scenes::SceneVersion;
use crate::session::state::{Phase, ServerState};

/// What a session has.
#[derive(Debug)]
enum SessionSlot {
    /// A seat among those who have not proved to be clients.
    PreAuth(PreAuthSlot),
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
    pub(crate) close_code: CloseCode,
    /// Name of the scene that it asks for, if that was said before `Hello`.
    pub(crate) requested_scene: Option<String>,
    /// What the token of its request grants.
    pub(crate) grant: Option<Grant>,
    /// The scene that it has, once it has one.
    pub(crate) version: Option<Arc<SceneVersion>>,
    /// Whether it is one of those that its address session_start.
    counted_for_address: bool,
    slot: SessionSlot,
}

impl SessionGuard {
    /// Begins a session, unless there is no lease for its address, or that session_start too many lately. It has no lease itself
    /// until [`SessionGuard::take_lease`], and over QUIC does not count among those that its address session_start until
    /// [`SessionGuard::count`]: whoever forges an address takes nothing from its owner.
    pub(crate) fn begin(
        state: &Arc<ServerState>,
        transport: Transport,
        peer: SocketAddr,
    ) -> Result<Self, LeaseError> {
        let running = if state.phase() == Phase::Running { Ok(()) } else { Err(LeaseError::Draining) };
        let now = state.now();
        let proved = transport == Transport::WebSocket;
        let in_time = || {
            let (address, session_rate) = (peer.ip(), &state.session_rate);
            let may = if proved { session_rate.take(address, now) } else { session_rate.check(address, now) };
            may.then_some(()).ok_or(LeaseError::RateLimit)
        };
        let free = running.and_then(|()| state.leases.check(peer.ip(), now));
        if let Err(why) = free.and_then(|()| in_time()) {
            state.metrics.session_refused(why.into());
            return Err(why);
        }
        state.sessions.send_modify(|open| *open += 1);
        state.metrics.session_started(transport);
        let id = state.next_session.fetch_add(1, Ordering::Relaxed);
        let slot = SessionSlot::PreAuth(state.enter_pre_auth(peer));
        Ok(Self {
            state: Arc::clone(state),
            transport,
            id,
            peer,
            close_code: CloseCode::Lost,
            requested_scene: None,
            grant: None,
            version: None,
            counted_for_address: proved,
            slot,
        })
    }

    /// Its part in what sessions share, if they share anything: `session_start` is when its clock did.
    pub(crate) fn join_shared_limit(&self, weight: Weight, session_start: Instant) -> Option<RateShare> {
        let session_start = Time::from(session_start.saturating_duration_since(self.state.started));
        let shared_rate_limit = self.state.live().shared_rate_limit.clone();
        shared_rate_limit.map(|shared_rate_limit| shared_rate_limit.join(self.group(), weight, session_start))
    }

    /// With whom it counts as one there: the sessions of its address, once that is proved. Whoever forges an address takes
    /// nothing from its owner.
    pub(crate) fn group(&self) -> Option<u128> {
        self.counted_for_address.then(|| AddressBlock::of(self.peer.ip()).number())
    }

    /// Name of the session's scene, for the log.
    pub(crate) fn scene_name(&self) -> &str {
        self.version.as_ref().map_or("none", |version| version.name())
    }

    /// Whether the session has a lease.
    pub(crate) const fn has_lease(&self) -> bool {
        matches!(self.slot, SessionSlot::Leased(_))
    }

    /// Counts the session among those that its address session_start, once: the address is proved.
    pub(crate) fn count_for_address(&mut self) -> Result<(), LeaseError> {
        if self.counted_for_address {
            return Ok(());
        }
        self.counted_for_address = true;
        if self.state.session_rate.take(self.peer.ip(), self.state.now()) {
            return Ok(());
        }
        self.state.metrics.session_refused(LeaseError::RateLimit.into());
        Err(LeaseError::RateLimit)
    }

    /// Takes a lease, once: the client has proved its address and said `Hello`.
    pub(crate) fn take_lease(&mut self) -> Result<(), LeaseError> {
        if self.has_lease() {
            return Ok(());
        }
        match self.state.leases.take(self.peer.ip(), self.state.now()) {
            Ok(lease) => {
                self.slot = SessionSlot::Leased(lease);
                Ok(())
            }
            Err(why) => {
                self.state.metrics.session_refused(why.into());
                Err(why)
            }
        }
    }

    /// The client comes from this address now: what the session has is that one's.
    pub(crate) fn set_peer(&mut self, peer: SocketAddr) {
        if peer.ip() != self.peer.ip()
            && let SessionSlot::Leased(lease) = &self.slot
        {
            lease.set_address(peer.ip());
        }
        if peer != self.peer {
            tracing::info!(from = %self.peer, to = %peer, "the client has another address");
            self.peer = peer;
        }
    }

    /// The client has asked for something: the session is of use.
    pub(crate) fn record_request(&self) {
        if let SessionSlot::Leased(lease) = &self.slot {
            lease.record_request(self.state.now());
        }
    }

    /// Resolves, once, when another needs what this session has; says why, for the client.
    pub(crate) async fn evicted(&self) -> &'static str {
        match &self.slot {
            SessionSlot::PreAuth(slot) => {
                slot.evicted().await;
                "too many clients connect at once and have not said Hello"
            }
            SessionSlot::Leased(lease) => {
                lease.revoked().await;
                "the server is full, and others have fewer sessions or ask for more"
            }
        }
    }
}

impl Drop for SessionGuard {
    fn drop(&mut self) {
        self.state.metrics.session_ended(self.transport, self.close_code);
        self.state.sessions.send_modify(|open| *open -= 1);
    }
}
