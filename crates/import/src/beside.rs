//! Files beside a model, found by their names where the paths that the model states lead nowhere: programs write the paths
//! of the machine that the file was made on, and names in another letter case.

use std::collections::BTreeMap;
use std::ffi::OsString;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;

/// A folder that is listed when a file of it is first looked for.
#[derive(Debug)]
pub(crate) struct Beside {
    folder: PathBuf,
    /// Names by their lower case; of several, the first in order.
    names: OnceLock<BTreeMap<String, OsString>>,
}

impl Beside {
    /// The folder of a model.
    pub(crate) fn new(model: &Path) -> Self {
        let folder = model.parent().unwrap_or(Path::new("")).to_owned();
        Self { folder, names: OnceLock::new() }
    }

    /// The folder.
    pub(crate) fn folder(&self) -> &Path {
        &self.folder
    }

    /// The file of the folder that has the name of a stated path, whose separators may be backslashes: the very name, else
    /// one that differs in letter case.
    pub(crate) fn named(&self, stated: &str) -> Option<PathBuf> {
        let plain = self.plain(stated)?;
        if plain.is_file() {
            return Some(plain);
        }
        let name = plain.file_name()?.to_str()?.to_lowercase();
        let found = self.names.get_or_init(|| names(&self.folder)).get(&name)?;
        Some(self.folder.join(found)).filter(|path| path.is_file())
    }

    /// Where a file of a stated path's name would be in the folder.
    pub(crate) fn plain(&self, stated: &str) -> Option<PathBuf> {
        let name = stated.rsplit(['/', '\\']).next().map(str::trim);
        let name = name.filter(|name| !matches!(*name, "" | "." | "..") && !name.contains(':'))?;
        Some(self.folder.join(name))
    }

    /// The files that a model depends on instead of one: itself, and if it does not exist, its name in the folder.
    pub(crate) fn and_named(&self, path: PathBuf) -> impl Iterator<Item = PathBuf> + use<> {
        let missing = !path.exists();
        let stated = path.to_string_lossy();
        let named = missing.then(|| self.plain(&stated)).flatten().filter(|named| *named != path);
        [Some(path), named].into_iter().flatten()
    }
}

fn names(folder: &Path) -> BTreeMap<String, OsString> {
    let folder = if folder.as_os_str().is_empty() { Path::new(".") } else { folder };
    let mut names = BTreeMap::new();
    for entry in std::fs::read_dir(folder).into_iter().flatten().flatten() {
        let name = entry.file_name();
        let Some(lower) = name.to_str().map(str::to_lowercase) else { continue };
        let first = names.entry(lower).or_insert_with(|| name.clone());
        if name < *first {
            *first = name;
        }
    }
    names
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_is_found_by_its_name_in_any_case_and_the_first_of_several() {
        let folder = tempfile::tempdir().unwrap();
        for name in ["Wood.PNG", "wooD.png", "Stein.jpg"] {
            std::fs::write(folder.path().join(name), name).unwrap();
        }
        std::fs::create_dir(folder.path().join("sub.png")).unwrap();
        let beside = Beside::new(&folder.path().join("a.obj"));
        let found = |stated: &str| {
            let found = beside.named(stated)?;
            Some(found.file_name()?.to_str()?.to_owned())
        };
        for stated in ["C:\\art\\wood.png", "/home/somebody/wood.png", "../wood.png", "wood.png"] {
            assert_eq!(found(stated).as_deref(), Some("Wood.PNG"), "{stated}");
        }
        assert_eq!(found("x\\wooD.png").as_deref(), Some("wooD.png"), "the very name before others");
        assert_eq!(found("tex/STEIN.JPG").as_deref(), Some("Stein.jpg"));
        for none in ["sub.png", "no.png", "", "..", "x/", "a:b"] {
            assert_eq!(found(none), None, "{none}");
        }
    }
}
