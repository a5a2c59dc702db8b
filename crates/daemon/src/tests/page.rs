//! The page for browsers.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};

use bytes::Bytes;
use lodestream_protocol::source::{SceneSource, SourceError};
use lodestream_scene::blob::BlobId;
use lodestream_scene::description::{SceneHeader, ScenePage};
use serde_json::Value;
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::time::Instant;

use super::http::exchange;
use super::*;
use crate::http::page::{Page, PageError, PageSetting};
use crate::http::site::{Site, WebTransportOffer};
use crate::session::scene_preview::PreviewFile;
use crate::session::scenes::Scenes;

const INDEX: &str = "<!doctype html><script type=\"application/json\" id=\"lodestream-server\">{}</script>\
                     <script type=\"module\" src=\"/lodestream-0123abcd.js\"></script>";

fn folder_with(files: &[(&str, &[u8])]) -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    for (name, contents) in files {
        std::fs::write(folder.path().join(name), contents).unwrap();
    }
    folder
}

fn page_folder() -> tempfile::TempDir {
    folder_with(&[
        ("index.html", INDEX.as_bytes()),
        ("index.html.br", b"stale"),
        ("lodestream-0123abcd.js", b"plain script"),
        ("lodestream-0123abcd.js.br", b"brotli"),
        ("lodestream-0123abcd.js.gz", b"gzip"),
        ("lodestream-0123abcd.wasm", b"\0asm"),
        ("icon.svg", b"<svg/>"),
        (".hidden", b"secret"),
    ])
}

/// A server of these scenes, with the page of a folder.
fn served(scenes: &[&str], folder: &Path) -> Arc<ServerState> {
    let named = |name: &&str| Arc::new(MemoryScene::named(name, 1, 100, 100)) as Arc<dyn SceneSource>;
    let scenes = Scenes::new(scenes.iter().map(named).collect()).unwrap();
    let state = ServerState::with_admission(scenes, SessionSettings::default(), Default::default());
    let page = PageSetting::Loaded(Page::load(folder).unwrap());
    let site = Site::new(page, Some(8080));
    site.offer_webtransport(WebTransportOffer { port: 4433, certificate_hashes: vec!["ab".repeat(32)] });
    state.set_site(site);
    state
}

struct Answer {
    status: u16,
    headers: BTreeMap<String, String>,
    body: String,
}

/// Sends one request, with more header lines if given, and reads until the server closes.
async fn request(state: &Arc<ServerState>, line: &str, more: &str) -> Answer {
    let text = format!("{line} HTTP/1.1\r\nHost: localhost:8080\r\nConnection: close\r\n{more}\r\n");
    let text = exchange(state, text.as_bytes()).await;
    let (head, body) = text.split_once("\r\n\r\n").unwrap_or_else(|| panic!("{line}: {text:?}"));
    let mut lines = head.lines();
    let status = lines.next().unwrap().split(' ').nth(1).unwrap().parse().unwrap();
    let headers = lines.map(|line| {
        let (name, value) = line.split_once(": ").unwrap();
        (name.to_ascii_lowercase(), value.to_owned())
    });
    Answer { status, headers: headers.collect(), body: body.into() }
}

impl Answer {
    fn header(&self, name: &str) -> &str {
        self.headers.get(name).map_or("", String::as_str)
    }

    /// The description of the server in the page.
    fn description(&self) -> Value {
        let after = self.body.split_once("id=\"lodestream-server\">").expect("no description").1;
        serde_json::from_str(after.split_once("</script>").unwrap().0).unwrap()
    }
}

