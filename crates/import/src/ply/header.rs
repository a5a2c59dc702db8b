//! The header of a PLY file: lines of text that declare elements and their properties.

use std::io::{BufRead, Read as _};
use std::path::Path;

use crate::error::ImportError;

/// Longest header, in bytes; headers of scanners have some kB of comments.
const MAX_HEADER_BYTES: u64 = 1 << 18;
/// Most elements of one kind: indices must fit `u32`, with room for a "none" mark.
const MAX_ELEMENTS: u64 = u32::MAX as u64 - 1;

/// Encoding of the body.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Encoding {
    Text,
    LittleEndian,
    BigEndian,
}

/// Type of a number, with its size in bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum NumberType {
    Signed(usize),
    Unsigned(usize),
    Float(usize),
}

impl NumberType {
    pub(super) fn named(name: &str) -> Result<Self, PropertyError> {
        Ok(match name {
            "char" | "int8" => Self::Signed(1),
            "uchar" | "uint8" => Self::Unsigned(1),
            "short" | "int16" => Self::Signed(2),
            "ushort" | "uint16" => Self::Unsigned(2),
            "int" | "int32" => Self::Signed(4),
            "uint" | "uint32" => Self::Unsigned(4),
            "float" | "float32" => Self::Float(4),
            "double" | "float64" => Self::Float(8),
            _ => return Err(PropertyError::Type(name.to_owned())),
        })
    }

    pub(super) const fn bytes(self) -> usize {
        let (Self::Signed(bytes) | Self::Unsigned(bytes) | Self::Float(bytes)) = self;
        bytes
    }

    pub(super) const fn is_integer(self) -> bool {
        !matches!(self, Self::Float(_))
    }

    /// The value that represents 1 in a colour component of the type.
    pub(super) fn unit_value(self) -> f64 {
        match self {
            Self::Signed(bytes) => 128.0 * 256_f64.powi(bytes as i32 - 1) - 1.0,
            Self::Unsigned(bytes) => 256_f64.powi(bytes as i32) - 1.0,
            Self::Float(_) => 1.0,
        }
    }
}

/// A number of each element, or a list of numbers with the type of its length.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Property {
    pub(super) name: String,
    pub(super) length: Option<NumberType>,
    pub(super) kind: NumberType,
}

/// Declaration of an element.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Element {
    pub(super) name: String,
    pub(super) count: u64,
    pub(super) properties: Vec<Property>,
    /// Line of the declaration.
    pub(super) line: usize,
}

/// Declarations of a PLY file.
#[derive(Debug)]
pub(super) struct Header {
    pub(super) encoding: Encoding,
    pub(super) elements: Vec<Element>,
    /// Textures of `TextureFile` comments, as MeshLab and photogrammetry programs write them; by their number.
    pub(super) textures: Vec<String>,
    pub(super) lines: usize,
    pub(super) bytes: u64,
}

