//! The VF-AS1 and the VF-S15 against their manuals and what is known of their siblings.

use super::*;
use crate::domain::units::UnitOfMeasure::{Hertz, None as Plain, Percent, Rpm, Second};
use crate::profile::model::BitMeaning::{
    BusFrequency, BusRun, Coast, Jog, Other, Reset, Reverse, Run, Trip,
};
use crate::profile::model::Confidence::{Default, Inferred, Manual, Sibling, ThirdParty};
use crate::profile::model::RegisterAccess::{Read, ReadWrite, Write};
use crate::profile::model::{BitMeaning, CodeRule, FactorySetting, RefusedWrite};

fn as1() -> Arc<Model> {
    model("toshiba-vf-as1")
}

fn s15() -> Arc<Model> {
    model("toshiba-vf-s15")
}

#[rustfmt::skip]
const AS1: [Row; 60] = [
    (0x0003, Some("0003"),   1, Plain,   ReadWrite, Inferred), // CMOD
    (0x0004, Some("0004"),   1, Plain,   ReadWrite, Inferred), // FMOD
    (0x0009, Some("0009"),  10, Second,  ReadWrite, Inferred), // ACC
    (0x0010, Some("0010"),  10, Second,  ReadWrite, Manual),   // DEC
    (0x0011, Some("0011"), 100, Hertz,   ReadWrite, Inferred), // FH
    (0x0012, Some("0012"), 100, Hertz,   ReadWrite, Sibling),  // UL
    (0x0013, Some("0013"), 100, Hertz,   ReadWrite, Inferred), // LL
    (0xF800, Some("F800"),   1, Plain,   Read,      Inferred), // speed
    (0xF801, Some("F801"),   1, Plain,   Read,      Inferred), // parity
    (0xF802, Some("F802"),   1, Plain,   Read,      Inferred), // inverter number
    (0xF803, Some("F803"),   1, Plain,   Read,      Manual),   // time-out
    (0xF804, Some("F804"),   1, Plain,   Read,      Manual),   // action on time-out
    (0xF805, Some("F805"),   1, Plain,   Read,      Inferred), // send waiting time
    (0xF807, Some("F807"),   1, Plain,   Read,      Inferred), // protocol
    (0xF820, Some("F820"),   1, Plain,   Read,      Inferred), // second port: speed
    (0xF825, Some("F825"),   1, Plain,   Read,      Inferred), // second port: send waiting time
    (0xF829, Some("F829"),   1, Plain,   Read,      Inferred), // second port: protocol
    (0xFA00, Some("FA00"),   1, Plain,   ReadWrite, Manual),   // command 1
    (0xFA01, Some("FA01"), 100, Hertz,   ReadWrite, Manual),   // frequency command
    (0xFA13, Some("FA13"),   1, Rpm,     ReadWrite, Sibling),  // speed command
    (0xFA20, Some("FA20"),   1, Plain,   ReadWrite, Sibling),  // command 2
    (0xFA26, Some("FA26"),   1, Plain,   ReadWrite, Sibling),  // command 3
    (0xFA50, Some("FA50"),   1, Plain,   ReadWrite, Sibling),  // terminal output
    (0xFA51, Some("FA51"),   1, Plain,   ReadWrite, Sibling),  // analog output
    (0xFB05, Some("FB05"),   1, Plain,   Read,      Sibling),  // model code
    (0xFC90, Some("FC90"),   1, Plain,   Read,      Manual),   // trip code
    (0xFC91, Some("FC91"),   1, Plain,   Read,      Sibling),  // alarms
    (0xFD00, Some("FD00"), 100, Hertz,   Read,      Sibling),  // output frequency
    (0xFD01, Some("FD01"),   1, Plain,   Read,      Sibling),  // status 1
    (0xFD02, Some("FD02"), 100, Hertz,   Read,      Inferred), // frequency command
    (0xFD03, Some("FD03"), 100, Percent, Read,      Sibling),  // output current
    (0xFD04, Some("FD04"), 100, Percent, Read,      Inferred), // DC bus
    (0xFD05, Some("FD05"), 100, Percent, Read,      Sibling),  // output voltage
    (0xFD06, Some("FD06"),   1, Plain,   Read,      Inferred), // terminals
    (0xFD07, Some("FD07"),   1, Plain,   Read,      Inferred),
    (0xFD42, Some("FD42"),   1, Plain,   Read,      Sibling),  // status 3
    (0xFD49, Some("FD49"),   1, Plain,   Read,      Sibling),  // status 4
    (0xFE00, Some("FE00"), 100, Hertz,   Read,      Sibling),  // the same at the last trip
    (0xFE01, Some("FE01"),   1, Plain,   Read,      Sibling),
    (0xFE02, Some("FE02"), 100, Hertz,   Read,      Inferred),
    (0xFE03, Some("FE03"), 100, Percent, Read,      Sibling),
    (0xFE04, Some("FE04"), 100, Percent, Read,      Inferred),
    (0xFE05, Some("FE05"), 100, Percent, Read,      Sibling),
    (0xFE06, Some("FE06"),   1, Plain,   Read,      Inferred),
    (0xFE07, Some("FE07"),   1, Plain,   Read,      Inferred),
    (0xFE08, Some("FE08"),   1, Plain,   Read,      Sibling),  // CPU 1 version
    (0xFE09, Some("FE09"),   1, Plain,   Read,      Sibling),  // EEPROM version
    (0xFE10, Some("FE10"),   1, Plain,   Read,      Sibling),  // past trips
    (0xFE11, Some("FE11"),   1, Plain,   Read,      Sibling),
    (0xFE12, Some("FE12"),   1, Plain,   Read,      Sibling),
    (0xFE13, Some("FE13"),   1, Plain,   Read,      Sibling),
    (0xFE14, Some("FE14"),   1, Plain,   Read,      Inferred), // cumulative run time
    (0xFE16, Some("FE16"), 100, Hertz,   Read,      Sibling),  // estimated output frequency
    (0xFE27, Some("FE27"),   1, Plain,   Read,      Sibling),  // load factor
    (0xFE45, Some("FE45"),   1, Plain,   Read,      Sibling),  // active sources
    (0xFE46, Some("FE46"),   1, Plain,   Read,      Sibling),
    (0xFE70, Some("FE70"),   1, Plain,   Read,      Sibling),  // rated current, scale in conflict
    (0xFE71, Some("FE71"),   1, Plain,   Read,      Sibling),  // rated voltage, scale in conflict
    (0xFE73, Some("FE73"),   1, Plain,   Read,      Sibling),  // CPU 2 version
    (0xFE79, Some("FE79"),   1, Plain,   Read,      Sibling),  // cumulative alarms
];

