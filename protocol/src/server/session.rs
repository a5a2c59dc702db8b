//! The session: handles the client's messages and ends the session.

use std::sync::Arc;

use bytes::Bytes;

use super::config::ServerConfig;
use super::outbox::{Full, Outbox};
use super::pace::Pace;
use super::plans::Plans;
use super::push::Push;
use super::requests::{PageRequest, Requests};
use super::timers::{SessionState, Timers};
use crate::frame::FrameError;
use crate::message::{
    ClientMessage, Close, CloseCode, Hello, Refused, ServerMessage, VERSIONS, Want, Welcome,
};
use crate::scheduler::Unit;
use crate::shared_rate_limit::{RateShare, Weight};
use crate::source::{SceneSource, SourceError};
use crate::time::Time;
use lodestream_scene::blob::BlobId;
use lodestream_scene::view::View;

/// Counters of a session.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ServerStats {
    /// Bytes on the wire, estimated as the limiter counts them.
    pub wire_bytes: u64,
    /// Blob bytes handed over.
    pub blob_bytes: u64,
    /// Blobs of which the first byte was handed over.
    pub blobs: u64,
    /// Control messages handed over.
    pub messages: u64,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Phase {
    /// `Hello` has not arrived.
    AwaitingHello,
    Open,
    Closed,
}

/// A session with one client.
pub struct ServerSession {
    pub(super) config: Arc<ServerConfig>,
    pub(super) source: Arc<dyn SceneSource>,
    pub(super) phase: Phase,
    close: Option<Close>,
    pub(super) pace: Pace,
    pub(super) timers: Timers,
    /// Control messages that are not handed over yet.
    pub(super) control: Outbox,
    pub(super) requests: Requests,
    pub(super) push: Push,
    /// Whether `Done` was sent since the last request.
    pub(super) done_reported: bool,
    /// Blobs that the driver is reading from the store.
    reads: Vec<BlobId>,
    pub(super) stats: ServerStats,
}

impl ServerSession {
    /// A session that begins now: the transport is open, `Hello` has not arrived. `session` is its number for logs.
    #[must_use]
    pub fn new(config: Arc<ServerConfig>, source: Arc<dyn SceneSource>, session: u64, now: Time) -> Self {
        Self::with_plans(Plans::new(), config, source, session, now)
    }

    /// As [`new`](Self::new), with first flights and refinements cached in `plans`, which all sessions with a scene
    /// share. What is sent is the same.
    #[must_use]
    pub fn with_plans(
        plans: Arc<Plans>,
        config: Arc<ServerConfig>,
        source: Arc<dyn SceneSource>,
        session: u64,
        now: Time,
    ) -> Self {
        let header = source.header().clone();
        let view = header.camera.view(config.start_viewport_px, 1.0);
        let welcome = ServerMessage::Welcome(Welcome {
            version: *VERSIONS.end(),
            session,
            rate_bits_per_s: config.limiter.rate_bits_per_s.unwrap_or(0),
            idle_timeout_ms: u32::try_from(config.idle_timeout.as_millis()).unwrap_or(u32::MAX),
            scene: header,
        });
        let punctual_lights = source.punctual_lights().cloned().map(ServerMessage::PunctualLights);
        let parts = source.parts().map(ServerMessage::Parts);
        let animations = source.animations().map(ServerMessage::Animations);
        let mut this = Self {
            phase: Phase::AwaitingHello,
            close: None,
            pace: Pace::new(config.limiter),
            timers: Timers::new(&config, now),
            control: Outbox::new(
                std::iter::once(welcome).chain(punctual_lights).chain(parts).chain(animations),
            ),
            requests: Requests::new(config.max_queued),
            push: Push::new(plans, view, config.push_before_hello_bytes),
            done_reported: true,
            reads: Vec::new(),
            stats: ServerStats::default(),
            config,
            source,
        };
        this.push.plan(&*this.source, &mut this.requests);
        this
    }

    /// Adds a share of a shared rate limit to the session's own limiter.
    pub fn set_shared_rate_limit(&mut self, share: RateShare) {
        self.pace.join(share);
    }

    /// Changes the session's own rate, in bits per second; `None` for no limit. Debt keeps its value in bytes.
    pub fn set_rate(&mut self, now: Time, rate_bits_per_s: Option<u64>) {
        self.pace.set_rate(now, rate_bits_per_s);
    }

    /// Changes the session's weight in its shared rate limit, if it has one.
    pub fn set_weight(&mut self, now: Time, weight: Weight) {
        self.pace.set_weight(now, weight);
    }

    /// Changes the session's group in its shared rate limit, if it has one.
    pub fn set_group(&mut self, now: Time, group: Option<u128>) {
        self.pace.set_group(now, group);
    }