#[tokio::test(start_paused = true)]
async fn the_page_describes_the_server() {
    let folder = page_folder();
    let state = served(&["first", "</script><script>"], folder.path());
    let page = request(&state, "GET /", "").await;
    assert_eq!((page.status, page.header("content-type")), (200, "text/html; charset=utf-8"));
    assert_eq!(page.body.matches("<script").count(), 2, "a name ends the script element: {}", page.body);
    let all = page.description();
    assert_eq!(all["scenes"], serde_json::json!(["</script><script>", "first"]));
    assert_eq!((&all["scene"], &all["websocket"]), (&Value::Null, &"/".into()));
    assert_eq!(all["token_required"], false);
    let one = request(&state, "GET /first", "").await.description();
    assert_eq!((&one["scene"], &one["websocket"]), (&"first".into(), &"/first".into()));
    let hashes = ["ab".repeat(32)];
    assert_eq!(
        one["webtransport"],
        serde_json::json!({ "port": 4433, "path": "/first", "certificate_hashes": hashes })
    );
    let odd = request(&state, "GET /%3C%2Fscript%3E%3Cscript%3E", "").await.description();
    assert_eq!(odd["scene"], "</script><script>");
    assert_eq!(odd["websocket"], "/%3C%2Fscript%3E%3Cscript%3E");
    assert_eq!(request(&state, "GET /second", "").await.status, 404);
    assert_eq!(request(&state, "GET /health", "").await.body, "ok\n");
    assert_eq!(request(&state, "GET /stream", "").await.status, 426, "the address of sessions is no page");
    let only = served(&["first"], folder.path());
    assert_eq!(request(&only, "GET /", "").await.description()["scene"], "first");
}

#[tokio::test(start_paused = true)]
async fn the_page_does_not_name_scenes_that_need_a_token() {
    let folder = page_folder();
    let keys = folder_with(&[("keys", b"a secret of more than thirty-two bytes")]);
    let tokens = crate::Tokens::from_file(keys.path().join("keys"), None).unwrap();
    let access = Some(Arc::new(crate::Access::Tokens(tokens)));
    let admission = crate::AdmissionSettings { access, ..Default::default() };
    let scene = Arc::new(MemoryScene::named("secret", 1, 100, 100)) as Arc<dyn SceneSource>;
    let state = ServerState::with_admission(scene, SessionSettings::default(), admission);
    state.set_site(Site::new(PageSetting::Loaded(Page::load(folder.path()).unwrap()), None));
    let preview = give_preview(&state);
    for (path, scene) in [("/", Value::Null), ("/secret", "secret".into()), ("/other", "other".into())] {
        let page = request(&state, &format!("GET {path}"), "").await;
        let told = page.description();
        assert_eq!((page.status, &told["scene"]), (200, &scene), "{path}");
        assert!(!page.body.contains(preview), "{path}: {}", page.body);
        assert_eq!((&told["scenes"], &told["token_required"]), (&serde_json::json!([]), &true.into()));
        assert_eq!(told["webtransport"], Value::Null);
    }
}

#[tokio::test(start_paused = true)]
async fn files_come_in_the_shortest_form_that_the_browser_accepts() {
    let folder = page_folder();
    let state = served(&["s"], folder.path());
    let mut tags = std::collections::BTreeSet::new();
    for (accepted, coding, body) in [
        ("Accept-Encoding: gzip, deflate, br, zstd\r\n", "br", "brotli"),
        ("Accept-Encoding: br;q=0, gzip\r\n", "gzip", "gzip"),
        ("Accept-Encoding: GZIP;q=0.5\r\n", "gzip", "gzip"),
        ("Accept-Encoding: *\r\n", "br", "brotli"),
        ("Accept-Encoding: br;q=nonsense\r\n", "", "plain script"),
        ("Accept-Encoding: \r\n", "", "plain script"),
        ("", "", "plain script"),
    ] {
        let file = request(&state, "GET /lodestream-0123abcd.js", accepted).await;
        assert_eq!((file.status, file.body.as_str()), (200, body), "{accepted}");
        assert_eq!(file.header("content-encoding"), coding, "{accepted}");
        assert_eq!(file.header("content-length"), body.len().to_string());
        assert_eq!(file.header("vary"), "accept-encoding");
        assert_eq!(file.header("content-type"), "text/javascript; charset=utf-8");
        assert_eq!(file.header("cache-control"), "public, max-age=31536000, immutable");
        tags.insert(file.header("etag").to_owned());
    }
    assert_eq!(tags.len(), 3, "one entity tag for each form");
    let none = request(&state, "GET /lodestream-0123abcd.js", "Accept-Encoding: *;q=0\r\n").await;
    assert_eq!(none.status, 406);
    let wasm = request(&state, "GET /lodestream-0123abcd.wasm", "Accept-Encoding: br\r\n").await;
    assert_eq!((wasm.header("content-type"), wasm.header("content-encoding")), ("application/wasm", ""));
    let icon = request(&state, "GET /icon.svg", "").await;
    assert_eq!((icon.header("cache-control"), icon.header("content-type")), ("no-cache", "image/svg+xml"));
    let head = request(&state, "HEAD /lodestream-0123abcd.js", "").await;
    assert_eq!((head.status, head.body.as_str(), head.header("content-length")), (200, "", "12"));
    assert_eq!(request(&state, "POST /lodestream-0123abcd.js", "Content-Length: 0\r\n").await.status, 404);
    assert_eq!(request(&state, "POST /", "Content-Length: 0\r\n").await.status, 405);
}

