//! Progress of a long task: one line that is redrawn on a terminal, and not shown on a pipe. What is worth a line of
//! its own is printed on both. All of it goes to standard error.

use super::log::complain;
use std::io::{self, IsTerminal};
use std::time::Duration;

/// Characters of the bar.
const WIDTH: usize = 30;

/// One line with a bar.
#[derive(Debug)]
pub struct ProgressBar {
    all: usize,
    done: usize,
    what: String,
    is_terminal: bool,
}

impl ProgressBar {
    /// A bar with this many steps.
    #[must_use]
    pub fn new(all: usize) -> Self {
        Self {
            all,
            done: 0,
            what: String::new(),
            is_terminal: io::stderr().is_terminal(),
        }
    }

    /// One step is done.
    pub fn step(&mut self) {
        self.done = (self.done + 1).min(self.all);
        self.draw();
    }

    /// Sets the number of steps.
    pub fn of(&mut self, all: usize) {
        self.all = all;
    }

    /// This many steps are done, and this is next.
    pub fn to(&mut self, done: usize, what: &str) {
        self.done = done.min(self.all);
        self.what = what.to_owned();
        self.draw();
    }

    /// Prints a line above the bar.
    pub fn line(&mut self, text: &str) {
        self.end();
        complain(format!("{text}\n").as_bytes());
        self.draw();
    }

    /// Removes the bar.
    pub fn end(&mut self) {
        if self.is_terminal {
            complain(b"\r\x1b[2K");
        }
    }

    fn draw(&self) {
        if self.is_terminal {
            complain(format!("\r\x1b[2K{}", self.text()).as_bytes());
        }
    }

    fn text(&self) -> String {
        let all = self.all.max(1);
        let filled = WIDTH * self.done / all;
        let per_cent = 100 * self.done / all;
        format!(
            "[{}{}] {per_cent:3} % {}",
            "#".repeat(filled),
            "-".repeat(WIDTH - filled),
            self.what
        )
    }
}

/// A time in words: `45 s`, `3 min 20 s`, `2 h 5 min`.
#[must_use]
pub fn seconds(time: Duration) -> String {
    let all = time.as_secs_f64().ceil() as u64;
    match (all / 3600, all / 60 % 60, all % 60) {
        (0, 0, seconds) => format!("{seconds} s"),
        (0, minutes, seconds) => format!("{minutes} min {seconds} s"),
        (hours, minutes, _) => format!("{hours} h {minutes} min"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_bar_fills_from_left_to_right_and_no_further() {
        let mut bar = ProgressBar {
            all: 4,
            done: 0,
            what: "9600 8N1".to_owned(),
            is_terminal: false,
        };
        assert_eq!(bar.text(), format!("[{}]   0 % 9600 8N1", "-".repeat(30)));
        bar.step();
        assert!(
            bar.text().starts_with("[#######-") && bar.text().contains(" 25 %"),
            "{}",
            bar.text()
        );
        for _ in 0..9 {
            bar.step();
        }
        assert!(
            bar.text()
                .starts_with(&format!("[{}] 100 %", "#".repeat(30))),
            "{}",
            bar.text()
        );
        assert!(
            ProgressBar {
                all: 0,
                done: 0,
                what: String::new(),
                is_terminal: false
            }
            .text()
            .contains("  0 %")
        );
    }

    #[test]
    fn times_are_rounded_up() {
        for (millis, text) in [
            (0, "0 s"),
            (1, "1 s"),
            (59_500, "1 min 0 s"),
            (200_000, "3 min 20 s"),
            (7_500_000, "2 h 5 min"),
        ] {
            assert_eq!(seconds(Duration::from_millis(millis)), text);
        }
    }
}
