//! Publishing: writes a scene and its packs as objects, from which any server can serve the scene.
//!
//! A pack's name is a hash of its inputs, so a pack that exists is neither prepared nor written again, whichever
//! machine made it. The scene object, the only object that is ever replaced, is written last.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use bytes::Bytes;
use lodestream_daemon::Page;
use lodestream_geometry::pack::{HEAD_BYTES, Head};
use lodestream_import::MAX_FILE_BYTES;

use super::place::PUBLISHED;
use lodestream_bake::compose::describe;
use lodestream_bake::prepare::cache::Key;
use lodestream_bake::prepare::{Options, keys_of, prepare_all_of};
use lodestream_bake::proxies::make_with;
use lodestream_bake::scene::Scene;
use lodestream_bake::sources::Sources;
use lodestream_bake::stderr::write_line;
use lodestream_bake::warnings::Warnings;
use lodestream_scene::blob::BlobPart;
use lodestream_scene::published::pack_name;
use lodestream_store::{
    MAX_SCENE_OBJECT_BYTES, Objects, PackFile, SceneDescription, SceneObject, StoreError,
};
use tokio::runtime::{Handle, RuntimeFlavor};

/// Result of publishing a scene.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Published {
    /// Name of the scene object.
    pub name: String,
    /// Packs that were prepared.
    pub prepared: usize,
    /// Packs that were written.
    pub written: usize,
    /// Packs that existed already.
    pub there: usize,
    /// Whether the scene object was written: it did not exist or differed.
    pub scene_written: bool,
    /// The scene's preview for the page, if it has one.
    pub preview: Option<Vec<u8>>,
}

impl std::fmt::Display for Published {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Self { name, prepared, written, there, scene_written, .. } = self;
        let scene = if *scene_written { "written" } else { "unchanged" };
        write!(f, "{name} {scene}; packs: {written} written, {there} existing, {prepared} prepared")
    }
}

/// Publishes a scene. Packs are prepared in `cache`, as for serving. Packs of proxies that another machine prepared are only
/// downloaded in a runtime of several threads, since this one waits for them.
///
/// # Errors
/// As [`publish_from`].
pub async fn publish(
    scene: &Scene,
    objects: &Objects,
    cache: &Path,
    options: &Options,
) -> anyhow::Result<Published> {
    publish_from(scene, objects, cache, options, &Sources::in_folder(cache)).await
}

/// As [`publish`], with the model files that the scene was found in.
///
/// # Errors
/// A model cannot be prepared, or the store does not answer or refuses an object. Objects written until then are
/// complete, and the next call uses them.
pub async fn publish_from(
    scene: &Scene,
    objects: &Objects,
    cache: &Path,
    options: &Options,
    sources: &Sources,
) -> anyhow::Result<Published> {
    let mut done = Published::default();
    let keys = keys_of(&scene.assets, options, sources)?;
    for (asset, key) in scene.assets.iter().zip(&keys) {
        download(objects, &key.path(cache, &asset.name), key).await?;
    }
    let mut warnings = Warnings::default();
    let prepared = prepare_all_of(&scene.assets, cache, options, sources, |number, cached| {
        if let Some(report) = &cached.report {
            done.prepared += 1;
            warnings.add(&scene.assets[number].file, &report.warnings);
            write_line(format_args!("{}: {report}", scene.assets[number].name));
        }
    });
    warnings.lines().for_each(|warning| write_line(format_args!("warning: {warning}")));
    let packs: Vec<PackFile> = prepared?.into_iter().map(|cached| cached.pack).collect();
    let mut downloaded = Ok(());
    // The key of a proxy's pack is known once those that it is made from are there.
    let forest = make_with(scene, &packs, cache, options, &mut |local, key| {
        if downloaded.is_ok() && Handle::current().runtime_flavor() != RuntimeFlavor::CurrentThread {
            let wait = || Handle::current().block_on(download(objects, local, key));
            downloaded = tokio::task::block_in_place(wait);
        }
    })?;
    downloaded?;
    if let Some(forest) = forest.as_ref().filter(|forest| forest.prepared > 0) {
        done.prepared += forest.prepared;
        write_line(format_args!("{}: {forest}", scene.name));
    }
    let of_proxies = forest.iter().flat_map(|forest| &forest.packs);
    let keyed = packs.iter().zip(keys.iter().map(Key::bytes));
    let keyed = keyed.chain(of_proxies.map(|pack| (pack, pack.made_from())));
    let mut keys: BTreeMap<PathBuf, [u8; 32]> = BTreeMap::new();
    for (pack, key) in keyed {
        keys.insert(pack.path().to_owned(), key);
        let name = pack_name(&key);
        if is_there(objects, &name, pack).await? {
            done.there += 1;
        } else {
            objects.put(&name, Bytes::from(std::fs::read(pack.path())?)).await?;
            done.written += 1;
        }
    }
    let (description, packs) = describe(scene, packs, forest)?;
    done.preview = preview(&description, &packs);
    let contents_of = |pack: &PackFile| pack.published(keys.get(pack.path()).copied().unwrap_or_default());
    let object = SceneObject { packs: packs.iter().map(contents_of).collect::<Result<_, _>>()?, description };
    done.name = format!("{}{PUBLISHED}", object_name(&scene.name));
    let bytes = object.encode().map_err(|what| anyhow::anyhow!("{}: {what}", scene.name))?;
    let before = match objects.whole(&done.name, MAX_SCENE_OBJECT_BYTES).await {
        Ok(before) => Some(before),
        Err(StoreError::NoSuchObject { .. }) => None,
        Err(why) => return Err(why.into()),
    };
    if before.is_none_or(|before| before != bytes) {
        objects.put(&done.name, bytes.into()).await?;
        done.scene_written = true;
    }
    Ok(done)
}

