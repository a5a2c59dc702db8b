//! Tests of plans: expansion and error messages.

use lodestream_geometry::Codec;
use lodestream_netsim::link::{AtEnd, GilbertElliott, Jitter, LinkSettings, Loss, Rate};

use super::sweep::MAX_RUNS;
use super::*;
use crate::camera_path::{CameraPath, Motion, Start};

const GOOD: &str = "scene = \"demo\"\n[[sweep]]\ntransport = \"quic\"\n\
                    rate_bits_per_s = [2_000_000, 8_000_000]\nrtt_ms = [50]\nloss = [0, 0.01]\n";

fn parse_at(text: &str) -> Result<Plan, PlanError> {
    parse(text, Path::new("plans/test.toml"))
}

#[test]
fn sweeps_expand_in_order() {
    let plan = parse_at(GOOD).unwrap();
    let found: Vec<_> =
        plan.cases.iter().map(|c| (c.link.down.rate.first(), c.link.down.loss.long_run())).collect();
    assert_eq!(found, [(2_000_000, 0.0), (2_000_000, 0.01), (8_000_000, 0.0), (8_000_000, 0.01)]);
    let first = &plan.cases[0];
    assert_eq!(
        (first.link.down.delay_ns, first.link.up.delay_ns, first.rtt_ms()),
        (25_000_000, 25_000_000, 50.0)
    );
    assert_eq!(first.to_string(), "quic, 2 Mbit/s, RTT 50 ms, loss 0 %");
    assert_eq!(plan.cases[1].link.name, "2 Mbit/s, RTT 50 ms, loss 1 %");
    assert_eq!((plan.viewport_px, plan.ttq_px), ([1280, 720], vec![1.0, 4.0, 16.0]));
    assert_eq!((first.path, &first.seeds[..], first.time_limit_s), (CameraPath::STILL, &[1][..], 600.0));
}

#[test]
fn the_documented_plan_parses() {
    let toml: Vec<&str> = include_str!("mod.rs")
        .lines()
        .map(|line| line.trim_start_matches("//!"))
        .skip_while(|line| *line != " ```toml")
        .skip(1)
        .take_while(|line| *line != " ```")
        .collect();
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("train.txt"), "4\n0\n1.5\n").unwrap();
    let plan = parse(&toml.join("\n"), &folder.path().join("plan.toml")).unwrap();
    // Four rates with and without loss, anew and resumed; the train seen by two cameras by two techniques, thirty times
    // each.
    assert_eq!((plan.cases.len(), plan.runs()), (2 * 4 * 2 + 4, 2 * 4 * 2 + 120));
    assert_eq!(plan.cases.iter().map(|case| case.resumed).position(|resumed| resumed), Some(8));
    let train = &plan.cases[17].link;
    assert_eq!(train.down.rate, Rate::trace(&[4_000_000, 0, 1_500_000], AtEnd::Repeat).unwrap());
    assert_eq!((train.up.rate.first(), train.up.jitter), (500_000, train.down.jitter));
}

#[test]
fn scene_files_are_relative_to_the_plan() {
    let plan = parse_at(&GOOD.replace("demo", "../scenes/a.toml")).unwrap();
    assert_eq!(plan.scenes[0].choice, SceneChoice::File("plans/../scenes/a.toml".into()));
    let published = |name| parse_at(&GOOD.replace("demo", name)).unwrap().scenes[0].choice.clone();
    assert_eq!(published("a.lss"), SceneChoice::Published("plans/a.lss".into()));
    for url in ["file:/b/a.lss", "https://host/b/a.lss"] {
        assert_eq!(published(url), SceneChoice::Published(url.into()));
    }
}

#[test]
fn the_projects_own_plans_parse() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../plans");
    let mut count = 0;
    for file in std::fs::read_dir(folder).unwrap() {
        let path = file.unwrap().path();
        if path.extension().is_some_and(|e| e == "toml") {
            read(&path).unwrap();
            count += 1;
        }
    }
    assert!(count >= 7, "{count}");
}

