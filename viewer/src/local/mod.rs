//! Local files as one more source: they are prepared in the background, published in a temporary folder beside the cache,
//! and read from there as any published scene.
//!
//! | module | idea |
//! |---|---|
//! | `target` | what the command line names |
//! | `preparation` | the background thread: coarse scene, whole scene, changes |
//! | `folder` | the temporary folder of published scenes |
//! | `share` | the scene for other viewers |
//! | `stamp` | whether files have changed |

mod folder;
mod preparation;
mod share;
mod stamp;
mod target;

pub(crate) use folder::remove_at_once;
pub(crate) use preparation::{LocalOptions, Preparation};
pub(crate) use target::Target;