#[rustfmt::skip]
const S15: [Row; 66] = [
    (0x0003, Some("0003"),   1, Plain,   ReadWrite, Inferred),
    (0x0004, Some("0004"),   1, Plain,   ReadWrite, Inferred),
    (0x0009, Some("0009"),  10, Second,  ReadWrite, Inferred),
    (0x0010, Some("0010"),  10, Second,  ReadWrite, Sibling),
    (0x0011, Some("0011"), 100, Hertz,   ReadWrite, Inferred),
    (0x0012, Some("0012"), 100, Hertz,   ReadWrite, Sibling),
    (0x0013, Some("0013"), 100, Hertz,   ReadWrite, Inferred),
    (0x1870, Some("1870"),   1, Plain,   Write,     Manual),     // indirect block
    (0x1871, Some("1871"),   1, Plain,   Write,     Manual),
    (0xF800, Some("F800"),   1, Plain,   Read,      Inferred),
    (0xF801, Some("F801"),   1, Plain,   Read,      Inferred),
    (0xF802, Some("F802"),   1, Plain,   Read,      Manual),
    (0xF803, Some("F803"),   1, Plain,   Read,      Sibling),
    (0xF804, Some("F804"),   1, Plain,   Read,      Sibling),
    (0xF805, Some("F805"),   1, Plain,   Read,      Inferred),
    (0xF829, Some("F829"),   1, Plain,   ReadWrite, Manual),
    (0xF870, Some("F870"),   1, Plain,   ReadWrite, Manual),     // selectors of the indirect blocks
    (0xF871, Some("F871"),   1, Plain,   ReadWrite, Manual),
    (0xF875, Some("F875"),   1, Plain,   ReadWrite, Manual),
    (0xF876, Some("F876"),   1, Plain,   ReadWrite, Manual),
    (0xF877, Some("F877"),   1, Plain,   ReadWrite, Manual),
    (0xF878, Some("F878"),   1, Plain,   ReadWrite, Manual),
    (0xF879, Some("F879"),   1, Plain,   ReadWrite, Manual),
    (0xFA00, Some("FA00"),   1, Plain,   ReadWrite, Manual),
    (0xFA01, Some("FA01"), 100, Hertz,   ReadWrite, Manual),
    (0xFA13, Some("FA13"),   1, Rpm,     ReadWrite, ThirdParty),
    (0xFA20, Some("FA20"),   1, Plain,   ReadWrite, Sibling),
    (0xFA26, Some("FA26"),   1, Plain,   ReadWrite, Sibling),
    (0xFA50, Some("FA50"),   1, Plain,   ReadWrite, Sibling),
    (0xFA51, Some("FA51"),   1, Plain,   ReadWrite, Sibling),
    (0xFB05, Some("FB05"),   1, Plain,   Read,      Sibling),
    (0xFC90, Some("FC90"),   1, Plain,   Read,      Sibling),
    (0xFC91, Some("FC91"),   1, Plain,   Read,      Sibling),
    (0xFD00, Some("FD00"), 100, Hertz,   Read,      Manual),
    (0xFD01, Some("FD01"),   1, Plain,   Read,      Sibling),
    (0xFD02, Some("FD02"), 100, Hertz,   Read,      Inferred),
    (0xFD03, Some("FD03"), 100, Percent, Read,      ThirdParty),
    (0xFD04, Some("FD04"), 100, Percent, Read,      Inferred),
    (0xFD05, Some("FD05"), 100, Percent, Read,      ThirdParty),
    (0xFD06, Some("FD06"),   1, Plain,   Read,      Inferred),
    (0xFD07, Some("FD07"),   1, Plain,   Read,      Inferred),
    (0xFD42, Some("FD42"),   1, Plain,   Read,      Sibling),
    (0xFD49, Some("FD49"),   1, Plain,   Read,      Sibling),
    (0xFE00, Some("FE00"), 100, Hertz,   Read,      ThirdParty),
    (0xFE01, Some("FE01"),   1, Plain,   Read,      Sibling),
    (0xFE02, Some("FE02"), 100, Hertz,   Read,      Inferred),
    (0xFE03, Some("FE03"), 100, Percent, Read,      ThirdParty),
    (0xFE04, Some("FE04"), 100, Percent, Read,      Inferred),
    (0xFE05, Some("FE05"), 100, Percent, Read,      ThirdParty),
    (0xFE06, Some("FE06"),   1, Plain,   Read,      Inferred),
    (0xFE07, Some("FE07"),   1, Plain,   Read,      Inferred),
    (0xFE08, Some("FE08"),   1, Plain,   Read,      Sibling),
    (0xFE09, Some("FE09"),   1, Plain,   Read,      Sibling),
    (0xFE10, Some("FE10"),   1, Plain,   Read,      Sibling),
    (0xFE11, Some("FE11"),   1, Plain,   Read,      Sibling),
    (0xFE12, Some("FE12"),   1, Plain,   Read,      Sibling),
    (0xFE13, Some("FE13"),   1, Plain,   Read,      Sibling),
    (0xFE14, Some("FE14"),   1, Plain,   Read,      Inferred),
    (0xFE16, Some("FE16"), 100, Hertz,   Read,      Sibling),
    (0xFE27, Some("FE27"),   1, Plain,   Read,      Sibling),
    (0xFE45, Some("FE45"),   1, Plain,   Read,      Sibling),
    (0xFE46, Some("FE46"),   1, Plain,   Read,      Sibling),
    (0xFE70, Some("FE70"),   1, Plain,   Read,      Sibling),
    (0xFE71, Some("FE71"),   1, Plain,   Read,      Sibling),
    (0xFE73, Some("FE73"),   1, Plain,   Read,      Sibling),
    (0xFE79, Some("FE79"),   1, Plain,   Read,      Sibling),
];

