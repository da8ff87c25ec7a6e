//! The E510 and the E510s against their manuals, field notes and what is known of their siblings.

use super::*;
use crate::domain::address::Address;
use crate::domain::units::UnitOfMeasure::{
    Ampere, Celsius, Hertz, Kilowatt, None as Plain, Rpm, Second, Volt,
};
use crate::profile::model::BitMeaning::{Other, Reset, Reverse, Run, Trip};
use crate::profile::model::Confidence::{
    Default, Inferred, Manual, SecondSource, Sibling, ThirdParty,
};
use crate::profile::model::RegisterAccess::{Read, ReadWrite, Write};
use crate::profile::model::{FactorySetting, ReadBoundary, RefusedWrite};

fn e510() -> Arc<Model> {
    model("teco-e510")
}

fn e510s() -> Arc<Model> {
    model("teco-e510s")
}

#[rustfmt::skip]
const E510: [Row; 38] = [
    (0x0002, Some("00-02"),   1, Plain,    ReadWrite, ThirdParty), // run source
    (0x0005, Some("00-05"),   1, Plain,    ReadWrite, ThirdParty), // frequency source
    (0x0008, Some("00-08"), 100, Hertz,    ReadWrite, Sibling),      // communication frequency
    (0x000C, Some("00-12"),   1, Plain,    ReadWrite, ThirdParty), // upper limit, scale in conflict
    (0x000D, Some("00-13"),   1, Plain,    ReadWrite, ThirdParty), // lower limit, scale in conflict
    (0x000E, Some("00-14"),  10, Second,   ReadWrite, ThirdParty), // acceleration time
    (0x000F, Some("00-15"),  10, Second,   ReadWrite, ThirdParty), // deceleration time
    (0x0201, Some("02-01"),  10, Ampere,   ReadWrite, ThirdParty), // motor: current
    (0x0203, Some("02-03"),   1, Rpm,      ReadWrite, ThirdParty), // speed
    (0x0204, Some("02-04"),  10, Volt,     ReadWrite, ThirdParty), // voltage
    (0x0205, Some("02-05"),  10, Kilowatt, ReadWrite, ThirdParty), // power
    (0x0206, Some("02-06"),  10, Hertz,    ReadWrite, ThirdParty), // frequency
    (0x0207, Some("02-07"),   1, Plain,    ReadWrite, ThirdParty), // poles
    (0x0900, Some("09-00"),   1, Plain,    ReadWrite, ThirdParty), // station
    (0x0901, Some("09-01"),   1, Plain,    ReadWrite, ThirdParty), // mode
    (0x0902, Some("09-02"),   1, Plain,    ReadWrite, Sibling),      // speed, two codes of the L510
    (0x0903, Some("09-03"),   1, Plain,    ReadWrite, ThirdParty), // stop bits
    (0x0904, Some("09-04"),   1, Plain,    ReadWrite, Sibling),      // parity, codes of the L510
    (0x0905, Some("09-05"),   1, Plain,    ReadWrite, ThirdParty), // data bits
    (0x0906, Some("09-06"),  10, Second,   ReadWrite, ThirdParty), // loss detection time
    (0x0907, Some("09-07"),   1, Plain,    ReadWrite, ThirdParty), // loss reaction
    (0x0D00, Some("13-00"),   1, Plain,    Read,      ThirdParty), // model
    (0x0D01, Some("13-01"),   1, Plain,    Read,      ThirdParty), // software version
    (0x2501, None,            1, Plain,    Write,     SecondSource), // operation command
    (0x2502, None,          100, Hertz,    Write,     SecondSource), // frequency command
    (0x2520, None,            1, Plain,    Read,      ThirdParty), // state
    (0x2521, None,            1, Plain,    Read,      Sibling),      // fault code
    (0x2522, None,            1, Plain,    Read,      Sibling),      // terminals
    (0x2523, None,          100, Hertz,    Read,      SecondSource), // frequency command
    (0x2524, None,          100, Hertz,    Read,      ThirdParty), // output frequency
    (0x2525, None,           10, Volt,     Read,      ThirdParty), // output voltage
    (0x2526, None,            1, Volt,     Read,      ThirdParty), // DC bus
    (0x2527, None,           10, Ampere,   Read,      ThirdParty), // output current
    (0x2528, None,            1, Plain,    Read,      ThirdParty),   // in conflict
    (0x2529, None,            1, Plain,    Read,      ThirdParty),   // in conflict
    (0x2531, None,           10, Celsius,  Read,      Sibling),      // heatsink
    (0x2532, None,            1, Plain,    Read,      Sibling),      // current in per cent
    (0xA002, None,            1, Plain,    Write,     SecondSource), // another frequency command
];

