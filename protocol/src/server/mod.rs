//! The server's side of a session, sans-IO.
//!
//! A session begins to speak at once: `Welcome`, then scene pages and base meshes of the scene's start
//! view, so that on QUIC they travel in the handshake's second flight and on WebSocket with the upgrade's
//! answer. `Hello` brings the real view; what is not sent yet is ordered anew. Behind the base meshes go
//! index pages and first chunks, until the client's first `Want` of a chunk takes over.

mod config;
mod push;
mod push_queue;
mod requests;
#[cfg(test)]
mod tests;
mod transmit;

use std::collections::{HashMap, HashSet, VecDeque};
use std::sync::Arc;

use crate::blob::BlobId;
use crate::frame::{BlobPiece, FrameError};
use crate::limiter::{CeilingShare, TokenBucket};
use crate::limits::MAX_BLOB_BYTES;
use crate::message::{ClientMessage, Close, CloseCode, Hello, ServerMessage, VERSIONS, Welcome};
use crate::scheduler::{Scheduler, Unit};
use crate::select::Priority;
use crate::source::SceneSource;
use crate::time::Time;
use crate::view::View;

pub use config::ServerConfig;

/// Most control messages that wait to be handed over. A peer that makes more is closed.
const MAX_CONTROL_QUEUED: usize = 4096;
/// Least time between two orderings of what is pushed.
const REPLAN_INTERVAL: std::time::Duration = std::time::Duration::from_millis(100);

/// What the driver should hand to the transport.
#[derive(Clone, Debug, PartialEq)]
pub enum Transmit {
    /// A control message.
    Message(ServerMessage),
    /// A piece of a blob. Pieces of a blob come in order; pieces of others may come between.
    Piece {
        /// The piece.
        piece: BlobPiece,
        /// The blob's priority, for the stream ([`crate::stream::quic_priority`]).
        priority: Priority,
    },
    /// The rest of a blob will not come: reset its stream. Nothing to do on WebSocket.
    Abandon(BlobId),
}

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
enum Phase {
    /// `Hello` has not been heard.
    Greeting,
    Open,
    Closed,
}

/// A session with one client.
pub struct ServerSession {
    config: Arc<ServerConfig>,
    source: Arc<dyn SceneSource>,
    phase: Phase,
    close: Option<Close>,
    bucket: TokenBucket,
    share: Option<CeilingShare>,
    control: VecDeque<ServerMessage>,
    abandoned: VecDeque<BlobId>,
    scheduler: Scheduler,
    /// What has begun to be handed over, or what the client says it has: how far, in bytes of a blob.
    handed: HashMap<Unit, u32>,
    /// What is pushed next, least urgent first.
    push: Vec<(Priority, Unit)>,
    /// Units without which a visible instance cannot be drawn, not handed over yet.
    bases_left: HashSet<Unit>,
    bases_told: bool,
    /// Pages among `handed`.
    pages_handed: u32,
    refinement_pushed: bool,
    /// The first refinement, as far as it is not asked for.
    unasked: HashSet<Unit>,
    /// Where the part ends that was pushed of a blob, until the client shows that it has it.
    pushed_parts: HashMap<BlobId, u32>,
    client_wants: bool,
    /// The client knows enough to ask for chunks: it needs no more guesses.
    client_refines: bool,
    /// The client holds parts of the scene already, so guesses at what it lacks would be wrong.
    resumes: bool,
    done_told: bool,
    view: View,
    /// The view has changed since the last ordering.
    replan_at: Option<Time>,
    /// When it was last ordered because the view had changed.
    replanned: Option<Time>,
    pushed_bytes: u64,
    push_budget: u64,
    max_blob_bytes: u32,
    started: Time,
    heard: Time,
    /// Since when there is something to send that the driver could have taken.
    offered: Time,
    /// When the driver last asked what to do: the limiter's wake-up call is not repeated after that.
    woken: Time,
    stats: ServerStats,
}

impl ServerSession {
    /// A session that begins now: the transport is open, `Hello` has not been heard. `session` is its
    /// number for logs.
    #[must_use]
    pub fn new(config: Arc<ServerConfig>, source: Arc<dyn SceneSource>, session: u64, now: Time) -> Self {
        let header = source.header().clone();
        let view = header.camera.view(config.start_viewport_px, 1.0);
        let welcome = ServerMessage::Welcome(Welcome {
            version: *VERSIONS.end(),
            session,
            rate_bits_per_s: config.limiter.rate_bits_per_s.unwrap_or(0),
            idle_timeout_ms: u32::try_from(config.idle_timeout.as_millis()).unwrap_or(u32::MAX),
            scene: header,
        });
        let mut this = Self {
            bucket: TokenBucket::new(config.limiter),
            share: None,
            phase: Phase::Greeting,
            close: None,
            control: VecDeque::from([welcome]),
            abandoned: VecDeque::new(),
            scheduler: Scheduler::new(config.max_queued),
            handed: HashMap::new(),
            push: Vec::new(),
            bases_left: HashSet::new(),
            bases_told: false,
            pages_handed: 0,
            refinement_pushed: false,
            unasked: HashSet::new(),
            pushed_parts: HashMap::new(),
            client_wants: false,
            client_refines: false,
            resumes: false,
            done_told: true,
            view,
            replan_at: None,
            replanned: None,
            pushed_bytes: 0,
            push_budget: config.push_before_hello_bytes,
            max_blob_bytes: MAX_BLOB_BYTES,
            started: now,
            heard: now,
            offered: now,
            woken: now,
            stats: ServerStats::default(),
            config,
            source,
        };
        this.plan();
        this
    }

    /// Makes the session share a ceiling with others.
    pub fn set_ceiling(&mut self, share: CeilingShare) {
        self.share = Some(share);
    }

