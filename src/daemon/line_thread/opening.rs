//! Opening the port, and reopening it after it was lost.

use super::LineTask;
use super::serving::{PortExit, PortUptime};
use crate::daemon::host::clock;
use crate::daemon::port::{OpenBackoff, OpenPort, PortOpener};
use crate::domain::report::LineFault;
use crate::domain::time::MonoTime;
use crate::gateway::LineInput;
use rustix::io::Errno;
use std::io;
use std::pin::pin;
use std::task::{Context, Poll};

/// Reasons that are remembered. Beyond that they are forgotten and may be logged again.
const REASONS_MAX: usize = 16;

/// The faults of the port that were logged. However often a port comes and goes, each reason is logged once, until the
/// port has proved good.
#[derive(Debug, Default)]
pub(super) struct LoggedFaults {
    reasons: Vec<String>,
    /// Why it was reopened although it was open.
    reopened: Option<LineFault>,
}

impl LoggedFaults {
    /// Whether `reason` is new.
    fn is_new(&mut self, reason: String) -> bool {
        if self.reasons.contains(&reason) {
            return false;
        }
        if self.reasons.len() >= REASONS_MAX {
            self.reasons.clear();
        }
        self.reasons.push(reason);
        true
    }

    /// Whether no logged fault is still open.
    pub(super) fn is_empty(&self) -> bool {
        self.reasons.is_empty() && self.reopened.is_none()
    }

    /// The port has been open for a while.
    pub(super) fn has_lasted(&mut self) {
        self.reasons.clear();
    }

    /// A drive has answered over the port.
    pub(super) fn has_answered(&mut self) {
        *self = Self::default();
    }
}

/// What happened first while there was no port.
pub(super) enum PortlessOutcome<T> {
    Done(T),
    TimeIsUp,
    /// The thread is to exit.
    Ended,
}

impl LineTask<'_> {
    /// Opens the port and serves it, again and again, until the thread is to exit.
    pub(super) async fn serve(mut self) -> io::Result<()> {
        let served = self.serve_ports().await;
        served.and(self.take_leave())
    }

    async fn serve_ports(&mut self) -> io::Result<()> {
        let mut opener = PortOpener::new(&self.port.settings);
        while let Some(mut device) = self.open(&mut opener).await? {
            let mut uptime = PortUptime::new(clock::now(), &self.core);
            // What was wrong with the last port says nothing about this one.
            self.to_reopen = None;
            self.announce(&mut uptime, &device);
            self.core
                .handle(uptime.since, LineInput::PortUp(device.kind()));
            self.connection_opened();
            let left = self.serve_port(&mut device, &mut opener, &mut uptime).await;
            let fault = match left {
                Ok(PortExit::Closed) => return Ok(()),
                Ok(PortExit::ToReopen(fault)) => {
                    self.tell_of_reopening(fault);
                    fault
                }
                Err(ref error) => {
                    let fault = fault_of(error);
                    self.tell_of_loss(fault, error);
                    fault
                }
            };
            // Before the wait: an open handle to an unplugged device keeps its name from the new one.
            drop(device);
            self.core.handle(clock::now(), LineInput::PortDown(fault));
            self.act(None)?;
            let is_asked_for = left.is_ok();
            // Time open proves nothing if the gateway itself gives the port up.
            let was_good =
                uptime.has_answered || (!is_asked_for && uptime.has_lasted(clock::now()));
            if was_good {
                self.attempts = OpenBackoff::default();
            }
            if (is_asked_for || !was_good) && self.pause().await? {
                return Ok(());
            }
        }
        Ok(())
    }

    /// Opens the port, retrying with growing waits; `None` if the thread is to exit.
    async fn open(&mut self, opener: &mut PortOpener<'_>) -> io::Result<Option<OpenPort>> {
        loop {
            let opened = {
                let mut opening = pin!(opener.open());
                self.meanwhile(MonoTime::NEVER, |cx| opening.as_mut().poll(cx))
                    .await?
            };
            match opened {
                PortlessOutcome::Done(Ok(device)) => return Ok(Some(device)),
                PortlessOutcome::Done(Err(error)) => {
                    let error = opener.explain(&error);
                    self.tell_of_refusal(&error);
                    let reason = format!("cannot open {}: {error}", self.port.settings.address);
                    self.core
                        .handle(clock::now(), LineInput::PortRefused(reason.into()));
                    self.act(None)?;
                }
                PortlessOutcome::TimeIsUp => {}
                PortlessOutcome::Ended => return Ok(None),
            }
            if self.pause().await? {
                return Ok(None);
            }
        }
    }

    /// Waits before the port is retried, longer each time. Returns whether the thread is to exit.
    async fn pause(&mut self) -> io::Result<bool> {
        let again = clock::now() + self.attempts.next_wait();
        let waited = self.meanwhile(again, |_| Poll::<()>::Pending).await?;
        Ok(matches!(waited, PortlessOutcome::Ended))
    }

    /// Waits for `until` or for the result of `poll`, without a port: requests are still answered, leases expire, and
    /// overdue stops are reported.
    pub(super) async fn meanwhile<T>(
        &mut self,
        until: MonoTime,
        mut poll: impl FnMut(&mut Context<'_>) -> Poll<T>,
    ) -> io::Result<PortlessOutcome<T>> {
        while clock::now() < until {
            let due = self
                .core
                .next_wake()
                .map_or(until, |wake| wake.at.min(until));
            self.timer.arm(due)?;
            if let Some(done) = self.wait(&mut poll).await {
                return Ok(PortlessOutcome::Done(done));
            }
            self.take_messages();
            self.core.handle(clock::now(), LineInput::Time);
            self.act(None)?;
            if self.is_over() {
                return Ok(PortlessOutcome::Ended);
            }
        }
        Ok(PortlessOutcome::TimeIsUp)
    }

    fn tell_of_refusal(&mut self, error: &str) {
        let line = &self.port.line;
        let port = &self.port.settings.address;
        if self.logged.is_new(error.to_owned()) {
            tracing::warn!(line, %port, error, "cannot open the port; retrying");
        } else {
            tracing::debug!(line, %port, error, "cannot open the port; retrying");
        }
    }

    fn tell_of_loss(&mut self, fault: LineFault, error: &io::Error) {
        let line = &self.port.line;
        // The same loss appears as several errors.
        if self.logged.is_new(fault.to_string()) {
            tracing::warn!(line, %fault, %error, "line down");
        } else {
            tracing::debug!(line, %fault, %error, "line down");
        }
    }

    fn tell_of_reopening(&mut self, fault: LineFault) {
        let line = &self.port.line;
        if self.logged.reopened.replace(fault) == Some(fault) {
            tracing::debug!(line, %fault, "reopening the port");
        } else {
            tracing::warn!(line, %fault, "reopening the port; retrying until the line recovers");
        }
    }
}

