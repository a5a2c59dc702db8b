//! A prepared asset: what it consists of, what it is good for on a screen, and the file that holds it.

pub mod base;
pub(crate) mod index;
pub mod pack;
pub mod screen;
