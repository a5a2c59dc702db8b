//! What the window and the browser tab share: the camera controller, the turntable, the playback of clips, and the quality of frames on slow
//! devices and within a bound on memory. No window, no network, no clock: times and events are arguments.

mod camera;
mod playback;
mod quality;
mod targets;
mod turntable;

pub use camera::{CameraController, Mode, Push, Side};
pub use playback::Playback;
pub use quality::{FULL, Quality, STEPS, Step, limited_settings};
pub use targets::fit_targets;
pub use turntable::Turntable;
