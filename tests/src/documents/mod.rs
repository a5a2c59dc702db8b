//! What the documents say of the repository is there: links and their anchors, files, names of code, commands with their
//! flags. And they can be read: no line of prose is longer than 120 characters, and none names a path of one machine.
//!
//! Names are looked up in the text of the sources, so a name that is left in one comment passes; what this guards against is
//! that something was moved or renamed and a document was forgotten.

mod check;
mod markdown;
mod quotes;
mod repository;

use repository::Repository;

#[test]
fn what_the_documents_name_is_there() {
    let repository = Repository::read();
    let documents: Vec<_> = repository.files.iter().filter(|file| file.ends_with(".md")).collect();
    assert!(documents.len() >= 10, "documents are missing: {documents:?}");
    let mut found = Vec::new();
    for name in documents {
        let text = std::fs::read_to_string(repository.root.join(name)).unwrap();
        found.extend(check::document(&repository, name, &text));
    }
    assert!(found.is_empty(), "{} faults in documents:\n{}", found.len(), found.join("\n"));
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

/// Each line of a document that is wrong is found, for what it is.
#[test]
fn what_is_not_there_is_found() {
    let repository = Repository::read();
    let faults = |text: &str| check::document(&repository, "docs/page.md", text);
    for (text, why) in [
        ("see [this](nowhere.md)", "links to docs/nowhere.md"),
        ("see [this](../README.md#no-such-heading)", "links to #no-such-heading"),
        ("`server/src/no_such_file.rs` does it", "is not there"),
        ("`no_such_file.rs`", "is not there"),
        ("`geometry/no-such-folder/`", "is not there"),
        ("`geometry::refine::NoSuchMesh`", "NoSuchMesh stands in no source of geometry"),
        ("`protocol::refine::SlotMap`", "SlotMap stands in no source of protocol"),
        ("`NoSuchStruct` and `no_such_fn()`", "stands in no source"),
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
