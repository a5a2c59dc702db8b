//! The program as a process: output, refusals, exit codes.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use lodestream_geometry::base::Base;
use lodestream_geometry::pack::{BlobKind, HEAD_BYTES, Head, write};
use lodestream_scene::asset::AssetDescription;
use tempfile::TempDir;

fn run(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_lodestream-server")).args(arguments).output().unwrap()
}

fn text(path: &Path) -> &str {
    path.to_str().unwrap()
}

fn stdout(output: &Output) -> String {
    String::from_utf8(output.stdout.clone()).unwrap()
}

/// Runs a command that must be refused: exit code 2, nothing on standard output, one line on standard error.
fn refused(arguments: &[&str], fragments: &[&str]) {
    let output = run(arguments);
    let message = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(2), "{arguments:?}: {message}");
    assert!(output.stdout.is_empty(), "{arguments:?}");
    assert!(message.starts_with("error: "), "{message}");
    assert_eq!(message.trim_end().lines().count(), 1, "{message}");
    for fragment in fragments {
        assert!(message.contains(fragment), "{message:?} lacks {fragment:?}");
    }
}

/// A closed, bumpy sphere, smooth enough to simplify; every edge has two faces.
fn sphere_obj(rings: usize, segments: usize) -> String {
    let mut obj = String::from("s 1\nv 0 1 0\nv 0 -1 0\n");
    for ring in 1..rings {
        for segment in 0..segments {
            let theta = std::f64::consts::PI * ring as f64 / rings as f64;
            let phi = std::f64::consts::TAU * segment as f64 / segments as f64;
            let r = 1.0 + 0.1 * (5.0 * phi).sin() * (4.0 * theta).sin();
            let (x, y, z) = (r * theta.sin() * phi.cos(), r * theta.cos(), r * theta.sin() * phi.sin());
            writeln!(obj, "v {x} {y} {z}").unwrap();
        }
    }
    let at = |ring: usize, segment: usize| 3 + (ring - 1) * segments + segment % segments;
    for s in 0..segments {
        writeln!(obj, "f 1 {} {}", at(1, s + 1), at(1, s)).unwrap();
        writeln!(obj, "f 2 {} {}", at(rings - 1, s), at(rings - 1, s + 1)).unwrap();
        for ring in 1..rings - 1 {
            let (a, b) = (at(ring, s), at(ring, s + 1));
            let (c, d) = (at(ring + 1, s), at(ring + 1, s + 1));
            writeln!(obj, "f {a} {b} {d} {c}").unwrap();
        }
    }
    obj
}

/// A folder with a model of about 8,000 faces and its pack.
fn prepared() -> (TempDir, PathBuf, PathBuf) {
    let dir = TempDir::new().unwrap();
    let (obj, pack) = (dir.path().join("ball.obj"), dir.path().join("ball.lsp"));
    std::fs::write(&obj, sphere_obj(64, 64)).unwrap();
    let output = run(&["prepare", text(&obj), "-o", text(&pack), "--quiet"]);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    (dir, obj, pack)
}

fn inspected(pack: &Path) -> serde_json::Value {
    let output = run(&["inspect", text(pack), "--json"]);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    serde_json::from_slice(&output.stdout).unwrap()
}

#[test]
fn inspect_prints_all_fields_and_they_agree() {
    let (_dir, _, pack) = prepared();
    let fields = inspected(&pack);
    let number = |name: &str| fields[name].as_f64().unwrap_or_else(|| panic!("{name} in {fields}"));
    assert_eq!(number("vertices"), 2.0 + 63.0 * 64.0);
    assert_eq!(number("faces"), 2.0 * 63.0 * 64.0);
    assert_eq!(number("wedges"), number("vertices"));
    assert_eq!(number("components"), 1.0);
    assert_eq!(number("position_bits"), 14.0);
    assert!(number("levels") >= 1.0 && number("chunks") >= 1.0);
    assert!(number("base_faces") < number("faces") / 4.0);
    assert_eq!(number("total_bytes"), std::fs::metadata(&pack).unwrap().len() as f64);
    let parts = number("base_bytes") + number("index_bytes") + number("payload_bytes");
    assert!(parts < number("total_bytes"));
    let bits = 8.0 * parts / number("vertices");
    assert!((number("bits_per_vertex") - bits).abs() < 0.01);
    assert!(number("base_error") > 0.0 && number("base_error") <= 0.05 * number("diagonal"));
    let plain = stdout(&run(&["inspect", text(&pack)]));
    assert!(plain.contains("base_faces"), "{plain}");
}

