//! Tests: reports of whole runs over the small demo scene.

use std::num::NonZeroUsize;
use std::path::Path;

use lodestream_scenario::baseline::Library;
use lodestream_scenario::draco::Encoder;
use lodestream_scenario::plan::{self, Plan, Transport};
use lodestream_scenario::result::to_json;
use lodestream_scenario::testing::{parse, results_of, small_scene};
use lodestream_scenario::truth::{Comparison, Difference, figures};
use lodestream_scenario::{Equipment, run, run_with};

use crate::reproduce::Rows;
use crate::{levels, write};

const TECHNIQUES: &str =
    "technique = [\"lodestream\", \"nodes\", \"chain\", \"obj\", \"obj-gzip\", \"draco\", \"seed-json\"]";

#[test]
fn reports_do_not_depend_on_threads_and_one_seed_replays_its_run() {
    // Everything random at once: loss, bursts, jitter that changes the order, endpoints.
    let text = "scene = \"demo-small\"\nviewport_px = [320, 180]\nseeds = 3\n\
                [link.rough]\ndown = { rate_bits_per_s = 1_000_000, delay_ms = 20, jitter_ms = 15, reorder = true, \
                burst_loss = { to_bad = 0.02, to_good = 0.3 } }\n\
                [[sweep]]\ntransport = \"quic\"\nlink = \"rough\"\ncamera = [\"still\", \"teleport\"]\n\
                [[sweep]]\ntransport = [\"quic\", \"ws\"]\nrate_bits_per_s = 2_000_000\nrtt_ms = 50\njitter_ms = 10\n";
    let plan = plan::parse(text, Path::new("test.toml")).unwrap();
    let run_on = |threads: usize| {
        let mut told = Vec::new();
        let results = run(&plan, &[small_scene()], NonZeroUsize::new(threads).unwrap(), |result| {
            told.push((result.link.clone(), result.transport, result.camera.clone(), result.seed));
        });
        let results = results.unwrap();
        let folder = tempfile::tempdir().unwrap();
        write(folder.path(), &plan, &results).unwrap();
        let files = ["results.json", "results.csv"].map(|f| std::fs::read(folder.path().join(f)).unwrap());
        (told, files, results)
    };
    let (told, files, results) = run_on(1);
    let seeds: Vec<u64> = told.iter().map(|told| told.3).collect();
    assert_eq!(seeds, [1, 2, 3, 1, 2, 3, 1, 2, 3, 1, 2, 3]);
    for threads in [2, 5] {
        let (told_then, files_then, _) = run_on(threads);
        assert!(told == told_then && files == files_then, "{threads} threads");
    }
    // Seeds differ, and each alone gives the same run again.
    let traces: std::collections::BTreeSet<&str> =
        results.iter().map(|result| result.trace.as_str()).collect();
    assert_eq!(traces.len(), results.len(), "{traces:?}");
    for seed in [2, 3] {
        let alone = results_of(&plan.clone().with_seed(seed));
        let of_seed: Vec<_> = results.iter().filter(|result| result.seed == seed).cloned().collect();
        assert_eq!(alone, of_seed);
    }
}

#[test]
fn percentiles_are_given_for_thirty_seeds_and_not_for_fewer() {
    let sweep = |seeds: u32| {
        let sweep = "transport = \"quic\"\nrate_bits_per_s = 16_000_000\nrtt_ms = 20\nloss = 0.05";
        parse("ttq_px = [16]", &format!("{sweep}\nseeds = {seeds}"))
    };
    let folder = tempfile::tempdir().unwrap();
    let plan = sweep(30);
    let results = results_of(&plan);
    write(folder.path(), &plan, &results).unwrap();
    let text = |name: &str| std::fs::read_to_string(folder.path().join(name)).unwrap();
    let json: serde_json::Value = serde_json::from_str(&text("percentiles.json")).unwrap();
    assert_eq!((&json[0]["seeds"], json.as_array().unwrap().len()), (&30.into(), 1));
    let mut times: Vec<f64> = results.iter().map(|result| result.ttff_ms.unwrap()).collect();
    times.sort_by(f64::total_cmp);
    assert!(times[0] < times[29], "loss changes nothing: {times:?}");
    for (name, rank) in [("p50", 15), ("p90", 27), ("p99", 30)] {
        assert_eq!(json[0]["figures"]["ttff_ms"][name].as_f64(), Some(times[rank - 1]), "{name}");
    }
    assert_eq!(text("percentiles.csv").lines().count(), 2);
    assert!(text("report.html").contains("where seen, TTQ(16 px) p50 / p90 / p99"));
    assert!(text("percentiles.svg").contains(">\nTTQ(16 px), where seen\n<"));
    // As many lines as runs, and as many fields as names.
    let csv = text("results.csv");
    let fields = |line: &str| line.replace("\"16 Mbit/s, RTT 20 ms, loss 5 %\"", "link").matches(',').count();
    let names = fields(csv.lines().next().unwrap());
    assert!(csv.lines().all(|line| fields(line) == names), "{csv}");
    assert_eq!(csv.lines().count(), 31);

    let fewer = sweep(29);
    write(folder.path(), &fewer, &results_of(&fewer)).unwrap();
    assert!(
        !folder.path().join("percentiles.json").exists() && !folder.path().join("percentiles.csv").exists()
    );
}
/// An encoder whose files are a twentieth of the text's length.
#[cfg(unix)]
fn encoder(folder: &Path) -> Encoder {
    use std::os::unix::fs::PermissionsExt as _;
    let path = folder.join("draco_encoder");
    std::fs::write(&path, "#!/bin/sh\nhead -c $(( $(wc -c < \"$2\") / 20 + 9 )) /dev/zero > \"$4\"\n")
        .unwrap();
    std::fs::set_permissions(&path, std::fs::Permissions::from_mode(0o755)).unwrap();
    Encoder::at(&path).unwrap()
}

