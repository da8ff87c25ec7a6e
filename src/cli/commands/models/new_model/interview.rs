//! What is asked, and in which order. With a drive on a port, registers are read while they are named.

use super::facts::{
    CitedDocuments, FactEvidence, FlagFacts, ModelFacts, RegisterFacts, RunFacts, SetupFacts,
    WordFacts,
};
use super::live::LiveDrive;
use super::skeleton::capitalised;
use crate::cli::tools::questions::{
    PersonQuestions, address_and_place, link_and_place, yes_and_place,
};
use crate::cli::tools::{CommandFailure, print};
use std::io::BufRead;

/// Most raw steps in one hertz.
const STEPS_MAX: u16 = 10_000;
/// Most words that a Modbus read can have.
const WORDS_MAX: u16 = 125;

/// The person, and the drive if there is one.
pub struct ModelInterview<'i, R> {
    /// Who answers.
    pub questions: PersonQuestions<R>,
    /// The drive on the port.
    pub live: Option<&'i mut LiveDrive>,
    /// Whether a manual was named, so that a place is one in it.
    pub has_manual: bool,
}

impl<R: BufRead> ModelInterview<'_, R> {
    /// Asks everything. `id` is the model's identifier, `date` today.
    pub fn facts(&mut self, id: &str, date: &str) -> Result<ModelFacts, CommandFailure> {
        print(HEAD)?;
        let (maker, series) = id.split_once('-').unwrap_or((id, id));
        let vendor = self.questions.text("Maker", &capitalised(maker))?;
        let title = self.questions.text("Series", &series.to_uppercase())?;
        let manual = self
            .questions
            .ask("Title of the manual that you read from (Enter: none)")?;
        let manual = (!manual.is_empty()).then_some(manual);
        self.has_manual = manual.is_some();
        let documents = CitedDocuments {
            manual,
            answered_on: Some(date.to_owned()),
            template: None,
        };
        let person = FactEvidence::Person("not in the manual".to_owned());
        let settings = "Factory setting of the line, such as 9600 8N1 (Enter: not known)";
        let link = self.questions.ask_until(settings, link_and_place)?;
        let mut facts = ModelFacts {
            id: id.to_owned(),
            vendor,
            title,
            link: link.map(|(link, place)| (link, self.by_place(place, "factory setting"))),
            max_words: self.max_words()?,
            functions: self.functions()?,
            documents,
            evidence: person,
            run: None,
            flags: Vec::new(),
            setup: Vec::new(),
            registers: Vec::new(),
            left_out: Vec::new(),
        };
        self.readings(&mut facts)?;
        self.orders(&mut facts)?;
        if facts.registers.is_empty() {
            return Err(CommandFailure::wrong(
                "no register was named, so nothing could be read from the drive: nothing was \
                 written; first look up the address of the output frequency or of the status word",
            ));
        }
        Ok(facts)
    }

    fn max_words(&mut self) -> Result<(u16, FactEvidence), CommandFailure> {
        let (words, place) =
            self.questions
                .ask_until("Most words in one read (Enter: 1)", |answer| {
                    let (words, place) = address_and_place(answer)?.unwrap_or((1, None));
                    if (1..=WORDS_MAX).contains(&words) {
                        Ok((words, place))
                    } else {
                        Err(format!("`{words}` is not a number from 1 to {WORDS_MAX}"))
                    }
                })?;
        Ok((words, self.by_place(place, "words in one read")))
    }

    fn functions(&mut self) -> Result<(Vec<u8>, FactEvidence), CommandFailure> {
        let question = "Does it write single registers (function 06) [Y/n]";
        let (writes_one, place) = self
            .questions
            .ask_until(question, |answer| yes_and_place(answer, true))?;
        Ok((
            vec![0x03, if writes_one { 0x06 } else { 0x10 }],
            self.by_place(place, "functions"),
        ))
    }

    fn readings(&mut self, facts: &mut ModelFacts) -> Result<(), CommandFailure> {
        if let Some((address, evidence)) = self.register("Output frequency", "none")? {
            let (scale, evidence) = self.scale(address, "output frequency", evidence)?;
            let of = RegisterIdentity {
                name: "output_frequency",
                title: "Output frequency",
                role: Some("output-frequency"),
            };
            facts
                .registers
                .push(of.read(address, scale, "Hz", "fast", evidence));
        }
        if let Some((address, evidence)) = self.register("Status word", "none")? {
            let of = RegisterIdentity {
                name: "status",
                title: "Status",
                role: None,
            };
            facts
                .registers
                .push(of.read(address, 1, "-", "fast", evidence));
            self.flags(address, facts)?;
        }
        if let Some((address, evidence)) =
            self.register("Number of the trip that holds, 0 for no trip", "none")?
        {
            let of = RegisterIdentity {
                name: "trip_code",
                title: "Trip that holds, 0 for none",
                role: Some("trip-code"),
            };
            facts
                .registers
                .push(of.read(address, 1, "-", "fast", evidence));
        }
        Ok(())
    }

    /// Bits of the status word. With a drive, `running` is what differs between standstill and running.
    fn flags(&mut self, address: u16, facts: &mut ModelFacts) -> Result<(), CommandFailure> {
        let seen = self.running_bits(address)?;
        let shown = seen
            .map(|bits| format!(" [0x{bits:04X}]"))
            .unwrap_or_default();
        for (flag, when, seen, shown) in [
            ("running", "the motor runs", seen, shown.as_str()),
            ("tripped", "a trip holds", None, ""),
        ] {
            let question = format!(
                "Bits of it that are 1 while {when}, and place, such as `0x0001 9.6` for bit 0 (Enter: none){shown}"
            );
            let given =
                self.questions
                    .ask_until(&question, |answer| match address_and_place(answer)? {
                        Some((0, _)) => Err("no bit is set in 0".to_owned()),
                        given => Ok(given),
                    })?;
            if let Some((mask, _)) = &given {
                print(&format!("  that is {}\n", bits_named(*mask)))?;
            }
            let found = match (given, seen) {
                (Some((mask, place)), _) => Some((mask, self.by_place(place, "bits"))),
                (None, Some(bits)) => {
                    Some((bits, FactEvidence::Person("seen at the drive".to_owned())))
                }
                (None, None) => None,
            };
            facts.flags.extend(found.map(|(mask, evidence)| FlagFacts {
                flag,
                mask,
                evidence,
            }));
        }
        Ok(())
    }

    /// The bits that are 0 at standstill and 1 while the motor runs; `None` without a drive, or if there are none.
    fn running_bits(&mut self, address: u16) -> Result<Option<u16>, CommandFailure> {
        if self.live.is_none()
            || !self.questions.yes(
                "Find the bit for `running`: can you run the motor at the panel",
                false,
            )?
        {
            return Ok(None);
        }
        self.questions
            .ask("Stop the motor at the panel, and press Enter")?;
        let at_rest = self.read(address)?;
        self.questions
            .ask("Run it forward at the panel, and press Enter")?;
        let running = self.read(address)?;
        let (Some(at_rest), Some(running)) = (at_rest, running) else {
            return Ok(None);
        };
        let bits = running & !at_rest;
        print(&format!(
            "  at standstill 0x{at_rest:04X}, running 0x{running:04X}: 1 while it runs: 0x{bits:04X}\n"
        ))?;
        // A single bit says one thing; of several the person knows which.
        Ok((bits.count_ones() == 1).then_some(bits))
    }

    fn orders(&mut self, facts: &mut ModelFacts) -> Result<(), CommandFailure> {
        if !facts
            .registers
            .iter()
            .any(|it| it.role == Some("output-frequency"))
        {
            return print(
                "Without an output frequency a stop cannot be seen, so the model is read-only.\n",
            );
        }
        let Some((address, evidence)) = self.register("Run command", "the model is only read")?
        else {
            return Ok(());
        };
        let of = RegisterIdentity {
            name: "run_command",
            title: "Run command",
            role: Some("run-command"),
        };
        facts
            .registers
            .push(of.written(address, 1, "-", "write", evidence));
        print(
            "Each word needs its own place in the manual: the page that names the register may not \
             be the one with its words.\n",
        )?;
        let stop = self
            .needed_word("  word that stops the motor by its ramp, and place, such as `0 9.5`")?;
        let forward = self.needed_word("  word that runs it forward, and place")?;
        let reverse = self.order_word(
            "  word that runs it in reverse, and place (Enter: none)",
            Ok,
        )?;
        facts.run = Some(RunFacts {
            stop,
            forward,
            reverse,
        });
        let setpoint = self.questions.ask_until(
            "Frequency command: address, and place in the manual",
            |answer| {
                address_and_place(answer)?.ok_or_else(|| "a drive that runs needs it".to_owned())
            },
        )?;
        let (address, evidence) = self.placed(setpoint)?;
        let (scale, evidence) = self.scale(address, "set frequency", evidence)?;
        let of = RegisterIdentity {
            name: "frequency_command",
            title: "Frequency command",
            role: Some("frequency-command"),
        };
        facts
            .registers
            .push(of.written(address, scale, "Hz", "read-write", evidence));
        self.setup(facts)
    }

    fn needed_word(&mut self, question: &str) -> Result<WordFacts, CommandFailure> {
        self.order_word(question, |given| {
            given
                .map(Some)
                .ok_or_else(|| "a drive that runs needs it".to_owned())
        })?
        .ok_or_else(|| CommandFailure::failed("no word was given"))
    }

    /// A word of the run command with the place that states it.
    fn order_word(
        &mut self,
        question: &str,
        is_enough: impl Fn(
            Option<(u16, Option<String>)>,
        ) -> Result<Option<(u16, Option<String>)>, String>,
    ) -> Result<Option<WordFacts>, CommandFailure> {
        let given = self
            .questions
            .ask_until(question, |answer| is_enough(address_and_place(answer)?))?;
        Ok(given.map(|(value, place)| WordFacts {
            value,
            evidence: self.by_place(place, "word"),
        }))
    }

    /// The manual at `place`, or the person.
    fn by_place(&self, place: Option<String>, what: &str) -> FactEvidence {
        match place {
            Some(place) if self.has_manual => FactEvidence::Manual(place),
            Some(place) => FactEvidence::Person(format!("{place}; no manual was named")),
            None => FactEvidence::Person(format!("{what}, not in the manual")),
        }
    }

    fn setup(&mut self, facts: &mut ModelFacts) -> Result<(), CommandFailure> {
        print("Settings under which it obeys the line, one after the other.\n")?;
        loop {
            let code = self
                .questions
                .ask("  code at the panel, such as P0-02 (Enter: no more)")?;
            if code.is_empty() {
                return Ok(());
            }
            let text = self
                .questions
                .text("  what it selects, and its value", "")?;
            let place = self.questions.ask("  place in the manual (Enter: none)")?;
            let evidence = self.by_place((!place.is_empty()).then_some(place), "setting");
            facts.setup.push(SetupFacts {
                code,
                text,
                evidence,
            });
        }
    }

    /// A register by its address; `None` if the drive has none, or it is not known, which means `without`.
    fn register(
        &mut self,
        what: &str,
        without: &str,
    ) -> Result<Option<(u16, FactEvidence)>, CommandFailure> {
        let question = format!(
            "{what}: address, and place in the manual, such as `0x2101 table 9-3` (Enter: {without})"
        );
        match self.questions.ask_until(&question, address_and_place)? {
            Some(given) => self.placed(given).map(Some),
            None => Ok(None),
        }
    }

    fn placed(
        &mut self,
        (address, place): (u16, Option<String>),
    ) -> Result<(u16, FactEvidence), CommandFailure> {
        self.read(address)?;
        Ok((address, self.by_place(place, &format!("0x{address:04X}"))))
    }

    /// What the drive holds at `address`, which is shown; `None` without a drive or an answer.
    fn read(&mut self, address: u16) -> Result<Option<u16>, CommandFailure> {
        let Some(live) = &mut self.live else {
            return Ok(None);
        };
        let read = live.read(address)?;
        match &read {
            Ok(word) => print(&format!("  the drive has {word} (0x{word:04X}) there\n"))?,
            Err(why) => print(&format!(
                "  {why} at 0x{address:04X}: look again before you rely on it\n"
            ))?,
        }
        Ok(read.ok())
    }

    /// Raw steps in one hertz, and the evidence of the register with theirs. With a drive, from what its panel shows.
    fn scale(
        &mut self,
        address: u16,
        what: &str,
        evidence: FactEvidence,
    ) -> Result<(u32, FactEvidence), CommandFailure> {
        let found = self.compared(address, what)?;
        let shown = found.map(|scale| format!(" [{scale}]")).unwrap_or_default();
        let question =
            format!("  raw steps in one hertz: 10 for steps of 0.1 Hz, 100 for 0.01 Hz{shown}");
        let (scale, place) = self.questions.ask_until(&question, |answer| {
            let wrong = || format!("`{answer}` is not a number from 1 to {STEPS_MAX}");
            match (address_and_place(answer)?, found) {
                (Some((scale, place)), _) if (1..=STEPS_MAX).contains(&scale) => {
                    Ok((u32::from(scale), place))
                }
                (None, Some(scale)) => Ok((scale, None)),
                _ => Err(wrong()),
            }
        })?;
        Ok((scale, evidence.and_steps(place)))
    }

    fn compared(&mut self, address: u16, what: &str) -> Result<Option<u32>, CommandFailure> {
        if self.live.is_none() {
            return Ok(None);
        }
        let shown = self.questions.ask_until(
            &format!("  what does the panel show as {what} now, in Hz (Enter: skip)"),
            |answer| match answer {
                "" => Ok(None),
                text => text
                    .parse()
                    .ok()
                    .filter(|hz| (0.0..=1000.0).contains(hz))
                    .map(Some)
                    .ok_or_else(|| format!("`{text}` is not a frequency in Hz")),
            },
        )?;
        let Some(shown_hz) = shown else {
            return Ok(None);
        };
        let Some(raw) = self.read(address)? else {
            return Ok(None);
        };
        let scale = scale_of(raw, shown_hz);
        if scale.is_none() {
            print("  no power of ten fits: run the motor, or look the steps up\n")?;
        }
        Ok(scale)
    }
}

