//! The N700 against its manuals.

use super::*;
use crate::domain::units::UnitOfMeasure::{Ampere, Hertz, None as Plain, Second, Volt};
use crate::profile::model::Confidence::{Default, Inferred, Manual, SecondSource};
use crate::profile::model::RegisterAccess::{Read, ReadWrite, Write};
use crate::profile::model::{FactorySetting, ReadBoundary, RefusedWrite};

fn n700() -> Arc<Model> {
    model("hyundai-n700")
}

/// Address, code, scale, unit, access and confidence of every register, typed from the manuals.
#[rustfmt::skip]
const N700_REGISTERS: [Row; 19] = [
    (0x0002, None,           1, Plain,  Write,     Manual),       // run command
    (0x0004, None,         100, Hertz,  Write,     Manual),       // frequency command
    (0x0101, Some("D001"), 100, Hertz,  Read,      Manual),       // output frequency monitor
    (0x0112, None,           1, Plain,  Read,      SecondSource), // trip count
    (0x0113, None,           1, Plain,  Read,      Inferred),     // newest trip: cause
    (0x0114, None,         100, Hertz,  Read,      Inferred),     // newest trip: output frequency
    (0x0115, None,          10, Ampere, Read,      Inferred),     // newest trip: output current
    (0x0116, None,           1, Volt,   Read,      Inferred),     // newest trip: DC link voltage
    (0x0117, None,           1, Plain,  Read,      Inferred),     // the trips before: their causes
    (0x011B, None,           1, Plain,  Read,      Inferred),
    (0x011F, None,           1, Plain,  Read,      Inferred),
    (0x0123, None,           1, Plain,  Read,      Inferred),
    (0x0127, None,           1, Plain,  Read,      Inferred),
    (0x0201, Some("F001"), 100, Hertz,  Read,      Manual),       // output frequency setting
    (0x0202, Some("F201"), 100, Hertz,  ReadWrite, Inferred),     // frequency setting of the second motor
    (0x020C, Some("F007"),  10, Second, ReadWrite, Manual),       // acceleration time
    (0x020E, Some("F008"),  10, Second, ReadWrite, Manual),       // deceleration time
    (0x0211, Some("F010"),   1, Plain,  ReadWrite, Manual),       // frequency source
    (0x0212, Some("F011"),   1, Plain,  ReadWrite, Manual),       // run-command source
];

#[test]
fn n700_registers_are_those_of_the_manuals() {
    let model = n700();
    assert_registers(&model, &N700_REGISTERS);
    assert!(model.registers.iter().all(|register| !register.signed));
}

#[test]
fn n700_registers_have_their_uses() {
    let model = n700();
    let roles = [
        (RegisterRole::RunCommand, 0x0002),
        (RegisterRole::FrequencyCommand, 0x0004),
        (RegisterRole::OutputFrequency, 0x0101),
        (RegisterRole::TripCount, 0x0112),
        (RegisterRole::TripCause, 0x0113),
        (RegisterRole::FrequencySetting, 0x0201),
        (RegisterRole::AccelerationTime, 0x020C),
        (RegisterRole::DecelerationTime, 0x020E),
        (RegisterRole::FrequencySource, 0x0211),
        (RegisterRole::RunSource, 0x0212),
    ];
    for (role, address) in roles {
        assert_eq!(
            model.register_for(role).unwrap().address,
            address,
            "{role:?}"
        );
    }
    let polled: Vec<_> = model
        .registers
        .iter()
        .filter_map(|it| Some((it.address.number(), it.poll?)))
        .collect();
    let (fast, slow) = (PollClass::Fast, PollClass::Slow);
    assert_eq!(
        polled,
        [
            (0x0101, fast),
            (0x0112, PollClass::Second),
            (0x0201, slow),
            (0x0211, slow),
            (0x0212, slow)
        ]
    );
    let trip = [
        "trip_count",
        "trip_cause",
        "trip_frequency",
        "trip_current",
        "trip_dc_voltage",
    ];
    for (name, address) in trip.into_iter().zip(0x0112..) {
        assert_eq!(model.register_named(name).unwrap().address, address);
    }
    assert_eq!(
        model.register_named("f007").unwrap().name,
        "acceleration_time"
    );
}

#[test]
fn n700_link_is_that_of_the_manual() {
    let link = &n700().link;
    assert_eq!(
        parts(&link.default),
        (FactorySetting::Set(LinkSettings::DEFAULT), Manual)
    );
    assert_eq!(
        parts(&link.bauds),
        (vec![2400, 4800, 9600, 19_200, 38_400], Manual)
    );
    assert_eq!(
        parts(&link.parities),
        (vec![Parity::None, Parity::Even, Parity::Odd], Manual)
    );
    assert_eq!(parts(&link.stop_bits), (vec![1, 2], Manual));
    assert_eq!(parts(&link.data_bits), (vec![8], Manual));
    assert_eq!(parts(&link.framings), (vec![Framing::Rtu], Manual));
    assert_eq!(
        parts(&link.interfaces),
        (vec![Interface::Rs485, Interface::Rs232], Manual)
    );
    assert_eq!(parts(&link.stations), (1..=32, Manual));
    let broadcast = link.broadcast.as_ref().unwrap();
    assert_eq!(
        (parts(&broadcast.station), &broadcast.functions[..]),
        ((0xFF, Manual), &[0x06][..])
    );
}

#[test]
fn n700_times_and_limits_are_those_of_the_manual() {
    let model = n700();
    assert_eq!(parts(&model.timing.gap_chars), (4.5, Manual));
    assert_eq!(
        parts(&model.timing.reply_timeout_cap),
        (Duration::from_millis(500), Default)
    );
    assert_eq!(
        parts(&model.timing.max_lateness),
        (Duration::from_millis(500), Default)
    );
    assert_eq!(model.timing.processing_max, None);
    assert_eq!(
        (parts(&model.read.max_words), model.read.boundary),
        ((8, Manual), Some(ReadBoundary::HighByte))
    );
    assert_eq!(
        (
            model.words_in_one_read(0x0101),
            model.words_in_one_read(0x01FE)
        ),
        (8, 2)
    );
    assert_eq!(
        parts(&model.write.refused),
        (RefusedWrite::KeepsOldValue, Inferred)
    );
    let barriers = [(0x0101, 1), (0x0211, 2), (0x0113, 4)].map(|(address, count)| {
        Barrier::Read(BarrierRead {
            address: address.into(),
            count,
        })
    });
    assert_eq!(model.barriers, barriers);
}

#[test]
fn n700_run_commands_are_those_of_the_manual() {
    let run = n700().run.clone().unwrap();
    assert_eq!(
        (parts(&run.stop), parts(&run.forward)),
        ((0, Manual), (1, Manual))
    );
    let others = [run.reverse, run.coast, run.reset].map(|fact| parts(&fact.unwrap()));
    assert_eq!(others, [(2, Manual), (3, Manual), (4, Manual)]);
}
