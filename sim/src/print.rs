//! Prints results on standard output.

use std::fmt::Display;

use serde::Serialize;

/// Prints one line of JSON, or text.
pub(crate) fn print<T: Display + Serialize>(result: &T, json: bool) -> anyhow::Result<()> {
    if json {
        println!("{}", serde_json::to_string(result)?);
    } else {
        println!("{result}");
    }
    Ok(())
}
