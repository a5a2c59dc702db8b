//! The background thread that prepares files: first a coarse scene of large models that are not in the cache, then the
//! whole scene, and with `--watch` a new one when a file has changed.

use std::io::Write as _;
use std::net::SocketAddr;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use anyhow::{Context as _, bail};
use lodestream_bake::prepare::{Options, Watch, cache, prefer_least_effort};
use lodestream_bake::scene::{self, Scene, UpAxis};
use lodestream_bake::sources::Sources;
use lodestream_bake::stderr::one_line;
use lodestream_bake::whole_scene::{WholeScene, WholeSceneError};
use lodestream_client::net::Address;

use super::folder::SceneFolder;
use super::share::Share;
use super::stamp::{Stamp, stamp};

/// Interval at which files are examined. One that is being written is read once it rests for as long.
const WATCH_INTERVAL: Duration = Duration::from_millis(500);

/// How files are prepared.
#[derive(Clone, Debug, Default)]
pub(crate) struct LocalOptions {
    /// Folder of prepared packs; `None`: the server's default.
    pub(crate) cache: Option<PathBuf>,
    /// Whether a coarse scene comes first where it pays.
    pub(crate) coarse_first: bool,
    /// Whether files that change are prepared again.
    pub(crate) watch: bool,
    /// The axis of models that points up; `None`: as their formats have it.
    pub(crate) up: Option<UpAxis>,
    /// Address at which the whole scene is served for others.
    pub(crate) share: Option<SocketAddr>,
    /// Whether standard error shows no progress.
    pub(crate) quiet: bool,
}

/// A scene that can be streamed.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Ready {
    /// Where it is.
    pub(crate) address: Address,
    /// Whether a finer one follows.
    pub(crate) is_coarse: bool,
}

/// State of the thread, for the one that draws.
#[derive(Debug, Default)]
struct Shared {
    /// What is done now; `None` once all is prepared.
    progress: Option<String>,
    /// Files that cannot be shown, with the reason.
    skipped: Vec<String>,
    /// Where others find the scene.
    shared_at: Option<String>,
    /// The newest scene that was not taken.
    ready: Option<Ready>,
    failed: Option<anyhow::Error>,
}

/// Handle of the thread. Once it is dropped, the thread finds that nothing more is wanted, and ends.
#[derive(Debug)]
pub(crate) struct Preparation {
    shared: Arc<Mutex<Shared>>,
    folder: Arc<SceneFolder>,
}

fn locked(shared: &Mutex<Shared>) -> MutexGuard<'_, Shared> {
    shared.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Preparation {
    /// Starts to prepare files, which make up one scene. `notify` is called on the thread when anything has changed.
    ///
    /// # Errors
    /// There is no cache folder, or no thread.
    pub(crate) fn start(
        files: Vec<PathBuf>,
        options: LocalOptions,
        notify: impl Fn() + Clone + Send + 'static,
    ) -> anyhow::Result<Self> {
        let cache = options.cache.clone().or_else(cache::default_folder);
        let cache = cache.context("no cache folder is known: name one with --cache DIR")?;
        let folder = Arc::new(SceneFolder::create(&cache)?);
        let shared = Arc::new(Mutex::new(Shared { progress: Some("opening".into()), ..Shared::default() }));
        let this = Self { shared: Arc::clone(&shared), folder: Arc::clone(&folder) };
        let share = options.share.map(|address| Share::new(address, &cache)).transpose()?;
        let worker = Worker { files, options, cache, folder, shared, share: share.map(Mutex::new), notify };
        std::thread::Builder::new().name("preparation".into()).spawn(move || worker.run())?;
        Ok(this)
    }

    /// The newest scene, unless it was taken already.
    pub(crate) fn take_ready(&self) -> Option<Ready> {
        locked(&self.shared).ready.take()
    }

    /// Why nothing can be shown.
    pub(crate) fn take_failure(&self) -> Option<anyhow::Error> {
        locked(&self.shared).failed.take()
    }

    /// Whether a scene will follow, or waits to be taken.
    pub(crate) fn is_pending(&self) -> bool {
        let shared = locked(&self.shared);
        shared.progress.is_some() || shared.ready.is_some()
    }

    /// What is done now, for the user; `None` once all is prepared.
    pub(crate) fn progress(&self) -> Option<String> {
        locked(&self.shared).progress.clone()
    }

    /// What was left out, and where the scene is shared, for the user.
    pub(crate) fn message(&self) -> Option<String> {
        let shared = locked(&self.shared);
        let lines: Vec<&str> = shared.skipped.iter().chain(&shared.shared_at).map(String::as_str).collect();
        (!lines.is_empty()).then(|| lines.join("\n"))
    }
}

