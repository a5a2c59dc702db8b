//! The page in a browser tab: streamed by a daemon, drawn by WebGPU in software, moved by mouse, wheel and fingers.

mod address;
mod animations;
mod checks;
mod device;
mod devtools;
mod element;
mod figures;
mod files;
mod habits;
mod memory;
mod npm;
mod overlay;
mod page;
mod parts;
mod restart;
mod shaders;
mod static_host;
mod stats;
mod three;
mod transports;

use std::io::Write as _;
use std::path::PathBuf;

use data_encoding::BASE64;
use devtools::Tab;

/// Says that a test is skipped.
fn skip(why: &str) {
    let test = std::thread::current().name().unwrap_or("a test").to_owned();
    // Not `eprintln!`: the test runner would swallow it when the test "passes".
    let _ = writeln!(std::io::stderr(), "SKIPPED, NOT PASSED ({why}): {test}");
}

/// A tab with WebGPU, or `None` if tests in a browser are skipped.
fn tab(size_px: [u32; 2]) -> Option<Tab> {
    tab_with(size_px, devtools::WEBGPU)
}

/// The same with other graphics.
fn tab_with(size_px: [u32; 2], graphics: &[&str]) -> Option<Tab> {
    if std::env::var("LODESTREAM_SKIP_BROWSER").is_ok_and(|v| v == "1") {
        skip("LODESTREAM_SKIP_BROWSER=1");
        return None;
    }
    let tab = Tab::open(size_px, graphics);
    Some(
        tab.expect(
            "these tests need Chromium (Debian: apt-get install chromium), or LODESTREAM_SKIP_BROWSER=1",
        ),
    )
}

/// A folder that `script/web` has written below the build's folder, by a file that it has.
fn built(name: &str, file: &str) -> PathBuf {
    let target = std::env::var_os("CARGO_TARGET_DIR")
        .map_or_else(|| std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../target"), Into::into);
    let folder = target.join(name);
    assert!(
        folder.join(file).exists(),
        "{name}/{file} is absent: build it with script/web (checks: with --checks), or LODESTREAM_SKIP_BROWSER=1"
    );
    folder
}

/// The page.
fn built_page() -> PathBuf {
    built("web", "index.html")
}

/// The npm package.
fn built_package() -> PathBuf {
    built("npm", "index.js")
}

/// An image that an expression gives as a blob.
fn image(tab: &mut Tab, blob: &str) -> image::RgbaImage {
    let text = tab.evaluate(&format!(
        "Promise.resolve({blob}).then((blob) => new Promise((done) => {{
            const reader = new FileReader();
            reader.onload = () => done(reader.result.split(',')[1]);
            reader.readAsDataURL(blob);
        }}))"
    ));
    let png = BASE64.decode(text.as_str().expect("a picture").as_bytes()).unwrap();
    image::load_from_memory(&png).unwrap().to_rgba8()
}
