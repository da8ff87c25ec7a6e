//! Advice on one drive.

use super::Advice;
use crate::domain::command::{Outcome, Reason, Report};
use crate::domain::control::ControlSettings;
use crate::domain::link::Interface;
use crate::domain::time::MonoTime;
use crate::drive::snapshot::Presence;
use crate::drive::view::{ControlView, StoppedAgain};
use crate::drive::watchdog::{WatchdogState, WatchdogView};
use crate::journal::trip;
use crate::north::finding::{Finding, OFFLINE_REMEDY, Severity, Sign, warns_text};
use crate::north::page::drive::Drive;
use crate::north::shown::{fresh, message, warning_text};
use crate::profile::model::{Model, Register, RunForm, SetupItem};
use crate::profile::scale::Scaled;

impl Drive<'_> {
    /// The advice on it, on a line of this interface.
    #[must_use]
    pub fn advice(&self, interface: Interface, now: MonoTime) -> Vec<Finding> {
        let description = self.description;
        let line = Some(description.line.clone());
        let drive = Some(description.name.clone());
        let mut said = Advice { line, drive, all: Vec::new() };
        // A line that is down is reported once, for all its drives.
        if self.view.line_is_up && self.view.snapshot.presence == Presence::Offline {
            let station = self.station.map(|station| format!(" as station {station}")).unwrap_or_default();
            said.say(Sign::Offline, format!("the drive does not answer{station}: {OFFLINE_REMEDY}"));
        }
        self.tripped(&mut said);
        if let Some(warning) = warning_text(description, self.view, now) {
            said.say(Sign::Warns, warns_text(&warning));
        }
        if let Some(settings) = &description.control {
            self.obedience(&mut said, interface, now);
            self.setpoint_limits(&mut said, settings, now);
            self.view.watchdog.iter().for_each(|it| self.watchdog(&mut said, settings, *it));
            self.view.control.iter().for_each(|it| control(&mut said, it, &description.model, now));
        }
        said.all
    }

    /// A drive that does not answer may no longer be tripped: then that is reported, and not this.
    fn tripped(&self, said: &mut Advice) {
        let trip = &self.view.trip;
        if trip.active != Some(true) || !self.view.is_online() {
            return;
        }
        let code = trip.last.as_ref().map_or(self.view.trip_kept.last_code, |last| last.code);
        let words = trip::newest_text(self.description, self.view);
        let name = match (code, words) {
            (Some(code), Some(words)) if words.contains(&code.to_string()) => format!(": {words}"),
            (Some(code), Some(words)) => format!(": {code} {words}"),
            (Some(code), None) => format!(": {code}"),
            (None, _) => String::new(),
        };
        said.say(Sign::Tripped, format!("the drive is tripped{name}; find its cause before it is reset"));
    }

    /// Whether it obeys the bus, as far as known from what was read.
    fn obedience(&self, said: &mut Advice, interface: Interface, now: MonoTime) {
        let model = &self.description.model;
        let name = &self.description.name;
        let concerned = model.setup.iter().filter(|item| item.interface.is_none_or(|of| of == interface));
        let wrong: Vec<String> = concerned.filter_map(|item| self.wrong(item, now)).collect();
        for wrong in &wrong {
            said.say(
                Sign::BusRefused,
                format!(
                    "the drive refuses bus commands: {wrong}; set it at the drive, or with `vfd-gateway enable {name}`"
                ),
            );
        }
        let takes_priority =
            matches!(model.run.as_ref().map(|run| &run.form), Some(RunForm::Bits { priority: 1.., .. }));
        let is_local = self.view.is_online() && self.view.status.is_local() == Some(true);
        if is_local && wrong.is_empty() && !takes_priority {
            said.say(
                Sign::LocalControl,
                format!(
                    "the drive obeys its panel or terminals, not the bus: give control to the bus at the drive; \
                 `vfd-gateway verify {name}` shows what is set"
                ),
            );
        }
    }

    /// What is not set as bus control needs it; `None` if it is right or not known.
    fn wrong(&self, item: &SetupItem, now: MonoTime) -> Option<String> {
        let register = self.description.model.register_at(item.address?)?;
        let word = fresh(self.description, register, self.view, now)?.raw;
        let wanted = &item.values.value;
        (!wanted.contains(&word)).then(|| {
            let right: Vec<_> = wanted.iter().map(|word| shown(register, *word)).collect();
            format!("{} is {}, not {} ({})", item.what, shown(register, word), right.join(" or "), item.text)
        })
    }

    fn setpoint_limits(&self, said: &mut Advice, settings: &ControlSettings, now: MonoTime) {
        let limits = settings.least.as_f64()..=settings.most.as_f64();
        if let Some(hertz) = self.setpoint(now).filter(|hertz| *hertz != 0.0 && !limits.contains(hertz)) {
            said.say(Sign::SetpointOutside, format!(
                "the drive's setpoint of {hertz} Hz is outside {} to {} Hz, so that a run without a frequency is refused: \
                 command a frequency within these limits, or change `frequency_hz`",
                limits.start(),
                limits.end()
            ));
        }
    }

    fn watchdog(&self, said: &mut Advice, settings: &ControlSettings, watchdog: WatchdogView) {
        let at_most = settings.watchdog_at_most();
        let wrong = match watchdog.state {
            WatchdogState::Unknown | WatchdogState::InOrder => return,
            WatchdogState::Off => "is off".to_owned(),
            WatchdogState::KeepsRunning => "lets the motor run on".to_owned(),
            WatchdogState::TooShort => "may stop the motor although all is well: its time is too short".to_owned(),
            WatchdogState::TooLong => format!("takes longer than {at_most:?}"),
        };
        let text = format!(
            "the drive's own watchdog over the bus {wrong}: it is what stops the motor when gateway or line are lost; \
             `vfd-gateway watchdog {}` shows and sets it",
            self.description.name
        );
        let severity = if settings.require_watchdog { Severity::Problem } else { Sign::WatchdogWrong.severity() };
        said.say_graded(severity, Sign::WatchdogWrong, text);
    }
}