    /// Handles a message of the client.
    pub fn handle_message(&mut self, now: Time, message: ClientMessage) {
        if self.phase == Phase::Closed {
            return;
        }
        self.timers.message_received(now);
        let had_work = self.has_work();
        match (self.phase, message) {
            (_, ClientMessage::Bye) => self.end(Close::new(CloseCode::Normal, "the client left"), false),
            (_, ClientMessage::Ping(nonce)) => {
                let queued = self.control.pong(nonce);
                self.close_if_full(queued);
            }
            // A server that requires tokens has taken it before the session.
            (_, ClientMessage::Token(_)) => {}
            (Phase::AwaitingHello, ClientMessage::Hello(hello)) => self.hello(hello),
            (Phase::AwaitingHello, _) => self.refuse(CloseCode::Protocol, "the first message must be Hello"),
            (_, ClientMessage::Hello(_)) => self.refuse(CloseCode::Protocol, "a second Hello"),
            (_, ClientMessage::Want(wants)) => self.want(&wants),
            (_, ClientMessage::Cancel(ids)) => self.cancel(&ids),
            (_, ClientMessage::SetView(view)) => self.set_view(now, view),
            (_, ClientMessage::WantScenePages(pages)) => self.want_pages(&pages),
        }
        if !had_work {
            self.timers.work_offered(now);
        }
    }

    /// Handles a frame that the driver could not decode: closes with the reason.
    pub fn handle_frame_error(&mut self, _now: Time, error: &FrameError) {
        self.refuse(error.close_code(), &error.to_string());
    }

    /// Ends the session because the transport failed or ended; no `Close` is sent.
    pub fn handle_lost(&mut self, _now: Time, reason: &str) {
        self.end(Close::new(CloseCode::Lost, reason), false);
    }

    /// Ends the session with a reason. What is queued is dropped; `Close` is the last message.
    pub fn close(&mut self, _now: Time, code: CloseCode, reason: &str) {
        self.refuse(code, reason);
    }

    pub(super) fn refuse(&mut self, code: CloseCode, reason: &str) {
        self.end(Close::new(code, reason), true);
    }

    fn end(&mut self, close: Close, send_close: bool) {
        if self.phase == Phase::Closed {
            return;
        }
        self.phase = Phase::Closed;
        self.control.end(send_close.then(|| close.clone()));
        self.requests.clear();
        self.push.clear();
        self.pace.leave();
        self.reads.clear();
        self.close = Some(close);
    }

    /// Closes the session if an answer did not fit the outbox.
    fn close_if_full(&mut self, queued: Result<(), Full>) {
        if queued.is_err() {
            self.refuse(CloseCode::Limit, "the client sends requests faster than it reads the answers");
        }
    }

    fn hello(&mut self, hello: Hello) {
        let version = *VERSIONS.end();
        if !(hello.version_min..=hello.version_max).contains(&version) {
            let Hello { version_min, version_max, .. } = hello;
            let reason = format!(
                "the server speaks version {version}, the client {version_min} to {version_max}; update one of them"
            );
            return self.refuse(CloseCode::Version, &reason);
        }
        let header = self.source.header();
        if !hello.scene.is_empty() && hello.scene != header.name {
            let reason = format!("there is no scene '{}'; this server has '{}'", hello.scene, header.name);
            return self.refuse(CloseCode::NoSuchScene, &reason);
        }
        let same = hello.fingerprint == header.fingerprint;
        let have = if same { &hello.have[..] } else { &[] };
        let source = &self.source;
        let existing = have.iter().copied().filter(|id| source.blob_len(id).is_some());
        self.requests.open(hello.max_blob_bytes, existing);
        self.phase = Phase::Open;
        self.push.open(hello.view, hello.budget_bytes, !have.is_empty());
        self.push.plan(&*self.source, &mut self.requests);
    }

    fn want(&mut self, wants: &[Want]) {
        self.done_reported = false;
        for want in wants {
            self.push.requested(want.id);
            if let Err(reason) = self.requests.want(&*self.source, want) {
                let queued = self.control.refuse(Refused { id: want.id, reason });
                self.close_if_full(queued);
            }
            if self.phase == Phase::Closed {
                return;
            }
        }
    }

    fn cancel(&mut self, ids: &[BlobId]) {
        for &id in ids {
            self.push.settled(Unit::Blob(id));
            self.requests.cancel(id);
        }
    }

    fn want_pages(&mut self, pages: &[u32]) {
        self.done_reported = false;
        let count = self.source.header().page_count;
        for &page in pages.iter().filter(|page| **page < count) {
            if let PageRequest::Resend(priority) = self.requests.want_page(page) {
                self.push.queue_page(page, priority);
            }
        }
    }

