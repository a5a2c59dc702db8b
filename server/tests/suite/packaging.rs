//! Checks the shipped files against the program: systemd unit, container image, dashboard, manual pages, packages.

use std::collections::BTreeSet;
use std::io::{BufRead as _, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use std::sync::Arc;

use lodestream_daemon::{MemoryScene, ServerState, SessionSettings};

/// A file of `server/packaging`.
fn shipped(name: &str) -> String {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("packaging").join(name);
    std::fs::read_to_string(&file).unwrap_or_else(|why| panic!("{}: {why}", file.display()))
}

fn program() -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_lodestream-server"));
    // A service does not inherit the environment of the tests.
    command.env_clear();
    command
}

/// The settings that a command line and an environment resolve to, as a file for `--config`.
fn resolved<'a>(words: &[&str], environment: impl IntoIterator<Item = (&'a str, &'a str)>) -> String {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("saved.toml");
    let output = program().args(words).arg("--save-config").arg(&file).envs(environment).output().unwrap();
    assert!(output.status.success(), "{words:?}: {}", String::from_utf8_lossy(&output.stderr));
    std::fs::read_to_string(file).unwrap()
}

/// Asserts that a text has each of these lines.
fn assert_lines(text: &str, lines: &[&str]) {
    for line in lines {
        assert!(text.lines().any(|other| other == *line), "{line} is not in {text}");
    }
}

#[test]
fn the_systemd_unit_starts_the_server_with_the_shipped_settings() {
    let unit = shipped("lodestream-server.service");
    assert_lines(&unit, &["Type=notify", "NoNewPrivileges=yes", "ProtectSystem=strict", "DynamicUser=yes"]);
    let value = |key: &str| unit.lines().find_map(|line| line.strip_prefix(key)).unwrap();
    let words: Vec<&str> = value("ExecStart=").split(' ').collect();
    let config = Path::new(env!("CARGO_MANIFEST_DIR")).join("packaging/server.toml");
    assert_eq!((words[0], words[3]), ("/usr/local/bin/lodestream-server", "/etc/lodestream/server.toml"));
    let words = [words[1], words[2], config.to_str().unwrap()];
    let saved = resolved(&words, value("Environment=").split_once('='));
    assert_lines(&saved, &["listen = \"0.0.0.0:4433\"", "drain = 30", "cache = \"/var/cache/lodestream\""]);
    // The server raises its soft limit of open files to this hard limit.
    assert!(unit.contains("LimitNOFILE=65536") && unit.contains("ExecReload=/bin/kill -HUP"));
}

#[test]
fn the_container_image_starts_the_server() {
    let file = shipped("Containerfile");
    let array = |key: &str| -> Vec<String> {
        let words = file.lines().find_map(|line| line.strip_prefix(key)).unwrap();
        serde_json::from_str(words).unwrap()
    };
    let (entry, words) = (array("ENTRYPOINT "), array("CMD "));
    assert_eq!(entry, ["/lodestream-server"]);
    let environment = file.lines().filter_map(|line| line.strip_prefix("ENV ")?.split_once('='));
    let words: Vec<&str> = words.iter().map(String::as_str).collect();
    let saved = resolved(&words, environment);
    assert_lines(&saved, &["listen = \"0.0.0.0:4433\"", "http = \"0.0.0.0:8080\"", "log-format = \"json\""]);
    assert_lines(&saved, &["cache = \"/cache\"", "page = \"/page\""]);
    let minimum = env!("CARGO_PKG_RUST_VERSION");
    assert!(file.contains(&format!("/rust:{minimum}-")), "the toolchain is {minimum}");
}

/// The metrics of a server that has just started.
fn metrics() -> String {
    let scene = Arc::new(MemoryScene::new(1, 10, 10));
    ServerState::new(scene, SessionSettings::default()).render_metrics()
}

/// Names of our metrics in a text.
fn metric_names(text: &str) -> BTreeSet<&str> {
    let part = |c: char| c.is_ascii_lowercase() || c.is_ascii_digit() || c == '_';
    let words = text.split(|c| !part(c));
    words.filter(|word| word.starts_with("lodestream_")).collect()
}

#[test]
fn the_dashboard_queries_existing_metrics() {
    let text = metrics();
    let exported = metric_names(&text);
    let dashboard: serde_json::Value = serde_json::from_str(&shipped("grafana-dashboard.json")).unwrap();
    let panels = dashboard["panels"].as_array().unwrap();
    assert!(panels.len() >= 10, "{}", panels.len());
    for panel in panels {
        for target in panel["targets"].as_array().unwrap() {
            let expression = target["expr"].as_str().unwrap();
            let queried = metric_names(expression);
            assert!(!queried.is_empty() && queried.is_subset(&exported), "{expression}");
            let [open, close] = ['(', ')'].map(|c| expression.matches(c).count());
            assert_eq!(open, close, "{expression}");
            // Grouping by a missing label would give one series without a name.
            for label in expression.split("by (").skip(1).filter_map(|rest| rest.split(')').next()) {
                let exists = text.contains(&format!("{label}=\"")) || label == "instance";
                assert!(exists, "{label} of {expression}");
            }
        }
    }
}

