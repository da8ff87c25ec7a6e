//! The N100plus against its manual and what is known of its sibling.

use super::*;
use crate::domain::address::Address;
use crate::domain::units::UnitOfMeasure::{Ampere, Hertz, Hour, None as Plain, Second, Volt};
use crate::profile::model::BitMeaning::{Reset, RunForward, RunReverse};
use crate::profile::model::Confidence::{Default, Inferred, Manual, Sibling};
use crate::profile::model::RegisterAccess::{Read, ReadWrite, Write};
use crate::profile::model::{CodeRule, DriveQuirks, FactorySetting, ReadBoundary, RefusedWrite};
use crate::profile::register::{extra_register, with_extra};
use crate::toml_file::document;

fn n100plus() -> Arc<Model> {
    model("hyundai-n100plus")
}

#[rustfmt::skip]
const REGISTERS: [Row; 39] = [
    (0x0002, None,          1, Plain,  Write,     Manual),   // run command
    (0x0004, None,        100, Hertz,  Write,     Manual),   // frequency command
    (0x0101, Some("d01"), 100, Hertz,  Read,      Manual),   // output frequency
    (0x0102, Some("d02"),  10, Ampere, Read,      Inferred), // output current
    (0x0103, Some("d03"),   1, Volt,   Read,      Inferred), // output voltage
    (0x0104, Some("d04"),   1, Plain,  Read,      Inferred), // direction
    (0x0105, Some("d05"),   1, Plain,  Read,      Inferred), // PID feedback
    (0x0106, Some("d06"),   1, Plain,  Read,      Inferred), // input terminals
    (0x0107, Some("d07"),   1, Plain,  Read,      Inferred), // output terminals
    (0x0108, Some("d08"),   1, Plain,  Read,      Inferred), // scaled output frequency
    (0x0109, Some("d09"),   1, Plain,  Read,      Inferred), // power
    (0x010A, Some("d10"),   1, Hour,   Read,      Inferred), // run time, hours
    (0x010B, Some("d11"),   1, Plain,  Read,      Inferred), // run time, minutes
    (0x010C, Some("d12"),   1, Volt,   Read,      Inferred), // DC link voltage
    (0x010D, Some("d13"),   1, Plain,  Read,      Inferred), // newest trip: cause, frequency, current, DC link
    (0x010E, None,        100, Hertz,  Read,      Inferred),
    (0x010F, None,         10, Ampere, Read,      Inferred),
    (0x0110, None,          1, Volt,   Read,      Inferred),
    (0x0111, None,          1, Plain,  Read,      Inferred), // previous trip 1
    (0x0112, None,        100, Hertz,  Read,      Inferred),
    (0x0113, None,         10, Ampere, Read,      Inferred),
    (0x0114, None,          1, Volt,   Read,      Inferred),
    (0x0115, None,          1, Plain,  Read,      Inferred), // previous trip 2
    (0x0116, None,        100, Hertz,  Read,      Inferred),
    (0x0117, None,         10, Ampere, Read,      Inferred),
    (0x0118, None,          1, Volt,   Read,      Inferred),
    (0x0119, None,          1, Plain,  Read,      Inferred), // previous trip 3
    (0x011A, None,        100, Hertz,  Read,      Inferred),
    (0x011B, None,         10, Ampere, Read,      Inferred),
    (0x011C, None,          1, Volt,   Read,      Inferred),
    (0x011D, None,          1, Plain,  Read,      Manual),   // trip count
    (0x0201, Some("F01"), 100, Hertz,  Read,      Manual),   // frequency setting
    (0x0202, Some("F02"),  10, Second, ReadWrite, Manual),   // acceleration time
    (0x0203, Some("F03"),  10, Second, ReadWrite, Manual),   // deceleration time
    (0x0301, Some("A01"),   1, Plain,  ReadWrite, Inferred), // frequency source
    (0x0302, Some("A02"),   1, Plain,  ReadWrite, Inferred), // run-command source
    (0x0303, Some("A03"), 100, Hertz,  ReadWrite, Sibling),  // base frequency
    (0x0304, Some("A04"), 100, Hertz,  ReadWrite, Sibling),  // maximum frequency
    (0x0411, Some("b17"),   1, Plain,  ReadWrite, Inferred), // station
];

