//! Dependencies of each crate, from `cargo tree`.

use std::collections::BTreeSet;
use std::path::PathBuf;
use std::process::Command;

/// Names of all crates that a package's library depends on, with arguments for features.
fn needs(package: &str, arguments: &[&str]) -> BTreeSet<String> {
    let mut command = Command::new(env!("CARGO"));
    command.current_dir(concat!(env!("CARGO_MANIFEST_DIR"), "/.."));
    command.args([
        "tree",
        "--offline",
        "--locked",
        "--edges",
        "normal,build",
        "--prefix",
        "none",
        "-p",
        package,
    ]);
    let output = command.args(arguments).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let names = String::from_utf8(output.stdout).unwrap();
    let names: BTreeSet<String> =
        names.lines().filter_map(|line| line.split_whitespace().next()).map(str::to_owned).collect();
    // Guards against another output format, in which no name would be found.
    assert!(names.contains(package), "{names:?}");
    names
}

/// Asserts that a package depends on none of these crates.
fn lacks(package: &str, arguments: &[&str], none: &[&str]) {
    let needs = needs(package, arguments);
    for name in none {
        assert!(!needs.contains(*name), "{package} {arguments:?} needs {name}");
    }
}

#[test]
fn an_embedder_of_the_client_compiles_no_window_and_no_renderer() {
    let graphics = ["wgpu", "winit", "egui", "clap", "lodestream-render", "lodestream-server"];
    lacks("lodestream-client", &[], &graphics);
    assert!(needs("lodestream-client", &[]).contains("tokio"));
    let network = ["tokio", "quinn", "rustls", "ring", "tungstenite", "tokio-tungstenite", "socket2"];
    lacks("lodestream-client", &["--no-default-features"], &network);
    // Nor C. (`cc` is a dependency of BLAKE3, which does not call it with its feature `pure`.)
    lacks("lodestream-client", &["--no-default-features"], &["zstd", "zstd-sys"]);
    // Nor decoders of images, which a browser has.
    lacks("lodestream-client", &["--no-default-features"], &["image", "png"]);
    lacks("lodestream-client", &["--no-default-features", "--features", "quic"], &["tokio-tungstenite"]);
    lacks("lodestream-client", &["--no-default-features", "--features", "websocket"], &["quinn", "rustls"]);
    lacks(
        "lodestream-client",
        &["--no-default-features", "--features", "tls"],
        &["quinn", "aws-lc-rs", "openssl"],
    );
}

#[test]
fn an_embedder_of_the_renderer_compiles_no_network() {
    let network = ["tokio", "quinn", "rustls", "tungstenite", "winit", "egui", "clap"];
    lacks("lodestream-render", &[], &[&network[..], &["lodestream-client"]].concat());
    lacks("lodestream-render", &["--features", "client"], &network);
    assert!(needs("lodestream-render", &["--features", "client"]).contains("lodestream-client"));
}

/// An embedder of the renderer with the feature `client` alone compiles no CPU reference and no drawing method for
/// comparison: both are features that nothing turns on by default.
#[test]
fn an_embedder_of_the_renderer_compiles_no_references() {
    let root = concat!(env!("CARGO_MANIFEST_DIR"), "/..");
    let manifest = |file: &str| -> toml::Table {
        std::fs::read_to_string(format!("{root}/{file}")).unwrap().parse().unwrap()
    };
    let render = manifest("crates/render/Cargo.toml");
    let features = render["features"].as_table().unwrap();
    assert!(!features.contains_key("default"), "{features:?}");
    assert!(features.contains_key("methods") && features.contains_key("reference"), "{features:?}");
    assert_eq!(features["client"].as_array().unwrap().len(), 1, "{features:?}");
    let embed = manifest("examples/embed/Cargo.toml");
    let enabled = embed["dependencies"]["lodestream-render"]["features"].as_array().unwrap();
    assert_eq!(enabled.iter().map(|name| name.as_str().unwrap()).collect::<Vec<_>>(), ["client"]);
    let library = std::fs::read_to_string(format!("{root}/crates/render/src/lib.rs")).unwrap();
    for module in ["cpu_reference", "image_compare", "rays"] {
        let gated = format!("#[cfg(any(test, feature = \"reference\"))]\npub mod {module};");
        assert!(library.contains(&gated), "{module} is compiled without the feature `reference`");
    }
}

