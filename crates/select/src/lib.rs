//! View-dependent selection: which blobs a view wants, in which order, and which applied chunks it no longer needs.
//!
//! Server, client and simulator use the same function.
//!
//! Each known chunk whose sphere reaches into the frustum of a visible instance has a screen error: its visible error
//! × magnification at the sphere's nearest point. Instances share the chunks of their asset, so the largest error
//! over the instances counts. Parents take the maximum of their children's errors, since a child cannot be applied
//! without them; so the chunks above any threshold form an ancestor-closed cut.
//!
//! The missing chunks above the threshold are wanted, in the order of visible difference per byte, their descendants
//! included ([`priority`]). The threshold is the view's target, or more if a budget would be exceeded. Applied chunks
//! below a smaller threshold are to be undone; the hysteresis avoids flicker when the camera moves slightly.
//!
//! A chunk without a wanted child is wanted up to the first truncation point whose screen error is not above the
//! threshold; otherwise whole. Budgets count whole chunks.

#![cfg_attr(
    not(test),
    warn(
        clippy::cast_possible_truncation,
        clippy::cast_possible_wrap,
        clippy::cast_precision_loss,
        clippy::cast_sign_loss
    )
)]

pub mod cut;
pub mod difference;
mod instance_tree;
mod occluder;
pub mod priority;
mod project;
mod root_error;
mod selection;
mod selector;
mod settings;
mod state;
#[cfg(any(test, feature = "testing"))]
#[cfg_attr(
    not(test),
    expect(
        clippy::cast_possible_truncation,
        clippy::cast_precision_loss,
        reason = "synthetic assets are small"
    )
)]
pub mod testing;
#[cfg(test)]
mod tests;
pub mod textures;
mod tile_demand;
pub mod visibility;

pub use difference::{punctual_light_priority, shape_priority};
pub use instance_tree::{InstanceTree, Instances};
pub use occluder::Occluder;
pub use priority::Priority;
pub use project::{Bounds, LocalView, Projection};
pub use root_error::RootError;
pub use selection::{Counters, Selection, State, Wanted};
pub use selector::{Selector, max_screen_error_px};
pub use settings::{SelectSettings, SettingsError, Share, Weight};
pub use state::{AssetState, Chunk, PageError};