#[test]
fn registers_are_those_of_the_sheet() {
    let model = n100plus();
    assert_registers(&model, &REGISTERS);
    assert_eq!(signed(&model), NOTHING);
    assert_eq!(ranges(&model), [(0x0411, 1..=32)]);
    assert_eq!(back_doors(&model), [0x0304]);
    assert_eq!(
        (
            in_memory(&model, RegisterMemory::Ram),
            in_memory(&model, RegisterMemory::Stored)
        ),
        (vec![], vec![])
    );
    let sources = [
        (0, "potentiometer"),
        (1, "terminal"),
        (2, "operator panel"),
        (3, "communication"),
    ];
    assert_eq!(meanings(&model, 0x0301), sources);
    assert_eq!(
        meanings(&model, 0x0302),
        [(0, "operator panel"), (1, "terminal"), (2, "communication")]
    );
}

#[test]
fn registers_have_their_uses() {
    let model = n100plus();
    assert_roles(
        &model,
        &[
            (RegisterRole::RunCommand, 0x0002),
            (RegisterRole::FrequencyCommand, 0x0004),
            (RegisterRole::FrequencySetting, 0x0201),
            (RegisterRole::OutputFrequency, 0x0101),
            (RegisterRole::OutputCurrent, 0x0102),
            (RegisterRole::OutputVoltage, 0x0103),
            (RegisterRole::RunHours, 0x010A),
            (RegisterRole::DcLinkVoltage, 0x010C),
            (RegisterRole::TripCause, 0x010D),
            (RegisterRole::TripFrequency, 0x010E),
            (RegisterRole::TripCurrent, 0x010F),
            (RegisterRole::TripDcLinkVoltage, 0x0110),
            (RegisterRole::TripHistory, 0x0111),
            (RegisterRole::TripHistory, 0x0115),
            (RegisterRole::TripHistory, 0x0119),
            (RegisterRole::TripCount, 0x011D),
            (RegisterRole::AccelerationTime, 0x0202),
            (RegisterRole::DecelerationTime, 0x0203),
            (RegisterRole::FrequencySource, 0x0301),
            (RegisterRole::RunSource, 0x0302),
        ],
    );
    assert_eq!(polled(&model, PollClass::Fast), [0x0101]);
    assert_eq!(polled(&model, PollClass::Second), [0x011D]);
    let slow = [
        0x0102, 0x0103, 0x010A, 0x010B, 0x010C, 0x0201, 0x0301, 0x0302,
    ];
    assert_eq!(polled(&model, PollClass::Slow), slow);
    assert_eq!(polled(&model, PollClass::Hourly), NOTHING);
}

#[test]
fn the_link_is_that_of_the_manual() {
    let model = n100plus();
    let link = &model.link;
    assert_eq!(
        parts(&link.default),
        (FactorySetting::Set(LinkSettings::DEFAULT), Inferred)
    );
    assert_eq!(parts(&link.bauds), (vec![9600], Manual));
    assert_eq!(
        parts(&link.parities),
        (vec![Parity::None, Parity::Even, Parity::Odd], Manual)
    );
    assert_eq!(parts(&link.stop_bits), (vec![1], Manual));
    assert_eq!(parts(&link.data_bits), (vec![8], Manual));
    assert_eq!(parts(&link.framings), (vec![Framing::Rtu], Manual));
    assert_eq!(parts(&link.interfaces), (vec![Interface::Rs485], Manual));
    assert_eq!(parts(&link.stations), (1..=32, Manual));
    assert_eq!(link.broadcast, None);
}

#[test]
fn times_and_limits_are_those_of_the_sheet() {
    let model = n100plus();
    assert_eq!(parts(&model.timing.gap_chars), (4.5, Manual));
    assert_eq!(parts(&model.timing.reply_timeout_cap), (ms(1200), Default));
    assert_eq!(parts(&model.timing.max_lateness), (ms(1500), Default));
    assert_eq!(
        maybe(model.timing.reply_delay_max.as_ref()),
        Some((ms(1000), Sibling))
    );
    assert_eq!(
        (&model.timing.processing_max, &model.timing.stored_write_max),
        (&None, &None)
    );
    assert_eq!(model.timing.reply_char_bits, None);
    assert_eq!(parts(&model.functions), (vec![3, 6], Manual));
    assert_eq!(
        (parts(&model.read.max_words), model.read.boundary),
        ((8, Manual), Some(ReadBoundary::HighByte))
    );
    assert_eq!(
        parts(&model.write.refused),
        (RefusedWrite::KeepsOldValue, Manual)
    );
    assert_eq!(model.write.block, None);
    assert_eq!(
        model.barriers,
        [
            barrier_read(0x0101, 1),
            barrier_read(0x0201, 2),
            barrier_read(0x010D, 4)
        ]
    );
    assert_eq!(
        (codes(&model.exceptions), &model.quirks),
        (vec![], &DriveQuirks::default())
    );
}

