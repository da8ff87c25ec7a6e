//! Notifications to the service manager: ready, reloading, stopping, a short status, and heartbeats. Without a service
//! manager nothing is sent.

use crate::daemon::exchange::shared::{CurrentPlant, SharedLine};
use crate::domain::ids::Name;
use crate::domain::report::LineState;
use sd_notify::NotifyState;
use std::collections::HashMap;
use std::sync::Arc;
use std::time::Duration;
use tokio::time::{Instant, sleep_until};

/// How often the status is checked. It is sent when it has changed.
const STATUS_EVERY: Duration = Duration::from_secs(5);
/// How often the lines' threads are checked if no service manager requires heartbeats: longer than a port may take to
/// open.
const FEEL_EVERY: Duration = Duration::from_secs(10);

/// Notifies that the gateway serves.
pub fn ready(current: &CurrentPlant) {
    say(&[NotifyState::Ready, NotifyState::Status(&status(current))]);
}

/// Notifies that a reload begins; [`ready`] ends it.
pub fn reloading() {
    match NotifyState::monotonic_usec_now() {
        Ok(now) => say(&[
            NotifyState::Reloading,
            now,
            NotifyState::Status("reloading"),
        ]),
        // The service manager would treat the one without the other as a fault.
        Err(error) => tracing::warn!(%error, "cannot notify the service manager of the reload"),
    }
}

/// Notifies that the gateway shuts down.
pub fn stopping() {
    say(&[
        NotifyState::Stopping,
        NotifyState::Status("shutting down: applying `on_shutdown` to each drive"),
    ]);
}

/// Checks that the lines' threads make progress, and sends heartbeats at half of the service manager's time-out while
/// they do; sends the status as well. It runs on the thread of the north side: if that hangs, no heartbeat is sent.
/// Never returns.
pub async fn watch(current: CurrentPlant) {
    let granted = sd_notify::watchdog_enabled().filter(|time| !time.is_zero());
    let mut pulse = LinePulse::default();
    let mut sent = String::new();
    let mut beat = Instant::now();
    let mut look = Instant::now();
    loop {
        let now = Instant::now();
        if now >= beat {
            beat = now + granted.map_or(FEEL_EVERY, |granted| granted / 2);
            match pulse.feel(&current.load().lines) {
                Ok(()) => say(&[NotifyState::Watchdog]),
                Err(hung) => {
                    tracing::error!(
                        ?hung,
                        "ALARM: line thread hangs; no heartbeat to the service manager"
                    )
                }
            }
        }
        if now >= look {
            look = now + STATUS_EVERY;
            let status = status(&current);
            if status != sent {
                say(&[NotifyState::Status(&status)]);
                sent = status;
            }
        }
        sleep_until(beat.min(look)).await;
    }
}

/// Sends heartbeats without checking the lines, while these end one after the other.
pub async fn keep_alive() {
    let Some(granted) = sd_notify::watchdog_enabled().filter(|time| !time.is_zero()) else {
        return;
    };
    loop {
        say(&[NotifyState::Watchdog]);
        tokio::time::sleep(granted / 2).await;
    }
}

fn say(words: &[NotifyState<'_>]) {
    if let Err(error) = sd_notify::notify(words) {
        tracing::debug!(%error, "cannot notify the service manager");
    }
}

fn status(current: &CurrentPlant) -> String {
    let shared = current.load();
    let up = shared
        .lines
        .iter()
        .filter(|line| line.report().state == LineState::Up)
        .count();
    let online = shared
        .drives
        .iter()
        .filter(|drive| drive.view.load().is_online())
        .count();
    format!(
        "{up} of {} lines up, {online} of {} drives online",
        shared.lines.len(),
        shared.drives.len()
    )
}

/// Whether the threads of all lines make progress.
#[derive(Debug, Default)]
struct LinePulse {
    /// The rounds of each line at the last check, by its number.
    rounds: HashMap<u16, u64>,
}

impl LinePulse {
    /// Wakes all threads, including sleeping ones, and finds the lines whose threads have made no round since the last
    /// check.
    fn feel(&mut self, lines: &[Arc<SharedLine>]) -> Result<(), Vec<Name>> {
        let stands =
            |line: &&Arc<SharedLine>| self.rounds.get(&line.number) == Some(&line.rounds());
        let hung: Vec<_> = lines
            .iter()
            .filter(stands)
            .map(|line| line.name.clone())
            .collect();
        lines
            .iter()
            .for_each(|line| line.set_hangs(hung.contains(&line.name)));
        self.rounds = lines
            .iter()
            .map(|line| (line.number, line.rounds()))
            .collect();
        lines.iter().for_each(|line| line.inbox.ring());
        if hung.is_empty() { Ok(()) } else { Err(hung) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::domain::link::Interface;

    fn line(number: u16, name: &str) -> Arc<SharedLine> {
        Arc::new(SharedLine::new(
            number,
            Name::new(name).unwrap(),
            Interface::Rs485,
            [],
        ))
    }

    #[test]
    fn a_line_whose_thread_does_not_come_round_ends_the_heartbeats() {
        let good = line(1, "good");
        let bad = line(2, "bad");
        let lines = [Arc::clone(&good), Arc::clone(&bad)];
        let mut pulse = LinePulse::default();
        assert_eq!(pulse.feel(&lines), Ok(()), "nothing is known yet");
        good.count_round();
        bad.count_round();
        assert_eq!(pulse.feel(&lines), Ok(()));
        good.count_round();
        assert_eq!(pulse.feel(&lines), Err(vec![Name::new("bad").unwrap()]));
        assert_eq!((lines[0].hangs(), lines[1].hangs()), (false, true));
        // After a reload there is a new line in its place, which gets its full time.
        let lines = [good, line(3, "bad")];
        lines[0].count_round();
        assert_eq!(pulse.feel(&lines), Ok(()));
        lines[1].count_round();
        assert_eq!(pulse.feel(&lines), Err(vec![Name::new("good").unwrap()]));
        lines.iter().for_each(|line| line.count_round());
        assert_eq!(
            pulse.feel(&lines),
            Ok(()),
            "what comes round again is alive again"
        );
    }

    #[test]
    fn a_thread_that_sleeps_is_called() {
        let line = line(1, "idle");
        assert!(line.inbox.may_sleep(true));
        let mut called = std::pin::pin!(line.inbox.called());
        let mut cx = std::task::Context::from_waker(std::task::Waker::noop());
        assert!(called.as_mut().poll(&mut cx).is_pending());
        assert_eq!(LinePulse::default().feel(&[Arc::clone(&line)]), Ok(()));
        assert!(called.as_mut().poll(&mut cx).is_ready());
    }
}