#[test]
fn packs_do_not_depend_on_the_run_or_on_threads() {
    let (dir, obj, pack) = prepared();
    for threads in ["1", "2", "3"] {
        let other = dir.path().join(format!("{threads}.lsp"));
        assert!(
            run(&["prepare", text(&obj), "-o", text(&other), "-q", "--threads", threads]).status.success()
        );
        assert!(std::fs::read(&other).unwrap() == std::fs::read(&pack).unwrap(), "{threads} threads");
    }
}

#[test]
fn check_finds_nothing_wrong_with_a_good_pack() {
    let (_dir, _, pack) = prepared();
    let output = run(&["check", text(&pack), "--random-sets", "30", "--seed", "7"]);
    assert_eq!(stdout(&output), "sets 30 cracks 0 order-dependent 0 undo-errors 0\n");
    assert!(output.status.success());
}

/// A wavy sheet with all kinds of attributes: seams, creases, colours, explicit normals, two materials, a texture.
fn decorated(dir: &TempDir) -> PathBuf {
    let n = 48;
    let mut obj = String::from("mtllib sheet.mtl\n");
    for y in 0..=n {
        for x in 0..=n {
            let (u, v) = (f64::from(x) / f64::from(n), f64::from(y) / f64::from(n));
            let height = 0.2 * (9.0 * u).sin() * (7.0 * v).cos();
            writeln!(obj, "v {u} {height} {v} {u:.3} {v:.3} 0.5\nvt {u} {v}\nvt {} {v}", u + 2.0).unwrap();
            writeln!(obj, "vn 0 1 0\nvn {} 1 0.3", u - 0.5).unwrap();
        }
    }
    for y in 0..n {
        writeln!(obj, "usemtl {}", if y < n / 3 { "wave" } else { "foam" }).unwrap();
        for x in 0..n {
            let chart = i32::from(x >= n / 2);
            let corner = |dx: i32, dy: i32| {
                let v = (y + dy) * (n + 1) + x + dx + 1;
                format!("{v}/{}/{}", 2 * v - 1 + chart, 2 * v - 1 + i32::from(y >= n / 2))
            };
            let [a, b, c, d] = [corner(0, 0), corner(1, 0), corner(0, 1), corner(1, 1)];
            writeln!(obj, "f {a} {c} {d}\nf {a} {d} {b}").unwrap();
        }
    }
    let path = dir.path().join("sheet.obj");
    std::fs::write(&path, obj).unwrap();
    std::fs::write(
        dir.path().join("sheet.mtl"),
        "newmtl wave\nKd 0.2 0.4 1\nmap_Kd wave.png\nmap_Pr -imfchan g wave.png\nnorm wave.png\n\
         newmtl foam\nKd 1 1 1\nd 0.5\nKe 0 0.5 2\nPm 0.5\n",
    )
    .unwrap();
    image::RgbImage::from_fn(32, 32, |x, y| image::Rgb([x as u8 * 8, y as u8 * 8, 0]))
        .save(dir.path().join("wave.png"))
        .unwrap();
    path
}

/// The pack with changed blobs and correct hashes.
fn forged(pack: &Path, change: &dyn Fn(BlobKind, &mut Vec<u8>)) -> Vec<u8> {
    let file = std::fs::read(pack).unwrap();
    let head = Head::parse(&file[..HEAD_BYTES]).unwrap();
    let end = HEAD_BYTES + head.table_bytes();
    let entries = head.parse_table(&file[HEAD_BYTES..end], file.len() as u64).unwrap();
    let mut blobs: Vec<(BlobKind, Vec<u8>)> =
        entries.iter().map(|e| (e.kind, file[e.offset as usize..][..e.length as usize].to_vec())).collect();
    blobs.iter_mut().for_each(|(kind, bytes)| change(*kind, bytes));
    let blobs: Vec<_> = blobs.iter().map(|(kind, bytes)| (*kind, &bytes[..])).collect();
    write(head.fingerprint, &blobs).unwrap()
}