#[tokio::test(start_paused = true)]
async fn a_cached_page_is_not_sent_again_until_it_changes() {
    let folder = page_folder();
    let state = served(&["s"], folder.path());
    for path in ["/", "/icon.svg"] {
        let first = request(&state, &format!("GET {path}"), "").await;
        let tag = first.header("etag").to_owned();
        for sent in [tag.clone(), format!("\"other\", W/{tag}"), "*".into()] {
            let again = request(&state, &format!("GET {path}"), &format!("If-None-Match: {sent}\r\n")).await;
            assert_eq!((again.status, again.body.as_str()), (304, ""), "{path} {sent}");
            assert_eq!(again.header("etag"), tag);
            assert_eq!(again.header("cache-control"), "no-cache");
        }
        let other = request(&state, &format!("GET {path}"), "If-None-Match: \"other\"\r\n").await;
        assert_eq!(other.status, 200);
    }
    let tag = request(&state, "GET /", "").await.header("etag").to_owned();
    let renewed = vec!["ab".repeat(32), "cd".repeat(32)];
    state.site().offer_webtransport(WebTransportOffer { port: 4433, certificate_hashes: renewed });
    let page = request(&state, "GET /", &format!("If-None-Match: {tag}\r\n")).await;
    assert_eq!(page.status, 200, "the certificate has changed");
}

#[tokio::test(start_paused = true)]
async fn the_page_and_its_files_are_confined() {
    let folder = page_folder();
    let state = served(&["s"], folder.path());
    for path in ["/", "/lodestream-0123abcd.js"] {
        let answer = request(&state, &format!("GET {path}"), "").await;
        for (name, value) in [
            ("x-content-type-options", "nosniff"),
            ("referrer-policy", "no-referrer"),
            ("cross-origin-opener-policy", "same-origin"),
            ("cross-origin-embedder-policy", "require-corp"),
            ("cross-origin-resource-policy", "same-origin"),
            (
                "content-security-policy",
                "default-src 'none'; script-src 'self' 'wasm-unsafe-eval'; style-src 'self'; worker-src 'self'; \
                 img-src 'self' blob: data:; connect-src 'self' ws://localhost:8080 wss://localhost:8080 \
                 https://localhost:4433; base-uri 'none'; form-action 'none'; frame-ancestors 'self'",
            ),
        ] {
            assert_eq!(answer.header(name), value, "{path}");
        }
    }
    for host in ["a; script-src *", "a,b", "a b", "[::1]:8080", "'self'", "a@b"] {
        let text = format!("GET / HTTP/1.1\r\nHost: {host}\r\nConnection: close\r\n\r\n");
        let text = exchange(&state, text.as_bytes()).await;
        if text.starts_with("HTTP/1.1 200") {
            assert!(text.contains("connect-src 'self'; base-uri"), "{host}: {text}");
        } else {
            assert!(text.starts_with("HTTP/1.1 400"), "{host}: {text}");
        }
    }
}

#[tokio::test(start_paused = true)]
async fn no_path_leaves_the_folder() {
    let folder = page_folder();
    std::fs::create_dir(folder.path().join("inner")).unwrap();
    std::fs::write(folder.path().join("inner/file.js"), "inner").unwrap();
    let state = served(&["s"], folder.path());
    let file = folder.path().join("lodestream-0123abcd.js");
    for path in [
        "/../lodestream-0123abcd.js",
        "/./lodestream-0123abcd.js",
        "//lodestream-0123abcd.js",
        "/%2e%2e/etc/passwd",
        "/..%2fetc%2fpasswd",
        "/%2Fetc%2Fpasswd",
        "/inner/file.js",
        "/.hidden",
        "/index.html",
        "/lodestream-0123abcd.js/",
        "/lodestream-0123abcd.js%00",
        "/lodestream-0123abcd.js.br",
        file.to_str().unwrap(),
    ] {
        let answer = request(&state, &format!("GET {path}"), "").await;
        assert_eq!(answer.status, 404, "{path}: {}", answer.body);
    }
}

