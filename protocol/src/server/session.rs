//! One session: what its client says, and when it ends.

use std::sync::Arc;

use bytes::Bytes;

use super::config::ServerConfig;
use super::outbox::{Full, Outbox};
use super::pace::Pace;
use super::plans::Plans;
use super::push::Push;
use super::requests::{PageWanted, Requests};
use super::timers::{Timers, Waiting};
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
    /// Blobs begun.
    pub blobs: u64,
    /// Control messages handed over.
    pub messages: u64,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Phase {
    /// `Hello` has not been heard.
    Greeting,
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
    /// Control messages, not handed over yet.
    pub(super) control: Outbox,
    pub(super) requests: Requests,
    pub(super) push: Push,
    /// All that was asked for has been handed over, and that was told.
    pub(super) done_told: bool,
    /// Blobs that the driver has the store read.
    reads: Vec<BlobId>,
    pub(super) stats: ServerStats,
}

impl ServerSession {
    /// A session that begins now: the transport is open, `Hello` has not been heard. `session` is its
    /// number for logs.
    #[must_use]
    pub fn new(config: Arc<ServerConfig>, source: Arc<dyn SceneSource>, session: u64, now: Time) -> Self {
        Self::sharing(Plans::new(), config, source, session, now)
    }

    /// The same of one of many sessions with a scene, all of which share `plans`: what is sent is the same, and the start
    /// view is planned once.
    #[must_use]
    pub fn sharing(
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
        let mut this = Self {
            phase: Phase::Greeting,
            close: None,
            pace: Pace::new(config.limiter),
            timers: Timers::new(&config, now),
            control: Outbox::new(std::iter::once(welcome).chain(punctual_lights)),
            requests: Requests::new(config.max_queued),
            push: Push::new(plans, view, config.push_before_hello_bytes),
            done_told: true,
            reads: Vec::new(),
            stats: ServerStats::default(),
            config,
            source,
        };
        this.push.plan(&*this.source, &mut this.requests);
        this
    }

    /// Makes the session share a shared rate limit with others, beside its own limiter.
    pub fn set_shared_rate_limit(&mut self, share: RateShare) {
        self.pace.join(share);
    }

    /// Changes the session's own rate from that of its configuration, in bits per second; `None` for no limit. What was
    /// overdrawn stays so in bytes.
    pub fn set_rate(&mut self, now: Time, rate_bits_per_s: Option<u64>) {
        self.pace.set_rate(now, rate_bits_per_s);
    }

    /// Changes how much the session counts beside those that it shares a shared rate limit with. Nothing where it shares none.
    pub fn set_weight(&mut self, now: Time, weight: Weight) {
        self.pace.set_weight(now, weight);
    }

    /// Changes the group of sessions with which it counts as one under a shared rate limit. Nothing where it shares none.
    pub fn set_group(&mut self, now: Time, group: Option<u128>) {
        self.pace.set_group(now, group);
    }

    /// Takes a message of the client.
    pub fn handle_message(&mut self, now: Time, message: ClientMessage) {
        if self.phase == Phase::Closed {
            return;
        }
        self.timers.heard(now);
        let had_work = self.has_work();
        match (self.phase, message) {
            (_, ClientMessage::Bye) => self.end(Close::new(CloseCode::Normal, "the client left"), false),
            (_, ClientMessage::Ping(nonce)) => {
                let told = self.control.pong(nonce);
                self.told(told);
            }
            // Whoever asks for tokens has taken it already.
            (_, ClientMessage::Token(_)) => {}
            (Phase::Greeting, ClientMessage::Hello(hello)) => self.hello(hello),
            (Phase::Greeting, _) => self.refuse(CloseCode::Protocol, "the first message must be Hello"),
            (_, ClientMessage::Hello(_)) => self.refuse(CloseCode::Protocol, "a second Hello"),
            (_, ClientMessage::Want(wants)) => self.want(&wants),
            (_, ClientMessage::Cancel(ids)) => self.cancel(&ids),
            (_, ClientMessage::SetView(view)) => self.set_view(now, view),
            (_, ClientMessage::WantScenePages(pages)) => self.want_pages(&pages),
        }
        if !had_work {
            self.timers.offered(now);
        }
    }

    /// Takes what the driver could not decode: queues a reasoned close.
    pub fn handle_frame_error(&mut self, _now: Time, error: &FrameError) {
        self.refuse(error.close_code(), &error.to_string());
    }

    /// The transport failed or ended: there is nobody to tell.
    pub fn handle_lost(&mut self, _now: Time, reason: &str) {
        self.end(Close::new(CloseCode::Lost, reason), false);
    }

    /// Ends the session with a reason; what is queued is dropped, `Close` is the last message.
    pub fn close(&mut self, _now: Time, code: CloseCode, reason: &str) {
        self.refuse(code, reason);
    }

    pub(super) fn refuse(&mut self, code: CloseCode, reason: &str) {
        self.end(Close::new(code, reason), true);
    }

    fn end(&mut self, close: Close, tell: bool) {
        if self.phase == Phase::Closed {
            return;
        }
        self.phase = Phase::Closed;
        self.control.end(tell.then(|| close.clone()));
        self.requests.clear();
        self.push.clear();
        self.pace.leave();
        self.reads.clear();
        self.close = Some(close);
    }