    fn set_view(&mut self, now: Time, view: View) {
        // Clients send their first view even if it is the scene's start view.
        if view == *self.push.view() {
            return;
        }
        // Nothing is pushed to a client that knows all pages and requests chunks itself.
        let all_pages = self.requests.pages_sent() >= self.source.header().page_count;
        let replan = !(self.requests.has_requested_chunks() && all_pages && self.push.has_all_bases());
        let instances = self.source.header().instance_count;
        self.push.set_view(now, view, &mut self.requests, replan, instances);
    }

    /// The next blob to read from the store ([`SceneSource::read`], which may block); the driver passes the result to
    /// [`ServerSession::handle_read`]. Call until `None`, after every [`ServerSession::poll_transmit`]. A session has
    /// at most [`crate::scheduler::MAX_READS`] outstanding reads for its client, and as many of index pages for what
    /// it pushes.
    pub fn poll_read(&mut self) -> Option<BlobId> {
        loop {
            let id = self.requests.scheduler.poll_read().or_else(|| self.push.poll_read())?;
            if !self.reads.contains(&id) {
                self.reads.push(id);
                return Some(id);
            }
        }
    }

    /// Takes the result of a read. Call [`ServerSession::poll_transmit`] afterwards. Drops what is no longer wanted.
    pub fn handle_read(&mut self, now: Time, id: BlobId, bytes: &Result<Bytes, SourceError>) {
        let had_work = self.has_work();
        self.reads.retain(|read| *read != id);
        self.requests.handle_read(id, bytes);
        self.push.handle_read(id, bytes);
        if !had_work {
            self.timers.work_offered(now);
        }
    }

    /// Handles deadlines. Call at the moment given by [`ServerSession::poll_timeout`]; an earlier call is harmless.
    pub fn handle_timeout(&mut self, now: Time) {
        self.timers.driver_polled(now);
        if self.phase == Phase::Closed {
            return;
        }
        let had_work = self.has_work();
        if let Some(reason) = self.timers.overdue(now, self.state()) {
            self.refuse(CloseCode::Timeout, &reason);
        } else if self.push.replan_if_due(now, &*self.source, &mut self.requests) && !had_work {
            self.timers.work_offered(now);
        }
    }

    fn state(&self) -> SessionState {
        SessionState {
            awaiting_hello: self.phase == Phase::AwaitingHello,
            has_work: self.has_work(),
            ready_at: self.pace.ready_at(),
        }
    }

    pub(super) fn has_work(&self) -> bool {
        let open = self.phase == Phase::Open;
        !self.control.is_empty()
            || self.requests.has_work()
            || self.push.has_work(&*self.source, open)
            || (open && (self.push.must_report_bases() || self.must_report_done()))
    }

    /// Whether all requested and pushed units are handed over and `Done` is not sent yet.
    pub(super) fn must_report_done(&self) -> bool {
        !self.done_reported && self.requests.scheduler.is_empty() && self.push.is_empty()
    }

    /// When to call [`ServerSession::handle_timeout`] and then [`ServerSession::poll_transmit`] again.
    #[must_use]
    pub fn poll_timeout(&self) -> Option<Time> {
        if self.phase == Phase::Closed {
            return None;
        }
        let next = self.timers.next(self.state());
        Some(self.push.replan_at().map_or(next, |at| next.min(at)))
    }

    /// Why the session ends; set as soon as that is decided.
    #[must_use]
    pub const fn close_reason(&self) -> Option<&Close> {
        self.close.as_ref()
    }

    /// Whether the session has ended and its `Close` was handed over: the driver closes the transport.
    #[must_use]
    pub fn is_closed(&self) -> bool {
        self.phase == Phase::Closed && self.control.is_empty()
    }

    /// Whether `Hello` was accepted and the session has not ended.
    #[must_use]
    pub fn is_open(&self) -> bool {
        self.phase == Phase::Open
    }

    /// Bytes not handed over yet: of requested blobs and of those pushed next, and of queued control messages as
    /// counted in memory. O(n) for n queued units: meant for occasional use.
    #[must_use]
    pub fn waiting_bytes(&self) -> u64 {
        let blobs = self.requests.scheduler.waiting_bytes(|id| self.source.blob_len(id));
        blobs + self.control.bytes() as u64
    }

    /// Whether [`ServerSession::waiting_bytes`] has nothing to count.
    #[must_use]
    pub fn nothing_waits(&self) -> bool {
        self.control.is_empty() && self.requests.scheduler.is_empty()
    }

    /// Counters since the session began.
    #[must_use]
    pub const fn stats(&self) -> ServerStats {
        self.stats
    }
}