#[test]
fn registers_are_those_of_the_sheet() {
    assert_registers(&as1(), &AS1);
    assert_registers(&s15(), &S15);
    for model in [as1(), s15()] {
        assert_eq!(signed(&model), NOTHING);
        assert_eq!(ranges(&model), [(0xF802, 0..=247)]);
        assert_eq!(
            in_memory(&model, RegisterMemory::Ram),
            [0xFA00, 0xFA01, 0xFA13, 0xFA20, 0xFA26, 0xFA50, 0xFA51]
        );
        assert_eq!(
            in_memory(&model, RegisterMemory::Stored),
            [0x0009, 0x0010, 0x0011, 0x0012, 0x0013]
        );
    }
    let limits = [0x0011, 0x0012, 0x0013];
    let commands = [0xFA13, 0xFA20, 0xFA26, 0xFA50, 0xFA51];
    assert_eq!(back_doors(&as1()), [&limits[..], &commands].concat());
    assert_eq!(
        back_doors(&s15()),
        [&limits[..], &[0x1870, 0x1871, 0xF870, 0xF871], &commands].concat()
    );
    let selects = [
        (0, "none"),
        (1, "FA00, run command"),
        (3, "FA01, frequency command"),
    ];
    assert_eq!(meanings(&s15(), 0xF870), selects);
}

