//! Simulated drives on a pseudo-terminal, in real time: moves bytes between a [`Pty`] and a [`SimBus`].

use super::pty::Pty;
use super::timer::RawTimer;
use super::{clock, sys};
use crate::domain::time::MonoTime;
use crate::sim::SimBus;
use rustix::event::{PollFd, PollFlags, poll};
use rustix::io::Errno;
use std::io;
use std::os::fd::AsFd;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

/// How often the loop looks whether it shall end.
const LOOK_UP: Duration = Duration::from_millis(200);

/// Plays `bus` on `pty` on a thread of its own as long as `work` lasts, and returns what that returns. `look` is somebody
/// who stands beside the drives; it is called in every round, at least a few times a second.
///
/// # Errors
/// What the pseudo-terminal or the timer reports.
pub fn play_beside<T>(
    pty: &Pty,
    bus: &mut SimBus,
    look: impl FnMut(&mut SimBus, MonoTime) + Send,
    work: impl FnOnce() -> T,
) -> io::Result<T> {
    let end = AtomicBool::new(false);
    std::thread::scope(|scope| {
        let player = scope.spawn(|| play(pty, bus, &end, look));
        // Also when the work panics: the scope waits for the player.
        let over = SetAtEnd(&end);
        let done = work();
        drop(over);
        player.join().unwrap_or_else(|_| Err(io::Error::other("the simulator panicked")))?;
        Ok(done)
    })
}

struct SetAtEnd<'a>(&'a AtomicBool);

impl Drop for SetAtEnd<'_> {
    fn drop(&mut self) {
        self.0.store(true, Ordering::Relaxed);
    }
}

/// Plays `bus` on `pty` until `end` is set. Meant for a thread of its own: it blocks. `look` is somebody who
/// stands beside the drives; it is called in every round, at least a few times a second.
///
/// # Errors
/// What the pseudo-terminal or the timer reports.
pub fn play(
    pty: &Pty,
    bus: &mut SimBus,
    end: &AtomicBool,
    mut look: impl FnMut(&mut SimBus, MonoTime),
) -> io::Result<()> {
    if bus.is_paced()
        && let Err(error) = sys::ask_for_real_time()
    {
        tracing::debug!(%error, "no real-time priority: simulated characters may come late under load");
    }
    let mut timer = RawTimer::new()?;
    let mut buffer = [0; 512];
    let mut out = Vec::new();
    while !end.load(Ordering::Relaxed) {
        let now = clock::now();
        look(bus, now);
        bus.take_due(now, |_, bytes| out.extend_from_slice(bytes));
        write_all(pty, &mut out)?;
        match rustix::io::read(pty.master(), &mut buffer) {
            Ok(bytes) => {
                bus.receive(clock::now(), &buffer[..bytes]);
                continue;
            }
            // EIO: nobody has the port open.
            Err(Errno::AGAIN | Errno::INTR | Errno::IO) => {}
            Err(error) => return Err(error.into()),
        }
        let wake = bus.next_due().unwrap_or(now + LOOK_UP).min(now + LOOK_UP);
        if wake <= clock::now() {
            continue;
        }
        timer.arm(wake)?;
        wait(pty, &mut timer)?;
    }
    Ok(())
}

fn wait(pty: &Pty, timer: &mut RawTimer) -> io::Result<()> {
    let mut fds = [PollFd::from_borrowed_fd(pty.master().as_fd(), PollFlags::IN), PollFd::new(&*timer, PollFlags::IN)];
    match poll(&mut fds, None) {
        Ok(_) | Err(Errno::INTR) => {}
        Err(error) => return Err(error.into()),
    }
    let fired = fds[1].revents().contains(PollFlags::IN);
    if fired {
        timer.acknowledge();
    }
    Ok(())
}

/// Writes what is due. What a full buffer does not take is lost, as on a wire that nobody listens to.
fn write_all(pty: &Pty, out: &mut Vec<u8>) -> io::Result<()> {
    if !out.is_empty() {
        match rustix::io::write(pty.master(), out) {
            Ok(_) | Err(Errno::AGAIN | Errno::INTR | Errno::IO) => {}
            Err(error) => return Err(error.into()),
        }
        out.clear();
    }
    Ok(())
}