#[test]
#[cfg(unix)]
fn reports_do_not_depend_on_threads_and_levels_end_where_the_view_is_sharp() {
    let folder = tempfile::tempdir().unwrap();
    let sweep = "transport = \"quic\"\nrate_bits_per_s = 2_000_000\nrtt_ms = 50\nloss = 0.01\nseeds = 2\n\
                 camera = [\"still\", \"orbit\"]\n";
    let plan = Plan {
        draco: Some(encoder(folder.path())),
        ..parse("time_limit_s = 60", &format!("{sweep}{TECHNIQUES}"))
    };
    let scenes = [small_scene()];
    let library = Library::prepare(&plan, &scenes, |_| {}).unwrap();
    let on = |threads| {
        let threads = NonZeroUsize::new(threads).unwrap();
        run_with(&plan, &scenes, Equipment { library: &library, gallery: None }, threads, |_| {}).unwrap()
    };
    let results = on(1);
    let bytes = to_json(&results).unwrap();
    assert!(bytes == to_json(&on(3)).unwrap());
    // The same when measured again.
    assert!(bytes == to_json(&run(&plan, &scenes, NonZeroUsize::MIN, |_| {}).unwrap()).unwrap());
    let of = |technique: &str, camera: &str| {
        let found = results.iter().find(|r| r.technique == technique && r.camera == camera && r.seed == 1);
        found.unwrap().clone()
    };
    let (chain, whole) = (of("chain", "still"), of("draco", "still"));
    assert_eq!((chain.ended.as_str(), whole.ended.as_str()), ("settled", "settled"));
    assert!(chain.ttff_ms < whole.ttff_ms, "{chain}, {whole}");
    // The last level of the chain is the one that its run recorded as sharp; every technique is compared at each.
    let levels = levels::of_plan(&plan, &results);
    let last = levels.iter().rfind(|level| level.technique == "chain" && level.seed == 1).unwrap();
    assert!(last.error_px <= 1.0, "{last:?}");
    assert_eq!((last.ms, last.bytes), (chain.ttq_ms["1"], chain.ttq_bytes["1"]));
    assert!(levels.len() > 2 * 7 && levels.len().is_multiple_of(7), "{}", levels.len());
    write(folder.path(), &plan, &results).unwrap();
    // Baselines do not know occlusion, so these cells are empty.
    assert!(!chain.to_string().contains("where seen"), "{chain}");
    assert!(chain.series.iter().all(|sample| sample.unoccluded_error_px.is_none()), "{chain:?}");
    let csv = std::fs::read_to_string(folder.path().join("levels.csv")).unwrap();
    assert_eq!(csv.lines().count(), 1 + levels.len());
    // A lap sees more, comes to rest, and reaches its quality there.
    let lap = of("chain", "orbit");
    assert!(lap.ended == "settled" && lap.rest_ttq_ms["1"].is_some(), "{lap:?}");
    assert!(lap.usage.chunk_bytes > chain.usage.chunk_bytes, "{lap:?}");
    // Whole files arrive before the lap, which then shows only more of the textures.
    let (still, lap) = (of("obj", "still"), of("obj", "orbit"));
    assert_eq!((still.ttff_ms, lap.rest_ttq_ms["1"]), (lap.ttff_ms, Some(0.0)), "{lap:?}");
    assert!(lap.usage.chunk_bytes > still.usage.chunk_bytes, "{lap:?}");
}

#[test]
fn each_figure_of_each_case_is_a_row() {
    let difference = |figure: &str, virtual_ms: f64, real_ms: Option<f64>| Difference {
        figure: figure.to_owned(),
        virtual_ms: Some(virtual_ms),
        real_ms,
        real_least_ms: real_ms,
        real_greatest_ms: real_ms,
        difference_ms: None,
        difference_share: None,
    };
    let case = |link: &str, ms: f64| Comparison {
        scene: "demo".to_owned(),
        transport: Transport::Ws,
        link: link.to_owned(),
        camera: "still".to_owned(),
        seed: 1,
        repeats: 5,
        virtual_bytes: 100,
        real_bytes: 101,
        differences: vec![difference("ttff", ms, Some(ms + 1.5)), difference("ttq 1 px", ms * 2.0, None)],
    };
    let compared = [case("slow", 170.0), case("fast", 20.0)];
    let rows = Rows::from_json(&serde_json::to_string(&figures(&compared)).unwrap()).unwrap();
    let cell = |row: usize, name: &str| rows.rows[row][rows.column(name).unwrap()].as_str();
    assert_eq!(rows.rows.len(), 4);
    let names = ["transport", "link", "figure", "virtual_ms", "real_ms", "real_bytes"];
    assert_eq!(names.map(|name| cell(2, name)), ["ws", "fast", "ttff", "20.0", "21.5", "101"]);
    assert_eq!(names.map(|name| cell(3, name)), ["ws", "fast", "ttq 1 px", "40.0", "", "101"]);
}
