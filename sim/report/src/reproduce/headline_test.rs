//! The headline table of README.md agrees with the sections' figures and with the page of window
//! measurements.

use std::path::{Path, PathBuf};

use super::Rows;

/// The techniques of docs/report/baselines.csv in the table's columns. Clusters were measured outside.
const TECHNIQUES: [(&str, &str); 6] = [
    ("Lodestream", "lodestream"),
    ("Draco file, whole", "draco"),
    ("Nexus nodes", "nodes: Nexus nxz, 12 bits, nodes of 32,768 faces"),
    ("chain of levels", "chain"),
    ("OBJ + gzip", "obj-gzip"),
    ("older JSON system", "seed-json"),
];
/// The table's lines: name, scene, column. Visible parts are known only for this project; other techniques show the
/// column without `unoccluded_`.
const FIGURES: [(&str, &str, &str); 9] = [
    ("demo, first frame, ms", "demo", "ttff_ms"),
    ("demo, 4 px where it is seen, ms", "demo", "unoccluded_ttq_4_ms"),
    ("demo, 1 px where it is seen, ms", "demo", "unoccluded_ttq_1_ms"),
    ("demo, bytes to that", "demo", "unoccluded_ttq_1_bytes"),
    ("demo, 1 px of what is hidden too, ms", "demo", "ttq_1_ms"),
    ("bunny, first frame, ms", "model:stanford-bunny.obj", "ttff_ms"),
    ("bunny, 4 px, ms", "model:stanford-bunny.obj", "ttq_4_ms"),
    ("bunny, 1 px, ms", "model:stanford-bunny.obj", "ttq_1_ms"),
    ("bunny, bytes to 1 px", "model:stanford-bunny.obj", "ttq_1_bytes"),
];
const DASH: &str = "–";

fn file(path: &str) -> String {
    let root: PathBuf = Path::new(env!("CARGO_MANIFEST_DIR"))
        .ancestors()
        .find(|folder| folder.join("docs/report/sections.toml").is_file())
        .unwrap()
        .to_owned();
    std::fs::read_to_string(root.join(path)).unwrap()
}

/// The cells of the table whose first heading is "figure", headings first, without emphasis and thousands separators.
fn headline(document: &str) -> Vec<Vec<String>> {
    let lines = document.lines().skip_while(|line| !line.starts_with("| figure |"));
    let cells = |line: &str| {
        let plain = |cell: &str| {
            let cell = cell.trim().trim_matches('*');
            let number = cell.replace(',', "");
            if number.parse::<f64>().is_ok() { number } else { cell.to_owned() }
        };
        line.trim_matches('|').split('|').map(plain).collect()
    };
    lines.take_while(|line| line.starts_with('|')).map(cells).collect()
}

/// Least and greatest time at which windows presented the first frame, from a page; of the latest runs, in the first
/// column.
fn presented(page: &str) -> String {
    let row = page.lines().find_map(|line| line.strip_prefix("| presented, ms |")).unwrap();
    let runs = row.split('|').next().unwrap().split(',').map(|run| run.trim().parse::<u32>().unwrap());
    let (least, greatest) = runs.fold((u32::MAX, 0), |(least, most), run| (least.min(run), most.max(run)));
    format!("{least} to {greatest}")
}

/// The one row with these values, over QUIC at 2 Mbit/s.
fn figure(rows: &Rows, scene: &str, technique: &str, column: &str) -> Option<String> {
    let at = |name: &str| rows.column(name).unwrap();
    let wanted =
        [("scene", scene), ("technique", technique), ("transport", "quic"), ("rate_bits_per_s", "2000000")];
    let mut found = rows.rows.iter().filter(|row| wanted.iter().all(|(name, value)| row[at(name)] == *value));
    let row = found.next()?;
    assert!(found.next().is_none(), "{scene}, {technique}: two rows");
    Some(format!("{:.0}", row[at(column)].parse::<f64>().unwrap()))
}

#[test]
fn the_readme_shows_measured_figures() {
    let readme = headline(&file("README.md"));
    let cell = |line: &str, heading: &str| {
        let column = readme[0].iter().position(|h| h == heading);
        let line = readme.iter().find(|cells| cells[0] == line);
        let (Some(column), Some(line)) = (column, line) else {
            panic!("no line {line:?} or no column {heading:?}")
        };
        line[column].clone()
    };
    let baselines = Rows::from_csv(&file("docs/report/baselines.csv")).unwrap();
    for (line, scene, column) in FIGURES {
        for (heading, technique) in TECHNIQUES {
            let column =
                if technique == "lodestream" { column } else { column.trim_start_matches("unoccluded_") };
            let measured = figure(&baselines, scene, technique, column);
            assert_eq!(cell(line, heading), measured.as_deref().unwrap_or(DASH), "{line}, {heading}");
        }
    }
    // A figure of the demo, so that not all can be dashes.
    assert_ne!(cell("demo, 1 px where it is seen, ms", "Lodestream"), DASH);

    // A drawable frame is not yet on the screen: both times are given, the second from one source.
    let windows = presented(&file("docs/benchmarks/first-frame.md"));
    assert_eq!(
        cell("demo, first frame on the screen, software driver, real time, ms", "Lodestream"),
        windows
    );

    let geometry = Rows::from_csv(&file("docs/report/geometry.csv")).unwrap();
    let bunny = geometry.rows.iter().find(|row| row[0] == "stanford-bunny").unwrap();
    let parts = ["base_bytes", "index_bytes", "payload_bytes"].map(|name| {
        let column = geometry.column(name).unwrap();
        bunny[column].parse::<u64>().unwrap()
    });
    assert_eq!(cell("bunny, whole file, bytes", "Lodestream"), parts.iter().sum::<u64>().to_string());
}