#[test]
fn registers_have_their_uses() {
    for model in [as1(), s15()] {
        assert_roles(
            &model,
            &[
                (RegisterRole::RunCommand, 0xFA00),
                (RegisterRole::FrequencyCommand, 0xFA01),
                (RegisterRole::RunSource, 0x0003),
                (RegisterRole::FrequencySource, 0x0004),
                (RegisterRole::AccelerationTime, 0x0009),
                (RegisterRole::DecelerationTime, 0x0010),
                (RegisterRole::TripCode, 0xFC90),
                (RegisterRole::OutputFrequency, 0xFD00),
                (RegisterRole::OutputCurrent, 0xFD03),
                (RegisterRole::DcLinkVoltage, 0xFD04),
                (RegisterRole::OutputVoltage, 0xFD05),
                (RegisterRole::TripFrequency, 0xFE00),
                (RegisterRole::TripCurrent, 0xFE03),
                (RegisterRole::TripDcLinkVoltage, 0xFE04),
                (RegisterRole::TripHistory, 0xFE10),
                (RegisterRole::TripHistory, 0xFE11),
                (RegisterRole::TripHistory, 0xFE12),
                (RegisterRole::TripHistory, 0xFE13),
            ],
        );
        // The command can be read back, so it is the setting as well.
        assert_eq!(model.setting_register().unwrap().address, 0xFA01);
        assert_eq!(polled(&model, PollClass::Fast), [0xFD00, 0xFD01]);
        assert_eq!(
            polled(&model, PollClass::Slow),
            [0xFC90, 0xFD03, 0xFD04, 0xFD05]
        );
        assert_eq!(
            polled(&model, PollClass::Hourly),
            [0xFB05, 0xFE14, 0xFE70, 0xFE71]
        );
    }
}