fn change_base(bytes: &mut Vec<u8>, change: impl Fn(&mut Base)) {
    let mut base = lodestream_compress::decode_base(bytes).unwrap();
    change(&mut base);
    *bytes = lodestream_compress::encode_base(&base).unwrap();
}

#[test]
fn check_compares_every_kind_of_pack_with_its_model() {
    let dir = TempDir::new().unwrap();
    let (obj, pack) = (decorated(&dir), dir.path().join("sheet.lsp"));
    for options in [
        &[][..],
        &["--codec", "zstd", "--position-bits", "11", "--uv-bits", "9"],
        &["--metric", "melax", "--tolerance", "0.001", "--normal-tolerance", "0"],
        &["--round-size", "0.1", "--codec", "zstd", "--normal-tolerance", "180", "--relief-depth", "0.1"],
    ] {
        let output = run(&[&["prepare", text(&obj), "-o", text(&pack), "-q"], options].concat());
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        let fields = inspected(&pack);
        assert!(fields["colors"].as_bool().unwrap() && fields["chunks"].as_u64() > Some(1), "{fields}");
        let counts = ["blended_materials", "masked_materials", "emissive_materials", "metallic_materials"]
            .map(|name| fields[name].as_u64());
        assert_eq!(counts, [Some(1), Some(0), Some(1), Some(1)]);
        let textures =
            ["textures", "color_textures", "normal_textures", "surface_textures", "height_textures"]
                .map(|name| fields[name].as_u64());
        assert_eq!(textures, [Some(3), Some(1), Some(1), Some(1), Some(0)]);
        let output = run(&["check", text(&pack), "--random-sets", "8", "--source", text(&obj)]);
        let expected = "sets 8 cracks 0 order-dependent 0 undo-errors 0\n\
            source faces 4608 missing 0 foreign 0 strange-wedges 0 differing-materials 0\n";
        assert_eq!(stdout(&output), expected, "{options:?} {}", String::from_utf8_lossy(&output.stderr));
        assert!(output.status.success());
    }
}

#[test]
fn check_finds_faults_that_hashes_do_not() {
    let dir = TempDir::new().unwrap();
    let (obj, pack, bad) = (decorated(&dir), dir.path().join("sheet.lsp"), dir.path().join("bad.lsp"));
    type Change = fn(BlobKind, &mut Vec<u8>);
    let colour: Change = |kind, bytes| {
        if kind == BlobKind::Base {
            change_base(bytes, |base| base.wedges[0].attributes.color[2] ^= 64);
        }
    };
    let uv: Change = |kind, bytes| {
        if kind == BlobKind::Base {
            change_base(bytes, |base| base.wedges[0].attributes.uv[0] ^= 1);
        }
    };
    let material: Change = |kind, bytes| {
        if kind == BlobKind::Base {
            change_base(bytes, |base| {
                let mut description = AssetDescription::decode(&base.description).unwrap();
                description.materials[1].metallic = 1.0;
                base.description = description.encode().unwrap();
            });
        }
    };
    let texture: Change = |kind, bytes| {
        if matches!(kind, BlobKind::Texture { level: 0, .. }) {
            *bytes.last_mut().unwrap() ^= 1;
        }
    };
    for codec in ["range", "zstd"] {
        assert!(run(&["prepare", text(&obj), "-o", text(&pack), "-q", "--codec", codec]).status.success());
        for (what, change) in
            [("strange-wedges", colour), ("missing", uv), ("materials", material), ("materials", texture)]
        {
            std::fs::write(&bad, forged(&pack, &change)).unwrap();
            let alone = run(&["check", text(&bad), "--random-sets", "3"]);
            assert!(alone.status.success(), "{what}: only a comparison with the model can find it");
            let output = run(&["check", text(&bad), "--random-sets", "3", "--source", text(&obj)]);
            let line = stdout(&output);
            assert_eq!(output.status.code(), Some(1), "{what}: {line}");
            assert!(!line.contains(&format!("{what} 0")), "{what}: {line}");
        }
    }
    let ball = dir.path().join("ball.obj");
    std::fs::write(&ball, sphere_obj(8, 8)).unwrap();
    refused(&["check", text(&pack), "--source", text(&ball)], &["another grid"]);
}