#[test]
fn techniques_change_fastest_and_nodes_stand_for_each_peer() {
    let text = GOOD.replace("loss = [0, 0.01]", "technique = [\"lodestream\", \"nodes\", \"obj-gzip\"]");
    let plan = parse_at(&text).unwrap();
    let names = |plan: &Plan| plan.cases.iter().map(|c| plan.technique_name(c)).collect::<Vec<_>>();
    assert_eq!(names(&plan), ["lodestream", "nodes", "obj-gzip"].repeat(2));
    assert_eq!(plan.cases[2].to_string(), "obj-gzip over quic, 2 Mbit/s, RTT 50 ms, loss 0 %");
    let example = Path::new(env!("CARGO_MANIFEST_DIR")).join("../peers/example.json");
    let peers = crate::peers::read(&example).unwrap();
    let with = plan.with_peers(peers.clone());
    let nodes = peers.iter().map(|peer| format!("nodes: {}", peer.name));
    let expected: Vec<String> =
        ["lodestream".into()].into_iter().chain(nodes).chain(["obj-gzip".into()]).collect();
    let expected = [expected.clone(), expected].concat();
    assert_eq!(names(&with), expected);
    assert_eq!(names(&with.with_peers(peers)), expected, "and only once");
    // A plan may name the file itself, relative to its own.
    let named = parse(&format!("peers = \"example.json\"\n{text}"), &example).unwrap();
    assert_eq!((named.peers.len(), named.cases.len()), (2, 8));
}

#[test]
fn models_are_files_of_a_folder_that_the_plan_does_not_name() {
    let text = format!("position_bits = 12\n{}", GOOD.replace("demo", "model:bunny.obj"));
    let plan = parse_at(&text).unwrap().with_models(Some(Path::new("models")));
    let folder = Some("models".into());
    let expected = SceneChoice::Model { file: "bunny.obj".into(), folder, position_bits: "12".parse().ok() };
    assert_eq!((&plan.scenes[0].choice, plan.scenes[0].name.as_str()), (&expected, "model:bunny.obj"));
    for bad in ["model:", "model:../bunny.obj", "model:/bunny.obj"] {
        let error = parse_at(&GOOD.replace("demo", bad)).unwrap_err();
        assert_eq!(
            (error.field.as_str(), error.message.contains("folder of models")),
            ("scene", true),
            "{bad}"
        );
    }
}

#[test]
fn errors_name_file_and_field() {
    let ws = GOOD.replace("\"quic\"", "\"ws\"");
    let resumed = format!("{}resumed = [false, true]\n", ws.replace("\"ws\"", "[\"quic\", \"ws\"]"));
    let cases = [
        (ws.as_str(), "sweep[0].loss[1]", "not modelled"),
        (resumed.as_str(), "sweep[0].resumed[1]", "only QUIC connections are resumed"),
        ("scene = \"demo\"", "sweep", "there is none"),
        ("scene = 3", "line 1", "expected a string"),
        ("scene = \"demo\"\nspeed = 3", "line 2", "unknown field"),
        ("scene = \"demo", "line 1", ""),
        (&GOOD.replace("[50]", "[]"), "sweep[0].rtt_ms", "is empty"),
        (&GOOD.replace("[50]", "[-1]"), "sweep[0].rtt_ms[0]", "-1"),
        (&GOOD.replace("[50]", "[nan]"), "sweep[0].rtt_ms[0]", "NaN"),
        (&GOOD.replace("8_000_000", "0"), "sweep[0].rate_bits_per_s[1]", "0 is not"),
        (&GOOD.replace("8_000_000", "-5"), "line 4", ""),
        (&format!("{GOOD}limiter_share = 0\n"), "sweep[0].limiter_share", "0 is not a share"),
        (&GOOD.replace("0.01", "1.5"), "sweep[0].loss[1]", "probability"),
        (&GOOD.replace("quic", "carrier-pigeon"), "line 3", "unknown variant"),
        (&format!("ttq_px = []\n{GOOD}"), "ttq_px", "is empty"),
        (&format!("ttq_px = [1, 0]\n{GOOD}"), "ttq_px[1]", "0 is not"),
        (&format!("viewport_px = [640, 0]\n{GOOD}"), "viewport_px[1]", "0 is not"),
        (&format!("time_limit_s = -1\n{GOOD}"), "time_limit_s", "-1 is not"),
        (&GOOD.replace("demo", "field:assets=1"), "scene", "is not a field"),
        (&format!("position_bits = 40\n{GOOD}"), "position_bits", "40 is not"),
        (&format!("peers = \"no.json\"\n{GOOD}"), "peers", "cannot be read"),
        (&format!("{GOOD}technique = []\n"), "sweep[0].technique", "is empty"),
        (&format!("{GOOD}technique = \"pigeons\"\n"), "line 7", "unknown variant"),
        (
            &format!("{GOOD}technique = [\"lodestream\", \"obj\"]\nlimiter_share = 0.9\n"),
            "sweep[0].technique[1]",
            "obj has no limiter",
        ),
    ];
    for (text, field, message) in cases {
        let error = parse_at(text).unwrap_err();
        assert_eq!(error.file, "plans/test.toml", "{text}");
        assert_eq!(error.field, field, "{text}\n{error}");
        assert!(error.message.contains(message), "{text}\n{error}");
        assert!(!error.to_string().contains('\n'), "{error}");
    }
    let missing = read(Path::new("no/plan.toml")).unwrap_err();
    assert!(missing.to_string().starts_with("no/plan.toml: file: cannot be read"), "{missing}");
}

