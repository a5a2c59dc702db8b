//! Cost of requests to an object store: how many requests a published demo scene takes, how many blobs and bytes each
//! returns, and this process's processor time, with an S3 server in another process.
//!
//! `cargo bench -p lodestream-server --bench stores`. The store is `s3s-fs` over a folder on loopback, with signatures.
//! Waiting times are not reported, since a real store is farther away. The first pass starts with an empty cache and
//! reads every blob, coarse levels first, as clients would that look at everything; the second finds all in the cache.
#![allow(clippy::unwrap_used, clippy::print_stdout, reason = "a benchmark may end where a test would")]

#[path = "../tests/suite/stores/s3.rs"]
#[allow(dead_code, unreachable_pub, reason = "tests use the rest")]
mod s3;

use std::io::{BufRead as _, BufReader, Write as _};
use std::path::Path;
use std::process::{Command, Stdio};
use std::sync::Arc;
use std::time::Instant;

use lodestream_bake::prepare::Options;
use lodestream_bake::scene;
use lodestream_protocol::source::SceneSource as _;
use lodestream_scene::{BlobId, BlobPart};
use lodestream_server::catalogue::publish::publish;
use lodestream_store::{BlobCache, Objects, SceneStore, retries};
use object_store::aws::AmazonS3Builder;
use tokio::runtime::Runtime;

/// Environment variable of the process that is the store.
const IS_STORE: &str = "LODESTREAM_BENCH_IS_STORE";

fn main() {
    if std::env::var_os(IS_STORE).is_some() {
        return be_store();
    }
    let mut store = Command::new(std::env::current_exe().unwrap())
        .env(IS_STORE, "1")
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .spawn()
        .unwrap();
    let (mut ask, mut told) = (store.stdin.take().unwrap(), BufReader::new(store.stdout.take().unwrap()));
    let mut line = || {
        let mut line = String::new();
        told.read_line(&mut line).unwrap();
        line.trim().to_owned()
    };
    let endpoint = line();
    let mut reads = || -> u64 {
        ask.write_all(b"\n").unwrap();
        line().parse().unwrap()
    };
    measure(&endpoint, &mut reads);
    drop(ask);
    store.wait().unwrap();
}

/// Runs the store: prints its address, then the number of reads whenever a line arrives.
fn be_store() {
    let s3 = s3::S3::start();
    println!("{}", s3.environment()[0].1);
    for asked in std::io::stdin().lock().lines() {
        if asked.is_err() {
            return;
        }
        println!("{}", s3.reads());
    }
}

fn bucket(endpoint: &str) -> Objects {
    let _ = rustls::crypto::ring::default_provider().install_default();
    let builder = s3::environment_of(endpoint).into_iter().fold(
        AmazonS3Builder::new().with_bucket_name("bucket").with_retry(retries()),
        |builder, (key, value)| match key.to_ascii_lowercase().parse() {
            Ok(key) => builder.with_config(key, value),
            Err(_) => builder,
        },
    );
    Objects::of_store(Arc::new(builder.build().unwrap()), "s3://bucket")
}

fn measure(endpoint: &str, reads: &mut dyn FnMut() -> u64) {
    let (bucket, runtime) = (bucket(endpoint), Runtime::new().unwrap());
    let work = Path::new(env!("CARGO_TARGET_TMPDIR")).join("stores");
    let made = lodestream_demo_scene::generate(&work.join("demo"), &lodestream_demo_scene::Options::full(1))
        .unwrap();
    let scene = scene::read(&made.scene).unwrap();
    let options = Options { quiet: true, ..Options::default() };
    runtime.block_on(publish(&scene, &bucket, &work.join("cache"), &options)).unwrap();

    let cache = BlobCache::new(256 << 20);
    let (before, busy) = (reads(), busy_seconds());
    let name = format!("{}.lss", scene.name);
    let store = runtime.block_on(SceneStore::open(&bucket, &name, &cache)).unwrap();
    let opening = reads() - before;
    println!("opening: {opening} requests, {:.1} ms of a core", 1e3 * (busy_seconds() - busy));

    let blobs = all_blobs(&store);
    println!(
        "pass       blobs        bytes   requests   of a core, ms   for a request, µs   a blob, µs   a MB, ms"
    );
    // The kernel's counter of a running thread is some milliseconds old.
    for (pass, times) in [("empty", 1), ("filled", 200)] {
        let (before, busy, began) = (reads(), busy_seconds(), Instant::now());
        let mut bytes = 0_u64;
        for id in (0..times).flat_map(|_| &blobs) {
            let blob = match store.try_read(id).unwrap() {
                lodestream_protocol::source::Reading::Ready(blob) => blob,
                lodestream_protocol::source::Reading::Pending => {
                    runtime.block_on(store.fetch(id).unwrap()).unwrap()
                }
            };
            bytes += blob.len() as u64;
        }
        let (busy, took, asked) = (busy_seconds() - busy, began.elapsed(), reads() - before);
        let count = (times * blobs.len()) as f64;
        let of = |number: f64, what: f64| 1e6 * number / what;
        let a_request = if asked > 0 { format!("{:.0}", of(busy, asked as f64)) } else { "–".to_owned() };
        let (a_blob, a_megabyte) = (of(busy, count), 1e3 * busy / (bytes as f64 / 1e6));
        println!(
            "{pass:<6}   {:>7}   {bytes:>10}   {asked:>8}   {:>13.1}   {a_request:>17}   {a_blob:>10.2}   {a_megabyte:>8.2}",
            times * blobs.len(),
            1e3 * busy,
        );
        eprintln!("({pass}: {:.2} s)", took.as_secs_f64());
    }
}

/// All blobs that a client could request, level by level.
fn all_blobs(store: &SceneStore) -> Vec<BlobId> {
    let assets = 0..store.header().asset_count;
    let parts = |number: u32| [BlobPart::IndexPage(number), BlobPart::Chunk(number)];
    let bases = assets.clone().map(BlobId::base);
    let rest = (0..4096).flat_map(|number| {
        assets.clone().flat_map(move |asset| parts(number).map(|part| BlobId::Asset { asset, part }))
    });
    bases.chain(rest).filter(|id| store.blob_len(id).is_some()).collect()
}

/// Processor time of all threads of this process, in seconds.
fn busy_seconds() -> f64 {
    let threads = std::fs::read_dir("/proc/self/task").expect("Linux's list of threads");
    let of = |thread: std::fs::DirEntry| {
        let text = std::fs::read_to_string(thread.path().join("schedstat")).ok()?;
        text.split(' ').next()?.parse::<f64>().ok()
    };
    threads.flatten().filter_map(of).sum::<f64>() * 1e-9
}
