//! Scenes and packs in a real S3 server whose answers are slow, short, wrong or missing.

mod s3;

use std::io::{BufRead as _, BufReader, Read as _, Write as _};
use std::net::TcpStream;
use std::path::Path;
use std::process::{Command, Stdio};
use std::sync::{Arc, LazyLock};

use lodestream_bake::prepare::{Options, prepare_cached};
use lodestream_bake::scene::{self, Scene};
use lodestream_daemon::SceneProvider as _;
use lodestream_protocol::source::{SceneSource, SourceError};
use lodestream_scene::{BlobId, BlobPart};
use lodestream_server::catalogue::Catalogue;
use lodestream_server::catalogue::publish::{Published, publish};
use lodestream_store::{BlobCache, Objects, SceneStore};
use object_store::aws::AmazonS3Builder;
use tokio::runtime::Runtime;

use crate::process::KilledOnDrop;
use s3::{Fault, S3};

/// A wavy sheet and a triangle.
fn write_scene(folder: &Path, name: &str, height: f64) -> Scene {
    write_scene_of(folder, name, height, 30)
}

/// The same with a sheet of `n` × `n` squares.
fn write_scene_of(folder: &Path, name: &str, height: f64, n: u32) -> Scene {
    let mut obj = String::new();
    for y in 0..=n {
        for x in 0..=n {
            let (u, v) = (f64::from(x) / f64::from(n), f64::from(y) / f64::from(n));
            // Rough, so that its chunks have many bytes.
            let rough = f64::from((x * 7919 + y * 104_729) % 1009) / 1009.0 / f64::from(n);
            obj.push_str(&format!("v {u} {} {v}\n", rough + height * (9.0 * u).sin() * (7.0 * v).cos()));
        }
    }
    for y in 0..n {
        for x in 0..n {
            let a = y * (n + 1) + x + 1;
            obj.push_str(&format!("f {a} {} {} {}\n", a + n + 1, a + n + 2, a + 1));
        }
    }
    std::fs::write(folder.join("sheet.obj"), obj).unwrap();
    std::fs::write(folder.join("one.obj"), "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n").unwrap();
    let text = format!(
        "name = '{name}'\n[[asset]]\nname = 'one'\nfile = 'one.obj'\n[[asset]]\nname = 'sheet'\nfile = 'sheet.obj'\n\
         [[instance]]\nasset = 'one'\n[[instance]]\nasset = 'sheet'\ntranslation = [0, 0, -2]\n\
         [[punctual_light]]\nposition = [0, 2, 0]\nintensity = 40\n"
    );
    let file = folder.join(format!("{name}.toml"));
    std::fs::write(&file, text).unwrap();
    scene::read(&file).unwrap()
}

fn options() -> Options {
    Options { quiet: true, ..Options::default() }
}

/// The bucket as an object store, for this process.
fn bucket(s3: &S3) -> Objects {
    // As `Objects::of_url` does.
    let _ = rustls::crypto::ring::default_provider().install_default();
    let builder = s3.environment().into_iter().fold(
        AmazonS3Builder::new().with_bucket_name("bucket").with_retry(lodestream_store::retries()),
        |builder, (key, value)| match key.to_ascii_lowercase().parse() {
            Ok(key) => builder.with_config(key, value),
            Err(_) => builder,
        },
    );
    Objects::of_store(Arc::new(builder.build().unwrap()), "s3://bucket")
}

/// All blobs that a client could request.
fn all_blobs(scene: &dyn SceneSource) -> Vec<BlobId> {
    let mut ids = Vec::new();
    for asset in 0..scene.header().asset_count {
        let parts = (0..400).flat_map(|n| [BlobPart::IndexPage(n), BlobPart::Chunk(n)]);
        let all = std::iter::once(BlobPart::Base).chain(parts).map(|part| BlobId::Asset { asset, part });
        ids.extend(all.filter(|id| scene.blob_len(id).is_some()));
    }
    ids
}

/// A published scene in a bucket, opened with an empty cache, and the same scene from files.
struct Two {
    s3: S3,
    runtime: Runtime,
    files: SceneStore,
    objects: SceneStore,
}

