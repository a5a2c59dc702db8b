//! A byte stream whose reads are counted, or limited.

use std::io;
use std::pin::Pin;
use std::task::{Context, Poll};

use tokio::io::{AsyncRead, AsyncWrite, ReadBuf};

/// Sees the reads of an [`ObservedStream`].
pub trait ReadObserver: Unpin {
    /// Called before each read.
    ///
    /// # Errors
    /// The read fails with this error. Bytes already read have been delivered.
    fn before_read(&mut self) -> io::Result<()> {
        Ok(())
    }

    /// Called after each read, with the number of bytes.
    fn after_read(&mut self, count: usize);
}

/// A stream whose reads an observer sees; writes pass unchanged.
#[derive(Debug)]
pub struct ObservedStream<S, O> {
    stream: S,
    observer: O,
}

impl<S, O> ObservedStream<S, O> {
    /// Wraps a stream.
    pub const fn new(stream: S, observer: O) -> Self {
        Self { stream, observer }
    }
}

impl<S: AsyncRead + Unpin, O: ReadObserver> AsyncRead for ObservedStream<S, O> {
    fn poll_read(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
        buffer: &mut ReadBuf<'_>,
    ) -> Poll<io::Result<()>> {
        self.observer.before_read()?;
        let before = buffer.filled().len();
        let polled = Pin::new(&mut self.stream).poll_read(context, buffer);
        self.observer.after_read(buffer.filled().len() - before);
        polled
    }
}

impl<S: AsyncWrite + Unpin, O: Unpin> AsyncWrite for ObservedStream<S, O> {
    fn poll_write(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
        bytes: &[u8],
    ) -> Poll<io::Result<usize>> {
        Pin::new(&mut self.stream).poll_write(context, bytes)
    }

    fn poll_flush(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<io::Result<()>> {
        Pin::new(&mut self.stream).poll_flush(context)
    }

    fn poll_shutdown(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<io::Result<()>> {
        Pin::new(&mut self.stream).poll_shutdown(context)
    }
}
