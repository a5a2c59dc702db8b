//! Lines for people on standard error. It may be closed, or a file on a disk that is full: `eprintln!` would panic.

use std::fmt::Arguments;
use std::io::Write as _;

/// Writes a line; where it cannot be written, nobody is told.
pub fn write_line(line: Arguments<'_>) {
    let _ = writeln!(std::io::stderr(), "{line}");
}