impl Two {
    fn new() -> Self {
        // Prepared once for all tests.
        static FOLDER: LazyLock<(tempfile::TempDir, Scene)> = LazyLock::new(|| {
            let folder = tempfile::tempdir().unwrap();
            let scene = write_scene_of(folder.path(), "hall", 0.1, 180);
            for asset in &scene.assets {
                prepare_cached(asset, &folder.path().join("cache"), &options()).unwrap();
            }
            (folder, scene)
        });
        let (folder, scene) = &*FOLDER;
        let (s3, runtime, cache) = (S3::start(), Runtime::new().unwrap(), folder.path().join("cache"));
        runtime.block_on(publish(scene, &bucket(&s3), &cache, &options())).unwrap();
        let packs =
            scene.assets.iter().map(|a| prepare_cached(a, &cache, &options()).unwrap().pack).collect();
        let files = lodestream_bake::compose::open(scene, packs, &BlobCache::new(1 << 24)).unwrap();
        let objects =
            runtime.block_on(SceneStore::open(&bucket(&s3), "hall.lss", &BlobCache::new(1 << 24))).unwrap();
        Self { s3, runtime, files, objects }
    }

    /// A chunk that was not read while opening.
    fn far(&self) -> BlobId {
        let far = all_blobs(&self.objects).into_iter().rev();
        far.into_iter().find(|id| !self.is_at_hand(id)).expect("opening read every chunk")
    }

    fn is_at_hand(&self, id: &BlobId) -> bool {
        !matches!(self.objects.try_read(id), Ok(lodestream_protocol::source::Reading::Pending))
    }

    fn fetch(&self, id: &BlobId) -> Result<bytes::Bytes, SourceError> {
        self.runtime.block_on(self.objects.fetch(id).unwrap())
    }
}

#[test]
fn a_bucket_serves_the_same_bytes_as_files() {
    let two = Two::new();
    assert_eq!(two.objects.header(), two.files.header());
    assert_eq!(two.objects.page(0), two.files.page(0));
    assert_eq!(two.objects.punctual_lights(), two.files.punctual_lights());
    let ids = all_blobs(&two.files);
    assert!(ids.len() > 30, "{}", ids.len());
    let before = two.s3.reads();
    for id in &ids {
        assert_eq!(two.objects.blob_len(id), two.files.blob_len(id));
        assert_eq!(two.fetch(id).unwrap(), two.files.read(id).unwrap(), "{id}");
        assert!(two.is_at_hand(id));
    }
    // A request reads neighbouring blobs too.
    let requests = two.s3.reads() - before;
    assert!(requests * 4 < ids.len() as u64, "{requests} requests for {} blobs", ids.len());
    assert!(two.objects.fetch(&BlobId::base(9)).is_none());
    assert!(matches!(two.fetch(&BlobId::chunk(0, 9999)), Err(SourceError::NotFound(_))));
}

#[test]
fn reads_of_the_same_range_share_one_request() {
    let two = Two::new();
    let id = two.far();
    two.s3.set(Fault::Slow);
    let before = two.s3.reads();
    let all = (0..50).map(|_| two.objects.fetch(&id).unwrap());
    let got = two.runtime.block_on(futures_util::future::join_all(all));
    assert!(got.iter().all(|bytes| bytes.as_ref().unwrap() == got[0].as_ref().unwrap()));
    assert_eq!(two.s3.reads() - before, 1);
}

#[test]
fn wrong_answers_of_a_store_are_refused_until_it_recovers() {
    let two = Two::new();
    let id = two.far();
    for fault in [Fault::Short, Fault::Wrong, Fault::Missing] {
        two.s3.set(fault);
        let refused = two.fetch(&id).unwrap_err();
        let SourceError::Unreadable { why, .. } = &refused else { panic!("{fault:?}: {refused}") };
        assert!(why.starts_with("s3://bucket/packs/"), "{fault:?}: {why}");
        assert!(!two.is_at_hand(&id), "{fault:?}");
    }
    // Temporary faults are retried.
    for fault in [Fault::WrongFor(1), Fault::BusyFor(2)] {
        let two = Two::new();
        let id = two.far();
        two.s3.set(fault);
        assert_eq!(two.fetch(&id).unwrap(), two.files.read(&id).unwrap(), "{fault:?}");
    }
    two.s3.set(Fault::Nothing);
    assert_eq!(two.fetch(&id).unwrap(), two.files.read(&id).unwrap());
}

