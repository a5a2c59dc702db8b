//! Moves a camera along its path: start, next position, and rest.

use std::time::Duration;

use lodestream_protocol::Time;
use lodestream_scene::description::Camera;
use lodestream_scene::view::View;

use super::camera_path::{CameraPath, Start};

/// Time between two positions of a camera that moves.
const FRAME: Duration = Duration::from_millis(20);

/// Progress along a path.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Phase {
    /// At the start view, until the path begins; for ever if the camera does not move.
    Waiting,
    /// Moving since a time; the next position is due at another.
    Moving { since: Time, next: Time },
    /// At the end of the path since a time.
    Resting { since: Time },
}

/// Milestones that a path may wait for.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Reached {
    pub(crate) first_frame: bool,
    pub(crate) settled: bool,
}

/// A camera and its path.
#[derive(Clone, Copy, Debug)]
pub(crate) struct CameraDrive {
    path: CameraPath,
    viewport_px: [u32; 2],
    target_px: f32,
    phase: Phase,
}

impl CameraDrive {
    pub(crate) fn new(path: CameraPath, viewport_px: [u32; 2], target_px: f32) -> Self {
        Self { path, viewport_px, target_px, phase: Phase::Waiting }
    }

    pub(crate) fn phase(&self) -> Phase {
        self.phase
    }

    /// Whether the camera moves at all.
    pub(crate) fn moves(&self) -> bool {
        self.path.moves()
    }

    /// When a moving camera came to rest.
    pub(crate) fn rest(&self) -> Option<Time> {
        match self.phase {
            Phase::Resting { since } => Some(since),
            Phase::Waiting | Phase::Moving { .. } => None,
        }
    }

    /// Whether the path begins now.
    fn begins(&self, now: Time, reached: Reached) -> bool {
        self.path.moves()
            && match self.path.start {
                Start::FirstFrame => reached.first_frame,
                Start::Settled => reached.settled,
                Start::At { seconds } => now >= Time::from(Duration::from_secs_f64(seconds)),
            }
    }

    /// When the camera moves next. A client that does not know the scene yet has reached nothing (`None`).
    pub(crate) fn next_move(&self, now: Time, reached: Option<Reached>) -> Option<Time> {
        match self.phase {
            Phase::Moving { next, .. } => Some(next),
            Phase::Waiting if reached.is_some_and(|reached| self.begins(now, reached)) => Some(Time::ZERO),
            // From that moment on it waits for the scene.
            Phase::Waiting => match self.path.start {
                Start::At { seconds } if self.path.moves() => {
                    Some(Time::from(Duration::from_secs_f64(seconds))).filter(|at| *at > now)
                }
                _ => None,
            },
            Phase::Resting { .. } => None,
        }
    }

    /// Updates the camera, whose path begins at `start`; returns the view if a move is due.
    pub(crate) fn advance(&mut self, now: Time, start: &Camera, reached: Reached) -> Option<View> {
        if self.phase == Phase::Waiting && self.begins(now, reached) {
            self.phase = Phase::Moving { since: now, next: now };
        }
        let Phase::Moving { since, next } = self.phase else { return None };
        if now < next {
            return None;
        }
        let seconds = now.since(since).as_secs_f64();
        self.phase = if seconds >= self.path.seconds {
            Phase::Resting { since: now }
        } else {
            Phase::Moving { since, next: now + FRAME }
        };
        Some(self.path.camera(start, seconds).view(self.viewport_px, self.target_px))
    }
}
