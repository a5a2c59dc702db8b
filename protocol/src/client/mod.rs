//! The client's side of a session, sans-IO.
//!
//! The session keeps the books of what has been asked for, puts pieces together, and decides how much of
//! what the selection wants is asked for now. It does not know what a chunk is: the caller selects,
//! caches and applies.

mod backoff;
mod estimate;
#[cfg(test)]
mod tests;

use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::time::Duration;

use bytes::Bytes;

use crate::blob::{BlobId, BlobPart};
use crate::frame::{BlobPiece, FrameError, ServerFrame};
use crate::limits::{MAX_BLOB_BYTES, MAX_HAVE, MAX_IDS_PER_MESSAGE, MAX_PAGES_PER_MESSAGE};
use crate::message::{
    ClientMessage, Close, CloseCode, Hello, RefusedReason, ServerMessage, VERSIONS, Want, Welcome,
};
use crate::scene::{Fingerprint, ScenePage};
use crate::select::{Priority, State, Wanted};
use crate::time::Time;
use crate::view::View;

pub use backoff::Backoff;
use estimate::Estimate;

/// Bytes assumed of a blob whose length is not known yet.
const ASSUMED_BYTES: u32 = 1500;
/// Most blobs that are partly here. A server keeps fewer than ten open at once.
const MAX_PARTIAL: usize = 1024;
/// Most blobs held that came before `Welcome`. A server pushes some tens before it hears `Hello`.
const MAX_EARLY: usize = 256;
/// Least time between two `SetView`.
const VIEW_INTERVAL: Duration = Duration::from_millis(100);
/// Change of priority that is worth telling: a quarter octave of screen error.
const PRIORITY_CHANGE: Priority = 1 << 21;
/// Pings while nothing is heard otherwise; short enough for a round trip soon after the start.
const FIRST_PING: Duration = Duration::from_millis(500);

/// Knobs of a client session.
#[derive(Clone, Debug)]
pub struct ClientConfig {
    /// Name of the scene; empty for the server's default.
    pub scene: String,
    /// Longest blob taken, in bytes.
    pub max_blob_bytes: u32,
    /// Bytes that the client can hold in all.
    pub budget_bytes: u64,
    /// Least bytes kept in flight.
    pub min_in_flight_bytes: u64,
    /// Most bytes kept in flight.
    pub max_in_flight_bytes: u64,
    /// Time in which `Welcome` must come.
    pub welcome_timeout: Duration,
    /// Silence after which the connection counts as lost.
    pub idle_timeout: Duration,
}

impl Default for ClientConfig {
    fn default() -> Self {
        Self {
            scene: String::new(),
            max_blob_bytes: MAX_BLOB_BYTES,
            budget_bytes: 512 << 20,
            min_in_flight_bytes: 16 * 1024,
            max_in_flight_bytes: 4 << 20,
            welcome_timeout: Duration::from_secs(10),
            idle_timeout: Duration::from_secs(20),
        }
    }
}

/// What a client keeps from one session to the next.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Resume {
    /// Fingerprint of the scene.
    pub fingerprint: Fingerprint,
    /// Base meshes and index pages that are still here ([`crate::select::AssetState::held`]). Chunks need
    /// not be listed: the server sends them unasked only to clients that hold nothing.
    pub have: Vec<BlobId>,
}

/// What happened.
#[derive(Clone, Debug, PartialEq)]
pub enum ClientEvent {
    /// The server has answered. A fingerprint other than before means another scene: start over.
    Connected(Welcome),
    /// A page of the scene description came.
    ScenePage(ScenePage),
    /// A blob, or the part of it that was sent, is complete, asked for or not. Told after
    /// [`ClientEvent::Connected`] even where it came before.
    Blob {
        /// The blob.
        id: BlobId,
        /// Where in the blob the bytes begin: 0, or the `held` of what was wanted.
        offset: u32,
        /// Length of the whole blob.
        total: u32,
        /// The bytes.
        bytes: Bytes,
    },
    /// A blob will not come; [`RefusedReason::QueueFull`] means: ask again later.
    Refused {
        /// The blob.
        id: BlobId,
        /// Why.
        reason: RefusedReason,
    },
    /// The server has handed over all visible base meshes.
    BasesSent,
    /// The server has nothing queued.
    Done,
    /// The session has ended; the last event.
    Closed(Close),
}

