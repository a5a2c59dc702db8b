//! The session: handles the server's messages, sends requests and ends the session.

use std::collections::{BTreeSet, VecDeque};
use std::time::Duration;

use super::config::{ClientConfig, Resume};
use super::downloads::{Complete, Depth, Downloads, take_first};
use super::early::Early;
use super::estimate::Estimate;
use super::event::{ClientEvent, ClientStats};
use super::keepalive::Keepalive;
use super::view_updates::ViewUpdates;
use crate::frame::{BlobPiece, FrameError, ServerFrame};
use crate::message::{
    ClientMessage, Close, CloseCode, Hello, Refused, ServerMessage, Token, VERSIONS, Welcome,
};
use crate::time::Time;
use lodestream_scene::blob::BlobId;
use lodestream_scene::limits::{MAX_HAVE, MAX_PAGES_PER_MESSAGE};
use lodestream_scene::view::View;
use lodestream_select::Wanted;

/// A session with a server.
#[derive(Debug)]
pub struct ClientSession {
    config: ClientConfig,
    close: Option<Close>,
    /// Token that is not sent yet.
    token: Option<Token>,
    /// `Hello`, if it is not sent yet.
    hello: Option<Hello>,
    /// Whether `Bye` must be sent.
    bye: bool,
    /// Number of scene pages, once `Welcome` has arrived.
    page_count: Option<u32>,
    pub(super) downloads: Downloads,
    pub(super) early: Early,
    /// Scene pages to request.
    pages: BTreeSet<u32>,
    view: ViewUpdates,
    events: VecDeque<ClientEvent>,
    estimate: Estimate,
    keepalive: Keepalive,
    /// Blob bytes received.
    blob_bytes: u64,
}

