//! What a feature does to the heights that are there.

/// What a feature does to the terrain under it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Mode {
    /// Heights become what is given.
    Fixed,
    /// Heights change by what is given.
    #[default]
    Additive,
}
