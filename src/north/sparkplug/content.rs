//! The content of a metric, compared without being written out.

use super::device::LastResult;
use super::metrics::{Control, Definition, Input, ResultPart, Source, Status, register};
use super::payload::Value;
use crate::domain::frequency::Hertz;
use crate::domain::time::MonoTime;
use crate::drive::description::DriveDescription;
use crate::drive::rated::Rated;
use crate::drive::view::DriveView;
use crate::drive::warnings;
use crate::journal::trip;
use crate::north::clock::Clock;
use crate::north::mqtt::{Kind, Points, trip_code, trips_are_fresh};
use crate::north::shown::{answered_run_state, fresh, intent, stale_at, warning};
use crate::profile::scale::{Decimal, Scaled};
use std::borrow::Cow;

/// Digits of a value that is derived from a rated one.
const RATED_DIGITS: u8 = 2;

/// The content of a metric.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum Content {
    /// Nothing reliable.
    Null,
    /// A register.
    Value(Scaled),
    Bool(bool),
    Number(i64),
    Hertz(Hertz),
    /// One of the sums of what the drive has used.
    Sum(Decimal),
    Text(Cow<'static, str>),
    /// A part of a report, with its number: the same words of another report are news.
    Said(Cow<'static, str>, i64),
}

impl Content {
    fn text(text: Option<impl Into<Cow<'static, str>>>) -> Self {
        text.map_or(Self::Null, |text| Self::Text(text.into()))
    }

    fn bool(value: Option<bool>) -> Self {
        value.map_or(Self::Null, Self::Bool)
    }

    fn number(value: Option<impl Into<i64>>) -> Self {
        value.map_or(Self::Null, |number| Self::Number(number.into()))
    }
}

/// Where the content of a metric is looked up.
#[derive(Clone, Copy)]
pub(super) struct Look<'l> {
    pub(super) at: MonoTime,
    pub(super) clock: Clock,
    pub(super) drive: &'l DriveDescription,
    pub(super) view: &'l DriveView,
    pub(super) points: &'l Points,
    /// The last command from a host.
    pub(super) told: Option<&'l LastResult>,
}