#[test]
fn the_operating_page_explains_exactly_the_exported_metrics() {
    let text = metrics();
    let families = text.lines().filter_map(|line| line.strip_prefix("# TYPE ")?.split(' ').next());
    let families: BTreeSet<&str> = families.collect();
    let page = Path::new(env!("CARGO_MANIFEST_DIR")).join("../docs/operating.md");
    let page = std::fs::read_to_string(page).unwrap();
    let rows: String = page.lines().filter(|line| line.starts_with("| `lodestream_")).collect();
    assert_eq!(metric_names(&rows), families);
}

fn generate(words: &[&str]) -> Output {
    let output = program().arg("generate").args(words).output().unwrap();
    assert!(output.status.success(), "{words:?}: {}", String::from_utf8_lossy(&output.stderr));
    output
}

#[test]
fn completions_and_manual_pages_cover_commands_and_flags() {
    for shell in ["bash", "zsh", "fish", "elvish", "powershell"] {
        let script = generate(&["completions", shell]).stdout;
        let script = String::from_utf8(script).unwrap();
        for word in ["terrain-import", "max-sessions-per-address", "completions"] {
            assert!(script.contains(word), "{shell}: {word}");
        }
    }
    let folder = tempfile::tempdir().unwrap();
    let pages = folder.path().join("new/man1");
    generate(&["man", pages.to_str().unwrap()]);
    let found = std::fs::read_dir(&pages).unwrap().map(|file| file.unwrap().path());
    let found: BTreeSet<PathBuf> = found.collect();
    for name in ["lodestream-server", "lodestream-server-serve", "lodestream-server-terrain-import"] {
        assert!(found.contains(&pages.join(name).with_extension("1")), "{name} of {found:?}");
    }
    let page = std::fs::read_to_string(pages.join("lodestream-server-serve.1")).unwrap();
    assert!(page.contains("drain") && page.contains("LODESTREAM_DRAIN"), "{page}");
}

/// A file of the repository.
fn repository(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..").join(name)
}

/// What `script/package --list` names: the tarball and its files, then the Debian package and its files.
fn package_list() -> (BTreeSet<String>, BTreeSet<String>) {
    let output = Command::new("bash").arg(repository("script/package")).arg("--list").output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let list = String::from_utf8(output.stdout).unwrap();
    let mut lines = list.lines();
    let version = env!("CARGO_PKG_VERSION");
    let folder = format!("lodestream-{version}-x86_64-linux");
    assert_eq!(lines.next(), Some(format!("target/package/{folder}.tar.gz").as_str()));
    let debian = format!("target/package/lodestream_{version}_amd64.deb");
    let tarball = lines.by_ref().take_while(|line| *line != debian).map(str::to_owned).collect();
    (tarball, lines.map(str::to_owned).collect())
}

/// The packages themselves are checked by `script/package --check`.
#[test]
fn packages_contain_each_program_with_its_manual_and_completions() {
    let (tarball, debian) = package_list();
    let version = env!("CARGO_PKG_VERSION");
    let mut expected = vec!["lib/systemd/system/lodestream.service".to_owned()];
    // The generator of the demo scene has no command `generate`; its manual page is a file.
    assert!(repository("examples/demo-scene/lodestream-demo-scene.1").exists());
    expected.push("share/man/man1/lodestream-demo-scene.1".to_owned());
    for name in ["lodestream-server", "lodestream-viewer", "lodestream-sim"] {
        expected.extend([
            format!("share/man/man1/{name}.1"),
            format!("share/bash-completion/completions/{name}"),
            format!("share/zsh/site-functions/_{name}"),
            format!("share/fish/vendor_completions.d/{name}.fish"),
        ]);
    }
    for name in ["server", "viewer", "sim", "examples/demo-scene"] {
        let manifest = std::fs::read_to_string(repository(name).join("Cargo.toml")).unwrap();
        let manifest: toml::Table = manifest.parse().unwrap();
        expected.push(format!("bin/{}", manifest["package"]["name"].as_str().unwrap()));
    }
    for name in ["README.md", "LICENSE-APACHE", "LICENSE-MIT"] {
        assert!(repository(name).exists(), "{name}");
        expected.push(format!("share/doc/lodestream/{name}"));
    }
    for name in ["server.toml", "grafana-dashboard.json"] {
        shipped(name);
        expected.push(format!("share/doc/lodestream/{name}"));
    }
    expected.push("share/doc/lodestream/THIRD-PARTY-LICENSES.txt".to_owned());
    expected.push("share/lodestream/web/index.html".to_owned());
    let below = |folder: &str| -> BTreeSet<String> {
        expected.iter().map(|name| format!("{folder}/{name}")).collect()
    };
    assert_eq!(tarball, below(&format!("lodestream-{version}-x86_64-linux")));

    let mut expected: BTreeSet<String> = below("usr")
        .into_iter()
        .map(|name| name.replace("zsh/site-functions", "zsh/vendor-completions"))
        .map(|name| if name.contains("/man1/") { name + ".gz" } else { name })
        .collect();
    // The settings file that the unit names.
    expected.insert("etc/lodestream/server.toml".to_owned());
    expected.insert("usr/share/doc/lodestream/copyright".to_owned());
    assert_eq!(debian, expected);
}

