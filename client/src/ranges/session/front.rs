//! The beginning of the published scene, as the first request brings it.

use bytes::Bytes;
use lodestream_protocol::client::ClientEvent;
use lodestream_protocol::message::{VERSIONS, Welcome};
use lodestream_protocol::time::Time;
use lodestream_scene::published::{HEAD_BYTES, Head, PublishedError};
use lodestream_select::Priority;

use super::{FIRST_BYTES, RangeSession};
use crate::ranges::directory::{Item, Location};
use crate::ranges::grouping::Candidate;
use crate::ranges::items::{Pending, Progress};
use crate::ranges::request::Object;

impl RangeSession {
    /// The end of what the first request brings.
    pub(super) fn front_end(&self) -> u64 {
        let asked =
            self.front_request.and_then(|id| self.in_flight.get(&id)).map_or(0, |flight| flight.range.end);
        asked.max(self.front.len() as u64)
    }

    /// End of what is read without the core's request: the flight, and what the first request brings.
    pub(super) fn flight_end(&self) -> u64 {
        let flight = self.directory.head().zip(self.directory.opening());
        let flight =
            flight.map_or(0, |(head, opening)| head.parts_start().saturating_add(opening.flight_bytes));
        flight.max(self.front_end())
    }

    pub(super) fn need_ahead(&mut self, item: Item, priority: Priority, front_end: u64) {
        if let Location::At(place) = self.directory.locate(item)
            && place.object == Object::Scene
            && place.start + u64::from(place.bytes) <= front_end
        {
            self.items.need(item, priority);
        }
    }

    /// Lets the front be continued if the opening is longer than what was requested.
    pub(super) fn continue_front(&mut self) {
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

    /// Reads what has arrived of the published scene's beginning.
    pub(super) fn read_front(&mut self, now: Time) {
        if self.close.is_some() || self.front.is_empty() {
            return;
        }
        if self.directory.opening().is_none() && !self.open() {
            return;
        }
        // What is read may tell where more lies.
        loop {
            self.need_from_front();
            let here = self.arrived();
            if here.is_empty() {
                return;
            }
            for one in here {
                let [start, end] =
                    [one.range.start, one.range.end].map(|at| usize::try_from(at).unwrap_or(usize::MAX));
                let bytes = self.front.get(start..end).map(Bytes::copy_from_slice).unwrap_or_default();
                self.deliver(now, &one, bytes);
                if self.close.is_some() {
                    return;
                }
            }
        }
    }

    /// Adds what waiting items need first, as far as the front has it: nothing else would read it until the next
    /// selection.
    fn need_from_front(&mut self) {
        let waiting = self.items.pending.iter().filter(|(_, pending)| pending.progress == Progress::Waiting);
        let needs: Vec<_> = waiting
            .filter_map(|(&item, pending)| match self.directory.locate(item) {
                Location::Needs(other) if !self.items.pending.contains_key(&other) => {
                    Some((other, pending.priority))
                }
                _ => None,
            })
            .filter(|&(other, _)| self.is_in_front(other))
            .collect();
        for (item, priority) in needs {
            self.items.need(item, priority);
        }
    }

    fn is_in_front(&self, item: Item) -> bool {
        matches!(self.directory.locate(item), Location::At(place)
            if place.object == Object::Scene && place.start + u64::from(place.bytes) <= self.front.len() as u64)
    }

    /// Waiting items that the front has whole.
    fn arrived(&self) -> Vec<Candidate> {
        let waits = |pending: &Pending| pending.progress == Progress::Waiting && !pending.reload;
        let waiting =
            self.items.pending.iter().filter(|(item, pending)| item.may_be_in_scene() && waits(pending));
        let here = waiting.filter_map(|(&item, pending)| {
            let Location::At(place) = self.directory.locate(item) else { return None };
            let end = place.start + u64::from(place.bytes);
            (place.object == Object::Scene && end <= self.front.len() as u64).then_some(Candidate {
                item,
                priority: pending.priority,
                object: place.object,
                range: place.start..end,
                segments: place.segments,
                reload: false,
            })
        });
        here.collect()
    }

    /// Reads the opening, if it has arrived; returns whether it has.
    pub(super) fn open(&mut self) -> bool {
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
        let parts = opening.parts.table();
        let animations = opening.animation_table();
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
        self.events.extend(parts.map(ClientEvent::Parts));
        self.events.extend(animations.map(ClientEvent::Animations));
        self.need_pages();
        true
    }
}
