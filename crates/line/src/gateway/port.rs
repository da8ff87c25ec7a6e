//! The port of one line: whether it is open, whether a connection is kept over it, and why it is not.

use crate::domain::report::{LineFault, LineState};
use std::sync::Arc;

/// State of the port of one line.
#[derive(Debug)]
pub(super) struct PortState {
    /// The reported state of the line.
    state: LineState,
    /// Whether there is a port to send to, whatever the reported state of the line.
    is_open: bool,
    /// The server has closed the connection: another one is made when a frame is due.
    is_parked: bool,
    /// Why the port was closed last, or the line was no use.
    fault: Option<LineFault>,
    /// Why the port cannot be opened; `None` once it is open.
    open_error: Option<Arc<str>>,
}

impl PortState {
    pub const fn closed() -> Self {
        Self {
            state: LineState::Down,
            is_open: false,
            is_parked: false,
            fault: None,
            open_error: None,
        }
    }

    pub const fn state(&self) -> LineState {
        self.state
    }

    pub fn is_down(&self) -> bool {
        self.state == LineState::Down
    }

    pub const fn is_open(&self) -> bool {
        self.is_open
    }

    pub const fn is_parked(&self) -> bool {
        self.is_parked
    }

    pub const fn fault(&self) -> Option<LineFault> {
        self.fault
    }

    pub fn open_error(&self) -> Option<Arc<str>> {
        self.open_error.clone()
    }

    /// The port was opened. If there is `trouble`, the line still cannot be used.
    pub fn opened(&mut self, trouble: Option<LineFault>) {
        self.state = state_in(trouble);
        self.is_open = true;
        self.is_parked = false;
        self.open_error = None;
    }

    /// The port was closed because of `fault`.
    pub const fn gone(&mut self, fault: LineFault) {
        self.state = LineState::Down;
        self.is_open = false;
        self.fault = Some(fault);
    }

    /// The port cannot be opened.
    pub fn refused(&mut self, reason: Arc<str>) {
        self.open_error = Some(reason);
    }

    /// The server has closed the connection.
    pub const fn park(&mut self) {
        self.is_parked = true;
    }

    /// Another connection is made.
    pub const fn connected(&mut self) {
        self.is_parked = false;
    }

    /// The line cannot be used any more although it is open, or can be used again.
    pub fn set_trouble(&mut self, trouble: Option<LineFault>) {
        self.state = state_in(trouble);
        self.fault = trouble.or(self.fault);
    }
}

const fn state_in(trouble: Option<LineFault>) -> LineState {
    if trouble.is_some() {
        LineState::Down
    } else {
        LineState::Up
    }
}