#[tokio::test(start_paused = true)]
async fn an_absent_page_is_explained() {
    let state = state_of(MemoryScene::new(1, 100, 100), None);
    let folders = vec![PathBuf::from("/usr/share/lodestream/web"), PathBuf::from("target/web")];
    state.set_site(Site::new(PageSetting::Absent(folders), None));
    let answer = request(&state, "GET /", "").await;
    assert_eq!((answer.status, answer.header("content-type")), (404, "text/plain; charset=utf-8"));
    assert_eq!(
        answer.body,
        "the page for browsers is absent (looked in /usr/share/lodestream/web and target/web): build it with \
         script/web\n"
    );
}

#[tokio::test(start_paused = true)]
async fn the_servers_own_page_may_open_sessions() {
    let folder = page_folder();
    let state = served(&["s"], folder.path());
    let upgrade = "GET / HTTP/1.1\r\nConnection: upgrade\r\nUpgrade: websocket\r\nSec-WebSocket-Version: 13\r\n\
                   Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\nSec-WebSocket-Protocol: lodestream.2\r\n";
    for (host, origin, status) in [
        ("localhost:8080", "http://localhost:8080", "101"),
        ("127.0.0.1:8080", "http://127.0.0.1:8080", "101"),
        ("localhost:8080", "http://localhost:8081", "403"),
        ("localhost:8080", "https://evil.example", "403"),
        ("localhost:8080", "null", "403"),
        // The name of another site, which it has made resolve to this server.
        ("evil.example:8080", "http://evil.example:8080", "403"),
    ] {
        let (mut near, far) = duplex(64 * 1024);
        tokio::spawn(accept_http(far, Arc::clone(&state), peer()));
        let text = format!("{upgrade}Host: {host}\r\nOrigin: {origin}\r\n\r\n");
        near.write_all(text.as_bytes()).await.unwrap();
        let mut status_line = [0; 12];
        near.read_exact(&mut status_line).await.unwrap();
        assert_eq!(String::from_utf8_lossy(&status_line), format!("HTTP/1.1 {status}"), "{origin} at {host}");
    }
}

#[tokio::test(start_paused = true)]
async fn one_connection_brings_several_files_however_slowly() {
    let script = vec![b'x'; 200_000];
    let folder = folder_with(&[("index.html", INDEX.as_bytes()), ("a-0123abcd.js", &script)]);
    let state = served(&["s"], folder.path());
    let (mut near, far) = duplex(4096);
    let serving = tokio::spawn(accept_http(far, state, peer()));
    let started = Instant::now();
    for _ in 0..2 {
        near.write_all(b"GET /a-0123abcd.js HTTP/1.1\r\nHost: localhost\r\n\r\n").await.unwrap();
        let mut received = Vec::new();
        // 4 KiB per second, so 50 s for each file; a request may take 10 s.
        while !received.ends_with(&script) {
            tokio::time::sleep(Duration::from_secs(1)).await;
            let mut piece = [0; 4096];
            let count = near.read(&mut piece).await.unwrap();
            assert!(count > 0, "closed after {} bytes", received.len());
            received.extend_from_slice(&piece[..count]);
        }
    }
    assert!(started.elapsed() > Duration::from_secs(90), "{:?}", started.elapsed());
    // A client that takes nothing more is dropped.
    near.write_all(b"GET /a-0123abcd.js HTTP/1.1\r\nHost: localhost\r\n\r\n").await.unwrap();
    let stalled = Instant::now();
    serving.await.unwrap();
    assert!(stalled.elapsed() <= Duration::from_secs(20), "{:?}", stalled.elapsed());
}