/// The power of ten that makes `raw` what the panel shows; `None` if none does, or at zero, where all do.
fn scale_of(raw: u16, shown_hz: f64) -> Option<u32> {
    let fits = |scale: &u32| {
        let hz = f64::from(raw) / f64::from(*scale);
        (hz - shown_hz).abs() <= shown_hz * 0.02
    };
    if raw == 0 || shown_hz <= 0.0 {
        None
    } else {
        [1, 10, 100, 1000].into_iter().find(fits)
    }
}

/// The bits of `mask` by their numbers, from 0 on.
fn bits_named(mask: u16) -> String {
    let bits: Vec<_> = (0..16_u16)
        .filter(|bit| mask & (1 << *bit) != 0)
        .map(|bit| bit.to_string())
        .collect();
    match bits.split_last() {
        Some((last, [])) => format!("bit {last}"),
        Some((last, others)) => format!("bits {} and {last}", others.join(", ")),
        None => "no bit".to_owned(),
    }
}

/// What a register is.
struct RegisterIdentity {
    name: &'static str,
    title: &'static str,
    role: Option<&'static str>,
}

impl RegisterIdentity {
    fn read(
        self,
        address: u16,
        scale: u32,
        unit: &'static str,
        poll: &'static str,
        evidence: FactEvidence,
    ) -> RegisterFacts {
        RegisterFacts {
            poll: Some(poll),
            ..self.written(address, scale, unit, "read", evidence)
        }
    }