/// A plan with a named link, whose directions hold `down` and `up`.
fn linked(down: &str, up: &str) -> String {
    format!(
        "scene = \"demo\"\n[link.l]\ndown = {{ {down} }}\n{up}\n[[sweep]]\ntransport = \"quic\"\nlink = \"l\"\n"
    )
}

#[test]
fn the_reverse_direction_of_a_link_overrides_only_what_differs() {
    let down = "rate_steps = [{ from_s = 0, bits_per_s = 2_000_000 }, { from_s = 0.5, bits_per_s = 0 }, \
                { from_s = 1, bits_per_s = 500_000 }], delay_ms = 0.25, jitter_ms = 3, reorder = true, \
                burst_loss = { to_bad = 0.01, to_good = 0.25 }, queue_bytes = 3000, mtu_bytes = 1400";
    let plan = parse_at(&linked(down, "up = { rate_bits_per_s = 1000, loss = 0.5 }")).unwrap();
    let CaseLink { name, down, up } = &plan.cases[0].link;
    assert_eq!(name, "l");
    let rate = Rate::steps(&[(0, 2_000_000), (500_000_000, 0), (1_000_000_000, 500_000)]).unwrap();
    let burst = GilbertElliott { to_bad: 0.01, to_good: 0.25, loss_good: 0.0, loss_bad: 1.0 };
    let expected = LinkSettings {
        rate,
        delay_ns: 250_000,
        jitter: Jitter { largest_ns: 3_000_000, reorders: true },
        queue_bytes: 3000,
        loss: Loss::Burst(burst),
        overhead_bytes: 0,
        mtu_bytes: 1400,
    };
    assert_eq!(*down, expected);
    let rate = Rate::constant(1000.try_into().unwrap());
    assert_eq!(*up, LinkSettings { rate, loss: Loss::Random(0.5), ..expected });
    let alike = parse_at(&linked("rate_bits_per_s = 5000", "")).unwrap();
    assert_eq!(alike.cases[0].link.down, alike.cases[0].link.up);
}

#[test]
fn traces_are_read_beside_the_plan() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("t.txt"), "2\n0.5\n").unwrap();
    let text = linked("rate_trace = { file = \"t.txt\", at_end = \"hold\" }", "");
    let plan = parse(&text, &folder.path().join("plan.toml")).unwrap();
    let expected = Rate::trace(&[2_000_000, 500_000], AtEnd::Hold).unwrap();
    assert_eq!(plan.cases[0].link.down.rate, expected);
    std::fs::write(folder.path().join("t.txt"), "2\nfast\n").unwrap();
    let error = parse(&text, &folder.path().join("plan.toml")).unwrap_err();
    assert_eq!(error.field, "link.l.down.rate_trace.file");
    assert!(error.message.contains("t.txt: line 2: \"fast\""), "{error}");
}

