//! Compressed sparse rows: immutable lists by number, in one array. [`crate::mesh::stars::Stars`] is the mutable
//! counterpart.

/// Entries by row.
#[derive(Clone, Debug)]
pub(crate) struct Rows<T> {
    /// Start of each row, and the end of the last.
    first: Vec<u32>,
    entries: Vec<T>,
}

impl<T> Default for Rows<T> {
    fn default() -> Self {
        Self { first: Vec::new(), entries: Vec::new() }
    }
}

impl<T: Copy + Default> Rows<T> {
    /// Groups entries by row, stable within a row (a counting sort: linear time and memory). `entries` is called
    /// twice and must return the same.
    pub(crate) fn new<I: Iterator<Item = (u32, T)>>(rows: usize, entries: impl Fn() -> I) -> Self {
        let mut table = Self::default();
        table.rebuild(rows, entries);
        table
    }

    /// As [`Self::new`], reusing the memory.
    pub(crate) fn rebuild<I: Iterator<Item = (u32, T)>>(&mut self, rows: usize, entries: impl Fn() -> I) {
        // Counts are stored two places ahead, so that filling the rows moves each start into place.
        self.first.clear();
        self.first.resize(rows + 2, 0);
        let mut count = 0;
        for (row, _) in entries() {
            self.first[row as usize + 2] += 1;
            count += 1;
        }
        for row in 2..self.first.len() {
            self.first[row] += self.first[row - 1];
        }
        self.entries.resize(count, T::default());
        for (row, entry) in entries() {
            let at = &mut self.first[row as usize + 1];
            self.entries[*at as usize] = entry;
            *at += 1;
        }
        self.first.pop();
    }

    /// Number of rows.
    pub(crate) fn len(&self) -> usize {
        self.first.len().saturating_sub(1)
    }

    /// The entries of a row.
    pub(crate) fn row(&self, row: u32) -> &[T] {
        let (from, to) = (self.first[row as usize], self.first[row as usize + 1]);
        &self.entries[from as usize..to as usize]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn entries_come_by_row_in_their_order_and_rows_may_be_empty() {
        let entries = [(2_u32, 'a'), (0, 'b'), (2, 'c'), (4, 'd'), (0, 'e'), (2, 'f')];
        let mut rows = Rows::new(6, || entries.iter().copied());
        let all = |rows: &Rows<char>| -> Vec<String> {
            (0..rows.len() as u32).map(|row| rows.row(row).iter().collect()).collect()
        };
        assert_eq!(all(&rows), ["be", "", "acf", "", "d", ""]);
        rows.rebuild(2, || [(1, 'x')].into_iter());
        assert_eq!(all(&rows), ["", "x"]);
        rows.rebuild(0, std::iter::empty);
        assert_eq!((all(&rows).len(), Rows::<u32>::default().len()), (0, 0));
    }
}
