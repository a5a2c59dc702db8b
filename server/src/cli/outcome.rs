//! The result of a command.

/// The result of a command that ran.
#[derive(Debug, PartialEq, Eq)]
pub(super) struct Outcome {
    /// Text for standard output.
    pub(super) text: String,
    /// Whether the command found no fault; otherwise the exit code is 1.
    pub(super) good: bool,
}

impl Outcome {
    pub(super) fn good(text: impl Into<String>) -> Self {
        Self { text: text.into(), good: true }
    }
}
