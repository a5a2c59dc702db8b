//! The scenes that a daemon serves: names, and under each a version of a scene, which nobody changes.
//!
//! A session takes its version when it begins and keeps it until it ends, so to exchange a scene is to put another version
//! under its name. Equal fingerprints are equal versions, and then the one that is there stays, with what was planned
//! for it.

use std::collections::BTreeMap;
use std::fmt;
use std::sync::{Arc, PoisonError, RwLock};

use lodestream_protocol::server::Plans;
use lodestream_protocol::source::{CacheUse, SceneSource};
use lodestream_protocol::stream::alpn_of_scene;
use serde_json::json;
use tokio::sync::watch;

/// Paths of the HTTP ports, which no scene may be called.
const TAKEN: [&str; 5] = ["health", "metrics", "ready", "scenes", "stream"];
/// Most names that a message lists.
const LISTED: usize = 8;

/// A scene as it is, and what its sessions share.
pub struct SceneVersion {
    source: Arc<dyn SceneSource>,
    plans: Arc<Plans>,
}

impl SceneVersion {
    fn new(source: Arc<dyn SceneSource>) -> Arc<Self> {
        Arc::new(Self { source, plans: Plans::new() })
    }

    /// The scene.
    #[must_use]
    pub fn source(&self) -> &Arc<dyn SceneSource> {
        &self.source
    }

    /// What is planned for all its sessions.
    pub(crate) const fn plans(&self) -> &Arc<Plans> {
        &self.plans
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

/// Scenes that cannot be served together.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum ScenesError {
    /// None at all.
    #[error("there is no scene to serve")]
    Empty,
    /// Two of one name.
    #[error("two scenes are called {0:?}; give one of them another name in its file (name = …)")]
    DuplicateName(String),
    /// A name that is something else in an address.
    #[error("no scene may be called {0:?}, which is an address of its own; give it another name (name = …)")]
    ReservedName(String),
    /// No name.
    #[error("a scene without a name cannot be asked for; give it one (name = …)")]
    Unnamed,
}

/// What an exchange came to.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct SceneChanges {
    /// Names that were not there before.
    pub added: Vec<String>,
    /// Names that have another version.
    pub changed: Vec<String>,
    /// Names that are not there any more.
    pub removed: Vec<String>,
}

impl SceneChanges {
    /// Whether all is as it was.
    #[must_use]
    pub fn is_nothing(&self) -> bool {
        *self == Self::default()
    }
}

/// The scenes at one time.
#[derive(Debug, Default)]
pub(crate) struct Table {
    by_name: BTreeMap<String, Arc<SceneVersion>>,
    /// What sessions may name over QUIC; nothing where there is one scene, which need not be named.
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
            if TAKEN.contains(&name.as_str()) {
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

    /// What sessions may name over QUIC.
    pub(crate) fn alpns(&self) -> impl Iterator<Item = &[u8]> {
        self.by_alpn.keys().map(Vec::as_slice)
    }

    /// The scene that such a name stands for.
    pub(crate) fn named(&self, alpn: &[u8]) -> Option<&str> {
        self.by_alpn.get(alpn).map(String::as_str)
    }
}

/// See the module.
pub struct Scenes {
    table: RwLock<Arc<Table>>,
    /// What caches did for versions that were exchanged.
    before: RwLock<CacheUse>,
    exchanges: watch::Sender<u64>,
}

impl fmt::Debug for Scenes {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_set().entries(self.table().by_name.values()).finish()
    }
}

impl Scenes {
    /// These scenes, by the names that they have.
    ///
    /// # Errors
    /// None, two of one name, or a name that none may have.
    pub fn new(sources: Vec<Arc<dyn SceneSource>>) -> Result<Self, ScenesError> {
        let table = Table::new(sources)?;
        if table.by_name.is_empty() {
            return Err(ScenesError::Empty);
        }
        Ok(Self::of(table))
    }

    /// One scene, whatever it is called.
    #[must_use]
    pub fn one(source: Arc<dyn SceneSource>) -> Self {
        let by_name = [(source.header().name.clone(), SceneVersion::new(source))].into();
        Self::of(Table { by_name, ..Table::default() })
    }

    fn of(table: Table) -> Self {
        Self {
            table: RwLock::new(Arc::new(table)),
            before: RwLock::new(CacheUse::default()),
            exchanges: watch::Sender::new(0),
        }
    }

    /// All of them as they are now. (A thread that panicked while it held the lock left one table or the other.)
    pub(crate) fn table(&self) -> Arc<Table> {
        Arc::clone(&self.table.read().unwrap_or_else(PoisonError::into_inner))
    }

    /// The scene of this name.
    #[must_use]
    pub fn get(&self, name: &str) -> Option<Arc<SceneVersion>> {
        self.table().by_name.get(name).cloned()
    }

