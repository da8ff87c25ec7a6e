//! The person at the keyboard, who is asked while the motor is watched.

use crate::cli::tools::{CommandFailure, print};
use std::io::{self, BufRead, Write};
use tokio::sync::mpsc::{Receiver, channel};

/// Lines that wait to be read; what is typed before a question is dropped.
const LINES_MAX: usize = 16;

/// Lines as they are typed.
#[derive(Debug)]
pub(super) struct TypedLines {
    lines: Receiver<String>,
}

impl TypedLines {
    /// Listens on stdin from now on. The thread exits with stdin or with the program.
    pub fn listen() -> io::Result<Self> {
        let (give, lines) = channel(LINES_MAX);
        let listen = move || {
            for line in io::stdin().lock().lines().map_while(Result::ok) {
                if give.blocking_send(line).is_err() {
                    return;
                }
            }
        };
        std::thread::Builder::new()
            .name("keyboard".to_owned())
            .spawn(listen)?;
        Ok(Self { lines })
    }

    /// The answer to `question`; `None` at the end of the input. What was typed before it was asked is no answer.
    pub async fn ask(&mut self, question: &str) -> Result<Option<String>, CommandFailure> {
        while self.lines.try_recv().is_ok() {}
        print(question)?;
        io::stdout().flush().map_err(CommandFailure::failed)?;
        Ok(self.lines.recv().await)
    }
}

/// Whether `answer` agrees.
pub(super) fn is_yes(answer: &str) -> bool {
    ["y", "yes"].contains(&answer.trim().to_lowercase().as_str())
}

/// Whether `answer` leaves this one out.
pub(super) fn is_skip(answer: &str) -> bool {
    ["s", "skip"].contains(&answer.trim().to_lowercase().as_str())
}