impl Drop for Preparation {
    fn drop(&mut self) {
        self.folder.close();
    }
}

struct Worker<N> {
    files: Vec<PathBuf>,
    options: LocalOptions,
    cache: PathBuf,
    folder: Arc<SceneFolder>,
    shared: Arc<Mutex<Shared>>,
    share: Option<Mutex<Share>>,
    notify: N,
}

impl<N: Fn() + Clone + Send + 'static> Worker<N> {
    fn run(self) {
        let mut seen = self.stamped(self.files.clone());
        match self.show(&mut seen) {
            Ok(()) => self.report(|shared| shared.progress = None),
            Err(why) => return self.report(|shared| shared.failed = Some(why)),
        }
        while (self.options.watch || self.share.is_some()) && !self.folder.is_closed() {
            std::thread::sleep(WATCH_INTERVAL);
            if !self.options.watch {
                continue;
            }
            let now = stamp(&seen.0);
            if now == seen.1 {
                continue;
            }
            std::thread::sleep(WATCH_INTERVAL);
            if now != stamp(&seen.0) {
                continue;
            }
            seen.1 = now;
            self.report(|shared| shared.skipped.clear());
            if let Err(why) = self.show(&mut seen) {
                self.skip(format!("not shown anew: {}", one_line(why.as_ref())));
            }
            self.report(|shared| shared.progress = None);
        }
    }

    fn stamped(&self, files: Vec<PathBuf>) -> (Vec<PathBuf>, Stamp) {
        let stamp = stamp(&files);
        (files, stamp)
    }

    /// Prepares and publishes the scene. `seen` becomes the files that were read, as they were before.
    fn show(&self, seen: &mut (Vec<PathBuf>, Stamp)) -> anyhow::Result<()> {
        let sources = Sources::in_folder(&self.cache);
        let mut files = self.files.clone();
        let mut coarse_first = self.options.coarse_first;
        loop {
            self.progress(format!("reading {}", names(&files)));
            let mut scene =
                match scene::of_files_in(&files, &Options::default().preparation_settings, &sources) {
                    Ok(scene) => scene,
                    Err(why) => {
                        self.leave_out_unreadable(&mut files, why.into(), &sources)?;
                        continue;
                    }
                };
            if self.options.up.is_some() && scene.instances.is_some() {
                bail!("--up is for models: a scene file says itself how its models stand");
            }
            scene.up = self.options.up;
            if self.share.is_none() {
                prefer_least_effort(&mut scene.assets, &self.cache, &sources);
            }
            let mut read: Vec<PathBuf> = self.files.clone();
            read.extend(scene.files.iter().chain(scene.assets.iter().map(|asset| &asset.file)).cloned());
            read.sort_unstable();
            read.dedup();
            if read != seen.0 {
                *seen = self.stamped(read);
            }
            if std::mem::take(&mut coarse_first) {
                match self.show_coarse(&scene, &sources) {
                    Ok(()) => {}
                    Err(why) => {
                        leave_out(&mut files, why, |text| self.skip(text))?;
                        coarse_first = true;
                        continue;
                    }
                }
            }
            self.progress(format!("preparing {}", names(&files)));
            match WholeScene::prepare(scene, &self.cache, &self.options_for(true), &sources) {
                Ok(whole) => {
                    let mut more: Vec<PathBuf> = whole.files.clone();
                    more.retain(|file| !seen.0.contains(file));
                    seen.1.extend(stamp(&more));
                    seen.0.extend(more);
                    return self.publish(whole, false);
                }
                Err(why) => leave_out(&mut files, why, |text| self.skip(text))?,
            }
        }
    }

    /// Publishes coarse stand-ins of large models, if it pays.
    fn show_coarse(&self, scene: &Scene, sources: &Sources) -> Result<(), WholeSceneError> {
        let folder = tempfile::Builder::new().prefix("coarse-").tempdir_in(self.folder.path());
        // Without, the whole scene is shown later.
        let Ok(folder) = folder else { return Ok(()) };
        let options = self.options_for(false);
        let coarse = WholeScene::coarse(scene, &self.cache, folder.path(), &options, sources)?;
        if let Some(coarse) = coarse
            && let Err(why) = self.publish(coarse, true)
        {
            tracing::debug!("no coarse scene: {why:#}");
        }
        Ok(())
    }

    fn publish(&self, scene: WholeScene, is_coarse: bool) -> anyhow::Result<()> {
        let address = self.folder.publish(scene)?;
        let file = PathBuf::from(&address.scene);
        self.report(|shared| shared.ready = Some(Ready { address, is_coarse }));
        if let Some(share) = self.share.as_ref().filter(|_| !is_coarse) {
            let urls = share.lock().unwrap_or_else(PoisonError::into_inner).serve(&file)?;
            for url in urls {
                // Standard output may be closed.
                let _ = writeln!(std::io::stdout(), "{url}");
                self.report(|shared| {
                    shared.shared_at.get_or_insert_with(|| format!("shared at {url}"));
                });
            }
        }
        Ok(())
    }

    fn options_for(&self, reports: bool) -> Options {
        let (shared, folder, notify) =
            (Arc::clone(&self.shared), Arc::clone(&self.folder), Mutex::new(self.notify.clone()));
        let watch = Watch::new(move |name, progress| {
            let percent = 100 * progress.faces_done / progress.faces_total.max(1);
            let text = Some(format!("preparing {name}: {percent} %"));
            let changed = reports && {
                let mut shared = locked(&shared);
                let changed = shared.progress != text;
                if changed {
                    shared.progress = text;
                }
                changed
            };
            if changed && let Ok(notify) = notify.lock() {
                notify();
            }
            !folder.is_closed()
        });
        Options { quiet: self.options.quiet, watch: Some(watch), ..Options::default() }
    }

    /// Leaves out the files that cannot be read as models by themselves.
    fn leave_out_unreadable(
        &self,
        files: &mut Vec<PathBuf>,
        why: anyhow::Error,
        sources: &Sources,
    ) -> anyhow::Result<()> {
        let settings = Options::default().preparation_settings;
        let mut bad = Vec::new();
        if files.len() > 1 {
            for file in files.iter() {
                if let Err(why) = scene::of_files_in(std::slice::from_ref(file), &settings, sources) {
                    bad.push((file.clone(), why));
                }
            }
        }
        if bad.is_empty() || bad.len() == files.len() {
            return Err(why);
        }
        for (file, why) in bad {
            files.retain(|other| *other != file);
            self.skip(format!("skipped {}: {why}", file.display()));
        }
        Ok(())
    }

    fn skip(&self, text: String) {
        tracing::warn!("{text}");
        self.report(|shared| shared.skipped.push(text));
    }

    fn progress(&self, text: String) {
        self.report(|shared| shared.progress = Some(text));
    }

    fn report(&self, change: impl FnOnce(&mut Shared)) {
        change(&mut locked(&self.shared));
        (self.notify)();
    }
}

