//! What is wrong with a plan, and where.

/// A plan that cannot be run: which file, which field, what is wrong.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{file}: {field}: {message}")]
pub struct PlanError {
    /// The plan's file.
    pub file: String,
    /// The field (`sweep[1].loss[0]`) or the line (`line 7`).
    pub field: String,
    /// What is wrong with it, and what to do.
    pub message: String,
}

/// What is wrong, before the file is named.
#[derive(Debug)]
pub(super) struct Fault {
    pub(super) field: String,
    pub(super) message: String,
}

impl Fault {
    pub(super) fn new(field: impl Into<String>, message: impl Into<String>) -> Self {
        Self { field: field.into(), message: message.into() }
    }

    /// The same, with what the field is a part of.
    pub(super) fn within(self, table: &str) -> Self {
        Self { field: format!("{table}.{}", self.field), ..self }
    }
}
