//! Lines on standard error, without the panic of `eprintln!` when it is closed or its disk is full.

use std::fmt::Arguments;
use std::io::Write as _;

/// Writes a line; ignores errors.
pub fn write_line(line: Arguments<'_>) {
    let _ = writeln!(std::io::stderr(), "{line}");
}
