//! Trains the entropy coder's priors ([`lodestream_geometry::training`]) on model files.

use std::path::PathBuf;

use anyhow::Context as _;
use lodestream_bake::preparation_settings::PositionBits;
use lodestream_geometry::Settings;
use lodestream_geometry::pool::Serial;
use lodestream_geometry::quantise::{Precision, QuantiseSettings, quantise};
use lodestream_geometry::training;

/// The table of priors for some models, each prepared with the default settings.
///
/// # Errors
/// If a model cannot be imported or prepared.
pub fn train(models: &[PathBuf], position_bits: PositionBits) -> anyhow::Result<Vec<u8>> {
    let settings =
        QuantiseSettings { precision: Precision::Bits(position_bits.get()), ..QuantiseSettings::default() };
    let mut meshes = Vec::with_capacity(models.len());
    for path in models {
        let imported = lodestream_import::import_smooth(path)
            .with_context(|| format!("cannot import {}", path.display()))?;
        let mesh = quantise(&imported.mesh, &settings);
        meshes.push(mesh.with_context(|| format!("cannot quantise {}", path.display()))?);
    }
    Ok(training::train(&meshes, &Settings::default(), &Serial)?)
}
