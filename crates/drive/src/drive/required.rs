//! What must hold at a drive before an order is sent to it, read first: that it is the drive that the configuration
//! names, and that its settings are those on which the model's commands and scales rest. A stop waits for none of this.

use super::steps::CommandStep;
use crate::domain::address::Address;
use crate::domain::command::{Direction, Order, Reason};
use crate::profile::model::{Model, NeededFor};

/// The reads that come before the steps of `order`. `is_identified`: the drive's identity was read since it came into
/// sight. `only`: the identity register and the word of the one drive that the configuration's acceptance is for, if it
/// rests on what was seen there.
#[must_use]
pub fn before(
    model: &Model,
    order: &Order,
    is_identified: bool,
    only: Option<(Address, u16)>,
) -> Vec<CommandStep> {
    let identity = match &model.identity {
        Some(identity) if !is_identified => Some(CommandStep::Require {
            address: identity.address,
            mask: identity.mask,
            values: match only {
                Some((address, word)) if address == identity.address => vec![word & identity.mask],
                _ => identity.values.value.clone(),
            },
            reason: Reason::OtherDrive,
        }),
        _ => None,
    };
    let settings = model
        .setup
        .iter()
        .filter(|item| item.needed_for.iter().any(|need| is_part(*need, order)));
    let settings = settings.filter_map(|item| {
        let (mask, values) = (item.mask, item.values.value.clone());
        Some(CommandStep::Require {
            address: item.address?,
            mask,
            values,
            reason: Reason::Precondition,
        })
    });
    identity.into_iter().chain(settings).collect()
}

/// Whether `order` contains what `need` names.
fn is_part(need: NeededFor, order: &Order) -> bool {
    let Order::Go(go) = order else { return false };
    match need {
        NeededFor::Run => go.run().is_some(),
        NeededFor::Reverse => go.run() == Some(Direction::Reverse),
        NeededFor::Setpoint => go.frequency().is_some(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::domain::command::GoOrder;
    use crate::domain::frequency::Hertz;
    use crate::profile::model::{Confidence, Fact, ModelIdentity};
    use crate::vendors::testing::{model, setup};

    fn guarded() -> Model {
        let mut model = model();
        model.setup = setup();
        model.setup[0].needed_for = vec![NeededFor::Run];
        model.setup[1].needed_for = vec![NeededFor::Reverse, NeededFor::Setpoint];
        model.setup[1].mask = 0x00FF;
        let values = Fact {
            value: vec![7],
            confidence: Confidence::Manual,
            source: "IM 1".to_owned(),
        };
        model.identity = Some(ModelIdentity {
            address: 0x0700_u16.into(),
            mask: 0xFF00,
            values,
            others: Vec::new(),
        });
        model
    }

    fn read(order: &Order, is_identified: bool) -> Vec<(u16, u16)> {
        let reads = before(&guarded(), order, is_identified, None)
            .into_iter()
            .map(|step| match step {
                CommandStep::Require { address, mask, .. } => (address.number(), mask),
                other => panic!("{other:?}"),
            });
        reads.collect()
    }

    #[test]
    fn an_order_is_preceded_by_what_it_needs_and_a_stop_by_nothing() {
        let go = |frequency, run| Order::Go(GoOrder::new(Vec::new(), frequency, run).unwrap());
        let setpoint = Some(Hertz::from_millihertz(30_000));
        assert_eq!(
            read(&go(None, Some(Direction::Forward)), true),
            [(0x0211, 0xFFFF)]
        );
        assert_eq!(
            read(&go(None, Some(Direction::Reverse)), true),
            [(0x0211, 0xFFFF), (0x0212, 0x00FF)]
        );
        assert_eq!(read(&go(setpoint, None), true), [(0x0212, 0x00FF)]);
        assert_eq!(
            read(&go(setpoint, None), false),
            [(0x0700, 0xFF00), (0x0212, 0x00FF)]
        );
        assert_eq!(read(&Order::Reset, true), []);
        assert_eq!(
            read(&Order::Reset, false),
            [(0x0700, 0xFF00)],
            "another drive is read-only"
        );
    }

    #[test]
    fn what_was_seen_at_one_drive_holds_for_that_one_alone() {
        let values = |only| match &before(&guarded(), &Order::Reset, false, only)[..] {
            [CommandStep::Require { values, .. }] => values.clone(),
            other => panic!("{other:?}"),
        };
        assert_eq!(values(Some((0x0700_u16.into(), 0x2A07))), [0x2A00]);
        assert_eq!(
            values(Some((0x0701_u16.into(), 0x2A07))),
            [7],
            "the word of another register says nothing"
        );
    }
}
