//! The scenes that a daemon serves: a map from names to immutable versions.
//!
//! A session keeps its version from start to end. A reload puts another version under the name. A scene with the same
//! fingerprint is the same version; the old one stays, with its plans.

use std::collections::BTreeMap;
use std::fmt;
use std::sync::{Arc, PoisonError, RwLock};

use lodestream_protocol::server::Plans;
use lodestream_protocol::source::{CacheUse, SceneSource};
use lodestream_protocol::stream::alpn_of_scene;
use serde_json::json;
use tokio::sync::{OnceCell, watch};

use crate::session::scene_preview::PreviewFile;

/// Paths of the HTTP ports, which cannot be names of scenes.
const RESERVED_NAMES: [&str; 5] = ["health", "metrics", "ready", "scenes", "stream"];
/// Most names in a message.
const MAX_LISTED_NAMES: usize = 8;

/// One version of a scene, and the plans that its sessions share.
pub struct SceneVersion {
    source: Arc<dyn SceneSource>,
    plans: Arc<Plans>,
    /// For the page; `None` in it if the scene has none.
    preview: OnceCell<Option<Arc<PreviewFile>>>,
}

impl SceneVersion {
    fn new(source: Arc<dyn SceneSource>) -> Arc<Self> {
        Arc::new(Self { source, plans: Plans::new(), preview: OnceCell::new() })
    }

    /// The scene.
    #[must_use]
    pub fn source(&self) -> &Arc<dyn SceneSource> {
        &self.source
    }

    /// Transmission plans, shared by all sessions of the version.
    pub(crate) const fn plans(&self) -> &Arc<Plans> {
        &self.plans
    }

    /// The page's preview of it.
    pub(crate) const fn preview(&self) -> &OnceCell<Option<Arc<PreviewFile>>> {
        &self.preview
    }

    /// Its name.
    #[must_use]
    pub fn name(&self) -> &str {
        &self.source.header().name
    }
}

impl fmt::Debug for SceneVersion {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let header = self.source.header();
        f.debug_struct("SceneVersion")
            .field("name", &header.name)
            .field("fingerprint", &header.fingerprint)
            .finish()
    }
}

/// Why scenes cannot be served together.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum ScenesError {
    /// No scene.
    #[error("there is no scene to serve")]
    Empty,
    /// Two scenes with one name.
    #[error("two scenes are named {0:?}; give one of them another name in its file (name = …)")]
    DuplicateName(String),
    /// A name that is a path of the HTTP port.
    #[error("no scene can be named {0:?}, which is a path of the HTTP port; give it another name (name = …)")]
    ReservedName(String),
    /// A scene without a name.
    #[error("a scene has no name and cannot be requested; give it one (name = …)")]
    Unnamed,
}

/// Names whose scene changed in a reload.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct SceneChanges {
    /// New names.
    pub added: Vec<String>,
    /// Names with a new version.
    pub changed: Vec<String>,
    /// Names that are gone.
    pub removed: Vec<String>,
}

impl SceneChanges {
    /// Whether nothing changed.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        *self == Self::default()
    }
}

/// An immutable snapshot of the scenes.
#[derive(Debug, Default)]
pub(crate) struct Table {
    by_name: BTreeMap<String, Arc<SceneVersion>>,
    /// ALPN names of the scenes; empty with one scene, which need not be named.
    by_alpn: BTreeMap<Vec<u8>, String>,
}

impl Table {
    fn new(sources: Vec<Arc<dyn SceneSource>>) -> Result<Self, ScenesError> {
        let mut by_name = BTreeMap::new();
        for source in sources {
            let name = source.header().name.clone();
            if name.is_empty() {
                return Err(ScenesError::Unnamed);
            }
            if RESERVED_NAMES.contains(&name.as_str()) {
                return Err(ScenesError::ReservedName(name));
            }
            if by_name.insert(name.clone(), SceneVersion::new(source)).is_some() {
                return Err(ScenesError::DuplicateName(name));
            }
        }
        let several = by_name.len() > 1;
        let alpn = |name: &String| (alpn_of_scene(name).into_bytes(), name.clone());
        let by_alpn = by_name.keys().filter(|_| several).map(alpn).collect();
        Ok(Self { by_name, by_alpn })
    }

    /// All names, in order.
    pub(crate) fn names(&self) -> impl Iterator<Item = &str> {
        self.by_name.keys().map(String::as_str)
    }

    /// All versions, by name.
    pub(crate) fn versions(&self) -> impl Iterator<Item = &Arc<SceneVersion>> {
        self.by_name.values()
    }

