//! `watch` on a terminal: a table that is redrawn, and the terminal restored afterwards.

use crate::cli::tools::CommandFailure;
use crate::cli::tools::reading::ShownValue;
use crate::domain::time::MonoTime;
use std::fmt::Write as _;
use std::io::{self, IsTerminal, Write};
use std::time::Duration;

/// How long a change is marked.
const MARKED_FOR: Duration = Duration::from_secs(3);
/// Lines besides the rows: title, head, error, exit hint.
const OTHER_LINES: usize = 5;

/// A view that takes the terminal until it is dropped.
pub struct TerminalView {
    title: String,
    rows: Vec<ViewRow>,
    /// Why there was no answer to the last request, if there was none.
    trouble: Option<String>,
}

struct ViewRow {
    shown: ShownValue,
    read_at: MonoTime,
    changed_at: Option<MonoTime>,
}

impl TerminalView {
    /// Whether the output is a terminal.
    #[must_use]
    pub fn is_possible() -> bool {
        io::stdout().is_terminal()
    }

    /// Takes the terminal.
    ///
    /// # Errors
    /// It cannot be written to.
    pub fn open(title: String) -> Result<Self, CommandFailure> {
        // Another screen, without a cursor.
        put("\x1b[?1049h\x1b[?25l")?;
        Ok(Self {
            title,
            rows: Vec::new(),
            trouble: None,
        })
    }

    /// Shows `values`, which were read at `now`.
    pub fn values(&mut self, values: Vec<ShownValue>, now: MonoTime) {
        self.trouble = None;
        let mut old = std::mem::take(&mut self.rows);
        for shown in values {
            let before = old
                .iter()
                .position(|row| row.shown.label == shown.label)
                .map(|at| old.swap_remove(at));
            let changed_at = match before {
                Some(row) if row.shown == shown => row.changed_at,
                Some(_) => Some(now),
                None => None,
            };
            self.rows.push(ViewRow {
                shown,
                read_at: now,
                changed_at,
            });
        }
    }

    /// The read failed, for this reason.
    pub fn trouble(&mut self, reason: &str) {
        self.trouble = Some(reason.to_owned());
    }

    /// Draws it as of `now`.
    ///
    /// # Errors
    /// The terminal cannot be written to.
    pub fn draw(&self, now: MonoTime) -> Result<(), CommandFailure> {
        let (columns, lines) = size();
        let text = self.text(now, columns, lines);
        // Overwrites each line to its end, and clears what is below: this does not flicker.
        put(&format!("\x1b[H{}\x1b[J", text.replace('\n', "\x1b[K\r\n")))
    }

    /// The content of a screen with this many columns and lines.
    fn text(&self, now: MonoTime, columns: usize, lines: usize) -> String {
        let width = |of: fn(&ViewRow) -> usize| self.rows.iter().map(of).max().unwrap_or(0);
        let names = width(|row| row.shown.label.chars().count()).max(4);
        let values = width(|row| row.shown.text().chars().count()).max(5);
        let mut all = vec![
            self.title.clone(),
            format!(
                "  {:names$}  {:values$}  {:>8}  {}",
                "name", "value", "age", "changed"
            ),
        ];
        let room = lines.saturating_sub(OTHER_LINES).max(1);
        for row in self.rows.iter().take(room) {
            let age = format!("{:.1} s", now.since(row.read_at).as_secs_f64());
            let since = row.changed_at.map(|at| now.since(at));
            let mark = if since.is_some_and(|since| since < MARKED_FOR) {
                '*'
            } else {
                ' '
            };
            let since = since
                .map(|since| format!("{} s ago", since.as_secs()))
                .unwrap_or_default();
            all.push(format!(
                "{mark} {:names$}  {:values$}  {age:>8}  {since}",
                row.shown.label,
                row.shown.text()
            ));
        }
        let hidden = self.rows.len().saturating_sub(room);
        if hidden > 0 {
            all.push(format!("  and {hidden} more: make the window taller"));
        }
        if let Some(trouble) = &self.trouble {
            all.push(format!("NO ANSWER: {trouble}; trying again"));
        }
        all.push("Ctrl-C ends".to_owned());
        let mut text = String::new();
        for line in all {
            let _ = writeln!(
                text,
                "{}",
                line.chars().take(columns).collect::<String>().trim_end()
            );
        }
        text
    }
}

impl Drop for TerminalView {
    fn drop(&mut self) {
        // The terminal may be gone.
        let _ = put("\x1b[?25h\x1b[?1049l");
    }
}

fn put(text: &str) -> Result<(), CommandFailure> {
    let mut out = io::stdout().lock();
    out.write_all(text.as_bytes())
        .and_then(|()| out.flush())
        .map_err(CommandFailure::failed)
}

/// Columns and lines of the terminal.
fn size() -> (usize, usize) {
    match rustix::termios::tcgetwinsize(io::stdout()) {
        Ok(size) if size.ws_col > 0 && size.ws_row > 0 => (size.ws_col.into(), size.ws_row.into()),
        _ => (80, 24),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn view() -> TerminalView {
        TerminalView {
            title: "pump".to_owned(),
            rows: Vec::new(),
            trouble: None,
        }
    }

    fn at(millis: u64) -> MonoTime {
        MonoTime::from_millis(millis)
    }

    #[test]
    fn changes_are_marked_for_a_while_and_ages_grow() {
        let mut view = view();
        view.values(
            vec![
                ShownValue::word("speed", 1, 10),
                ShownValue::word("load", 2, 5),
            ],
            at(0),
        );
        view.values(
            vec![
                ShownValue::word("speed", 1, 11),
                ShownValue::word("load", 2, 5),
            ],
            at(1000),
        );
        let lines: Vec<String> = view
            .text(at(1500), 80, 24)
            .lines()
            .map(str::to_owned)
            .collect();
        assert!(
            lines[2].starts_with("* speed") && lines[2].contains("0.5 s"),
            "{lines:?}"
        );
        assert!(lines[3].starts_with("  load"), "{lines:?}");
        view.trouble("the drive did not answer");
        let later = view.text(at(9000), 80, 24);
        assert!(
            later.contains("  speed") && later.contains("8.0 s") && later.contains("8 s ago"),
            "{later}"
        );
        assert!(
            later.contains("NO ANSWER: the drive did not answer"),
            "{later}"
        );
    }

    #[test]
    fn it_fits_into_the_window() {
        let mut view = view();
        view.values(
            (0..50)
                .map(|at| ShownValue::word(&format!("register {at}"), at, at))
                .collect(),
            at(0),
        );
        let text = view.text(at(0), 20, 10);
        assert!(text.lines().count() < 10, "{text}");
        assert!(
            text.lines().all(|line| line.chars().count() <= 20) && text.contains("and 45 more"),
            "{text}"
        );
    }
}
