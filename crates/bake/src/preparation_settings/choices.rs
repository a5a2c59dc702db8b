//! The set of preparation settings, and its text in packs.

use std::fmt;
use std::str::FromStr;

use lodestream_geometry::quantise::{self, QuantiseSettings};
use lodestream_geometry::{Metric, Settings};

use lodestream_import::CreaseAngle;
use lodestream_import::setting::InvalidValue;
use lodestream_import::texture::{TextureQuality, TextureSettings};

use super::batching::Batching;
use super::codec_choice::CodecChoice;
use super::effort::Effort;
use super::setting::{
    BlockFaces, NormalTolerance, PositionBits, RegionFaces, ReliefDepth, Round, Tolerance, UvBits,
};

/// Precision of an asset's positions.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Precision {
    /// Bits per axis.
    Bits(PositionBits),
    /// Largest distance between a source position and its grid point.
    Tolerance(Tolerance),
}

/// Preparation settings; `None` is the default of `geometry`.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PreparationSettings {
    /// Precision of positions.
    pub precision: Option<Precision>,
    /// Bits per axis of texture coordinates.
    pub uv_bits: Option<UvBits>,
    /// Largest angle between a source normal and the normal of its faces for which the former is dropped.
    pub normal_tolerance: Option<NormalTolerance>,
    /// Largest angle between faces that are shaded as one smooth surface, where the file does not say.
    pub crease_angle: Option<CreaseAngle>,
    /// Error metric of collapses.
    pub metric: Option<Metric>,
    /// Order of collapses.
    pub round: Option<Round>,
    /// Codec of base mesh and chunks.
    pub codec: Option<CodecChoice>,
    /// Most faces simplified at once.
    pub block_faces: Option<BlockFaces>,
    /// Depth of relief instead of the materials' own.
    pub relief_depth: Option<ReliefDepth>,
    /// Quality of textures.
    pub texture_quality: Option<TextureQuality>,
    /// Work that goes into small packs.
    pub effort: Option<Effort>,
    /// Which assets the meshes of a file become. No pack contains it.
    pub batching: Option<Batching>,
    /// Whether scenes of many instances get proxies. No pack contains it.
    pub proxies: Option<bool>,
}

impl PreparationSettings {
    /// These settings, with those of `other` for settings that are `None`.
    #[must_use]
    pub fn or(self, other: Self) -> Self {
        Self {
            precision: self.precision.or(other.precision),
            uv_bits: self.uv_bits.or(other.uv_bits),
            normal_tolerance: self.normal_tolerance.or(other.normal_tolerance),
            crease_angle: self.crease_angle.or(other.crease_angle),
            metric: self.metric.or(other.metric),
            round: self.round.or(other.round),
            codec: self.codec.or(other.codec),
            block_faces: self.block_faces.or(other.block_faces),
            relief_depth: self.relief_depth.or(other.relief_depth),
            texture_quality: self.texture_quality.or(other.texture_quality),
            effort: self.effort.or(other.effort),
            batching: self.batching.or(other.batching),
            proxies: self.proxies.or(other.proxies),
        }
    }

    /// Settings of quantisation.
    #[must_use]
    pub fn quantise_settings(&self) -> QuantiseSettings {
        let default = QuantiseSettings::default();
        QuantiseSettings {
            precision: match self.precision {
                Some(Precision::Bits(bits)) => quantise::Precision::Bits(bits.get()),
                Some(Precision::Tolerance(length)) => quantise::Precision::Tolerance(length.get()),
                None => default.precision,
            },
            uv_bits: self.uv_bits.map_or(default.uv_bits, UvBits::get),
            normal_tolerance: self.normal_tolerance.map_or(default.normal_tolerance, NormalTolerance::get),
        }
    }

    /// Settings of simplification and coding, with the default codec, since the codec may depend on the mesh.
    #[must_use]
    pub fn simplify_settings(&self) -> Settings {
        let default = self.effort().simplify(Settings::default());
        Settings {
            metric: self.metric.unwrap_or(default.metric),
            round_share: self.round.map_or(default.round_share, Round::share),
            block_faces: self.block_faces.map_or(default.block_faces, BlockFaces::get),
            ..default
        }
    }

    /// How textures are encoded.
    #[must_use]
    pub fn texture_settings(&self) -> TextureSettings {
        let quality = self.texture_quality.unwrap_or_default();
        TextureSettings { quality, effort: self.effort().textures() }
    }

    /// Where surfaces without normals are smooth.
    #[must_use]
    pub fn crease_angle(&self) -> CreaseAngle {
        self.crease_angle.unwrap_or_default()
    }

    /// Work that goes into small packs.
    #[must_use]
    pub fn effort(&self) -> Effort {
        self.effort.unwrap_or_default()
    }

    /// The codec, or the rule that selects it.
    #[must_use]
    pub fn codec(&self) -> CodecChoice {
        self.codec.unwrap_or_default()
    }
}

/// All settings that decide what a pack holds, the defaults among them, as `inspect` shows them.
impl fmt::Display for PreparationSettings {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (quantise, settings) = (self.quantise_settings(), self.simplify_settings());
        match quantise.precision {
            quantise::Precision::Bits(bits) => write!(f, "position-bits {bits}")?,
            quantise::Precision::Tolerance(length) => write!(f, "tolerance {length}")?,
        }
        write!(f, ", uv-bits {}, normal-tolerance {}°", quantise.uv_bits, quantise.normal_tolerance)?;
        write!(f, ", metric {}", settings.metric)?;
        match settings.round_share {
            None => write!(f, ", round-size heap")?,
            Some(share) => write!(f, ", round-size {share}")?,
        }
        write!(f, ", region-faces {}, codec {}", settings.region_faces, self.codec())?;
        // Written only if set: nearly all meshes are smaller.
        self.block_faces.map_or(Ok(()), |faces| write!(f, ", block-faces {}", faces.get()))?;
        self.crease_angle.map_or(Ok(()), |angle| write!(f, ", crease-angle {angle}°"))?;
        self.relief_depth.map_or(Ok(()), |depth| write!(f, ", relief-depth {depth}"))?;
        self.texture_quality.map_or(Ok(()), |quality| write!(f, ", texture-quality {quality}"))?;
        self.effort.map_or(Ok(()), |effort| write!(f, ", effort {effort}"))
    }
}