/// Counters of a session.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ClientStats {
    /// Blob bytes received, duplicates and cancelled ones included.
    pub blob_bytes: u64,
    /// Blobs completed.
    pub blobs: u64,
    /// Bytes asked for that have not arrived.
    pub in_flight_bytes: u64,
    /// Blobs asked for that have not arrived.
    pub in_flight_blobs: usize,
    /// Round trip, once measured.
    pub rtt: Option<Duration>,
    /// Estimated throughput.
    pub bytes_per_s: f64,
}

/// A blob that is asked for, or arriving.
#[derive(Debug, Default)]
struct Pending {
    /// The priority last told; `None` for what the server sends unasked.
    asked: Option<Priority>,
    /// The length that scene or index announced.
    expected: Option<u32>,
    /// The part that is asked for: from here, to here if not to the blob's end.
    from: u32,
    to: Option<u32>,
    /// Where the run ends that the pieces belong to, once the first is here.
    end: Option<u32>,
    received: Vec<u8>,
}

impl Pending {
    fn left(&self) -> u64 {
        let end = self.end.or(self.to).or(self.expected).unwrap_or(ASSUMED_BYTES);
        u64::from(end).saturating_sub(u64::from(self.from) + self.received.len() as u64)
    }
}

/// A session with a server.
#[derive(Debug)]
pub struct ClientSession {
    config: ClientConfig,
    close: Option<Close>,
    welcome: Option<(u32, Duration)>,
    hello: Option<Hello>,
    pending: BTreeMap<BlobId, Pending>,
    /// Sum of what is left of the blobs asked for.
    in_flight_bytes: u64,
    /// Blobs that overtook `Welcome`, and their bytes: only it tells what scene they are of.
    early: Vec<ClientEvent>,
    early_bytes: u64,
    /// To be told: requests new or changed, and requests taken back.
    wants: BTreeSet<BlobId>,
    cancels: BTreeSet<BlobId>,
    pages: BTreeSet<u32>,
    view: Option<View>,
    view_sent: Option<Time>,
    bye: bool,
    events: VecDeque<ClientEvent>,
    base_bytes: BTreeMap<u32, u32>,
    estimate: Estimate,
    started: Time,
    heard: Time,
    ping_due: Time,
    ping: Option<(u32, Time)>,
    pings: u32,
    blob_bytes: u64,
    blobs: u64,
}

impl ClientSession {
    /// A session that begins now; `Hello` is the first thing to transmit. `view` may be `None` where the
    /// scene's start view is wanted.
    #[must_use]
    pub fn new(config: ClientConfig, view: Option<View>, resume: Resume, now: Time) -> Self {
        let Resume { fingerprint, mut have } = resume;
        have.truncate(MAX_HAVE);
        let ClientConfig { max_blob_bytes, budget_bytes, .. } = config;
        let hello = Hello {
            view,
            max_blob_bytes,
            budget_bytes,
            fingerprint,
            have,
            ..Hello::new(config.scene.as_str())
        };
        Self {
            config,
            close: None,
            welcome: None,
            hello: Some(hello),
            pending: BTreeMap::new(),
            in_flight_bytes: 0,
            early: Vec::new(),
            early_bytes: 0,
            wants: BTreeSet::new(),
            cancels: BTreeSet::new(),
            pages: BTreeSet::new(),
            view: None,
            view_sent: None,
            bye: false,
            events: VecDeque::new(),
            base_bytes: BTreeMap::new(),
            estimate: Estimate::new(now),
            started: now,
            heard: now,
            ping_due: now,
            ping: None,
            pings: 0,
            blob_bytes: 0,
            blobs: 0,
        }
    }

