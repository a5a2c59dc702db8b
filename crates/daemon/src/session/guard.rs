//! One session's entries in the daemon's tables and counters.

use std::net::SocketAddr;
use std::sync::Arc;
use std::sync::atomic::Ordering;

use lodestream_protocol::message::CloseCode;
use lodestream_protocol::shared_rate_limit::{RateShare, Weight};

use crate::auth::grant::Grant;
use crate::limits::leases::{Lease, LeaseError};
use crate::limits::pre_auth_pool::{AddressBlock, PreAuthSlot};
use crate::metrics::Transport;
use crate::session::scenes::SceneVersion;
use crate::session::state::{Phase, ServerState};

/// The limit that a session counts against.
#[derive(Debug)]
enum SessionSlot {
    /// The pre-auth pool.
    PreAuth(PreAuthSlot),
    /// The leases.
    Leased(Lease),
}

/// A session's slot or lease, and its entries in the counters; returned when dropped.
#[derive(Debug)]
pub(crate) struct SessionGuard {
    pub(crate) state: Arc<ServerState>,
    pub(crate) transport: Transport,
    /// Number of the session, from 1.
    pub(crate) id: u64,
    pub(crate) peer: SocketAddr,
    /// Reason of the end for the metrics; `Lost` until another is known.
    pub(crate) close_code: CloseCode,
    /// Name of the requested scene, if known before `Hello`.
    pub(crate) requested_scene: Option<String>,
    /// Whether the client has something of the scene, so that nothing is pushed before it says what.
    pub(crate) resumes: bool,
    /// Grant of the token in the HTTP request.
    pub(crate) grant: Option<Grant>,
    /// The scene, once the session is admitted.
    pub(crate) version: Option<Arc<SceneVersion>>,
    /// Whether the session counts against its address's rate of new sessions.
    counted_for_address: bool,
    slot: SessionSlot,
}

impl SessionGuard {
    /// Starts a session in the pre-auth pool if a lease is available and the address has not started too many sessions.
    ///
    /// The lease is taken in [`SessionGuard::take_lease`]. Over QUIC the address may be forged, so it is charged only in
    /// [`SessionGuard::count_for_address`], once it is validated.
    pub(crate) fn begin(
        state: &Arc<ServerState>,
        transport: Transport,
        peer: SocketAddr,
    ) -> Result<Self, LeaseError> {
        let running = if state.phase() == Phase::Running { Ok(()) } else { Err(LeaseError::Draining) };
        let now = state.now();
        let address_valid = transport == Transport::WebSocket;
        let within_rate = || {
            let (address, session_rate) = (peer.ip(), &state.session_rate);
            let admitted = if address_valid {
                session_rate.take(address, now)
            } else {
                session_rate.check(address, now)
            };
            admitted.then_some(()).ok_or(LeaseError::RateLimit)
        };
        let free = running.and_then(|()| state.leases.check(peer.ip(), now));
        if let Err(why) = free.and_then(|()| within_rate()) {
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
            resumes: false,
            grant: None,
            version: None,
            counted_for_address: address_valid,
            slot,
        })
    }

    /// Joins the shared rate limit, if there is one. `session_start` is the start of the session's clock.
    pub(crate) fn join_shared_limit(&self, weight: Weight) -> Option<RateShare> {
        let session_start = self.state.now();
        let shared_rate_limit = self.state.live().shared_rate_limit.clone();
        shared_rate_limit.map(|limit| limit.join(self.group(), weight, session_start))
    }

    /// Group in the shared rate limit: the client's address block, once the address is validated, since it may be forged.
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

    /// Charges the session, once, to its address's rate of new sessions. Call when the address is validated.
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

    /// Takes a lease, once. Call when the address is validated and the client admitted.
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

    /// Moves the session to the client's current address.
    pub(crate) fn set_peer(&mut self, peer: SocketAddr) {
        if peer.ip() != self.peer.ip()
            && let SessionSlot::Leased(lease) = &self.slot
        {
            lease.set_address(peer.ip());
        }
        if peer != self.peer {
            tracing::info!(from = %self.peer, to = %peer, "the client's address has changed");
            self.peer = peer;
        }
    }

    /// Notes a request: the session is active.
    pub(crate) fn record_request(&self) {
        if let SessionSlot::Leased(lease) = &self.slot {
            lease.record_request(self.state.now());
        }
    }

    /// Resolves once when the session loses its slot or lease; returns the reason for the client.
    pub(crate) async fn evicted(&self) -> &'static str {
        match &self.slot {
            SessionSlot::PreAuth(slot) => {
                slot.evicted().await;
                "too many clients are connecting and have not sent Hello"
            }
            SessionSlot::Leased(lease) => {
                lease.revoked().await;
                "the server is full, and this session was idle or of the address with the most sessions"
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
