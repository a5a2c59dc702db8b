//! Downloads models and scene files from a store, with the files that they name, into a folder of the same structure.

use std::path::{Component, Path, PathBuf};

use anyhow::{Context as _, bail};
use lodestream_import::{MAX_FILE_BYTES, ModelFile, is_streamed};

use lodestream_bake::scene::has_extension;
use lodestream_store::{Objects, StoreError};

/// Most files that one scene or model may name.
const MAX_FILES: usize = 10_000;

/// Downloads a model or a scene file and all files that it names; returns its path in `folder`. A named file that does
/// not exist in the store is skipped: the importer reports it.
///
/// # Errors
/// The URL is not of a store, the store does not answer, or a file is missing or too long.
pub async fn fetch(url: &str, folder: &Path) -> anyhow::Result<PathBuf> {
    let Some((root, name)) = url.rsplit_once('/').filter(|(_, name)| !name.is_empty()) else {
        bail!("{url}: names no model");
    };
    let objects = Objects::of_url(root)?;
    let file = folder.join(name);
    objects.download(name, &file, MAX_FILE_BYTES).await?;
    let mut to_read = vec![file.clone()];
    let mut seen = 1;
    while let Some(next) = to_read.pop() {
        for named in named_in(&next)? {
            // Paths outside the scene's folder are skipped: the importer refuses them.
            let Ok(relative) = named.strip_prefix(folder) else { continue };
            if named.exists() || !relative.components().all(|part| matches!(part, Component::Normal(_))) {
                continue;
            }
            seen += 1;
            if seen > MAX_FILES {
                bail!("{url}: names more than {MAX_FILES} files");
            }
            if let Some(parent) = named.parent() {
                std::fs::create_dir_all(parent).with_context(|| parent.display().to_string())?;
            }
            let parts: Vec<_> = relative.iter().map(|part| part.to_string_lossy()).collect();
            match objects.download(&parts.join("/"), &named, MAX_FILE_BYTES).await {
                // Textures are named in the MTL file, so the OBJ file is read again once its MTL file is there.
                Ok(()) if has_extension(&named, &["mtl"]) => to_read.push(next.clone()),
                Ok(()) => to_read.push(named),
                Err(StoreError::NoSuchObject { .. }) => {}
                Err(why) => return Err(why.into()),
            }
        }
    }
    Ok(file)
}

/// Paths of the files that a file names.
fn named_in(file: &Path) -> anyhow::Result<Vec<PathBuf>> {
    let folder = file.parent().unwrap_or(Path::new(""));
    if has_extension(file, &["toml"]) {
        let text = std::fs::read_to_string(file).with_context(|| file.display().to_string())?;
        // Errors of syntax are reported when the file is read as a scene.
        let Ok(table) = text.parse::<toml::Table>() else { return Ok(Vec::new()) };
        let assets = table.get("asset").and_then(toml::Value::as_array).into_iter().flatten();
        let files = assets.filter_map(|asset| asset.get("file"));
        let features = table.get("terrain").and_then(|terrain| terrain.get("features"));
        let all = files.chain(features).filter_map(toml::Value::as_str);
        return Ok(all.map(|name| folder.join(name)).collect());
    }
    if is_streamed(file) {
        return Ok(ModelFile::streamed(file).dependencies().to_vec());
    }
    if !has_extension(file, &["obj", "gltf", "glb"]) {
        return Ok(Vec::new());
    }
    let bytes = lodestream_import::read_file(file, MAX_FILE_BYTES)?;
    Ok(lodestream_import::dependencies(file, &bytes))
}
