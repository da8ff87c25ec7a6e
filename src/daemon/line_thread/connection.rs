//! The connection to a Modbus TCP server that closes it, as some do after each reply or when it was idle for a while. That is
//! no lost line: the next request makes a new connection. Only if there is none, or if the server closes one over which
//! nothing came, the line is down.

use super::{Connection, LineTask};
use crate::config::PortAddress;
use crate::daemon::host::clock;
use crate::daemon::port::{Opener, Port};
use std::io;
use std::time::Duration;
use tokio::time::timeout;

/// Longest wait for another connection. Nothing else is done on the line meanwhile, as during an exchange.
const CONNECT_WITHIN: Duration = Duration::from_secs(1);

impl LineTask<'_> {
    /// The port was opened.
    pub(super) fn connection_opened(&mut self) {
        self.connection = Connection { replies_before: self.core.counters().replies, ..Connection::default() };
    }

    /// Sends a frame, or keeps it for the next connection.
    pub(super) fn transmit(&mut self, device: &mut Port, frame: Vec<u8>) -> io::Result<()> {
        if device.is_parked() {
            self.connection.unsent = Some(frame);
            return Ok(());
        }
        if !self.core.may_transmit(clock::now()) {
            return Ok(());
        }
        match device.write_frame(&frame) {
            // The system has sent nothing of it.
            Err(error) if self.is_only_closed(&error) => {
                self.let_go(device);
                self.connection.unsent = Some(frame);
            }
            sent => {
                sent?;
                self.core.transmitted(clock::now());
            }
        }
        Ok(())
    }

    /// Makes another connection for the frame that waits for one.
    pub(super) async fn send_over_another(&mut self, device: &mut Port, opener: &mut Opener<'_>) -> io::Result<()> {
        let Some(frame) = self.connection.unsent.take() else { return Ok(()) };
        let gone = |why: String| io::Error::new(io::ErrorKind::ConnectionReset, why);
        let opened = timeout(CONNECT_WITHIN, opener.open()).await;
        let opened = opened.map_err(|_| gone("the server does not accept another connection in time".to_owned()))?;
        *device = opened.map_err(|error| gone(opener.explain(&error)))?;
        self.connection.replies_before = self.core.counters().replies;
        if self.core.may_transmit(clock::now()) {
            device.write_frame(&frame)?;
            self.core.transmitted(clock::now());
        }
        Ok(())
    }

    /// Whether `error` only means that the server has closed a connection over which it had replied.
    pub(super) fn is_only_closed(&self, error: &io::Error) -> bool {
        use io::ErrorKind::{BrokenPipe, ConnectionAborted, ConnectionReset, UnexpectedEof};
        let is_server = matches!(self.port.settings.address, PortAddress::ModbusTcp { .. });
        let is_closed = matches!(error.kind(), UnexpectedEof | ConnectionReset | ConnectionAborted | BrokenPipe);
        is_server && is_closed && self.replies_on_connection() > 0
    }

    /// The server has closed the connection: the next frame makes another one.
    pub(super) fn let_go(&mut self, device: &mut Port) {
        device.park();
        let line = &self.port.line;
        if self.replies_on_connection() == 1 && !std::mem::replace(&mut self.connection.closes_each, true) {
            tracing::info!(line, "server closes the connection after each reply; each request makes a new one");
        } else {
            tracing::debug!(line, "server has closed the connection; the next request makes a new one");
        }
    }

    /// Closes a connection before its server does, which could lose the next request.
    pub(super) fn close_after_reply(&mut self, device: &mut Port) {
        if self.connection.closes_each
            && !device.is_parked()
            && self.replies_on_connection() > 0
            && !self.core.is_occupied()
        {
            device.park();
        }
    }

    fn replies_on_connection(&self) -> u64 {
        self.core.counters().replies.saturating_sub(self.connection.replies_before)
    }
}
