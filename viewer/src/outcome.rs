//! How a run ends, and what its exit code says.

use std::process::ExitCode;

/// How a run ended that was no error.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Outcome {
    /// As it was meant to: settled, or closed by the user.
    Finished,
    /// Nothing more will come, and the view lacks something.
    Incomplete,
    /// A signal of this number asked for the end.
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
            // As shells report a program that a signal ended.
            Outcome::Interrupted(signal) => Self::from(128_u8.saturating_add(signal)),
        }
    }
}

/// What a view lacks, for people: how many blobs that are damaged or refused, and the first of them; if none is, what had
/// not come when the session ended.
pub(crate) fn lacks(count: u64, first: &[impl std::fmt::Display]) -> String {
    if count == 0 {
        return "incomplete: the session ended before all that the view needs had come".to_owned();
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
    fn what_is_missing_is_named() {
        assert!(lacks(0, &[""]).contains("the session ended before"));
        assert_eq!(
            lacks(1, &["asset 2 chunk 7"]),
            "incomplete: the view lacks 1 blob that is damaged or refused (asset 2 chunk 7)"
        );
        assert_eq!(
            lacks(3, &["asset 2 chunk 7", "asset 3 base"]),
            "incomplete: the view lacks 3 blobs that are damaged or refused (asset 2 chunk 7, asset 3 base, …)"
        );
    }
}
