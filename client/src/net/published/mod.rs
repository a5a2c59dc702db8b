//! Published scenes: requests for byte ranges of files, from a web server or a folder.

mod drive;
mod file;
mod http;
mod target;

use std::collections::BTreeMap;

use bytes::Bytes;
use tokio::sync::mpsc;
use tokio::task::AbortHandle;

use crate::ranges::{RangeRequest, ResponseHead};

pub use drive::run_published;
pub(super) use file::FileFetch;
pub(super) use http::HttpFetch;
pub(super) use target::{Origin, Target};

/// What a fetch reports.
#[derive(Debug)]
pub enum Report {
    /// The head of a response.
    Head(ResponseHead),
    /// Bytes of its body.
    Body(Bytes),
    /// The end of its body.
    End,
    /// The request failed; another one may not.
    Failed(String),
    /// The request failed for a reason that stays, such as a certificate that is not trusted.
    Refused(String),
}

/// Reports of all fetches, each with the request's number.
pub type Reports = mpsc::Sender<(u64, Report)>;

/// Makes range requests.
pub trait Fetch {
    /// Starts a request, which reports what arrives.
    fn start(&mut self, request: RangeRequest, reports: Reports);

    /// Aborts a request.
    fn abort(&mut self, id: u64);

    /// Forgets a request that has ended.
    fn ended(&mut self, id: u64) {
        let _ = id;
    }

    /// Transport payload received so far.
    fn received_bytes(&self) -> u64;
}

/// Tasks of requests that have not ended; dropping them aborts them.
#[derive(Debug, Default)]
struct Tasks(BTreeMap<u64, AbortHandle>);

impl Tasks {
    fn start(&mut self, id: u64, task: impl Future<Output = ()> + Send + 'static) {
        self.0.insert(id, tokio::spawn(task).abort_handle());
    }

    fn abort(&mut self, id: u64) {
        if let Some(task) = self.0.remove(&id) {
            task.abort();
        }
    }
}

impl Drop for Tasks {
    fn drop(&mut self) {
        self.0.values().for_each(AbortHandle::abort);
    }
}
