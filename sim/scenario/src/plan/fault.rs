//! Faults of a plan, with their place.

/// An invalid plan: file, field and fault.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{file}: {field}: {message}")]
pub struct PlanError {
    /// The plan's file.
    pub file: String,
    /// The field (`sweep[1].loss[0]`) or the line (`line 7`).
    pub field: String,
    /// The fault and its remedy.
    pub message: String,
}

/// A fault, without the file's name.
#[derive(Debug)]
pub(super) struct Fault {
    pub(super) field: String,
    pub(super) message: String,
}

impl Fault {
    pub(super) fn new(field: impl Into<String>, message: impl Into<String>) -> Self {
        Self { field: field.into(), message: message.into() }
    }

    /// The same fault with the enclosing table prepended to its field.
    pub(super) fn within(self, table: &str) -> Self {
        Self { field: format!("{table}.{}", self.field), ..self }
    }
}
