//! Responses in; failures and deadlines.

use bytes::Bytes;
use lodestream_protocol::message::{Close, CloseCode};
use lodestream_protocol::time::Time;

use super::{InFlight, RangeSession};
use crate::ranges::request::Object;
use crate::ranges::response::{self, ResponseFault, ResponseHead};

impl RangeSession {
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
            self.retry_at = Some(now + self.backoff.next_wait_at(now));
        }
        let since = self.trouble.as_ref().map_or(now, |(since, _)| *since);
        self.trouble = Some((since, why));
    }

    /// Handles a request that failed for a reason that stays.
    pub fn handle_refusal(&mut self, id: u64, why: &str) {
        let Some(flight) = self.in_flight.remove(&id) else { return };
        self.end(Close::new(CloseCode::Protocol, format!("{}: {why}", flight.object)));
    }

    /// A response that cannot be used.
    pub(super) fn fault(&mut self, now: Time, id: u64, fault: &ResponseFault) {
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

    pub(super) fn deadline(&self, flight: &InFlight) -> Time {
        let opened = self.directory.opening().is_some();
        flight.heard_at + if opened { self.config.idle_timeout } else { self.config.welcome_timeout }
    }
}
