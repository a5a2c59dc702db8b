//! What the command line names: a server or published scene to stream from, or files to prepare.

use std::ffi::OsString;
use std::fmt;
use std::path::{Path, PathBuf};

use anyhow::{Context as _, bail};
use lodestream_bake::prepare::is_pack;
use lodestream_bake::scene::{MODEL_EXTENSIONS, has_extension};
use lodestream_client::net::{Address, Scheme};

/// What to show.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum Target {
    /// A server, or a published scene.
    Stream(Address),
    /// Models and packs that make up one scene, or one scene file.
    Files(Vec<PathBuf>),
}

impl Target {
    /// Finds out what words of the command line name.
    ///
    /// # Errors
    /// A word that is neither a file nor an address, a folder of nothing or of several scenes, and what cannot be combined.
    pub(crate) fn of(words: &[OsString]) -> anyhow::Result<Self> {
        let (mut files, mut alone) = (Vec::new(), None);
        for word in words {
            match named(word)? {
                Self::Files(named) => files.extend(named),
                Self::Stream(address) => alone = Some(Self::Stream(address)),
            }
        }
        match (alone, words) {
            (Some(stream), [_]) => Ok(stream),
            (Some(stream), _) => bail!("{stream} is a scene of its own: name it alone"),
            (None, _) => Ok(Self::Files(files)),
        }
    }

    /// Name of the transport in statistics.
    pub(crate) const fn transport(&self) -> &'static str {
        match self {
            Self::Stream(address) => address.transport(),
            Self::Files(_) => Scheme::File.name(),
        }
    }
}

impl fmt::Display for Target {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Stream(address) => address.fmt(f),
            Self::Files(files) => {
                let name =
                    |file: &PathBuf| file.file_name().unwrap_or_default().to_string_lossy().into_owned();
                f.write_str(&files.first().map(name).unwrap_or_default())?;
                if files.len() > 1 { write!(f, " and {} more", files.len() - 1) } else { Ok(()) }
            }
        }
    }
}

/// What one word names.
fn named(word: &OsString) -> anyhow::Result<Target> {
    let path = Path::new(word);
    let address = word.to_str().map(str::parse::<Address>);
    match address {
        Some(Ok(address)) => Ok(Target::Stream(address)),
        _ if path.is_dir() => in_folder(path),
        _ if path.exists() && has_extension(path, &["lss"]) => published(path).map(Target::Stream),
        _ if path.exists() => Ok(Target::Files(vec![path.to_owned()])),
        Some(Err(why)) => bail!("there is no file or folder {word:?}, and {why}"),
        None => bail!("there is no file or folder {word:?}"),
    }
}

/// Address of a published scene in a file.
pub(super) fn published(file: &Path) -> anyhow::Result<Address> {
    let scene = file.to_str().with_context(|| {
        format!("{}: the path of a published scene must be UTF-8 text: rename it", file.display())
    })?;
    Ok(Address { scheme: Scheme::File, host: String::new(), port: 0, scene: scene.to_owned(), pin: None })
}

/// What a folder has: one published scene, one scene file (in it or in a folder within it), or else models and packs.
fn in_folder(folder: &Path) -> anyhow::Result<Target> {
    let entries = entries(folder)?;
    let of = |extensions: &[&str]| -> Vec<PathBuf> {
        entries.iter().filter(|file| has_extension(file, extensions) && file.is_file()).cloned().collect()
    };
    if let Some(scene) = only(folder, of(&["lss"]))? {
        return published(&scene).map(Target::Stream);
    }
    let mut scenes = of(&["toml"]);
    scenes.extend(entries.iter().map(|inner| inner.join("scene.toml")).filter(|scene| scene.is_file()));
    if let Some(scene) = only(folder, scenes)? {
        return Ok(Target::Files(vec![scene]));
    }
    let models: Vec<PathBuf> = entries
        .into_iter()
        .filter(|file| (has_extension(file, &MODEL_EXTENSIONS) || is_pack(file)) && file.is_file())
        .collect();
    if models.is_empty() {
        bail!("{}: the folder has no model, pack or scene: name another", folder.display());
    }
    Ok(Target::Files(models))
}

/// The only one of a folder's scenes; `None` if there is none.
fn only(folder: &Path, mut scenes: Vec<PathBuf>) -> anyhow::Result<Option<PathBuf>> {
    if scenes.len() > 1 {
        let names: Vec<String> = scenes.iter().take(5).map(|scene| scene.display().to_string()).collect();
        bail!(
            "{}: the folder has {} scenes: name one of them: {}",
            folder.display(),
            scenes.len(),
            names.join(", ")
        );
    }
    Ok(scenes.pop())
}

/// Paths in a folder, sorted.
fn entries(folder: &Path) -> anyhow::Result<Vec<PathBuf>> {
    let about = || folder.display().to_string();
    let read = std::fs::read_dir(folder).with_context(about)?;
    let mut entries = read
        .map(|entry| entry.map(|entry| entry.path()))
        .collect::<Result<Vec<_>, _>>()
        .with_context(about)?;
    entries.sort();
    Ok(entries)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(words: &[&Path]) -> anyhow::Result<Target> {
        let words: Vec<OsString> = words.iter().map(|word| word.as_os_str().to_owned()).collect();
        Target::of(&words)
    }

    #[test]
    fn words_are_addresses_files_or_an_error_that_names_both() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        for name in ["b.obj", "a.GLB", "c.lsp", "notes.txt"] {
            std::fs::write(at(name), "").unwrap();
        }
        assert!(matches!(of(&[Path::new("ws://h:1")]).unwrap(), Target::Stream(_)));
        assert_eq!(of(&[&at("b.obj"), &at("a.GLB")]).unwrap(), Target::Files(vec![at("b.obj"), at("a.GLB")]));
        assert_eq!(of(&[folder.path()]).unwrap(), Target::Files(vec![at("a.GLB"), at("b.obj"), at("c.lsp")]));
        let why = of(&[&at("bb.obj")]).unwrap_err().to_string();
        assert!(why.contains("no file or folder") && why.contains("is not a server address"), "{why}");
        assert!(
            of(&[Path::new("ws://h:1"), &at("b.obj")]).unwrap_err().to_string().contains("name it alone")
        );
        assert_eq!(of(&[&at("b.obj"), &at("a.GLB")]).unwrap().to_string(), "b.obj and 1 more");
    }

    #[test]
    fn a_folders_scene_comes_before_its_models() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        assert!(of(&[folder.path()]).unwrap_err().to_string().contains("has no model"));
        std::fs::write(at("a.obj"), "").unwrap();
        std::fs::create_dir(at("hall")).unwrap();
        std::fs::write(at("hall/scene.toml"), "").unwrap();
        assert_eq!(of(&[folder.path()]).unwrap(), Target::Files(vec![at("hall/scene.toml")]));
        std::fs::write(at("other.toml"), "").unwrap();
        let why = of(&[folder.path()]).unwrap_err().to_string();
        assert!(why.contains("2 scenes") && why.contains("other.toml"), "{why}");
        std::fs::write(at("x.lss"), "").unwrap();
        let Target::Stream(address) = of(&[folder.path()]).unwrap() else { panic!() };
        assert_eq!(address.to_string(), format!("file:{}", at("x.lss").display()));
        assert_eq!(of(&[&at("x.lss")]).unwrap(), Target::Stream(address));
    }
}
