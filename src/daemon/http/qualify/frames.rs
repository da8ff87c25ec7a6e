//! What a trial sends: the registers, words and frames of one order, worked out without sending it.

use super::body::TrialOrder;
use crate::domain::address::Address;
use crate::domain::command::Order;
use crate::domain::control::ControlSettings;
use crate::domain::frequency::Hertz;
use crate::domain::ids::Station;
use crate::domain::link::Framing;
use crate::drive::bases::FrequencyBases;
use crate::drive::steps::{self, CommandStep, WriteFunctions};
use crate::north::api::{TrialFrame, TrialWord};
use crate::profile::model::{Model, OrderKind};
use crate::wire::framing;
use crate::wire::pdu::Request;

/// A motor turns visibly at this frequency.
const VISIBLE: Hertz = Hertz::from_millihertz(5000);

/// The setpoint of a trial: the lowest that is permitted, or if a motor might not be seen to turn at that, 5 Hz.
pub(super) fn trial_frequency(control: &ControlSettings) -> Hertz {
    control.least.max(VISIBLE.min(control.most))
}

/// What `order` writes, in order; empty if the model has no such order.
pub(super) fn order_frames(
    order: TrialOrder,
    model: &Model,
    control: &ControlSettings,
    (station, framing): (Station, Framing),
) -> Vec<TrialFrame> {
    let functions = WriteFunctions::of(model);
    let steps = match order.order(trial_frequency(control)) {
        Some(Order::Stop { .. } | Order::Coast) => {
            let stop = steps::of_stop(model, order == TrialOrder::Sent(OrderKind::Coast), None);
            return stop.map_or_else(
                |_| Vec::new(),
                |(address, value)| {
                    vec![shown(
                        &functions.request(address, value),
                        &[(address, value)],
                        station,
                        framing,
                    )]
                },
            );
        }
        Some(Order::Go(go)) => steps::of_go(model, &go, control, None, &FrequencyBases::of(model)),
        Some(Order::Reset) => steps::of_reset(model),
        Some(Order::Release) => steps::of_release(model),
        _ => return Vec::new(),
    };
    let write = |step| {
        if let CommandStep::Write(writes) = step {
            Some(writes)
        } else {
            None
        }
    };
    let writes = steps.unwrap_or_default().into_iter().filter_map(write);
    let frames = writes.filter_map(|writes| {
        let words: Vec<_> = writes
            .iter()
            .map(|write| (write.address, write.value))
            .collect();
        let request = match words[..] {
            [] => return None,
            [(address, value)] => functions.request(address, value),
            [(address, _), ..] => Request::WriteMultiple {
                address,
                values: words.iter().map(|(_, value)| *value).collect(),
            },
        };
        Some(shown(&request, &words, station, framing))
    });
    frames.collect()
}

fn shown(
    request: &Request,
    words: &[(Address, u16)],
    station: Station,
    framing: Framing,
) -> TrialFrame {
    let mut frame = Vec::new();
    framing::encode(framing, &mut frame, station.0, |out| request.encode(out));
    let bytes: Vec<_> = frame.iter().map(|byte| format!("{byte:02X}")).collect();
    let word = |(address, value): &(Address, u16)| TrialWord {
        register: address.to_string().into(),
        word: *value,
    };
    TrialFrame {
        words: words.iter().map(word).collect(),
        frame: bytes.join(" ").into(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::vendors::testing::{control, model};

    const AT: (Station, Framing) = (Station(1), Framing::Rtu);

    #[test]
    fn the_frames_are_those_of_the_model() {
        let (model, control) = (model(), control());
        let stop = order_frames(TrialOrder::Sent(OrderKind::Stop), &model, &control, AT);
        let (address, word) = steps::of_stop(&model, false, None).unwrap();
        assert_eq!(stop.len(), 1);
        let register = address.to_string().into();
        assert_eq!(stop[0].words, [TrialWord { register, word }]);
        let frame = &stop[0].frame;
        let number = address.number();
        let [high, low] = number.to_be_bytes();
        assert!(
            frame.starts_with(&format!("01 06 {high:02X} {low:02X} ")),
            "{frame}"
        );
        assert!(
            !order_frames(TrialOrder::Sent(OrderKind::Forward), &model, &control, AT).is_empty()
        );
        assert!(order_frames(TrialOrder::Renew, &model, &control, AT).is_empty());
    }

    #[test]
    fn a_trial_runs_as_slowly_as_can_be_seen() {
        let hertz = Hertz::from_millihertz;
        for (least, most, expected) in [
            (0, 50_000, 5000),
            (10_000, 50_000, 10_000),
            (0, 2000, 2000),
            (1000, 50_000, 5000),
        ] {
            let control = ControlSettings {
                least: hertz(least),
                most: hertz(most),
                ..control()
            };
            assert_eq!(
                trial_frequency(&control),
                hertz(expected),
                "{least} to {most}"
            );
        }
    }
}