/// The fault behind an error of an open port. An unplugged device is reported differently by driver and moment.
fn fault_of(error: &io::Error) -> LineFault {
    use io::ErrorKind::{
        BrokenPipe, ConnectionAborted, ConnectionReset, HostUnreachable, NetworkUnreachable,
        TimedOut, UnexpectedEof, WouldBlock, WriteZero,
    };
    let code = error.raw_os_error().map(Errno::from_raw_os_error);
    match error.kind() {
        WriteZero | WouldBlock => LineFault::Stuck,
        UnexpectedEof | ConnectionReset | ConnectionAborted | BrokenPipe | TimedOut
        | HostUnreachable | NetworkUnreachable => LineFault::Gone,
        _ if matches!(code, Some(Errno::IO | Errno::NXIO | Errno::NODEV)) => LineFault::Gone,
        _ => LineFault::Failed,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_device_that_is_gone_is_gone_whatever_the_system_says() {
        for errno in [
            Errno::IO,
            Errno::NXIO,
            Errno::NODEV,
            Errno::CONNRESET,
            Errno::TIMEDOUT,
            Errno::PIPE,
        ] {
            assert_eq!(fault_of(&errno.into()), LineFault::Gone, "{errno:?}");
        }
        assert_eq!(
            fault_of(&io::ErrorKind::UnexpectedEof.into()),
            LineFault::Gone
        );
        assert_eq!(fault_of(&Errno::AGAIN.into()), LineFault::Stuck);
        assert_eq!(fault_of(&io::ErrorKind::WriteZero.into()), LineFault::Stuck);
        assert_eq!(fault_of(&Errno::BADF.into()), LineFault::Failed);
    }

    #[test]
    fn each_reason_is_reported_once_until_the_port_proves_good() {
        let mut logged = LoggedFaults::default();
        for reason in ["gone", "no such file"] {
            assert!(logged.is_new(reason.to_owned()), "{reason}");
        }
        assert!(!logged.is_new("gone".to_owned()) && !logged.is_empty());
        logged.has_lasted();
        assert!(logged.is_empty() && logged.is_new("gone".to_owned()));
        for number in 0..1000 {
            logged.is_new(number.to_string());
        }
        assert!(logged.reasons.len() <= REASONS_MAX);
    }

    #[test]
    fn a_silent_adapter_that_stays_open_is_not_reported_again() {
        let mut logged = LoggedFaults {
            reopened: Some(LineFault::Mute),
            ..LoggedFaults::default()
        };
        logged.has_lasted();
        assert!(!logged.is_empty());
        logged.has_answered();
        assert!(logged.is_empty());
    }
}
