//! Choices among names.

use lodestream_geometry::{Codec, Metric};

use super::knob::Impossible;

const METRICS: [(Metric, &str); 2] = [(Metric::Qem, "qem"), (Metric::Melax, "melax")];

/// A metric's name.
pub(super) fn metric_name(metric: Metric) -> &'static str {
    METRICS.iter().find(|(m, _)| *m == metric).map_or("", |(_, name)| name)
}

/// A metric by its name.
///
/// # Errors
/// In one line, what names there are.
pub fn parse_metric(text: &str) -> Result<Metric, Impossible> {
    let found = METRICS.iter().find(|(_, name)| *name == text).map(|(metric, _)| *metric);
    found.ok_or_else(|| Impossible::new("qem or melax is possible", format!("{text:?}")))
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
pub fn parse_codec(text: &str) -> Result<Codec, Impossible> {
    let found = CODECS.iter().find(|(_, name)| *name == text).map(|(codec, _)| *codec);
    found.ok_or_else(|| Impossible::new("range or zstd is possible", format!("{text:?}")))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_understood_or_refused() {
        assert_eq!(parse_metric("melax"), Ok(Metric::Melax));
        assert!(parse_metric("best").is_err());
        assert_eq!(parse_codec("zstd"), Ok(Codec::Plain));
        assert!(parse_codec("plain").is_err());
        assert_eq!((metric_name(Metric::Qem), codec_name(Codec::Range)), ("qem", "range"));
    }
}
