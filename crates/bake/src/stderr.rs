//! Lines on standard error, without the panic of `eprintln!` when it is closed or its disk is full.

use std::error::Error;
use std::fmt::Arguments;
use std::io::Write as _;

/// Writes a line; ignores errors.
pub fn write_line(line: Arguments<'_>) {
    let _ = writeln!(std::io::stderr(), "{line}");
}

/// An error with its causes as one line.
#[must_use]
pub fn one_line(error: &(dyn Error + 'static)) -> String {
    let (mut line, mut next) = (String::new(), Some(error));
    while let Some(cause) = next {
        let text = cause.to_string();
        // An error whose text already ends with its cause's is not followed by it again.
        if !line.ends_with(&text) {
            if !line.is_empty() {
                line.push_str(": ");
            }
            line.push_str(&text);
        }
        next = cause.source();
    }
    line.split_whitespace().collect::<Vec<_>>().join(" ")
}
