//! Names that are given out once.

use std::collections::HashMap;

/// Names that are taken, each with the number that its last namesake got.
#[derive(Debug, Default)]
pub(super) struct UniqueNames(HashMap<String, usize>);

impl UniqueNames {
    /// Reserves a name that is already taken.
    pub(super) fn reserve(&mut self, name: impl Into<String>) {
        self.0.entry(name.into()).or_insert(1);
    }

    /// The name, or if it is taken, the name with the first number from 2 that makes it another.
    pub(super) fn take(&mut self, wanted: &str) -> String {
        let Some(&last) = self.0.get(wanted) else {
            self.reserve(wanted);
            return wanted.to_owned();
        };
        let mut number = last;
        let name = loop {
            number += 1;
            let name = format!("{wanted}-{number}");
            if !self.0.contains_key(&name) {
                break name;
            }
        };
        self.0.insert(wanted.to_owned(), number);
        self.reserve(name.clone());
        name
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_name_is_given_twice() {
        let mut names = UniqueNames::default();
        names.reserve("kept");
        let wanted = ["a-2", "a", "a", "a", "a-2", "kept", "kept-2"];
        let given = wanted.map(|name| names.take(name));
        assert_eq!(given, ["a-2", "a", "a-3", "a-4", "a-2-2", "kept-2", "kept-2-2"]);
    }
}
