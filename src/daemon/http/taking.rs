//! Closes the connection of a client that does not read its answer: what waits for it is memory of ours.

use std::io;
use std::pin::Pin;
use std::task::{Context, Poll, ready};
use std::time::Duration;
use tokio::io::{AsyncRead, AsyncWrite, ReadBuf};
use tokio::time::{Instant, Sleep, sleep};

/// Bytes that share one time limit: a large answer is made in pieces of at most this size.
pub const PIECE_BYTES: usize = 64 * 1024;

/// A connection whose client has to read each piece in time. While nothing waits for it there is no limit.
#[derive(Debug)]
pub(super) struct WriteTimeout<S> {
    stream: S,
    within: Duration,
    /// The time limit of the current piece, and how much the client has read of it.
    waiting: Option<(Pin<Box<Sleep>>, usize)>,
}

impl<S> WriteTimeout<S> {
    /// A connection over `stream`, with `within` for each piece.
    pub(super) const fn new(stream: S, within: Duration) -> Self {
        Self {
            stream,
            within,
            waiting: None,
        }
    }

    /// The client has read `bytes`.
    fn took(&mut self, bytes: usize) {
        if let Some((until, taken)) = &mut self.waiting {
            *taken += bytes;
            if *taken >= PIECE_BYTES {
                *taken = 0;
                until.as_mut().reset(Instant::now() + self.within);
            }
        }
    }

    /// The client has to read something first.
    fn poll_late<T>(&mut self, context: &mut Context<'_>) -> Poll<io::Result<T>> {
        let within = self.within;
        let (until, _) = self
            .waiting
            .get_or_insert_with(|| (Box::pin(sleep(within)), 0));
        ready!(until.as_mut().poll(context));
        tracing::info!("HTTP client does not read its response; disconnected");
        Poll::Ready(Err(io::ErrorKind::TimedOut.into()))
    }
}

impl<S: AsyncRead + Unpin> AsyncRead for WriteTimeout<S> {
    fn poll_read(
        mut self: Pin<&mut Self>,
        cx: &mut Context<'_>,
        buffer: &mut ReadBuf<'_>,
    ) -> Poll<io::Result<()>> {
        Pin::new(&mut self.stream).poll_read(cx, buffer)
    }
}

impl<S: AsyncWrite + Unpin> AsyncWrite for WriteTimeout<S> {
    fn poll_write(
        mut self: Pin<&mut Self>,
        cx: &mut Context<'_>,
        bytes: &[u8],
    ) -> Poll<io::Result<usize>> {
        match Pin::new(&mut self.stream).poll_write(cx, bytes) {
            Poll::Ready(Ok(taken)) => {
                self.took(taken);
                Poll::Ready(Ok(taken))
            }
            Poll::Ready(Err(error)) => Poll::Ready(Err(error)),
            Poll::Pending => self.poll_late(cx),
        }
    }

    fn poll_write_vectored(
        mut self: Pin<&mut Self>,
        cx: &mut Context<'_>,
        bytes: &[io::IoSlice<'_>],
    ) -> Poll<io::Result<usize>> {
        match Pin::new(&mut self.stream).poll_write_vectored(cx, bytes) {
            Poll::Ready(Ok(taken)) => {
                self.took(taken);
                Poll::Ready(Ok(taken))
            }
            Poll::Ready(Err(error)) => Poll::Ready(Err(error)),
            Poll::Pending => self.poll_late(cx),
        }
    }

    fn is_write_vectored(&self) -> bool {
        self.stream.is_write_vectored()
    }

    fn poll_flush(mut self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<io::Result<()>> {
        // Flushing is requested when nothing is left to be written.
        match Pin::new(&mut self.stream).poll_flush(cx) {
            Poll::Ready(done) => {
                self.waiting = None;
                Poll::Ready(done)
            }
            Poll::Pending => self.poll_late(cx),
        }
    }

    fn poll_shutdown(mut self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<io::Result<()>> {
        match Pin::new(&mut self.stream).poll_shutdown(cx) {
            Poll::Ready(done) => Poll::Ready(done),
            Poll::Pending => self.poll_late(cx),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use tokio::io::{AsyncReadExt, AsyncWriteExt, duplex};

    const WITHIN: Duration = Duration::from_secs(10);

    #[tokio::test(start_paused = true)]
    async fn who_takes_nothing_is_let_go_and_who_has_nothing_to_take_is_not() {
        let (ours, mut client) = duplex(1024);
        let mut ours = WriteTimeout::new(ours, WITHIN);
        ours.write_all(&[1; 1024]).await.unwrap();
        ours.flush().await.unwrap();
        tokio::time::sleep(WITHIN * 10).await;
        client.read_exact(&mut [0; 1024]).await.unwrap();
        let began = Instant::now();
        let refused = ours.write_all(&[1; 2048]).await.unwrap_err();
        assert_eq!(
            (refused.kind(), Instant::now() - began),
            (io::ErrorKind::TimedOut, WITHIN)
        );
    }

    #[tokio::test(start_paused = true)]
    async fn drops_now_and_then_are_not_enough_and_a_piece_in_time_is() {
        for (bytes, is_let_go) in [(PIECE_BYTES / 4, true), (PIECE_BYTES / 2, false)] {
            let (ours, mut client) = duplex(PIECE_BYTES);
            let reader = tokio::spawn(async move {
                let mut buffer = vec![0; bytes];
                while client.read_exact(&mut buffer).await.is_ok() {
                    tokio::time::sleep(WITHIN / 2).await;
                }
            });
            let mut ours = WriteTimeout::new(ours, WITHIN + Duration::from_millis(1));
            let written = async {
                ours.write_all(&vec![1; PIECE_BYTES * 5]).await?;
                ours.flush().await
            };
            assert_eq!(
                written.await.is_err(),
                is_let_go,
                "{bytes} bytes in {:?}",
                WITHIN / 2
            );
            drop(ours);
            reader.await.unwrap();
        }
    }
}