/// Leaves out the file of an asset that cannot be prepared, unless nothing would be left, or a scene file needs it.
fn leave_out(
    files: &mut Vec<PathBuf>,
    WholeSceneError { asset, why }: WholeSceneError,
    skip: impl FnOnce(String),
) -> anyhow::Result<()> {
    let at_fault = asset.and_then(|asset| files.iter().position(|file| *file == asset.file));
    let Some(at_fault) = at_fault.filter(|_| files.len() > 1) else { return Err(why.into()) };
    let file = files.remove(at_fault);
    skip(format!("skipped {}: {why}", file.display()));
    Ok(())
}

/// The name of the file, or how many there are.
fn names(files: &[PathBuf]) -> String {
    match files {
        [file] => Path::new(file.file_name().unwrap_or_default()).display().to_string(),
        _ => format!("{} files", files.len()),
    }
}

#[cfg(test)]
mod tests {
    use std::fmt::Write as _;
    use std::sync::mpsc;

    use super::*;

    /// A hilly square of `2 × cells²` faces.
    fn write_hills(path: &Path, cells: usize) {
        let mut obj = String::new();
        for (i, j) in (0..=cells).flat_map(|i| (0..=cells).map(move |j| (i, j))) {
            let [x, z] = [i, j].map(|at| at as f64 / cells as f64);
            writeln!(obj, "v {x:.5} {:.5} {z:.5}", 0.1 * (9.0 * x).sin() * (7.0 * z).cos()).unwrap();
        }
        let at = |i: usize, j: usize| 1 + i * (cells + 1) + j;
        for (i, j) in (0..cells).flat_map(|i| (0..cells).map(move |j| (i, j))) {
            writeln!(obj, "f {} {} {} {}", at(i, j), at(i, j + 1), at(i + 1, j + 1), at(i + 1, j)).unwrap();
        }
        std::fs::write(path, obj).unwrap();
    }

    /// Prepares files until all is done, and returns the scenes in order, which of them are coarse, and the last message.
    /// The thread waits after each change until it was looked at, so that none is missed.
    fn prepared(files: &[PathBuf], cache: &Path) -> anyhow::Result<(Vec<bool>, Option<String>)> {
        prepared_with(files, options(cache))
    }

    fn options(cache: &Path) -> LocalOptions {
        let cache = Some(cache.to_owned());
        LocalOptions { cache, coarse_first: true, quiet: true, ..LocalOptions::default() }
    }

