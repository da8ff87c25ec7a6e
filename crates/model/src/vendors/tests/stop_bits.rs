//! What a stop of each model does with the bits of an order to run that do not run the motor.

use super::{CATALOG, model};
use crate::domain::command::Direction;
use crate::profile::model::StopBits;

const BOTH: [Direction; 2] = [Direction::Forward, Direction::Reverse];

#[test]
fn no_stop_changes_anything_but_the_running_unless_its_documents_show_that_word() {
    for model in CATALOG.models() {
        let Some(run) = &model.run else { continue };
        for direction in BOTH {
            let changed = run.changed_by_stop(direction);
            assert_eq!(
                changed, 0,
                "{}: a stop after {direction:?} changes 0x{changed:04X} as well",
                model.id
            );
        }
        let said = run.stop_bits.keeps | run.stop_bits.drops;
        let orders = [Some(&run.forward), run.reverse.as_ref()]
            .into_iter()
            .flatten();
        let differs = orders.fold(0, |all, order| all | (order.value ^ run.stop.value));
        assert_eq!(
            said & !differs,
            0,
            "{}: no order has these bits other than the stop",
            model.id
        );
    }
}

#[test]
fn a_cfw_that_is_stopped_keeps_its_direction() {
    for id in ["weg-cfw300", "weg-cfw500"] {
        let run = model(id).run.clone().unwrap();
        let words = [None, Some(Direction::Forward), Some(Direction::Reverse)]
            .map(|after| run.stop_word(after));
        assert_eq!(words, [0x0002, 0x0006, 0x0002], "{id}");
    }
}

#[test]
fn these_stops_change_the_direction_by_their_documents() {
    let found: Vec<_> = CATALOG
        .models()
        .filter_map(|model| Some((model.id.as_str(), model.run.as_ref()?.stop_bits)))
        .filter(|(_, bits)| *bits != StopBits::default())
        .map(|(id, bits)| (id, bits.keeps, bits.drops))
        .collect();
    let expected = [
        ("danfoss-fc51", 0, 0x8000),
        ("eaton-dc1", 0, 0x0002),
        ("eaton-de1", 0, 0x0002),
        ("eaton-mmax", 0, 0x0002),
        ("siemens-g120", 0, 0x0800),
        ("siemens-v20", 0, 0x0800),
        ("teco-e510", 0, 0x0002),
        ("teco-e510s", 0, 0x0002),
        ("toshiba-vf-as1", 0, 0x0200),
        ("toshiba-vf-s15", 0, 0x0200),
        ("vacon-10", 0, 0x0002),
        ("vacon-100", 0, 0x0002),
        ("vacon-20", 0, 0x0002),
        ("weg-cfw300", 0x0004, 0),
        ("weg-cfw500", 0x0004, 0),
    ];
    assert_eq!(found, expected);
}
