//! Log lines on stderr.

use crate::daemon::host::recent_log;
use std::io::{self, IsTerminal, Write};
use tracing::Level;
use tracing_appender::non_blocking::{NonBlockingBuilder, WorkerGuard};
use tracing_subscriber::Layer;
use tracing_subscriber::filter::Targets;
use tracing_subscriber::layer::SubscriberExt;
use tracing_subscriber::util::SubscriberInitExt;

/// Most lines that wait to be written. Room for all of them is allocated at the start, 32 bytes each: the library's
/// default would be the largest piece of memory of the whole program.
const LINES_MAX: usize = 8192;

/// The format of log lines.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum LogFormat {
    /// For people.
    Text,
    /// One JSON object per line.
    Json,
}

/// Starts logging. `RUST_LOG` selects what is logged, as levels of targets (`info,vfd_gateway=trace`); without it, or if it
/// is anything else, everything from `level` on. The returned guard writes the last lines when it is dropped.
///
/// A separate thread writes, so that logging never waits for a reader: lines beyond what the thread holds are lost.
pub fn start(format: LogFormat, level: Level) -> WorkerGuard {
    let selected = std::env::var("RUST_LOG").ok();
    let targets: Targets = selected
        .and_then(|targets| targets.parse().ok())
        .unwrap_or_else(|| Targets::new().with_default(level));
    let (writer, guard) = NonBlockingBuilder::default()
        .lossy(true)
        .buffered_lines_limit(LINES_MAX)
        .finish(LogOutput);
    let lines = tracing_subscriber::fmt::layer().with_writer(writer);
    let lines = match format {
        LogFormat::Text => lines
            .with_ansi(io::stderr().is_terminal())
            .with_target(false)
            .boxed(),
        LogFormat::Json => lines.json().boxed(),
    };
    tracing_subscriber::registry()
        .with(lines.with_filter(targets))
        .init();
    guard
}

/// Standard error, and the newest lines for diagnostics; a line that cannot be written is dropped without further effect. Its reader may be gone, and an
/// error would make the library complain on the same standard error, which panics the thread that logs.
struct LogOutput;

impl Write for LogOutput {
    fn write(&mut self, line: &[u8]) -> io::Result<usize> {
        complain(line);
        recent_log::own().keep(line);
        Ok(line.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

/// Writes to standard error. Failures are ignored.
pub fn complain(text: &[u8]) {
    let _ = io::stderr().lock().write_all(text);
}
