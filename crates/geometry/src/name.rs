//! Choices that people name: the error of a word that is no such name.

/// A word that names none of the choices that there are.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{possible} is possible; {given:?} is not")]
pub struct UnknownName {
    /// The names that there are, as the beginning of a sentence ("qem or melax").
    pub possible: &'static str,
    /// What was given instead.
    pub given: String,
}

impl UnknownName {
    /// A refusal of `given`, where only `possible` is.
    pub fn new(possible: &'static str, given: &str) -> Self {
        Self { possible, given: given.to_owned() }
    }
}
