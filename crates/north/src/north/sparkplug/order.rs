//! What the metrics of a command order, or why they order nothing.

use super::device::SparkplugDevice;
use super::metrics::MetricInput;
use super::payload::{PayloadMetric, PayloadValue};
use crate::domain::command::{Direction, GoOrder, Order, Reason};
use crate::domain::frequency::Hertz;
use crate::domain::problem::nearest;
use crate::north::command_words::{
    RUN_EXAMPLE, RefusedCommand, RunWord, no_frequency, run_word, short,
};
use crate::profile::scale::Decimal;

/// What a message orders.
#[derive(Debug)]
pub(super) struct DeviceCommand {
    /// The order; `None`: there is none, as when buttons were released.
    pub(super) order: Option<Order>,
    /// Why the message, or what it contains besides a stop, is refused.
    pub(super) refused: Option<RefusedCommand>,
}

/// What one metric orders.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum MetricOrder {
    Frequency(Hertz),
    Run(Direction),
    Stop,
    Coast,
    Reset,
    Take,
    Release,
    Renew,
}

/// Reads a command for `device`. All metrics are checked before any counts; but a stop counts whatever else the message
/// contains.
pub(super) fn read(device: &SparkplugDevice, metrics: &[PayloadMetric]) -> DeviceCommand {
    let read: Vec<_> = metrics.iter().map(|metric| part(device, metric)).collect();
    let has = |part: MetricOrder| read.contains(&Ok(Some(part)));
    for (part, order) in [
        (MetricOrder::Stop, Order::Stop { setpoint: None }),
        (MetricOrder::Coast, Order::Coast),
    ] {
        if has(part) {
            let refused = read.into_iter().find_map(Result::err);
            return DeviceCommand {
                order: Some(order),
                refused,
            };
        }
    }
    let parts: Result<Vec<_>, _> = read.into_iter().filter_map(Result::transpose).collect();
    match parts.and_then(|parts| one_order(&parts)) {
        Ok(order) => DeviceCommand {
            order,
            refused: None,
        },
        Err(refused) => DeviceCommand {
            order: None,
            refused: Some(refused),
        },
    }
}

fn one_order(parts: &[MetricOrder]) -> Result<Option<Order>, RefusedCommand> {
    let mut frequency = None;
    let mut run = None;
    let mut single = None;
    for part in parts {
        let was_there = match *part {
            MetricOrder::Frequency(hertz) => frequency.replace(hertz).is_some(),
            MetricOrder::Run(direction) => run.replace(direction).is_some(),
            MetricOrder::Reset => single.replace(Order::Reset).is_some(),
            MetricOrder::Take => single.replace(Order::Take).is_some(),
            MetricOrder::Release => single.replace(Order::Release).is_some(),
            MetricOrder::Renew => single.replace(Order::Renew).is_some(),
            MetricOrder::Stop | MetricOrder::Coast => false,
        };
        if was_there {
            return Err(conflict());
        }
    }
    match (GoOrder::new(Vec::new(), frequency, run), single) {
        (Some(_), Some(_)) => Err(conflict()),
        (Some(go), None) => Ok(Some(Order::Go(go))),
        (None, single) => Ok(single),
    }
}

fn conflict() -> RefusedCommand {
    let message = "one message carries a frequency, a direction, or both; or one of reset, take, release and lease";
    RefusedCommand::new(Reason::Conflict, message)
}

/// What `metric` orders; `None`: a button that is not pressed.
fn part(
    device: &SparkplugDevice,
    metric: &PayloadMetric,
) -> Result<Option<MetricOrder>, RefusedCommand> {
    let Some(definition) = device.definition(metric) else {
        return Err(unknown(device, metric));
    };
    let name = definition.name.as_str();
    let input = definition.input().ok_or_else(|| {
        let inputs: Vec<_> = device.inputs().collect();
        let right = if inputs.is_empty() {
            "nothing here is".to_owned()
        } else {
            inputs.join(", ")
        };
        RefusedCommand::new(
            Reason::NotUnderstood,
            format!("`{name}` is not written; what is: {right}"),
        )
    })?;
    let value = if metric.is_null == Some(true) {
        None
    } else {
        metric.value.as_ref()
    };
    match input {
        MetricInput::Frequency => frequency(name, value, device.setpoint_step())
            .map(MetricOrder::Frequency)
            .map(Some),
        MetricInput::Run => run(name, value).map(Some),
        MetricInput::Reset => button(name, value, MetricOrder::Reset),
        MetricInput::Take => button(name, value, MetricOrder::Take),
        MetricInput::Release => button(name, value, MetricOrder::Release),
        MetricInput::Lease => button(name, value, MetricOrder::Renew),
    }
}

fn unknown(device: &SparkplugDevice, metric: &PayloadMetric) -> RefusedCommand {
    let message = match (&metric.name, metric.alias) {
        (Some(name), _) => {
            let near = if name.len() <= 64 {
                nearest(name, device.inputs())
            } else {
                None
            };
            let hint = near.map_or_else(String::new, |near| format!("; is it `{near}`?"));
            format!("there is no metric `{}`{hint}", short(name))
        }
        (None, Some(alias)) => {
            format!(
                "no metric of this device has the alias {alias}; its birth says which have which"
            )
        }
        (None, None) => "a metric has neither name nor alias".to_owned(),
    };
    RefusedCommand::new(Reason::NotUnderstood, message)
}

fn frequency(
    name: &str,
    value: Option<&PayloadValue>,
    step: Option<Decimal>,
) -> Result<Hertz, RefusedCommand> {
    let number = match value {
        Some(PayloadValue::Double(number)) => *number,
        // The nearest double has digits that were not written.
        Some(PayloadValue::Float(number)) => number.to_string().parse().unwrap_or(f64::NAN),
        Some(PayloadValue::Int(bits)) => f64::from(bits.cast_signed()),
        Some(PayloadValue::Long(bits)) => {
            i32::try_from(bits.cast_signed()).map_or(f64::NAN, f64::from)
        }
        _ => {
            let message = format!("`{name}` takes hertz as a number, such as 42.5");
            return Err(RefusedCommand::new(Reason::NotANumber, message));
        }
    };
    Hertz::from_f64(number).map_err(|why| no_frequency(why, name, &number.to_string(), step))
}

fn run(name: &str, value: Option<&PayloadValue>) -> Result<MetricOrder, RefusedCommand> {
    let Some(PayloadValue::Text(text)) = value else {
        return Err(RefusedCommand::new(
            Reason::NotUnderstood,
            format!("`{name}` takes text: {RUN_EXAMPLE}"),
        ));
    };
    Ok(match run_word(text)? {
        RunWord::Run(direction) => MetricOrder::Run(direction),
        RunWord::Stop => MetricOrder::Stop,
        RunWord::Coast => MetricOrder::Coast,
    })
}

fn button(
    name: &str,
    value: Option<&PayloadValue>,
    part: MetricOrder,
) -> Result<Option<MetricOrder>, RefusedCommand> {
    match value {
        Some(PayloadValue::Boolean(is_down)) => Ok(is_down.then_some(part)),
        _ => Err(RefusedCommand::new(
            Reason::NotUnderstood,
            format!("`{name}` accepts only true; false has no effect"),
        )),
    }
}
