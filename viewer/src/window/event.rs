//! What wakes the window.

/// Event from another thread.
#[derive(Clone, Copy, Debug)]
pub(super) enum Event {
    /// The streaming thread has a new step or status, or a terrain tile is ready.
    Streaming,
    /// A signal of this number has arrived.
    End(u8),
}
