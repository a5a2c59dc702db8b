//! Out-of-core preparation: gives the same packs as in memory, also if the files cannot be written.

#![allow(clippy::unwrap_used, reason = "test helpers without #[test] may unwrap, as tests may")]
#![cfg(target_os = "linux")]

mod landscape;

use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::{Mutex, MutexGuard, PoisonError};

use lodestream_bake::mapping_allocator::{MapError, Mapping, MappingAllocator};
use lodestream_bake::preparation_settings::PreparationSettings;
use lodestream_bake::prepare::{Options, PrepareError, prepare_to};
use lodestream_bake::scene::Asset;
use rustix::process::{Resource, Rlimit, getrlimit, setrlimit};
use tempfile::TempDir;
use tokio::signal::unix::{SignalKind, signal};

#[global_allocator]
static ALLOCATOR: MappingAllocator = MappingAllocator;

/// Serialises the tests: mappings and resource limits are per process, and limits are inherited by child processes.
static ONE_AT_A_TIME: Mutex<()> = Mutex::new(());

fn alone() -> MutexGuard<'static, ()> {
    ONE_AT_A_TIME.lock().unwrap_or_else(PoisonError::into_inner)
}

/// A folder in the build folder, which is usually on a disk.
fn folder() -> TempDir {
    TempDir::new_in(env!("CARGO_TARGET_TMPDIR")).unwrap()
}

/// Small, so that most lists of a small mesh are mapped.
const FROM_BYTES: usize = 16 << 10;

/// Maps lists to files; `None` if the build folder is on a file system in memory.
fn mapping(folder: &Path) -> Option<Mapping> {
    match MappingAllocator::into(folder, FROM_BYTES) {
        Ok(mapping) => Some(mapping),
        Err(error @ MapError::InMemory(_)) => {
            eprintln!("NOT TESTED: {error}");
            None
        }
        Err(error) => panic!("{error}"),
    }
}

fn landscape(folder: &Path, size: u32) -> PathBuf {
    let file = folder.join("land.obj");
    std::fs::write(&file, landscape::obj(size)).unwrap();
    file
}

fn pack(model: &Path, pack: &Path, threads: usize) -> Vec<u8> {
    pack_by(model, pack, threads, PreparationSettings::default())
}

fn pack_by(model: &Path, pack: &Path, threads: usize, preparation_settings: PreparationSettings) -> Vec<u8> {
    let options =
        Options { threads: threads.try_into().ok(), quiet: true, preparation_settings, ..Options::default() };
    prepare_to(&Asset::of_file(model), &options, pack).unwrap();
    std::fs::read(pack).unwrap()
}

#[test]
fn lists_in_files_change_no_byte_and_leave_no_file() {
    let _alone = alone();
    let dir = folder();
    let model = landscape(dir.path(), 90);
    let in_memory = pack(&model, &dir.path().join("memory.lsp"), 2);
    let blocks = PreparationSettings { block_faces: "2000".parse().ok(), ..PreparationSettings::default() };
    let in_blocks = pack_by(&model, &dir.path().join("blocks.lsp"), 2, blocks);
    assert!(in_blocks != in_memory);
    let lists = dir.path().join("lists");
    std::fs::create_dir(&lists).unwrap();
    let Some(mapping) = mapping(&lists) else { return };
    for threads in [1, 2] {
        assert!(pack(&model, &dir.path().join("files.lsp"), threads) == in_memory, "another pack");
        let again = pack_by(&model, &dir.path().join("files.lsp"), threads, blocks);
        assert!(again == in_blocks, "another pack in blocks");
    }
    assert!(MappingAllocator::most_bytes() > 500_000, "{} bytes were mapped", MappingAllocator::most_bytes());
    assert_eq!(std::fs::read_dir(&lists).unwrap().count(), 0);
    drop(mapping);
    let most = MappingAllocator::most_bytes();
    assert!(pack(&model, &dir.path().join("after.lsp"), 2) == in_memory);
    assert_eq!(MappingAllocator::most_bytes(), most, "nothing is mapped any more");
}