impl ClientSession {
    /// A session that begins now. `Hello` is the first message, after a token; `view` is `None` for the scene's start
    /// view.
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
            close: None,
            token: config.token.clone(),
            hello: Some(hello),
            bye: false,
            page_count: None,
            downloads: Downloads::default(),
            early: Early::default(),
            pages: BTreeSet::new(),
            view: ViewUpdates::default(),
            events: VecDeque::new(),
            estimate: Estimate::new(now),
            keepalive: Keepalive::new(&config, now),
            blob_bytes: 0,
            config,
        }
    }

    /// Handles a frame of the server.
    pub fn handle_frame(&mut self, now: Time, frame: ServerFrame) {
        match frame {
            ServerFrame::Message(message) => self.handle_message(now, message),
            ServerFrame::Piece(piece) => self.handle_piece(now, piece),
        }
    }

    /// Handles a control message of the server.
    pub fn handle_message(&mut self, now: Time, message: ServerMessage) {
        if self.close.is_some() {
            return;
        }
        self.keepalive.received(now);
        match message {
            ServerMessage::Welcome(welcome) => self.welcome(welcome),
            ServerMessage::Close(close) => self.end(Close::new(close.code, close.reason)),
            // On QUIC, blobs may overtake the control stream, but control messages keep their order.
            _ if self.page_count.is_none() => self.fail("the server's first message must be Welcome"),
            ServerMessage::ScenePage(page) => {
                for (asset, entry) in (page.first_asset..).zip(&page.assets) {
                    self.downloads.announce_base(asset, entry.base_bytes);
                }
                self.events.push_back(ClientEvent::ScenePage(page));
            }
            ServerMessage::PunctualLights(punctual_lights) => {
                self.events.push_back(ClientEvent::PunctualLights(punctual_lights))
            }
            ServerMessage::Parts(table) => self.events.push_back(ClientEvent::Parts(table)),
            ServerMessage::Animations(table) => self.events.push_back(ClientEvent::Animations(table)),
            ServerMessage::Refused(refused) => self.refused(refused),
            ServerMessage::RefusedMany(many) => many.into_iter().for_each(|refused| self.refused(refused)),
            ServerMessage::BasesSent => self.events.push_back(ClientEvent::BasesSent),
            ServerMessage::Done => self.events.push_back(ClientEvent::Done),
            ServerMessage::Pong(nonce) => {
                if let Some(rtt) = self.keepalive.pong(now, nonce) {
                    self.estimate.measured_rtt(rtt);
                }
            }
        }
    }

    fn welcome(&mut self, welcome: Welcome) {
        if self.page_count.is_some() {
            return self.fail("the server sent a second Welcome");
        }
        if !VERSIONS.contains(&welcome.version) {
            let (min, max) = (VERSIONS.start(), VERSIONS.end());
            let reason = format!(
                "the server speaks version {}, this client {min} to {max}; update one of them",
                welcome.version
            );
            return self.end(Close::new(CloseCode::Version, reason));
        }
        self.estimate.rate_hint(welcome.rate_bits_per_s);
        self.keepalive.welcomed(Duration::from_millis(u64::from(welcome.idle_timeout_ms)));
        self.page_count = Some(welcome.scene.page_count);
        self.events.push_back(ClientEvent::Connected(welcome));
        self.events.extend(self.early.take().into_iter().map(blob_event));
    }

    /// Handles a piece of a blob.
    ///
    /// Ignores pieces that do not continue what was received: they belong to a blob that was cancelled while they
    /// were in flight.
    pub fn handle_piece(&mut self, now: Time, piece: BlobPiece) {
        if self.close.is_some() {
            return;
        }
        self.keepalive.received(now);
        self.blob_bytes += piece.bytes.len() as u64;
        self.estimate.received(now, piece.bytes.len());
        match self.downloads.take(piece, self.config.max_blob_bytes) {
            Ok(Some(blob)) => self.completed(blob),
            Ok(None) => {}
            Err(why) => self.fail(&why.to_string()),
        }
    }

    /// Reports a complete run, or holds it until `Welcome` identifies the scene. If too much is held, the blob is
    /// cancelled and can be requested again.
    fn completed(&mut self, blob: Complete) {
        if self.page_count.is_some() {
            self.events.push_back(blob_event(blob));
        } else if let Err(blob) = self.early.hold(blob, self.config.max_in_flight_bytes) {
            self.downloads.cancel_received(&[blob.id]);
        }
    }

    /// Handles the reset of a blob's stream: drops what was received of the blob.
    pub fn handle_abandoned(&mut self, _now: Time, id: BlobId) {
        self.downloads.abandoned(id);
    }

    /// Handles a frame that the driver could not decode: ends the session.
    pub fn handle_frame_error(&mut self, _now: Time, error: &FrameError) {
        self.fail(&error.to_string());
    }

    /// Handles the failure or end of the transport.
    pub fn handle_lost(&mut self, _now: Time, reason: &str) {
        self.end(Close::new(CloseCode::Lost, reason));
    }

    fn refused(&mut self, Refused { id, reason }: Refused) {
        self.downloads.forget(id);
        self.events.push_back(ClientEvent::Refused { id, reason });
    }

    fn fail(&mut self, why: &str) {
        self.leave(Close::new(CloseCode::Protocol, why));
    }

    fn leave(&mut self, close: Close) {
        if self.close.is_none() {
            self.bye = true;
            self.end(close);
        }
    }

    fn end(&mut self, close: Close) {
        if self.close.is_some() {
            return;
        }
        self.downloads.end();
        self.early.take();
        self.pages.clear();
        self.close = Some(close.clone());
        self.events.push_back(ClientEvent::Closed(close));
    }

    /// Ends the session after sending `Bye`.
    pub fn close(&mut self, _now: Time, code: CloseCode, reason: &str) {
        self.leave(Close::new(code, reason));
    }

    /// Handles deadlines. Call at the moment given by [`ClientSession::poll_timeout`]; an earlier call is harmless.
    pub fn handle_timeout(&mut self, now: Time) {
        if self.close.is_none()
            && let Some(reason) = self.keepalive.overdue(now)
        {
            self.end(Close::new(CloseCode::Timeout, reason));
        }
    }

    /// When to call [`ClientSession::handle_timeout`] and then [`ClientSession::poll_transmit`].
    #[must_use]
    pub fn poll_timeout(&self) -> Option<Time> {
        if self.close.is_some() {
            return None;
        }
        let next = self.keepalive.next(self.hello.is_none());
        Some(self.view.next().map_or(next, |at| next.min(at)))
    }

    /// Time since the server's last message, if the answer to a ping is overdue. Detected within two seconds, later
    /// on links with round trips of half a second and more. The session continues.
    #[must_use]
    pub fn silence(&self, now: Time) -> Option<Duration> {
        if self.close.is_some() { None } else { self.keepalive.silence(now, self.estimate.rtt()) }
    }

    /// The next message to send. Call until `None`, while the transport accepts data.
    pub fn poll_transmit(&mut self, now: Time) -> Option<ClientMessage> {
        if self.close.is_some() {
            return std::mem::take(&mut self.bye).then_some(ClientMessage::Bye);
        }
        if let Some(token) = self.token.take() {
            return Some(ClientMessage::Token(token));
        }
        if let Some(hello) = self.hello.take() {
            self.view.hello_sent(now, hello.view.is_some());
            return Some(ClientMessage::Hello(hello));
        }
        if let Some(nonce) = self.keepalive.poll_ping(now) {
            return Some(ClientMessage::Ping(nonce));
        }
        if let Some(message) = self.downloads.poll_message() {
            return Some(message);
        }
        if !self.pages.is_empty() {
            return Some(ClientMessage::WantScenePages(take_first(&mut self.pages, MAX_PAGES_PER_MESSAGE)));
        }
        self.view.poll(now).map(ClientMessage::SetView)
    }

    /// The next event.
    pub fn poll_event(&mut self) -> Option<ClientEvent> {
        self.events.pop_front()
    }

    /// Sets the wanted blobs, most urgent first, and those to cancel.
    ///
    /// The session requests as many as keep the link busy and sends changed priorities. Less urgent blobs in flight
    /// do not count towards the limit, since the server sends them later. Returns the newly requested blobs; call
    /// again as blobs arrive.
    pub fn set_wanted(&mut self, _now: Time, wanted: &[Wanted], cancel: &[BlobId]) -> Vec<BlobId> {
        if self.close.is_some() {
            return Vec::new();
        }
        let ClientConfig { min_in_flight_bytes, max_in_flight_bytes, max_blob_bytes, .. } = self.config;
        let depth = Depth {
            ahead_bytes: self.estimate.depth_bytes(min_in_flight_bytes..=max_in_flight_bytes),
            most_bytes: max_in_flight_bytes,
            max_blob_bytes,
        };
        self.downloads.set_wanted(wanted, cancel, depth)
    }

    /// Sets the view, which is sent at most every 100 ms.
    pub fn set_view(&mut self, _now: Time, view: View) {
        match &mut self.hello {
            Some(hello) => hello.view = Some(view),
            None => self.view.set(view),
        }
    }

    /// Sends another token, because the earlier one is about to expire.
    pub fn set_token(&mut self, token: Token) {
        self.token = Some(token);
    }

    /// Whether a blob is requested and has not arrived.
    #[must_use]
    pub fn is_requested(&self, id: BlobId) -> bool {
        self.downloads.pending.get(&id).is_some_and(|pending| pending.requested.is_some())
    }

    /// The blobs that are requested and have not arrived. Once the session has ended: those that never will.
    pub fn requested(&self) -> impl Iterator<Item = BlobId> {
        self.downloads.pending.keys().copied().filter(|id| self.is_requested(*id))
    }

    /// Reports blobs that the client's cache has evicted; they may be requested again.
    pub fn evicted(&mut self, _now: Time, ids: &[BlobId]) {
        if self.close.is_none() {
            self.downloads.cancel_received(ids);
        }
    }

    /// Whether the session has ended and nothing more will be sent.
    #[must_use]
    pub const fn is_closed(&self) -> bool {
        self.close.is_some() && !self.bye
    }

    /// Counters and estimates.
    #[must_use]
    pub fn stats(&self) -> ClientStats {
        ClientStats {
            blob_bytes: self.blob_bytes,
            blobs: self.downloads.completed,
            in_flight_bytes: self.downloads.in_flight_bytes,
            in_flight_blobs: if self.close.is_none() { self.downloads.pending.len() } else { 0 },
            rtt: self.estimate.rtt(),
            bytes_per_s: self.estimate.bytes_per_s(),
        }
    }
}

fn blob_event(Complete { id, offset, total, bytes }: Complete) -> ClientEvent {
    ClientEvent::Blob { id, offset, total, bytes }
}
