//! One drive as a document.

use super::PageMoment;
use crate::domain::control::ControlSettings;
use crate::domain::frequency::Hertz;
use crate::domain::ids::{Name, Station};
use crate::domain::standby::LineRole;
use crate::domain::time::MonoTime;
use crate::domain::units::UnitOfMeasure;
use crate::drive::description::DriveDescription;
use crate::drive::rated::RatedConversion;
use crate::drive::snapshot::ValueReading;
use crate::drive::view::{ControlView, DriveView};
use crate::journal::trip;
use crate::north::points::{RATED_DIGITS, control_flags, status_flags, with_flags};
use crate::north::shown::{self, quality, stale_at};
use crate::profile::model::{PollClass, Register, RegisterRole};
use crate::profile::words::{POLL_CLASSES, ROLES};
use crate::toml_file::words::word_for;
use serde_json::{Value, json};

/// One drive with its view.
#[derive(Clone, Copy, Debug)]
pub struct PageDrive<'d> {
    /// Its description.
    pub description: &'d DriveDescription,
    /// Its view.
    pub view: &'d DriveView,
    /// Its station number, as far as it is known.
    pub station: Option<Station>,
    /// The gateway's role on its line; `None` if it is the only gateway there.
    pub standby: Option<LineRole>,
}

impl PageDrive<'_> {
    /// The document.
    #[must_use]
    pub fn document(&self, present: &PageMoment<'_>) -> Value {
        let Self {
            description,
            view,
            station,
            standby,
        } = self;
        let model = &description.model;
        json!({
            "name": description.name.as_str(),
            "line": description.line.as_str(),
            "group": description.group.as_ref().map(Name::as_str),
            "model": model.id,
            "vendor": model.vendor,
            "title": model.title,
            "station": station.map(|station| station.0),
            "unit": description.unit.get(),
            "uniform_unit": description.uniform_unit.get(),
            "presence": shown::presence(view),
            "run_state": shown::run_state(view).keyword(),
            "drive_state": shown::drive_state(description, view, present.now),
            "may_still_run": view.sight.may_still_run,
            "last_seen": shown::last_seen(view, present.clock),
            "output_frequency_hz": self.output_frequency(present.now),
            "setpoint_hz": self.setpoint(present.now),
            "trip": self.trip(present),
            "status": status_flags(view),
            "warning": shown::warning_text(self.description, self.view, present.now),
            "standby": standby.map(LineRole::keyword),
            "watchdog": view.watchdog.map(|watchdog| watchdog.state.keyword()),
            "control": description.control.as_ref().map(|settings| self.control(settings, present)),
            "usage": shown::usage(view),
            "oldest_ms": self.oldest_at(present.now).map(|at| whole_millis(present.now, at)),
            "values": self.polled().map(|register| self.value(register, present.now)).collect::<Vec<_>>(),
        })
    }

    /// When the next value grows stale if no more is read; never, if all have.
    #[must_use]
    pub fn changes_at(&self, now: MonoTime) -> MonoTime {
        let moments = self
            .polled()
            .filter_map(|register| stale_at(self.description, register, self.view));
        moments
            .filter(|at| *at > now)
            .min()
            .unwrap_or(MonoTime::NEVER)
    }

    /// When the oldest value was read that is read again and again; `None` if none of them is fresh.
    #[must_use]
    pub fn oldest_at(&self, now: MonoTime) -> Option<MonoTime> {
        let is_live = |register: &&Register| register.poll.is_some_and(PollClass::is_live);
        let read_at = |register: &Register| {
            if quality(self.description, register, self.view, now).keyword() != "good" {
                return None;
            }
            Some(self.view.snapshot.value(register)?.at)
        };
        self.polled().filter(is_live).filter_map(read_at).min()
    }

    /// The output frequency, unless it is stale.
    fn output_frequency(&self, now: MonoTime) -> Option<f64> {
        self.hertz(
            self.description
                .model
                .register_for(RegisterRole::OutputFrequency)?,
            now,
        )
    }

    /// The setpoint that the drive holds, unless that is stale; if it is not polled, the last one that was accepted.
    pub(super) fn setpoint(&self, now: MonoTime) -> Option<f64> {
        match self
            .description
            .model
            .setting_register()
            .filter(|register| register.poll.is_some())
        {
            Some(register) => self.hertz(register, now),
            None => Some(self.view.control.as_ref()?.setpoint?.as_f64()),
        }
    }

    fn hertz(&self, register: &Register, now: MonoTime) -> Option<f64> {
        if register.unit != UnitOfMeasure::Hertz {
            return None;
        }
        let reading = shown::fresh(self.description, register, self.view, now)?;
        Some(reading.value.value())
    }

    fn trip(&self, present: &PageMoment<'_>) -> Value {
        let trip = &self.view.trip;
        let kept = &self.view.trip_kept;
        let code = match &trip.last {
            Some(last) => last.code,
            None => kept.last_code,
        };
        json!({
            "active": trip.active,
            "code": code,
            "text": trip::newest_text(self.description, self.view),
            "count": trip.count,
            "seen": trip.seen,
            "total": kept.total,
            "last_at": trip.last.as_ref().map(|last| present.clock.text(last.at)),
            "values": trip.last.as_ref().map(|last| {
                trip::record(self.description, &|at| present.clock.text(at), last).remove("values")
            }),
        })
    }

    fn control(&self, settings: &ControlSettings, present: &PageMoment<'_>) -> Value {
        let now = present.now;
        let nobody = ControlView::default();
        let view = self.view.control.as_ref().unwrap_or(&nobody);
        let lease = view.lease.filter(|(_, until)| now < *until);
        let left = lease
            .map(|(_, until)| until)
            .filter(|until| *until != MonoTime::NEVER);
        let document = json!({
            "can": shown::capabilities(self.description),
            "from": shown::sources(settings),
            "site": shown::site(settings),
            "min_hz": settings.least.as_f64(),
            "max_hz": settings.most.as_f64(),
            "on_commander_lost": settings.on_commander_lost.keyword(),
            "lost_after_s": settings.lost_after.as_secs_f64(),
            "owner": lease.map(|(owner, _)| owner.to_string()),
            "lease_left_ms": left.map(|until| whole_millis(until, now)),
            "intent": shown::intent(view.intent),
            "setpoint_hz": view.setpoint.map(Hertz::as_f64),
            "failsafe": shown::fail_safe(Some(view), present.clock),
            "last": view.last.map(|report| json!({
                "outcome": report.outcome.keyword(),
                "reason": report.reason.keyword(),
                "message": shown::message(&self.description.model, &report),
            })),
        });
        with_flags(document, control_flags(self.view))
    }

    fn value(&self, register: &Register, now: MonoTime) -> Value {
        let reading = self.view.snapshot.value(register);
        let rated = RatedConversion::of(register, &self.description.ratings);
        let number = |it: ValueReading| match rated {
            Some(rated) => rated.to_digits(it.value, RATED_DIGITS).value(),
            None => it.value.value(),
        };
        json!({
            "name": register.name,
            "label": register.title,
            "unit": rated.map_or_else(|| trip::unit(register), |rated| Some(rated.unit.symbol())),
            "value": reading.map(number),
            "text": reading.and_then(|it| self.meaning(register, it)),
            "quality": quality(self.description, register, self.view, now).keyword(),
            "age_ms": reading.map(|it| whole_millis(now, it.at)),
            "poll": register.poll.map(|class| word_for(&POLL_CLASSES, &class)),
            "role": register.role.map(|role| word_for(&ROLES, &role).replace('-', "_")),
        })
    }

    fn meaning(&self, register: &Register, reading: ValueReading) -> Option<String> {
        match register.role {
            Some(
                role @ (RegisterRole::TripCode
                | RegisterRole::TripBits
                | RegisterRole::TripCause
                | RegisterRole::TripHistory),
            ) => {
                let code = register
                    .code(|address| self.view.snapshot.reading(address).map(|it| it.raw))?;
                trip::meaning(self.description, role, code)
            }
            _ => register.meaning(reading.raw).map(str::to_owned),
        }
    }

    fn polled(&self) -> impl Iterator<Item = &Register> {
        self.description
            .model
            .registers
            .iter()
            .filter(|register| register.poll.is_some())
    }
}

fn whole_millis(later: MonoTime, earlier: MonoTime) -> u64 {
    u64::try_from(later.since(earlier).as_millis()).unwrap_or(u64::MAX)
}