#[test]
fn mapped_lists_keep_their_content_when_they_grow_shrink_or_move() {
    let _alone = alone();
    let dir = folder();
    let Some(first) = mapping(dir.path()) else { return };
    let made_before: Vec<u64> = (0..50_000).collect();
    let mut grown = Vec::new();
    (0..100_000_u64).for_each(|i| grown.push(i));
    assert!(vec![0_u8; 1 << 20].iter().all(|&byte| byte == 0));
    assert!(matches!(MappingAllocator::into(dir.path(), FROM_BYTES), Err(MapError::InUse)));
    drop(first);
    // New memory comes from the system's allocator again; mapped lists stay mapped until they grow.
    (100_000..200_000).for_each(|i| grown.push(i));
    grown.truncate(150_000);
    grown.shrink_to_fit();
    let second = mapping(dir.path()).unwrap();
    let threads: Vec<_> = (0..4_u64)
        .map(|t| std::thread::spawn(move || (0..40_u64).map(|i| vec![t * i; 5000]).collect::<Vec<_>>()))
        .collect();
    for (t, thread) in (0_u64..).zip(threads) {
        for (i, list) in (0_u64..).zip(thread.join().unwrap()) {
            assert!(list.len() == 5000 && list.iter().all(|&x| x == t * i));
        }
    }
    drop(second);
    assert!(made_before.iter().copied().eq(0..50_000));
    assert!(grown.into_iter().eq(0..150_000));
}

/// Writing to a file without space, or beyond the size limit, would end the process by a signal.
#[test]
fn lists_without_disk_space_stay_in_memory() {
    let _alone = alone();
    let dir = folder();
    let model = landscape(dir.path(), 90);
    let in_memory = pack(&model, &dir.path().join("memory.lsp"), 2);
    let runtime = tokio::runtime::Builder::new_current_thread().enable_io().build().unwrap();
    let _entered = runtime.enter();
    let _signal = signal(SignalKind::from_raw(rustix::process::Signal::XFSZ.as_raw())).unwrap();
    let Some(_mapping) = mapping(dir.path()) else { return };
    let limit = getrlimit(Resource::Fsize);
    setrlimit(Resource::Fsize, Rlimit { current: Some(400_000), ..limit }).unwrap();
    let small = pack(&model, &dir.path().join("small.lsp"), 2);
    setrlimit(Resource::Fsize, limit).unwrap();
    assert!(small == in_memory, "another pack");
}

#[test]
fn a_mesh_too_large_for_the_disk_is_refused() {
    let free = 10_u64 << 30;
    let refused = PrepareError::room("land.ply".as_ref(), 100_000_000, Some(free)).unwrap_err().to_string();
    for word in ["land.ply", "100000000 faces", "10.7 GB", "--out-of-core"] {
        assert!(refused.contains(word), "{refused}");
    }
    assert!(PrepareError::room("land.ply".as_ref(), 20_000_000, Some(free)).is_ok());
    assert!(PrepareError::room("land.ply".as_ref(), 100_000_000, None).is_ok());
}

#[test]
fn the_program_prepares_out_of_core_and_refuses_folders_that_cannot_hold_lists() {
    let _alone = alone();
    let dir = folder();
    let model = landscape(dir.path(), 60);
    let prepare = |pack: &str, folder: &Path| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_lodestream-server"));
        command.arg("prepare").arg(&model).arg("--output").arg(dir.path().join(pack)).arg("--quiet");
        command.arg("--out-of-core").arg(folder).output().unwrap()
    };
    let missing = prepare("none.lsp", &dir.path().join("nowhere"));
    let told = String::from_utf8(missing.stderr).unwrap();
    assert!(!missing.status.success() && told.contains("nowhere"), "{told}");
    assert!(!dir.path().join("none.lsp").exists());
    if Path::new("/dev/shm").is_dir() {
        let in_memory = prepare("none.lsp", Path::new("/dev/shm"));
        let told = String::from_utf8(in_memory.stderr).unwrap();
        assert!(!in_memory.status.success() && told.contains("tmpfs"), "{told}");
    }
    let done = prepare("done.lsp", dir.path());
    let told = String::from_utf8(done.stderr).unwrap();
    assert!(done.status.success() || told.contains("tmpfs"), "{told}");
}
