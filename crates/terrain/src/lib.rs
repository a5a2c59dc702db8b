//! Terrain: every height of a world follows from [`Parameters`] and a few injected features.
//!
//! Heights are integers on a global grid of points, made by diamond-square with hashed offsets (Fournier,
//! Fussell and Carpenter 1982). The world is divided into square patches: patch (X, Y) covers the points
//! X·2^n to (X + 1)·2^n in x, and likewise in y, borders included. Level l has every 2^(n − l)th of those;
//! level −j has every 2^j-th patch corner. Coordinates of a level are global: its point (x, y) is point
//! (x·2^(n − l), y·2^(n − l)) of the finest.
//!
//! - Any rectangle of any level is made alone ([`Terrain::window`]), the same on every machine: integers
//!   only, no clock, no order, no state.
//! - Neighbouring patches agree on their border.
//! - Level l is a subset of level l + 1.
//!
//! Grid x is a scene's x, grid y its z, height its y.

#![cfg_attr(
    not(test),
    warn(
        clippy::cast_possible_truncation,
        clippy::cast_possible_wrap,
        clippy::cast_precision_loss,
        clippy::cast_sign_loss
    )
)]

mod deviation;
mod differences;
mod erosion;
mod error;
mod feature;
mod fingerprint;
mod mode;
mod noise;
mod numbers;
mod override_codec;
mod override_prediction;
mod parameters;
mod points;
mod query;
mod rect;
mod refine;
mod roughness;
mod sculpt;
mod stamp;
pub mod tiles;
mod window;
mod world;

pub use error::TerrainError;
pub use feature::{FeatureSet, Features, MAX_POINTS, Point};
pub use fingerprint::fingerprint;
pub use mode::Mode;
pub use override_codec::{decode_points, encode_points};
pub use parameters::{
    Distribution, Erosion, HALVING, MAX_BASE_HEIGHT, MAX_FINEST_LEVEL, PARAMETERS_BYTES, Parameters,
};
pub use points::{HeightOverride, HeightOverrides, MAX_PATCH_POINTS};
pub use roughness::RoughPlace;
pub use stamp::{
    MAX_REACH, MAX_RIVER_POINTS, MAX_SEGMENT, MAX_STAMPS, Position, Shape, Stamp, decode_stamps,
    encode_stamps,
};
pub use window::Scratch;
pub use world::{MAX_WINDOW_POINTS, Terrain};
