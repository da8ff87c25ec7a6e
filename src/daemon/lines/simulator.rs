//! Simulated drives in real time: moves bytes between the end of a line and a [`SimBus`].

use crate::daemon::host::clock;
use crate::daemon::host::sys;
use crate::daemon::host::timer::RawTimer;
use crate::daemon::lines::simulated_end::LineEnd;
use crate::domain::time::MonoTime;
use crate::sim::SimBus;
use std::io;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

/// How often the loop checks whether it is to end.
const LOOK_UP: Duration = Duration::from_millis(200);

/// Plays `bus` at this end of a `line` on a thread of its own while `work` runs, and returns the result of `work`.
/// `look` observes the drives; it is called in every round, at least a few times a second.
///
/// # Errors
/// What the end of the line or the timer reports.
pub fn play_beside<T>(
    line: impl LineEnd + Send,
    bus: &mut SimBus,
    look: impl FnMut(&mut SimBus, MonoTime) + Send,
    work: impl FnOnce() -> T,
) -> io::Result<T> {
    let end = AtomicBool::new(false);
    std::thread::scope(|scope| {
        let player = scope.spawn(|| play(line, bus, &end, look));
        // Also when the work panics: the scope waits for the player.
        let over = SetAtEnd(&end);
        let done = work();
        drop(over);
        player
            .join()
            .unwrap_or_else(|_| Err(io::Error::other("the simulator panicked")))?;
        Ok(done)
    })
}

struct SetAtEnd<'a>(&'a AtomicBool);

impl Drop for SetAtEnd<'_> {
    fn drop(&mut self) {
        self.0.store(true, Ordering::Relaxed);
    }
}

/// Plays `bus` at this end of a `line` until `end` is set. It blocks, so it is intended for a thread of its own. `look`
/// observes the drives; it is called in every round, at least a few times a second.
///
/// # Errors
/// What the end of the line or the timer reports.
pub fn play(
    mut line: impl LineEnd,
    bus: &mut SimBus,
    end: &AtomicBool,
    mut look: impl FnMut(&mut SimBus, MonoTime),
) -> io::Result<()> {
    if bus.is_paced()
        && let Err(error) = sys::ask_for_real_time()
    {
        tracing::debug!(%error, "no real-time priority; simulated characters may be late under load");
    }
    let mut timer = RawTimer::new()?;
    let mut buffer = [0; 512];
    let mut out = Vec::new();
    while !end.load(Ordering::Relaxed) {
        let now = clock::now();
        look(bus, now);
        bus.take_due(now, |_, bytes| out.extend_from_slice(bytes));
        if !out.is_empty() {
            line.write(&out)?;
            out.clear();
        }
        if let Some(bytes) = line.read(&mut buffer)? {
            bus.receive(clock::now(), &buffer[..bytes]);
            continue;
        }
        let wake = bus.next_due().unwrap_or(now + LOOK_UP).min(now + LOOK_UP);
        if wake <= clock::now() {
            continue;
        }
        timer.arm(wake)?;
        line.wait(&mut timer)?;
    }
    Ok(())
}