    /// Takes a frame of the server.
    pub fn handle_frame(&mut self, now: Time, frame: ServerFrame) {
        match frame {
            ServerFrame::Message(message) => self.handle_message(now, message),
            ServerFrame::Piece(piece) => self.handle_piece(now, piece),
        }
    }

    /// Takes a control message of the server.
    pub fn handle_message(&mut self, now: Time, message: ServerMessage) {
        if self.close.is_some() {
            return;
        }
        self.heard = now;
        match message {
            ServerMessage::Welcome(welcome) => self.welcome(welcome),
            ServerMessage::Close(close) => self.end(close),
            // On QUIC, blobs may overtake the control stream, but control messages keep their order.
            _ if self.welcome.is_none() => self.fail("the server's first message must be Welcome"),
            ServerMessage::ScenePage(page) => {
                for (asset, entry) in (page.first_asset..).zip(&page.assets) {
                    self.base_bytes.insert(asset, entry.base_bytes);
                }
                self.events.push_back(ClientEvent::ScenePage(page));
            }
            ServerMessage::Refused(refused) => {
                self.forget(refused.id);
                self.events.push_back(ClientEvent::Refused { id: refused.id, reason: refused.reason });
            }
            ServerMessage::BasesSent => self.events.push_back(ClientEvent::BasesSent),
            ServerMessage::Done => self.events.push_back(ClientEvent::Done),
            ServerMessage::Pong(nonce) => {
                if let Some((sent_nonce, sent)) = self.ping
                    && sent_nonce == nonce
                {
                    self.estimate.measured_rtt(now.since(sent));
                    self.ping = None;
                }
            }
        }
    }

    fn welcome(&mut self, welcome: Welcome) {
        if self.welcome.is_some() {
            return self.fail("the server sent a second Welcome");
        }
        if !VERSIONS.contains(&welcome.version) {
            let reason = format!("the server speaks version {}, this viewer {VERSIONS:?}", welcome.version);
            return self.end(Close::new(CloseCode::Version, reason));
        }
        self.estimate.rate_hint(welcome.rate_bits_per_s);
        let idle = Duration::from_millis(u64::from(welcome.idle_timeout_ms));
        self.welcome = Some((welcome.scene.page_count, idle));
        self.events.push_back(ClientEvent::Connected(welcome));
        self.events.extend(std::mem::take(&mut self.early));
    }

    /// Tells of a blob, or keeps it until `Welcome` has told what scene it is of. What would be too much to keep
    /// is given back to the server, to be asked for again.
    fn arrived(&mut self, id: BlobId, offset: u32, total: u32, bytes: Bytes) {
        let length = bytes.len() as u64;
        let event = ClientEvent::Blob { id, offset, total, bytes };
        if self.welcome.is_some() {
            self.events.push_back(event);
        } else if self.early.len() < MAX_EARLY
            && self.early_bytes.saturating_add(length) <= self.config.max_in_flight_bytes
        {
            self.early_bytes += length;
            self.early.push(event);
        } else {
            self.cancels.insert(id);
        }
    }

