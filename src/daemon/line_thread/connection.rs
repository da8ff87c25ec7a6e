//! The connection to a Modbus TCP server that closes it, as some do after each reply or when it was idle for a while. That is
//! no lost line: the next request makes a new connection. Only if there is none, or if the server closes one over which
//! nothing came, the line is down.

use super::opening::PortlessOutcome;
use super::{LineTask, ServerConnection};
use crate::config::PortAddress;
use crate::daemon::host::clock;
use crate::daemon::port::{OpenPort, PortOpener};
use crate::gateway::LineInput;
use std::io;
use std::pin::pin;
use std::time::Duration;

/// Longest wait for another connection: long enough for a lost first packet, which is repeated after 1 s.
const CONNECT_WITHIN: Duration = Duration::from_secs(2);

impl LineTask<'_> {
    /// The port was opened.
    pub(super) fn connection_opened(&mut self) {
        self.connection = ServerConnection {
            replies_before: self.core.counters().replies,
            ..ServerConnection::default()
        };
    }

    /// Sends a frame.
    pub(super) fn transmit(&mut self, device: &mut OpenPort, frame: &[u8]) -> io::Result<()> {
        if !self.core.may_transmit(clock::now()) {
            return Ok(());
        }
        match device.write_frame(frame) {
            // The system has sent nothing of it.
            Err(error) if self.is_only_closed(&error) => self.let_go(device),
            sent => {
                sent?;
                self.core.transmitted(clock::now());
            }
        }
        Ok(())
    }

    /// Makes another connection once a frame is due. Only then is decided which: messages are taken meanwhile, and what was
    /// due may be too late by then.
    pub(super) async fn connect_again(
        &mut self,
        device: &mut OpenPort,
        opener: &mut PortOpener<'_>,
    ) -> io::Result<()> {
        let now = clock::now();
        if self.core.connects_at().is_none_or(|at| at > now) {
            return Ok(());
        }
        let opened = {
            let mut opening = pin!(opener.open());
            self.meanwhile(now + CONNECT_WITHIN, |cx| opening.as_mut().poll(cx))
                .await?
        };
        let gone = |why: String| io::Error::new(io::ErrorKind::ConnectionReset, why);
        *device = match opened {
            PortlessOutcome::Done(Ok(device)) => device,
            PortlessOutcome::Done(Err(error)) => return Err(gone(opener.explain(&error))),
            PortlessOutcome::TimeIsUp => {
                return Err(gone(
                    "the server does not accept another connection in time".to_owned(),
                ));
            }
            PortlessOutcome::Ended => return Ok(()),
        };
        self.connection.replies_before = self.core.counters().replies;
        self.take_messages();
        self.core.handle(clock::now(), LineInput::ConnectionBack);
        self.core.handle(clock::now(), LineInput::Time);
        self.act(Some(device))
    }

    /// Whether `error` only means that the server has closed a connection over which it had replied.
    pub(super) fn is_only_closed(&self, error: &io::Error) -> bool {
        use io::ErrorKind::{BrokenPipe, ConnectionAborted, ConnectionReset, UnexpectedEof};
        let is_server = matches!(self.port.settings.address, PortAddress::ModbusTcp { .. });
        let is_closed = matches!(
            error.kind(),
            UnexpectedEof | ConnectionReset | ConnectionAborted | BrokenPipe
        );
        is_server && is_closed && self.replies_on_connection() > 0
    }

    /// The server has closed the connection: the next frame makes another one.
    pub(super) fn let_go(&mut self, device: &mut OpenPort) {
        self.part(device);
        let line = &self.port.line;
        if self.replies_on_connection() == 1
            && !std::mem::replace(&mut self.connection.closes_each, true)
        {
            tracing::info!(
                line,
                "server closes the connection after each reply; each request makes a new one"
            );
        } else {
            tracing::debug!(
                line,
                "server has closed the connection; the next request makes a new one"
            );
        }
    }

    /// Closes a connection before its server does, which could lose the next request.
    pub(super) fn close_after_reply(&mut self, device: &mut OpenPort) {
        if self.connection.closes_each
            && !device.is_parked()
            && self.replies_on_connection() > 0
            && !self.core.awaits_reply()
        {
            self.part(device);
        }
    }

    fn part(&mut self, device: &mut OpenPort) {
        device.park();
        self.core.handle(clock::now(), LineInput::ConnectionClosed);
    }

    fn replies_on_connection(&self) -> u64 {
        self.core
            .counters()
            .replies
            .saturating_sub(self.connection.replies_before)
    }
}
