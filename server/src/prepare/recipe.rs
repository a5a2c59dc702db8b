//! What a command line or a scene file may say about how a model is prepared.

use std::fmt;
use std::str::FromStr;

use lodestream_geometry::quantise::{self, QuantiseSettings};
use lodestream_geometry::{Codec, Metric, Settings};

use crate::scene::Precision;

/// Choices; the defaults of `geometry` where `None`.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Recipe {
    /// Precision of positions.
    pub precision: Option<Precision>,
    /// Bits per axis of texture coordinates, 1 to 16.
    pub uv_bits: Option<u8>,
    /// Largest angle, in degrees (0 to 180), of a normal to what the faces say before it is sent.
    pub normal_tolerance: Option<f64>,
    /// What a collapse is held to cost.
    pub metric: Option<Metric>,
    /// Order of collapses.
    pub round: Option<Round>,
    /// How base mesh and chunks are coded.
    pub codec: Option<Codec>,
    /// Depth of relief in units of texture coordinates, instead of what the materials say.
    pub relief_depth: Option<f32>,
}

/// Order of collapses within a region.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Round {
    /// The cheapest first.
    Heap,
    /// Rounds of collapses that share no face, each of this share of the vertices, 0.01 to 0.5.
    Share(f64),
}

impl Round {
    /// The setting of simplification: `None` for the heap.
    #[must_use]
    pub fn share(self) -> Option<f64> {
        match self {
            Self::Heap => None,
            Self::Share(share) => Some(share),
        }
    }
}

impl Recipe {
    /// These choices, with those of `other` where there are none.
    #[must_use]
    pub fn or(self, other: Self) -> Self {
        Self {
            precision: self.precision.or(other.precision),
            uv_bits: self.uv_bits.or(other.uv_bits),
            normal_tolerance: self.normal_tolerance.or(other.normal_tolerance),
            metric: self.metric.or(other.metric),
            round: self.round.or(other.round),
            codec: self.codec.or(other.codec),
            relief_depth: self.relief_depth.or(other.relief_depth),
        }
    }

    /// Settings of quantisation.
    #[must_use]
    pub fn quantise_settings(&self) -> QuantiseSettings {
        let default = QuantiseSettings::default();
        QuantiseSettings {
            precision: match self.precision {
                Some(Precision::Bits(bits)) => quantise::Precision::Bits(bits),
                Some(Precision::Tolerance(length)) => quantise::Precision::Tolerance(length),
                None => default.precision,
            },
            uv_bits: self.uv_bits.unwrap_or(default.uv_bits),
            normal_tolerance: self.normal_tolerance.unwrap_or(default.normal_tolerance),
        }
    }

    /// Settings of simplification.
    #[must_use]
    pub fn settings(&self) -> Settings {
        let default = Settings::default();
        Settings {
            metric: self.metric.unwrap_or(default.metric),
            round_share: self.round.map_or(default.round_share, Round::share),
            codec: self.codec.unwrap_or(default.codec),
            ..default
        }
    }
}

/// All settings that decide what a pack holds, the defaults among them, as `inspect` shows them.
impl fmt::Display for Recipe {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (quantise, settings) = (self.quantise_settings(), self.settings());
        match quantise.precision {
            quantise::Precision::Bits(bits) => write!(f, "position-bits {bits}")?,
            quantise::Precision::Tolerance(length) => write!(f, "tolerance {length}")?,
        }
        write!(f, ", uv-bits {}, normal-tolerance {}°", quantise.uv_bits, quantise.normal_tolerance)?;
        write!(f, ", metric {}", metric_name(settings.metric))?;
        match settings.round_share {
            None => write!(f, ", round-size heap")?,
            Some(share) => write!(f, ", round-size {share}")?,
        }
        write!(f, ", region-faces {}, codec {}", settings.region_faces, codec_name(settings.codec))?;
        self.relief_depth.map_or(Ok(()), |depth| write!(f, ", relief-depth {depth}"))
    }
}

/// Reads what [`Recipe`]'s display wrote.
impl FromStr for Recipe {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let mut recipe = Self::default();
        for item in text.split(", ") {
            let bad = |why: String| format!("{item:?}: {why}");
            let (name, value) = item.split_once(' ').ok_or_else(|| bad("no setting".into()))?;
            let number = || value.trim_end_matches('°').parse::<f64>().map_err(|e| bad(e.to_string()));
            let whole = || value.parse::<u8>().map_err(|e| bad(e.to_string()));
            match name {
                "position-bits" => recipe.precision = Some(Precision::Bits(whole()?)),
                "tolerance" => recipe.precision = Some(Precision::Tolerance(number()?)),
                "uv-bits" => recipe.uv_bits = Some(check_uv_bits(whole()?).map_err(bad)?),
                "normal-tolerance" => {
                    recipe.normal_tolerance = Some(check_normal_tolerance(number()?).map_err(bad)?);
                }
                "metric" => recipe.metric = Some(parse_metric(value).map_err(bad)?),
                "round-size" => recipe.round = Some(parse_round(value).map_err(bad)?),
                "codec" => recipe.codec = Some(parse_codec(value).map_err(bad)?),
                "relief-depth" => recipe.relief_depth = Some(number()? as f32),
                "region-faces" => {}
                _ => return Err(bad("no such setting".into())),
            }
        }
        Ok(recipe)
    }
}