    /// Takes a piece of a blob.
    ///
    /// Pieces that do not continue what is here are passed over: they belong to a blob that was cancelled
    /// while they were under way.
    pub fn handle_piece(&mut self, now: Time, piece: BlobPiece) {
        if self.close.is_some() {
            return;
        }
        self.heard = now;
        self.blob_bytes += piece.bytes.len() as u64;
        self.estimate.received(now, piece.bytes.len());
        let BlobPiece { id, offset, end: run_end, total, bytes } = piece;
        let end = u64::from(offset) + bytes.len() as u64;
        if total > self.config.max_blob_bytes || run_end > total || end > u64::from(run_end) {
            return self.fail(&format!("{id} is longer than announced or allowed"));
        }
        let known_base = match id {
            BlobId::Asset { asset, part: BlobPart::Base } => self.base_bytes.get(&asset).copied(),
            _ => None,
        };
        if offset > 0 && !self.pending.contains_key(&id) {
            return;
        }
        let begins = self.pending.get(&id).map_or(0, |pending| pending.from) == offset;
        if begins && self.pending.values().filter(|p| !p.received.is_empty()).count() >= MAX_PARTIAL {
            return self.fail("too many blobs at once");
        }
        let pending = self.pending.entry(id).or_default();
        pending.expected = pending.expected.or(known_base);
        if let Some(expected) = pending.expected
            && expected != total
        {
            return self.fail(&format!("{id} has {total} bytes, but {expected} were announced"));
        }
        if begins {
            // The length is the peer's word: memory is taken as bytes arrive, not in advance.
            let before = pending.left();
            pending.received.clear();
            pending.end = Some(run_end);
            let after = pending.left();
            if pending.asked.is_some() {
                self.in_flight_bytes = self.in_flight_bytes.saturating_sub(before).saturating_add(after);
            }
        } else if u64::from(pending.from) + pending.received.len() as u64 != u64::from(offset)
            || pending.end != Some(run_end)
        {
            return;
        }
        let before = pending.left();
        pending.received.extend_from_slice(&bytes);
        if pending.asked.is_some() {
            self.in_flight_bytes = self.in_flight_bytes.saturating_sub(before - pending.left());
        }
        if end == u64::from(run_end) {
            let offset = pending.from;
            let bytes = Bytes::from(std::mem::take(&mut pending.received));
            // Nothing of it is left in flight.
            self.pending.remove(&id);
            self.wants.remove(&id);
            self.cancels.remove(&id);
            self.blobs += 1;
            self.arrived(id, offset, total, bytes);
        }
    }

    /// Drops all that is known of a request.
    fn forget(&mut self, id: BlobId) {
        if let Some(pending) = self.pending.remove(&id)
            && pending.asked.is_some()
        {
            self.in_flight_bytes = self.in_flight_bytes.saturating_sub(pending.left());
        }
        self.wants.remove(&id);
    }

    /// The stream of a blob was reset: what came of it is dropped.
    pub fn handle_abandoned(&mut self, _now: Time, id: BlobId) {
        // A blob that was asked for again since is still to come, on another stream.
        if let Some(pending) = self.pending.get_mut(&id) {
            let before = pending.left();
            pending.received.clear();
            pending.end = None;
            if pending.asked.is_some() {
                let in_flight = self.in_flight_bytes.saturating_sub(before);
                self.in_flight_bytes = in_flight.saturating_add(pending.left());
            } else {
                self.pending.remove(&id);
            }
        }
    }

    /// Takes what the driver could not decode: ends the session.
    pub fn handle_frame_error(&mut self, _now: Time, error: &FrameError) {
        self.fail(&error.to_string());
    }

    /// The transport failed or ended.
    pub fn handle_lost(&mut self, _now: Time, reason: &str) {
        self.end(Close::new(CloseCode::Lost, reason));
    }

    fn fail(&mut self, why: &str) {
        self.bye = true;
        self.end(Close::new(CloseCode::Protocol, why));
    }

    fn end(&mut self, close: Close) {
        if self.close.is_some() {
            return;
        }
        self.pending.clear();
        self.in_flight_bytes = 0;
        self.wants.clear();
        self.cancels.clear();
        self.pages.clear();
        self.early.clear();
        self.close = Some(close.clone());
        self.events.push_back(ClientEvent::Closed(close));
    }

    /// Leaves: `Bye` is sent, then the session is closed.
    pub fn close(&mut self, _now: Time, code: CloseCode, reason: &str) {
        if self.close.is_none() {
            self.bye = true;
            self.end(Close::new(code, reason));
        }
    }

    /// Call when the moment given by [`ClientSession::poll_timeout`] has come; earlier is harmless.
    pub fn handle_timeout(&mut self, now: Time) {
        let ClientConfig { welcome_timeout, idle_timeout, .. } = self.config;
        if self.close.is_some() {
            return;
        }
        if self.welcome.is_none() && now >= self.started + welcome_timeout {
            let reason = format!("no answer within {} s", welcome_timeout.as_secs_f32());
            self.end(Close::new(CloseCode::Timeout, reason));
        } else if now >= self.heard + idle_timeout {
            let reason = format!("nothing heard for {} s", idle_timeout.as_secs_f32());
            self.end(Close::new(CloseCode::Timeout, reason));
        }
    }