/// Packages and image hold the page where the installed server looks for it, and none is made without.
#[test]
fn packages_and_image_hold_the_page_for_browsers() {
    let read = |name: &str| std::fs::read_to_string(repository(name)).unwrap();
    let script = read("script/package");
    let at = |line: &str| script.find(line).unwrap_or_else(|| panic!("script/package lacks {line}"));
    // Built or renewed before it is copied, and a failure ends the script.
    assert!(
        at("    ensure_page || fail ") < at("    stage_prefix\n"),
        "the page is built before it is staged"
    );
    assert!(script.contains("cp \"$(target_directory)\"/web/* \"$prefix/share/lodestream/web/\""));
    at("    check_page \"$page\" || fail ");
    let function = read("script/setup.sh");
    let function = function.split("\nensure_page() {\n").nth(1).expect("script/setup.sh builds the page");
    let sources = function.split("sources=(").nth(1).unwrap().split(')').next().unwrap();
    for source in sources.split(' ') {
        assert!(repository(source).exists(), "{source}");
    }

    let image = shipped("Containerfile");
    assert_lines(&image, &["COPY --from=build /source/target/web /page", "ENV LODESTREAM_PAGE=/page"]);
    let check = image.find("RUN test -s target/web/index.html").expect("a build without the page fails");
    assert!(check < image.find("RUN cargo build").unwrap(), "it fails before it compiles");
    assert_lines(&read(".dockerignore"), &["target/*", "!target/web"]);
}

/// A page in `../share/lodestream/web` beside the program is served; without one the program says where it looked.
#[test]
fn an_installed_server_finds_its_page() {
    let folder = tempfile::tempdir().unwrap();
    let (bin, web) = (folder.path().join("bin"), folder.path().join("share/lodestream/web"));
    std::fs::create_dir_all(&bin).unwrap();
    std::fs::create_dir_all(&web).unwrap();
    let installed = bin.join("lodestream-server");
    std::fs::copy(env!("CARGO_BIN_EXE_lodestream-server"), &installed).unwrap();
    let page = "<!doctype html><script type=\"application/json\" id=\"lodestream-server\">{}</script>";
    for extension in ["", ".br", ".gz"] {
        std::fs::write(web.join(format!("index.html{extension}")), page).unwrap();
    }
    std::fs::write(folder.path().join("model.obj"), "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n").unwrap();
    let mut server = Command::new(&installed)
        .env_clear()
        .current_dir(folder.path())
        .args(["serve", "model.obj", "--listen", "127.0.0.1:0", "--http", "127.0.0.1:0", "--admin", "off"])
        .args(["--cache", "cache"])
        .env("HOME", folder.path())
        .stdout(Stdio::piped())
        .spawn()
        .unwrap();
    let lines = BufReader::new(server.stdout.take().unwrap()).lines().map_while(Result::ok);
    // Its output ends if it stops.
    let found = lines.take_while(|line| !line.is_empty()).find(|line| line.starts_with("http://"));
    server.kill().unwrap();
    server.wait().unwrap();
    assert!(found.is_some(), "the server prints the page's address");
}

/// The Debian package recommends what script/setup.sh installs for the viewer, and keeps edited settings.
#[test]
fn the_debian_package_recommends_what_the_viewer_loads() {
    let manifest = std::fs::read_to_string(repository("server/Cargo.toml")).unwrap();
    let manifest: toml::Table = manifest.parse().unwrap();
    let debian = &manifest["package"]["metadata"]["deb"];
    let recommended = debian["recommends"].as_str().unwrap();
    let setup = std::fs::read_to_string(repository("script/setup.sh")).unwrap();
    let libraries =
        setup.lines().filter(|line| line.contains("have_library lib") || line.contains("vulkan_driver ||"));
    let packages: Vec<&str> =
        libraries.filter_map(|line| line.split("missing+=(").nth(1)?.strip_suffix(')')).collect();
    assert_eq!(packages.len(), 7, "{packages:?}");
    for package in packages {
        assert!(recommended.split([',', '|', ' ']).any(|word| word == package), "{package} of {recommended}");
    }
    assert_eq!(debian["conf-files"][0].as_str(), Some("/etc/lodestream/server.toml"));
    let sources: Vec<&str> =
        debian["assets"].as_array().unwrap().iter().filter_map(|asset| asset[0].as_str()).collect();
    assert!(sources.iter().all(|source| source.starts_with("../target/package/debian/")), "{sources:?}");
}
