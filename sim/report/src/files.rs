//! The files of a report.

use std::path::Path;

use lodestream_compress::whole_file::write_atomically;
use lodestream_scenario::plan::Plan;
use lodestream_scenario::result::{RunResult, to_json};
use serde::Serialize;

use super::levels::{self, Level};
use super::page;
use super::percentiles::{self, Percentiles};
use super::pictures::{self, Gallery};
use super::plots;
use super::tables;

/// Writes the report into a folder, which is created if missing: `results.json` and `results.csv` with a line per run,
/// `percentiles.json` and `percentiles.csv` if a case has enough seeds, `levels.csv` if a case is a chain of levels,
/// plots as SVG, and `report.html`, a self-contained page. Files are written atomically; percentiles, levels, plots and
/// pictures of an earlier report are removed.
///
/// # Errors
/// Errors of the file system.
pub fn write(folder: &Path, plan: &Plan, results: &[RunResult]) -> std::io::Result<()> {
    write_drawn(folder, plan, results, None)
}

/// As [`write()`], with pictures: `pictures.csv` has a line per picture, `first-seconds.csv` a line per run whose first
/// seconds the plan asks for.
///
/// # Errors
/// Errors of the file system.
pub fn write_drawn(
    folder: &Path,
    plan: &Plan,
    results: &[RunResult],
    gallery: Option<Gallery>,
) -> std::io::Result<()> {
    std::fs::create_dir_all(folder)?;
    let adapter = gallery.as_ref().map(|gallery| gallery.adapter().to_owned());
    match gallery {
        Some(gallery) => gallery.publish()?,
        None => pictures::remove_earlier(folder)?,
    }
    let json = |json: serde_json::Result<Vec<u8>>| json.map_err(std::io::Error::other);
    put(folder, "results.json", &json(to_json(results))?)?;
    put(folder, "results.csv", tables::of_runs(results).as_bytes())?;
    if results.iter().all(|run| run.pictures.is_empty()) {
        remove(folder, "pictures.csv")?;
    } else {
        put(folder, "pictures.csv", tables::of_pictures(results).as_bytes())?;
    }
    if results.iter().all(|run| run.first_seconds.is_none()) {
        remove(folder, "first-seconds.csv")?;
    } else {
        put(folder, "first-seconds.csv", tables::of_first_seconds(results).as_bytes())?;
    }
    let levels: Vec<Level> = levels::of_plan(plan, results);
    if levels.is_empty() {
        remove(folder, "levels.csv")?;
    } else {
        put(folder, "levels.csv", tables::of_levels(&levels).as_bytes())?;
    }
    let plots = plots::draw(plan, results)?;
    plots::remove_earlier(folder)?;
    for plot in &plots {
        put(folder, &plot.file, plot.svg.as_bytes())?;
    }
    let page = page::page(folder, plan, results, &plots, adapter.as_deref())?;
    put(folder, "report.html", page.as_bytes())?;
    let spread: Vec<Percentiles> = percentiles::of_plan(plan, results);
    if spread.is_empty() {
        remove(folder, "percentiles.json")?;
        return remove(folder, "percentiles.csv");
    }
    put(folder, "percentiles.json", &json(to_json(&spread))?)?;
    put(folder, "percentiles.csv", tables::of_percentiles(&spread).as_bytes())
}

/// Removes a file of an earlier report.
fn remove(folder: &Path, name: &str) -> std::io::Result<()> {
    match std::fs::remove_file(folder.join(name)) {
        Err(why) if why.kind() != std::io::ErrorKind::NotFound => Err(why),
        _ => Ok(()),
    }
}

/// Writes a list as a JSON file into a folder, which is created if missing. The file is written atomically.
///
/// # Errors
/// Errors of the file system.
pub fn write_json<T: Serialize>(folder: &Path, name: &str, objects: &[T]) -> std::io::Result<()> {
    std::fs::create_dir_all(folder)?;
    put(folder, name, &to_json(objects).map_err(std::io::Error::other)?)
}

fn put(folder: &Path, name: &str, bytes: &[u8]) -> std::io::Result<()> {
    write_atomically(&folder.join(name), |out| out.write_all(bytes))
}