    /// When to call [`ClientSession::handle_timeout`] and then [`ClientSession::poll_transmit`].
    #[must_use]
    pub fn poll_timeout(&self) -> Option<Time> {
        if self.close.is_some() {
            return None;
        }
        let mut next = self.heard + self.config.idle_timeout;
        if self.welcome.is_none() {
            next = next.min(self.started + self.config.welcome_timeout);
        }
        if self.hello.is_none() {
            next = next.min(self.ping_due);
        }
        if self.view.is_some()
            && let Some(sent) = self.view_sent
        {
            next = next.min(sent + VIEW_INTERVAL);
        }
        Some(next)
    }

    /// The next message to send. Call until `None`, while the transport can take it.
    pub fn poll_transmit(&mut self, now: Time) -> Option<ClientMessage> {
        if self.close.is_some() {
            return std::mem::take(&mut self.bye).then_some(ClientMessage::Bye);
        }
        if let Some(hello) = self.hello.take() {
            // A view that the server has not heard of yet need not wait.
            self.view_sent = hello.view.map(|_| now);
            return Some(ClientMessage::Hello(hello));
        }
        if now >= self.ping_due {
            // Often at first, for the round trip; then to stay well within the server's patience.
            let patience = self.welcome.map_or(FIRST_PING, |(_, idle)| (idle / 3).max(FIRST_PING));
            let patience = patience.min(self.config.idle_timeout / 3);
            self.ping_due = now + if self.pings < 4 { FIRST_PING.min(patience) } else { patience };
            self.pings = self.pings.wrapping_add(1);
            self.ping = Some((self.pings, now));
            return Some(ClientMessage::Ping(self.pings));
        }
        if !self.cancels.is_empty() {
            return Some(ClientMessage::Cancel(take_first(&mut self.cancels, MAX_IDS_PER_MESSAGE)));
        }
        if !self.wants.is_empty() {
            let ids = take_first(&mut self.wants, MAX_IDS_PER_MESSAGE);
            let mut wants: Vec<Want> = ids
                .into_iter()
                .filter_map(|id| {
                    let &Pending { asked, from, to, .. } = self.pending.get(&id)?;
                    Some(Want { id, priority: asked?, offset: from, end: to })
                })
                .collect();
            wants.sort_by_key(|want| (std::cmp::Reverse(want.priority), want.id));
            return Some(ClientMessage::Want(wants));
        }
        if !self.pages.is_empty() {
            return Some(ClientMessage::WantScenePages(take_first(&mut self.pages, MAX_PAGES_PER_MESSAGE)));
        }
        if self.view_sent.is_none_or(|sent| now >= sent + VIEW_INTERVAL)
            && let Some(view) = self.view.take()
        {
            self.view_sent = Some(now);
            return Some(ClientMessage::SetView(view));
        }
        None
    }

    /// The next thing that happened.
    pub fn poll_event(&mut self) -> Option<ClientEvent> {
        self.events.pop_front()
    }

