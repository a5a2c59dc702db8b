//! Writes the shaders that `wgsl!` includes. For a browser they are without what every visitor would load for nothing:
//! comments, indentation and methods that the tab does not offer. Natively they are the files, so that the lines of a
//! compiler's message are theirs.

use std::path::Path;
use std::{env, fs, io};

/// Shaders that are empty for a browser: debug views, wireframe, overdraw, screen-space reflections, bloom and drawing
/// into a host's target. There, a pipeline that needs one does not compile.
const NOT_FOR_BROWSERS: [&str; 9] = [
    "bloom.wgsl",
    "composite.wgsl",
    "debug.wgsl",
    "overdraw.wgsl",
    "pyramid.wgsl",
    "reflections.wgsl",
    "tracing.wgsl",
    "water_picture.wgsl",
    "wireframe.wgsl",
];

fn main() -> io::Result<()> {
    println!("cargo::rerun-if-changed=src/shaders");
    let for_browser = env::var("CARGO_CFG_TARGET_FAMILY").is_ok_and(|family| family == "wasm");
    let out = env::var_os("OUT_DIR").ok_or_else(|| io::Error::other("cargo sets OUT_DIR"))?;
    for file in fs::read_dir("src/shaders")? {
        let file = file?;
        let text = fs::read_to_string(file.path())?;
        let text = match for_browser {
            true if NOT_FOR_BROWSERS.iter().any(|name| file.file_name() == *name) => String::new(),
            true => stripped(&text),
            false => text,
        };
        fs::write(Path::new(&out).join(file.file_name()), text)?;
    }
    Ok(())
}

/// WGSL without comments, indentation and empty lines. It has no text in quotes, and no shader has a comment in `/*`.
fn stripped(text: &str) -> String {
    let code = |line: &'_ str| line.split("//").next().unwrap_or_default().trim().to_owned();
    text.lines().map(code).filter(|line| !line.is_empty()).map(|line| line + "\n").collect()
}
