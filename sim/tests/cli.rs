//! Exit codes and messages of the program.

#![allow(clippy::unwrap_used, reason = "test helpers without #[test] may unwrap, as tests may")]

use std::path::Path;
use std::process::{Command, Output};

fn simulator(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_lodestream-sim")).args(arguments).output().unwrap()
}

fn write(folder: &Path, name: &str, text: &str) -> String {
    let path = folder.join(name);
    std::fs::write(&path, text).unwrap();
    path.to_str().unwrap().to_owned()
}

/// Asserts that bad input was refused: exit code 2 and one line that names `what`.
fn assert_refused(output: &Output, what: &[&str]) {
    let error = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(2), "{error}");
    assert_eq!(error.trim_end().lines().count(), 1, "{error}");
    for what in what {
        assert!(error.contains(what), "{what:?} is not in {error:?}");
    }
}

#[test]
fn measure_prints_both_directions() {
    let folder = tempfile::tempdir().unwrap();
    let low = write(folder.path(), "low.obj", "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nf 1 2 3 4\n");
    let high = write(folder.path(), "high.obj", "v 0 0 0.1\nv 1 0 0.1\nv 1 1 0.1\nv 0 1 0.1\nf 1 2 3 4\n");
    let output = simulator(&["measure", &low, &high, "--samples", "1000", "--json"]);
    assert!(output.status.success());
    let json: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    let expected = 0.1 / 2f64.sqrt();
    for value in [&json["rms"], &json["max"], &json["a_to_b"]["rms"], &json["b_to_a"]["max"]] {
        assert!((value.as_f64().unwrap() - expected).abs() < 1e-9, "{json}");
    }
    let text = simulator(&["measure", &low, &high, "--samples", "1000"]).stdout;
    let text = String::from_utf8(text).unwrap();
    assert!(text.lines().any(|line| line == "rms 7.071068e-2 (7071.068e-5)"), "{text}");
}

#[test]
fn measure_refuses_files_without_a_surface() {
    let folder = tempfile::tempdir().unwrap();
    let good = write(folder.path(), "good.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n");
    let flat = write(folder.path(), "flat.obj", "v 0 0 0\nv 1 0 0\nv 2 0 0\nf 1 2 3\n");
    assert_refused(&simulator(&["measure", &good, "missing.obj"]), &["missing.obj"]);
    assert_refused(&simulator(&["measure", &good, &flat]), &["second mesh", "area"]);
}

#[test]
fn run_refuses_plans_before_anything_is_prepared() {
    let folder = tempfile::tempdir().unwrap();
    let output = folder.path().join("out");
    let run = |plan: &str| simulator(&["run", plan, "-o", output.to_str().unwrap()]);
    let lossy = write(
        folder.path(),
        "lossy.toml",
        "scene = \"demo\"\n[[sweep]]\ntransport = \"ws\"\nrate_bits_per_s = [2_000_000]\nrtt_ms = [50]\nloss = [0.01]\n",
    );
    assert_refused(&run(&lossy), &["lossy.toml", "sweep[0].loss[0]", "not modelled"]);
    let typo = write(folder.path(), "typo.toml", "scene = \"demo\"\nsweeps = 1\n");
    assert_refused(&run(&typo), &["typo.toml", "line 2", "sweeps"]);
    let missing = write(
        folder.path(),
        "missing.toml",
        "scene = \"none.toml\"\n[[sweep]]\ntransport = \"ws\"\nrate_bits_per_s = [2_000_000]\nrtt_ms = [50]\n",
    );
    assert_refused(&run(&missing), &["none.toml"]);
    assert!(!output.exists());
}

#[test]
fn frame_time_and_terrain_table_refuse_invalid_arguments() {
    let plan = Path::new(env!("CARGO_MANIFEST_DIR")).join("plans/none.toml");
    assert_refused(&simulator(&["frame-time", plan.to_str().unwrap()]), &["none.toml"]);
    let targets = vec!["1"; 17].join(",");
    let output = simulator(&["frame-time", plan.to_str().unwrap(), "--target-px", &targets]);
    assert_refused(&output, &["17 targets", "16 are the most"]);
    assert_eq!(simulator(&["frame-time", "a.toml", "--target-px", "0"]).status.code(), Some(2));
    assert_eq!(simulator(&["terrain-table", "--generations", "0"]).status.code(), Some(2));
    let output = simulator(&["terrain-table", "--generations", "1", "--json"]);
    let json: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!((json["times"].as_array().unwrap().len(), json["bytes"].as_array().unwrap().len()), (12, 6));
}

