//! The content of a metric, compared without being written out.

use super::device::LastResult;
use super::metrics::{
    ControlPart, MetricDefinition, MetricInput, MetricSource, ResultPart, StatusPart, register,
};
use super::payload::PayloadValue;
use crate::domain::frequency::Hertz;
use crate::domain::time::MonoTime;
use crate::drive::description::DriveDescription;
use crate::drive::rated::RatedConversion;
use crate::drive::view::DriveView;
use crate::drive::warnings;
use crate::journal::trip;
use crate::north::clock::LabelClock;
use crate::north::mqtt::{PublishedPoints, TopicKind, trip_code, trips_are_fresh};
use crate::north::shown::{answered_run_state, fresh, intent, stale_at, warning};
use crate::profile::scale::{Decimal, ScaledValue};
use std::borrow::Cow;

/// Digits of a value that is derived from a rated one.
const RATED_DIGITS: u8 = 2;

/// The content of a metric.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum MetricContent {
    /// Nothing reliable.
    Null,
    /// A register.
    Value(ScaledValue),
    Bool(bool),
    Number(i64),
    Hertz(Hertz),
    /// One of the sums of what the drive has used.
    Sum(Decimal),
    Text(Cow<'static, str>),
    /// A part of a report, with its number: the same text of another report is a change.
    Said(Cow<'static, str>, i64),
}

impl MetricContent {
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
pub(super) struct MetricContext<'l> {
    pub(super) at: MonoTime,
    pub(super) clock: LabelClock,
    pub(super) drive: &'l DriveDescription,
    pub(super) view: &'l DriveView,
    pub(super) points: &'l PublishedPoints,
    /// The last command from a host.
    pub(super) last_result: Option<&'l LastResult>,
}

impl MetricContext<'_> {
    /// The present content of the metric.
    pub(super) fn content(&self, definition: &MetricDefinition) -> MetricContent {
        match definition.source {
            MetricSource::Topic(kind) => self.topic(kind),
            MetricSource::TripTotal => MetricContent::Number(self.view.trip_kept.total.into()),
            MetricSource::Control(part) => self.control(part),
            MetricSource::Status(status) => self.status(status),
            MetricSource::Watchdog => {
                MetricContent::text(self.view.watchdog.as_ref().map(|it| it.state.keyword()))
            }
            MetricSource::Result(part) => self.result(part),
            MetricSource::Model => MetricContent::Text(self.drive.model.id.clone().into()),
            MetricSource::Line => MetricContent::Text(self.drive.line.as_str().to_owned().into()),
            MetricSource::Unit => MetricContent::Number(self.drive.unit.get().into()),
            MetricSource::Input(input) => self.input(input),
        }
    }

    fn topic(&self, kind: TopicKind) -> MetricContent {
        let drive = self.drive;
        let view = self.view;
        let trip = trips_are_fresh(drive, view, self.at).then_some(&view.trip);
        match kind {
            TopicKind::Availability => MetricContent::Bool(view.is_online()),
            TopicKind::RunState => MetricContent::Text(answered_run_state(view).keyword().into()),
            TopicKind::Polled(place) | TopicKind::Rated(place) | TopicKind::Param(place) => {
                let register = drive.model.registers.get(place);
                let reading = register.and_then(|register| fresh(drive, register, view, self.at));
                reading.map_or(MetricContent::Null, |reading| {
                    MetricContent::Value(reading.value)
                })
            }
            TopicKind::Setpoint => self.setpoint(),
            TopicKind::Owner => {
                let owner = view
                    .control
                    .as_ref()
                    .and_then(|control| control.lease)
                    .map(|(owner, _)| owner);
                MetricContent::Text(
                    owner.map_or(Cow::Borrowed(""), |owner| owner.to_string().into()),
                )
            }
            TopicKind::Usage(part) => view
                .usage
                .value(part)
                .map_or(MetricContent::Null, MetricContent::Sum),
            TopicKind::TripActive => MetricContent::bool(trip.and_then(|trip| trip.active)),
            TopicKind::TripCount => MetricContent::number(trip.and(view.trip_kept.count)),
            TopicKind::TripCode => MetricContent::number(trip.and(trip_code(view))),
            TopicKind::TripText => {
                MetricContent::text(trip.and_then(|_| trip::active_text(drive, view)))
            }
            TopicKind::WarningActive => {
                MetricContent::bool(warning(drive, view, self.at).map(|word| word != 0))
            }
            TopicKind::WarningCode => MetricContent::number(
                warning(drive, view, self.at).map(|word| warnings::code(&drive.model, word)),
            ),
            TopicKind::WarningText => MetricContent::text(
                warning(drive, view, self.at).and_then(|word| warnings::text(&drive.model, word)),
            ),
            TopicKind::TripLast => {
                let label = |at| self.clock.text(at);
                let last = view
                    .trip_kept
                    .last
                    .as_ref()
                    .map(|it| trip::record(drive, &label, it));
                MetricContent::text(
                    last.map(|record| serde_json::Value::Object(record).to_string()),
                )
            }
        }
    }

    fn setpoint(&self) -> MetricContent {
        let setpoint = self
            .view
            .control
            .as_ref()
            .and_then(|control| control.setpoint);
        setpoint.map_or(MetricContent::Null, MetricContent::Hertz)
    }

    fn control(&self, part: ControlPart) -> MetricContent {
        let of = |control: &crate::drive::view::ControlView| match part {
            ControlPart::StartInhibited => control.start_inhibited,
            ControlPart::StopPending => control.stop_pending,
            ControlPart::NotEffective => control.not_effective,
            ControlPart::FailSafe => control.failsafe.is_some(),
            ControlPart::OutputOutside => control.output_outside,
            ControlPart::StoppedElsewhere => control.stopped_elsewhere,
        };
        MetricContent::bool(self.view.control.as_ref().map(of))
    }

    fn status(&self, status: StatusPart) -> MetricContent {
        let of_view = &self.view.status;
        MetricContent::bool(match status {
            StatusPart::Local => of_view.is_local(),
            StatusPart::Alarm => of_view.alarm,
            StatusPart::Ready => of_view.ready,
            StatusPart::MayStillRun => Some(self.view.sight.may_still_run),
        })
    }

    fn result(&self, part: ResultPart) -> MetricContent {
        let Some(last) = self.last_result else {
            return if part == ResultPart::Count {
                MetricContent::Number(0)
            } else {
                MetricContent::Text("".into())
            };
        };
        match part {
            ResultPart::Outcome => {
                MetricContent::Said(last.report.outcome.keyword().into(), last.count)
            }
            ResultPart::Reason => {
                MetricContent::Said(last.report.reason.keyword().into(), last.count)
            }
            ResultPart::Message => MetricContent::Said(last.message.clone().into(), last.count),
            ResultPart::Count => MetricContent::Number(last.count),
        }
    }

    /// What was last written and is in force; buttons are never pressed.
    fn input(&self, input: MetricInput) -> MetricContent {
        match input {
            MetricInput::Frequency => self.setpoint(),
            MetricInput::Run => MetricContent::text(
                self.view
                    .control
                    .as_ref()
                    .map(|control| intent(control.intent)),
            ),
            MetricInput::Reset | MetricInput::Take | MetricInput::Release | MetricInput::Lease => {
                MetricContent::Bool(false)
            }
        }
    }

    /// Whether a change of the metric from `old` to `new` is news.
    pub(super) fn is_news(
        &self,
        definition: &MetricDefinition,
        old: &MetricContent,
        new: &MetricContent,
    ) -> bool {
        match (definition.source, old, new) {
            (MetricSource::Topic(kind), MetricContent::Value(old), MetricContent::Value(new)) => {
                self.points.differ_on(kind, self.drive, *old, *new)
            }
            _ => old != new,
        }
    }

    /// `content` as sent; `None` if there is no value.
    pub(super) fn value(
        &self,
        definition: &MetricDefinition,
        content: &MetricContent,
    ) -> Option<PayloadValue> {
        use super::payload::PayloadType::{Int32, Int64};
        Some(match content {
            MetricContent::Null => return None,
            MetricContent::Bool(value) => PayloadValue::Boolean(*value),
            MetricContent::Text(text) | MetricContent::Said(text, _) => {
                PayloadValue::Text(text.clone().into_owned())
            }
            MetricContent::Hertz(hertz) => PayloadValue::Double(hertz.as_f64()),
            MetricContent::Sum(sum) if definition.datatype == Int64 => {
                PayloadValue::of_i64(sum.whole())
            }
            MetricContent::Sum(sum) => PayloadValue::Double(sum.value()),
            MetricContent::Number(number) if definition.datatype == Int64 => {
                PayloadValue::of_i64(*number)
            }
            MetricContent::Number(number) if definition.datatype == Int32 => {
                PayloadValue::of_i32(i32::try_from(*number).ok()?)
            }
            MetricContent::Number(_) => return None,
            MetricContent::Value(value) => PayloadValue::Double(self.number(definition, *value)?),
        })
    }

    fn number(&self, definition: &MetricDefinition, value: ScaledValue) -> Option<f64> {
        let MetricSource::Topic(kind) = definition.source else {
            return None;
        };
        let place = kind.register()?;
        let register = self.drive.model.registers.get(place)?;
        Some(match kind {
            TopicKind::Rated(_) => RatedConversion::of(register, &self.drive.ratings)?
                .to_digits(value, RATED_DIGITS)
                .value(),
            _ => self.points.value(place, value),
        })
    }

    /// Since when the metric has its content, as far as known; else now.
    pub(super) fn since(&self, definition: &MetricDefinition, content: &MetricContent) -> MonoTime {
        let of_register = || {
            let register = register(self.drive, definition.source)?;
            self.view.snapshot.read_at(register)
        };
        match content {
            MetricContent::Value(_) => of_register().unwrap_or(self.at),
            _ if definition.is_trip() => match &self.view.trip_kept.last {
                Some(record) if self.view.trip.active == Some(true) => record.at,
                _ => self.at,
            },
            _ => self.at,
        }
    }

    /// When the content of the metric is no longer reliable; `None`: not before something changes.
    pub(super) fn ends_at(&self, definition: &MetricDefinition) -> Option<MonoTime> {
        let register = match definition.source {
            MetricSource::Topic(TopicKind::Polled(_) | TopicKind::Rated(_)) => {
                register(self.drive, definition.source)
            }
            MetricSource::Topic(
                TopicKind::TripActive
                | TopicKind::TripCode
                | TopicKind::TripText
                | TopicKind::TripCount,
            ) => self.drive.model.trip_register(),
            MetricSource::Topic(
                TopicKind::WarningActive | TopicKind::WarningCode | TopicKind::WarningText,
            ) => self.drive.model.warning_register(),
            _ => None,
        };
        stale_at(self.drive, register?, self.view).filter(|stale_at| *stale_at > self.at)
    }
}
