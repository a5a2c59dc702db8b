//! The bytes of a file, of which parts are read where they are needed.

use std::fmt;
use std::fs::File;
use std::io::{self, Read as _, Seek as _, SeekFrom};
use std::ops::Range;
use std::path::Path;
use std::sync::{Mutex, PoisonError};

use bytes::Bytes;

use crate::error::ImportError;
use crate::file::{MAX_FILE_BYTES, check_file};

/// The bytes of a file. Threads share it.
pub trait Content: fmt::Debug + Send + Sync {
    /// Length of the file.
    fn length(&self) -> u64;

    /// The bytes of a range. What is returned may keep a block of the file in memory: copy what is kept for long.
    ///
    /// # Errors
    /// A file that cannot be read, or no longer has these bytes.
    fn read(&self, range: Range<u64>) -> io::Result<Bytes>;
}

impl Content for Bytes {
    fn length(&self) -> u64 {
        self.len() as u64
    }

    fn read(&self, range: Range<u64>) -> io::Result<Bytes> {
        let of = |at: u64| usize::try_from(at).ok().filter(|&at| at <= self.len());
        match (of(range.start), of(range.end)) {
            (Some(start), Some(end)) if start <= end => Ok(self.slice(start..end)),
            _ => Err(io::ErrorKind::UnexpectedEof.into()),
        }
    }
}

/// An open file. One that is replaced by another of its name stays readable.
#[derive(Debug)]
pub(crate) struct OpenFile {
    file: Mutex<File>,
    length: u64,
}

impl OpenFile {
    /// # Errors
    /// As [`read_file`](crate::read_file).
    pub(crate) fn new(path: &Path) -> Result<Self, ImportError> {
        let length = check_file(path, MAX_FILE_BYTES)?;
        let file = File::open(path).map_err(|source| ImportError::Read { path: path.to_owned(), source })?;
        Ok(Self { file: Mutex::new(file), length })
    }
}

impl Content for OpenFile {
    fn length(&self) -> u64 {
        self.length
    }

    fn read(&self, range: Range<u64>) -> io::Result<Bytes> {
        // Reserves no more than the file had.
        if range.start > range.end || range.end > self.length {
            return Err(io::ErrorKind::UnexpectedEof.into());
        }
        let length = usize::try_from(range.end - range.start).map_err(io::Error::other)?;
        let mut bytes = vec![0; length];
        let mut file = self.file.lock().unwrap_or_else(PoisonError::into_inner);
        file.seek(SeekFrom::Start(range.start))?;
        file.read_exact(&mut bytes)?;
        Ok(bytes.into())
    }
}