#[rustfmt::skip]
const E510S: [Row; 28] = [
    (0x0002, Some("00-02"),   1, Plain,  ReadWrite, Sibling),
    (0x0005, Some("00-05"),   1, Plain,  ReadWrite, Sibling),
    (0x0008, Some("00-08"), 100, Hertz,  ReadWrite, Sibling),
    (0x000C, Some("00-12"),   1, Plain,  ReadWrite, Sibling),
    (0x000D, Some("00-13"),   1, Plain,  ReadWrite, Sibling),
    (0x0900, Some("09-00"),   1, Plain,  ReadWrite, Inferred),
    (0x0901, Some("09-01"),   1, Plain,  ReadWrite, Inferred),
    (0x0902, Some("09-02"),   1, Plain,  ReadWrite, Inferred),
    (0x0903, Some("09-03"),   1, Plain,  ReadWrite, Inferred),
    (0x0904, Some("09-04"),   1, Plain,  ReadWrite, Inferred),
    (0x0905, Some("09-05"),   1, Plain,  ReadWrite, Inferred),
    (0x0906, Some("09-06"),  10, Second, ReadWrite, Inferred),
    (0x0907, Some("09-07"),   1, Plain,  ReadWrite, Inferred),
    (0x0908, Some("09-08"),   1, Plain,  ReadWrite, Inferred), // tolerance count
    (0x0909, Some("09-09"), 1000, Second, ReadWrite, Inferred), // reply waiting time, in ms
    (0x090A, Some("09-10"),   1, Plain,  ReadWrite, Inferred), // BACnet instance
    (0x0C10, Some("12-16"), 100, Hertz,  Read,      SecondSource),
    (0x2501, None,            1, Plain,  Write,     Sibling),
    (0x2502, None,          100, Hertz,  Write,     SecondSource),
    (0x2520, None,            1, Plain,  Read,      Inferred),
    (0x2521, None,            1, Plain,  Read,      Inferred),
    (0x2522, None,            1, Plain,  Read,      Inferred),
    (0x2523, None,          100, Hertz,  Read,      Inferred),
    (0x2524, None,          100, Hertz,  Read,      Inferred),
    (0x2525, None,           10, Volt,   Read,      Inferred),
    (0x2526, None,            1, Volt,   Read,      Inferred),
    (0x2527, None,           10, Ampere, Read,      Inferred),
    (0xA002, None,            1, Plain,  Write,     Sibling),
];

#[test]
fn registers_are_those_of_the_sheet() {
    let (e510, e510s) = (e510(), e510s());
    assert_registers(&e510, &E510);
    assert_registers(&e510s, &E510S);
    for model in [&e510, &e510s] {
        assert_eq!(signed(model), NOTHING);
        assert_eq!(back_doors(model), [0x0008, 0x000C, 0x000D, 0xA002]);
        assert_eq!(in_memory(model, RegisterMemory::Ram), NOTHING);
        assert_eq!(
            in_memory(model, RegisterMemory::Stored),
            addresses(model, |register| register.address < 0x2000_u16.into())
        );
    }
    assert_eq!(ranges(&e510), [(0x0900, 1..=32), (0x0906, 0..=255)]);
    let of_the_e510s = [
        (0x0900, 1..=254),
        (0x0906, 0..=255),
        (0x0908, 1..=20),
        (0x0909, 5..=65),
        (0x090A, 1..=254),
    ];
    assert_eq!(ranges(&e510s), of_the_e510s);
}

