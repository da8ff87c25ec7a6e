//! Questions on the terminal, each asked until its answer can be used. Answers may also come from a pipe, a line each.

use super::passwords::SilentTerminal;
use super::{CommandFailure, print};
use crate::domain::link::{LinkSettings, Parity};
use rustix::termios::isatty;
use std::io::{BufRead, Write};

/// Longest line that is read in bytes.
const LINE_BYTES_MAX: u64 = 1024;

/// What a line consists of that was ended by Ctrl-C while the terminal is silent.
const CANCELLED: &str = "\u{3}";

/// The person who answers.
pub struct PersonQuestions<R> {
    input: R,
}

impl<R: BufRead> PersonQuestions<R> {
    /// Answers come from `input`.
    pub const fn new(input: R) -> Self {
        Self { input }
    }

    /// The answer to `question`, without spaces around it; empty if only Enter was pressed.
    pub fn ask(&mut self, question: &str) -> Result<String, CommandFailure> {
        print(&format!("{question}: "))?;
        std::io::stdout().flush().map_err(CommandFailure::failed)?;
        let mut line = Vec::new();
        let mut limited = std::io::Read::take(&mut self.input, LINE_BYTES_MAX);
        if limited
            .read_until(b'\n', &mut line)
            .map_err(CommandFailure::failed)?
            == 0
        {
            return Err(CommandFailure::failed(format!(
                "\nthe input ended before \"{question}\" was answered; nothing was written"
            )));
        }
        let line = String::from_utf8(line)
            .map_err(|_| CommandFailure::wrong("the answer is not valid UTF-8"))?;
        Ok(line.trim().to_owned())
    }

    /// Asks until `parse` accepts the answer. What is wrong with one is shown.
    pub fn ask_until<T>(
        &mut self,
        question: &str,
        mut parse: impl FnMut(&str) -> Result<T, String>,
    ) -> Result<T, CommandFailure> {
        loop {
            match parse(&self.ask(question)?) {
                Ok(value) => return Ok(value),
                Err(why) => print(&format!("  {why}\n"))?,
            }
        }
    }

    /// The value of a flag if it was given, otherwise the answer to `question`; Enter takes `default`.
    pub fn given_or_asked<T>(
        &mut self,
        given: Option<&str>,
        flag: &str,
        question: &str,
        default: Option<&str>,
        mut parse: impl FnMut(&str) -> Result<T, String>,
    ) -> Result<T, CommandFailure> {
        if let Some(text) = given {
            return parse(text.trim())
                .map_err(|why| CommandFailure::wrong(format!("{flag}: {why}")));
        }
        let shown = match default {
            None | Some("") => question.to_owned(),
            Some(default) => format!("{question} [{default}]"),
        };
        self.ask_until(&shown, |answer| {
            parse(if answer.is_empty() {
                default.unwrap_or_default()
            } else {
                answer
            })
        })
    }

    /// A password, which the terminal does not show.
    pub fn secret(&mut self, question: &str) -> Result<String, CommandFailure> {
        let stdin = std::io::stdin();
        let silence = if isatty(&stdin) {
            Some(SilentTerminal::begin(&stdin).map_err(CommandFailure::failed)?)
        } else {
            None
        };
        let answer = self.ask_until(question, |answer| match answer {
            "" => Err("an answer is needed".to_owned()),
            CANCELLED => Ok(None),
            text => Ok(Some(text.to_owned())),
        });
        drop(silence);
        answer?.ok_or_else(|| CommandFailure::failed("nothing was written"))
    }

    /// Text that must not be empty unless there is a `default`.
    pub fn text(&mut self, question: &str, default: &str) -> Result<String, CommandFailure> {
        let shown = if default.is_empty() {
            question.to_owned()
        } else {
            format!("{question} [{default}]")
        };
        self.ask_until(&shown, |answer| match (answer, default) {
            ("", "") => Err("an answer is needed".to_owned()),
            ("", default) => Ok(default.to_owned()),
            (answer, _) => Ok(answer.to_owned()),
        })
    }

    /// Yes or no; Enter is `default`.
    pub fn yes(&mut self, question: &str, default: bool) -> Result<bool, CommandFailure> {
        let choice = if default { "Y/n" } else { "y/N" };
        self.ask_until(&format!("{question} [{choice}]"), |answer| {
            yes_or_no(answer, default)
        })
    }
}

/// An address or a word, in decimal or as 0x2000 or 2000H.
pub fn parse_word(text: &str) -> Result<u16, String> {
    let hex = text.strip_prefix("0x").or_else(|| text.strip_prefix("0X"));
    let hex = hex.or_else(|| text.strip_suffix('H').or_else(|| text.strip_suffix('h')));
    let parsed = match hex {
        Some(digits) => u16::from_str_radix(digits, 16),
        None => text.parse(),
    };
    parsed.map_err(|_| {
        format!(
            "`{text}` is not a number from 0 to 65535; hexadecimal numbers are written 0x2000 or \
             2000H"
        )
    })
}

