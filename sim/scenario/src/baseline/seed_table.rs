//! The older system's Table 5.1, by its method: transfer times of models as JSON over two links, computed as length
//! over rate with a Mbit of 1024² bits; beside them the sizes of this project's packs of the same models.

use std::fmt;

use anyhow::Context as _;
use lodestream_compress::{encode_base, prepare};
use lodestream_geometry::Settings;
use lodestream_geometry::pool::{Serial, Silent};
use lodestream_geometry::quantise::{QuantiseSettings, quantise};
use serde::Serialize;

use super::mesh_text;
use super::seed_models::seed_models;

/// The rates of the table, in Mbit/s.
pub const RATES_MBIT_PER_S: [f64; 2] = [2.0, 15.91];
/// The table's Mbit.
const MBIT: f64 = 1024.0 * 1024.0;

/// A length, and its transfer time at each of [`RATES_MBIT_PER_S`].
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Transfer {
    /// Length.
    pub bytes: u64,
    /// Milliseconds, by rate.
    pub ms: [f64; 2],
}

impl Transfer {
    /// The transfer of a number of bytes.
    #[must_use]
    pub fn of(bytes: u64) -> Self {
        let ms = |rate: f64| bytes as f64 * 8.0 / (rate * MBIT) * 1e3;
        // To the microsecond.
        Self { bytes, ms: RATES_MBIT_PER_S.map(|rate| (ms(rate) * 1e3).round() / 1e3) }
    }
}

/// The row of one model.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Line {
    /// The model.
    pub model: &'static str,
    /// Its triangles.
    pub triangles: usize,
    /// The model as JSON.
    pub json: Transfer,
    /// The JSON after gzip.
    pub json_gzip: Transfer,
    /// This project's base mesh, which is enough for a first frame.
    pub first_frame: Transfer,
    /// Base mesh, index and all chunks.
    pub whole: Transfer,
}

/// The table.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct SeedTable(pub Vec<Line>);

/// Makes the models, writes them as JSON and prepares them with the default settings.
///
/// # Errors
/// None for these models.
pub fn seed_table() -> anyhow::Result<SeedTable> {
    let line = |model: &super::seed_models::SeedModel| -> anyhow::Result<Line> {
        let mesh = quantise(&model.mesh, &QuantiseSettings::default())?;
        let json = mesh_text::json(&mesh)?;
        let prepared = prepare(&mesh, &Settings::default(), &Serial, &Silent)?;
        let base = encode_base(&prepared.base)?.len() as u64;
        let rest = prepared.pages.iter().chain(&prepared.chunks).map(|blob| blob.len() as u64).sum::<u64>();
        Ok(Line {
            model: model.name,
            triangles: mesh.faces.len(),
            json: Transfer::of(json.len() as u64),
            json_gzip: Transfer::of(mesh_text::gzip_bytes(&json)?),
            first_frame: Transfer::of(base),
            whole: Transfer::of(base + rest),
        })
    };
    let models = seed_models();
    let lines = models.iter().map(|model| line(model).with_context(|| model.name));
    Ok(SeedTable(lines.collect::<anyhow::Result<_>>()?))
}

impl fmt::Display for SeedTable {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [slow, fast] = RATES_MBIT_PER_S;
        writeln!(f, "| model | triangles | as | bytes | {slow} Mbit/s, ms | {fast} Mbit/s, ms |")?;
        write!(f, "|---|---|---|---|---|---|")?;
        for line in &self.0 {
            let rows = [
                ("JSON", line.json),
                ("JSON, gzip", line.json_gzip),
                ("pack, to the first frame", line.first_frame),
                ("pack, whole", line.whole),
            ];
            for (what, Transfer { bytes, ms: [slow, fast] }) in rows {
                let Line { model, triangles, .. } = line;
                write!(f, "\n| {model} | {triangles} | {what} | {bytes} | {slow:.1} | {fast:.1} |")?;
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_mbit_has_1024_times_1024_bits() {
        assert_eq!(Transfer::of(262_144).ms, [1000.0, 125.707]);
    }

    #[test]
    fn packs_are_shorter_than_json_and_first_frames_shorter_still() {
        let table = seed_table().unwrap();
        assert_eq!(table.0.iter().map(|line| line.triangles).collect::<Vec<_>>(), [902, 298, 950]);
        for line in &table.0 {
            assert!(
                line.first_frame.bytes < line.whole.bytes && line.whole.bytes < line.json_gzip.bytes,
                "{line:?}"
            );
            assert!(line.json_gzip.bytes < line.json.bytes / 2, "{line:?}");
        }
        assert_eq!(seed_table().unwrap(), table);
        // A head, and four lines for each model.
        assert_eq!(table.to_string().lines().count(), 2 + 12);
    }
}
