//! Published scenes: requests for byte ranges of files, from a web server or a folder.

mod drive;
mod file;
mod http;
mod target;

use bytes::Bytes;
use tokio::sync::mpsc;
use tokio::task::AbortHandle;

use crate::ranges::{RangeRequest, ResponseHead};

pub use drive::run_published;
pub(super) use file::FileFetch;
pub(super) use http::Sockets;
pub use http::{Connect, HttpFetch, HttpStream};
pub use target::{Origin, Target};

/// What a fetch reports.
#[derive(Debug)]
pub enum Report {
    /// The head of a response.
    Head(ResponseHead),
    /// Bytes of its body.
    Body(Bytes),
    /// The end of its body.
    End,
    /// The request failed.
    Failed(String),
}

/// Reports of all fetches, each with the request's number.
pub type Reports = mpsc::Sender<(u64, Report)>;

/// Makes range requests.
pub trait Fetch {
    /// Starts a request, which reports what arrives. Aborting it gives up its connection.
    fn start(&mut self, request: RangeRequest, reports: Reports) -> AbortHandle;

    /// Transport payload received so far.
    fn received_bytes(&self) -> u64;
}
