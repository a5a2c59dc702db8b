//! Start, reload and shutdown.

pub(crate) mod notify;
pub(crate) mod reload;
pub mod settings_watch;
pub mod shutdown;