#[test]
fn every_axis_multiplies_and_the_last_changes_fastest() {
    let text = "scene = \"demo\"\nseeds = 2\n[[sweep]]\nscene = [\"empty\", \"demo\"]\ntransport = [\"quic\", \"ws\"]\n\
                rate_bits_per_s = { from = 1_000_000, to = 4_000_000, factor = 2 }\nrtt_ms = 50\n\
                jitter_ms = [0, 5]\nqueue_bytes = [1500, 65536]\nmtu_bytes = 1300\n\
                camera = [\"still\", \"orbit\"]\nseeds = [7, 5, 9]\nup = { rate_bits_per_s = 100_000 }\n";
    let plan = parse_at(text).unwrap();
    assert_eq!(plan.cases.len(), 2 * 2 * 3 * 2 * 2 * 2);
    assert_eq!((plan.runs(), plan.clone().with_seed(4).runs()), (96 * 3, 96));
    let names: Vec<&str> = plan.scenes.iter().map(|scene| scene.name.as_str()).collect();
    assert_eq!(names, ["empty", "demo"]);
    let [first, second, .., last] = &plan.cases[..] else { panic!() };
    assert_eq!((first.scene, first.transport, first.camera.as_str()), (0, Transport::Quic, "still"));
    assert_eq!((second.camera.as_str(), second.link == first.link), ("orbit", true));
    assert_eq!((last.scene, last.transport, last.link.down.queue_bytes), (1, Transport::Ws, 65_536));
    assert_eq!(
        (&first.seeds[..], first.link.down.mtu_bytes, first.link.up.mtu_bytes),
        (&[7, 5, 9][..], 1300, 1300)
    );
    assert_eq!(first.link.name, "1 Mbit/s, RTT 50 ms, loss 0 %, queue 1500 bytes, 0.1 Mbit/s up");
    assert_eq!((last.link.down.rate.first(), last.link.up.rate.first()), (4_000_000, 100_000));
    assert_eq!(last.link.up.jitter.largest_ns, 5_000_000);
}

#[test]
fn camera_paths_have_defaults_and_may_be_redefined() {
    let text = |camera: &str| {
        format!("{camera}\n{GOOD}camera = [\"orbit\", \"teleport\", \"swing\", \"fly-through\"]\n")
    };
    let at = |text: String| text.replacen("scene", "viewport_px = [64, 64]\nscene", 1);
    let plan = parse_at(&at(text(""))).unwrap();
    let paths: Vec<CameraPath> = plan.cases[..4].iter().map(|case| case.path).collect();
    let moving = |motion| CameraPath { motion, seconds: 12.0, start: Start::FirstFrame };
    assert_eq!(
        paths,
        [
            moving(Motion::Orbit { degrees: 360.0 }),
            CameraPath { motion: Motion::Teleport { degrees: 180.0 }, seconds: 0.0, start: Start::Settled },
            moving(Motion::Swing { degrees: 45.0, times: 2.0 }),
            moving(Motion::FlyThrough { distance: 1.5 }),
        ]
    );
    let own = "scene = \"demo\"\n[camera.orbit]\npath = \"orbit\"\nseconds = 3\ndegrees = -90\nstarts = 2.5\n[[sweep]]\n\
               transport = \"quic\"\nrate_bits_per_s = 5000\nrtt_ms = 0\ncamera = \"orbit\"\n";
    let expected = CameraPath {
        motion: Motion::Orbit { degrees: -90.0 },
        seconds: 3.0,
        start: Start::At { seconds: 2.5 },
    };
    assert_eq!(parse_at(own).unwrap().cases[0].path, expected);
}