#[test]
fn normals_and_models_refuse_invalid_arguments() {
    let folder = tempfile::tempdir().unwrap();
    let square = write(
        folder.path(),
        "square.obj",
        "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nvn 0 1 0\nf 1//1 2//1 3//1 4//1\n",
    );
    let said = simulator(&["normals", &square, "--tolerances", "89,91"]).stdout;
    let expected = "square.obj, 89°: 4 of 4 wedges send their normal, 100.0 %\n\
                    square.obj, 91°: 0 of 4 wedges send their normal, 0.0 %\n";
    assert_eq!(String::from_utf8(said).unwrap(), expected);
    for command in ["normals", "models"] {
        assert_refused(&simulator(&[command, "no/model.obj"]), &["no/model.obj"]);
        assert_eq!(simulator(&[command]).status.code(), Some(2));
    }
    for degrees in ["-1", "181", "nan", "flat"] {
        assert_eq!(
            simulator(&["normals", &square, &format!("--tolerances={degrees}")]).status.code(),
            Some(2)
        );
    }
    assert_eq!(simulator(&["normals", &square, "--position-bits", "25"]).status.code(), Some(2));
}

#[test]
fn run_names_missing_models_and_peers() {
    let folder = tempfile::tempdir().unwrap();
    let output = folder.path().join("out");
    let link = "[[sweep]]\ntransport = \"ws\"\nrate_bits_per_s = 2_000_000\nrtt_ms = 50\n";
    let plan = write(folder.path(), "model.toml", &format!("scene = \"model:none.obj\"\n{link}"));
    let run = |options: &[&str]| {
        simulator(&[&["run", &plan, "-o", output.to_str().unwrap(), "--quiet"], options].concat())
    };
    let unknown = Command::new(env!("CARGO_BIN_EXE_lodestream-sim"))
        .args(["run", &plan, "-o", output.to_str().unwrap()])
        .env_remove("LODESTREAM_MODELS")
        .output()
        .unwrap();
    assert_refused(&unknown, &["none.obj", "--models DIR"]);
    assert_refused(&run(&["--models", folder.path().to_str().unwrap()]), &["none.obj"]);
    let peers = write(folder.path(), "peers.json", "[{\"peer\": 3}]");
    assert_refused(&run(&["--peers", &peers]), &["peers.json", "line 1", "expected a string"]);
    assert_refused(&run(&["--draco-encoder", "no/encoder"]), &["no/encoder", "no such program"]);
    assert!(!output.exists());
}

/// The message about missing models names `--models`, so `truth` must accept that flag.
#[test]
fn truth_takes_the_folder_of_models_that_its_message_names() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    write(folder.path(), "square.obj", "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nf 1 2 3 4\n");
    let plan = write(
        folder.path(),
        "square.toml",
        "scene = \"model:square.obj\"\n[[sweep]]\ntransport = \"ws\"\nrate_bits_per_s = 2_000_000\nrtt_ms = 10\n",
    );
    let truth = |options: &[&str]| {
        let (output, cache) = (at("out"), at("cache"));
        let arguments =
            [&["truth", &plan, "--repeats", "1", "-o", &output, "--cache", &cache], options].concat();
        let mut command = Command::new(env!("CARGO_BIN_EXE_lodestream-sim"));
        command.args(arguments).env_remove("LODESTREAM_MODELS").output().unwrap()
    };
    assert_refused(&truth(&[]), &["square.obj", "--models DIR"]);
    let peers = write(folder.path(), "peers.json", "[{\"peer\": 3}]");
    assert_refused(&truth(&["--peers", &peers]), &["peers.json", "line 1"]);
    let done = truth(&["--models", folder.path().to_str().unwrap()]);
    assert!(done.status.success(), "{done:?}");
    let json: serde_json::Value =
        serde_json::from_str(&std::fs::read_to_string(at("out/truth.json")).unwrap()).unwrap();
    assert_eq!((json.as_array().unwrap().len(), &json[0]["repeats"]), (1, &1.into()));
}

