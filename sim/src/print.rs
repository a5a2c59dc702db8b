//! Results on standard output.

use std::fmt::Display;

use serde::Serialize;

/// As one line of JSON, or for people.
pub(crate) fn print<T: Display + Serialize>(result: &T, json: bool) -> anyhow::Result<()> {
    if json {
        println!("{}", serde_json::to_string(result)?);
    } else {
        println!("{result}");
    }
    Ok(())
}
