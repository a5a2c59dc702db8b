//! Which blobs a view wants, in which order, and which applied chunks it can do without.
//!
//! The same function orders the server's first flight, the viewer's requests and the simulator's.
//!
//! For every visible instance, every known chunk whose sphere reaches into the frustum gets the screen
//! error that it would leave: geometric error × magnification at the sphere's nearest point. An asset's
//! chunks are shared by its instances, so the largest over the instances counts. Chunks pass their error
//! on to their parents, without which they cannot be applied; so the chunks above any threshold are closed
//! under parents. Wanted are the missing ones above the threshold (the view's target, or more where
//! the budgets are exceeded), those first that make the most visible difference per byte, with what hangs on them
//! ([`priority`]); unneeded are the applied ones below a
//! smaller threshold, so that nothing flickers when the camera wavers.
//!
//! A chunk none of whose children is above the threshold is wanted up to the first truncation whose error, at
//! the same magnification, is not above it; once a child is, or the truncation does no longer, the rest. Budgets
//! count it whole.

#![cfg_attr(
    not(test),
    warn(
        clippy::cast_possible_truncation,
        clippy::cast_possible_wrap,
        clippy::cast_precision_loss,
        clippy::cast_sign_loss
    )
)]

pub mod difference;
mod instance_tree;
mod occluder;
pub mod priority;
mod project;
mod selection;
mod selector;
mod settings;
mod state;
#[cfg(any(test, feature = "testing"))]
pub mod testing;
#[cfg(test)]
mod tests;
pub mod textures;
pub mod visibility;

pub use difference::{punctual_light_priority, shape_priority};
pub use instance_tree::{InstanceTree, Instances};
pub use occluder::Occluder;
pub use priority::Priority;
pub use project::{Bounds, LocalView, Projection};
pub use selection::{Counters, Selection, State, Wanted};
pub use selector::{Selector, max_screen_error_px};
pub use settings::{SelectSettings, SettingsError, Share, Weight};
pub use state::{AssetState, Chunk, PageError};
