//! A second start with the same cache: files that have not changed are not parsed, so not imported either.

use std::path::Path;

use tempfile::TempDir;

use super::batch_tests::street;
use super::of_files_in;
use crate::preparation_settings::PreparationSettings;
use crate::prepare::{Options, keys_of, prepare_all_of};
use crate::sources::Sources;

/// What a start did.
#[derive(Debug, PartialEq)]
struct Start {
    files_read: usize,
    prepared: usize,
    keys: Vec<String>,
}

/// Opens a model as the server does; `flags` are as on the command line.
fn start(model: &Path, cache: &Path, flags: &[(&str, &str)]) -> Start {
    let mut preparation_settings = PreparationSettings::default();
    for &(name, value) in flags {
        match name {
            "batch" => preparation_settings.batching = Some(value.parse().unwrap()),
            "uv-bits" => preparation_settings.uv_bits = Some(value.parse().unwrap()),
            _ => panic!("{name}"),
        }
    }
    let options = Options { preparation_settings, quiet: true, ..Options::default() };
    let sources = Sources::in_folder(cache);
    let scene = of_files_in(&[model.to_owned()], &preparation_settings, &sources).unwrap();
    let keys = keys_of(&scene.assets, &options, &sources).unwrap();
    let mut prepared = 0;
    let cached = prepare_all_of(&scene.assets, cache, &options, &sources, |_, cached| {
        prepared += usize::from(cached.report.is_some());
    });
    assert!(cached.unwrap().iter().all(|cached| cached.files.contains(&model.to_owned())));
    Start { files_read: sources.files_read(), prepared, keys: keys.iter().map(|key| key.hex()).collect() }
}

#[test]
fn an_unchanged_file_is_not_parsed_and_anything_else_is_noticed() {
    let dir = TempDir::new().unwrap();
    let (model, cache) = (dir.path().join("street.glb"), dir.path().join("cache"));
    let bend = |i: usize| 0.1 + i as f64 / 100.0;
    street(bend, 60).write(&model);
    let small = [("batch", "1000")];
    let first = start(&model, &cache, &small);
    assert!(first.files_read == 1 && first.prepared > 1 && first.prepared == first.keys.len(), "{first:?}");
    let warm = Start { files_read: 0, prepared: 0, keys: first.keys.clone() };
    assert_eq!(start(&model, &cache, &small), warm);

    // Settings of what becomes a batch, and of packs.
    let one = start(&model, &cache, &[]);
    assert_eq!((one.files_read, one.prepared, one.keys.len()), (1, 1, 1));
    let other = start(&model, &cache, &[("batch", "1000"), ("uv-bits", "9")]);
    assert_eq!((other.files_read, other.prepared), (1, first.prepared));
    // All of them are known from now on.
    assert_eq!(start(&model, &cache, &small), warm);
    assert_eq!(start(&model, &cache, &[]), Start { files_read: 0, prepared: 0, ..one });

    // A changed file: one batch of it, and back.
    street(|i| if i == 7 { 9.0 } else { bend(i) }, 60).write(&model);
    let changed = start(&model, &cache, &small);
    assert_eq!((changed.files_read, changed.prepared), (1, 1));
    assert_ne!(changed.keys, first.keys);
    street(bend, 60).write(&model);
    assert_eq!(start(&model, &cache, &small), warm);

    // A pack that is missing is prepared again, by one parse.
    let pack = |entry: &std::fs::DirEntry| entry.path().extension().is_some_and(|end| end == "lsp");
    std::fs::read_dir(&cache).unwrap().flatten().filter(pack).for_each(|pack| {
        std::fs::remove_file(pack.path()).unwrap();
    });
    assert_eq!(start(&model, &cache, &small), Start { files_read: 1, ..first });
}

#[test]
fn damaged_memos_are_ignored() {
    let dir = TempDir::new().unwrap();
    let (model, cache) = (dir.path().join("street.glb"), dir.path().join("cache"));
    street(|i| i as f64 / 7.0, 40).write(&model);
    let first = start(&model, &cache, &[]);
    let memos = || {
        let files = std::fs::read_dir(&cache).unwrap().map(|entry| entry.unwrap().path());
        files.filter(|path| path.extension().is_some_and(|end| end == "memo")).collect::<Vec<_>>()
    };
    assert_eq!(memos().len(), 2);
    for damage in [|bytes: &mut Vec<u8>| bytes[100] ^= 1, |bytes: &mut Vec<u8>| bytes.truncate(70)] {
        for memo in memos() {
            let mut bytes = std::fs::read(&memo).unwrap();
            damage(&mut bytes);
            std::fs::write(&memo, bytes).unwrap();
        }
        let again = Start { files_read: 1, prepared: 0, keys: first.keys.clone() };
        assert_eq!(start(&model, &cache, &[]), again);
        // They were written again.
        assert_eq!(start(&model, &cache, &[]).files_read, 0);
    }
}
