//! Serving an open port.

use super::LineTask;
use crate::daemon::host::clock;
use crate::daemon::port::{OpenPort, PortOpener};
use crate::domain::report::{LineFault, LineState};
use crate::domain::time::MonoTime;
use crate::gateway::{LineCore, LineInput, LineWake, WakeReason};
use std::future::poll_fn;
use std::io;
use std::pin::pin;
use std::task::{Context, Poll};
use std::time::Duration;

/// Reads of the port in one round, of 512 bytes each: 15 of the longest replies.
const READS_PER_ROUND: usize = 8;
/// How long a line that has sent more than that is left alone. So no node takes the processor from other lines,
/// whatever the priority of its thread: 4 MB/s is more than any serial line carries.
const FLOOD_PAUSE: Duration = Duration::from_millis(1);
/// How long before the end of the silence the thread wakes up and spins on the clock: as long as waking up takes on an
/// ordinary machine. It keeps gaps exact at the cost of this much processor time a frame.
const WAKE_EARLY: Duration = Duration::from_micros(100);
/// How long a line without character times polls for the reply before it sleeps. Such a reply arrives sooner than a
/// sleeping thread is woken; on a paced line it never does.
const LOOK_BEFORE_SLEEP: Duration = Duration::from_micros(60);
/// A port that was open for less than this had not really recovered: the next attempt waits longer.
const STABLE_AFTER: Duration = Duration::from_secs(1);

/// Why an open port was left.
pub(super) enum PortExit {
    /// The thread is to exit.
    Closed,
    /// The port is to be reopened.
    ToReopen(LineFault),
}

/// What a port has proved since it was opened.
#[derive(Debug)]
pub(super) struct PortUptime {
    /// When it was opened.
    pub since: MonoTime,
    /// Valid replies up to then.
    replies: u64,
    /// A drive has answered over it.
    pub has_answered: bool,
    /// Whether it was logged as up.
    is_announced: bool,
}

impl PortUptime {
    pub fn new(now: MonoTime, core: &LineCore) -> Self {
        Self {
            since: now,
            replies: core.counters().replies,
            has_answered: false,
            is_announced: false,
        }
    }

    /// Whether it has been open for a while.
    pub fn has_lasted(&self, now: MonoTime) -> bool {
        now.since(self.since) >= STABLE_AFTER
    }
}

