//! The cache of prepared packs: a folder of packs, each named by a hash of its inputs.

use std::path::{Path, PathBuf};

use lodestream_geometry::mesh::{Corner, SourceMesh};

use crate::sources::Source;

/// Version of the preparation. Increment it when the same input gives another pack of the same format version: after a
/// change of the simplifier or of the texture encoders.
pub(super) const PREPARATION_VERSION: u32 = 26;

/// BLAKE3 hash of everything that a pack depends on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Key(blake3::Hash);

impl Key {
    /// Hashes a model file, the files that it names and the encoded settings, with the versions of the pack format and of
    /// the preparation.
    pub(super) fn new(source: &Source, settings: &[u8], format_version: u32) -> Self {
        let mut hasher = hasher(settings, format_version);
        hasher.update(source.hash.as_bytes());
        for hash in &source.dependencies {
            // The folder does not matter, only the names in the OBJ and MTL files, which are hashed already.
            match hash {
                Some(hash) => hasher.update(&[1]).update(hash.as_bytes()),
                None => hasher.update(&[0]),
            };
        }
        Self(hasher.finalize())
    }

    /// Hashes what was imported of a model file instead of the file: the key stays when other parts of the file change.
    /// `materials` is what [`super::materials_key`] encodes.
    pub(super) fn of_content(
        mesh: &SourceMesh,
        materials: &[u8],
        settings: &[u8],
        format_version: u32,
    ) -> Self {
        let mut hasher = hasher(settings, format_version);
        hasher.update(blake3::hash(materials).as_bytes());
        hash_mesh(mesh, &mut hasher);
        Self(hasher.finalize())
    }

    /// Hashes settings that state all that a pack is made from.
    pub(crate) fn of_settings(settings: &[u8], format_version: u32) -> Self {
        Self(hasher(settings, format_version).finalize())
    }
}

fn hasher(settings: &[u8], format_version: u32) -> blake3::Hasher {
    let mut hasher = blake3::Hasher::new_derive_key("lodestream prepared pack");
    hasher.update(&format_version.to_le_bytes());
    hasher.update(&PREPARATION_VERSION.to_le_bytes());
    hasher.update(blake3::hash(settings).as_bytes());
    hasher
}

/// Hashes every list of a mesh, each with its length. The pattern names all fields, so a new one does not compile until it
/// is hashed here.
fn hash_mesh(mesh: &SourceMesh, hasher: &mut blake3::Hasher) {
    let SourceMesh { positions, uvs, second_uvs, normals, colors, faces, materials, parts, skins, poses } =
        mesh;
    let corner = |&Corner { position, uv, second_uv: _, normal, color }: &Corner| {
        [position, uv, normal, color].into_iter().flat_map(u32::to_le_bytes)
    };
    hash_list(hasher, positions, |point| point.iter().flat_map(|x| x.to_le_bytes()));
    hash_list(hasher, uvs, |uv| uv.iter().flat_map(|x| x.to_le_bytes()));
    hash_list(hasher, normals, |normal| normal.iter().flat_map(|x| x.to_le_bytes()));
    hash_list(hasher, colors, |color| color.iter().copied());
    hash_list(hasher, faces, |face| face.iter().flat_map(corner));
    hash_list(hasher, materials, |material| material.to_le_bytes().into_iter());
    hash_list(hasher, parts, |part| part.to_le_bytes().into_iter());
    if !second_uvs.is_empty() {
        hash_list(hasher, second_uvs, |uv| uv.iter().flat_map(|x| x.to_le_bytes()));
        let second = |face: &[Corner; 3]| face.map(|corner| corner.second_uv);
        hash_list(hasher, faces, |face| second(face).into_iter().flat_map(u32::to_le_bytes));
    }
    if !skins.is_empty() {
        hash_list(hasher, skins, |skin| [skin.joints(), skin.weights()].into_iter().flatten());
        for pose in poses {
            hash_list(hasher, pose, |map| map.iter().flatten().flat_map(|x| x.to_le_bytes()));
        }
    }
}

/// Hashes a list's length and the bytes of its elements.
fn hash_list<'a, T, B: Iterator<Item = u8>>(
    hasher: &mut blake3::Hasher,
    list: &'a [T],
    bytes: impl Fn(&'a T) -> B,
) {
    hasher.update(&(list.len() as u64).to_le_bytes());
    // The hash is fast for some kilobytes at once.
    let mut block = Vec::new();
    for some in list.chunks(1024) {
        block.clear();
        block.extend(some.iter().flat_map(&bytes));
        hasher.update(&block);
    }
}

impl Key {
    /// The key with these bytes.
    pub(super) const fn of_bytes(bytes: [u8; 32]) -> Self {
        Self(blake3::Hash::from_bytes(bytes))
    }

    /// The hash.
    #[must_use]
    pub fn bytes(&self) -> [u8; 32] {
        *self.0.as_bytes()
    }

    /// The hash as text.
    #[must_use]
    pub fn hex(&self) -> String {
        self.0.to_hex().to_string()
    }

    /// The pack's path in a cache folder. It begins with `name`, for people who list the folder.
    #[must_use]
    pub fn path(&self, folder: &Path, name: &str) -> PathBuf {
        let name: String = name
            .chars()
            .take(40)
            .map(|c| if c.is_ascii_alphanumeric() || c == '-' || c == '_' { c } else { '_' })
            .collect();
        folder.join(format!("{name}-{}.lsp", &self.0.to_hex()[..32]))
    }
}

/// The default cache folder: `$XDG_CACHE_HOME/lodestream`, else `~/.cache/lodestream`; `None` if neither variable is an
/// absolute path.
#[must_use]
pub fn default_folder() -> Option<PathBuf> {
    let variable = |name| std::env::var_os(name).map(PathBuf::from).filter(|path| path.is_absolute());
    let base = variable("XDG_CACHE_HOME").or_else(|| variable("HOME").map(|home| home.join(".cache")));
    base.map(|base| base.join("lodestream"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_key_depends_on_every_file_and_setting() {
        let dir = tempfile::TempDir::new().unwrap();
        let write = |name: &str, text: &str| std::fs::write(dir.path().join(name), text).unwrap();
        let obj = dir.path().join("a.obj");
        let key = |settings: &[u8], version| Key::new(&Source::read(&obj).unwrap(), settings, version);
        let now = || key(b"bits 14", 1);
        write("a.obj", "mtllib a.mtl\nf 1 2 3\n");
        let missing = now();
        write("a.mtl", "newmtl x\nmap_Kd t.png\n");
        let untextured = now();
        write("t.png", "one");
        let textured = now();
        write("t.png", "two");
        let retextured = now();
        write("a.obj", "mtllib a.mtl\nf 1 2 4\n");
        let reshaped = now();
        let keys = [missing, untextured, textured, retextured, reshaped];
        for (i, one) in keys.iter().enumerate() {
            assert!(keys[i + 1..].iter().all(|other| other != one), "{i}");
        }
        assert_eq!(now(), reshaped);
        assert_ne!(key(b"bits 15", 1), reshaped);
        assert_ne!(key(b"bits 14", 2), reshaped);
    }

    #[test]
    fn cache_names_are_safe() {
        let path = Key(blake3::hash(b"x")).path(Path::new("cache"), "../é/a b");
        assert_eq!(path.parent(), Some(Path::new("cache")));
        assert!(path.file_name().unwrap().to_str().unwrap().starts_with("_____a_b-"));
    }
}