#[test]
fn a_scene_over_damaged_objects_is_not_opened() {
    let two = Two::new();
    let open = || {
        let opened =
            two.runtime.block_on(SceneStore::open(&bucket(&two.s3), "hall.lss", &BlobCache::new(1 << 24)));
        opened.err().map(|why| why.to_string()).unwrap_or_default()
    };
    for (fault, said) in
        [(Fault::Wrong, "damaged"), (Fault::Missing, "no such object"), (Fault::Short, "truncated")]
    {
        two.s3.set(fault);
        let why = open();
        assert!(why.starts_with("s3://bucket/hall.lss: ") && why.contains(said), "{fault:?}: {why}");
    }
    two.s3.set(Fault::Nothing);
    let packs = two.s3.root.path().join("bucket/packs");
    let mut files: Vec<_> = std::fs::read_dir(&packs).unwrap().map(|file| file.unwrap().path()).collect();
    files.sort();
    // Each pack under the other's name.
    let swapped = packs.join("swapped");
    for (from, to) in [(&files[0], &swapped), (&files[1], &files[0]), (&swapped, &files[1])] {
        std::fs::rename(from, to).unwrap();
    }
    assert!(open().contains("another pack than the scene was published with"), "{}", open());
}

#[test]
fn publishing_again_writes_nothing_and_another_machine_prepares_nothing() {
    let (s3, folder) = (S3::start(), tempfile::tempdir().unwrap());
    let runtime = Runtime::new().unwrap();
    let scene = write_scene(folder.path(), "hall", 0.1);
    let published = |scene: &Scene, cache: &str| {
        let to = folder.path().join(cache);
        let done = runtime.block_on(publish(scene, &bucket(&s3), &to, &options())).unwrap();
        assert!(done.preview.is_some());
        Published { preview: None, ..done }
    };
    let expected = |prepared, written, there, scene_written| Published {
        name: "hall.lss".into(),
        prepared,
        written,
        there,
        scene_written,
        preview: None,
    };
    assert_eq!(published(&scene, "cache"), expected(2, 2, 0, true));
    assert_eq!(published(&scene, "cache"), expected(0, 0, 2, false));
    assert_eq!(published(&scene, "another"), expected(0, 0, 2, false));
    // A damaged pack in the store is prepared and written again.
    let packs = s3.root.path().join("bucket/packs");
    for pack in std::fs::read_dir(packs).unwrap() {
        let pack = pack.unwrap().path();
        let bytes = std::fs::read(&pack).unwrap();
        std::fs::write(&pack, &bytes[..bytes.len() / 2]).unwrap();
    }
    assert_eq!(published(&scene, "a third"), expected(2, 2, 0, false));
    let changed = write_scene(folder.path(), "hall", 0.2);
    assert_eq!(published(&changed, "cache"), expected(1, 1, 1, true));
}

#[test]
fn packs_of_proxies_are_published_and_another_machine_prepares_none() {
    let (s3, folder) = (S3::start(), tempfile::tempdir().unwrap());
    let runtime = Runtime::new().unwrap();
    let mut text = String::from("name = 'many'\n");
    for number in 0..64 {
        // Rough ground with a colour at each vertex: 0.8 kB of base mesh.
        let mut obj = String::new();
        for i in 0..121_u32 {
            let hash = (i + 1000 * number).wrapping_mul(0x9E37_79B9);
            let hash = (hash ^ (hash >> 15)).wrapping_mul(0x85EB_CA6B);
            let [y, r, g, b] = hash.to_be_bytes().map(|byte| f64::from(byte) / 255.0);
            obj.push_str(&format!("v {} {} {} {r} {g} {b}\n", i % 11, 5.0 * y, i / 11));
        }
        for i in (0..100).map(|i| i / 10 * 11 + i % 10 + 1) {
            obj.push_str(&format!("f {i} {} {} {}\n", i + 11, i + 12, i + 1));
        }
        std::fs::write(folder.path().join(format!("{number}.obj")), obj).unwrap();
        text += &format!("[[asset]]\nname = '{number}'\nfile = '{number}.obj'\n");
        text += &format!(
            "[[instance]]\nasset = '{number}'\ntranslation = [{}, 0, {}]\n",
            number % 8 * 15,
            number / 8 * 15
        );
    }
    let file = folder.path().join("many.toml");
    std::fs::write(&file, text).unwrap();
    let scene = scene::read(&file).unwrap();
    let published = |cache: &str| {
        let to = folder.path().join(cache);
        let done = runtime.block_on(publish(&scene, &bucket(&s3), &to, &options())).unwrap();
        (done.prepared, done.written, done.there, done.scene_written)
    };
    let (prepared, written, there, _) = published("cache");
    assert!(prepared == written && written > 66 && there == 0, "{prepared} {written} {there}");
    assert_eq!(published("another"), (0, 0, written, false));
    let (objects, blobs) = (bucket(&s3), BlobCache::new(1 << 24));
    let store = runtime.block_on(SceneStore::open(&objects, "many.lss", &blobs)).unwrap();
    assert_eq!(store.header().asset_count as usize, written);
    let first = store.page(0).unwrap();
    assert!(!first.proxies.is_empty() && first.instances.is_empty());
}