#[test]
fn the_link_is_that_of_the_manuals() {
    let even = LinkSettings {
        baud: 19_200,
        data_bits: 8,
        parity: Parity::Even,
        stop_bits: 1,
    };
    for (model, of_the_s15) in [(as1(), Sibling), (s15(), Manual)] {
        let link = &model.link;
        assert_eq!(parts(&link.default), (FactorySetting::Set(even), Manual));
        assert_eq!(parts(&link.bauds), (vec![9600, 19_200, 38_400], Manual));
        assert_eq!(
            parts(&link.parities),
            (vec![Parity::Even, Parity::Odd, Parity::None], Manual)
        );
        assert_eq!(parts(&link.stop_bits), (vec![1, 2], Manual));
        assert_eq!(parts(&link.data_bits), (vec![8], Manual));
        assert_eq!(parts(&link.framings), (vec![Framing::Rtu], Manual));
        assert_eq!(parts(&link.interfaces), (vec![Interface::Rs485], Manual));
        assert_eq!(parts(&link.stations), (1..=247, of_the_s15));
        let broadcast = link.broadcast.as_ref().unwrap();
        assert_eq!(
            (parts(&broadcast.station), &broadcast.functions[..]),
            ((0, of_the_s15), &[0x06][..])
        );
    }
}

#[test]
fn times_and_limits_are_those_of_the_manuals() {
    for model in [as1(), s15()] {
        assert_eq!(parts(&model.timing.gap_chars), (3.5, Manual));
        assert_eq!(parts(&model.timing.reply_timeout_cap), (ms(500), Default));
        assert_eq!(parts(&model.timing.max_lateness), (ms(500), Default));
        assert_eq!(
            maybe(model.timing.reply_char_bits.as_ref()),
            Some((12, Manual))
        );
        assert_eq!(model.timing.reply_delay_max, None);
        assert_eq!(
            (model.read.boundary, &model.read.max_words_ascii),
            (None, &None)
        );
        assert_eq!(
            parts(&model.write.refused),
            (RefusedWrite::Exception, Manual)
        );
        assert_eq!(model.write.block, None);
        let [Barrier::Refused(function)] = &model.barriers[..] else {
            panic!("{:?}", model.barriers)
        };
        assert_eq!(parts(function), (0x08, Inferred));
        assert_eq!(codes(&model.exceptions), [1, 2, 3, 4]);
        assert!(model.exceptions.iter().all(|it| it.confidence == Manual));
    }
    let (as1, s15) = (as1(), s15());
    assert_eq!(
        maybe(as1.timing.processing_max.as_ref()),
        Some((ms(8), Manual))
    );
    assert_eq!(
        maybe(s15.timing.processing_max.as_ref()),
        Some((ms(10), Manual))
    );
    assert_eq!(as1.timing.stored_write_max, None);
    assert_eq!(
        maybe(s15.timing.stored_write_max.as_ref()),
        Some((ms(50), Manual))
    );
    assert_eq!(
        (parts(&as1.functions), parts(&as1.read.max_words)),
        ((vec![3, 6], Manual), (1, Inferred))
    );
    assert_eq!(
        parts(&s15.functions),
        (vec![0x03, 0x06, 0x10, 0x17, 0x2B], Manual)
    );
    assert_eq!(parts(&s15.read.max_words), (1, Manual));
}

#[test]
fn what_they_do_differently_is_named() {
    for (model, c16, power_up) in [(as1(), Sibling, ms(2000)), (s15(), ThirdParty, ms(1000))] {
        let quirks = &model.quirks;
        assert_eq!(maybe(quirks.decimal_numbers.as_ref()), Some(((), c16)));
        assert_eq!(maybe(quirks.percent_of_rated.as_ref()), Some(((), c16)));
        assert_eq!(
            maybe(quirks.deaf_after_power_up.as_ref()),
            Some((power_up, Manual))
        );
        assert_eq!(
            maybe(quirks.deaf_after_reset.as_ref()),
            Some((ms(2000), Sibling))
        );
        assert_eq!(
            (&quirks.setpoint_before_run, &quirks.stored_alias_bit),
            (&None, &None)
        );
        assert_eq!(quirks.pause_before_request, None);
        assert_eq!(model.next_address(0xFE09_u16.into()), 0xFE10);
        assert!(
            matches!(&model.codes, Some(CodeRule::Hexadecimal(origin)) if origin.confidence == Manual)
        );
        assert_eq!(model.watchdog, None);
    }
}

const NOTHING_PROVEN: [u8; 0] = [];

