//! Sources of scenes, as the command line names them: files, folders, stores.

use std::path::{Path, PathBuf};

use anyhow::{Context as _, bail};

use lodestream_bake::scene::{MODEL_EXTENSIONS, SceneError, has_extension};
use lodestream_store::{ObjectEntry, Objects};

/// Extension of published scenes.
pub(super) const PUBLISHED: &str = ".lss";

/// A source of scenes.
#[derive(Clone, Debug)]
pub(super) enum Place {
    /// One scene: a scene file, or models combined to one scene.
    Files(Vec<PathBuf>),
    /// The scene files of a folder and of its subfolders; if there are none, each model in the folder.
    Folder(PathBuf),
    /// Published scenes: the named one, or all in a folder.
    Published(Objects, Option<String>),
}

/// A scene of a source.
#[derive(Clone, Debug)]
pub(super) enum SceneLocation {
    /// A scene file, or models combined to one scene.
    Files(Vec<PathBuf>),
    /// A published scene.
    Published(Objects, ObjectEntry),
}

impl SceneLocation {
    /// Unique key of the scene.
    pub(super) fn key(&self) -> String {
        match self {
            Self::Files(files) => {
                files.iter().map(|file| file.display().to_string()).collect::<Vec<_>>().join("\n")
            }
            Self::Published(objects, listed) => format!("{}/{}", objects.name(), listed.name),
        }
    }
}

impl Place {
    /// Parses the arguments of a command line.
    pub(super) fn of_words(words: &[PathBuf]) -> anyhow::Result<Vec<Self>> {
        let mut places = Vec::new();
        let mut models = Vec::new();
        for word in words {
            if Objects::is_url(word) {
                let url = word.to_string_lossy();
                places.push(match url.rsplit_once('/') {
                    Some((folder, name)) if name.ends_with(PUBLISHED) => {
                        Self::Published(Objects::of_url(folder)?, Some(name.to_owned()))
                    }
                    _ => Self::Published(Objects::of_url(&url)?, None),
                });
            } else if word.is_dir() {
                places.push(if names(word, &[&PUBLISHED[1..]])?.is_empty() {
                    Self::Folder(word.clone())
                } else {
                    Self::Published(Objects::of_folder(word)?, None)
                });
            } else if has_extension(word, &["toml"]) {
                places.push(Self::Files(vec![word.clone()]));
            } else if has_extension(word, &[&PUBLISHED[1..]]) {
                let folder = word.parent().filter(|folder| !folder.as_os_str().is_empty());
                let name = word.file_name().unwrap_or_default().to_string_lossy().into_owned();
                places
                    .push(Self::Published(Objects::of_folder(folder.unwrap_or(Path::new(".")))?, Some(name)));
            } else {
                models.push(word.clone());
            }
        }
        match (&places[..], models.is_empty()) {
            ([], true) => Err(SceneError::NothingNamed.into()),
            (_, true) => Ok(places),
            ([], false) => Ok(vec![Self::Files(models)]),
            ([Self::Files(scene), ..], false) => {
                let path = scene.first().cloned().unwrap_or_default();
                Err(SceneError::SceneAmongOthers { path }.into())
            }
            (_, false) => bail!("{}: models cannot be combined with folders or stores", models[0].display()),
        }
    }

    /// Whether this names a single scene, which then must exist.
    pub(super) const fn is_one(&self) -> bool {
        matches!(self, Self::Files(_) | Self::Published(_, Some(_)))
    }

    /// Lists the existing scenes.
    pub(super) async fn list(&self) -> anyhow::Result<Vec<SceneLocation>> {
        match self {
            Self::Files(files) => Ok(vec![SceneLocation::Files(files.clone())]),
            Self::Folder(folder) => {
                let folder = folder.clone();
                let scenes = tokio::task::spawn_blocking(move || scenes_in(&folder)).await??;
                Ok(scenes.into_iter().map(|file| SceneLocation::Files(vec![file])).collect())
            }
            Self::Published(objects, name) => {
                let mut listed = objects.list(PUBLISHED).await?;
                if let Some(name) = name {
                    listed.retain(|listed| listed.name == *name);
                    if listed.is_empty() {
                        bail!("{}/{name}: there is no such object", objects.name());
                    }
                }
                Ok(listed
                    .into_iter()
                    .map(|listed| SceneLocation::Published(objects.clone(), listed))
                    .collect())
            }
        }
    }
}

/// The scene files of a folder and of its subfolders; if there are none, the models in the folder.
fn scenes_in(folder: &Path) -> anyhow::Result<Vec<PathBuf>> {
    let mut scenes = names(folder, &["toml"])?;
    for inner in std::fs::read_dir(folder).with_context(|| folder.display().to_string())? {
        let inner = inner.with_context(|| folder.display().to_string())?.path();
        let scene = inner.join("scene.toml");
        if scene.is_file() {
            scenes.push(scene);
        }
    }
    scenes.sort();
    if scenes.is_empty() { names(folder, &MODEL_EXTENSIONS) } else { Ok(scenes) }
}

/// Files in a folder with one of these extensions, sorted by name.
fn names(folder: &Path, endings: &[&str]) -> anyhow::Result<Vec<PathBuf>> {
    let about = || folder.display().to_string();
    let mut found = Vec::new();
    for file in std::fs::read_dir(folder).with_context(about)? {
        let file = file.with_context(about)?.path();
        if has_extension(&file, endings) && file.is_file() {
            found.push(file);
        }
    }
    found.sort();
    Ok(found)
}