/// The program, with the bucket in its environment.
fn program(s3: &S3, folder: &Path, arguments: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_lodestream-server"));
    command.args(arguments).envs(s3.environment()).current_dir(folder);
    command
}

fn run(s3: &S3, folder: &Path, arguments: &[&str]) -> String {
    let output = program(s3, folder, arguments).output().unwrap();
    let text =
        String::from_utf8_lossy(&output.stdout).into_owned() + &String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{arguments:?}: {text}");
    text
}

/// A server that is killed at the end of the test.
struct Server {
    _child: KilledOnDrop,
    http: String,
}

impl Server {
    fn start(s3: &S3, folder: &Path, scenes: &[&str]) -> Self {
        let ports =
            ["--listen", "127.0.0.1:0", "--http", "127.0.0.1:0", "--admin", "off", "--scene-check", "1"];
        let mut command = program(s3, folder, &[&["serve"], scenes, &ports, &["--cache", "cache"]].concat());
        let mut child = command.stdout(Stdio::piped()).stderr(Stdio::null()).spawn().unwrap();
        let lines = BufReader::new(child.stdout.take().unwrap()).lines();
        let mut lines = lines.map(|line| line.expect("the server has ended"));
        let http = lines
            .find_map(|line| line.strip_prefix("ws://").map(str::to_owned))
            .expect("the server has ended");
        let http = http.split('/').next().unwrap_or_default().to_owned();
        Self { _child: KilledOnDrop(child), http }
    }

    fn scenes(&self) -> serde_json::Value {
        let mut stream = TcpStream::connect(&self.http).unwrap();
        stream.write_all(b"GET /scenes HTTP/1.1\r\nHost: s\r\n\r\n").unwrap();
        let mut text = String::new();
        stream.read_to_string(&mut text).unwrap();
        serde_json::from_str(text.split_once("\r\n\r\n").unwrap().1).unwrap()
    }

    /// Waits until the list of scenes satisfies `passes`.
    fn until(&self, passes: impl Fn(&serde_json::Value) -> bool) -> serde_json::Value {
        let began = std::time::Instant::now();
        loop {
            let list = self.scenes();
            if passes(&list) {
                return list;
            }
            assert!(began.elapsed().as_secs() < 60, "{list}");
            std::thread::sleep(std::time::Duration::from_millis(100));
        }
    }
}

