//! Facts about models for operators: what they can be commanded, and which facts are not proven.

use crate::config;
use crate::domain::control::ControlAction;
use crate::profile::model::{
    Barrier, CodeRule, Confidence, DriveQuirks, Fact, Model, ModelLink, ModelTiming, RunCommand,
    RunForm,
};
use crate::profile::words::FLAGS;
use crate::toml_file::words::word_for;
use std::collections::BTreeMap;

/// The orders that every controllable drive has, which are accepted together.
pub const BASICS: [&str; 3] = ["stop", "frequency", "forward"];

/// An order for a drive, with the confidence of its fact.
pub type OrderWord = (&'static str, Confidence);

/// The orders for a drive of `model`.
///
/// # Errors
/// Why it cannot be controlled.
pub fn orders(model: &Model) -> Result<Vec<OrderWord>, String> {
    if let Some(why) = config::why_not_controlled(model) {
        return Err(why);
    }
    let Some(run) = &model.run else {
        return Ok(Vec::new());
    };
    let of = |fact: &Option<Fact<u16>>| fact.as_ref().map(|fact| fact.confidence);
    // Stop, forward and the setpoint are accepted together, so they are as sure as the least sure of them.
    let basic = model
        .unproven_basics()
        .into_iter()
        .map(|basic| basic.confidence)
        .max();
    let least =
        |confidence: Confidence| Some(basic.map_or(confidence, |basic| basic.max(confidence)));
    let forward = least(run.forward.confidence);
    let all = [
        (BASICS[0], least(run.stop.confidence)),
        // Every controllable drive takes a frequency.
        (BASICS[1], forward),
        (BASICS[2], forward),
        (ControlAction::Reverse.keyword(), of(&run.reverse)),
        (ControlAction::Coast.keyword(), of(&run.coast)),
        (ControlAction::Reset.keyword(), of(&run.reset)),
        (ControlAction::Release.keyword(), of(&run.release)),
    ];
    Ok(all
        .into_iter()
        .filter_map(|(word, confidence)| Some((word, confidence?)))
        .collect())
}

/// `orders`, separated by commas, those that have to be accepted marked. Where the basic ones have to be, nothing else can be
/// ordered without them.
pub fn orders_text(orders: &Result<Vec<OrderWord>, String>) -> String {
    let mark = |(word, confidence): &OrderWord| {
        if confidence.is_proven() {
            (*word).to_owned()
        } else {
            format!("{word} (unproven)")
        }
    };
    match orders {
        Ok(orders) => {
            let listed =
                |orders: &[OrderWord]| orders.iter().map(mark).collect::<Vec<_>>().join(", ");
            let (basics, others) = orders.split_at(BASICS.len().min(orders.len()));
            if others.is_empty() || basics.iter().all(|(_, confidence)| confidence.is_proven()) {
                return listed(orders);
            }
            format!(
                "{}; once these are accepted also {}",
                listed(basics),
                listed(others)
            )
        }
        Err(why) => format!("only read: {why}"),
    }
}

/// The facts of a model that no document of this very model states.
#[derive(Debug, Default)]
pub struct UnprovenFacts {
    by_confidence: BTreeMap<Confidence, Vec<String>>,
}

impl UnprovenFacts {
    /// Everything of `model` that is unproven.
    pub fn of(model: &Model) -> Self {
        let mut unproven = Self::default();
        unproven.link(&model.link);
        unproven.timing(&model.timing);
        unproven.reads(model);
        unproven.writes(model);
        unproven.quirks(&model.quirks);
        unproven.barriers(&model.barriers);
        if let Some(run) = &model.run {
            unproven.run(run);
        }
        unproven.meanings(model);
        unproven.settings(model);
        unproven.registers(model);
        unproven
    }

    /// Number of unproven facts.
    pub fn count(&self) -> usize {
        self.by_confidence.values().map(Vec::len).sum()
    }

    /// Each degree of confidence with its facts.
    pub fn groups(&self) -> impl Iterator<Item = (Confidence, &[String])> {
        self.by_confidence
            .iter()
            .map(|(confidence, names)| (*confidence, names.as_slice()))
    }

    fn link(&mut self, link: &ModelLink) {
        self.add("factory setting", &link.default);
        self.add("speeds", &link.bauds);
        self.add("data bits", &link.data_bits);
        self.add("parities", &link.parities);
        self.add("stop bits", &link.stop_bits);
        self.add("framings", &link.framings);
        self.add("interfaces", &link.interfaces);
        self.add("stations", &link.stations);
        self.add_some("broadcast", link.broadcast.as_ref().map(|it| &it.station));
    }

    fn timing(&mut self, timing: &ModelTiming) {
        self.add("silence between frames", &timing.gap_chars);
        self.add("longest wait for a reply", &timing.reply_timeout_cap);
        self.add_some("longest processing", timing.processing_max.as_ref());
        self.add_some(
            "longest processing of a stored write",
            timing.stored_write_max.as_ref(),
        );
        self.add_some("longest delay of replies", timing.reply_delay_max.as_ref());
        self.add_some("pause after a write", timing.pause_after_write.as_ref());
        self.add_some(
            "pause after a stored write",
            timing.pause_after_stored_write.as_ref(),
        );
        self.add_some(
            "bits of a character of replies",
            timing.reply_char_bits.as_ref(),
        );
        self.add("latest reply after a time-out", &timing.max_lateness);
    }

    fn reads(&mut self, model: &Model) {
        self.add("functions", &model.functions);
        self.add("words in one read", &model.read.max_words);
        self.add_some("longest frame", model.read.max_bytes.as_ref());
        self.add_some("what holes show", model.read.holes.as_ref());
        for area in &model.read.areas {
            self.add(
                format!("words in one read from 0x{:04X} on", area.from),
                &area.max_words,
            );
        }
        self.add_some(
            "words in one read in ASCII",
            model.read.max_words_ascii.as_ref(),
        );
    }

    fn writes(&mut self, model: &Model) {
        self.add("what a refused write looks like", &model.write.refused);
        self.add_some(
            "writes of a block",
            model.write.block.as_ref().map(|block| &block.count),
        );
        for exception in &model.exceptions {
            self.note(
                format!("exception {:02X} hex", exception.code),
                exception.confidence,
            );
        }
    }

    fn quirks(&mut self, quirks: &DriveQuirks) {
        self.add_some("decimal numbers", quirks.decimal_numbers.as_ref());
        self.add_some("per cent of rated values", quirks.percent_of_rated.as_ref());
        self.add_some("setpoint before run", quirks.setpoint_before_run.as_ref());
        self.add_some("stored twins", quirks.stored_alias_bit.as_ref());
        self.add_some("forms in RAM", quirks.ram_alias.as_ref());
        self.add_some("deaf after power-up", quirks.deaf_after_power_up.as_ref());
        self.add_some("deaf after a reset", quirks.deaf_after_reset.as_ref());
        self.add_some(
            "pause before a request",
            quirks.pause_before_request.as_ref(),
        );
    }

    fn barriers(&mut self, barriers: &[Barrier]) {
        for barrier in barriers {
            match barrier {
                // A read is based on its registers.
                Barrier::Read(_) => {}
                Barrier::Loop(fact) => self.add("loop test", fact),
                Barrier::Refused(fact) => {
                    self.add(format!("refusal of function {:02X} hex", fact.value), fact)
                }
            }
        }
    }

    fn run(&mut self, run: &RunCommand) {
        self.add("stop", &run.stop);
        self.add("forward", &run.forward);
        self.add_some("reverse", run.reverse.as_ref());
        self.add_some("coast", run.coast.as_ref());
        self.add_some("reset", run.reset.as_ref());
        self.add_some("release", run.release.as_ref());
        self.add_some("direction", run.places.direction.as_ref());
        for step in &run.start.steps {
            self.add(format!("start 0x{:04X}", step.write.value), &step.write);
        }
        self.add_some("take_back", run.start.take_back.as_ref());
        let elsewhere = run.places.never.iter().map(|(_, word)| word);
        for word in run.never.iter().chain(elsewhere) {
            self.add(format!("run command 0x{:04X} never", word.value), word);
        }
        self.add_some("run command 0", run.zero.as_ref());
        if let RunForm::Bits { bits, fields, .. } = &run.form {
            for bit in bits {
                self.add(format!("run command bit {}", bit.bit.value), &bit.bit);
            }
            for field in fields {
                self.add(
                    format!("run command field 0x{:04X}", field.mask.value),
                    &field.mask,
                );
            }
        }
    }

    /// What words of the drive mean.
    fn meanings(&mut self, model: &Model) {
        for status in &model.status {
            let what = format!("status `{}`", word_for(&FLAGS, &status.flag));
            self.add_some(
                &format!("other words of {what}"),
                status.others_clear.as_ref(),
            );
            self.note(what, status.confidence);
        }
        for trip in &model.trip_codes {
            self.note(format!("text of trip {}", trip.code), trip.confidence);
        }
        for warning in &model.warning_codes {
            self.note(
                format!("text of warning {}", warning.code),
                warning.confidence,
            );
        }
    }

    /// What has to be set, or to be written after it was.
    fn settings(&mut self, model: &Model) {
        for item in &model.setup {
            self.add(format!("set-up of {}", item.what), &item.values);
        }
        for word in model.commit.all() {
            self.add(
                format!("the word to {} parameters", word.value.effect.keyword()),
                word,
            );
        }
        self.add_some(
            "what the drive says it is",
            model.identity.as_ref().map(|it| &it.values),
        );
        self.add_some(
            "what switches the drive's watchdog off",
            model.watchdog.as_ref().map(|it| &it.off),
        );
    }

    fn registers(&mut self, model: &Model) {
        match &model.codes {
            Some(
                CodeRule::Groups { origin, .. }
                | CodeRule::Linear { origin, .. }
                | CodeRule::Hexadecimal(origin),
            ) => {
                self.add("how codes are addresses", origin);
            }
            None => {}
        }
        for register in &model.registers {
            self.note(format!("register `{}`", register.name), register.confidence);
            if register.confidence.is_proven() {
                for part in &register.not_stated {
                    self.note(
                        format!("{} of register `{}`", part.keyword(), register.name),
                        Confidence::Inferred,
                    );
                }
            }
        }
    }

    fn add_some<T>(&mut self, what: &str, fact: Option<&Fact<T>>) {
        if let Some(fact) = fact {
            self.add(what, fact);
        }
    }

    fn add<T>(&mut self, what: impl Into<String>, fact: &Fact<T>) {
        self.note(what.into(), fact.confidence);
    }

    fn note(&mut self, what: String, confidence: Confidence) {
        if !confidence.is_proven() {
            self.by_confidence.entry(confidence).or_default().push(what);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::profile::check;

    const EVERYTHING: &str = include_str!("../../../tests/golden/models/everything.toml");

    fn everything() -> Model {
        check::model(EVERYTHING).unwrap()
    }

    #[test]
    fn all_that_is_unproven_is_found() {
        let unproven = UnprovenFacts::of(&everything());
        for word in ["third-party", "sibling", "inferred", "default"] {
            let found = unproven
                .groups()
                .find(|(confidence, _)| confidence.keyword() == word)
                .unwrap()
                .1;
            let written = EVERYTHING
                .matches(&format!("confidence = \"{word}\""))
                .count();
            assert_eq!(found.len(), written, "{word}: {found:?}");
        }
        assert_eq!(unproven.groups().count(), 4);
        let inferred = "setpoint before run, refusal of function 2B hex, reset, run command bit 11, run command bit 13, \
                        status `tripped`, text of trip 24, text of warning 9";
        let names = unproven
            .groups()
            .find(|(confidence, _)| *confidence == Confidence::Inferred)
            .unwrap()
            .1;
        assert_eq!(names.join(", "), inferred);
    }

    #[test]
    fn any_fact_may_be_unproven() {
        let text = EVERYTHING.replace("confidence = \"manual\"", "confidence = \"sibling\"");
        let written = text.matches("confidence = ").count()
            - text.matches("confidence = \"second-source\"").count();
        assert_eq!(
            UnprovenFacts::of(&check::model(&text).unwrap()).count(),
            written
        );
    }

    #[test]
    fn orders_are_reported_with_what_has_to_be_accepted() {
        let text = orders_text(&orders(&everything()));
        assert_eq!(
            text,
            "stop, frequency, forward, reverse (unproven), coast (unproven), reset (unproven), release"
        );
        let unproven = Ok(vec![
            ("stop", Confidence::Sibling),
            ("frequency", Confidence::Sibling),
            ("forward", Confidence::Sibling),
            ("reverse", Confidence::Manual),
        ]);
        let text = orders_text(&unproven);
        assert_eq!(
            text,
            "stop (unproven), frequency (unproven), forward (unproven); once these are accepted also reverse"
        );
        let mut deaf = everything();
        deaf.run = None;
        assert_eq!(
            orders_text(&orders(&deaf)),
            "only read: its description has no run commands"
        );
    }
}