#[test]
fn codes_mean_other_things_on_the_other_model() {
    let (e510, e510s) = (e510(), e510s());
    let speeds = ["4800 bit/s", "9600 bit/s", "19200 bit/s", "38400 bit/s"];
    assert_eq!(
        meanings(&e510, 0x0902),
        (0..).zip(speeds).collect::<Vec<_>>()
    );
    assert_eq!(
        meanings(&e510s, 0x0902),
        (2..).zip(speeds).collect::<Vec<_>>()
    );
    assert_eq!(
        meanings(&e510, 0x0901),
        [(0, "RTU"), (1, "ASCII"), (2, "BACnet")]
    );
    assert_eq!(meanings(&e510s, 0x0901).last(), Some(&(1, "BACnet")));
    let reactions = [
        (0, "decelerate (time 1)"),
        (1, "coast"),
        (2, "decelerate (time 2)"),
        (3, "keep running"),
    ];
    for model in [&e510, &e510s] {
        assert_eq!(
            meanings(model, 0x0904),
            [(0, "none"), (1, "even"), (2, "odd")]
        );
        assert_eq!(meanings(model, 0x0905), [(0, "eight"), (1, "seven")]);
        assert_eq!(meanings(model, 0x0907), reactions);
    }
}

#[test]
fn registers_have_their_uses() {
    let both = [
        (RegisterRole::RunSource, 0x0002),
        (RegisterRole::FrequencySource, 0x0005),
        (RegisterRole::RunCommand, 0x2501),
        (RegisterRole::FrequencyCommand, 0x2502),
        (RegisterRole::TripCode, 0x2521),
        (RegisterRole::FrequencySetting, 0x2523),
        (RegisterRole::OutputFrequency, 0x2524),
        (RegisterRole::OutputVoltage, 0x2525),
        (RegisterRole::DcLinkVoltage, 0x2526),
        (RegisterRole::OutputCurrent, 0x2527),
    ];
    let ramps = [
        (RegisterRole::AccelerationTime, 0x000E),
        (RegisterRole::DecelerationTime, 0x000F),
    ];
    assert_roles(&e510(), &[&both[..], &ramps].concat());
    assert_roles(&e510s(), &both);
    let sparing = [0x0002, 0x0005];
    for (model, hourly) in [
        (e510(), [&sparing[..], &[0x0D00, 0x0D01]].concat()),
        (e510s(), sparing.to_vec()),
    ] {
        assert_eq!(
            polled(&model, PollClass::Fast),
            (0x2520..=0x2527).collect::<Vec<_>>()
        );
        assert_eq!(
            (
                polled(&model, PollClass::Second),
                polled(&model, PollClass::Slow)
            ),
            (vec![], vec![])
        );
        assert_eq!(
            polled(&model, PollClass::Minutely),
            [0x0906, 0x0907],
            "its watchdog"
        );
        assert_eq!(polled(&model, PollClass::Hourly), hourly);
    }
}

#[test]
fn the_link_is_that_of_the_sheet() {
    let (e510, e510s) = (e510(), e510s());
    let factory = LinkSettings {
        baud: 19_200,
        ..LinkSettings::DEFAULT
    };
    assert_eq!(
        parts(&e510.link.default),
        (FactorySetting::Set(factory), ThirdParty)
    );
    assert_eq!(
        parts(&e510s.link.default),
        (FactorySetting::Set(factory), Sibling)
    );
    for (model, codes) in [(&e510, Sibling), (&e510s, SecondSource)] {
        let link = &model.link;
        assert_eq!(
            parts(&link.bauds),
            (vec![4800, 9600, 19_200, 38_400], codes)
        );
        assert_eq!(
            parts(&link.parities),
            (vec![Parity::None, Parity::Even, Parity::Odd], codes)
        );
        assert_eq!(parts(&link.stop_bits), (vec![1, 2], SecondSource));
        assert_eq!(parts(&link.data_bits), (vec![8, 7], SecondSource));
        assert_eq!(
            parts(&link.framings),
            (vec![Framing::Rtu, Framing::Ascii], SecondSource)
        );
        assert_eq!(
            parts(&link.interfaces),
            (vec![Interface::Rs485], SecondSource)
        );
        assert_eq!(link.broadcast, None);
    }
    assert_eq!(parts(&e510.link.stations), (1..=32, SecondSource));
    assert_eq!(parts(&e510s.link.stations), (1..=247, SecondSource));
}

