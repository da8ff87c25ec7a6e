//! Asks the person at the terminal before something is done.

use super::{CommandFailure, print};
use std::io::{self, IsTerminal};

/// Asks the person at the terminal.
pub fn ask_for_consent() -> Result<(), CommandFailure> {
    ask("set this?", "nothing was set")
}

/// Asks the person at the terminal this `question`; unless the answer is yes, the error says what was done `otherwise`.
pub fn ask(question: &str, otherwise: &str) -> Result<(), CommandFailure> {
    if !io::stdin().is_terminal() {
        return Err(CommandFailure::wrong(format!(
            "{otherwise}: there is no terminal to ask on; add --yes"
        )));
    }
    print(&format!("{question} [y/N] "))?;
    // The question must be visible before the answer is awaited.
    io::Write::flush(&mut io::stdout()).map_err(CommandFailure::failed)?;
    let mut answer = String::new();
    io::stdin()
        .read_line(&mut answer)
        .map_err(CommandFailure::failed)?;
    let is_yes = ["y", "yes"].contains(&answer.trim().to_lowercase().as_str());
    if is_yes {
        Ok(())
    } else {
        Err(CommandFailure::failed(otherwise))
    }
}
