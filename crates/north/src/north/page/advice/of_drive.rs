//! Advice on one drive.

use super::SubjectAdvice;
use crate::domain::command::{Outcome, Reason, Report};
use crate::domain::control::ControlSettings;
use crate::domain::fail_safe::FailSafeStage;
use crate::domain::link::Interface;
use crate::domain::time::MonoTime;
use crate::drive::snapshot::DrivePresence;
use crate::drive::view::{ControlView, StoppedAgain};
use crate::drive::watchdog::{WatchdogState, WatchdogView};
use crate::journal::trip;
use crate::north::finding::{Finding, FindingSign, Severity, offline, warns};
use crate::north::page::drive::PageDrive;
use crate::north::shown::{fail_safe_text, fresh, may_still_run, said, warning_text};
use crate::north::texts::Sentence;
use crate::profile::model::{Model, Register, RunForm, SetupItem};
use crate::profile::scale::ScaledValue;

impl PageDrive<'_> {
    /// The advice on it, on a line of this interface.
    #[must_use]
    pub fn advice(&self, interface: Interface, now: MonoTime) -> Vec<Finding> {
        let description = self.description;
        let line = Some(description.line.clone());
        let drive = Some(description.name.clone());
        let mut said = SubjectAdvice {
            line,
            drive,
            all: Vec::new(),
        };
        if self.view.sight.may_still_run {
            said.say(FindingSign::MayStillRun, may_still_run(self.view));
        }
        // A line that is down is reported once, for all its drives.
        if self.view.line_is_up && self.view.snapshot.presence == DrivePresence::Offline {
            said.say(FindingSign::Offline, offline(self.station));
        }
        self.tripped(&mut said);
        self.plausible(&mut said);
        if let Some(warning) = warning_text(description, self.view, now) {
            said.say(FindingSign::Warns, warns(warning));
        }
        if self.view.is_online() {
            self.undocumented_state(&mut said);
            self.refused_registers(&mut said);
        }
        if let Some(settings) = &description.control {
            self.obedience(&mut said, interface, now);
            self.setpoint_limits(&mut said, settings, now);
            if let Some(it) = self.view.watchdog {
                self.watchdog(&mut said, settings, it);
            }
            if let Some(it) = &self.view.control {
                control(&mut said, it, &description.model, now);
            }
        }
        said.all
    }

    /// A state that the documents of the model do not name.
    fn undocumented_state(&self, said: &mut SubjectAdvice) {
        let Some(state) = self.view.status.undocumented else {
            return;
        };
        let text =
            Sentence::new("finding.undocumented_state").with("register", state.address.to_string());
        said.say(
            FindingSign::UndocumentedState,
            text.with("value", u64::from(state.word)),
        );
    }

    /// The registers that the drive refuses to show.
    fn refused_registers(&self, said: &mut SubjectAdvice) {
        for refused in &self.view.refused {
            let model = &self.description.model;
            let name = model
                .register_at(refused.address)
                .map_or_else(String::new, |register| register.title.clone());
            let text = Sentence::new("finding.register_refused")
                .with("register", refused.address.to_string());
            let is_essential = model.is_essential(refused.address);
            let severity = if is_essential {
                Severity::Problem
            } else {
                FindingSign::RegisterRefused.severity()
            };
            let code = format!("{:02X}", refused.code);
            said.say_graded(
                severity,
                FindingSign::RegisterRefused,
                text.with("name", name).with("code", code),
            );
        }
    }

    /// What the drive shows that no drive of its model shows.
    fn plausible(&self, said: &mut SubjectAdvice) {
        if !self.view.snapshot.is_implausible || !self.view.is_online() {
            return;
        }
        for register in &self.description.model.registers {
            let (Some(range), Some(reading)) = (
                &register.plausible,
                self.view.snapshot.reading(register.address),
            ) else {
                continue;
            };
            if (i64::from(*range.start())..=i64::from(*range.end()))
                .contains(&register.number_in(reading.raw))
            {
                continue;
            }
            let ends = [range.start(), range.end()]
                .map(|end| ScaledValue::new(i64::from(*end), register.scale));
            let implausible =
                Sentence::new("finding.implausible").with("register", register.title.as_str());
            let implausible = implausible.with("address", register.address.to_string());
            let implausible = implausible.with("is", register.plain_value(reading.raw).to_string());
            let implausible = implausible
                .with("least", ends[0].to_string())
                .with("most", ends[1].to_string());
            said.say(
                FindingSign::Implausible,
                implausible.with("unit", register.unit.symbol()),
            );
        }
    }

    /// A drive that does not answer may no longer be tripped: then that is reported, and not this.
    fn tripped(&self, said: &mut SubjectAdvice) {
        let trip = &self.view.trip;
        if trip.active != Some(true) || !self.view.is_online() {
            return;
        }
        let code = trip
            .last
            .as_ref()
            .map_or(self.view.trip_kept.last_code, |last| last.code);
        let words = trip::newest_text(self.description, self.view);
        let name = match (code, words) {
            (Some(code), Some(words)) if words.contains(&code.to_string()) => words,
            (Some(code), Some(words)) => format!("{code} {words}"),
            (Some(code), None) => code.to_string(),
            (None, _) => return said.say(FindingSign::Tripped, Sentence::new("finding.tripped")),
        };
        said.say(
            FindingSign::Tripped,
            Sentence::new("finding.tripped_by").with("trip", name),
        );
    }

    /// Whether it obeys the bus, as far as known from what was read.
    fn obedience(&self, said: &mut SubjectAdvice, interface: Interface, now: MonoTime) {
        let model = &self.description.model;
        let name = &self.description.name;
        let concerned = model
            .setup
            .iter()
            .filter(|item| item.interface.is_none_or(|of| of == interface));
        let wrong: Vec<_> = concerned.filter_map(|item| self.wrong(item, now)).collect();
        let is_set = wrong.is_empty();
        for wrong in wrong {
            let refused = Sentence::new("finding.bus_refused");
            said.say(
                FindingSign::BusRefused,
                refused.with("setting", wrong).with("drive", name.as_str()),
            );
        }
        let takes_priority = matches!(
            model.run.as_ref().map(|run| &run.form),
            Some(RunForm::Bits { priority: 1.., .. })
        );
        let is_local = self.view.is_online() && self.view.status.is_local() == Some(true);
        if is_local && is_set && !takes_priority {
            said.say(
                FindingSign::LocalControl,
                Sentence::new("finding.local_control").with("drive", name.as_str()),
            );
        }
    }

    /// What is not set as bus control needs it; `None` if it is right or not known.
    fn wrong(&self, item: &SetupItem, now: MonoTime) -> Option<Sentence> {
        let register = self.description.model.register_at(item.address?)?;
        let word = fresh(self.description, register, self.view, now)?.raw;
        let wanted = &item.values.value;
        (!wanted.contains(&word)).then(|| {
            let right: Vec<_> = wanted.iter().map(|word| shown(register, *word)).collect();
            let setting = Sentence::new("finding.wrong_setting").with("what", item.what.as_str());
            setting
                .with("is", shown(register, word))
                .with("right", right.join(" / "))
                .with("text", item.text.as_str())
        })
    }

    fn setpoint_limits(&self, said: &mut SubjectAdvice, settings: &ControlSettings, now: MonoTime) {
        let limits = settings.least.as_f64()..=settings.most.as_f64();
        if let Some(hertz) = self
            .setpoint(now)
            .filter(|hertz| *hertz != 0.0 && !limits.contains(hertz))
        {
            let outside = Sentence::new("finding.setpoint_outside").with("setpoint", hertz);
            said.say(
                FindingSign::SetpointOutside,
                outside
                    .with("least", *limits.start())
                    .with("most", *limits.end()),
            );
        }
    }

    fn watchdog(
        &self,
        said: &mut SubjectAdvice,
        settings: &ControlSettings,
        watchdog: WatchdogView,
    ) {
        let state = match watchdog.state {
            WatchdogState::Unknown | WatchdogState::InOrder => return,
            WatchdogState::Off => Sentence::new("watchdog.off"),
            WatchdogState::KeepsRunning => Sentence::new("watchdog.keeps_running"),
            WatchdogState::TooShort => Sentence::new("watchdog.too_short"),
            WatchdogState::TooLong => Sentence::new("watchdog.too_long")
                .with("seconds", settings.watchdog_at_most().as_secs_f64()),
        };
        let text = Sentence::new("finding.watchdog_wrong").with("state", state);
        let text = text.with("drive", self.description.name.as_str());
        let severity = if settings.require_watchdog {
            Severity::Problem
        } else {
            FindingSign::WatchdogWrong.severity()
        };
        said.say_graded(severity, FindingSign::WatchdogWrong, text);
    }
}

