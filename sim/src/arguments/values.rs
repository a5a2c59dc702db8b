//! Parsers of values on the command line.

use lodestream_scenario::plan::Transport;

/// Parses a transport.
pub(crate) fn transport(text: &str) -> Result<Transport, String> {
    match text {
        "quic" => Ok(Transport::Quic),
        "ws" => Ok(Transport::Ws),
        _ => Err("quic or ws is needed".to_owned()),
    }
}

/// Parses a screen error.
pub(crate) fn target_px(text: &str) -> Result<f32, String> {
    match text.parse::<f32>() {
        Ok(px) if (0.01..=1000.0).contains(&px) => Ok(px),
        _ => Err("a screen error from 0.01 to 1000 pixels is needed".to_owned()),
    }
}
