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

/// Results that are printed one by one as text, or together as a list in JSON.
pub(crate) struct Results<T> {
    json: bool,
    all: Vec<T>,
}

impl<T: Display + Serialize> Results<T> {
    /// No results yet.
    pub(crate) fn new(json: bool) -> Self {
        Self { json, all: Vec::new() }
    }

    /// Adds a result.
    pub(crate) fn push(&mut self, result: T) {
        if !self.json {
            println!("{result}");
        }
        self.all.push(result);
    }

    /// Ends the list, and returns it.
    pub(crate) fn finish(self) -> anyhow::Result<Vec<T>> {
        if self.json {
            println!("{}", serde_json::to_string(&self.all)?);
        }
        Ok(self.all)
    }
}
