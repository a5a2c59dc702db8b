//! Packs and published scenes, as baking makes them.

#![allow(clippy::unwrap_used, reason = "test helpers without #[test] may unwrap, as tests may")]

mod packs;
mod scene_object;