#[test]
fn errors_of_links_cameras_and_seeds_name_what_to_do() {
    let sweep = |text: &str| format!("{GOOD}{text}\n");
    let camera = |text: &str| linked("rate_bits_per_s = 5000", &format!("[camera.c]\n{text}"));
    let ws = |down: &str| linked(down, "").replace("\"quic\"", "\"ws\"");
    let cases = [
        (linked("delay_ms = 1", ""), "link.l.down.rate_bits_per_s", "or rate_trace"),
        (
            linked("rate_bits_per_s = 5000, rate_steps = []", ""),
            "link.l.down.rate_bits_per_s",
            "more than one",
        ),
        (linked("rate_steps = []", ""), "link.l.down.rate_steps", "no rate"),
        (linked("rate_steps = [{ from_s = 0, bits_per_s = 0 }]", ""), "link.l.down.rate_steps", "stays 0"),
        (
            linked("rate_steps = [{ from_s = -1, bits_per_s = 5 }]", ""),
            "link.l.down.rate_steps[0].from_s",
            "-1",
        ),
        (
            linked("rate_trace = { file = \"none\", at_end = \"hold\" }", ""),
            "link.l.down.rate_trace.file",
            "plans/none",
        ),
        (linked("rate_trace = { file = \"none\" }", ""), "line 3", "at_end"),
        (linked("rate_bits_per_s = 5000, delay_ms = -2", ""), "link.l.down.delay_ms", "-2 is not a time"),
        (linked("rate_bits_per_s = 5000", "up = { jitter_ms = nan }"), "link.l.up.jitter_ms", "NaN"),
        (linked("rate_bits_per_s = 5000, mtu_bytes = 100", ""), "link.l.down.mtu_bytes", "576"),
        (linked("rate_bits_per_s = 5000, mtu_bytes = 1200", ""), "sweep[0].link[0]", "use more, or \"ws\""),
        (linked("rate_bits_per_s = 5000, loss = 2", ""), "link.l.down.loss", "probability"),
        (
            linked("rate_bits_per_s = 5000, burst_loss = { to_bad = 0.1, to_good = 0 }", ""),
            "link.l.down.burst_loss.to_good",
            "for ever",
        ),
        (ws("rate_bits_per_s = 5000, loss = 0.1"), "sweep[0].link[0]", "not modelled"),
        (
            ws("rate_bits_per_s = 5000, burst_loss = { to_bad = 0.1, to_good = 1 }"),
            "sweep[0].link[0]",
            "not modelled",
        ),
        (
            ws("rate_bits_per_s = 5000, jitter_ms = 1, reorder = true"),
            "sweep[0].link[0]",
            "leave out `reorder`",
        ),
        (
            sweep("up = { loss = 0.5 }").replace("[0, 0.01]", "0").replace("\"quic\"", "[\"quic\", \"ws\"]"),
            "sweep[0].up.loss",
            "0.5 up over \"ws\"",
        ),
        (sweep("burst_loss = [{ to_bad = 0.1, to_good = 0.1 }]"), "sweep[0].loss", "keep one"),
        (sweep("jitter_ms = [1, -1]"), "sweep[0].jitter_ms[1]", "-1 is not"),
        (sweep("queue_bytes = [1, 9_999_999_999]"), "sweep[0].queue_bytes[1]", "1 GiB"),
        (sweep("mtu_bytes = [1500, 1000]"), "sweep[0].mtu_bytes[1]", "1228"),
        (sweep("link = \"l\""), "sweep[0].rate_bits_per_s", "leave out `link`"),
        (
            linked("rate_bits_per_s = 5000", "").replace("\"l\"", "\"m\""),
            "sweep[0].link[0]",
            "add a [link.m]",
        ),
        (sweep("camera = \"drunk\""), "sweep[0].camera[0]", "\"fly-through\""),
        (camera("path = \"orbit\"\nseconds = -1"), "camera.c.seconds", "-1 is not a duration"),
        (camera("path = \"teleport\"\nseconds = 1"), "camera.c.seconds", "leave it out"),
        (camera("path = \"swing\"\ndegrees = 0"), "camera.c.degrees", "other than 0"),
        (camera("path = \"orbit\"\nstarts = -1"), "camera.c.starts", "-1 is not"),
        (sweep("seeds = 0"), "sweep[0].seeds", "0 is not a number of seeds"),
        (sweep("seeds = [4, 4]"), "sweep[0].seeds", "seed 4 twice"),
        (sweep("seeds = \"many\""), "line 7", "list of seeds"),
        (sweep("limiter_share = 0.5\nlimiter_bits_per_s = 5000"), "sweep[0].limiter_share", "keep one"),
        (
            linked("rate_steps = [{ from_s = 0, bits_per_s = 9000 }]", "") + "limiter_share = 0.5\n",
            "sweep[0].limiter_share",
            "give limiter_bits_per_s",
        ),
        (sweep("time_limit_s = 0"), "sweep[0].time_limit_s", "0 is not"),
        (sweep("scene = \"\""), "sweep[0].scene[0]", "is empty"),
        (GOOD.replace("rtt_ms = [50]\n", ""), "sweep[0].rtt_ms", "or name a `link`"),
        (sweep("seeds = 2501"), "sweep[0].rate_bits_per_s", "more than 10000 runs"),
    ];
    for (text, field, message) in cases {
        let error = parse_at(&text).unwrap_err();
        assert_eq!(error.field, field, "{text}\n{error}");
        assert!(error.message.contains(message), "{text}\n{error}");
        assert!(!error.to_string().contains('\n'), "{error}");
    }
}