    /// What became of an answer.
    fn told(&mut self, told: Result<(), Full>) {
        if told.is_err() {
            self.refuse(CloseCode::Limit, "the client makes messages faster than it takes the answers");
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
        let real = have.iter().copied().filter(|id| source.blob_len(id).is_some());
        self.requests.open(hello.max_blob_bytes, real);
        self.phase = Phase::Open;
        self.push.open(hello.view, hello.budget_bytes, !have.is_empty());
        self.push.plan(&*self.source, &mut self.requests);
    }

    fn want(&mut self, wants: &[Want]) {
        self.done_told = false;
        for want in wants {
            self.push.asked_for(want.id);
            if let Err(reason) = self.requests.want(&*self.source, want) {
                let told = self.control.refuse(Refused { id: want.id, reason });
                self.told(told);
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
        self.done_told = false;
        let count = self.source.header().page_count;
        for &page in pages.iter().filter(|page| **page < count) {
            if let PageWanted::Again(priority) = self.requests.want_page(page) {
                self.push.wait_page(page, priority);
            }
        }
    }

    fn set_view(&mut self, now: Time, view: View) {
        // Clients say so even where their first view is the scene's own.
        if view == *self.push.view() {
            return;
        }
        // Once the client knows all pages and asks for itself, there is nothing to order.
        let all_pages = self.requests.pages_handed() >= self.source.header().page_count;
        let order = !(self.requests.refines() && all_pages && self.push.has_all_bases());
        let instances = self.source.header().instance_count;
        self.push.set_view(now, view, &mut self.requests, order, instances);
    }

    /// The next blob that the driver should have the store read ([`SceneSource::read`]), where that may take its time,
    /// and answer by [`ServerSession::handle_read`]. Ask until `None`, after every
    /// [`ServerSession::poll_transmit`]. A session has at most [`crate::scheduler::MAX_READS`] reads for its client under
    /// way, and as many index pages for what it pushes.
    pub fn poll_read(&mut self) -> Option<BlobId> {
        loop {
            let id = self.requests.scheduler.poll_read().or_else(|| self.push.poll_read())?;
            if !self.reads.contains(&id) {
                self.reads.push(id);
                return Some(id);
            }
        }
    }

    /// Takes what the store has read. Call [`ServerSession::poll_transmit`] afterwards. What is no longer wanted is
    /// dropped.
    pub fn handle_read(&mut self, now: Time, id: BlobId, bytes: &Result<Bytes, SourceError>) {
        let had_work = self.has_work();
        self.reads.retain(|read| *read != id);
        self.requests.handle_read(id, bytes);
        self.push.handle_read(id, bytes);
        if !had_work {
            self.timers.offered(now);
        }
    }

    /// Call when the moment given by [`ServerSession::poll_timeout`] has come; earlier is harmless.
    pub fn handle_timeout(&mut self, now: Time) {
        self.timers.woken(now);
        if self.phase == Phase::Closed {
            return;
        }
        let had_work = self.has_work();
        if let Some(reason) = self.timers.overdue(now, self.waiting()) {
            self.refuse(CloseCode::Timeout, &reason);
        } else if self.push.replan_if_due(now, &*self.source, &mut self.requests) && !had_work {
            self.timers.offered(now);
        }
    }

    fn waiting(&self) -> Waiting {
        Waiting {
            greeting: self.phase == Phase::Greeting,
            has_work: self.has_work(),
            ready_at: self.pace.ready_at(),
        }
    }

    pub(super) fn has_work(&self) -> bool {
        let open = self.phase == Phase::Open;
        !self.control.is_empty()
            || self.requests.has_work()
            || self.push.has_work(&*self.source, open)
            || (open && (self.push.bases_to_tell() || self.is_done_to_tell()))
    }

    /// Whether all that was asked for has been handed over, of which nothing was told yet.
    pub(super) fn is_done_to_tell(&self) -> bool {
        !self.done_told && self.requests.scheduler.is_empty() && self.push.is_empty()
    }

    /// When to call [`ServerSession::handle_timeout`] and then [`ServerSession::poll_transmit`] again.
    #[must_use]
    pub fn poll_timeout(&self) -> Option<Time> {
        if self.phase == Phase::Closed {
            return None;
        }
        let next = self.timers.next(self.waiting());
        Some(self.push.replan_at().map_or(next, |at| next.min(at)))
    }

    /// Why the session ended: set as soon as it is decided.
    #[must_use]
    pub const fn close_reason(&self) -> Option<&Close> {
        self.close.as_ref()
    }

    /// Whether the session has ended and its `Close` has been handed over: close the transport.
    #[must_use]
    pub fn is_closed(&self) -> bool {
        self.phase == Phase::Closed && self.control.is_empty()
    }

    /// Whether `Hello` has been heard and accepted.
    #[must_use]
    pub fn is_open(&self) -> bool {
        self.phase == Phase::Open
    }

    /// Bytes that wait to be handed over: of blobs that were asked for or are pushed next, and of control messages as
    /// they lie in memory. Looks at each request that is queued: for a look now and then.
    #[must_use]
    pub fn waiting_bytes(&self) -> u64 {
        let blobs = self.requests.scheduler.waiting_bytes(|id| self.source.blob_len(id));
        blobs + self.control.bytes() as u64
    }

    /// Whether nothing waits to be handed over, as [`ServerSession::waiting_bytes`] counts it.
    #[must_use]
    pub fn nothing_waits(&self) -> bool {
        self.control.is_empty() && self.requests.scheduler.is_empty()
    }

    /// What has been sent so far.
    #[must_use]
    pub const fn stats(&self) -> ServerStats {
        self.stats
    }
}
