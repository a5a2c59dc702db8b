//! What the window and the browser tab share: the camera controller, and the quality of frames on slow devices. No
//! window, no network, no clock: times and events are arguments.

mod camera;
mod quality;

pub use camera::{CameraController, Mode, Push};
pub use quality::{FULL, Quality, Step, limited_settings};
