//! The content of a metric, compared without being written out.

use super::device::LastResult;
use super::metrics::{MetricDefinition, MetricInput, MetricSource, ResultPart};
use super::payload::PayloadValue;
use crate::domain::time::MonoTime;
use crate::drive::rated::RatedConversion;
use crate::north::points::{
    DrivePoint, PointContent, PointContext, PointGroup, PublishedPoints, RATED_DIGITS,
};
use crate::north::shown::{intent, stale_at};
use crate::profile::model::Register;
use crate::profile::scale::ScaledValue;
use std::borrow::Cow;

/// The content of a metric.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum MetricContent {
    /// What a point of the drive shows, or something of its kind.
    Plain(PointContent),
    /// A part of a report, with its number: the same text of another report is a change.
    Said(Cow<'static, str>, i64),
}

impl MetricContent {
    /// Nothing reliable.
    pub(super) const NULL: Self = Self::Plain(PointContent::Unknown);
}

/// Where the content of a metric is looked up.
#[derive(Clone, Copy)]
pub(super) struct MetricContext<'l> {
    pub(super) now: PointContext<'l>,
    pub(super) points: &'l PublishedPoints,
    /// The last command from a host.
    pub(super) last_result: Option<&'l LastResult>,
}

impl MetricContext<'_> {
    /// The present content of the metric.
    pub(super) fn content(&self, definition: &MetricDefinition) -> MetricContent {
        let PointContext { drive, view, .. } = self.now;
        MetricContent::Plain(match definition.source {
            MetricSource::Point(point) => self.point(point),
            MetricSource::TripTotal => PointContent::Number(view.trip_kept.total.into()),
            MetricSource::Flag(flag) => PointContent::flag((flag.read)(view)),
            MetricSource::Watchdog => {
                PointContent::text(view.watchdog.as_ref().map(|it| it.state.keyword()))
            }
            MetricSource::Result(part) => return self.result(part),
            MetricSource::Model => PointContent::Text(drive.model.id.clone().into()),
            MetricSource::Line => PointContent::Text(drive.line.as_str().to_owned().into()),
            MetricSource::Unit => PointContent::Number(drive.unit.get().into()),
            MetricSource::Input(input) => self.input(input),
        })
    }

    /// Hosts are shown an owner of control that is none as an empty text, and not as null.
    fn point(&self, point: DrivePoint) -> PointContent {
        match (point, point.content(&self.now)) {
            (DrivePoint::Plain(point), PointContent::Unknown)
                if point.group == PointGroup::Control =>
            {
                PointContent::Text("".into())
            }
            (_, content) => content,
        }
    }

    fn result(&self, part: ResultPart) -> MetricContent {
        let Some(last) = self.last_result else {
            return MetricContent::Plain(if part == ResultPart::Count {
                PointContent::Number(0)
            } else {
                PointContent::Text("".into())
            });
        };
        match part {
            ResultPart::Outcome => {
                MetricContent::Said(last.report.outcome.keyword().into(), last.count)
            }
            ResultPart::Reason => {
                MetricContent::Said(last.report.reason.keyword().into(), last.count)
            }
            ResultPart::Message => MetricContent::Said(last.message.clone().into(), last.count),
            ResultPart::Count => MetricContent::Plain(PointContent::Number(last.count)),
        }
    }

    /// What was last written and is in force; buttons are never pressed.
    fn input(&self, input: MetricInput) -> PointContent {
        match input {
            MetricInput::Frequency => DrivePoint::Setpoint.content(&self.now),
            MetricInput::Run => {
                let control = self.now.view.control.as_ref();
                PointContent::text(control.map(|control| intent(control.intent)))
            }
            MetricInput::Reset | MetricInput::Take | MetricInput::Release | MetricInput::Lease => {
                PointContent::Flag(false)
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
        use MetricContent::Plain;
        use PointContent::Value;
        match (definition.source, old, new) {
            (MetricSource::Point(point), Plain(Value(old)), Plain(Value(new))) => {
                self.points.differ_on(point, self.now.drive, *old, *new)
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
        let content = match content {
            MetricContent::Plain(content) => content,
            MetricContent::Said(text, _) => {
                return Some(PayloadValue::Text(text.clone().into_owned()));
            }
        };
        Some(match content {
            PointContent::Unknown => return None,
            PointContent::Flag(flag) => PayloadValue::Boolean(*flag),
            PointContent::Text(text) => PayloadValue::Text(text.clone().into_owned()),
            PointContent::Hertz(hertz) => PayloadValue::Double(hertz.as_f64()),
            PointContent::Sum(sum) if definition.datatype == Int64 => {
                PayloadValue::of_i64(sum.whole())
            }
            PointContent::Sum(sum) => PayloadValue::Double(sum.value()),
            PointContent::Number(number) if definition.datatype == Int64 => {
                PayloadValue::of_i64(*number)
            }
            PointContent::Number(number) if definition.datatype == Int32 => {
                PayloadValue::of_i32(i32::try_from(*number).ok()?)
            }
            PointContent::Number(_) => return None,
            PointContent::Value(value) => PayloadValue::Double(self.number(definition, *value)?),
        })
    }

    fn number(&self, definition: &MetricDefinition, value: ScaledValue) -> Option<f64> {
        let MetricSource::Point(point) = definition.source else {
            return None;
        };
        let drive = self.now.drive;
        let place = point.register()?;
        let register = drive.model.registers.get(place)?;
        Some(match point {
            DrivePoint::Rated(_) => RatedConversion::of(register, &drive.ratings)?
                .to_digits(value, RATED_DIGITS)
                .value(),
            _ => self.points.value(place, value),
        })
    }

    /// Since when the metric has its content, as far as known; else now.
    pub(super) fn since(&self, definition: &MetricDefinition, content: &MetricContent) -> MonoTime {
        let PointContext { at, view, .. } = self.now;
        match content {
            MetricContent::Plain(PointContent::Value(_)) => self
                .register(definition)
                .and_then(|register| view.snapshot.read_at(register))
                .unwrap_or(at),
            _ if definition.is_trip() => match &view.trip_kept.last {
                Some(record) if view.trip.active == Some(true) => record.at,
                _ => at,
            },
            _ => at,
        }
    }

    /// When the content of the metric is no longer reliable; `None`: not before something changes.
    pub(super) fn ends_at(&self, definition: &MetricDefinition) -> Option<MonoTime> {
        let PointContext {
            at, drive, view, ..
        } = self.now;
        stale_at(drive, self.register(definition)?, view).filter(|stale_at| *stale_at > at)
    }

    /// The register whose age decides whether the metric is known.
    fn register(&self, definition: &MetricDefinition) -> Option<&Register> {
        match definition.source {
            MetricSource::Point(point) => point.rests_on(self.now.drive),
            _ => None,
        }
    }
}
