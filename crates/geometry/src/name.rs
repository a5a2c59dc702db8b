//! The error of parsing a name that is not one of the choices.

/// A name that is not one of the choices.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{possible} is possible; {given:?} is not")]
pub struct UnknownName {
    /// The valid names, as the beginning of a sentence ("qem or melax").
    pub possible: &'static str,
    /// The name that was given.
    pub given: String,
}

impl UnknownName {
    /// An error about `given` when the choices are `possible`.
    pub fn new(possible: &'static str, given: &str) -> Self {
        Self { possible, given: given.to_owned() }
    }
}
