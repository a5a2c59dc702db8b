//! The viewer's settings file: which keys do what.

use std::collections::BTreeMap;
use std::io::Read as _;
use std::path::{Path, PathBuf};

use anyhow::{Context as _, bail};
use serde::Deserialize;

/// Longest file that is read, in bytes.
const MAX_BYTES: u64 = 1 << 20;

/// Contents of the file.
#[derive(Clone, Debug, Default, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct SettingsFile {
    #[serde(skip)]
    path: PathBuf,
    /// Keys of actions, in place of the usual ones.
    #[serde(default)]
    keys: BTreeMap<String, KeyNames>,
}

/// A key, or several.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(untagged)]
enum KeyNames {
    One(String),
    Several(Vec<String>),
}

impl SettingsFile {
    /// Reads a file; without one, the user's, which may be missing.
    ///
    /// # Errors
    /// A file that cannot be read, and one with other contents.
    pub(crate) fn load(given: Option<&Path>) -> anyhow::Result<Self> {
        match (given, default_file()) {
            (Some(file), _) => read(file),
            (None, Some(file)) if file.exists() => read(&file),
            _ => Ok(Self::default()),
        }
    }

    /// The file, for messages about what it says.
    pub(crate) fn describe(&self) -> String {
        describe(&self.path)
    }

    /// Keys of actions, in place of the usual ones.
    pub(crate) fn keys(&self) -> BTreeMap<String, Vec<String>> {
        let names = |names: &KeyNames| match names {
            KeyNames::One(name) => vec![name.clone()],
            KeyNames::Several(several) => several.clone(),
        };
        self.keys.iter().map(|(action, keys)| (action.clone(), names(keys))).collect()
    }
}

/// `$XDG_CONFIG_HOME/lodestream/viewer.toml` or `~/.config/lodestream/viewer.toml`.
fn default_file() -> Option<PathBuf> {
    let variable = |name| std::env::var_os(name).map(PathBuf::from).filter(|path| path.is_absolute());
    let base = variable("XDG_CONFIG_HOME").or_else(|| variable("HOME").map(|home| home.join(".config")));
    base.map(|base| base.join("lodestream/viewer.toml"))
}

fn describe(file: &Path) -> String {
    format!("settings file {}", file.display())
}

fn read(file: &Path) -> anyhow::Result<SettingsFile> {
    let about = || describe(file);
    let mut text = String::new();
    let opened = std::fs::File::open(file).with_context(about)?;
    let length = opened.take(MAX_BYTES + 1).read_to_string(&mut text).with_context(about)?;
    if length as u64 > MAX_BYTES {
        bail!("{}: it has more than {MAX_BYTES} bytes", about());
    }
    let read: SettingsFile =
        toml::from_str(&text).map_err(|why| anyhow::anyhow!("{}: {}", about(), why.to_string().trim()))?;
    Ok(SettingsFile { path: file.to_owned(), ..read })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_gives_keys_of_actions_and_errors_name_it() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("viewer.toml");
        std::fs::write(&file, "[keys]\nsection = \"B\"\npicture = [\"F2\", \"Ctrl+P\"]\n").unwrap();
        let keys = SettingsFile::load(Some(&file)).unwrap().keys();
        assert_eq!(keys["section"], ["B"]);
        assert_eq!(keys["picture"], ["F2", "Ctrl+P"]);
        for (text, why) in
            [("[key]\n", "unknown field"), ("[keys]\nsection = 3\n", "section"), ("[keys", "viewer.toml")]
        {
            std::fs::write(&file, text).unwrap();
            let error = format!("{:#}", SettingsFile::load(Some(&file)).unwrap_err());
            assert!(error.contains(why) && error.contains("viewer.toml"), "{error}");
        }
        assert!(SettingsFile::load(Some(&folder.path().join("missing.toml"))).is_err());
    }
}