    fn written(
        self,
        address: u16,
        scale: u32,
        unit: &'static str,
        access: &'static str,
        evidence: FactEvidence,
    ) -> RegisterFacts {
        RegisterFacts {
            name: self.name.to_owned(),
            title: self.title.to_owned(),
            address,
            table: None,
            scale,
            unit,
            signed: false,
            access,
            role: self.role,
            poll: None,
            evidence,
        }
    }
}

/// What is said first.
const HEAD: &str = "\
Addresses are those on the wire, counted from 0, in decimal or as 0x2000 or 2000H. After an answer and a space, name the place in
the manual that states it: what has none is `third-party`. Nothing is written to a drive, and no file before you have seen what it
says.
";

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_mask_is_told_as_bits() {
        for (mask, bits) in [
            (1, "bit 0"),
            (3, "bits 0 and 1"),
            (8, "bit 3"),
            (0x8011, "bits 0, 4 and 15"),
        ] {
            assert_eq!(bits_named(mask), bits);
        }
    }

    #[test]
    fn a_scale_is_a_power_of_ten_that_fits_what_is_shown() {
        assert_eq!(scale_of(5000, 50.0), Some(100));
        assert_eq!(scale_of(301, 30.0), Some(10), "the panel rounds");
        assert_eq!(scale_of(8192, 50.0), None);
        assert_eq!(scale_of(0, 0.0), None);
    }
}
