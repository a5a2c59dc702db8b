//! Ranges of files in a folder.

use std::fs::File;
use std::io::{Read as _, Seek as _, SeekFrom};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use bytes::Bytes;
use tokio::task::spawn_blocking;

use super::{Fetch, Report, Reports, Tasks};
use crate::ranges::{ContentRange, Object, RangeRequest, ResponseHead};

/// Reads a published scene from files.
#[derive(Debug)]
pub(in crate::net) struct FileFetch {
    scene: PathBuf,
    received: Arc<AtomicU64>,
    tasks: Tasks,
}

impl FileFetch {
    pub(in crate::net) fn new(scene: PathBuf) -> Self {
        Self { scene, received: Arc::default(), tasks: Tasks::default() }
    }

    fn path(&self, object: &Object) -> PathBuf {
        match object.name() {
            None => self.scene.clone(),
            Some(name) => self.scene.parent().unwrap_or(Path::new("")).join(name),
        }
    }
}

impl Fetch for FileFetch {
    fn start(&mut self, request: RangeRequest, reports: Reports) {
        let (path, received, id) = (self.path(&request.object), Arc::clone(&self.received), request.id);
        self.tasks.start(id, async move {
            let read = spawn_blocking(move || read(&path, &request)).await;
            let read = read.unwrap_or_else(|why| Err(std::io::Error::other(why)));
            let _ = match read {
                Ok((head, bytes)) => {
                    received.fetch_add(bytes.len() as u64, Ordering::Relaxed);
                    let _ = reports.send((id, Report::Head(head))).await;
                    let _ = reports.send((id, Report::Body(bytes))).await;
                    reports.send((id, Report::End)).await
                }
                Err(why) => reports.send((id, Report::Failed(why.to_string()))).await,
            };
        });
    }

    fn abort(&mut self, id: u64) {
        self.tasks.abort(id);
    }

    fn ended(&mut self, id: u64) {
        self.tasks.abort(id);
    }

    fn received_bytes(&self) -> u64 {
        self.received.load(Ordering::Relaxed)
    }
}

/// Reads a range; answers as a web server would.
fn read(path: &Path, request: &RangeRequest) -> std::io::Result<(ResponseHead, Bytes)> {
    let head = |status, content_range| ResponseHead { status, content_range, encoded: false };
    let mut file = match File::open(path) {
        Ok(file) => file,
        Err(why) if why.kind() == std::io::ErrorKind::NotFound => return Ok((head(404, None), Bytes::new())),
        Err(why) => return Err(why),
    };
    let total = file.metadata()?.len();
    let range = request.range.start..request.range.end.min(total);
    if range.is_empty() {
        return Ok((head(416, None), Bytes::new()));
    }
    file.seek(SeekFrom::Start(range.start))?;
    let mut bytes = Vec::new();
    file.take(range.end - range.start).read_to_end(&mut bytes)?;
    Ok((head(206, Some(ContentRange { range, total: Some(total) })), bytes.into()))
}
