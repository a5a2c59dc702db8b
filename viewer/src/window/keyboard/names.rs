//! Names of keys, as settings files and the help have them.

use winit::keyboard::KeyCode;

/// A key, with or without a control key. Letters and digits are those of a US keyboard at the same place.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Press {
    pub(super) code: KeyCode,
    pub(super) control: bool,
}

const CONTROL: &str = "Ctrl+";

/// Names and codes. A name with several codes means any of them.
const NAMES: &[(&str, &[KeyCode])] = &[
    ("A", &[KeyCode::KeyA]),
    ("B", &[KeyCode::KeyB]),
    ("C", &[KeyCode::KeyC]),
    ("D", &[KeyCode::KeyD]),
    ("E", &[KeyCode::KeyE]),
    ("F", &[KeyCode::KeyF]),
    ("G", &[KeyCode::KeyG]),
    ("H", &[KeyCode::KeyH]),
    ("I", &[KeyCode::KeyI]),
    ("J", &[KeyCode::KeyJ]),
    ("K", &[KeyCode::KeyK]),
    ("L", &[KeyCode::KeyL]),
    ("M", &[KeyCode::KeyM]),
    ("N", &[KeyCode::KeyN]),
    ("O", &[KeyCode::KeyO]),
    ("P", &[KeyCode::KeyP]),
    ("Q", &[KeyCode::KeyQ]),
    ("R", &[KeyCode::KeyR]),
    ("S", &[KeyCode::KeyS]),
    ("T", &[KeyCode::KeyT]),
    ("U", &[KeyCode::KeyU]),
    ("V", &[KeyCode::KeyV]),
    ("W", &[KeyCode::KeyW]),
    ("X", &[KeyCode::KeyX]),
    ("Y", &[KeyCode::KeyY]),
    ("Z", &[KeyCode::KeyZ]),
    ("0", &[KeyCode::Digit0, KeyCode::Numpad0]),
    ("1", &[KeyCode::Digit1, KeyCode::Numpad1]),
    ("2", &[KeyCode::Digit2, KeyCode::Numpad2]),
    ("3", &[KeyCode::Digit3, KeyCode::Numpad3]),
    ("4", &[KeyCode::Digit4, KeyCode::Numpad4]),
    ("5", &[KeyCode::Digit5, KeyCode::Numpad5]),
    ("6", &[KeyCode::Digit6, KeyCode::Numpad6]),
    ("7", &[KeyCode::Digit7, KeyCode::Numpad7]),
    ("8", &[KeyCode::Digit8, KeyCode::Numpad8]),
    ("9", &[KeyCode::Digit9, KeyCode::Numpad9]),
    ("F1", &[KeyCode::F1]),
    ("F2", &[KeyCode::F2]),
    ("F3", &[KeyCode::F3]),
    ("F4", &[KeyCode::F4]),
    ("F5", &[KeyCode::F5]),
    ("F6", &[KeyCode::F6]),
    ("F7", &[KeyCode::F7]),
    ("F8", &[KeyCode::F8]),
    ("F9", &[KeyCode::F9]),
    ("F10", &[KeyCode::F10]),
    ("F11", &[KeyCode::F11]),
    ("F12", &[KeyCode::F12]),
    ("Space", &[KeyCode::Space]),
    ("Escape", &[KeyCode::Escape]),
    ("Enter", &[KeyCode::Enter, KeyCode::NumpadEnter]),
    ("Backspace", &[KeyCode::Backspace]),
    ("Insert", &[KeyCode::Insert]),
    ("Delete", &[KeyCode::Delete]),
    ("Home", &[KeyCode::Home]),
    ("End", &[KeyCode::End]),
    ("PageUp", &[KeyCode::PageUp]),
    ("PageDown", &[KeyCode::PageDown]),
    ("Left", &[KeyCode::ArrowLeft]),
    ("Right", &[KeyCode::ArrowRight]),
    ("Up", &[KeyCode::ArrowUp]),
    ("Down", &[KeyCode::ArrowDown]),
    ("Shift", &[KeyCode::ShiftLeft, KeyCode::ShiftRight]),
    ("Comma", &[KeyCode::Comma]),
    ("Period", &[KeyCode::Period]),
    ("Slash", &[KeyCode::Slash]),
    ("Minus", &[KeyCode::Minus, KeyCode::NumpadSubtract]),
    ("Equal", &[KeyCode::Equal, KeyCode::NumpadAdd]),
];

/// The keys of a name, such as `F`, `F12` or `Ctrl+S`.
///
/// # Errors
/// A name that no key has.
pub(super) fn parse(name: &str) -> Result<Vec<Press>, String> {
    let (control, plain) = match name.strip_prefix(CONTROL) {
        Some(plain) => (true, plain),
        None => (false, name),
    };
    let codes = NAMES.iter().find(|(known, _)| *known == plain).map(|(_, codes)| codes);
    let press = |codes: &&[KeyCode]| codes.iter().map(|&code| Press { code, control }).collect();
    codes.map(press).ok_or_else(|| {
        format!(
            "no key is called {name:?}: write a letter in capitals, a digit, Space, F1 to F12, \
             Escape, Enter, Home, Left or the like, or one of these behind Ctrl+"
        )
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_keys_with_or_without_control() {
        let press = |code, control| Press { code, control };
        assert_eq!(parse("F").unwrap(), [press(KeyCode::KeyF, false)]);
        assert_eq!(parse("Ctrl+F12").unwrap(), [press(KeyCode::F12, true)]);
        assert_eq!(parse("7").unwrap(), [press(KeyCode::Digit7, false), press(KeyCode::Numpad7, false)]);
        for wrong in ["", "f", "Ctrl+", "F13", "Ctrl+Ctrl+A", "ctrl+A"] {
            assert!(parse(wrong).unwrap_err().contains("no key is called"), "{wrong}");
        }
        let mut names: Vec<&str> = NAMES.iter().map(|(name, _)| *name).collect();
        names.sort_unstable();
        names.dedup();
        assert_eq!(names.len(), NAMES.len());
    }
}