const METRICS: [(Metric, &str); 2] = [(Metric::Qem, "qem"), (Metric::Melax, "melax")];

fn metric_name(metric: Metric) -> &'static str {
    METRICS.iter().find(|(m, _)| *m == metric).map_or("", |(_, name)| name)
}

/// A metric by its name.
///
/// # Errors
/// In one line, what names there are.
pub fn parse_metric(text: &str) -> Result<Metric, String> {
    let found = METRICS.iter().find(|(_, name)| *name == text).map(|(metric, _)| *metric);
    found.ok_or_else(|| "qem or melax is needed".to_owned())
}

const CODECS: [(Codec, &str); 2] = [(Codec::Range, "range"), (Codec::Plain, "zstd")];

/// A codec's name.
#[must_use]
pub fn codec_name(codec: Codec) -> &'static str {
    CODECS.iter().find(|(c, _)| *c == codec).map_or("", |(_, name)| name)
}

/// A codec by its name.
///
/// # Errors
/// In one line, what names there are.
pub fn parse_codec(text: &str) -> Result<Codec, String> {
    let found = CODECS.iter().find(|(_, name)| *name == text).map(|(codec, _)| *codec);
    found.ok_or_else(|| "range or zstd is needed".to_owned())
}

/// An order of collapses: `heap`, or a share of the vertices.
///
/// # Errors
/// In one line, what is possible.
pub fn parse_round(text: &str) -> Result<Round, String> {
    match text.parse::<f64>() {
        Ok(share) if (0.01..=0.5).contains(&share) => Ok(Round::Share(share)),
        _ if text == "heap" => Ok(Round::Heap),
        _ => Err("heap, or a share of the vertices from 0.01 to 0.5, is needed".to_owned()),
    }
}

/// Bits per axis of texture coordinates.
///
/// # Errors
/// In one line, what is possible.
pub fn check_uv_bits(bits: u8) -> Result<u8, String> {
    if (1..=16).contains(&bits) { Ok(bits) } else { Err("1 to 16 bits are possible".to_owned()) }
}

/// A tolerance of normals, in degrees.
///
/// # Errors
/// In one line, what is possible.
pub fn check_normal_tolerance(degrees: f64) -> Result<f64, String> {
    if (0.0..=180.0).contains(&degrees) {
        Ok(degrees)
    } else {
        Err("0 to 180 degrees are possible".to_owned())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn choices_come_before_defaults_and_are_told() {
        let general = Recipe { uv_bits: Some(10), normal_tolerance: Some(3.0), ..Recipe::default() };
        let own = Recipe { uv_bits: Some(9), round: Some(Round::Share(0.1)), ..Recipe::default() };
        let both = own.or(general);
        assert_eq!((both.uv_bits, both.normal_tolerance), (Some(9), Some(3.0)));
        assert_eq!(both.settings().round_share, Some(0.1));
        assert_eq!(both.quantise_settings().normal_tolerance, 3.0);
        let text = both.to_string();
        for part in [
            "position-bits 14",
            "uv-bits 9",
            "normal-tolerance 3°",
            "metric qem",
            "round-size 0.1",
            "codec range",
        ] {
            assert!(text.contains(part), "{text}");
        }
    }

    #[test]
    fn what_is_told_is_read_again() {
        let all = Recipe {
            precision: Some(Precision::Tolerance(0.1 + 0.2)),
            uv_bits: Some(9),
            normal_tolerance: Some(2.5),
            metric: Some(Metric::Melax),
            round: Some(Round::Share(0.1)),
            codec: Some(Codec::Plain),
            relief_depth: Some(0.1),
        };
        assert_eq!(all.to_string().parse(), Ok(all));
        let told: Recipe = Recipe::default().to_string().parse().unwrap();
        assert_eq!(told.quantise_settings(), Recipe::default().quantise_settings());
        assert_eq!(told.settings(), Recipe::default().settings());
        for bad in ["", "uv-bits", "uv-bits 17", "color red", "tolerance wide"] {
            assert!(bad.parse::<Recipe>().is_err(), "{bad}");
        }
    }

    #[test]
    fn words_of_the_command_line_are_understood_or_refused() {
        assert_eq!(parse_metric("melax"), Ok(Metric::Melax));
        assert!(parse_metric("best").is_err());
        assert_eq!(parse_codec("zstd"), Ok(Codec::Plain));
        assert!(parse_codec("plain").is_err());
        assert_eq!(parse_round("heap"), Ok(Round::Heap));
        assert_eq!(parse_round("0.2"), Ok(Round::Share(0.2)));
        for bad in ["0", "0.6", "nan", "some"] {
            assert!(parse_round(bad).is_err(), "{bad}");
        }
        assert!(check_uv_bits(0).is_err() && check_uv_bits(17).is_err() && check_uv_bits(16).is_ok());
        assert!(check_normal_tolerance(f64::NAN).is_err() && check_normal_tolerance(180.0).is_ok());
    }
}
