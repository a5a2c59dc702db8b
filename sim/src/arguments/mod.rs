//! Arguments shared by several commands, and parsers of values.

mod beside;
mod cache;
mod drawn_case;
mod values;

pub(crate) use beside::Beside;
pub(crate) use cache::CacheFolder;
pub(crate) use drawn_case::DrawnCase;
pub(crate) use values::{target_px, transport};