#[test]
fn run_commands_are_those_of_the_sheet() {
    let proven = |word| Some((word, Manual));
    let inferred = |word| Some((word, Inferred));
    let third = |word| Some((word, ThirdParty));
    assert_eq!(
        run_words(&as1()),
        [
            Some((0xC000, Sibling)),
            proven(0xC400),
            inferred(0xC600),
            inferred(0xC800),
            inferred(0xE000),
            Some((0x0000, Sibling))
        ]
    );
    assert_eq!(
        run_words(&s15()),
        [
            third(0xC000),
            proven(0xC400),
            third(0xC600),
            Some((0xC800, Sibling)),
            third(0xE000),
            third(0x0000)
        ]
    );
    let meanings: [BitMeaning; 16] = [
        Other,
        Other,
        Other,
        Other,
        Other,
        Other,
        Other,
        Other,
        Jog,
        Reverse,
        Run,
        Coast,
        Trip,
        Reset,
        BusFrequency,
        BusRun,
    ];
    for model in [as1(), s15()] {
        let run = model.run.as_ref().unwrap();
        let RunForm::Bits { bits, priority, .. } = &run.form else {
            panic!("bits")
        };
        let found: Vec<_> = bits
            .iter()
            .map(|bit| (bit.bit.value, bit.meaning))
            .collect();
        assert_eq!(found, (0..).zip(meanings).collect::<Vec<_>>());
        assert_eq!(*priority, 0xC000);
        assert_eq!(run.reset_words(), [0xC000, 0xE000, 0xC000]);
        let proven: Vec<_> = bits
            .iter()
            .filter(|bit| bit.bit.confidence.is_proven())
            .map(|bit| bit.bit.value)
            .collect();
        assert_eq!(
            proven, NOTHING_PROVEN,
            "the manual shows the sum of three bits alone"
        );
    }
}

#[test]
fn the_status_word_is_that_of_the_sheet() {
    let flag = |flag, bit: u16| (flag, 0xFD01, 1 << bit, vec![1 << bit], Sibling);
    for model in [as1(), s15()] {
        assert_eq!(
            status(&model),
            [
                flag(IndicatedState::Running, 10),
                flag(IndicatedState::Reverse, 9),
                flag(IndicatedState::Tripped, 1),
                flag(IndicatedState::Alarm, 2),
                flag(IndicatedState::Ready, 14)
            ]
        );
        let shows = |word| {
            model
                .status
                .iter()
                .filter(|it| it.holds(word))
                .map(|it| it.flag)
                .collect::<Vec<_>>()
        };
        // The VF-AS1's example of a run, and the VF-S15's of one with an alarm.
        assert_eq!(
            shows(0x6400),
            [IndicatedState::Running, IndicatedState::Ready]
        );
        assert_eq!(
            shows(0xE404),
            [
                IndicatedState::Running,
                IndicatedState::Alarm,
                IndicatedState::Ready
            ]
        );
    }
}

#[test]
fn trips_are_hints_and_setup_names_the_protocol() {
    let (as1, s15) = (as1(), s15());
    let listed: Vec<u16> = (1..=24).chain([26, 29, 30, 32, 34]).collect();
    assert_eq!(codes(&as1.trip_codes), listed);
    let without_phases: Vec<u16> = listed
        .into_iter()
        .filter(|code| ![6, 7].contains(code))
        .collect();
    assert_eq!(codes(&s15.trip_codes), without_phases);
    for trip in as1.trip_codes.iter().chain(&s15.trip_codes) {
        assert_eq!(trip.confidence, Inferred, "{}", trip.text);
    }
    assert_eq!(
        as1.trip_text(24).unwrap().text,
        "Err5: communication time-out"
    );
    assert_eq!(
        setup(&as1),
        [
            ("F807, F829", None, &[][..], Inferred),
            ("power", None, &[][..], Manual)
        ]
    );
    assert_eq!(
        setup(&s15),
        [
            ("F829", Some(0xF829), &[1][..], Manual),
            ("power", None, &[][..], Manual)
        ]
    );
}