/// Rows that cannot be reproduced on this machine do not count as different.
#[test]
fn reproduce_leaves_out_rows_that_need_the_file_of_peers() {
    let folder = tempfile::tempdir().unwrap();
    let plan = write(
        folder.path(),
        "plan.toml",
        "scene = \"empty\"\n[[sweep]]\ntransport = \"ws\"\nrate_bits_per_s = 2_000_000\nrtt_ms = 50\n\
         technique = [\"nodes\", \"lodestream\"]\n",
    );
    let sections = write(
        folder.path(),
        "sections.toml",
        &format!(
            "[[section]]\nname = \"others\"\ntitle = \"t\"\nseconds = 1\n\
             columns = [\"technique\", \"total_bytes\", \"ended\"]\n\
             [[section.command]]\nrun = \"run {plan} --quiet -o {{out}}\"\nfile = \"results.csv\"\n"
        ),
    );
    let page = write(folder.path(), "page.md", "# Figures\n");
    let output = folder.path().join("out");
    let reproduce = |extra: &[&str]| {
        let output = output.to_str().unwrap();
        let all =
            [&["reproduce", "--sections", &sections, "--document", &page, "-o", output], extra].concat();
        let mut command = Command::new(env!("CARGO_BIN_EXE_lodestream-sim"));
        command.args(all).env_remove("LODESTREAM_PEERS").env_remove("LODESTREAM_MODELS").output().unwrap()
    };
    let peers = Path::new(env!("CARGO_MANIFEST_DIR")).join("peers/example.json");
    assert!(reproduce(&["--peers", peers.to_str().unwrap(), "--update"]).status.success());
    let csv = folder.path().join("others.csv");
    let committed = std::fs::read_to_string(&csv).unwrap();
    assert_eq!(committed.matches("nodes: example").count(), 2, "{committed}");
    for extra in [&[][..], &["--update"]] {
        let again = reproduce(extra);
        let text = String::from_utf8(again.stdout).unwrap();
        assert!(again.status.success(), "{text}");
        assert!(
            text.contains("left out: 2 rows of nodes: not run: no file of peers is named (--peers FILE)"),
            "{text}"
        );
        assert_eq!(std::fs::read_to_string(&csv).unwrap(), committed);
    }
    // Rows that can be reproduced are compared nevertheless.
    std::fs::write(&csv, committed.replace(",settled", ",never")).unwrap();
    assert_eq!(reproduce(&[]).status.code(), Some(1));
}

#[test]
fn the_older_systems_table_has_a_line_for_each_way_of_sending() {
    let text = String::from_utf8(simulator(&["seed-table"]).stdout).unwrap();
    for line in
        ["| stone | 902 | JSON | ", "| padlock | 298 | pack, whole | ", "| vase | 950 | JSON, gzip | "]
    {
        assert!(text.contains(line), "{text}");
    }
    let json = simulator(&["seed-table", "--json"]).stdout;
    let json: serde_json::Value = serde_json::from_slice(&json).unwrap();
    assert_eq!(json[1]["triangles"], 298);
}

#[test]
fn a_plan_with_pictures_needs_a_graphics_adapter_and_says_so() {
    let folder = tempfile::tempdir().unwrap();
    let output = folder.path().join("out");
    let text = "scene = \"empty\"\n[pictures]\n[[sweep]]\ntransport = \"ws\"\nrate_bits_per_s = 2_000_000\nrtt_ms = 50\n";
    let run = |text: &str| {
        let plan = write(folder.path(), "plan.toml", text);
        let mut command = Command::new(env!("CARGO_BIN_EXE_lodestream-sim"));
        // A back end that is not compiled in, so that no adapter is found.
        command.args(["run", &plan, "--quiet", "-o", output.to_str().unwrap()]).env("WGPU_BACKEND", "gl");
        command.output().unwrap()
    };
    assert_refused(&run(text), &["[pictures]", "no graphics adapter", "mesa-vulkan-drivers"]);
    assert!(!output.exists());
    assert!(run(&text.replace("[pictures]\n", "")).status.success());
    assert!(output.join("report.html").exists() && !output.join("pictures").exists());
}

