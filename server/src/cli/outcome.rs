//! What a command leaves to say.

/// What a command that ran has to say.
#[derive(Debug, PartialEq, Eq)]
pub(super) struct Outcome {
    /// For standard output.
    pub(super) text: String,
    /// Whether the answer is good; exit code 1 otherwise.
    pub(super) good: bool,
}

impl Outcome {
    pub(super) fn good(text: impl Into<String>) -> Self {
        Self { text: text.into(), good: true }
    }
}
