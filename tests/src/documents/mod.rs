//! Links, anchors, files, names of code and commands in the documents exist; lines of prose have at most 120
//! characters, no line names a path of one machine, and all documents together stay short. Scripts print their usage.
//!
//! Names are looked up in the text of the sources, so a name that is left in one comment passes. This guards against
//! moves and renames that a document did not follow.

mod check;
mod markdown;
mod quotes;
mod repository;

use repository::Repository;

/// Most words of all documents together, as `wc -w` counts them.
const MAX_WORDS: usize = 50_000;

/// Name and text of every document.
fn documents(repository: &Repository) -> Vec<(&str, String)> {
    let names = repository.files.iter().filter(|file| file.ends_with(".md"));
    let documents: Vec<_> = names
        .map(|name| (name.as_str(), std::fs::read_to_string(repository.root.join(name)).unwrap()))
        .collect();
    assert!(documents.len() >= 10, "documents are missing: {} found", documents.len());
    documents
}

#[test]
fn documents_name_only_what_exists() {
    let repository = Repository::read();
    let faults: Vec<String> = documents(&repository)
        .iter()
        .flat_map(|(name, text)| check::faults(&repository, name, text))
        .collect();
    assert!(faults.is_empty(), "{} faults in documents:\n{}", faults.len(), faults.join("\n"));
}

#[test]
fn documents_stay_short() {
    let repository = Repository::read();
    let mut words: Vec<(usize, &str)> = documents(&repository)
        .into_iter()
        .map(|(name, text)| (text.split_whitespace().count(), name))
        .collect();
    words.sort_unstable_by(|a, b| b.cmp(a));
    let total: usize = words.iter().map(|(count, _)| count).sum();
    assert!(
        total <= MAX_WORDS,
        "{total} words in all documents, at most {MAX_WORDS}; shorten some, of which these are the longest: {:?}",
        &words[..10]
    );
}

#[test]
fn programs_are_known_with_their_commands_and_flags() {
    let programs = Repository::read().programs;
    for (program, command, flag) in [
        ("lodestream-server", "terrain-import", "--max-sessions"),
        ("lodestream-server", "serve", "--position-bits"),
        ("lodestream-sim", "run", "--seed"),
        ("lodestream-sim", "frame-time", "--models"),
    ] {
        assert!(programs[program].commands.contains(command), "{program} {command}");
        assert!(programs[program].flags.contains(flag), "{program} {flag}: {:?}", programs[program].flags);
    }
    let viewer = &programs["lodestream-viewer"];
    assert!(
        viewer.commands.contains("generate") && viewer.flags.contains("--exit-when-settled"),
        "{:?}",
        viewer.flags
    );
}

/// `--help` of `script/web` once started a build of many minutes.
#[test]
fn scripts_print_their_usage_instead_of_starting() {
    let repository = Repository::read();
    let scripts = repository.files.iter().filter(|file| file.starts_with("script/"));
    let mut count = 0;
    for script in scripts {
        let path = repository.root.join(script);
        // Others are read by these.
        if !std::fs::read(&path).unwrap().starts_with(b"#!") {
            continue;
        }
        let output = std::process::Command::new(&path).arg("--help").output().unwrap();
        let said = String::from_utf8_lossy(&output.stdout);
        assert!(
            output.status.success() && said.contains(&format!("Usage: {script}")),
            "{script}: {output:?}"
        );
        count += 1;
    }
    assert!(count >= 7, "{count} scripts");
}

#[test]
fn every_kind_of_fault_is_reported() {
    let repository = Repository::read();
    let faults = |text: &str| check::faults(&repository, "docs/page.md", text);
    for (text, why) in [
        ("see [this](nowhere.md)", "links to docs/nowhere.md"),
        ("see [this](../README.md#no-such-heading)", "links to #no-such-heading"),
        ("`server/src/no_such_file.rs` does it", "does not exist"),
        ("`no_such_file.rs`", "does not exist"),
        ("`geometry/no-such-folder/`", "does not exist"),
        ("`geometry::refine::NoSuchMesh`", "NoSuchMesh occurs in no source of geometry"),
        ("`protocol::refine::SlotMap`", "SlotMap occurs in no source of protocol"),
        ("`NoSuchStruct` and `no_such_fn()`", "occurs in no source"),
        ("`lodestream-nothing`", "neither a package nor a program"),
        ("`lodestream-server serv model.obj`", "no command serv"),
        ("```sh\ntarget/release/lodestream-server serve a.obj --rat 1Mbit\n```", "no flag --rat"),
        ("```sh\nA=1 cargo run -p lodestream-sim -- \\\n  run a.toml --sed 1\n```", "no flag --sed"),
        ("`cargo bench -p lodestream-nothing --bench prepare`", "no package lodestream-nothing"),
        ("`cargo bench -p lodestream-sim --bench nothing`", "no --bench nothing"),
        ("`script/nothing --all`", "no script/nothing"),
        (&"word ".repeat(30), "characters of prose"),
        ("lies in /home/me/x", "a path of one machine"),
    ] {
        let found = faults(text);
        assert!(found.iter().any(|fault| fault.contains(why)), "{text}: {found:?}");
    }
    let good = "[a](protocol.md#frames) `protocol/src/frame.rs` `frame.rs` `protocol::frame::FrameReader` `sim/plans/*.toml`\n\
                `cargo test -p lodestream-tests wire` `std::fs::no_such_thing` `out/report.html` `model.obj` `wgpu::Device`\n\
                | `a` | a table may be as long as it likes, whatever a line of prose may be, since it cannot be broken at all |";
    assert_eq!(faults(good), [""; 0]);
}
