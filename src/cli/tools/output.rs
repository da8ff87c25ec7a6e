//! What a command prints to stdout.

use super::CommandFailure;
use std::io::IsTerminal;

/// How a word is meant, for its colour on a terminal.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum WordTone {
    /// The value is as it should be.
    Good,
    /// Worth a look.
    Notice,
    /// Wrong.
    Problem,
}

/// `word` in the colour of `tone` if stdout is a terminal, unless `NO_COLOR` is set (https://no-color.org).
#[must_use]
pub fn toned(tone: WordTone, word: &str) -> String {
    let is_coloured = std::io::stdout().is_terminal()
        && std::env::var_os("NO_COLOR").is_none_or(|it| it.is_empty());
    if is_coloured {
        coloured(tone, word)
    } else {
        word.to_owned()
    }
}

fn coloured(tone: WordTone, word: &str) -> String {
    let code = match tone {
        WordTone::Good => 32,
        WordTone::Notice => 33,
        WordTone::Problem => 31,
    };
    format!("\x1b[{code}m{word}\x1b[0m")
}

/// `names`, or the first `most` of them and how many more there are.
#[must_use]
pub fn few(names: &[String], most: usize) -> String {
    match names.split_at_checked(most) {
        Some((first, rest)) if !rest.is_empty() => {
            format!("{} and {} more", first.join(", "), rest.len())
        }
        _ => names.join(", "),
    }
}

/// Prints to stdout. A reader that has gone away, such as `head`, ends the output without an error.
///
/// # Errors
/// Any other failure to write.
pub fn print(text: &str) -> Result<(), CommandFailure> {
    use std::io::Write;
    match std::io::stdout().lock().write_all(text.as_bytes()) {
        Err(error) if error.kind() != std::io::ErrorKind::BrokenPipe => {
            Err(CommandFailure::failed(error))
        }
        _ => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_tone_has_its_colour_and_ends_with_its_word() {
        assert_eq!(coloured(WordTone::Good, "up"), "\x1b[32mup\x1b[0m");
        assert_ne!(
            coloured(WordTone::Notice, "x"),
            coloured(WordTone::Problem, "x")
        );
    }
}