/// An address, and after a space where the manual states it; `None` for an empty answer.
pub fn address_and_place(text: &str) -> Result<Option<(u16, Option<String>)>, String> {
    match with_place(text) {
        ("", _) => Ok(None),
        (first, place) => Ok(Some((parse_word(first)?, place))),
    }
}

/// Yes or no, and after a space where the manual states it; `default` for an empty answer.
pub fn yes_and_place(text: &str, default: bool) -> Result<(bool, Option<String>), String> {
    let (first, place) = with_place(text);
    yes_or_no(first, default).map(|yes| (yes, place))
}

fn yes_or_no(text: &str, default: bool) -> Result<bool, String> {
    match text.to_lowercase().as_str() {
        "" => Ok(default),
        "y" | "yes" => Ok(true),
        "n" | "no" => Ok(false),
        other => Err(format!("`{other}` is neither y nor n")),
    }
}

/// The first word of an answer, and the place in the manual that follows it.
fn with_place(text: &str) -> (&str, Option<String>) {
    let text = text.trim();
    let (first, place) = text.split_once(char::is_whitespace).unwrap_or((text, ""));
    let place = place.trim();
    (first, (!place.is_empty()).then(|| place.to_owned()))
}

/// Settings of a line, as `9600 8N1`, and after a space where the manual states them; `None` for an empty answer.
pub fn link_and_place(text: &str) -> Result<Option<(LinkSettings, Option<String>)>, String> {
    let (baud, format) = with_place(text);
    let (format, place) = with_place(format.as_deref().unwrap_or_default());
    let settings = link(format!("{baud} {format}").trim())?;
    Ok(settings.map(|settings| (settings, place)))
}

/// Settings of a line, as `9600 8N1`; `None` for an empty answer.
fn link(text: &str) -> Result<Option<LinkSettings>, String> {
    let wrong = || format!("`{text}` is not a speed and a character format, such as 9600 8N1");
    if text.is_empty() {
        return Ok(None);
    }
    let (baud, format) = text.split_once(' ').ok_or_else(wrong)?;
    let baud = baud
        .parse()
        .ok()
        .filter(|baud| (300..=1_000_000).contains(baud))
        .ok_or_else(wrong)?;
    let (parity, stop_bits) = match format.trim().to_ascii_uppercase().as_str() {
        "8N1" => (Parity::None, 1),
        "8N2" => (Parity::None, 2),
        "8E1" => (Parity::Even, 1),
        "8E2" => (Parity::Even, 2),
        "8O1" => (Parity::Odd, 1),
        "8O2" => (Parity::Odd, 2),
        _ => return Err(wrong()),
    };
    Ok(Some(LinkSettings {
        baud,
        data_bits: 8,
        parity,
        stop_bits,
    }))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn addresses_are_read_as_manuals_print_them() {
        assert_eq!(parse_word("0x2000"), Ok(0x2000));
        assert_eq!(parse_word("2000H"), Ok(0x2000));
        assert_eq!(parse_word("8192"), Ok(8192));
        assert!(
            parse_word("2000G").is_err() && parse_word("65536").is_err() && parse_word("").is_err()
        );
        let with = address_and_place("0x2101 table 9-3").unwrap();
        assert_eq!(with, Some((0x2101, Some("table 9-3".to_owned()))));
        assert_eq!(address_and_place("0x2101"), Ok(Some((0x2101, None))));
        assert_eq!(address_and_place("  "), Ok(None));
    }

    #[test]
    fn a_line_is_written_as_everywhere() {
        assert_eq!(link("19200 8e1").unwrap().unwrap().to_string(), "19200 8E1");
        assert_eq!(link(""), Ok(None));
        assert!(link("9600").is_err() && link("9600 7N2").is_err() && link("0 8N1").is_err());
    }

    #[test]
    fn every_answer_may_name_its_place() {
        let (settings, place) = link_and_place("19200  8N1 table 9.1").unwrap().unwrap();
        assert_eq!(
            (settings.to_string().as_str(), place.as_deref()),
            ("19200 8N1", Some("table 9.1"))
        );
        assert_eq!(link_and_place("9600 8E1").unwrap().unwrap().1, None);
        assert_eq!(link_and_place(" "), Ok(None));
        assert!(link_and_place("9600").is_err() && link_and_place("9600 9.1").is_err());
        assert_eq!(
            yes_and_place("n 9.4", true),
            Ok((false, Some("9.4".to_owned())))
        );
        assert_eq!(yes_and_place("", true), Ok((true, None)));
        assert!(yes_and_place("9.4", true).is_err());
    }

    #[test]
    fn a_question_is_asked_until_it_is_answered() {
        let mut questions = PersonQuestions::new(&b"x\n\ny\n"[..]);
        assert!(
            questions.yes("really", false).is_ok_and(|it| !it),
            "Enter after a wrong answer is the default"
        );
        assert!(questions.yes("really", false).unwrap());
        let ended = questions.text("maker", "").unwrap_err();
        assert!(
            ended
                .to_string()
                .contains("before \"maker\" was answered; nothing was written"),
            "{ended}"
        );
    }
}