impl Header {
    /// Reads the header, and nothing beyond it.
    pub(super) fn read(path: &Path, reader: &mut impl BufRead) -> Result<Self, ImportError> {
        let mut header =
            Self { encoding: Encoding::Text, elements: Vec::new(), textures: Vec::new(), lines: 0, bytes: 0 };
        let (mut line, mut encoding) = (Vec::new(), None);
        loop {
            line.clear();
            let read = reader.by_ref().take(MAX_HEADER_BYTES - header.bytes).read_until(b'\n', &mut line);
            header.bytes +=
                read.map_err(|source| ImportError::Read { path: path.to_owned(), source })? as u64;
            header.lines += 1;
            let at = header.lines;
            let wrong = |what: String| ImportError::line(path, at, what);
            if at == 1 && line.trim_ascii_end() != b"ply" {
                return Err(wrong("is not a PLY file: its first line is not \"ply\"".to_owned()));
            }
            if line.last() != Some(&b'\n') {
                return Err(wrong(format!(
                    "the header has no end: no line end_header within {} bytes",
                    header.bytes
                )));
            }
            let text = String::from_utf8_lossy(&line);
            let words: Vec<&str> = text.split_ascii_whitespace().collect();
            match words[..] {
                [] | ["ply" | "obj_info", ..] => {}
                ["comment", "TextureFile", ..] => {
                    let name = text.split_once("TextureFile").map(|(_, name)| name.trim().to_owned());
                    header.textures.extend(name);
                }
                ["comment", ..] => {}
                ["format", name, "1.0"] => {
                    encoding = Some(match name {
                        "ascii" => Encoding::Text,
                        "binary_little_endian" => Encoding::LittleEndian,
                        "binary_big_endian" => Encoding::BigEndian,
                        _ => return Err(wrong(format!("there is no format {name:?}"))),
                    });
                }
                ["element", name, count] => {
                    let count: u64 = count.parse().map_err(|_| wrong(format!("{count:?} is not a count")))?;
                    if count > MAX_ELEMENTS {
                        return Err(wrong(format!("{count} elements; at most {MAX_ELEMENTS} are supported")));
                    }
                    let (name, properties) = (name.to_owned(), Vec::new());
                    header.elements.push(Element { name, count, properties, line: at });
                }
                ["property", ref rest @ ..] => {
                    let property = property(rest).map_err(|why| wrong(why.to_string()))?;
                    let element = header.elements.last_mut();
                    let element = element.ok_or_else(|| wrong("a property of no element".to_owned()))?;
                    element.properties.push(property);
                }
                ["end_header"] => break,
                _ => {
                    let what =
                        "is not one of format (version 1.0), element, property, comment and end_header";
                    return Err(wrong(format!("{:?} {what}", text.trim_ascii())));
                }
            }
        }
        let lacks = || ImportError::line(path, header.lines, "the header names no format");
        header.encoding = encoding.ok_or_else(lacks)?;
        Ok(header)
    }

    /// Checks counts against the bytes that follow, before memory is reserved.
    pub(super) fn check_counts(&self, path: &Path, file_bytes: u64) -> Result<(), ImportError> {
        let follow = file_bytes.saturating_sub(self.bytes);
        let mut needed = 0_u64;
        for element in &self.elements {
            let least = |property: &Property| match self.encoding {
                // A digit and a separator.
                Encoding::Text => 2,
                _ => property.length.unwrap_or(property.kind).bytes() as u64,
            };
            let each: u64 = element.properties.iter().map(least).sum();
            needed = needed.saturating_add(element.count.saturating_mul(each));
            // The last line of a text may have no end.
            if needed > follow + u64::from(self.encoding == Encoding::Text) {
                let Element { name, count, line, .. } = element;
                let what = format!(
                    "{count} elements {name:?} and those before them take at least {needed} bytes, but {follow} follow: the \
                     file is truncated, or its header is wrong"
                );
                return Err(ImportError::line(path, *line, what));
            }
        }
        Ok(())
    }
}

/// A property that is not declared as it should be.
#[derive(Debug, thiserror::Error)]
pub(super) enum PropertyError {
    #[error("there is no type {0:?}")]
    Type(String),
    #[error("a property is TYPE NAME or list TYPE TYPE NAME")]
    Words,
    #[error("the list {0:?} has a length that is not an integer")]
    Length(String),
}

/// Parses the words after `property`.
fn property(words: &[&str]) -> Result<Property, PropertyError> {
    let (length, of, name) = match *words {
        ["list", length, of, name] => (Some(NumberType::named(length)?), of, name),
        [of, name] => (None, of, name),
        _ => return Err(PropertyError::Words),
    };
    if length.is_some_and(|length| !length.is_integer()) {
        return Err(PropertyError::Length(name.to_owned()));
    }
    Ok(Property { name: name.to_owned(), length, kind: NumberType::named(of)? })
}