    fn prepared_with(
        files: &[PathBuf],
        options: LocalOptions,
    ) -> anyhow::Result<(Vec<bool>, Option<String>)> {
        let (sender, changes) = mpsc::sync_channel(0);
        let preparation = Preparation::start(files.to_vec(), options, move || {
            let _ = sender.send(());
        })?;
        let mut scenes = Vec::new();
        loop {
            changes.recv()?;
            if let Some(why) = preparation.take_failure() {
                return Err(why);
            }
            if let Some(ready) = preparation.take_ready() {
                assert!(Path::new(&ready.address.scene).exists());
                scenes.push(ready.is_coarse);
            }
            if !preparation.is_pending() {
                return Ok((scenes, preparation.message()));
            }
        }
    }

    /// What is in a cache folder besides packs.
    fn left(cache: &Path) -> Vec<String> {
        let names = std::fs::read_dir(cache).unwrap();
        let names = names.map(|entry| entry.unwrap().file_name().into_string().unwrap());
        names.filter(|name| !name.ends_with(".lsp")).collect()
    }

    #[test]
    fn a_coarse_scene_precedes_a_large_one_that_is_not_in_the_cache() {
        let folder = tempfile::tempdir().unwrap();
        let (model, cache) = (folder.path().join("a.obj"), folder.path().join("cache"));
        write_hills(&model, 250);
        assert_eq!(prepared(std::slice::from_ref(&model), &cache).unwrap(), (vec![true, false], None));
        assert_eq!(prepared(&[model], &cache).unwrap(), (vec![false], None));
        assert_eq!(left(&cache), Vec::<String>::new());
    }

    /// Of each pack in a cache folder, whether it was prepared with the least effort.
    fn made_with_least_effort(cache: &Path) -> Vec<bool> {
        let paths = std::fs::read_dir(cache).unwrap().map(|entry| entry.unwrap().path());
        let packs = paths.filter(|path| path.extension().is_some_and(|extension| extension == "lsp"));
        let settings = |path: PathBuf| lodestream_store::PackFile::open(&path).unwrap().settings().unwrap();
        packs.map(|path| settings(path).ends_with(", effort least")).collect()
    }

    #[test]
    fn packs_that_stay_here_are_made_with_the_least_effort_and_shared_ones_with_all() {
        let folder = tempfile::tempdir().unwrap();
        let (model, cache) = (folder.path().join("a.obj"), folder.path().join("cache"));
        write_hills(&model, 4);
        prepared(std::slice::from_ref(&model), &cache).unwrap();
        assert_eq!(made_with_least_effort(&cache), [true]);
        let share = "127.0.0.1:0".parse().ok();
        prepared_with(std::slice::from_ref(&model), LocalOptions { share, ..options(&cache) }).unwrap();
        let mut both = made_with_least_effort(&cache);
        both.sort_unstable();
        assert_eq!(both, [false, true]);
        // The small one is there now.
        prepared(&[model], &cache).unwrap();
        assert_eq!(made_with_least_effort(&cache).len(), 2);
    }

    #[test]
    fn bad_files_are_left_out_and_named() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        std::fs::write(at("b.obj"), "v 0 0 0\nf 1 2 3\n").unwrap();
        std::fs::write(at("c.glb"), "no glTF").unwrap();
        write_hills(&at("a.obj"), 4);
        let (scenes, message) = prepared(&["a.obj", "b.obj", "c.glb"].map(at), &at("cache")).unwrap();
        let message = message.unwrap();
        assert_eq!(scenes, [false]);
        assert!(message.contains("b.obj") && message.contains("c.glb"), "{message}");
        assert_eq!(message.lines().count(), 2, "{message}");
        assert_eq!(left(&at("cache")), Vec::<String>::new());
    }

    #[test]
    fn a_preparation_that_is_not_wanted_any_more_leaves_nothing() {
        let folder = tempfile::tempdir().unwrap();
        let (model, cache) = (folder.path().join("a.obj"), folder.path().join("cache"));
        write_hills(&model, 300);
        let (sender, changes) = mpsc::sync_channel(0);
        let options = LocalOptions { cache: Some(cache.clone()), quiet: true, ..LocalOptions::default() };
        let preparation = Preparation::start(vec![model], options, move || {
            let _ = sender.send(());
        })
        .unwrap();
        while !preparation.progress().unwrap().contains('%') {
            changes.recv().unwrap();
        }
        assert_eq!(left(&cache).len(), 1, "{:?}", left(&cache));
        drop(preparation);
        // The thread goes on until it finds out.
        while changes.recv().is_ok() {}
        assert_eq!(std::fs::read_dir(&cache).unwrap().count(), 0);
    }
}
