//! The session over range requests: responses in, events out; failures, deadlines and end.

mod delivery;
mod front;
mod pages;
mod requests;
mod responses;

use std::collections::{BTreeMap, VecDeque};
use std::ops::Range;
use std::time::Duration;

use lodestream_protocol::client::{Backoff, ClientConfig, ClientEvent, ClientStats, Estimate};
use lodestream_protocol::message::{Close, CloseCode};
use lodestream_protocol::time::Time;
use lodestream_scene::blob::BlobId;
use lodestream_scene::published::PublishedError;
use lodestream_scene::view::View;
use lodestream_select::{State, Wanted};

use super::directory::{Directory, Item};
use super::grouping::{Candidate, RangeSettings};
use super::items::Items;
use super::request::Object;

/// Bytes of the first request: opening, first scene pages, base meshes and index pages of most scenes.
const FIRST_BYTES: u64 = 64 << 10;
/// Most blobs, and most of their bytes, that wait for requests.
const MAX_WANTED: usize = 4096;
/// See [`MAX_WANTED`].
const MAX_WANTED_BYTES: u64 = 4 << 20;

/// A request that has been made.
#[derive(Debug)]
struct InFlight {
    object: Object,
    range: Range<u64>,
    /// Items in the order of the object; those that have arrived are taken out.
    items: VecDeque<Candidate>,
    /// Bytes that no item has taken yet, and where they begin.
    body: Vec<u8>,
    body_start: u64,
    asked_at: Time,
    heard_at: Time,
    answered: bool,
}

impl InFlight {
    fn received_to(&self) -> u64 {
        self.body_start + self.body.len() as u64
    }

    fn remaining_bytes(&self) -> u64 {
        self.range.end - self.received_to().min(self.range.end)
    }
}

/// A session with a published scene.
#[derive(Debug)]
pub struct RangeSession {
    config: ClientConfig,
    settings: RangeSettings,
    close: Option<Close>,
    directory: Directory,
    items: Items,
    /// Items that failed twice, until when.
    failed: BTreeMap<Item, Time>,
    in_flight: BTreeMap<u64, InFlight>,
    next_id: u64,
    cancelled: VecDeque<u64>,
    /// The beginning of the published scene, as the first request brings it.
    front: Vec<u8>,
    front_request: Option<u64>,
    /// Where the first requests end: longer than usual if the opening is.
    front_until: u64,
    /// Length of the published scene, as the host states it.
    scene_bytes: Option<u64>,
    reload: bool,
    next_page: u32,
    pages_in_view_known: bool,
    view: Option<View>,
    events: VecDeque<ClientEvent>,
    estimate: Estimate,
    backoff: Backoff,
    retry_at: Option<Time>,
    /// What is wrong for the present, and since when.
    trouble: Option<(Time, String)>,
    blob_bytes: u64,
    blobs: u64,
}

impl RangeSession {
    /// A session that begins now. `reload`: an earlier session ended because copies in caches were outdated.
    #[must_use]
    pub fn new(
        config: ClientConfig,
        settings: RangeSettings,
        view: Option<View>,
        reload: bool,
        now: Time,
    ) -> Self {
        Self {
            config,
            settings,
            close: None,
            directory: Directory::default(),
            items: Items::default(),
            failed: BTreeMap::new(),
            in_flight: BTreeMap::new(),
            next_id: 0,
            cancelled: VecDeque::new(),
            front: Vec::new(),
            front_request: None,
            front_until: FIRST_BYTES,
            scene_bytes: None,
            reload,
            next_page: 0,
            pages_in_view_known: false,
            view,
            events: VecDeque::new(),
            estimate: Estimate::new(now),
            backoff: Backoff::new(),
            retry_at: None,
            trouble: None,
            blob_bytes: 0,
            blobs: 0,
        }
    }

    pub(super) fn fail(&mut self, why: &PublishedError) {
        self.end(Close::new(CloseCode::Protocol, format!("the published scene: {why}")));
    }

    pub(super) fn end(&mut self, close: Close) {
        if self.close.is_some() {
            return;
        }
        self.cancelled.extend(self.in_flight.keys());
        self.in_flight.clear();
        self.close = Some(close.clone());
        self.events.push_back(ClientEvent::Closed(close));
    }

