//! What all seeds are.

/// A seed that a target must accept.
pub(super) fn seed(name: impl Into<String>, bytes: Vec<u8>) -> (String, Vec<u8>) {
    (name.into(), bytes)
}
