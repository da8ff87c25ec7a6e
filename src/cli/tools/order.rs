//! An order of one word to one drive, written and answered for; and the stop after it.

use super::CommandFailure;
use super::client::{LEASE_LEFT, NoAnswer, UnitClient, reason};
use super::stopping::{self, stop};
use crate::domain::frequency::{Hertz, NoFrequency};
use crate::north::modbus::address as map;
use crate::north::modbus::uniform::run;
use crate::wire::exception;

/// What is to be written.
#[derive(Debug, PartialEq, Eq)]
pub struct WriteOrder {
    /// Address of the register.
    pub address: u16,
    /// The word.
    pub word: u16,
    /// For the uniform unit.
    pub is_uniform: bool,
    /// Text for people.
    pub text: String,
    /// What else it does at a unit that is taken for a native one: it makes a motor run, or takes it over.
    pub starts: Option<String>,
}

impl WriteOrder {
    /// Whether it makes a motor run.
    #[must_use]
    pub fn makes_run(&self) -> bool {
        self.is_uniform
            && self.address == map::RUN
            && matches!(self.word, run::FORWARD | run::REVERSE)
    }

    /// Whether it takes the drive over and moves nothing.
    #[must_use]
    pub fn takes(&self) -> bool {
        self.is_uniform && self.address == map::RUN && self.word == run::TAKE
    }

    /// Whether it stops the drive or cuts its output off.
    #[must_use]
    pub fn stops(&self) -> bool {
        self.is_uniform && self.address == map::RUN && matches!(self.word, run::STOP | run::COAST)
    }

    /// What is said if a person ends the program before it is done.
    #[must_use]
    pub fn interrupted(&self) -> String {
        let what = if self.stops() {
            "its effect was seen: the motor may still run"
        } else {
            "an answer arrived: it may have been carried out"
        };
        format!("{}: interrupted before {what}", self.text)
    }

    /// Writes it. A stop is done once the drive shows its effect.
    ///
    /// # Errors
    /// It is refused, has no effect, or there is no answer.
    pub async fn send(&self, client: &mut UnitClient) -> Result<(), CommandFailure> {
        if self.stops() {
            let stopped = stopping::confirmed(client, self.word).await;
            return stopped
                .map_err(|failure| CommandFailure::failed(format!("{}: {failure}", self.text)));
        }
        match client.write(self.address, self.word).await {
            Ok(()) => Ok(()),
            Err(error) => Err(self.explained(client, &error).await),
        }
    }

    /// Writes a run command, and returns which one is in force then; `None` if there is nothing to hold. If its outcome
    /// is unknown, a stop follows: otherwise a motor might run unsupervised. After a take it does not: it might stop
    /// another client's drive.
    ///
    /// # Errors
    /// It is refused, or there is no answer.
    pub async fn run(&self, client: &mut UnitClient) -> Result<Option<u16>, CommandFailure> {
        let error = match client.write(self.address, self.word).await {
            Ok(()) if self.takes() => return self.taken(client).await,
            Ok(()) => return Ok(Some(self.word)),
            Err(error) => error,
        };
        if self.takes()
            || !matches!(
                error,
                NoAnswer::Exception(exception::GATEWAY_TARGET_FAILED) | NoAnswer::Lost(_)
            )
        {
            return Err(self.explained(client, &error).await);
        }
        let then = match stop(client).await {
            Ok(text) => text,
            Err(failure) => failure.message,
        };
        Err(CommandFailure::failed(format!(
            "{}: {error}; it may have been carried out, so it is stopped: {then}",
            self.text
        )))
    }

    /// The run command that was taken over with the lease; `None` if no client holds one.
    async fn taken(&self, client: &mut UnitClient) -> Result<Option<u16>, CommandFailure> {
        let read = async |client: &mut UnitClient, address| match client.read(address, 1).await {
            Ok(words) => Ok(words.first().copied().unwrap_or(0)),
            Err(error) => Err(CommandFailure::failed(format!(
                "{}: acknowledged, but then: {error}",
                self.text
            ))),
        };
        if read(client, LEASE_LEFT).await? == 0 {
            return Ok(None);
        }
        read(client, map::RUN).await.map(Some)
    }

    /// The error, for a uniform unit with the reason that the gateway records there.
    async fn explained(&self, client: &mut UnitClient, error: &NoAnswer) -> CommandFailure {
        let mut text = format!("{}: {error}", self.text);
        if self.is_uniform && matches!(error, NoAnswer::Exception(_)) {
            text.push_str(&reason(client).await);
        }
        CommandFailure::failed(text)
    }
}

/// The word of a frequency in Hz, such as 42.5.
///
/// # Errors
/// It is none, or out of range.
pub fn frequency(value: &str) -> Result<u16, CommandFailure> {
    let wrong = |what: &dyn std::fmt::Display| {
        CommandFailure::wrong(format!("{value} is not a frequency such as 42.5: {what}"))
    };
    let hertz = Hertz::parse(value).map_err(|error| wrong(&error))?;
    if !hertz.millihertz().is_multiple_of(10) {
        return Err(wrong(&"finer than 0.01 Hz"));
    }
    hertz
        .centihertz()
        .ok_or_else(|| wrong(&NoFrequency::OutOfRange))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frequencies_are_exact_or_refused() {
        assert_eq!(frequency("42.5").unwrap(), 4250);
        assert_eq!(frequency("0.01").unwrap(), 1);
        for (wrong, why) in [
            ("42.505", "finer"),
            ("655.36", "range"),
            ("-1", "range"),
            ("4,5", "number"),
            ("fast", "number"),
        ] {
            let failure = frequency(wrong).unwrap_err();
            assert!(
                failure.message.contains(why),
                "{wrong}: {}",
                failure.message
            );
            assert_eq!(failure.code, crate::cli::tools::failure::WRONG_USAGE);
        }
    }
}