impl LineTask<'_> {
    /// Logs that the line is up, unless a logged fault may still be open.
    pub(super) fn announce(&self, uptime: &mut PortUptime, device: &OpenPort) {
        if uptime.is_announced
            || !self.logged.is_empty()
            || self.core.report().state == LineState::Down
        {
            return;
        }
        uptime.is_announced = true;
        let line = &self.port.line;
        let settings = &self.port.settings;
        let link = settings
            .address
            .is_serial_line()
            .then(|| tracing::field::display(settings.link));
        tracing::info!(line, port = %settings.address, link, "line up");
        if let Some(remark) = device.remark() {
            tracing::warn!(line, port = %settings.address, "{remark}");
        }
    }

    fn look_after(&mut self, uptime: &mut PortUptime, device: &OpenPort) {
        if uptime.has_answered {
            return;
        }
        if self.core.counters().replies > uptime.replies {
            uptime.has_answered = true;
            self.logged.has_answered();
        } else if !uptime.is_announced && uptime.has_lasted(clock::now()) {
            self.logged.has_lasted();
        }
        self.announce(uptime, device);
    }

    /// Serves an open port until it is lost, is to be reopened, or the thread is to exit.
    pub(super) async fn serve_port(
        &mut self,
        device: &mut OpenPort,
        opener: &mut PortOpener<'_>,
        uptime: &mut PortUptime,
    ) -> io::Result<PortExit> {
        let mut buffer = [0; 512];
        let mut has_more = false;
        loop {
            self.act(Some(device))?;
            self.connect_again(device, opener).await?;
            self.look_after(uptime, device);
            if self.is_over() {
                return Ok(PortExit::Closed);
            }
            if let Some(fault) = self.to_reopen.take() {
                return Ok(PortExit::ToReopen(fault));
            }
            let wake = self.core.next_wake().map(|wake| match wake.reason {
                WakeReason::SilentInterval => wake.at.before(WAKE_EARLY),
                _ => wake.at,
            });
            if let Some(due) = wake.into_iter().chain(self.core.connects_at()).min() {
                self.timer.arm(due)?;
            }
            has_more = match self.hear(device, &mut buffer, has_more).await {
                Err(error) if self.is_only_closed(&error) => {
                    self.let_go(device);
                    false
                }
                heard => heard?,
            };
            self.close_after_reply(device);
            self.core.handle(clock::now(), LineInput::Time);
        }
    }

    /// Waits until something happens, and takes messages and bytes. Returns whether there may be more bytes.
    async fn hear(
        &mut self,
        device: &mut OpenPort,
        buffer: &mut [u8],
        has_more: bool,
    ) -> io::Result<bool> {
        let waited = if has_more {
            tokio::time::sleep(FLOOD_PAUSE).await;
            Ok(())
        } else {
            match self.reply_comes_at_once(device, buffer) {
                Ok(false) => self
                    .wait(|cx| device.poll_readable(cx))
                    .await
                    .transpose()
                    .map(drop),
                looked => looked.map(drop),
            }
        };
        self.watch_the_silence_end();
        self.take_messages();
        waited?;
        self.drain(device, buffer)
    }

    /// On a line without character times: polls for the reply for a moment, yielding to other threads. Returns whether
    /// bytes arrived.
    fn reply_comes_at_once(
        &mut self,
        device: &mut OpenPort,
        buffer: &mut [u8],
    ) -> io::Result<bool> {
        if self.is_paced || !self.core.is_occupied() {
            return Ok(false);
        }
        let until = clock::now() + LOOK_BEFORE_SLEEP;
        while clock::now() < until {
            match device.read_now(buffer)? {
                Some(0) => return Err(io::ErrorKind::UnexpectedEof.into()),
                Some(bytes) => {
                    self.core
                        .handle(clock::now(), LineInput::Bytes(&buffer[..bytes]));
                    return Ok(true);
                }
                None => std::thread::yield_now(),
            }
        }
        Ok(false)
    }

    /// Spins on the clock while the silence before the next frame is about to end.
    fn watch_the_silence_end(&self) {
        let Some(LineWake {
            at,
            reason: WakeReason::SilentInterval,
        }) = self.core.next_wake()
        else {
            return;
        };
        if at.since(clock::now()) <= WAKE_EARLY {
            while clock::now() < at {
                std::hint::spin_loop();
            }
        }
    }

    /// Waits until the timer fires, a message arrives, or `poll` is ready, whose result is returned.
    pub(super) async fn wait<T>(
        &mut self,
        mut poll: impl FnMut(&mut Context<'_>) -> Poll<T>,
    ) -> Option<T> {
        if !self.board.inbox().may_sleep(!self.core.is_occupied()) {
            return None;
        }
        let inbox = self.board.inbox();
        let mut called = pin!(inbox.called());
        poll_fn(|cx| {
            let fired = self.timer.poll_fired(cx).is_ready();
            let called = called.as_mut().poll(cx).is_ready();
            match poll(cx) {
                Poll::Ready(it) => Poll::Ready(Some(it)),
                Poll::Pending if fired || called => Poll::Ready(None),
                Poll::Pending => Poll::Pending,
            }
        })
        .await
    }

    /// Reads until the port is empty, asking the port itself and not the runtime's readiness. A node that never stops
    /// sending is left after a while, so that messages, deadlines and other lines have their turn; returns whether that
    /// happened.
    fn drain(&mut self, device: &mut OpenPort, buffer: &mut [u8]) -> io::Result<bool> {
        for _ in 0..READS_PER_ROUND {
            let Some(bytes) = device.read_now(buffer)? else {
                return Ok(false);
            };
            if bytes == 0 {
                return Err(io::ErrorKind::UnexpectedEof.into());
            }
            self.core
                .handle(clock::now(), LineInput::Bytes(&buffer[..bytes]));
        }
        Ok(true)
    }
}