    /// Ends the session.
    pub fn close(&mut self, _now: Time, code: CloseCode, reason: &str) {
        self.end(Close::new(code, reason));
    }

    /// When to call [`RangeSession::handle_timeout`] and then [`RangeSession::poll_request`].
    #[must_use]
    pub fn poll_timeout(&self) -> Option<Time> {
        if self.close.is_some() {
            return None;
        }
        self.in_flight.values().map(|flight| self.deadline(flight)).chain(self.retry_at).min()
    }

    /// Time since requests fail, if they do. The session continues.
    #[must_use]
    pub fn silence(&self, now: Time) -> Option<Duration> {
        self.trouble.as_ref().map(|(since, _)| now.since(*since))
    }

    /// What is wrong for the present, for people.
    #[must_use]
    pub fn trouble(&self) -> Option<&str> {
        self.trouble.as_ref().map(|(_, why)| why.as_str())
    }

    /// The next event.
    pub fn poll_event(&mut self) -> Option<ClientEvent> {
        self.events.pop_front()
    }

    /// Sets the wanted blobs, most urgent first, and those to cancel. Returns the newly requested blobs; call again as
    /// blobs arrive.
    pub fn set_wanted(&mut self, now: Time, wanted: &[Wanted], cancel: &[BlobId]) -> Vec<BlobId> {
        if self.close.is_some() || self.directory.opening().is_none() {
            return Vec::new();
        }
        for id in cancel {
            self.items.unwant(*id);
        }
        self.cancel_unwanted();
        let (mut requested, mut waiting, mut bytes) = (Vec::new(), 0, 0_u64);
        for one in wanted {
            if matches!(one.state, State::Cached | State::Applied | State::Failed) {
                continue;
            }
            if waiting >= MAX_WANTED || bytes >= MAX_WANTED_BYTES {
                break;
            }
            waiting += 1;
            bytes = bytes.saturating_add(one.bytes.unwrap_or(0).into());
            if one.bytes.is_some_and(|bytes| bytes > self.config.max_blob_bytes) {
                continue;
            }
            if self.items.want(one.id, one.priority, one.held, one.end) {
                requested.push(one.id);
            }
        }
        self.read_front(now);
        requested
    }

    /// Aborts requests of which nothing is wanted any more.
    pub(super) fn cancel_unwanted(&mut self) {
        let idle: Vec<u64> = self
            .in_flight
            .iter()
            .filter(|(id, flight)| {
                let needed = |one: &Candidate| {
                    self.items.pending.get(&one.item).is_some_and(|pending| pending.wanted || pending.needed)
                };
                self.front_request != Some(**id) && !flight.items.iter().any(needed)
            })
            .map(|(id, _)| *id)
            .collect();
        for id in idle {
            if let Some(flight) = self.in_flight.remove(&id) {
                for one in flight.items {
                    self.items.pending.remove(&one.item);
                }
            }
            self.cancelled.push_back(id);
        }
    }

    /// Sets the view.
    pub fn set_view(&mut self, _now: Time, view: View) {
        self.view = Some(view);
        self.need_pages();
    }

    /// Whether a blob is requested and has not arrived.
    #[must_use]
    pub fn is_requested(&self, id: BlobId) -> bool {
        self.items.is_wanted(id)
    }

    /// The blobs that are requested and have not arrived.
    pub fn requested(&self) -> impl Iterator<Item = BlobId> {
        self.items.wanted()
    }

    /// Whether the session has ended.
    #[must_use]
    pub const fn is_closed(&self) -> bool {
        self.close.is_some()
    }

    /// Number of requests made.
    #[must_use]
    pub const fn requests(&self) -> u64 {
        self.next_id
    }

    /// Counters and estimates.
    #[must_use]
    pub fn stats(&self) -> ClientStats {
        ClientStats {
            blob_bytes: self.blob_bytes,
            blobs: self.blobs,
            in_flight_bytes: self.in_flight.values().map(InFlight::remaining_bytes).sum(),
            in_flight_blobs: self.items.wanted().count(),
            rtt: self.estimate.rtt(),
            bytes_per_s: self.estimate.bytes_per_s(),
        }
    }
}
