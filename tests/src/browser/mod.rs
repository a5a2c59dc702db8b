//! The page in a browser tab: streamed by a daemon, drawn by WebGPU in software, moved by mouse, wheel and fingers.

mod devtools;
mod figures;
mod page;
mod shaders;
mod static_host;

use std::io::Write as _;
use std::path::PathBuf;

use devtools::Tab;

/// A tab, or `None` if tests in a browser are skipped.
fn tab(size_px: [u32; 2]) -> Option<Tab> {
    if std::env::var("LODESTREAM_SKIP_BROWSER").is_ok_and(|v| v == "1") {
        let test = std::thread::current().name().unwrap_or("a test").to_owned();
        // Not `eprintln!`: the test runner would swallow it when the test "passes".
        let _ = writeln!(std::io::stderr(), "SKIPPED, NOT PASSED (LODESTREAM_SKIP_BROWSER=1): {test}");
        return None;
    }
    let tab = Tab::open(size_px);
    Some(
        tab.expect(
            "these tests need Chromium (Debian: apt-get install chromium), or LODESTREAM_SKIP_BROWSER=1",
        ),
    )
}

/// The folder that `script/web` has written.
fn built_page() -> PathBuf {
    let target = std::env::var_os("CARGO_TARGET_DIR")
        .map_or_else(|| std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../target"), Into::into);
    let page = target.join("web");
    assert!(
        page.join("index.html").exists(),
        "the page is absent: build it with script/web, or LODESTREAM_SKIP_BROWSER=1"
    );
    page
}