#[test]
fn endless_plans_are_refused() {
    let many = "2_000_000, ".repeat(MAX_RUNS);
    let error = parse_at(&GOOD.replace("2_000_000", &format!("{many} 2_000_000"))).unwrap_err();
    assert!(error.message.contains("more than"), "{error}");
}

#[test]
fn the_shipped_plans_parse() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../plans");
    let first_frame = read(&folder.join("first-frame.toml")).unwrap();
    assert_eq!(first_frame.cases.len(), 9);
    assert_eq!(first_frame.scenes[0].choice, SceneChoice::Demo);
    let limited = read(&folder.join("limited.toml")).unwrap();
    assert_eq!(limited.cases[0].limiter_bits_per_s, Some(1_900_000));
    assert_eq!(limited.cases.len(), first_frame.cases.len());
    let short = read(&folder.join("short.toml")).unwrap();
    assert_eq!(short.scenes[0].choice, SceneChoice::DemoSmall);
    let city = read(&folder.join("city.toml")).unwrap();
    let sizes: Vec<_> = city.scenes.iter().map(|scene| scene.choice.clone()).collect();
    assert_eq!(sizes, [100, 1_000, 10_000].map(SceneChoice::City));
}

#[test]
fn pictures_have_the_aspect_of_the_view_and_ordered_instants() {
    let with =
        |pictures: &str| parse_at(&GOOD.replace("[[sweep]]", &format!("[pictures]\n{pictures}\n[[sweep]]")));
    assert_eq!(parse_at(GOOD).unwrap().pictures, None);
    let settings = |pictures: &str| with(pictures).unwrap().pictures.unwrap();
    let usual = PictureSettings { at_s: vec![1.0, 3.0], size_px: [640, 360], first: None };
    assert_eq!(settings(""), usual);
    let small = PictureSettings { at_s: Vec::new(), size_px: [320, 180], first: None };
    assert_eq!(settings("at_s = []\nsize_px = [320, 180]"), small);
    let first = settings("at_s = [0.25, 0.3, 2]\nfirst_s = 0.4\nevery_s = 0.1");
    assert_eq!(first.at_s, [0.1, 0.2, 0.25, 0.3, 0.4, 2.0]);
    assert_eq!(first.first, Some(FirstSeconds { until_s: 0.4, every_s: 0.1 }));
    // The nearest size in whole pixels.
    assert_eq!(settings("size_px = [100, 56]").size_px, [100, 56]);
    for (pictures, field, message) in [
        ("at_s = [1, 0]", "pictures.at_s[1]", "not a time"),
        ("at_s = [nan]", "pictures.at_s[0]", "not a time"),
        ("at_s = [3, 3]", "pictures.at_s[1]", "after the instant before"),
        ("at_s = [1,2,3,4,5,6,7,8,9,10,11,12,13,14,15,16,17]", "pictures.at_s", "16 are the most"),
        ("first_s = 0", "pictures.first_s", "not a time"),
        ("first_s = 3\nevery_s = 0.001", "pictures.every_s", "100 pictures"),
        ("size_px = [640, 352]", "pictures.size_px", "shape"),
        ("size_px = [360, 640]", "pictures.size_px", "shape"),
        ("size_px = [4096, 2304]", "pictures.size_px[0]", "16 to 2048"),
        ("size_px = [16, 9]", "pictures.size_px[1]", "16 to 2048"),
        ("at = [1]", "line 3", "unknown field"),
    ] {
        let error = with(pictures).unwrap_err();
        assert!(error.field == field && error.message.contains(message), "{pictures}: {error}");
    }
}

