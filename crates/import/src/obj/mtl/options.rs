//! The value of a `map_` keyword: options and a file name.

use std::path::{Component as PathPart, Path, PathBuf};

use lodestream_scene::asset::Wrap;

use crate::beside::Beside;
use crate::model::Component;

/// Options and file name of a texture line.
pub(super) struct TextureOptions {
    pub(super) file: String,
    /// `-bm`.
    pub(super) bump: f32,
    /// `-clamp on`; along both axes, since the option does not tell them apart.
    pub(super) wrap: [Wrap; 2],
    /// `-imfchan`.
    pub(super) component: Option<Component>,
}

impl TextureOptions {
    /// Splits `-option value … file name with blanks`.
    pub(super) fn parse(text: &str) -> Self {
        let mut this = Self { file: String::new(), bump: 1.0, wrap: [Wrap::Repeat; 2], component: None };
        let mut rest = text.trim();
        while rest.starts_with('-') {
            let (option, tail) = split_word(rest);
            // Number of values of an option, and whether trailing ones may be missing.
            let (count, optional) = match option {
                "-blendu" | "-blendv" | "-cc" | "-clamp" | "-bm" | "-boost" | "-imfchan" | "-texres"
                | "-type" => (1, false),
                "-mm" => (2, false),
                "-o" | "-s" | "-t" => (3, true),
                _ => break,
            };
            rest = tail;
            for _ in 0..count {
                let (value, tail) = split_word(rest);
                if tail.is_empty() || (optional && value.parse::<f64>().is_err()) {
                    break;
                }
                this.set(option, value);
                rest = tail;
            }
        }
        this.file = rest.to_owned();
        this
    }

    fn set(&mut self, option: &str, value: &str) {
        match (option, value) {
            ("-bm", _) => {
                self.bump = value.parse::<f32>().ok().filter(|b| b.is_finite()).unwrap_or(1.0);
            }
            ("-clamp", "on") => self.wrap = [Wrap::Clamp; 2],
            ("-imfchan", "r") => self.component = Some(Component::Red),
            ("-imfchan", "g") => self.component = Some(Component::Green),
            ("-imfchan", "b") => self.component = Some(Component::Blue),
            ("-imfchan", "m") => self.component = Some(Component::Alpha),
            ("-imfchan", "l") => self.component = Some(Component::Luminance),
            _ => {}
        }
    }
}

fn split_word(text: &str) -> (&str, &str) {
    let (word, tail) = text.split_once(char::is_whitespace).unwrap_or((text, ""));
    (word, tail.trim_start())
}

/// A file that is not read: otherwise an untrusted model could publish local files.
#[derive(Debug, thiserror::Error)]
#[error("{0:?} is not in the model's folder or below it and is left out; put the file there")]
pub(in crate::obj) struct OutsideFolder(String);

/// Resolves a file name in a file of the folder `here`, within the model's folder, `beside`. Backslashes are separators if
/// the name as written does not exist (files written on Windows). A file that does not exist where it should be is looked
/// for by its name in the model's folder, then in the other.
///
/// # Errors
/// Names outside the model's folder of files that are not found in it.
pub(in crate::obj) fn locate(beside: &Beside, here: &Beside, name: &str) -> Result<PathBuf, OutsideFolder> {
    let name = name.trim().trim_matches('"');
    let stated = stated(beside.folder(), here.folder(), name);
    if let Ok(path) = &stated
        && path.exists()
    {
        return stated;
    }
    beside.named(name).or_else(|| here.named(name)).map_or(stated, Ok)
}

/// The path that a name states, whether it exists or not.
fn stated(root: &Path, folder: &Path, name: &str) -> Result<PathBuf, OutsideFolder> {
    let inside = |name: &str| {
        let below = folder.strip_prefix(root).unwrap_or(Path::new(""));
        let depth = below.components().chain(Path::new(name).components()).try_fold(
            0_usize,
            |depth, part| match part {
                PathPart::Normal(_) => Some(depth + 1),
                PathPart::CurDir => Some(depth),
                PathPart::ParentDir => depth.checked_sub(1),
                PathPart::RootDir | PathPart::Prefix(_) => None,
            },
        );
        depth.map(|_| folder.join(name)).ok_or_else(|| OutsideFolder(name.to_owned()))
    };
    let path = inside(name)?;
    if !path.exists() && name.contains('\\') {
        return inside(&name.replace('\\', "/"));
    }
    Ok(path)
}
