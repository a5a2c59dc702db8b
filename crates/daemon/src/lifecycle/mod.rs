//! Signals, reload and notifications to the service manager.

pub(crate) mod file_watch;
pub(crate) mod notify;
pub(crate) mod settings_watch;
pub(crate) mod shutdown;
