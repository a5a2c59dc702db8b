//! What the crate promises, tested through its public interface on generated meshes.
#![allow(clippy::unwrap_used)]

mod common;

mod promises;