#[test]
fn servers_over_one_bucket_serve_newly_published_scenes() {
    let (s3, folder) = (S3::start(), tempfile::tempdir().unwrap());
    let home = folder.path();
    write_scene(home, "hall", 0.1);
    write_scene(home, "yard", 0.1);
    run(&s3, home, &["publish", "hall.toml", "s3://bucket/scenes", "--cache", "cache", "-q"]);
    let servers = [(); 2].map(|()| Server::start(&s3, home, &["s3://bucket/scenes/"]));
    let lists = servers.each_ref().map(Server::scenes);
    assert_eq!(lists[0], lists[1]);
    assert_eq!(lists[0]["scenes"][0]["name"], "hall");
    // Another scene and a new version of the first, prepared from models in the store.
    let models = s3.root.path().join("bucket/models");
    std::fs::create_dir(&models).unwrap();
    for file in ["yard.toml", "sheet.obj", "one.obj"] {
        std::fs::copy(home.join(file), models.join(file)).unwrap();
    }
    let told = run(
        &s3,
        home,
        &["publish", "s3://bucket/models/yard.toml", "s3://bucket/scenes/", "--cache", "other", "-q"],
    );
    assert!(told.contains("yard.lss written; packs: 0 written, 2 existing, 0 prepared"), "{told}");
    write_scene(home, "hall", 0.3);
    run(&s3, home, &["publish", "hall.toml", "s3://bucket/scenes", "--cache", "cache", "-q"]);
    let before = lists[0]["scenes"][0]["fingerprint"].clone();
    for server in &servers {
        server.until(|list| {
            list["scenes"].as_array().unwrap().len() == 2 && list["scenes"][0]["fingerprint"] != before
        });
    }
    assert_eq!(servers[0].scenes(), servers[1].scenes());
    std::fs::remove_file(s3.root.path().join("bucket/scenes/yard.lss")).unwrap();
    servers[1].until(|list| list["scenes"].as_array().unwrap().len() == 1);
    // A single pack.
    let pack = ["prepare", "s3://bucket/models/one.obj", "-o", "s3://bucket/one.lsp", "-q"];
    assert!(run(&s3, home, &pack).contains("1 faces"));
    assert!(run(&s3, home, &pack).contains("exists already"));
}

#[test]
fn changes_of_a_folder_are_served_and_unreadable_scenes_keep_their_version() {
    let (s3, folder) = (S3::start(), tempfile::tempdir().unwrap());
    let scenes = folder.path().join("scenes");
    std::fs::create_dir(&scenes).unwrap();
    write_scene(&scenes, "hall", 0.1);
    let server = Server::start(&s3, folder.path(), &["scenes"]);
    let first = server.scenes();
    write_scene(&scenes, "yard", 0.1);
    let both = server.until(|list| list["scenes"].as_array().unwrap().len() == 2);
    assert_eq!(both["scenes"][0], first["scenes"][0]);
    std::fs::write(scenes.join("hall.toml"), "nonsense").unwrap();
    write_scene(&scenes, "yard", 0.2);
    let after = server.until(|list| list["scenes"][1] != both["scenes"][1]);
    assert_eq!(after["scenes"][0], first["scenes"][0]);
    // The hall uses the same sheet; its file is repaired.
    write_scene(&scenes, "hall", 0.2);
    server.until(|list| list["scenes"][0] != first["scenes"][0]);
}

/// A source that cannot be listed does not affect what is known of the others, and an unreadable scene is not read
/// again at every check.
#[test]
fn failed_scenes_are_not_read_again_until_they_change() {
    let folder = tempfile::tempdir().unwrap();
    let [one, other] = ["one", "other"].map(|name| folder.path().join(name));
    for (place, name) in [(&one, "hall"), (&other, "yard")] {
        std::fs::create_dir(place).unwrap();
        write_scene(place, name, 0.1);
    }
    let broken = one.join("broken.toml");
    std::fs::write(&broken, "nonsense").unwrap();
    let cache = folder.path().join("cache");
    let words = [one.clone(), other.clone()];
    let catalogue = Catalogue::new(&words, cache, options(), 1 << 24, None).unwrap();
    let runtime = Runtime::new().unwrap();
    let scenes = runtime.block_on(catalogue.open()).unwrap();
    assert!(scenes.get("hall").is_some() && scenes.get("yard").is_some());
    let look = || runtime.block_on(catalogue.load(false));
    assert!(look().unwrap().is_none());
    // A source that is missing.
    let away = folder.path().join("away");
    std::fs::rename(&other, &away).unwrap();
    // Meanwhile a scene of another source is unreadable.
    let (hall, text) = (one.join("hall.toml"), std::fs::read(one.join("hall.toml")).unwrap());
    assert!(look().is_err());
    std::fs::rename(&away, &other).unwrap();
    std::fs::write(&hall, "nonsense").unwrap();
    assert!(look().unwrap().is_none(), "an unreadable scene must change nothing");
    assert!(look().unwrap().is_none());
    std::fs::write(&hall, text).unwrap();
    assert_eq!(look().unwrap().map(|all| all.len()), Some(2));
    write_scene(&one, "broken", 0.1);
    assert_eq!(look().unwrap().map(|all| all.len()), Some(3));
    assert!(look().unwrap().is_none());
}