/// Names of an enum's variants or a struct's fields that are compiled without the renderer's feature `methods`.
fn without_methods(file: &str, type_name: &str) -> Vec<String> {
    let path = format!("{}/../crates/render/src/{file}", env!("CARGO_MANIFEST_DIR"));
    let parsed = syn::parse_file(&std::fs::read_to_string(path).unwrap()).unwrap();
    let is_methods = |attribute: &syn::Attribute| {
        let condition = attribute.meta.require_list().map(|list| list.tokens.to_string().replace(' ', ""));
        attribute.path().is_ident("cfg")
            && condition.is_ok_and(|condition| condition == r#"any(test,feature="methods")"#)
    };
    let name = |attributes: &[syn::Attribute], name: &syn::Ident| {
        (!attributes.iter().any(is_methods)).then(|| name.to_string())
    };
    let of_item = |item: &syn::Item| -> Option<Vec<String>> {
        match item {
            syn::Item::Enum(item) if item.ident == type_name => {
                Some(item.variants.iter().filter_map(|v| name(&v.attrs, &v.ident)).collect())
            }
            syn::Item::Struct(item) if item.ident == type_name => {
                Some(item.fields.iter().filter_map(|f| name(&f.attrs, f.ident.as_ref()?)).collect())
            }
            _ => None,
        }
    };
    parsed.items.iter().find_map(of_item).unwrap_or_else(|| panic!("{file} declares no {type_name}"))
}

/// The shaders of such a build are checked in `embed`.
#[test]
fn settings_without_the_renderers_methods_offer_the_defaults_only() {
    assert_eq!(without_methods("frame/settings.rs", "ReliefMethod"), ["Relief"]);
    assert_eq!(without_methods("passes/occlusion.rs", "OcclusionMethod"), ["Gtao"]);
    let settings = without_methods("frame/settings.rs", "Settings");
    assert!(settings.len() > 20 && settings.contains(&"relief_method".to_owned()), "{settings:?}");
    for method in ["pn_triangles", "ink"] {
        assert!(!settings.contains(&method.to_owned()), "{settings:?}");
    }
}

/// Client, server push and simulator share one selection, which therefore knows no session.
#[test]
fn selection_depends_on_no_session() {
    lacks(
        "lodestream-select",
        &[],
        &["lodestream-protocol", "lodestream-client", "lodestream-daemon", "tokio"],
    );
    assert!(needs("lodestream-protocol", &[]).contains("lodestream-select"));
}

/// Terrain is generated and its tiles are selected without a GPU, a window or a thread pool.
#[test]
fn terrain_tiles_are_selected_without_a_gpu() {
    lacks("lodestream-terrain", &[], &["wgpu", "lodestream-render", "lodestream-scene", "tokio", "rayon"]);
    let of_the_renderer = needs("lodestream-render", &[]);
    assert!(of_the_renderer.contains("lodestream-terrain") && of_the_renderer.contains("wgpu"));
}

/// Nor C: only tests encode with meshoptimizer's library.
#[test]
fn the_importer_without_its_draco_feature_compiles_no_draco() {
    assert!(needs("lodestream-import", &[]).contains("draco-core"));
    lacks("lodestream-import", &["--no-default-features"], &["draco-core"]);
    lacks("lodestream-import", &[], &["meshopt", "zstd-sys", "tokio", "clap"]);
}

/// Clients of object stores bring a C library for TLS by default.
#[test]
fn the_server_has_one_library_of_tls() {
    lacks("lodestream-server", &[], &["aws-lc-rs", "aws-lc-sys", "openssl", "native-tls", "wgpu", "winit"]);
    assert!(needs("lodestream-server", &[]).contains("object_store"));
}

/// Whether a package compiles another with a feature, its own features being the default ones.
fn enables(package: &str, dependency: &str, feature: &str) -> bool {
    let mut command = Command::new(env!("CARGO"));
    command.current_dir(concat!(env!("CARGO_MANIFEST_DIR"), "/.."));
    command.args(["tree", "--offline", "--locked", "--edges", "normal,build,features", "--prefix", "none"]);
    let output = command.args(["--format", "{p}|{f}", "-p", package]).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let listing = String::from_utf8(output.stdout).unwrap();
    // A line is "NAME vVERSION (PATH)|FEATURE,FEATURE", or "NAME feature \"FEATURE\"" for an edge.
    let lines = listing.lines().filter(|line| line.split_whitespace().next() == Some(dependency));
    let features: Vec<&str> = lines.filter_map(|line| line.rsplit_once('|')).map(|(_, list)| list).collect();
    // Guards against a listing of another form, in which no feature would ever be found.
    assert!(!features.is_empty(), "{package} does not need {dependency}, or the listing has another form");
    features.iter().any(|list| list.split([',', ' ']).any(|enabled| enabled == feature))
}

#[test]
fn serving_and_viewing_compile_no_importer_and_no_simplifier() {
    for package in ["lodestream-daemon", "lodestream-client", "lodestream-store"] {
        lacks(package, &[], &["lodestream-import", "lodestream-bake", "gltf", "tobj", "draco-core"]);
        assert!(!enables(package, "lodestream-geometry", "prepare"), "{package} compiles the simplifier");
    }
    // The names looked for above are found where they are needed.
    for name in ["lodestream-import", "gltf", "tobj", "draco-core"] {
        assert!(needs("lodestream-bake", &[]).contains(name), "{name}");
    }
    assert!(needs("lodestream-server", &[]).contains("lodestream-bake"));
    assert!(enables("lodestream-bake", "lodestream-geometry", "prepare"));
}

/// bincode is unmaintained (deny.toml): it encodes control messages, and nothing that is stored.
#[test]
fn only_the_protocol_depends_on_bincode() {
    let root = concat!(env!("CARGO_MANIFEST_DIR"), "/..");
    let read = |file: &str| -> toml::Table {
        std::fs::read_to_string(format!("{root}/{file}/Cargo.toml")).unwrap().parse().unwrap()
    };
    let workspace = read(".");
    let members =
        workspace["workspace"]["members"].as_array().unwrap().iter().map(|name| name.as_str().unwrap());
    let users: Vec<&str> = members
        .filter(|member| {
            let manifest = read(member);
            let lists = ["dependencies", "dev-dependencies", "build-dependencies"];
            lists.iter().filter_map(|list| manifest.get(*list)).any(|list| list.get("bincode").is_some())
        })
        .collect();
    assert_eq!(users, ["protocol"]);
    lacks("lodestream-scene", &[], &["bincode"]);
    let (mut named, mut folders) = (Vec::new(), vec![PathBuf::from(format!("{root}/protocol/src"))]);
    while let Some(folder) = folders.pop() {
        for path in std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()) {
            if path.is_dir() {
                folders.push(path);
            } else if std::fs::read_to_string(&path).unwrap().contains("bincode") {
                named.push(path);
            }
        }
    }
    assert!(named.len() == 1 && named[0].ends_with("protocol/src/coding.rs"), "{named:?}");
}

#[test]
fn the_simulated_links_depend_on_no_other_crate_of_the_workspace() {
    let ours: Vec<String> = needs("lodestream-netsim", &[])
        .into_iter()
        .filter(|name| name.starts_with("lodestream-") && name != "lodestream-netsim")
        .collect();
    assert!(ours.is_empty(), "{ours:?}");
}