#[test]
fn unusable_folders_are_refused_with_the_reason() {
    let load = |files: &[(&str, &[u8])]| {
        let folder = folder_with(files);
        Page::load(folder.path()).map(|_| ()).unwrap_err()
    };
    let index = ("index.html", INDEX.as_bytes());
    assert!(matches!(load(&[]), PageError::NoIndex(_)));
    let without = load(&[("index.html", b"<!doctype html>")]);
    assert!(matches!(without, PageError::Placeholder(_, 0)), "{without}");
    let twice = load(&[("index.html", INDEX.repeat(2).as_bytes())]);
    assert!(matches!(twice, PageError::Placeholder(_, 2)), "{twice}");
    let original = load(&[index, ("a-0123abcd.js.gz", b"")]).to_string();
    assert!(original.contains("a-0123abcd.js.gz is the compressed form"), "{original}");
    assert!(matches!(load(&[index, ("a b.js", b"")]), PageError::Name(_)));
    let many: Vec<String> = (0..256).map(|number| format!("{number}.js")).collect();
    let many: Vec<(&str, &[u8])> = many.iter().map(|name| (name.as_str(), &b""[..])).chain([index]).collect();
    assert!(matches!(load(&many), PageError::TooManyFiles(_)));
    let missing = Page::load(Path::new("/nonexistent/page")).unwrap_err().to_string();
    assert!(missing.contains("/nonexistent/page"), "{missing}");
    let folder = folder_with(&[index]);
    // A sparse file, of which nothing beyond the limit is read.
    let file = std::fs::File::create(folder.path().join("long-0123abcd.wasm")).unwrap();
    file.set_len(65 << 20).unwrap();
    assert!(matches!(Page::load(folder.path()).unwrap_err(), PageError::TooLong(_)));
}

/// Gives a scene's version a preview without reading the scene.
fn give_preview(state: &ServerState) -> &'static str {
    let preview = PreviewFile::named(b"coarse".to_vec());
    let version = state.scenes().only().unwrap();
    version.preview().set(Some(Arc::new(preview))).unwrap();
    "preview-"
}

#[tokio::test(start_paused = true)]
async fn the_page_names_a_preview_that_is_served_by_its_content() {
    let folder = page_folder();
    let state = served(&["first"], folder.path());
    let prefix = give_preview(&state);
    let page = request(&state, "GET /", "").await;
    let name = page.description()["preview"].as_str().unwrap().to_owned();
    assert!(name.starts_with(prefix) && name.ends_with(".bin"), "{name}");
    assert!(
        page.body.contains(&format!("<link rel=\"preload\" href=\"./{name}\" as=\"fetch\" crossorigin />"))
    );
    let file = request(&state, &format!("GET /{name}"), "").await;
    assert_eq!((file.status, file.body.as_str()), (200, "coarse"));
    assert!(file.header("cache-control").contains("immutable"), "{:?}", file.headers);
    let tag = file.header("etag").to_owned();
    let again = request(&state, &format!("GET /{name}"), &format!("If-None-Match: {tag}\r\n")).await;
    assert_eq!(again.status, 304);
    assert_eq!(request(&state, "GET /preview-0000000000000000.bin", "").await.status, 404);
    // A scene that cannot be previewed is served all the same.
    let without = served(&["first"], folder.path());
    let page = request(&without, "GET /", "").await;
    assert_eq!((page.status, &page.description()["preview"]), (200, &Value::Null));
    assert!(!page.body.contains("preload"));
}

/// A scene whose store fails at the first read; its blobs are no base meshes.
struct FailsOnce(MemoryScene, AtomicBool);

impl SceneSource for FailsOnce {
    fn header(&self) -> &SceneHeader {
        self.0.header()
    }

    fn page(&self, page: u32) -> Option<Arc<ScenePage>> {
        self.0.page(page)
    }

    fn blob_len(&self, id: &BlobId) -> Option<u32> {
        self.0.blob_len(id)
    }

    fn read(&self, id: &BlobId) -> Result<Bytes, SourceError> {
        if self.1.swap(false, Ordering::Relaxed) {
            return Err(SourceError::Unreadable { id: *id, why: "no answer".into() });
        }
        self.0.read(id)
    }
}

#[tokio::test(start_paused = true)]
async fn a_preview_is_tried_again_after_an_error_of_the_store_but_not_of_the_scene() {
    let folder = page_folder();
    let scene = FailsOnce(MemoryScene::named("first", 1, 100, 100), AtomicBool::new(true));
    let scenes = Scenes::new(vec![Arc::new(scene) as Arc<dyn SceneSource>]).unwrap();
    let state = ServerState::with_admission(scenes, SessionSettings::default(), Default::default());
    state.set_site(Site::new(PageSetting::Loaded(Page::load(folder.path()).unwrap()), None));
    for known in [false, true] {
        assert_eq!(request(&state, "GET /", "").await.description()["preview"], Value::Null);
        assert_eq!(state.scenes().only().unwrap().preview().get().is_some(), known);
    }
}
