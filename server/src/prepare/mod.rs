//! From a model file to a prepared pack.

pub mod atomic;
pub mod cache;
pub mod describe;
