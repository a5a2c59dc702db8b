//! The body of a PLY file, read number by number, text or binary.

use std::io::{self, BufRead, Read as _};
use std::path::Path;

use super::header::{Encoding, Header, NumberType};
use crate::error::ImportError;

/// Longest line of text, in bytes: a polygon of some million corners.
const MAX_LINE_BYTES: u64 = 1 << 24;

/// Reads the numbers of elements in the order of their properties.
pub(super) struct Body<'a, R> {
    path: &'a Path,
    reader: R,
    encoding: Encoding,
    /// Offset of the next byte, and length of the file.
    offset: u64,
    length: u64,
    /// For text: line number, bytes of the line, and number of bytes read.
    line: usize,
    text: Vec<u8>,
    read: usize,
    /// Lines with more than the header declares, and lines of comments; of each the first, and how many.
    excess: Option<(usize, u64)>,
    comments: Option<(usize, u64)>,
    /// The current element.
    name: &'a str,
    index: u64,
}

impl<'a, R: BufRead> Body<'a, R> {
    /// The body of a file of `length` bytes, after its header.
    pub(super) fn new(path: &'a Path, reader: R, header: &Header, length: u64) -> Self {
        let &Header { encoding, bytes: offset, lines: line, .. } = header;
        let (text, name) = (Vec::new(), "");
        let (excess, comments) = (None, None);
        Self { path, reader, encoding, offset, length, line, text, read: 0, excess, comments, name, index: 0 }
    }

    /// An error about the current element.
    pub(super) fn wrong(&self, what: impl std::fmt::Display) -> ImportError {
        let Self { path, index, offset, .. } = self;
        // The name comes from the file, and messages go to terminals.
        let name = self.name.escape_debug();
        match self.encoding {
            Encoding::Text => ImportError::line(path, self.line, format!("{name} {index}: {what}")),
            _ => ImportError::ply(path, format!("{name} {index}, before byte {offset}: {what}")),
        }
    }

    fn unreadable(&self, source: io::Error) -> ImportError {
        if source.kind() == io::ErrorKind::UnexpectedEof {
            return self.wrong("the file ends within it: it is truncated");
        }
        ImportError::Read { path: self.path.to_owned(), source }
    }

    /// Begins an element.
    pub(super) fn begin(&mut self, name: &'a str, index: u64) -> Result<(), ImportError> {
        (self.name, self.index) = (name, index);
        if self.encoding != Encoding::Text {
            return Ok(());
        }
        self.text.clear();
        while self.text.trim_ascii().is_empty() || is_comment(&self.text) {
            if is_comment(&self.text) {
                note(&mut self.comments, self.line);
            }
            self.text.clear();
            let line = self.reader.by_ref().take(MAX_LINE_BYTES).read_until(b'\n', &mut self.text);
            let read = line.map_err(|source| self.unreadable(source))? as u64;
            self.line += 1;
            match read {
                0 => return Err(self.wrong("the file ends before it: it is truncated")),
                MAX_LINE_BYTES => return Err(self.wrong(format!("a line of over {read} bytes"))),
                _ => {}
            }
        }
        self.read = 0;
        Ok(())
    }

    /// Ends an element. What else a line of text has is noted.
    pub(super) fn end(&mut self) {
        if !self.text[self.read..].trim_ascii().is_empty() {
            note(&mut self.excess, self.line);
        }
    }

    /// What was noted, for people.
    pub(super) fn notes(&self) -> impl Iterator<Item = String> {
        let excess = self.excess.map(|(line, count)| {
            format!("{count} lines have more than the header declares, which is left out (the first is line {line})")
        });
        let comments = self.comments.map(|(line, count)| {
            format!("{count} comments stand among the elements, where none belong (the first is line {line})")
        });
        excess.into_iter().chain(comments)
    }

    /// The next number.
    pub(super) fn number(&mut self, kind: NumberType) -> Result<f64, ImportError> {
        let mut bytes = [0; 8];
        let size = kind.bytes();
        if self.encoding == Encoding::Text {
            return self.word();
        }
        let read = self.reader.read_exact(&mut bytes[..size]);
        read.map_err(|source| self.unreadable(source))?;
        self.offset += size as u64;
        if self.encoding == Encoding::BigEndian {
            bytes[..size].reverse();
        }
        let (number, unused) = (u64::from_le_bytes(bytes), 64 - 8 * size as u32);
        Ok(match kind {
            NumberType::Signed(_) => ((number << unused) as i64 >> unused) as f64,
            NumberType::Unsigned(_) => number as f64,
            NumberType::Float(4) => f64::from(f32::from_bits(number as u32)),
            NumberType::Float(_) => f64::from_bits(number),
        })
    }

    fn word(&mut self) -> Result<f64, ImportError> {
        let rest = &self.text[self.read..];
        let start = rest.iter().position(|byte| !byte.is_ascii_whitespace());
        let start = start.ok_or_else(|| self.wrong("the line has fewer numbers than the header declares"))?;
        let length = rest[start..].iter().position(u8::is_ascii_whitespace).unwrap_or(rest.len() - start);
        let word = &rest[start..start + length];
        let number = str::from_utf8(word).ok().and_then(|word| word.parse().ok());
        let number = number.ok_or_else(|| {
            let shown = String::from_utf8_lossy(&word[..word.len().min(40)]).into_owned();
            self.wrong(format!("{shown:?} is not a number"))
        })?;
        self.read += start + length;
        Ok(number)
    }

    /// Length of a list of numbers, checked against the remaining bytes.
    pub(super) fn list_length(&mut self, length: NumberType, of: NumberType) -> Result<usize, ImportError> {
        let count = self.number(length)?;
        let (least, left) = match self.encoding {
            Encoding::Text => (1, (self.text.len() - self.read) as u64),
            _ => (of.bytes() as u64, self.length.saturating_sub(self.offset)),
        };
        // Below 2^32, and exact.
        if count.fract() != 0.0 || count < 0.0 || count * least as f64 > left as f64 {
            return Err(self.wrong(format!("a list of {count} numbers, but {left} bytes are left")));
        }
        Ok(count as usize)
    }
}

/// Counts a line.
fn note(noted: &mut Option<(usize, u64)>, line: usize) {
    noted.get_or_insert((line, 0)).1 += 1;
}

/// Whether a line is a comment, as the header has them or as other formats do.
fn is_comment(line: &[u8]) -> bool {
    let line = line.trim_ascii_start();
    let word = line.split(u8::is_ascii_whitespace).next().unwrap_or_default();
    line.starts_with(b"#") || matches!(word, b"comment" | b"obj_info")
}