fn control(said: &mut SubjectAdvice, control: &ControlView, model: &Model, now: MonoTime) {
    if control.not_effective {
        said.say(
            FindingSign::NotEffective,
            Sentence::new("finding.not_effective"),
        );
    }
    if control.output_outside {
        let key = if model.needs_full_scale() {
            "finding.output_outside_scale"
        } else {
            "finding.output_outside"
        };
        said.say(FindingSign::OutputOutside, Sentence::new(key));
    }
    if control.stopped_elsewhere {
        said.say(
            FindingSign::StoppedElsewhere,
            Sentence::new("finding.stopped_elsewhere"),
        );
    }
    if let Some(again) = control
        .stopped_again
        .filter(|it| now.since(it.at) < StoppedAgain::WITHIN)
    {
        let stopped = Sentence::new("finding.stopped_again").with("by", again.by.to_string());
        said.say(
            FindingSign::StoppedAgain,
            stopped.with("times", u64::from(again.times)),
        );
    }
    if let Some(run) = control.failsafe {
        let sign = if run.cause.is_lost_commander() {
            FindingSign::CommanderLost
        } else {
            FindingSign::FailSafe
        };
        // Until the drive has shown the effect, its motor may go on.
        let is_effective = matches!(
            run.stage,
            FailSafeStage::Effective | FailSafeStage::NotNeeded
        );
        let severity = if is_effective {
            sign.severity()
        } else {
            Severity::Problem
        };
        said.say_graded(severity, sign, fail_safe_text(run));
    }
    if let Some(text) = control.last.as_ref().and_then(|last| refused(model, last)) {
        said.say(FindingSign::CommandFailed, text);
    }
}