    /// ALPN names of the scenes.
    pub(crate) fn alpns(&self) -> impl Iterator<Item = &[u8]> {
        self.by_alpn.keys().map(Vec::as_slice)
    }

    /// Name of the scene with this ALPN name.
    pub(crate) fn named(&self, alpn: &[u8]) -> Option<&str> {
        self.by_alpn.get(alpn).map(String::as_str)
    }
}

/// The served scenes, replaceable while sessions run.
pub struct Scenes {
    table: RwLock<Arc<Table>>,
    /// Cache use of versions that were replaced.
    replaced_cache_use: RwLock<CacheUse>,
    replacements: watch::Sender<u64>,
}

impl fmt::Debug for Scenes {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_set().entries(self.table().by_name.values()).finish()
    }
}

impl Scenes {
    /// Serves scenes under the names in their headers.
    ///
    /// # Errors
    /// No scene, two scenes with one name, or a reserved or empty name.
    pub fn new(sources: Vec<Arc<dyn SceneSource>>) -> Result<Self, ScenesError> {
        let table = Table::new(sources)?;
        if table.by_name.is_empty() {
            return Err(ScenesError::Empty);
        }
        Ok(Self::of(table))
    }

    /// Serves one scene, under any name.
    #[must_use]
    pub fn one(source: Arc<dyn SceneSource>) -> Self {
        let by_name = [(source.header().name.clone(), SceneVersion::new(source))].into();
        Self::of(Table { by_name, ..Table::default() })
    }

    fn of(table: Table) -> Self {
        Self {
            table: RwLock::new(Arc::new(table)),
            replaced_cache_use: RwLock::new(CacheUse::default()),
            replacements: watch::Sender::new(0),
        }
    }

    /// The current snapshot.
    pub(crate) fn table(&self) -> Arc<Table> {
        Arc::clone(&self.table.read().unwrap_or_else(PoisonError::into_inner))
    }

    /// The scene of this name.
    #[must_use]
    pub fn get(&self, name: &str) -> Option<Arc<SceneVersion>> {
        self.table().by_name.get(name).cloned()
    }

    /// The scene, if there is exactly one.
    #[must_use]
    pub fn only(&self) -> Option<Arc<SceneVersion>> {
        let all = &self.table().by_name;
        if all.len() == 1 { all.values().next().cloned() } else { None }
    }

    /// A counter of replacements, to wait for the next one.
    pub(crate) fn replacements(&self) -> watch::Receiver<u64> {
        self.replacements.subscribe()
    }

    /// Replaces the served scenes; running sessions keep their versions. After an error nothing has changed.
    ///
    /// # Errors
    /// As [`Scenes::new`], except that there may be no scene.
    pub fn replace(&self, sources: Vec<Arc<dyn SceneSource>>) -> Result<SceneChanges, ScenesError> {
        let mut new = Table::new(sources)?;
        let mut changes = SceneChanges::default();
        let mut table = self.table.write().unwrap_or_else(PoisonError::into_inner);
        for (name, version) in &mut new.by_name {
            match table.by_name.get(name) {
                Some(old) if old.source.header().fingerprint == version.source.header().fingerprint => {
                    *version = Arc::clone(old);
                }
                Some(_) => changes.changed.push(name.clone()),
                None => changes.added.push(name.clone()),
            }
        }
        let stays = |name: &String, old| new.by_name.get(name).is_some_and(|new| Arc::ptr_eq(new, old));
        let gone = table.by_name.iter().filter(|(name, old)| !stays(name, old));
        let mut before = self.replaced_cache_use.write().unwrap_or_else(PoisonError::into_inner);
        for (name, old) in gone {
            if !new.by_name.contains_key(name) {
                changes.removed.push(name.clone());
            }
            *before = sum(*before, old.source.cache_use());
        }
        *table = Arc::new(new);
        drop((table, before));
        if !changes.is_empty() {
            self.replacements.send_modify(|count| *count = count.wrapping_add(1));
        }
        Ok(changes)
    }

    /// Hits and misses of the scenes' caches since the start; `None` if no scene has a cache.
    pub(crate) fn cache_use(&self) -> Option<CacheUse> {
        let before = *self.replaced_cache_use.read().unwrap_or_else(PoisonError::into_inner);
        let now: Vec<CacheUse> =
            self.table().by_name.values().filter_map(|version| version.source.cache_use()).collect();
        let any = !now.is_empty() || before != CacheUse::default();
        any.then(|| now.into_iter().fold(before, |all, one| sum(all, Some(one))))
    }