/// Settings text of a pack that cannot be parsed.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum ReadError {
    /// An item without a name or a value.
    #[error("{item:?} is not a setting")]
    NoSetting {
        /// The part.
        item: String,
    },
    /// An unknown setting.
    #[error("{item:?}: there is no such setting")]
    Unknown {
        /// The part.
        item: String,
    },
    /// A value outside the setting's range.
    #[error("{item:?}: {why}")]
    InvalidValue {
        /// The part.
        item: String,
        /// Why not.
        why: InvalidValue,
    },
}

/// Parses the text that `Display` writes.
impl FromStr for PreparationSettings {
    type Err = ReadError;

    fn from_str(text: &str) -> Result<Self, ReadError> {
        let mut preparation_settings = Self::default();
        for item in text.split(", ") {
            let Some((name, value)) = item.split_once(' ') else {
                return Err(ReadError::NoSetting { item: item.to_owned() });
            };
            match preparation_settings.set(name, value) {
                Ok(true) => {}
                Ok(false) => return Err(ReadError::Unknown { item: item.to_owned() }),
                Err(why) => return Err(ReadError::InvalidValue { item: item.to_owned(), why }),
            }
        }
        Ok(preparation_settings)
    }
}

impl PreparationSettings {
    /// Sets a setting by its name in the text; false if there is none of that name.
    fn set(&mut self, name: &str, value: &str) -> Result<bool, InvalidValue> {
        match name {
            "position-bits" => self.precision = Some(Precision::Bits(value.parse()?)),
            "tolerance" => self.precision = Some(Precision::Tolerance(value.parse()?)),
            "uv-bits" => self.uv_bits = Some(value.parse()?),
            "normal-tolerance" => self.normal_tolerance = Some(value.trim_end_matches('°').parse()?),
            "crease-angle" => self.crease_angle = Some(value.trim_end_matches('°').parse()?),
            "metric" => self.metric = Some(value.parse::<Metric>()?),
            "round-size" => self.round = Some(value.parse()?),
            "block-faces" => self.block_faces = Some(value.parse()?),
            "codec" => self.codec = Some(value.parse::<CodecChoice>()?),
            "relief-depth" => self.relief_depth = Some(value.parse()?),
            "texture-quality" => self.texture_quality = Some(value.parse()?),
            "effort" => self.effort = Some(value.parse::<Effort>()?),
            // Written for information, but not a setting yet.
            "region-faces" => drop(value.parse::<RegionFaces>()?),
            _ => return Ok(false),
        }
        Ok(true)
    }
}

#[cfg(test)]
mod tests {
    use lodestream_geometry::Codec;

    use super::*;

    fn uv(bits: u8) -> Option<UvBits> {
        Some(bits.try_into().unwrap())
    }

    fn degrees(angle: f64) -> Option<NormalTolerance> {
        Some(angle.try_into().unwrap())
    }

    #[test]
    fn choices_override_defaults_and_are_displayed() {
        let general = PreparationSettings {
            uv_bits: uv(10),
            normal_tolerance: degrees(3.0),
            ..PreparationSettings::default()
        };
        let own = PreparationSettings {
            uv_bits: uv(9),
            round: Round::try_from(0.1).ok(),
            ..PreparationSettings::default()
        };
        let both = own.or(general);
        assert_eq!((both.uv_bits, both.normal_tolerance), (uv(9), degrees(3.0)));
        assert_eq!(both.simplify_settings().round_share, Some(0.1));
        assert_eq!(both.quantise_settings().normal_tolerance, 3.0);
        let text = both.to_string();
        for part in [
            "position-bits 14",
            "uv-bits 9",
            "normal-tolerance 3°",
            "metric qem",
            "round-size 0.1",
            "codec auto",
        ] {
            assert!(text.contains(part), "{text}");
        }
    }

    #[test]
    fn the_displayed_text_is_parsed_again() {
        let all = PreparationSettings {
            precision: Tolerance::try_from(0.1 + 0.2).ok().map(Precision::Tolerance),
            uv_bits: uv(9),
            normal_tolerance: degrees(2.5),
            crease_angle: CreaseAngle::try_from(30.5).ok(),
            metric: Some(Metric::Melax),
            round: Round::try_from(0.1).ok(),
            codec: Some(Codec::Zstd.into()),
            block_faces: BlockFaces::try_from(1_000_000).ok(),
            relief_depth: ReliefDepth::try_from(0.1).ok(),
            texture_quality: TextureQuality::try_from(90).ok(),
            effort: Some(Effort::Least),
            batching: None,
            proxies: None,
        };
        assert_eq!(all.to_string().parse(), Ok(all));
        let told: PreparationSettings = PreparationSettings::default().to_string().parse().unwrap();
        assert_eq!(told.quantise_settings(), PreparationSettings::default().quantise_settings());
        assert_eq!(told.simplify_settings(), PreparationSettings::default().simplify_settings());
        assert_eq!(told.codec(), CodecChoice::Auto);
        for bad in
            ["", "uv-bits", "uv-bits 17", "color red", "tolerance wide", "position-bits 3", "relief-depth 2"]
        {
            assert!(bad.parse::<PreparationSettings>().is_err(), "{bad}");
        }
    }
}