#[test]
fn run_writes_the_same_report_on_any_number_of_threads_and_replays_a_seed() {
    let folder = tempfile::tempdir().unwrap();
    let plan = write(
        folder.path(),
        "plan.toml",
        "scene = \"empty\"\nseeds = 4\n[[sweep]]\ntransport = [\"quic\", \"ws\"]\nrate_bits_per_s = 2_000_000\nrtt_ms = 50\njitter_ms = 9\n",
    );
    let run = |name: &str, options: &[&str]| {
        let output = folder.path().join(name);
        let arguments = [&["run", &plan, "-o", output.to_str().unwrap()], options].concat();
        let done = simulator(&arguments);
        assert!(done.status.success(), "{done:?}");
        let read = |file: &str| std::fs::read_to_string(output.join(file)).unwrap();
        (String::from_utf8(done.stdout).unwrap(), read("results.json"), read("results.csv"))
    };
    let one = run("one", &["--threads", "1"]);
    assert_eq!(one.0.lines().count(), 8);
    assert_eq!(one.2.lines().count(), 9);
    assert_eq!(run("three", &["--threads", "3"]), one);
    let (said, alone, _) = run("alone", &["--seed", "3", "--quiet"]);
    assert_eq!(said, "");
    let lines: Vec<&str> = alone.lines().filter(|line| line.starts_with('{')).collect();
    assert_eq!(lines.len(), 2);
    for line in lines {
        assert!(one.1.contains(line.trim_end_matches(',')), "{line}");
    }
}

#[test]
fn assess_takes_the_size_of_the_top_and_refuses_what_is_out_of_range() {
    use std::fmt::Write as _;
    let folder = tempfile::tempdir().unwrap();
    let mut wavy = String::new();
    for y in 0..30 {
        for x in 0..30 {
            writeln!(wavy, "v {x} {y} {}", (x * 7 + y * 5) % 4).unwrap();
        }
    }
    for i in (1..870).filter(|i| i % 30 != 0) {
        writeln!(wavy, "f {i} {} {} {}", i + 1, i + 31, i + 30).unwrap();
    }
    let model = write(folder.path(), "wavy.obj", &wavy);
    let assess = |top: &str| {
        let options = ["--random-sets", "0", "--samples", "1000", "--region-faces", "100", "--json"];
        simulator(&[&["assess", &model, "--top-regions", top], &options[..]].concat())
    };
    let levels = |top| {
        let json: serde_json::Value = serde_json::from_slice(&assess(top).stdout).unwrap();
        json["levels"].as_u64().unwrap()
    };
    assert_eq!(levels("16"), 2);
    assert!(levels("0.25") > 2);
    for top in ["0.2", "17", "nan", "many"] {
        let output = assess(top);
        assert_eq!(output.status.code(), Some(2), "{top}");
        let error = String::from_utf8_lossy(&output.stderr);
        assert!(error.contains("--top-regions") && error.contains("0.25 to 16"), "{error}");
    }
    for share in ["-0.1", "4.1", "nan", "fine"] {
        let output = simulator(&["assess", &model, &format!("--coarse-grid={share}")]);
        assert_eq!(output.status.code(), Some(2), "{share}");
        let error = String::from_utf8_lossy(&output.stderr);
        assert!(error.contains("--coarse-grid") && error.contains("0 to 4"), "{error}");
    }
    for faces in ["99", "100000001", "-1", "all"] {
        let output = simulator(&["assess", &model, &format!("--block-faces={faces}")]);
        assert_eq!(output.status.code(), Some(2), "{faces}");
        let error = String::from_utf8_lossy(&output.stderr);
        assert!(error.contains("--block-faces") && error.contains("100 to 100000000"), "{error}");
    }
}

