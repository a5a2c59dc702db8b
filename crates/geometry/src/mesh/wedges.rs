//! A mesh's wedges, with those added by collapses.

use crate::mesh::Wedge;

/// Wedges by number: the borrowed input, then the added ones.
pub(crate) struct Wedges<'a> {
    input: &'a [Wedge],
    added: Vec<Wedge>,
}

impl<'a> Wedges<'a> {
    pub(crate) fn new(input: &'a [Wedge]) -> Self {
        Self { input, added: Vec::new() }
    }

    /// Number of wedges.
    pub(crate) fn len(&self) -> usize {
        self.input.len() + self.added.len()
    }

    /// The wedge with a number.
    #[inline]
    pub(crate) fn get(&self, wedge: u32) -> Wedge {
        let wedge = wedge as usize;
        self.input.get(wedge).copied().unwrap_or_else(|| self.added[wedge - self.input.len()])
    }

    /// The added wedges from number `first` on.
    pub(crate) fn added_from(&self, first: usize) -> &[Wedge] {
        &self.added[first - self.input.len()..]
    }

    /// All wedges.
    pub(crate) fn iter(&self) -> impl Iterator<Item = &Wedge> {
        self.input.iter().chain(&self.added)
    }

    /// Appends a wedge; returns its number.
    pub(crate) fn push(&mut self, wedge: Wedge) -> u32 {
        self.added.push(wedge);
        (self.len() - 1) as u32
    }
}