#[test]
fn times_and_limits_are_those_of_the_sheet() {
    let (e510, e510s) = (e510(), e510s());
    for (model, delay, block) in [
        (&e510, Sibling, SecondSource),
        (&e510s, SecondSource, Sibling),
    ] {
        assert_eq!(parts(&model.timing.gap_chars), (3.5, Default));
        assert_eq!(parts(&model.timing.reply_timeout_cap), (ms(500), Default));
        assert_eq!(parts(&model.timing.max_lateness), (ms(500), Default));
        assert_eq!(
            maybe(model.timing.reply_delay_max.as_ref()),
            Some((ms(65), delay))
        );
        assert_eq!(
            (&model.timing.processing_max, &model.timing.stored_write_max),
            (&None, &None)
        );
        assert_eq!(model.timing.reply_char_bits, None);
        assert_eq!(model.functions.value, [0x03, 0x06, 0x08, 0x10]);
        assert_eq!(model.read.boundary, Some(ReadBoundary::HighByte));
        assert_eq!(
            parts(&model.write.refused),
            (RefusedWrite::Exception, SecondSource)
        );
        let written = model.write.block.as_ref().unwrap();
        assert_eq!(
            (written.address.number(), parts(&written.count)),
            (0x2501, (2, block))
        );
        let [Barrier::Loop(loop_test), reads @ ..] = &model.barriers[..] else {
            panic!("{:?}", model.barriers)
        };
        assert_eq!(loop_test.confidence, SecondSource);
        assert_eq!(
            reads,
            [
                barrier_read(0x2524, 1),
                barrier_read(0x2523, 3),
                barrier_read(0x2523, 5)
            ]
        );
    }
    assert_eq!(
        (e510.functions.confidence, e510s.functions.confidence),
        (SecondSource, Manual)
    );
    assert_eq!(parts(&e510.read.max_words), (37, SecondSource));
    assert_eq!(
        maybe(e510.read.max_words_ascii.as_ref()),
        Some((17, SecondSource))
    );
    assert_eq!(parts(&e510s.read.max_words), (32, SecondSource));
    assert_eq!(
        maybe(e510s.read.max_words_ascii.as_ref()),
        Some((17, Inferred))
    );
    assert_eq!(e510.on(Framing::Ascii).words_in_one_read(0x2520), 17);
    assert_eq!(e510.on(Framing::Rtu).words_in_one_read(0x25F0), 16);
}

#[test]
fn exceptions_of_both_models_are_known_on_each() {
    let (e510, e510s) = (e510(), e510s());
    let sure = |model: &Model| {
        let proven = model
            .exceptions
            .iter()
            .filter(|it| it.confidence == SecondSource);
        proven.map(|it| it.code).collect::<Vec<_>>()
    };
    assert_eq!(
        codes(&e510.exceptions),
        [0x01, 0x02, 0x03, 0x04, 0x20, 0x51, 0x52, 0x53, 0x54, 0x55]
    );
    assert_eq!(sure(&e510), [0x20, 0x51, 0x52, 0x53, 0x54, 0x55]);
    assert_eq!(
        codes(&e510s.exceptions),
        [0x01, 0x02, 0x03, 0x04, 0x51, 0x52, 0x53, 0x54, 0x55]
    );
    assert_eq!(sure(&e510s), [0x01, 0x02, 0x03, 0x04]);
    assert_eq!(
        e510.exception_text(0x52).unwrap().text,
        "register address error"
    );
    assert_eq!(
        e510s.exception_text(0x04).unwrap().text,
        "more than 32 registers"
    );
}

#[test]
fn what_they_do_differently_is_named() {
    for (model, before_run) in [(e510(), None), (e510s(), Some(((), Inferred)))] {
        let quirks = &model.quirks;
        assert_eq!(
            maybe(quirks.pause_before_request.as_ref()),
            Some((ms(20), Sibling))
        );
        assert_eq!(maybe(quirks.setpoint_before_run.as_ref()), before_run);
        assert_eq!(
            (&quirks.decimal_numbers, &quirks.percent_of_rated),
            (&None, &None)
        );
        assert_eq!(
            (&quirks.deaf_after_power_up, &quirks.deaf_after_reset),
            (&None, &None)
        );
        assert_eq!(quirks.stored_alias_bit, None);
        let rule = model.codes.as_ref().unwrap();
        assert_eq!(
            (rule.address("08-03"), rule.address("10-11")),
            (Some(0x0803), Some(0x0A0B))
        );
        assert_eq!(
            (rule.address("13-00"), rule.address("1300")),
            (Some(0x0D00), None)
        );
    }
}