fn control(said: &mut Advice, control: &ControlView, model: &Model, now: MonoTime) {
    if control.not_effective {
        said.say(Sign::NotEffective, "a stop shows no effect: look after the motor at the drive itself");
    }
    if let Some(again) = control.stopped_again.filter(|it| now.since(it.at) < StoppedAgain::WITHIN) {
        said.say(Sign::StoppedAgain, format!(
            "{} stops the drive again and again ({} times in a row) although it was started elsewhere: a controller that is \
             not in charge writes nothing",
            again.by, again.times
        ));
    }
    if control.failsafe {
        said.say(
            Sign::CommanderLost,
            "the commander was lost and the declared action was carried out: command stop, then run, once its cause is \
             found",
        );
    }
    if let Some(text) = control.last.as_ref().and_then(|last| refused(model, last)) {
        said.say(Sign::CommandFailed, text);
    }
}

/// What the outcome of the last command says about the drive or its configuration.
fn refused(model: &Model, last: &Report) -> Option<String> {
    let hint = match (last.outcome, last.reason) {
        (Outcome::Confirmed | Outcome::Acknowledged, _) => return None,
        (_, Reason::KeptOldValue) => {
            "it may be locked against changes over the bus, or the motor must stand still for it"
        }
        (_, Reason::DriveException) => "look up the register and what may be written to it in the drive's manual",
        (_, Reason::DriveBusy) => "order it again",
        (_, Reason::DriveLocked) => "unlock its parameters at the drive",
        (_, Reason::DriveInTrip) => "reset its trip first",
        (_, Reason::LocalControl) => "give control to the bus at the drive",
        (_, Reason::Precondition) => "`vfd-gateway verify` lists what must be set, `enable` sets it",
        (_, Reason::NotCommitted) => "order it again: until then it may not act, or be lost with the drive's power",
        (_, Reason::NotReady) => "see at the drive what it waits for: mains, an enable terminal, a trip",
        (_, Reason::OtherDrive) => "check the station number and the model in the configuration",
        (_, Reason::SetpointUnknown) => "command a frequency first",
        (_, Reason::Unverified) => {
            "try it with `vfd-gateway qualify`, or list the action under `accept_unverified` once it was tried with care"
        }
        _ => return None,
    };
    let code = last.exception.map(|code| format!(" {code:02X}")).unwrap_or_default();
    Some(format!("the last command was not carried out: {}{code}; {hint}", message(model, last)))
}

/// A word with what it means.
fn shown(register: &Register, word: u16) -> String {
    let value = Scaled::from_word(word, register);
    register.meaning(word).map_or_else(|| value.to_string(), |meaning| format!("{value} ({meaning})"))
}