/// What the outcome of the last command says about the drive or its configuration.
fn refused(model: &Model, last: &Report) -> Option<Sentence> {
    let is_good = matches!(last.outcome, Outcome::Confirmed | Outcome::Acknowledged);
    if is_good || !OF_DRIVE.contains(&last.reason) {
        return None;
    }
    let failed = Sentence::new(match last.exception {
        Some(_) => "finding.command_failed_by",
        None => "finding.command_failed",
    });
    let failed = failed.with("reason", said(model, last)).with(
        "hint",
        Sentence::new(format!("hint.{}", last.reason.keyword())),
    );
    Some(match last.exception {
        Some(code) => failed.with("exception", format!("{code:02X}")),
        None => failed,
    })
}

/// Reasons that lie in the drive or its configuration. The catalogue has a hint for each.
pub(super) const OF_DRIVE: [Reason; 13] = [
    Reason::KeptOldValue,
    Reason::DriveException,
    Reason::DriveBusy,
    Reason::DriveLocked,
    Reason::DriveInTrip,
    Reason::LocalControl,
    Reason::Precondition,
    Reason::NotCommitted,
    Reason::NotReady,
    Reason::OtherDrive,
    Reason::Implausible,
    Reason::SetpointUnknown,
    Reason::Unverified,
];

/// A word with what it means.
fn shown(register: &Register, word: u16) -> String {
    let value = ScaledValue::from_word(word, register);
    register.meaning(word).map_or_else(
        || value.to_string(),
        |meaning| format!("{value} ({meaning})"),
    )
}
