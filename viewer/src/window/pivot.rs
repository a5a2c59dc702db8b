//! What is under the pointer, about which a drag turns and to which the wheel moves. It is asked from the streaming
//! thread, and the target of the camera stands in for it until the answer comes.

use glam::DVec3;
use lodestream_client::core::Ray;
use lodestream_client::streaming::{Answer, Streaming};
use lodestream_viewing::CameraController;

use super::clicks::CLICK_PX;
use super::visible::Visible;

/// Turns of the wheel whose pivot is not known yet.
#[derive(Debug)]
struct Zoom {
    at: [f64; 2],
    lines: f64,
    answer: Answer<Option<DVec3>>,
}

/// The pivots of drag and wheel.
#[derive(Debug, Default)]
pub(super) struct Pivot {
    asked_turn: Option<Answer<Option<DVec3>>>,
    turn: Option<DVec3>,
    zoom: Option<Zoom>,
    /// The last pivot of the wheel, and where the pointer was.
    zoomed: Option<([f64; 2], Option<DVec3>)>,
}

fn ask(ray: Ray, streaming: &Streaming, visible: Visible) -> Option<Answer<Option<DVec3>>> {
    streaming.ask(move |core| visible.pick(core, ray).map(|hit| hit.place)).ok()
}

impl Pivot {
    /// Begins a drag.
    pub(super) fn press(&mut self, ray: Ray, streaming: &Streaming, visible: Visible) {
        (self.turn, self.asked_turn) = (None, ask(ray, streaming, visible));
    }

    /// Ends a drag.
    pub(super) fn release(&mut self) {
        (self.turn, self.asked_turn) = (None, None);
    }

    /// Forgets the wheel's pivot: the camera was moved otherwise.
    pub(super) fn forget_zoom(&mut self) {
        self.zoomed = None;
    }

    /// The point to turn about, if it is known.
    pub(super) fn turn(&mut self) -> Option<DVec3> {
        if let Some(asked) = &mut self.asked_turn
            && let Ok(Some(place)) = asked.take()
        {
            (self.turn, self.asked_turn) = (place, None);
        }
        self.turn
    }

    /// Turns of the wheel with the pointer at a place in pixels; returns whether the camera has moved.
    pub(super) fn wheel(
        &mut self,
        at: [f64; 2],
        lines: f64,
        controller: &mut CameraController,
        ray: Ray,
        streaming: &Streaming,
        visible: Visible,
    ) -> bool {
        let near = |place: [f64; 2]| (place[0] - at[0]).hypot(place[1] - at[1]) < CLICK_PX;
        if let Some(zoom) = &mut self.zoom {
            zoom.lines += lines;
            return false;
        }
        if let Some((_, pivot)) = self.zoomed.filter(|(place, _)| near(*place)) {
            zoom(controller, pivot, lines);
            return true;
        }
        match ask(ray, streaming, visible) {
            Some(answer) => {
                self.zoom = Some(Zoom { at, lines, answer });
                false
            }
            None => {
                controller.wheel(lines);
                true
            }
        }
    }

    /// Whether turns of the wheel wait.
    pub(super) const fn awaits_answer(&self) -> bool {
        self.zoom.is_some()
    }

    /// Takes the answer that turns of the wheel wait for; returns whether the camera has moved.
    pub(super) fn receive(&mut self, controller: &mut CameraController) -> bool {
        let Some(waiting) = &mut self.zoom else { return false };
        let pivot = match waiting.answer.take() {
            Ok(None) => return false,
            Ok(Some(pivot)) => pivot,
            Err(_) => None,
        };
        zoom(controller, pivot, waiting.lines);
        self.zoomed = Some((waiting.at, pivot));
        self.zoom = None;
        true
    }
}

fn zoom(controller: &mut CameraController, pivot: Option<DVec3>, lines: f64) {
    match pivot {
        Some(pivot) => controller.wheel_to(pivot, lines),
        None => controller.wheel(lines),
    }
}