    /// Takes a message of the client.
    pub fn handle_message(&mut self, now: Time, message: ClientMessage) {
        if self.phase == Phase::Closed {
            return;
        }
        self.heard = now;
        let had_work = self.has_work();
        match (self.phase, message) {
            (_, ClientMessage::Bye) => self.end(Close::new(CloseCode::Normal, "the client left"), false),
            (_, ClientMessage::Ping(nonce)) => self.tell(ServerMessage::Pong(nonce)),
            (Phase::Greeting, ClientMessage::Hello(hello)) => self.hello(hello),
            (Phase::Greeting, _) => self.refuse(CloseCode::Protocol, "the first message must be Hello"),
            (_, ClientMessage::Hello(_)) => self.refuse(CloseCode::Protocol, "a second Hello"),
            (_, ClientMessage::Want(wants)) => self.want(&wants),
            (_, ClientMessage::Cancel(ids)) => self.cancel(&ids),
            (_, ClientMessage::SetView(view)) => self.set_view(now, view),
            (_, ClientMessage::WantScenePages(pages)) => self.want_pages(&pages),
        }
        if !had_work {
            self.offered = now;
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

    fn refuse(&mut self, code: CloseCode, reason: &str) {
        self.end(Close::new(code, reason), true);
    }

    fn end(&mut self, close: Close, tell: bool) {
        if self.phase == Phase::Closed {
            return;
        }
        self.phase = Phase::Closed;
        self.control.clear();
        self.abandoned.clear();
        self.scheduler.clear();
        self.push = Vec::new();
        self.handed = HashMap::new();
        self.unasked = HashSet::new();
        self.pushed_parts = HashMap::new();
        self.bases_left = HashSet::new();
        self.share = None;
        if tell {
            self.control.push_back(ServerMessage::Close(close.clone()));
        }
        self.close = Some(close);
    }

    fn tell(&mut self, message: ServerMessage) {
        if self.control.len() < MAX_CONTROL_QUEUED {
            self.control.push_back(message);
        } else {
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
        if hello.fingerprint == header.fingerprint {
            let source = &self.source;
            let real = hello.have.iter().filter(|id| source.blob_len(id).is_some());
            self.handed.extend(real.map(|id| (Unit::Blob(*id), u32::MAX)));
            self.resumes = !hello.have.is_empty();
        }
        self.phase = Phase::Open;
        self.max_blob_bytes = hello.max_blob_bytes.min(MAX_BLOB_BYTES);
        self.push_budget = hello.budget_bytes;
        self.pushed_bytes = 0;
        if let Some(view) = hello.view {
            self.view = view;
        }
        self.plan();
    }

    fn set_view(&mut self, now: Time, view: View) {
        // Clients say so even where their first view is the scene's own.
        if view == self.view {
            return;
        }
        self.view = view;
        self.drop_unasked();
        // Once the client knows all pages and asks for itself, there is nothing to order.
        let all_pages = self.pages_handed >= self.source.header().page_count;
        if !(self.client_refines && all_pages && self.bases_left.is_empty()) {
            let at = self.replanned.map_or(now, |last| now.max(last + REPLAN_INTERVAL));
            self.replan_at.get_or_insert(at);
        }
    }

    /// Call when the moment given by [`ServerSession::poll_timeout`] has come; earlier is harmless.
    pub fn handle_timeout(&mut self, now: Time) {
        let ServerConfig { hello_timeout, idle_timeout, stall_timeout, .. } = *self.config;
        self.woken = now;
        if self.phase == Phase::Closed {
            return;
        }
        if self.phase == Phase::Greeting && now >= self.started + hello_timeout {
            self.refuse(CloseCode::Timeout, &format!("no Hello within {} s", hello_timeout.as_secs_f32()));
        } else if now >= self.heard + idle_timeout {
            self.refuse(CloseCode::Timeout, &format!("nothing heard for {} s", idle_timeout.as_secs_f32()));
        } else if self.has_work() && now >= self.stalled_at() + stall_timeout {
            self.refuse(CloseCode::Timeout, &format!("nothing taken for {} s", stall_timeout.as_secs_f32()));
        } else if self.replan_at.is_some_and(|at| at <= now) {
            let had_work = self.has_work();
            self.replan(now);
            if !had_work {
                self.offered = now;
            }
        }
    }

    fn stalled_at(&self) -> Time {
        self.offered.max(self.bucket.ready_at())
    }

    fn has_work(&self) -> bool {
        !self.control.is_empty()
            || !self.abandoned.is_empty()
            || !self.scheduler.is_empty()
            || self
                .push
                .last()
                .is_some_and(|(_, unit)| self.phase == Phase::Open || self.fits_push_budget(*unit))
            || (self.phase == Phase::Open && !(self.bases_told && self.done_told))
    }

    /// When to call [`ServerSession::handle_timeout`] and then [`ServerSession::poll_transmit`] again.
    #[must_use]
    pub fn poll_timeout(&self) -> Option<Time> {
        if self.phase == Phase::Closed {
            return None;
        }
        let mut next = self.heard + self.config.idle_timeout;
        if self.phase == Phase::Greeting {
            next = next.min(self.started + self.config.hello_timeout);
        }
        if let Some(at) = self.replan_at {
            next = next.min(at);
        }
        if self.has_work() {
            next = next.min(self.stalled_at() + self.config.stall_timeout);
            // Once woken for it, the driver's transport is what is waited for.
            if self.bucket.ready_at() > self.woken {
                next = next.min(self.bucket.ready_at());
            }
        }
        Some(next)
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

    /// What has been sent so far.
    #[must_use]
    pub const fn stats(&self) -> ServerStats {
        self.stats
    }
}