    /// The scene, where there is only one.
    #[must_use]
    pub fn only(&self) -> Option<Arc<SceneVersion>> {
        let all = &self.table().by_name;
        if all.len() == 1 { all.values().next().cloned() } else { None }
    }

    /// Told of each exchange.
    pub(crate) fn exchanges(&self) -> watch::Receiver<u64> {
        self.exchanges.subscribe()
    }

    /// Serves these scenes from now on. Sessions go on with what they have. Where nothing may be exchanged, all stays.
    ///
    /// # Errors
    /// As [`Scenes::new`], but that there may be none.
    pub fn replace(&self, sources: Vec<Arc<dyn SceneSource>>) -> Result<SceneChanges, ScenesError> {
        let mut new = Table::new(sources)?;
        let mut done = SceneChanges::default();
        let mut table = self.table.write().unwrap_or_else(PoisonError::into_inner);
        for (name, version) in &mut new.by_name {
            match table.by_name.get(name) {
                Some(old) if old.source.header().fingerprint == version.source.header().fingerprint => {
                    *version = Arc::clone(old);
                }
                Some(_) => done.changed.push(name.clone()),
                None => done.added.push(name.clone()),
            }
        }
        let stays = |name: &String, old| new.by_name.get(name).is_some_and(|new| Arc::ptr_eq(new, old));
        let gone = table.by_name.iter().filter(|(name, old)| !stays(name, old));
        let mut before = self.before.write().unwrap_or_else(PoisonError::into_inner);
        for (name, old) in gone {
            if !new.by_name.contains_key(name) {
                done.removed.push(name.clone());
            }
            *before = sum(*before, old.source.cache_use());
        }
        *table = Arc::new(new);
        drop((table, before));
        if !done.is_nothing() {
            self.exchanges.send_modify(|count| *count = count.wrapping_add(1));
        }
        Ok(done)
    }

    /// What their caches have done since the start; `None` where they have none.
    pub(crate) fn cache_use(&self) -> Option<CacheUse> {
        let before = *self.before.read().unwrap_or_else(PoisonError::into_inner);
        let now: Vec<CacheUse> =
            self.table().by_name.values().filter_map(|version| version.source.cache_use()).collect();
        let any = !now.is_empty() || before != CacheUse::default();
        any.then(|| now.into_iter().fold(before, |all, one| sum(all, Some(one))))
    }

    /// Why there is no scene of this name, or without a name none at all; names others only if `listed`.
    pub(crate) fn missing(&self, name: &str, listed: bool) -> String {
        let all = &self.table().by_name;
        let some: Vec<String> = all.keys().take(LISTED).map(|name| format!("'{name}'")).collect();
        let more = if all.len() > LISTED { ", … (see /scenes)" } else { "" };
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

    /// The scenes for which `listed` holds, as JSON: name, fingerprint, numbers of assets and instances.
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
    fn names_that_cannot_be_served_are_told() {
        let with =
            |names: &[&str]| Scenes::new(names.iter().map(|name| scene(name, 1)).collect()).unwrap_err();
        assert_eq!(with(&[]), ScenesError::Empty);
        assert_eq!(with(&["a", "b", "a"]), ScenesError::DuplicateName("a".into()));
        assert_eq!(with(&["a", "ready"]), ScenesError::ReservedName("ready".into()));
        assert_eq!(with(&["a", ""]), ScenesError::Unnamed);
    }

    #[test]
    fn what_did_not_change_stays_and_what_cannot_be_served_changes_nothing() {
        let scenes = Scenes::new(vec![scene("a", 1), scene("b", 1), scene("c", 1)]).unwrap();
        let [a, b] = ["a", "b"].map(|name| scenes.get(name).unwrap());
        let told = scenes.exchanges();
        let done = scenes.replace(vec![scene("a", 1), scene("b", 2), scene("d", 1)]).unwrap();
        let expected =
            SceneChanges { added: vec!["d".into()], changed: vec!["b".into()], removed: vec!["c".into()] };
        assert_eq!(done, expected);
        assert!(told.has_changed().unwrap());
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
    fn the_list_is_json_and_holds_what_may_be_seen() {
        let scenes = Scenes::new(vec![scene("a \"b\"", 1), scene("c", 2)]).unwrap();
        let list: serde_json::Value = serde_json::from_str(&scenes.list(|name| name != "c")).unwrap();
        assert_eq!(list["scenes"].as_array().unwrap().len(), 1);
        assert_eq!(list["scenes"][0]["name"], "a \"b\"");
        assert_eq!(list["scenes"][0]["fingerprint"].as_str().unwrap().len(), 32);
        assert!(scenes.missing("x", true).contains("'c'") && !scenes.missing("x", false).contains("'c'"));
    }
}