#[test]
fn run_commands_are_those_of_the_sheet() {
    for (model, others, shown) in [
        (e510(), ThirdParty, SecondSource),
        (e510s(), Sibling, Sibling),
    ] {
        let [stop, forward, reverse] = [(0, others), (1, shown), (3, others)].map(Some);
        assert_eq!(
            run_words(&model),
            [stop, forward, reverse, None, Some((8, Sibling)), None]
        );
        let run = model.run.as_ref().unwrap();
        assert_eq!(
            (run.reset_words(), &run.never[..]),
            (vec![0, 8, 0], &[][..])
        );
        let RunForm::Bits { bits, priority, .. } = &run.form else {
            panic!("bits")
        };
        let first: Vec<_> = bits
            .iter()
            .take(4)
            .map(|bit| (bit.bit.value, bit.meaning, bit.bit.confidence))
            .collect();
        let expected = [
            (0, Run, others),
            (1, Reverse, others),
            (2, Trip, Sibling),
            (3, Reset, Sibling),
        ];
        assert_eq!(first, expected);
        let others: Vec<_> = bits
            .iter()
            .skip(4)
            .map(|bit| (bit.bit.value, bit.meaning))
            .collect();
        assert_eq!(others, (6..=15).map(|bit| (bit, Other)).collect::<Vec<_>>());
        assert_eq!(*priority, 0);
    }
}

#[test]
fn the_state_word_is_that_of_the_sheet() {
    for (model, sure) in [(e510(), ThirdParty), (e510s(), Inferred)] {
        let flag = |flag, bit: u16| (flag, 0x2520, 1 << bit, vec![1 << bit], sure);
        let flags = [
            flag(IndicatedState::Running, 0),
            flag(IndicatedState::Reverse, 1),
            flag(IndicatedState::Ready, 2),
            flag(IndicatedState::Tripped, 3),
        ];
        assert_eq!(status(&model), flags);
    }
}

#[test]
fn trips_are_those_of_a_sibling() {
    let of_the_l510 = [
        1, 2, 3, 4, 6, 7, 8, 9, 11, 12, 13, 14, 15, 16, 18, 19, 20, 21, 23, 24, 25, 33, 34, 40, 41,
        44, 46,
    ];
    let (e510, e510s) = (e510(), e510s());
    assert_eq!(codes(&e510s.trip_codes), of_the_l510);
    let from_the_field: Vec<_> = e510
        .trip_codes
        .iter()
        .filter(|it| it.code == 28)
        .map(|it| it.confidence)
        .collect();
    assert_eq!(from_the_field, [ThirdParty]);
    let others: Vec<_> = e510
        .trip_codes
        .iter()
        .filter(|it| it.code != 28)
        .cloned()
        .collect();
    assert_eq!(codes(&others), of_the_l510);
    assert!(
        others
            .iter()
            .chain(&e510s.trip_codes)
            .all(|it| it.confidence == Sibling)
    );
}

#[test]
fn the_drive_has_a_watchdog_and_two_sources() {
    for (model, off, sure) in [
        (e510(), SecondSource, ThirdParty),
        (e510s(), Sibling, Sibling),
    ] {
        let watchdog = model.watchdog.as_ref().unwrap();
        assert_eq!(
            (
                watchdog.time.number(),
                parts(&watchdog.off),
                watchdog.action.map(Address::number)
            ),
            (0x0906, (0, off), Some(0x0907))
        );
        assert!(
            !model.watchdog_is_proven(),
            "where 09-06 is on the line, a program alone shows"
        );
        assert_eq!(
            setup(&model),
            [
                ("00-05", Some(0x0005), &[5][..], sure),
                ("00-02", Some(0x0002), &[2][..], sure)
            ]
        );
    }
}
