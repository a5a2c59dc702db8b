//! The keys of each action: the usual ones, changed by the table `keys` of a settings file.

use std::collections::{BTreeMap, BTreeSet};

use anyhow::{Context as _, bail};
use winit::keyboard::KeyCode;

use super::actions::{ACTIONS, Action};
use super::names::{Press, parse};

/// Keys of actions. No key has two of them.
#[derive(Clone, Debug)]
pub(in crate::window) struct Bindings {
    /// By entry of [`ACTIONS`]: names and keys.
    keys: Vec<(Vec<String>, Vec<Press>)>,
}

impl Bindings {
    /// The usual keys, those of some actions replaced. `changed` has names of actions with names of keys.
    ///
    /// # Errors
    /// An action or key that does not exist, and a key of two actions.
    pub(in crate::window) fn new(changed: &BTreeMap<String, Vec<String>>) -> anyhow::Result<Self> {
        if let Some(unknown) = changed.keys().find(|name| ACTIONS.iter().all(|entry| entry.name != **name)) {
            let known: Vec<&str> = ACTIONS.iter().map(|entry| entry.name).collect();
            bail!("there is no action {unknown:?}: there are {}", known.join(", "));
        }
        let mut keys: Vec<(Vec<String>, Vec<Press>)> = Vec::with_capacity(ACTIONS.len());
        for entry in ACTIONS {
            let usual = || entry.keys.iter().map(|&key| key.to_owned()).collect();
            let names: Vec<String> = changed.get(entry.name).cloned().unwrap_or_else(usual);
            let mut presses = Vec::new();
            for name in &names {
                let new = parse(name).map_err(anyhow::Error::msg).context(entry.name)?;
                let taken =
                    keys.iter().position(|(_, others)| new.iter().any(|press| others.contains(press)));
                if let Some(other) = taken.and_then(|other| ACTIONS.get(other)) {
                    bail!("{name} is the key of {} and {}: give one of them another", other.name, entry.name);
                }
                presses.extend(new);
            }
            keys.push((names, presses));
        }
        Ok(Self { keys })
    }

    /// The action of a key that goes down, with or without a control key.
    pub(in crate::window) fn action(&self, code: KeyCode, control: bool) -> Option<Action> {
        let at = self.keys.iter().position(|(_, presses)| presses.contains(&Press { code, control }))?;
        ACTIONS.get(at).map(|entry| entry.action)
    }

    /// Whether a key of an action is among those that are held.
    pub(super) fn holds(&self, held: &BTreeSet<KeyCode>, action: Action) -> bool {
        self.of(action).is_some_and(|(_, presses)| {
            presses.iter().any(|press| !press.control && held.contains(&press.code))
        })
    }

    /// Names of an action's keys, for people.
    pub(in crate::window) fn names(&self, action: Action) -> String {
        self.of(action).map(|(names, _)| names.join(" ")).unwrap_or_default()
    }

    fn of(&self, action: Action) -> Option<&(Vec<String>, Vec<Press>)> {
        self.keys.get(ACTIONS.iter().position(|entry| entry.action == action)?)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn changed(table: &[(&str, &[&str])]) -> anyhow::Result<Bindings> {
        let keys = |keys: &[&str]| keys.iter().map(|&key| key.to_owned()).collect();
        Bindings::new(&table.iter().map(|&(name, names)| (name.to_owned(), keys(names))).collect())
    }

    #[test]
    fn the_usual_keys_are_each_of_one_action() {
        let usual = changed(&[]).unwrap();
        for (code, control, wanted) in [
            (KeyCode::F12, false, Some(Action::Picture)),
            (KeyCode::KeyS, true, Some(Action::Picture)),
            (KeyCode::KeyS, false, Some(Action::MoveBack)),
            (KeyCode::KeyQ, true, Some(Action::Quit)),
            (KeyCode::Numpad7, false, Some(Action::Top)),
            (KeyCode::KeyB, false, None),
        ] {
            assert_eq!(usual.action(code, control), wanted, "{code:?} {control}");
        }
        assert_eq!(usual.names(Action::Picture), "F12 Ctrl+S");
        let names: BTreeSet<&str> = ACTIONS.iter().map(|entry| entry.name).collect();
        assert_eq!(names.len(), ACTIONS.len());
    }

    #[test]
    fn a_file_changes_keys_of_some_actions() {
        let other = changed(&[("section", &["B", "Ctrl+B"]), ("measure", &["C"])]).unwrap();
        assert_eq!(other.action(KeyCode::KeyB, true), Some(Action::Section));
        assert_eq!(other.action(KeyCode::KeyC, false), Some(Action::Measure));
        assert_eq!(other.action(KeyCode::KeyM, false), None);
        let none = changed(&[("section", &[])]).unwrap();
        assert_eq!(none.action(KeyCode::KeyC, false), None);
        for (table, why) in [
            ([("cut", &["B"][..])], "there is no action \"cut\""),
            ([("section", &["b"][..])], "no key is called"),
            ([("section", &["M"][..])], "M is the key of measure and section"),
        ] {
            let error = format!("{:#}", changed(&table).unwrap_err());
            assert!(error.contains(why), "{error}");
        }
    }
}