#[test]
fn reproduce_agrees_with_its_own_output_and_names_differences() {
    let folder = tempfile::tempdir().unwrap();
    let sections = write(
        folder.path(),
        "sections.toml",
        "[[section]]\nname = \"older\"\ntitle = \"t\"\nseconds = 1\ncolumns = [\"model\", \"triangles\"]\n\
         [[section.command]]\nrun = \"seed-table --json\"\n\
         [[section]]\nname = \"scan\"\ntitle = \"t\"\nseconds = 1\ncolumns = [\"faces\"]\n\
         [[section.command]]\nrun = \"assess {models}/none.obj --json\"\n\
         [[section.table]]\nid = \"scan\"\ncolumns = []\n",
    );
    let text = std::fs::read_to_string(&sections).unwrap().replacen(
        "[[section]]\nname = \"scan\"",
        "[[section.table]]\nid = \"older\"\ncolumns = [[\"model\", \"{model}\"], [\"faces\", \"{triangles:,}\"]]\n\
         [[section]]\nname = \"scan\"",
        1,
    );
    std::fs::write(&sections, text).unwrap();
    let document = write(folder.path(), "figures.md", "# Figures\n\n<!-- table: older -->\n\nEnd.\n");
    let output = folder.path().join("out");
    let reproduce = |extra: &[&str]| {
        let output = output.to_str().unwrap();
        let all =
            [&["reproduce", "--sections", &sections, "--document", &document, "-o", output], extra].concat();
        let mut command = Command::new(env!("CARGO_BIN_EXE_lodestream-sim"));
        command.args(all).env_remove("LODESTREAM_MODELS").output().unwrap()
    };
    assert_refused(&reproduce(&[]), &["older.csv", "--update"]);
    assert!(reproduce(&["--update"]).status.success());
    let written = std::fs::read_to_string(&document).unwrap();
    assert!(written.contains("<!-- table: older -->\n| model | faces |\n|---|---|\n"), "{written}");
    assert!(written.contains("| 902 |\n") && written.ends_with("\n\nEnd.\n"), "{written}");
    let again = reproduce(&[]);
    let text = String::from_utf8(again.stdout).unwrap();
    assert!(
        again.status.success() && text.contains("as committed") && text.contains("scan: left out"),
        "{text}"
    );
    assert!(output.join("reproduction.json").exists());
    let page = std::fs::read_to_string(output.join("reproduction.html")).unwrap();
    assert!(page.contains("padlock") && page.contains("Not run: its models are not here"), "{page}");
    // Independent of the run time.
    assert!(reproduce(&[]).status.success());
    assert_eq!(std::fs::read_to_string(output.join("reproduction.html")).unwrap(), page);
    // A figure and the table were changed by hand.
    let csv = folder.path().join("older.csv");
    let changed = std::fs::read_to_string(&csv).unwrap().replace("902", "903");
    std::fs::write(&csv, changed).unwrap();
    let differs = reproduce(&["older"]);
    let text = String::from_utf8(differs.stdout).unwrap();
    assert_eq!(differs.status.code(), Some(1), "{text}");
    assert!(text.contains("triangles: 902 instead of 903") && text.contains("table older"), "{text}");
    // Tables follow the committed figures, even if these were edited by hand.
    assert!(reproduce(&["older", "--tables"]).status.success());
    assert!(std::fs::read_to_string(&document).unwrap().contains("| stone | 903 |"));
    assert_refused(&reproduce(&["newer"]), &["no section is called newer", "older, scan"]);
}

/// 30 of the ten thousand cases of each subject, run as for the table: the daemon in a separate process, both
/// transports, and a client behind its socket.
#[test]
fn damaged_packs_sessions_and_flights_cause_no_panic() {
    const CASES: u64 = 30;
    let folder = tempfile::tempdir().unwrap();
    let cache = folder.path().to_str().unwrap();
    let output = simulator(&["mutate", "--count", "30", "--seed", "7", "--json", "--cache", cache]);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let found: Vec<serde_json::Value> = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(found.len(), 6);
    for subject in &found {
        let count = |name: &str| subject[name].as_u64().unwrap();
        assert_eq!((count("tried"), count("panics"), count("stuck")), (CASES, 0, 0), "{subject}");
        assert_eq!(count("taken") + count("refused"), CASES, "{subject}");
        assert!(count("refused") > 0, "{subject}");
        // A client that cannot connect would count as refused without having sent anything.
        assert!(!subject["reasons"].as_str().unwrap().contains("no connection"), "{subject}");
        let hashed = subject["subject"] == "packs";
        assert!(hashed || count("taken") > 0, "{subject}");
    }
    assert_refused(&simulator(&["mutate", "--only", "dragons", "--cache", cache]), &["dragons"]);
}
