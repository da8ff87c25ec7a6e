//! Signals: which end the gateway in good order, and which it does not follow.
//!
//! A signal without a handler ends the process at once, without `on_shutdown`. So each that can be handled is.

use rustix::process::Signal as Number;
use std::borrow::Cow;
use std::future::poll_fn;
use std::io;
use std::ops::RangeInclusive;
use std::task::{Context, Poll};
use tokio::signal::unix::{Signal, SignalKind, signal};

/// What asks a program to end.
const ENDS: [(Number, &str); 3] = [
    (Number::INT, "SIGINT"),
    (Number::TERM, "SIGTERM"),
    (Number::QUIT, "SIGQUIT"),
];
/// What has no meaning here.
const IGNORED: [(Number, &str); 9] = [
    (Number::USR1, "SIGUSR1"),
    (Number::USR2, "SIGUSR2"),
    (Number::ALARM, "SIGALRM"),
    (Number::VTALARM, "SIGVTALRM"),
    (Number::PROF, "SIGPROF"),
    (Number::IO, "SIGIO"),
    (Number::POWER, "SIGPWR"),
    (Number::STKFLT, "SIGSTKFLT"),
    (Number::XCPU, "SIGXCPU"),
];

/// Signals that programs may use as they like, by number (Linux, `signal(7)`; the C library keeps 32 and 33 to itself).
const OF_PROGRAMS: RangeInclusive<i32> = 34..=64;

/// A signal with its name.
struct NamedSignal {
    signal: Signal,
    name: Cow<'static, str>,
}

impl NamedSignal {
    fn of((number, name): &(Number, &'static str)) -> io::Result<Self> {
        Ok(Self {
            signal: signal(SignalKind::from_raw(number.as_raw()))?,
            name: Cow::Borrowed(name),
        })
    }

    fn of_program(number: i32) -> io::Result<Self> {
        Ok(Self {
            signal: signal(SignalKind::from_raw(number))?,
            name: Cow::Owned(format!("signal {number}")),
        })
    }

    fn has_come(&mut self, cx: &mut Context<'_>) -> bool {
        self.signal.poll_recv(cx) == Poll::Ready(Some(()))
    }
}

/// Handles SIGINT, SIGTERM and SIGQUIT from now on; the future waits for the first of them. Signals without a meaning
/// here end nothing from now on, and are logged while it waits. Must be called on a runtime, before the first output: a
/// parent process that sees that may send a signal at once.
///
/// # Errors
/// The system's refusal to install the handlers.
pub fn told_to_end() -> io::Result<impl Future<Output = ()>> {
    let mut ends = ENDS
        .iter()
        .map(NamedSignal::of)
        .collect::<io::Result<Vec<_>>>()?;
    let mut ignored = IGNORED
        .iter()
        .map(NamedSignal::of)
        .collect::<io::Result<Vec<_>>>()?;
    // A system without some of them sends none.
    ignored.extend(OF_PROGRAMS.filter_map(|number| NamedSignal::of_program(number).ok()));
    // A file that may not grow is an error of the write then. To log it could write to that very file.
    drop(signal(SignalKind::from_raw(Number::XFSZ.as_raw()))?);
    Ok(async move {
        let name = poll_fn(|cx| {
            for it in &mut ignored {
                while it.has_come(cx) {
                    tracing::warn!(signal = %it.name, "signal ignored: it has no meaning here");
                }
            }
            ends.iter_mut()
                .find_map(|it| it.has_come(cx).then(|| it.name.clone()))
                .map_or(Poll::Pending, Poll::Ready)
        })
        .await;
        tracing::debug!(signal = %name, "ended by a signal");
    })
}
