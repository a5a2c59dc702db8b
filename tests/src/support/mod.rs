//! What the topics share.

pub(crate) mod authority;
pub(crate) mod daemon;
pub(crate) mod picture;
pub(crate) mod program;
pub(crate) mod raw;
pub(crate) mod scene;
pub(crate) mod shapes;
pub(crate) mod source;
pub(crate) mod viewer;
pub(crate) mod virtual_link;
pub(crate) mod x11;

use std::time::Duration;

/// Bound on everything that happens in real time; far above what it takes.
pub(crate) const LIMIT: Duration = Duration::from_secs(60);

/// Size of the pictures that are compared.
pub(crate) const PICTURE_PX: [u32; 2] = [640, 360];
