//! Choices by name.

/// A choice of which each value has a name.
pub trait Named: Copy + Send + Sync + 'static {
    /// All values, in the order in which messages list them.
    const ALL: &'static [Self];

    /// The value's name.
    fn name(self) -> &'static str;

    /// The value with a name.
    ///
    /// # Errors
    /// No value has this name.
    fn from_name(name: &str) -> Result<Self, UnknownName> {
        Self::ALL.iter().copied().find(|value| value.name() == name).ok_or_else(|| {
            let names: Vec<_> = Self::ALL.iter().map(|value| value.name()).collect();
            let possible = match &names[..] {
                [first @ .., last] if !first.is_empty() => format!("{} or {last}", first.join(", ")),
                _ => names.concat(),
            };
            UnknownName { possible, given: name.to_owned() }
        })
    }
}

/// A name that is not one of the choices.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{possible} is possible; {given:?} is not")]
pub struct UnknownName {
    /// The valid names, as the beginning of a sentence ("qem or melax").
    pub possible: String,
    /// The name that was given.
    pub given: String,
}