impl Look<'_> {
    /// The present content of the metric.
    pub(super) fn content(&self, definition: &Definition) -> Content {
        match definition.source {
            Source::Topic(kind) => self.topic(kind),
            Source::TripTotal => Content::Number(self.view.trip_kept.total.into()),
            Source::Control(part) => self.control(part),
            Source::Status(status) => self.status(status),
            Source::Watchdog => {
                Content::text(self.view.watchdog.as_ref().map(|it| it.state.word()))
            }
            Source::Result(part) => self.result(part),
            Source::Model => Content::Text(self.drive.model.id.clone().into()),
            Source::Line => Content::Text(self.drive.line.as_str().to_owned().into()),
            Source::Unit => Content::Number(self.drive.unit.get().into()),
            Source::Input(input) => self.input(input),
        }
    }

    fn topic(&self, kind: Kind) -> Content {
        let drive = self.drive;
        let view = self.view;
        let trip = trips_are_fresh(drive, view, self.at).then_some(&view.trip);
        match kind {
            Kind::Availability => Content::Bool(view.is_online()),
            Kind::RunState => Content::Text(answered_run_state(view).word().into()),
            Kind::Polled(place) | Kind::Rated(place) | Kind::Param(place) => {
                let register = drive.model.registers.get(place);
                let reading = register.and_then(|register| fresh(drive, register, view, self.at));
                reading.map_or(Content::Null, |reading| Content::Value(reading.value))
            }
            Kind::Setpoint => self.setpoint(),
            Kind::Owner => {
                let owner = view
                    .control
                    .as_ref()
                    .and_then(|control| control.lease)
                    .map(|(owner, _)| owner);
                Content::Text(owner.map_or(Cow::Borrowed(""), |owner| owner.to_string().into()))
            }
            Kind::Usage(part) => view.usage.value(part).map_or(Content::Null, Content::Sum),
            Kind::TripActive => Content::bool(trip.and_then(|trip| trip.active)),
            Kind::TripCount => Content::number(trip.and(view.trip_kept.count)),
            Kind::TripCode => Content::number(trip.and(trip_code(view))),
            Kind::TripText => Content::text(trip.and_then(|_| trip::active_text(drive, view))),
            Kind::WarningActive => {
                Content::bool(warning(drive, view, self.at).map(|word| word != 0))
            }
            Kind::WarningCode => Content::number(
                warning(drive, view, self.at).map(|word| warnings::code(&drive.model, word)),
            ),
            Kind::WarningText => Content::text(
                warning(drive, view, self.at).and_then(|word| warnings::text(&drive.model, word)),
            ),
            Kind::TripLast => {
                let label = |at| self.clock.text(at);
                let last = view
                    .trip_kept
                    .last
                    .as_ref()
                    .map(|it| trip::record(drive, &label, it));
                Content::text(last.map(|record| serde_json::Value::Object(record).to_string()))
            }
        }
    }

    fn setpoint(&self) -> Content {
        let setpoint = self
            .view
            .control
            .as_ref()
            .and_then(|control| control.setpoint);
        setpoint.map_or(Content::Null, Content::Hertz)
    }

    fn control(&self, part: Control) -> Content {
        let of = |control: &crate::drive::view::ControlView| match part {
            Control::StartInhibited => control.start_inhibited,
            Control::StopPending => control.stop_pending,
            Control::NotEffective => control.not_effective,
            Control::FailSafe => control.failsafe.is_some(),
            Control::OutputOutside => control.output_outside,
            Control::StoppedElsewhere => control.stopped_elsewhere,
        };
        Content::bool(self.view.control.as_ref().map(of))
    }

    fn status(&self, status: Status) -> Content {
        let of_view = &self.view.status;
        Content::bool(match status {
            Status::Local => of_view.is_local(),
            Status::Alarm => of_view.alarm,
            Status::Ready => of_view.ready,
            Status::MayStillRun => Some(self.view.sight.may_still_run),
        })
    }

    fn result(&self, part: ResultPart) -> Content {
        let Some(told) = self.told else {
            return if part == ResultPart::Count {
                Content::Number(0)
            } else {
                Content::Text("".into())
            };
        };
        match part {
            ResultPart::Outcome => Content::Said(told.report.outcome.word().into(), told.count),
            ResultPart::Reason => Content::Said(told.report.reason.word().into(), told.count),
            ResultPart::Message => Content::Said(told.message.clone().into(), told.count),
            ResultPart::Count => Content::Number(told.count),
        }
    }

    /// What was last written and is in force; buttons are never pressed.
    fn input(&self, input: Input) -> Content {
        match input {
            Input::Frequency => self.setpoint(),
            Input::Run => Content::text(
                self.view
                    .control
                    .as_ref()
                    .map(|control| intent(control.intent)),
            ),
            Input::Reset | Input::Take | Input::Release | Input::Lease => Content::Bool(false),
        }
    }

    /// Whether a change of the metric from `old` to `new` is news.
    pub(super) fn is_news(&self, definition: &Definition, old: &Content, new: &Content) -> bool {
        match (definition.source, old, new) {
            (Source::Topic(kind), Content::Value(old), Content::Value(new)) => {
                self.points.differ_on(kind, self.drive, *old, *new)
            }
            _ => old != new,
        }
    }

    /// `content` as sent; `None` if there is no value.
    pub(super) fn value(&self, definition: &Definition, content: &Content) -> Option<Value> {
        use super::payload::Datatype::{Int32, Int64};
        Some(match content {
            Content::Null => return None,
            Content::Bool(value) => Value::Boolean(*value),
            Content::Text(text) | Content::Said(text, _) => Value::Text(text.clone().into_owned()),
            Content::Hertz(hertz) => Value::Double(hertz.as_f64()),
            Content::Sum(sum) if definition.datatype == Int64 => Value::of_i64(sum.whole()),
            Content::Sum(sum) => Value::Double(sum.value()),
            Content::Number(number) if definition.datatype == Int64 => Value::of_i64(*number),
            Content::Number(number) if definition.datatype == Int32 => {
                Value::of_i32(i32::try_from(*number).ok()?)
            }
            Content::Number(_) => return None,
            Content::Value(value) => Value::Double(self.number(definition, *value)?),
        })
    }

    fn number(&self, definition: &Definition, value: Scaled) -> Option<f64> {
        let Source::Topic(kind) = definition.source else {
            return None;
        };
        let place = kind.register()?;
        let register = self.drive.model.registers.get(place)?;
        Some(match kind {
            Kind::Rated(_) => Rated::of(register, &self.drive.ratings)?
                .to_digits(value, RATED_DIGITS)
                .value(),
            _ => self.points.value(place, value),
        })
    }

    /// Since when the metric has its content, as far as known; else now.
    pub(super) fn since(&self, definition: &Definition, content: &Content) -> MonoTime {
        let of_register = || {
            let register = register(self.drive, definition.source)?;
            self.view.snapshot.read_at(register)
        };
        match content {
            Content::Value(_) => of_register().unwrap_or(self.at),
            _ if definition.is_trip() => match &self.view.trip_kept.last {
                Some(record) if self.view.trip.active == Some(true) => record.at,
                _ => self.at,
            },
            _ => self.at,
        }
    }

    /// When the content of the metric is no longer reliable; `None`: not before something changes.
    pub(super) fn ends_at(&self, definition: &Definition) -> Option<MonoTime> {
        let register = match definition.source {
            Source::Topic(Kind::Polled(_) | Kind::Rated(_)) => {
                register(self.drive, definition.source)
            }
            Source::Topic(Kind::TripActive | Kind::TripCode | Kind::TripText | Kind::TripCount) => {
                self.drive.model.trip_register()
            }
            Source::Topic(Kind::WarningActive | Kind::WarningCode | Kind::WarningText) => {
                self.drive.model.warning_register()
            }
            _ => None,
        };
        stale_at(self.drive, register?, self.view).filter(|stale_at| *stale_at > self.at)
    }
}
