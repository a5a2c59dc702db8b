//! Packs and published scenes, as baking makes them.

#![allow(
    clippy::unwrap_used,
    reason = "helpers of tests are tests, whatever the lint thinks of functions without #[test]"
)]

mod packs;
mod scene_object;
