//! How a feature changes heights.

/// How a feature changes the heights below it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Mode {
    /// Sets heights.
    Fixed,
    /// Adds to heights.
    #[default]
    Additive,
}