/// Downloads a pack that another machine prepared, unless it is here; the preparation verifies it.
async fn download(objects: &Objects, local: &Path, key: &Key) -> anyhow::Result<()> {
    let name = pack_name(&key.bytes());
    if !local.exists() && objects.length(&name).await?.is_some() {
        std::fs::create_dir_all(local.parent().unwrap_or(local))?;
        if let Err(why) = objects.download(&name, local, MAX_FILE_BYTES).await {
            write_line(format_args!("warning: the pack is prepared again: {why}"));
        }
    }
    Ok(())
}

/// The preview; a scene without one is published all the same.
fn preview(description: &SceneDescription, packs: &[PackFile]) -> Option<Vec<u8>> {
    let read = |asset: u32, part: BlobPart| {
        let pack = packs.get(asset as usize).map(|pack| pack.read(part).map(|bytes| bytes.to_vec()));
        pack.transpose().map_err(anyhow::Error::from)
    };
    let made = lodestream_preview::encode(&description.header, &description.pages, read);
    made.inspect_err(|why| write_line(format_args!("warning: no preview: {why}"))).ok()
}

/// Publishes the page for browsers beside a published scene: its files, named by content, and `NAME.html`, which shows
/// the scene. Gives the name of the latter.
///
/// # Errors
/// The store does not answer or refuses an object.
pub async fn publish_page(
    page: &Page,
    published: &Published,
    objects: &Objects,
) -> Result<String, StoreError> {
    let scene = &published.name;
    let index = format!("{}.html", scene.strip_suffix(PUBLISHED).unwrap_or(scene));
    for (name, content_type, bytes) in page.published(scene, published.preview.clone(), index.clone()) {
        let exists = name != index && objects.length(&name).await? == Some(bytes.len() as u64);
        if !exists {
            objects.put_typed(&name, bytes, content_type).await?;
        }
    }
    Ok(index)
}

/// Whether an object is this pack. Comparing heads suffices, since a head holds the hashes of all contents.
pub async fn is_there(objects: &Objects, name: &str, pack: &PackFile) -> Result<bool, StoreError> {
    if objects.length(name).await? != Some(pack.total_bytes()) {
        return Ok(false);
    }
    let head = objects.start(name, HEAD_BYTES as u64).await?;
    Ok(Head::parse(&head).is_ok_and(|head| head == *pack.head()))
}

/// The name of a scene's object. Characters that some stores do not accept are removed; a hash of the whole name then
/// keeps different scenes apart.
fn object_name(name: &str) -> String {
    let plain = |c: char| c.is_ascii_alphanumeric() || matches!(c, '-' | '_' | '.');
    if name.chars().all(plain) && !name.is_empty() && !name.starts_with('.') && name.len() <= 100 {
        return name.to_owned();
    }
    let kept: String = name.chars().filter(|c| c.is_ascii_alphanumeric()).take(40).collect();
    format!("{kept}-{}", &blake3::hash(name.as_bytes()).to_hex()[..16])
}