#[test]
fn client_and_codec_default_to_the_shipped_settings() {
    let plain = parse_at(GOOD).unwrap();
    assert_eq!((plain.client, plain.codec), (ClientSettings::to(1.0), None));
    let client = "[client]\ntarget_px = 4\nrequest_depth_bytes = 9000\nprefetch_bases = false\ntruncation_points = false\nshadows = true\nsplits_per_s = 3e5\n";
    let head = "codec = \"zstd\"\nttq_px = [4, 1]\n";
    let own =
        parse_at(&format!("{head}{}", GOOD.replace("[[sweep]]", &format!("{client}[[sweep]]")))).unwrap();
    let expected = ClientSettings {
        target_px: 4.0,
        request_depth_bytes: Some(9000),
        prefetch_bases: false,
        truncation_points: false,
        hidden_last: true,
        shadows: true,
        splits_per_s: Some(3e5),
    };
    assert_eq!((own.client, own.codec), (expected, Some(Codec::Zstd.into())));
    for (text, field, message) in [
        (client.replace("= 4", "= 0"), "client.target_px", "0 is not a screen error"),
        (client.replace("9000", "0"), "client.request_depth_bytes", "0 is not a number"),
        (client.replace("truncation_points", "stop"), "line 6", "unknown field"),
    ] {
        let error = parse_at(&GOOD.replace("[[sweep]]", &format!("{text}[[sweep]]"))).unwrap_err();
        assert!(error.field == field && error.message.contains(message), "{error}");
    }
    let error = parse_at(&format!("codec = \"lzw\"\n{GOOD}")).unwrap_err();
    let message = "auto, range, axis-aligned or zstd is possible; \"lzw\" is not";
    assert_eq!((error.field.as_str(), error.message.as_str()), ("codec", message));
}

#[test]
fn keys_may_be_changed_from_outside() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("plan.toml");
    std::fs::write(&file, GOOD).unwrap();
    let with = |changes: &[&str]| {
        let changes: Vec<String> = changes.iter().map(|&change| change.to_owned()).collect();
        read_with(&file, &changes)
    };
    assert_eq!(with(&[]).unwrap(), parse_at(GOOD).unwrap());
    let changed =
        with(&["client.target_px=4", "sweep.seeds = 3", "codec=\"zstd\"", "sweep.loss=[0]"]).unwrap();
    assert_eq!((changed.client.target_px, changed.codec), (4.0, Some(Codec::Zstd.into())));
    assert!(changed.cases.iter().all(|case| case.seeds.len() == 3));
    assert_eq!(changed.cases.len() * 2, parse_at(GOOD).unwrap().cases.len());
    for (change, message) in [
        ("speed=3", "unknown field"),
        ("codec", "KEY=VALUE"),
        ("codec=zstd", "quotation marks"),
        ("scene.name=1", "scene is not a table"),
        ("client..x=1", "a key is empty"),
        ("client.target_px=0", "not a screen error"),
    ] {
        let error = with(&[change]).unwrap_err();
        assert!(
            error.to_string().contains(message) && !error.to_string().contains('\n'),
            "{change}: {error}"
        );
    }
}

#[test]
fn plans_take_4_to_24_position_bits() {
    for bits in [4, 24] {
        let plan = parse_at(&format!("position_bits = {bits}\n{}", GOOD.replace("demo", "model:bunny.obj")))
            .unwrap();
        let SceneChoice::Model { position_bits, .. } = &plan.scenes[0].choice else {
            panic!("{:?}", plan.scenes)
        };
        assert_eq!(position_bits.map(|bits| bits.get()), Some(bits));
    }
    for bits in [3, 25] {
        let error = parse_at(&format!("position_bits = {bits}\n{GOOD}")).unwrap_err();
        assert_eq!(error.message, format!("4 to 24 bits are possible; {bits} is not"));
    }
}
