//! Keys: what they do, which they are, and how held ones move the camera.
//!
//! | module | idea |
//! |---|---|
//! | `actions` | what keys do, with their usual keys |
//! | `bindings` | the keys of each action, changed by a settings file |
//! | `names` | names of keys |
//! | `held` | keys that are held, and the turntable |
//! | `input` | effects of keys on camera and quality |

mod actions;
mod bindings;
mod held;
mod input;
mod names;

pub(in crate::window) use actions::{ACTIONS, Action};
pub(in crate::window) use bindings::Bindings;
pub(in crate::window) use held::Keys;
pub(in crate::window) use input::{key, move_camera};
