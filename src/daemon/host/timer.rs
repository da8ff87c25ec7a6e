//! A timer as exact as the hardware; tokio's own has millisecond resolution.

use crate::daemon::host::clock;
use crate::daemon::host::sys;
use crate::domain::time::MonoTime;
use rustix::time::{
    Itimerspec, TimerfdClockId, TimerfdFlags, TimerfdTimerFlags, Timespec, timerfd_create,
    timerfd_settime,
};
use std::io;
use std::os::fd::{AsFd, BorrowedFd, OwnedFd};
use std::task::{Context, Poll, ready};
use tokio::io::unix::AsyncFd;

/// A `timerfd` on the clock of [`clock::now`].
#[derive(Debug)]
pub struct RawTimer {
    fd: OwnedFd,
    armed: MonoTime,
}

impl RawTimer {
    /// A timer that is not armed.
    ///
    /// # Errors
    /// The kernel's refusal, for want of descriptors.
    pub fn new() -> io::Result<Self> {
        let fd = timerfd_create(
            TimerfdClockId::Boottime,
            TimerfdFlags::NONBLOCK | TimerfdFlags::CLOEXEC,
        )?;
        Ok(Self {
            fd,
            armed: MonoTime::NEVER,
        })
    }

    /// Makes the timer fire at `at` or earlier. A timer that is armed for an earlier moment is left as it is, which
    /// saves a system call per exchange when only a time-out moves on.
    ///
    /// # Errors
    /// The kernel's refusal; none is known.
    pub fn arm(&mut self, at: MonoTime) -> io::Result<()> {
        if self.armed <= at && clock::now() < self.armed {
            return Ok(());
        }
        let seconds = i64::try_from(at.as_nanos() / 1_000_000_000).unwrap_or(i64::MAX);
        // Zero would disarm it.
        let nanos = i64::try_from(at.as_nanos() % 1_000_000_000)
            .unwrap_or(0)
            .max(1);
        let spec = Itimerspec {
            it_interval: Timespec {
                tv_sec: 0,
                tv_nsec: 0,
            },
            it_value: Timespec {
                tv_sec: seconds,
                tv_nsec: nanos,
            },
        };
        timerfd_settime(&self.fd, TimerfdTimerFlags::ABSTIME, &spec)?;
        self.armed = at;
        Ok(())
    }

    /// Notes that the timer has fired, so that its descriptor is quiet again.
    pub fn acknowledge(&mut self) {
        let mut count = [0; 8];
        // Nothing to read means that it was armed again in between.
        let _ = rustix::io::read(&self.fd, &mut count);
        self.armed = MonoTime::NEVER;
    }
}

impl AsFd for RawTimer {
    fn as_fd(&self) -> BorrowedFd<'_> {
        self.fd.as_fd()
    }
}

impl std::os::fd::AsRawFd for RawTimer {
    fn as_raw_fd(&self) -> std::os::fd::RawFd {
        std::os::fd::AsRawFd::as_raw_fd(&self.fd)
    }
}

/// The timer for a tokio task.
#[derive(Debug)]
pub struct TaskTimer {
    inner: AsyncFd<RawTimer>,
}

impl TaskTimer {
    /// A timer that is not armed, for the runtime of the calling thread.
    ///
    /// # Errors
    /// The kernel's refusal, for want of descriptors.
    pub fn new() -> io::Result<Self> {
        Ok(Self {
            inner: sys::readable(RawTimer::new()?)?,
        })
    }

    /// See [`RawTimer::arm`].
    ///
    /// # Errors
    /// The kernel's refusal; none is known.
    pub fn arm(&mut self, at: MonoTime) -> io::Result<()> {
        self.inner.get_mut().arm(at)
    }

    /// Ready once the timer has fired.
    pub fn poll_fired(&mut self, cx: &mut Context<'_>) -> Poll<()> {
        if let Ok(mut guard) = ready!(self.inner.poll_read_ready_mut(cx)) {
            guard.get_inner_mut().acknowledge();
            guard.clear_ready();
        }
        Poll::Ready(())
    }
}