#[test]
fn packs_of_both_codecs_hold_the_same_meshes() {
    let (dir, obj, ranged) = prepared();
    let packed = dir.path().join("zstd.lsp");
    assert!(run(&["prepare", text(&obj), "-o", text(&packed), "-q", "--codec", "zstd"]).status.success());
    let fields = [&ranged, &packed].map(|pack| inspected(pack));
    assert_eq!([&fields[0]["codec"], &fields[1]["codec"]], ["range", "zstd"]);
    assert!(fields[1]["settings"].as_str().unwrap().contains("codec zstd"), "{}", fields[1]);
    let bytes = fields.each_ref().map(|f| f["payload_bytes"].as_u64().unwrap());
    assert!(bytes[0] < bytes[1] && bytes[1] < 2 * bytes[0], "{bytes:?}");
    for field in ["faces", "wedges", "chunks", "base_error", "base_faces"] {
        assert_eq!(fields[0][field], fields[1][field], "{field}");
    }
    let output = run(&["check", text(&packed), "--random-sets", "10"]);
    assert!(output.status.success(), "{}", stdout(&output));
    // The lines of an OBJ file, sorted, since the order of vertices differs.
    let exported = |pack: &Path| {
        let out = dir.path().join("out.obj");
        let output = run(&["export", text(pack), "-o", text(&out)]);
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        let text = std::fs::read_to_string(&out).unwrap();
        let mut lines: Vec<String> = text.lines().filter(|l| l.starts_with('v')).map(Into::into).collect();
        lines.sort();
        lines
    };
    // Within a budget only chunks of the range coder can end at a truncation point.
    assert!(exported(&ranged) == exported(&packed));
}

#[test]
fn exports_keep_to_their_budget_and_can_be_imported() {
    let (dir, _, pack) = prepared();
    let out = dir.path().join("out.obj");
    let export = |budget: &[&str]| {
        let mut arguments = vec!["export", text(&pack)];
        arguments.extend(budget);
        arguments.extend(["-o", text(&out)]);
        let output = run(&arguments);
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        let faces = lodestream_import::import(&out).unwrap().mesh.faces.len();
        let said = stdout(&output);
        assert!(said.contains(&format!("{faces} faces")), "{said}");
        faces
    };
    let all = export(&[]);
    assert_eq!(all, 2 * 63 * 64);
    let some = export(&["--faces", "3000"]);
    assert!((300..=3000).contains(&some), "{some}");
    let coarse = export(&["--error", "1"]);
    assert!(coarse < some, "{coarse}");
    let total = std::fs::metadata(&pack).unwrap().len();
    let half = export(&["--bytes", &(total / 2).to_string()]);
    assert!(half > coarse && half < all, "{half}");
    refused(&["export", text(&pack), "--bytes", "10", "-o", text(&out)], &["ball.lsp", "bytes"]);
    refused(&["export", text(&pack), "--faces", "1", "-o", text(&out)], &["ball.lsp", "faces"]);
}

#[test]
fn bad_models_are_refused_and_leave_no_pack() {
    let dir = TempDir::new().unwrap();
    let (obj, pack) = (dir.path().join("bad.obj"), dir.path().join("bad.lsp"));
    refused(&["prepare", text(&obj), "-o", text(&pack)], &["bad.obj: cannot be read"]);
    let triangle = "v 0 0 0\nv 1 0 0\nv 0 1 0\n";
    let cases: [(String, &str); 8] = [
        (String::new(), "is empty"),
        (format!("{triangle}f 1 2 9\n"), ":4: face refers to vertex 9"),
        (format!("{triangle}f 1 2 -9\n"), ":4: face refers to vertex -9"),
        (format!("{triangle}v nan 0 0\nf 1 2 4\n"), ":4: vertex"),
        (format!("{triangle}v 1e39 0 0\nf 1 2 4\n"), ":4: vertex"),
        (format!("{triangle}l 1 2\np 3\n"), "has no faces"),
        (format!("{triangle}f 1 1 2\n"), "no usable face"),
        ("\0\u{1}\u{2}".repeat(99), "not text"),
    ];
    for (content, fragment) in cases {
        std::fs::write(&obj, content).unwrap();
        refused(&["prepare", text(&obj), "-o", text(&pack)], &["bad.obj", fragment]);
    }
    std::fs::write(&obj, format!("{triangle}f 1 2 3\n")).unwrap();
    refused(
        &["prepare", text(&obj), "-o", text(&dir.path().join("no/a.lsp"))],
        &["a.lsp: cannot be written"],
    );
    let tolerance = ["prepare", text(&obj), "-o", text(&pack), "--tolerance", "1e-30"];
    refused(&tolerance, &["bad.obj"]);
    let files: Vec<_> = std::fs::read_dir(dir.path()).unwrap().map(|f| f.unwrap().file_name()).collect();
    assert_eq!(files, ["bad.obj"], "only the model is left");
}

