//! What to request next.

use std::collections::VecDeque;
use std::ops::Range;

use lodestream_protocol::client::ClientConfig;
use lodestream_protocol::time::Time;
use lodestream_select::Priority;

use super::{InFlight, RangeSession};
use crate::ranges::directory::{Item, Location};
use crate::ranges::grouping::{Candidate, group};
use crate::ranges::items::Progress;
use crate::ranges::request::{Object, RangeRequest};

/// A chunk needs its index page, which needs a list of packs.
const MAX_NEEDED_IN_A_ROW: usize = 3;
/// See [`RangeSession::gap_bytes`].
const GAP_SHARE: f64 = 0.1;

impl RangeSession {
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
    pub(super) fn gap_bytes(&self) -> u64 {
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

    pub(super) fn request(
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
    pub(super) fn candidates(&mut self, now: Time) -> Vec<Candidate> {
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
    pub(super) fn located(&mut self) -> (Vec<Candidate>, Vec<(Item, Priority)>) {
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

    /// A request that the driver should abort: nothing in it is wanted any more, or it takes too long.
    pub fn poll_cancelled(&mut self) -> Option<u64> {
        self.cancelled.pop_front()
    }
}
