//! Code shared by the test modules.

pub(crate) mod authority;
pub(crate) mod daemon;
pub(crate) mod drag_and_drop;
pub(crate) mod picture;
pub(crate) mod program;
pub(crate) mod raw;
pub(crate) mod scene;
pub(crate) mod shapes;
pub(crate) mod source;
pub(crate) mod viewer;
pub(crate) mod virtual_link;
pub(crate) mod window_pictures;
pub(crate) mod x11;

use std::time::Duration;

/// Time limit of everything in real time; far above what it needs.
pub(crate) const LIMIT: Duration = Duration::from_secs(60);

/// Size of the compared pictures.
pub(crate) const PICTURE_PX: [u32; 2] = [640, 360];
