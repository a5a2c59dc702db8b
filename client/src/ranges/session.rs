//! The session over range requests: responses in, events out; failures, deadlines and end.

use std::collections::{BTreeMap, VecDeque};
use std::ops::Range;
use std::time::Duration;

use bytes::Bytes;
use lodestream_protocol::client::{Backoff, ClientConfig, ClientEvent, ClientStats, Estimate};
use lodestream_protocol::message::{Close, CloseCode, Refused, RefusedReason, VERSIONS, Welcome};
use lodestream_protocol::time::Time;
use lodestream_scene::blob::BlobId;
use lodestream_scene::published::{HEAD_BYTES, Head, PublishedError};
use lodestream_scene::view::{Frustum, View};
use lodestream_select::priority::{DIRECTORY, refine_priority};
use lodestream_select::{Priority, State, Wanted};

use super::directory::{Directory, Item, Location};
use super::grouping::{Candidate, RangeSettings, group};
use super::items::{Items, Progress};
use super::request::{Object, RangeRequest};
use super::response::{self, ResponseFault, ResponseHead};

/// Bytes of the first request: opening, first scene pages, base meshes and index pages of most scenes.
pub(super) const FIRST_BYTES: u64 = 64 << 10;
/// Scene pages that are requested ahead.
const PAGES_AHEAD: u32 = 64;
/// Most blobs, and most of their bytes, that wait for requests.
const MAX_WANTED: usize = 4096;
/// See [`MAX_WANTED`].
const MAX_WANTED_BYTES: u64 = 4 << 20;
/// Priority of scene pages and base meshes in view.
const FIRST_FRAME: Priority = Priority::MAX;
/// Time until an item that failed twice is tried again for those that need it.
const FAILED_FOR: Duration = Duration::from_secs(5);
/// A chunk needs its index page, which needs a list of packs.
const MAX_NEEDED_IN_A_ROW: usize = 3;
/// See [`RangeSession::gap_bytes`].
const GAP_SHARE: f64 = 0.1;

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

    /// The next request to make. Call until `None`.
    pub fn poll_request(&mut self, now: Time) -> Option<RangeRequest> {
        if self.close.is_some() || self.retry_at.is_some_and(|at| now < at) {
            return None;
        }
        self.retry_at = None;
        if self.directory.opening().is_none() {
            // Without an opening nothing else is known; the front is read once.
            if self.front_request.is_some() {
                return None;
            }
            let range = self.front.len() as u64..self.front_until;
            let request = self.request(now, Object::Scene, range, VecDeque::new(), self.reload);
            self.front_request = Some(request.id);
            return Some(request);
        }
        if self.in_flight.len() >= self.settings.max_requests {
            return None;
        }
        let ClientConfig { min_in_flight_bytes, max_in_flight_bytes, .. } = self.config;
        let depth = self.estimate.depth_bytes(min_in_flight_bytes..=max_in_flight_bytes);
        let in_flight: u64 = self.in_flight.values().map(InFlight::remaining_bytes).sum();
        if in_flight >= depth {
            return None;
        }
        let candidates = self.candidates(now);
        // The requests that are left share the bytes that are missing in flight.
        let free = (self.settings.max_requests - self.in_flight.len()).max(1) as u64;
        let [least, most] = self.settings.request_bytes;
        let length = ((depth - in_flight) / free).clamp(least, most.max(least));
        let (items, range) = group(&candidates, length, self.gap_bytes(), &self.settings)?;
        let (object, reload) = items.first().map(|one| (one.object.clone(), one.reload))?;
        Some(self.request(now, object, range, items.into(), reload))
    }

    /// Most bytes between two items of a request. A request takes one of few places for a round trip, so bytes cost less
    /// than another request as long as they take less than a place's share of that time.
    fn gap_bytes(&self) -> u64 {
        let round_trip = self.estimate.rtt().unwrap_or_default().as_secs_f64();
        let share = self.estimate.bytes_per_s() * round_trip / self.settings.max_requests.max(1) as f64;
        let [least, most] = self.settings.gap_bytes;
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "saturates, and is clamped"
        )]
        let share = (share * GAP_SHARE) as u64;
        share.clamp(least, most.max(least))
    }

    fn request(
        &mut self,
        now: Time,
        object: Object,
        range: Range<u64>,
        items: VecDeque<Candidate>,
        reload: bool,
    ) -> RangeRequest {
        let id = self.next_id;
        self.next_id += 1;
        for one in &items {
            if let Some(pending) = self.items.pending.get_mut(&one.item) {
                pending.progress = Progress::Requested(id);
            }
        }
        let flight = InFlight {
            object: object.clone(),
            range: range.clone(),
            items,
            body: Vec::new(),
            body_start: range.start,
            asked_at: now,
            heard_at: now,
            answered: false,
        };
        self.in_flight.insert(id, flight);
        RangeRequest { id, object, range, reload }
    }

    /// What can be requested now. Adds what other items need first, which may itself need something.
    fn candidates(&mut self, now: Time) -> Vec<Candidate> {
        self.failed.retain(|_, until| *until > now);
        let mut candidates = Vec::new();
        for _ in 0..MAX_NEEDED_IN_A_ROW {
            let (found, needs) = self.located();
            candidates = found;
            let mut is_new = false;
            for (item, priority) in needs {
                is_new |= !self.items.pending.contains_key(&item);
                self.items.need(item, priority);
            }
            if !is_new {
                break;
            }
        }
        candidates
    }

    /// Items whose place is known, and what others need for that.
    fn located(&mut self) -> (Vec<Candidate>, Vec<(Item, Priority)>) {
        let front_end = self.front_end();
        let mut candidates = Vec::new();
        let (mut needs, mut lost): (Vec<(Item, Priority)>, Vec<Item>) = (Vec::new(), Vec::new());
        for (&item, pending) in &self.items.pending {
            if pending.progress != Progress::Waiting {
                continue;
            }
            let place = match self.directory.locate(item) {
                Location::At(place) => place,
                Location::Needs(other)
                    if self.failed.contains_key(&other)
                        || self.directory.locate(other) == Location::Nowhere =>
                {
                    lost.push(item);
                    continue;
                }
                Location::Needs(other) => {
                    needs.push((other, pending.priority));
                    continue;
                }
                Location::Nowhere => {
                    lost.push(item);
                    continue;
                }
            };
            let end = place.start + u64::from(place.bytes);
            if place.object == Object::Scene && end <= front_end && !pending.reload {
                // The front brings it.
                continue;
            }
            let to = pending.to.unwrap_or(place.bytes).min(place.bytes);
            let mut segments = place.segments;
            segments.retain(|one| one.end > pending.from && one.start < to.max(1));
            let (Some(first), Some(last)) = (segments.first(), segments.last()) else {
                lost.push(item);
                continue;
            };
            let range = place.start + u64::from(first.start)..place.start + u64::from(last.end);
            candidates.push(Candidate {
                item,
                priority: pending.priority,
                object: place.object,
                range,
                segments,
                reload: pending.reload,
            });
        }
        for item in lost {
            self.give_up(item);
        }
        (candidates, needs)
    }

    /// The end of what the first request brings.
    fn front_end(&self) -> u64 {
        let asked =
            self.front_request.and_then(|id| self.in_flight.get(&id)).map_or(0, |flight| flight.range.end);
        asked.max(self.front.len() as u64)
    }

    /// A request that the driver should abort: nothing in it is wanted any more, or it takes too long.
    pub fn poll_cancelled(&mut self) -> Option<u64> {
        self.cancelled.pop_front()
    }

    /// Handles the head of a response.
    pub fn handle_head(&mut self, now: Time, id: u64, head: &ResponseHead) {
        let stated = self.directory.head().map(|head| head.object_bytes);
        let Some(flight) = self.in_flight.get_mut(&id) else { return };
        flight.heard_at = now;
        flight.answered = true;
        let stated = match &flight.object {
            Object::Scene => stated,
            Object::Pack(_, bytes) => Some(*bytes),
        };
        let asked_at = flight.asked_at;
        match response::check(head, &flight.range, stated) {
            Ok((range, total)) => {
                if flight.object == Object::Scene {
                    self.scene_bytes = total.or(self.scene_bytes);
                }
                let whole = range.end == flight.range.end;
                if !whole && self.front_request != Some(id) {
                    return self.fault(now, id, &ResponseFault::Truncated);
                }
                flight.range.end = range.end;
                self.estimate.measured_rtt(now.since(asked_at));
            }
            Err(fault) => self.fault(now, id, &fault),
        }
    }

    /// Handles bytes of a response, in order.
    pub fn handle_body(&mut self, now: Time, id: u64, bytes: &[u8]) {
        let Some(flight) = self.in_flight.get_mut(&id) else { return };
        if !flight.answered || bytes.len() as u64 > flight.remaining_bytes() {
            return self.fault(now, id, &ResponseFault::OtherRange);
        }
        flight.heard_at = now;
        self.blob_bytes += bytes.len() as u64;
        self.estimate.received(now, bytes.len());
        self.backoff.succeeded();
        self.trouble = None;
        let (mut complete, done) = (Vec::new(), flight.remaining_bytes() == bytes.len() as u64);
        if self.front_request == Some(id) {
            self.front.extend_from_slice(bytes);
            flight.body_start += bytes.len() as u64;
        } else {
            flight.body.extend_from_slice(bytes);
            while let Some(first) = flight.items.front()
                && first.range.end <= flight.received_to()
                && let Some(one) = flight.items.pop_front()
            {
                let at = |place: u64| {
                    usize::try_from(place.saturating_sub(flight.body_start)).unwrap_or(usize::MAX)
                };
                let taken =
                    flight.body.get(at(one.range.start)..at(one.range.end)).map(Bytes::copy_from_slice);
                complete.push((one, taken.unwrap_or_default()));
            }
            // Bytes before the next item are in none.
            let next = flight.items.front().map_or(flight.received_to(), |one| one.range.start);
            let passed = next.min(flight.received_to()).saturating_sub(flight.body_start);
            flight.body.drain(..usize::try_from(passed).unwrap_or(usize::MAX).min(flight.body.len()));
            flight.body_start += passed;
        }
        if done {
            self.in_flight.remove(&id);
        }
        for (one, bytes) in complete {
            self.deliver(now, &one, bytes);
        }
        self.read_front(now);
        if done
            && self.front_request == Some(id)
            && self.directory.opening().is_none()
            && self.close.is_none()
        {
            self.continue_front();
        }
    }

    /// Lets the front be continued if the opening is longer than what was requested.
    fn continue_front(&mut self) {
        match Head::parse(&self.front) {
            Ok(head)
                if self.front.len() as u64 == self.front_until && head.parts_start() > self.front_until =>
            {
                self.front_until = head.parts_start() + FIRST_BYTES;
                self.front_request = None;
            }
            Ok(_) => self.fail(&PublishedError::Truncated("its opening")),
            Err(why) => self.fail(&why),
        }
    }

    /// Handles the end of a response.
    pub fn handle_end(&mut self, now: Time, id: u64) {
        if self.in_flight.contains_key(&id) {
            self.handle_failure(now, id, "the response ended early");
        }
    }

    /// Handles a request that failed: no connection, or a lost one.
    pub fn handle_failure(&mut self, now: Time, id: u64, why: &str) {
        let Some(flight) = self.in_flight.remove(&id) else { return };
        self.items.release(id);
        let why = format!("{}: {why}", flight.object);
        if self.directory.opening().is_none() {
            return self.end(Close::new(CloseCode::Lost, why));
        }
        // Several requests fail together: they count as one.
        if self.retry_at.is_none() {
            let spread = (id as u32).wrapping_mul(0x9E37_79B9);
            self.retry_at = Some(now + self.backoff.next_wait(spread));
        }
        let since = self.trouble.as_ref().map_or(now, |(since, _)| *since);
        self.trouble = Some((since, why));
    }

    /// A response that cannot be used.
    fn fault(&mut self, now: Time, id: u64, fault: &ResponseFault) {
        self.cancelled.push_back(id);
        if fault.passes() {
            return self.handle_failure(now, id, &fault.to_string());
        }
        let Some(flight) = self.in_flight.remove(&id) else { return };
        let why = format!("{}: {fault}", flight.object);
        match (&flight.object, fault) {
            (_, ResponseFault::NoRanges | ResponseFault::Encoded) => {
                self.end(Close::new(CloseCode::Protocol, why));
            }
            (Object::Scene, _) if self.directory.opening().is_some() => {
                self.end(Close::new(CloseCode::Lost, why));
            }
            (Object::Scene, ResponseFault::Missing(_)) => self.end(Close::new(CloseCode::NoSuchScene, why)),
            (Object::Scene, ResponseFault::Refused(_)) => self.end(Close::new(CloseCode::Unauthorised, why)),
            (Object::Scene, _) => self.end(Close::new(CloseCode::Protocol, why)),
            (Object::Pack(..), _) => {
                tracing::warn!("{why}");
                self.trouble = Some((now, why));
                for one in flight.items {
                    self.give_up(one.item);
                }
            }
        }
    }

    /// Reads what has arrived of the published scene's beginning.
    fn read_front(&mut self, now: Time) {
        if self.close.is_some() || self.front.is_empty() {
            return;
        }
        if self.directory.opening().is_none() && !self.open() {
            return;
        }
        loop {
            let arrived = self.front.len() as u64;
            let here = self.items.pending.iter().find_map(|(&item, pending)| {
                let Location::At(place) = self.directory.locate(item) else { return None };
                let end = place.start + u64::from(place.bytes);
                let is_here = pending.progress == Progress::Waiting
                    && !pending.reload
                    && place.object == Object::Scene
                    && end <= arrived;
                is_here.then_some(Candidate {
                    item,
                    priority: pending.priority,
                    object: place.object,
                    range: place.start..end,
                    segments: place.segments,
                    reload: false,
                })
            });
            let Some(one) = here else { return };
            let [start, end] =
                [one.range.start, one.range.end].map(|at| usize::try_from(at).unwrap_or(usize::MAX));
            let bytes = self.front.get(start..end).map(Bytes::copy_from_slice).unwrap_or_default();
            self.deliver(now, &one, bytes);
            if self.close.is_some() {
                return;
            }
        }
    }

    /// Reads the opening, if it has arrived; returns whether it has.
    fn open(&mut self) -> bool {
        if self.front.len() < HEAD_BYTES {
            return false;
        }
        let head = match Head::parse(&self.front) {
            Ok(head) => head,
            Err(why) => {
                self.fail(&why);
                return false;
            }
        };
        if self.scene_bytes.is_some_and(|bytes| bytes != head.object_bytes) {
            self.fail(&PublishedError::Truncated("its parts"));
            return false;
        }
        let end = usize::try_from(head.parts_start()).unwrap_or(usize::MAX);
        let Some(bytes) = self.front.get(HEAD_BYTES..end) else { return false };
        let opening = match head.opening(bytes) {
            Ok(opening) => opening,
            Err(why) => {
                self.fail(&why);
                return false;
            }
        };
        let lights = opening.punctual_lights();
        let welcome = Welcome {
            version: *VERSIONS.end(),
            session: 0,
            rate_bits_per_s: 0,
            idle_timeout_ms: 0,
            scene: opening.header.clone(),
        };
        self.directory.open(head, opening);
        self.events.push_back(ClientEvent::Connected(welcome));
        self.events.extend(lights.map(ClientEvent::PunctualLights));
        self.need_pages();
        true
    }

    /// Requests the next scene pages.
    fn need_pages(&mut self) {
        let Some(opening) = self.directory.opening() else { return };
        let frustum = self.view.map(|view| (view.frustum(), view.eye));
        let hidden = refine_priority(1.0, 1.0, 1.0);
        let eye = opening.header.camera.eye;
        let priorities: Vec<(u32, Priority)> = (self.next_page..)
            .zip(opening.pages.iter().skip(self.next_page as usize).take(PAGES_AHEAD as usize))
            .map(|(number, place)| {
                let seen = frustum
                    .as_ref()
                    .is_none_or(|(frustum, from)| sees(frustum, from, &eye, place.center, place.radius));
                // The first page has what is nearest and largest.
                (number, if seen || number == 0 { FIRST_FRAME } else { hidden })
            })
            .collect();
        let unseen_from = self.pages_seen_to();
        let known = self.next_page >= unseen_from;
        for (number, priority) in priorities {
            // A page is of no use before those that precede it.
            let priority = if number < unseen_from { FIRST_FRAME } else { priority };
            if self.directory.page(number).is_none() {
                self.items.need(Item::Page(number), priority);
            }
        }
        if known && !self.pages_in_view_known && self.view.is_some() {
            self.pages_in_view_known = true;
            self.events.push_back(ClientEvent::BasesSent);
        }
    }

    /// Number of the page behind the last one in view.
    fn pages_seen_to(&self) -> u32 {
        let (Some(opening), Some(view)) = (self.directory.opening(), &self.view) else { return 0 };
        let frustum = view.frustum();
        let eye = opening.header.camera.eye;
        let seen = |place: &lodestream_scene::published::PagePlace| {
            sees(&frustum, &view.eye, &eye, place.center, place.radius)
        };
        opening
            .pages
            .iter()
            .rposition(seen)
            .map_or(0, |at| u32::try_from(at).unwrap_or(u32::MAX).saturating_add(1))
    }

    /// Takes an item's bytes.
    fn deliver(&mut self, now: Time, one: &Candidate, bytes: Bytes) {
        let Some(pending) = self.items.pending.get(&one.item) else { return };
        let (wanted, from) = (pending.wanted, pending.from);
        let first = one.segments.first().map_or(0, |segment| segment.start);
        let intact = one.segments.iter().all(|segment| {
            let run = (segment.start - first) as usize..(segment.end - first) as usize;
            bytes.get(run).is_some_and(|run| segment.is_of(run))
        });
        if !intact {
            return self.damaged(now, one);
        }
        self.items.pending.remove(&one.item);
        let added = match one.item {
            Item::Page(number) => self.directory.add_page(number, &bytes).map(|()| self.number_pages()),
            Item::Source(number) => {
                self.directory.add_source(number, &bytes).map(|()| self.need_behind(number))
            }
            Item::TerrainTable(page) => self.directory.add_terrain_table(page, &bytes),
            Item::LightTable(page) => self.directory.add_light_table(page, &bytes),
            Item::Index(asset, page) => self.directory.add_index(asset, page, &bytes).map(|length| {
                self.blobs += 1;
                let bytes = bytes.slice(..length);
                let total = u32::try_from(length).unwrap_or(u32::MAX);
                self.events.push_back(ClientEvent::Blob {
                    id: BlobId::index_page(asset, page),
                    offset: 0,
                    total,
                    bytes,
                });
            }),
            Item::Blob(id) => {
                self.blobs += 1;
                let total = match self.directory.locate(one.item) {
                    Location::At(place) => place.bytes,
                    Location::Needs(_) | Location::Nowhere => 0,
                };
                // The core continues a chunk at the byte that it has.
                let skipped = if wanted { from.saturating_sub(first) as usize } else { 0 };
                let bytes = bytes.slice(skipped.min(bytes.len())..);
                let offset = first + u32::try_from(skipped).unwrap_or(u32::MAX);
                self.events.push_back(ClientEvent::Blob { id, offset, total, bytes });
                Ok(())
            }
        };
        // The hash matches, so the scene was published like this.
        if let Err(why) = added {
            self.fail(&why);
        }
    }

    /// Announces scene pages in order, with the base meshes that come ahead.
    fn number_pages(&mut self) {
        let ahead = self.flight_end();
        while let Some(record) = self.directory.next_in_order(self.next_page) {
            let page = record.page.clone();
            let assets = page.first_asset
                ..page.first_asset.saturating_add(u32::try_from(page.assets.len()).unwrap_or(0));
            self.events.push_back(ClientEvent::ScenePage(page));
            for asset in assets {
                self.need_ahead(Item::Blob(BlobId::base(asset)), FIRST_FRAME - 1, ahead);
            }
            self.need_ahead(Item::Source(self.next_page), DIRECTORY, ahead);
            self.next_page += 1;
        }
        self.need_pages();
    }

    /// Takes what lies behind a list of packs, as far as it comes ahead.
    fn need_behind(&mut self, number: u32) {
        let ahead = self.flight_end();
        for item in self.directory.behind_source(number) {
            self.need_ahead(item, DIRECTORY, ahead);
        }
    }

    /// End of what is read without the core's request: the flight, and what the first request brings.
    fn flight_end(&self) -> u64 {
        let flight = self.directory.head().zip(self.directory.opening());
        let flight =
            flight.map_or(0, |(head, opening)| head.parts_start().saturating_add(opening.flight_bytes));
        flight.max(self.front_end())
    }

    fn need_ahead(&mut self, item: Item, priority: Priority, front_end: u64) {
        if let Location::At(place) = self.directory.locate(item)
            && place.object == Object::Scene
            && place.start + u64::from(place.bytes) <= front_end
        {
            self.items.need(item, priority);
        }
    }

    /// An item's bytes do not have their hash. They are fetched once more, past all caches.
    fn damaged(&mut self, now: Time, one: &Candidate) {
        let Some(pending) = self.items.pending.get_mut(&one.item) else { return };
        let Candidate { object, range, .. } = one;
        let why = format!(
            "{object}: bytes {} to {} do not have their hash: the file is damaged or was replaced; publish the scene again",
            range.start, range.end
        );
        tracing::warn!("{why}");
        pending.progress = Progress::Waiting;
        if !std::mem::replace(&mut pending.reload, true) {
            return;
        }
        match one.item {
            Item::Page(_) => self.end(Close::new(CloseCode::Lost, why)),
            item => {
                self.trouble = Some((now, why));
                self.failed.insert(item, now + FAILED_FOR);
                self.give_up(item);
            }
        }
    }

    /// Drops an item. The core tries a blob again later.
    fn give_up(&mut self, item: Item) {
        let pending = self.items.pending.remove(&item);
        if let (Some(id), true) = (item.blob(), pending.is_some_and(|pending| pending.wanted)) {
            let Refused { id, reason } = Refused { id, reason: RefusedReason::Unreadable };
            self.events.push_back(ClientEvent::Refused { id, reason });
        }
    }

    fn fail(&mut self, why: &PublishedError) {
        self.end(Close::new(CloseCode::Protocol, format!("the published scene: {why}")));
    }

    fn end(&mut self, close: Close) {
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

    /// Handles deadlines. Call at the moment given by [`RangeSession::poll_timeout`]; an earlier call is harmless.
    pub fn handle_timeout(&mut self, now: Time) {
        let late: Vec<u64> = self
            .in_flight
            .iter()
            .filter(|(_, flight)| self.deadline(flight) <= now)
            .map(|(id, _)| *id)
            .collect();
        for id in late {
            self.cancelled.push_back(id);
            self.handle_failure(now, id, "the server does not answer");
        }
    }

    fn deadline(&self, flight: &InFlight) -> Time {
        let opened = self.directory.opening().is_some();
        flight.heard_at + if opened { self.config.idle_timeout } else { self.config.welcome_timeout }
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
    fn cancel_unwanted(&mut self) {
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

/// Whether a page's sphere, relative to the start camera's eye, reaches into the view.
#[expect(clippy::cast_possible_truncation, reason = "relative to the eye, as spheres of instances are")]
fn sees(frustum: &Frustum, from: &[f64; 3], eye: &[f64; 3], center: [f32; 3], radius: f32) -> bool {
    let relative = [0, 1, 2].map(|axis| (f64::from(center[axis]) + eye[axis] - from[axis]) as f32);
    frustum.sees(relative.into(), radius)
}
