//! The client of a baseline: requests what its view needs along the camera path, and records milestones.

use std::collections::BTreeMap;
use std::time::Duration;

use lodestream_client::core::{Milestone, QUALITIES_PX};
use lodestream_client::net::Clock;
use lodestream_protocol::Time;
use lodestream_scene::View;
use tokio::time::sleep;

use super::library::Content;
use super::offer::Item;
use super::select::{ItemStates, Selection, State, select};
use super::wire::{Event, Request, Wire};
use crate::camera_drive::{CameraDrive, Reached};
use crate::camera_path::CameraPath;
use crate::quality::note_quality;
use crate::timeline::{Sample, Series, Stalls};

/// A baseline's client.
pub(super) struct Loader<'a> {
    content: &'a Content,
    most_in_flight: usize,
    clock: Clock,
    limit: Time,
    drive: CameraDrive,
    view: View,
    held: ItemStates,
    selection: Selection,
    in_flight: BTreeMap<u64, (Item, u64)>,
    asked: u64,
    /// Total length of the bodies that arrived completely.
    pub(super) body_bytes: u64,
    pub(super) first_frame: Option<Milestone>,
    pub(super) quality: [Option<Milestone>; QUALITIES_PX.len()],
    pub(super) rest_quality: [Option<Duration>; QUALITIES_PX.len()],
    pub(super) settled: Option<Milestone>,
    pub(super) series: Series,
    pub(super) stalls: Stalls,
}

impl<'a> Loader<'a> {
    /// A client whose connect call is now.
    pub(super) fn new(
        content: &'a Content,
        most_in_flight: usize,
        viewport_px: [u32; 2],
        target_px: f32,
        path: CameraPath,
        limit: Duration,
    ) -> Self {
        Self {
            content,
            most_in_flight,
            clock: Clock::start(),
            limit: Time::from(limit),
            drive: CameraDrive::new(path, viewport_px, target_px),
            view: content.stage.camera.view(viewport_px, target_px),
            held: ItemStates::nothing(content),
            selection: Selection::default(),
            in_flight: BTreeMap::new(),
            asked: 0,
            body_bytes: 0,
            first_frame: None,
            quality: [None; QUALITIES_PX.len()],
            rest_quality: [None; QUALITIES_PX.len()],
            settled: None,
            series: Series::default(),
            stalls: Stalls::default(),
        }
    }

    pub(super) fn now(&self) -> Time {
        self.clock.now()
    }

    /// When a moving camera came to rest.
    pub(super) fn rest(&self) -> Option<Time> {
        self.drive.rest()
    }

    /// Loads until the picture is settled with the camera at rest (`Ok(true)`) or the time limit (`Ok(false)`).
    /// `received` returns the bytes that the transport has delivered.
    ///
    /// # Errors
    /// The reason why the connection was lost.
    pub(super) async fn load(&mut self, mut wire: Wire, received: impl Fn() -> u64) -> Result<bool, String> {
        self.update_selection();
        loop {
            let now = self.clock.now();
            if self.move_camera(now) {
                self.update_selection();
            }
            self.note(now, received());
            if self.settled.is_some() {
                return Ok(true);
            }
            if now >= self.limit {
                return Ok(false);
            }
            self.ask(&wire).await?;
            let until = self
                .drive
                .next_move(self.clock.now(), Some(self.reached()))
                .map_or(self.limit, |next| next.min(self.limit));
            let left = Duration::from(until).saturating_sub(Duration::from(now));
            tokio::select! {
                biased;
                event = wire.events.recv() => {
                    let mut event = event;
                    let mut news = false;
                    loop {
                        match event {
                            Some(Event::Bytes) => {}
                            Some(Event::Done(number)) => {
                                if let Some((item, bytes)) = self.in_flight.remove(&number) {
                                    self.held.set(item, State::Here);
                                    self.body_bytes += bytes;
                                    news = true;
                                }
                            }
                            Some(Event::Lost(why)) => return Err(why),
                            None => return Err("the connection is closed".to_owned()),
                        }
                        event = match wire.events.try_recv() {
                            Ok(next) => Some(next),
                            Err(_) => break,
                        };
                    }
                    if news {
                        self.update_selection();
                    }
                }
                () = sleep(left) => {}
            }
        }
    }

    fn update_selection(&mut self) {
        self.selection = select(self.content, &self.held, &self.view);
    }

    /// Requests the most urgent items, up to the number of concurrent requests.
    async fn ask(&mut self, wire: &Wire) -> Result<(), String> {
        let absent = |wanted: &&super::select::MissingItem| wanted.state == State::Absent;
        let room = self.most_in_flight.saturating_sub(self.in_flight.len());
        let next: Vec<_> = self.selection.wanted.iter().filter(absent).take(room).copied().collect();
        if next.is_empty() {
            return Ok(());
        }
        for wanted in next {
            let request = Request { number: self.asked, body_bytes: wanted.bytes };
            wire.requests.send(request).await.map_err(|_| "the connection is closed".to_owned())?;
            self.in_flight.insert(self.asked, (wanted.item, wanted.bytes));
            self.held.set(wanted.item, State::Requested);
            self.asked += 1;
        }
        self.update_selection();
        Ok(())
    }

    /// Milestones that the camera path may wait for.
    fn reached(&self) -> Reached {
        Reached { first_frame: self.first_frame.is_some(), settled: self.selection.wanted.is_empty() }
    }

    /// Updates the camera; returns whether a move was due.
    fn move_camera(&mut self, now: Time) -> bool {
        let moved = self.drive.advance(now, &self.content.stage.camera, self.reached());
        self.view = moved.unwrap_or(self.view);
        moved.is_some()
    }

    /// Records the current state.
    fn note(&mut self, now: Time, bytes: u64) {
        let here = Milestone { after: Duration::from(now), bytes };
        let error_px = Some(self.selection.error_px).filter(|px| self.selection.drawable && px.is_finite());
        if let Some(error_px) = error_px {
            self.first_frame.get_or_insert(here);
            note_quality(&mut self.quality, error_px, here);
            if let Some(since) = self.rest() {
                note_quality(&mut self.rest_quality, error_px, now.since(since));
            }
        }
        self.series.push(Sample { at_ns: now.as_ns(), bytes, error_px, unoccluded_error_px: None });
        let wants = !self.selection.wanted.is_empty();
        if self.first_frame.is_some() {
            self.stalls.observe(now, bytes, wants);
        }
        let at_rest = !self.drive.moves() || self.rest().is_some();
        if at_rest && !wants {
            self.settled.get_or_insert(here);
        }
    }
}