#[test]
fn damaged_packs_are_refused() {
    let (dir, obj, pack) = prepared();
    let good = std::fs::read(&pack).unwrap();
    let bad = dir.path().join("bad.lsp");
    let refused_as = |bytes: &[u8], fragments: &[&str]| {
        std::fs::write(&bad, bytes).unwrap();
        refused(&["inspect", text(&bad)], fragments);
    };
    refused(&["inspect", text(&dir.path().join("none.lsp"))], &["none.lsp: cannot be read"]);
    refused(&["inspect", text(dir.path())], &["not a regular file"]);
    refused(&["inspect", text(&obj)], &["ball.obj", "not a Lodestream pack"]);
    refused_as(&[], &["bad.lsp"]);
    for parts in 0..8 {
        refused_as(&good[..good.len() * parts / 8], &["bad.lsp"]);
    }
    refused_as(&good[..good.len() - 1], &["bad.lsp"]);
    let mut longer = good.clone();
    longer.push(0);
    refused_as(&longer, &["bad.lsp"]);
    for i in 0..40 {
        let mut flipped = good.clone();
        let at = i * (good.len() - 1) / 39;
        flipped[at] ^= 1 << (i % 8);
        refused_as(&flipped, &["bad.lsp"]);
    }
    // Fields of the head: magic, version, key of the inputs.
    let with = |at: usize| {
        let mut changed = good.clone();
        changed[at] ^= 0x40;
        changed
    };
    refused_as(&with(0), &["bad.lsp", "not a Lodestream pack"]);
    refused_as(&with(8), &["bad.lsp", "version", "prepare the asset again"]);
    refused_as(&with(20), &["bad.lsp", "damaged"]);
    std::fs::write(&bad, &good[..good.len() / 2]).unwrap();
    refused(&["check", text(&bad)], &["bad.lsp"]);
    refused(&["export", text(&bad), "-o", text(&dir.path().join("x.obj"))], &["bad.lsp"]);
}

#[test]
fn bad_scenes_are_refused() {
    let dir = TempDir::new().unwrap();
    let scene = dir.path().join("scene.toml");
    let cache = dir.path().join("cache");
    let serve = |files: &[&str], fragments: &[&str]| {
        let mut arguments = vec!["serve"];
        arguments.extend(files);
        arguments.extend(["--cache", text(&cache)]);
        refused(&arguments, fragments);
    };
    serve(&[text(&scene)], &["scene.toml: cannot be read"]);
    std::fs::write(&scene, "[[asset]]\nname = \"a\"\nfile = \"a.obj\"\nsize = 3\n").unwrap();
    serve(&[text(&scene)], &["scene.toml:4:", "size"]);
    std::fs::write(&scene, "[[asset]]\nname = \"a\"\nfile = \"a.obj\"\n").unwrap();
    serve(&[text(&scene)], &["a.obj: cannot be read"]);
    serve(&[text(&scene), "b.obj"], &["stands alone"]);
    serve(&["b.obj"], &["b.obj: cannot be read"]);
}

/// Runs the program with a file size limit of four blocks; it must print an error and end.
#[cfg(unix)]
fn limited_to_small_files(folder: &Path, arguments: &str) -> Output {
    let output = Command::new("sh")
        .args([
            "-c",
            &format!("ulimit -f 4 && exec \"$0\" {arguments}"),
            env!("CARGO_BIN_EXE_lodestream-server"),
        ])
        .current_dir(folder)
        .output()
        .unwrap();
    let message = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(2), "{:?}: {message}", output.status);
    assert!(
        message.lines().any(|line| line.starts_with("error: ") && line.contains("too large")),
        "{message}"
    );
    output
}

#[cfg(unix)]
#[test]
fn a_file_over_the_size_limit_is_an_error_and_leaves_no_part() {
    let dir = TempDir::new().unwrap();
    let model = dir.path().join("ball.obj");
    std::fs::write(&model, sphere_obj(40, 40)).unwrap();
    limited_to_small_files(dir.path(), "prepare ball.obj -o ball.lsp");
    let left: Vec<_> = std::fs::read_dir(dir.path()).unwrap().map(|f| f.unwrap().file_name()).collect();
    assert_eq!(left, ["ball.obj"]);
}

