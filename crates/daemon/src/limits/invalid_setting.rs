//! The error of parsing a setting from text.

/// A text that is not what a setting needs, with an example.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{given:?} is not {needed}: write {example}")]
pub struct InvalidSetting {
    /// The text.
    pub given: String,
    /// What is needed.
    pub needed: &'static str,
    /// What to write instead.
    pub example: &'static str,
}

impl InvalidSetting {
    pub(crate) fn new(given: &str, needed: &'static str, example: &'static str) -> Self {
        Self { given: given.to_owned(), needed, example }
    }
}