    /// Message for a request of a scene that does not exist, or names none; lists other scenes only if `listed`.
    pub(crate) fn missing(&self, name: &str, listed: bool) -> String {
        let all = &self.table().by_name;
        let some: Vec<String> = all.keys().take(MAX_LISTED_NAMES).map(|name| format!("'{name}'")).collect();
        let more = if all.len() > MAX_LISTED_NAMES { ", … (see /scenes)" } else { "" };
        let others = if listed && !some.is_empty() {
            format!("; this server has {}{more}", some.join(", "))
        } else {
            String::new()
        };
        if name.is_empty() {
            return format!("the address must name a scene, as in ws://HOST:PORT/NAME{others}");
        }
        format!("there is no scene '{name}'{others}")
    }

    /// The scenes for which `listed` returns true, as JSON: name, fingerprint, numbers of assets and instances.
    pub(crate) fn list(&self, listed: impl Fn(&str) -> bool) -> String {
        let all = &self.table().by_name;
        let scenes = all.values().filter(|version| listed(version.name())).map(|version| {
            let header = version.source.header();
            let fingerprint: String = header.fingerprint.iter().map(|byte| format!("{byte:02x}")).collect();
            json!({
                "name": header.name,
                "fingerprint": fingerprint,
                "assets": header.asset_count,
                "instances": header.instance_count,
            })
        });
        format!("{:#}\n", json!({ "scenes": scenes.collect::<Vec<_>>() }))
    }
}

impl<S: SceneSource + 'static> From<Arc<S>> for Scenes {
    fn from(source: Arc<S>) -> Self {
        Self::one(source)
    }
}

impl From<Arc<dyn SceneSource>> for Scenes {
    fn from(source: Arc<dyn SceneSource>) -> Self {
        Self::one(source)
    }
}

fn sum(all: CacheUse, one: Option<CacheUse>) -> CacheUse {
    let one = one.unwrap_or_default();
    CacheUse { hits: all.hits + one.hits, misses: all.misses + one.misses }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::session::memory_scene::MemoryScene;

    fn scene(name: &str, assets: u32) -> Arc<dyn SceneSource> {
        Arc::new(MemoryScene::named(name, assets, 100, 100))
    }

    #[test]
    fn invalid_names_are_refused() {
        let with =
            |names: &[&str]| Scenes::new(names.iter().map(|name| scene(name, 1)).collect()).unwrap_err();
        assert_eq!(with(&[]), ScenesError::Empty);
        assert_eq!(with(&["a", "b", "a"]), ScenesError::DuplicateName("a".into()));
        assert_eq!(with(&["a", "ready"]), ScenesError::ReservedName("ready".into()));
        assert_eq!(with(&["a", ""]), ScenesError::Unnamed);
    }

    #[test]
    fn replacing_keeps_equal_versions_and_an_error_changes_nothing() {
        let scenes = Scenes::new(vec![scene("a", 1), scene("b", 1), scene("c", 1)]).unwrap();
        let [a, b] = ["a", "b"].map(|name| scenes.get(name).unwrap());
        let replacements = scenes.replacements();
        let changes = scenes.replace(vec![scene("a", 1), scene("b", 2), scene("d", 1)]).unwrap();
        let expected =
            SceneChanges { added: vec!["d".into()], changed: vec!["b".into()], removed: vec!["c".into()] };
        assert_eq!(changes, expected);
        assert!(replacements.has_changed().unwrap());
        assert!(Arc::ptr_eq(&a, &scenes.get("a").unwrap()));
        assert!(!Arc::ptr_eq(&b, &scenes.get("b").unwrap()));
        assert!(scenes.get("c").is_none());
        let before = scenes.table();
        assert!(scenes.replace(vec![scene("a", 2), scene("a", 3)]).is_err());
        assert!(Arc::ptr_eq(&before, &scenes.table()));
        assert_eq!(
            scenes.replace(vec![scene("a", 1), scene("b", 2), scene("d", 1)]),
            Ok(SceneChanges::default())
        );
    }

    #[test]
    fn the_list_is_json_of_the_listed_scenes() {
        let scenes = Scenes::new(vec![scene("a \"b\"", 1), scene("c", 2)]).unwrap();
        let list: serde_json::Value = serde_json::from_str(&scenes.list(|name| name != "c")).unwrap();
        assert_eq!(list["scenes"].as_array().unwrap().len(), 1);
        assert_eq!(list["scenes"][0]["name"], "a \"b\"");
        assert_eq!(list["scenes"][0]["fingerprint"].as_str().unwrap().len(), 32);
        assert!(scenes.missing("x", true).contains("'c'") && !scenes.missing("x", false).contains("'c'"));
    }
}