    /// Tells the session what the selection wants, most urgent first, and what is no longer needed. The
    /// session asks for as much of it as keeps the link busy, tells the server of changed priorities and
    /// cancels the rest. What is under way and less urgent does not count: the server sends it later. Gives the blobs
    /// newly asked for; call again as blobs arrive.
    pub fn set_wanted(&mut self, _now: Time, wanted: &[Wanted], cancel: &[BlobId]) -> Vec<BlobId> {
        if self.close.is_some() {
            return Vec::new();
        }
        for &id in cancel {
            if self.pending.get(&id).is_some_and(|pending| pending.asked.is_some()) {
                self.forget(id);
                self.cancels.insert(id);
            }
        }
        let depth =
            self.estimate.depth_bytes(self.config.min_in_flight_bytes..=self.config.max_in_flight_bytes);
        let mut asked = Vec::new();
        let mut in_flight = self.in_flight_by_urgency().into_iter().peekable();
        // Bytes under way that the server sends before what is looked at.
        let mut ahead = 0_u64;
        for &Wanted { id, priority, bytes, state, held, end, .. } in wanted {
            while let Some((_, left)) = in_flight.next_if(|(told, _)| *told >= priority) {
                ahead = ahead.saturating_add(left);
            }
            if matches!(state, State::Cached | State::Applied | State::Failed) {
                continue;
            }
            if let Some(pending) = self.pending.get_mut(&id)
                && let Some(told) = &mut pending.asked
            {
                if told.abs_diff(priority) >= PRIORITY_CHANGE {
                    *told = priority;
                    self.wants.insert(id);
                }
                continue;
            }
            if ahead >= depth
                || self.in_flight_bytes >= self.config.max_in_flight_bytes
                || bytes.is_some_and(|b| b > self.config.max_blob_bytes)
            {
                continue;
            }
            let pending = self.pending.entry(id).or_default();
            pending.asked = Some(priority);
            pending.expected = pending.expected.or(bytes);
            // What the server sends unasked begins at the blob's beginning.
            if pending.received.is_empty() {
                (pending.from, pending.to) = (held, end);
            }
            let left = pending.left();
            self.in_flight_bytes = self.in_flight_bytes.saturating_add(left);
            ahead = ahead.saturating_add(left);
            self.wants.insert(id);
            asked.push(id);
        }
        asked
    }

    /// What is under way, most urgent first: the priority last told, and bytes. What the server sends unasked comes
    /// before all that is asked for.
    fn in_flight_by_urgency(&self) -> Vec<(Priority, u64)> {
        let mut in_flight: Vec<(Priority, u64)> = self
            .pending
            .values()
            .map(|pending| (pending.asked.unwrap_or(Priority::MAX), pending.left()))
            .collect();
        in_flight.sort_unstable_by_key(|&(priority, _)| std::cmp::Reverse(priority));
        in_flight
    }

    /// Asks for scene pages ahead of their turn.
    pub fn want_scene_pages(&mut self, pages: impl IntoIterator<Item = u32>) {
        if let Some((count, _)) = self.welcome {
            self.pages.extend(pages.into_iter().filter(|page| *page < count));
        }
    }

    /// Tells the server of a new view; sent at most every 100 ms.
    pub fn set_view(&mut self, _now: Time, view: View) {
        if let Some(hello) = &mut self.hello {
            hello.view = Some(view);
        } else if view.check().is_ok() {
            self.view = Some(view);
        }
    }

    /// These blobs were dropped from the client's cache and may be asked for again.
    pub fn evicted(&mut self, _now: Time, ids: &[BlobId]) {
        if self.close.is_none() {
            self.cancels.extend(ids.iter().filter(|id| !self.pending.contains_key(id)));
        }
    }

    /// Whether the session has ended and nothing more will be sent.
    #[must_use]
    pub const fn is_closed(&self) -> bool {
        self.close.is_some() && !self.bye
    }

    /// Whether a blob has been asked for and not arrived.
    #[must_use]
    pub fn is_in_flight(&self, id: &BlobId) -> bool {
        self.pending.contains_key(id)
    }

    /// Counters and estimates.
    #[must_use]
    pub fn stats(&self) -> ClientStats {
        ClientStats {
            blob_bytes: self.blob_bytes,
            blobs: self.blobs,
            in_flight_bytes: self.in_flight_bytes,
            in_flight_blobs: self.pending.len(),
            rtt: self.estimate.rtt(),
            bytes_per_s: self.estimate.bytes_per_s(),
        }
    }
}

fn take_first<T: Ord + Copy>(set: &mut BTreeSet<T>, count: usize) -> Vec<T> {
    let mut taken = Vec::with_capacity(set.len().min(count));
    while taken.len() < count
        && let Some(first) = set.pop_first()
    {
        taken.push(first);
    }
    taken
}
