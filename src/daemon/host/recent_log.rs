//! The newest lines of the log, kept in memory for diagnostics.

use std::collections::VecDeque;
use std::sync::{Mutex, MutexGuard, PoisonError};

/// Most bytes that are kept.
const BYTES_MAX: usize = 256 * 1024;

/// Lines of a log, the oldest first.
#[derive(Debug)]
pub struct RecentLog {
    lines: Mutex<RecentLines>,
}

#[derive(Debug)]
struct RecentLines {
    lines: VecDeque<Box<str>>,
    bytes: usize,
}

/// The lines of this process. The log has one writer for all of it.
static OWN: RecentLog = RecentLog::new();

/// The newest lines of the log of this process.
#[must_use]
pub fn own() -> &'static RecentLog {
    &OWN
}

impl RecentLog {
    const fn new() -> Self {
        Self {
            lines: Mutex::new(RecentLines {
                lines: VecDeque::new(),
                bytes: 0,
            }),
        }
    }

    /// Keeps a line, without the colours of a terminal, in place of the oldest ones.
    pub fn keep(&self, line: &[u8]) {
        let line = without_colours(&String::from_utf8_lossy(line)).into_boxed_str();
        let mut kept = self.lock();
        kept.bytes += line.len();
        kept.lines.push_back(line);
        while kept.bytes > BYTES_MAX {
            let Some(oldest) = kept.lines.pop_front() else {
                return;
            };
            kept.bytes -= oldest.len();
        }
    }

    /// All lines that are kept.
    #[must_use]
    pub fn text(&self) -> String {
        self.lock().lines.iter().map(AsRef::as_ref).collect()
    }

    fn lock(&self) -> MutexGuard<'_, RecentLines> {
        self.lines.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// `line` without escape sequences, which end with a letter.
fn without_colours(line: &str) -> String {
    let mut parts = line.split('\u{1b}');
    let mut plain = parts.next().unwrap_or_default().to_owned();
    for part in parts {
        let end = part
            .find(|c: char| c.is_ascii_alphabetic())
            .map_or(part.len(), |at| at + 1);
        plain.push_str(&part[end..]);
    }
    plain
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_newest_lines_are_kept_without_colours() {
        let log = RecentLog::new();
        log.keep(b"\x1b[2m2026\x1b[0m \x1b[32m INFO\x1b[0m running\n");
        assert_eq!(log.text(), "2026  INFO running\n");
        for number in 0..10_000 {
            log.keep(format!("line {number} {}\n", "x".repeat(50)).as_bytes());
        }
        let text = log.text();
        assert!(
            text.len() <= BYTES_MAX && text.contains("line 9999") && !text.contains("running"),
            "{}",
            text.len()
        );
    }
}
