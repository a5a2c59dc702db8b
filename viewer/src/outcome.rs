//! Outcomes of a run, their exit codes and messages.

use std::process::ExitCode;

use lodestream_client::net::End;
use lodestream_protocol::message::CloseCode;

/// Outcome of a run that was not an error.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Outcome {
    /// Settled, or closed by the user.
    Finished,
    /// The view lacks blobs that will not arrive.
    Incomplete,
    /// Ended by the signal of this number.
    Interrupted(u8),
}

/// Exit codes, for `--help`.
pub(crate) const EXIT_CODES: &str = "Exit codes: 0 settled, or closed; 2 an error; 3 the picture is incomplete, since \
                                     blobs are damaged or refused; 130, 143 interrupted or terminated";

impl From<Outcome> for ExitCode {
    fn from(outcome: Outcome) -> Self {
        match outcome {
            Outcome::Finished => Self::SUCCESS,
            Outcome::Incomplete => Self::from(3),
            // The convention of shells for a program that a signal has ended.
            Outcome::Interrupted(signal) => Self::from(128_u8.saturating_add(signal)),
        }
    }
}

/// Why streaming ended, with the command line flags that help.
pub(crate) fn describe_end(end: &End) -> String {
    match end {
        End::Closed(close) if close.code == CloseCode::Unauthorised => {
            format!("{end}, and pass it with --token-file FILE")
        }
        _ => end.to_string(),
    }
}

/// Describes an incomplete picture: how many blobs are damaged or refused, and the first of them. With a count of 0,
/// the session ended too early.
pub(crate) fn describe_missing(count: u64, first: &[impl std::fmt::Display]) -> String {
    if count == 0 {
        return "incomplete: the session ended before everything in view had arrived".to_owned();
    }
    let names: Vec<String> = first.iter().map(ToString::to_string).collect();
    let more = if count > first.len() as u64 { ", …" } else { "" };
    let blobs = if count == 1 { "blob that is" } else { "blobs that are" };
    format!("incomplete: the view lacks {count} {blobs} damaged or refused ({}{more})", names.join(", "))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn missing_blobs_are_named() {
        assert!(describe_missing(0, &[""]).contains("the session ended before"));
        assert_eq!(
            describe_missing(1, &["asset 2 chunk 7"]),
            "incomplete: the view lacks 1 blob that is damaged or refused (asset 2 chunk 7)"
        );
        assert_eq!(
            describe_missing(3, &["asset 2 chunk 7", "asset 3 base"]),
            "incomplete: the view lacks 3 blobs that are damaged or refused (asset 2 chunk 7, asset 3 base, …)"
        );
    }
}