#[test]
fn run_commands_are_those_of_the_manual() {
    let model = n100plus();
    let [stop, forward, reverse] = [0, 1, 2].map(|word| Some((word, Manual)));
    assert_eq!(
        run_words(&model),
        [stop, forward, reverse, None, Some((4, Manual)), None]
    );
    let run = model.run.as_ref().unwrap();
    assert_eq!(run.reset_words(), [0, 4, 0]);
    assert_eq!(
        run.never.iter().map(|fact| fact.value).collect::<Vec<_>>(),
        [3]
    );
    let RunForm::Bits { bits, priority, .. } = &run.form else {
        panic!("bits")
    };
    let bits: Vec<_> = bits
        .iter()
        .map(|bit| (bit.bit.value, bit.meaning, bit.bit.confidence))
        .collect();
    assert_eq!(
        bits,
        [
            (0, RunForward, Manual),
            (1, RunReverse, Manual),
            (2, Reset, Manual)
        ]
    );
    assert_eq!(*priority, 0);
}

#[test]
fn trips_sources_and_codes_are_those_of_the_manual() {
    let model = n100plus();
    assert_eq!(
        codes(&model.trip_codes),
        [1, 2, 3, 4, 6, 7, 8, 9, 10, 11, 12]
    );
    assert_eq!(
        model
            .trip_text(12)
            .map(|it| (it.text.as_str(), it.confidence)),
        Some(("ground fault", Manual))
    );
    let on_the_bus = [
        (IndicatedState::BusRun, 0x0302, 0xFFFF, vec![2], Inferred),
        (
            IndicatedState::BusFrequency,
            0x0301,
            0xFFFF,
            vec![3],
            Inferred,
        ),
    ];
    assert_eq!(status(&model), on_the_bus);
    // 3 for one and 2 for the other.
    assert_eq!(
        setup(&model),
        [
            ("A01", Some(0x0301), &[3][..], Manual),
            ("A02", Some(0x0302), &[2][..], Manual)
        ]
    );
    assert_eq!(model.watchdog, None);
    let rule = model.codes.as_ref().unwrap();
    assert_eq!(
        (
            rule.address("A60"),
            rule.address("H01"),
            rule.address("D01")
        ),
        (Some(0x033C), Some(0x0701), None)
    );
    assert!(matches!(rule, CodeRule::Groups { origin, .. } if origin.confidence == Manual));
    assert_eq!(
        (
            rule.address("d13"),
            rule.address("d14"),
            rule.address("d17")
        ),
        (Some(0x010D), None, None)
    );
}

/// What a configuration adds to the model with these lines, and what is wrong with them.
fn extended(lines: &str) -> (Model, Vec<String>) {
    let mut problems = Vec::new();
    let document = document(lines, &mut problems).unwrap();
    let extra = vec![extra_register(document.section(), &mut problems)];
    let model = with_extra(&n100plus(), &extra, &mut problems);
    (
        model,
        problems
            .into_iter()
            .map(|problem| format!("{}: {}", problem.key, problem.what))
            .collect(),
    )
}

#[test]
fn a_register_may_be_named_like_its_own_code() {
    let a60 = |more: &str| format!("title = 'A60'\nunit = '-'\naccess = 'read'\n{more}\n");
    for lines in [
        "name = 'a60'\ncode = 'A60'\naddress = 0x033C",
        "name = 'a60'\naddress = 0x033C",
    ] {
        let (model, problems) = extended(&a60(lines));
        assert_eq!(problems, [""; 0], "{lines}");
        for name in ["a60", "A60"] {
            let found = model.register_named(name).map(|register| register.address);
            assert_eq!(found, Some(Address::holding(0x033C)), "{lines}: {name}");
        }
    }
    let (_, problems) = extended(&a60("name = 'a60'\ncode = 'A60'\naddress = 0x0303"));
    assert!(
        problems
            .iter()
            .any(|it| it.contains("`A60` is 0x033C by `codes`")),
        "{problems:?}"
    );
    let (_, problems) = extended(&a60("name = 'd01'\naddress = 0x033C"));
    assert_eq!(
        problems,
        ["name: the name `d01` is taken by `output_frequency` of the model"]
    );
}

#[test]
fn behind_d13_a_code_may_be_at_any_address() {
    let (model, problems) = extended(
        "name = 'trips'\ncode = 'd17'\ntitle = 'x'\nunit = '-'\naccess = 'read'\naddress = 0x0120",
    );
    assert_eq!(problems, [""; 0]);
    assert_eq!(
        model
            .register_named("d17")
            .map(|register| register.address.number()),
        Some(0x0120)
    );
}
