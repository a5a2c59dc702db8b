//! Which assets are so small that they are prepared side by side.

use std::collections::BTreeMap;
use std::path::Path;

use lodestream_import::is_gltf;

use crate::scene::Asset;
use crate::sources::{KEPT, Sources};

/// Longest model, in bytes of its files, and most faces of an asset of a glTF file, that are prepared beside others. A
/// larger one has all threads and the memory for itself.
const MAX_SMALL_BYTES: u64 = 4 << 20;
const MAX_SMALL_FACES: usize = 100_000;

/// Sizes of the assets of a scene, as their files state them.
pub(super) struct Sizes<'a> {
    sources: &'a Sources,
    /// Assets of each file.
    assets: BTreeMap<&'a Path, usize>,
    /// Whether files of one asset are small.
    files: BTreeMap<&'a Path, bool>,
}

impl<'a> Sizes<'a> {
    pub(super) fn new(assets: &'a [Asset], sources: &'a Sources) -> Self {
        let mut count: BTreeMap<&Path, usize> = BTreeMap::new();
        assets.iter().for_each(|asset| *count.entry(&asset.file).or_default() += 1);
        Self { sources, assets: count, files: BTreeMap::new() }
    }

    /// How many of the first assets, at most `most`, are small. Files of several assets are read for that: no more than
    /// are kept, so that their preparation does not read them again.
    pub(super) fn small_ones(&mut self, assets: &'a [Asset], most: usize) -> usize {
        let mut read: Vec<&Path> = Vec::new();
        let small = |asset: &&'a Asset| {
            if !self.is_shared(asset) {
                return self.is_small_file(&asset.file);
            }
            if !read.contains(&&*asset.file) {
                read.push(&asset.file);
            }
            read.len() <= KEPT && self.is_small_part(asset)
        };
        assets.iter().take(most).take_while(small).count()
    }

    fn is_shared(&self, asset: &Asset) -> bool {
        is_gltf(&asset.file) && self.assets.get(&*asset.file).is_some_and(|&assets| assets > 1)
    }

    /// Whether a part of a file is small. A file that cannot be read is reported when it is prepared.
    fn is_small_part(&self, asset: &Asset) -> bool {
        let Ok(source) = self.sources.get(&asset.file) else { return true };
        match source.model.stated_size(&asset.part) {
            Some(size) => size.faces <= MAX_SMALL_FACES,
            None => is_small_file(&asset.file),
        }
    }

    fn is_small_file(&mut self, file: &'a Path) -> bool {
        *self.files.entry(file).or_insert_with(|| is_small_file(file))
    }
}

fn is_small_file(file: &Path) -> bool {
    let length = |path: &Path| std::fs::metadata(path).map_or(0, |file| file.len());
    let mut bytes = length(file);
    // The vertices of a text file are beside it.
    if bytes <= MAX_SMALL_BYTES
        && file.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("gltf"))
    {
        let text = lodestream_import::read_file(file, MAX_SMALL_BYTES).unwrap_or_default();
        bytes += lodestream_import::dependencies(file, &text).iter().map(|file| length(file)).sum::<u64>();
    }
    bytes <= MAX_SMALL_BYTES
}

#[cfg(test)]
mod tests {
    use std::path::PathBuf;

    use lodestream_import::Part;
    use serde_json::json;
    use tempfile::TempDir;

    use super::*;

    fn small_ones(assets: &[Asset]) -> usize {
        Sizes::new(assets, &Sources::default()).small_ones(assets, 100)
    }

    #[test]
    fn a_file_of_one_asset_is_small_by_its_length_and_that_of_the_files_beside_it() {
        let dir = TempDir::new().unwrap();
        let write = |name: &str, bytes: u64| {
            let path = dir.path().join(name);
            std::fs::File::create(&path).unwrap().set_len(bytes).unwrap();
            path
        };
        let buffer = json!({"uri": "far.bin", "byteLength": 1});
        let text = json!({"asset": {"version": "2.0"}, "buffers": [buffer]}).to_string();
        std::fs::write(dir.path().join("beside.gltf"), text).unwrap();
        write("far.bin", MAX_SMALL_BYTES + 1);
        let small = [write("a.obj", 100), write("b.ply", MAX_SMALL_BYTES), PathBuf::from("missing.obj")];
        let assets = |last: &Path| {
            small.iter().map(PathBuf::as_path).chain([last]).map(Asset::of_file).collect::<Vec<_>>()
        };
        assert_eq!(small_ones(&assets(Path::new("missing.glb"))), 4);
        assert_eq!(small_ones(&assets(&write("large.glb", MAX_SMALL_BYTES + 1))), 3);
        assert_eq!(small_ones(&assets(&dir.path().join("beside.gltf"))), 3);
    }

    #[test]
    fn a_large_mesh_among_small_ones_of_a_file_has_all_threads() {
        let dir = TempDir::new().unwrap();
        let corners = [30, 3 * MAX_SMALL_FACES, 3 * MAX_SMALL_FACES + 3];
        let accessors = corners.map(|count| json!({"componentType": 5126, "type": "VEC3", "count": count}));
        let mesh = |accessor: usize| json!({"primitives": [{"attributes": {"POSITION": accessor}}]});
        let text = json!({"asset": {"version": "2.0"}, "accessors": accessors, "meshes": [mesh(0), mesh(1), mesh(2)]});
        let asset = |name: &str, mesh: usize| {
            let file = dir.path().join(name);
            std::fs::write(&file, text.to_string()).unwrap();
            Asset { part: Part::Mesh { mesh, linear: [[0.0; 3]; 3] }, ..Asset::of_file(&file) }
        };
        let file = |name: &str| [0, 1, 2, 0].map(|mesh| asset(name, mesh));
        let assets = file("a.gltf");
        assert_eq!(small_ones(&assets), 2);
        assert_eq!(Sizes::new(&assets, &Sources::default()).small_ones(&assets[3..], 100), 1);
        // No more files at once than are kept.
        let names = ["a", "a", "b", "b", "c", "c"].map(|name| asset(&format!("{name}.gltf"), 0));
        assert_eq!(small_ones(&names), 2 * KEPT);
    }
}