#[test]
fn flags_override_environment_then_file_then_defaults() {
    let dir = TempDir::new().unwrap();
    let (file, saved) = (dir.path().join("server.toml"), dir.path().join("saved.toml"));
    std::fs::write(&file, "files = \"a.obj\"\nrate = \"3Mbit\"\nmax-sessions = 30\ndrain = 30\n").unwrap();
    let output = Command::new(env!("CARGO_BIN_EXE_lodestream-server"))
        .args(["serve", "--config", text(&file), "--save-config", text(&saved), "--rate", "1Mbit"])
        .envs([("LODESTREAM_RATE", "2Mbit"), ("LODESTREAM_MAX_SESSIONS", "20")])
        .output()
        .unwrap();
    assert!(output.status.success(), "{output:?}");
    let saved = std::fs::read_to_string(saved).unwrap();
    for line in ["rate = \"1Mbit\"", "max-sessions = 20", "drain = 30", "http-tls = false"] {
        assert!(saved.lines().any(|saved| saved == line), "{line} of {saved}");
    }
    // An invalid variable is refused as the flag is.
    let output = Command::new(env!("CARGO_BIN_EXE_lodestream-server"))
        .args(["serve", "a.obj", "--save-config", text(&file)])
        .env("LODESTREAM_DRAIN", "soon")
        .output()
        .unwrap();
    let errors = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.code() == Some(2) && errors.contains("--drain"), "{errors}");
}

#[cfg(target_os = "linux")]
#[test]
fn a_full_disk_is_an_error() {
    let dir = TempDir::new().unwrap();
    let model = dir.path().join("ball.obj");
    std::fs::write(&model, sphere_obj(40, 40)).unwrap();
    let model = text(&model);
    let pack = dir.path().join("ball.lsp");
    assert!(run(&["prepare", model, "-o", text(&pack)]).status.success());
    // Each write to it fails as on a full disk (ENOSPC).
    let full = |arguments: &[&str]| {
        let output = run(arguments);
        let message = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(2), "{arguments:?}: {message}");
        let told = |line: &str| {
            line.starts_with("error: ") && line.contains("/dev/full") && line.contains("No space left")
        };
        assert!(message.lines().any(told), "{arguments:?}: {message}");
    };
    full(&["prepare", model, "-o", "/dev/full"]);
    full(&["export", text(&pack), "--faces", "200", "-o", "/dev/full"]);
}

#[cfg(target_os = "linux")]
#[test]
fn standard_error_on_a_full_disk_causes_no_panic() {
    let dir = TempDir::new().unwrap();
    // A missing texture causes a warning.
    std::fs::write(dir.path().join("a.mtl"), "newmtl a\nmap_Kd missing.png\n").unwrap();
    let obj = "mtllib a.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl a\nf 1 2 3\n";
    std::fs::write(dir.path().join("a.obj"), obj).unwrap();
    for (arguments, code) in [("prepare a.obj -o a.lsp", 0), ("prepare b.obj -o b.lsp", 2)] {
        let line = format!("exec \"$0\" {arguments} 2>/dev/full");
        let mut command = Command::new("sh");
        command.args(["-c", &line, env!("CARGO_BIN_EXE_lodestream-server")]).current_dir(dir.path());
        assert_eq!(command.status().unwrap().code(), Some(code), "{arguments}");
    }
}

#[cfg(unix)]
#[test]
fn a_full_cache_disk_ends_the_server_and_leaves_no_part() {
    let dir = TempDir::new().unwrap();
    std::fs::write(dir.path().join("ball.obj"), sphere_obj(40, 40)).unwrap();
    let serve = "serve ball.obj --cache cache --listen 127.0.0.1:0 --http 127.0.0.1:0 --admin off";
    let output = limited_to_small_files(dir.path(), serve);
    assert!(output.stdout.is_empty(), "a server that does not serve prints no address");
    let left: Vec<_> =
        std::fs::read_dir(dir.path().join("cache")).unwrap().map(|f| f.unwrap().file_name()).collect();
    assert!(left.is_empty(), "{left:?}");
}
