//! The limits for all sessions and for each group.

/// Limits in bits per second on the wire, as [`crate::limiter`] counts them.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Limits {
    /// For all sessions together; `None` for no limit.
    pub total_bits_per_s: Option<u64>,
    /// For the sessions of each group together; `None` for no limit.
    pub group_bits_per_s: Option<u64>,
}
