//! A mesh's wedges, and those that collapses added.

use crate::mesh::Wedge;

/// Wedges by number: the input's, which are borrowed, then those that were added.
pub(crate) struct Wedges<'a> {
    input: &'a [Wedge],
    added: Vec<Wedge>,
}

impl<'a> Wedges<'a> {
    pub(crate) fn new(input: &'a [Wedge]) -> Self {
        Self { input, added: Vec::new() }
    }

    /// How many there are.
    pub(crate) fn len(&self) -> usize {
        self.input.len() + self.added.len()
    }

    /// One of them.
    #[inline]
    pub(crate) fn get(&self, wedge: u32) -> Wedge {
        let wedge = wedge as usize;
        self.input.get(wedge).copied().unwrap_or_else(|| self.added[wedge - self.input.len()])
    }

    /// Those from `first` on, which are not the input's.
    pub(crate) fn added_from(&self, first: usize) -> &[Wedge] {
        &self.added[first - self.input.len()..]
    }

    /// All of them.
    pub(crate) fn iter(&self) -> impl Iterator<Item = &Wedge> {
        self.input.iter().chain(&self.added)
    }

    /// Adds one; answers its number.
    pub(crate) fn push(&mut self, wedge: Wedge) -> u32 {
        self.added.push(wedge);
        (self.len() - 1) as u32
    }
}
