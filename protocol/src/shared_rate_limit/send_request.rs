//! A session's request to send.

/// A session's demand when it asks to send.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct SendRequest {
    /// Whether it has something to send.
    pub(crate) active: bool,
    /// Its own rate; `None` for no limit.
    pub(crate) own_bits_per_s: Option<u64>,
    /// Whether its own limiter admits something now.
    pub(crate) own_ready: bool,
}
