//! The FR500A against its manual.

use super::*;
use crate::domain::address::Address;
use crate::domain::units::UnitOfMeasure::{
    Ampere, Celsius, Hertz, Hour, Kilowatt, KilowattHour, None as Plain, Percent, Rpm, Second, Volt,
};
use crate::profile::model::Confidence::{Default, Inferred, Manual, SecondSource};
use crate::profile::model::RegisterAccess::{Read, ReadWrite, Write};
use crate::profile::model::{FactorySetting, ReadBoundary, RefusedWrite};

fn fr500a() -> Arc<Model> {
    model("frecon-fr500a")
}

/// All of the manual's second edition but what it gives no address for.
#[rustfmt::skip]
const REGISTERS: [Row; 102] = [
    (0x0002, Some("F00.02"),    1, Plain,    ReadWrite, SecondSource), // lock of parameters
    (0x0006, Some("F00.06"),    1, Plain,    ReadWrite, SecondSource), // who edits parameters
    (0x0014, Some("F00.20"),   10, Kilowatt, Read,      SecondSource), // rated power
    (0x0015, Some("F00.21"),    1, Volt,     Read,      SecondSource), // rated voltage
    (0x0016, Some("F00.22"),   10, Ampere,   Read,      SecondSource), // rated current
    (0x0017, Some("F00.23"),  100, Plain,    Read,      SecondSource), // software version
    (0x0101, Some("F01.01"),    1, Plain,    ReadWrite, SecondSource), // master frequency
    (0x0108, Some("F01.08"),  100, Hertz,    ReadWrite, SecondSource), // maximum frequency
    (0x0109, Some("F01.09"),  100, Hertz,    ReadWrite, SecondSource), // upper limit
    (0x010A, Some("F01.10"),  100, Hertz,    ReadWrite, SecondSource), // lower limit
    (0x0200, Some("F02.00"),    1, Plain,    ReadWrite, SecondSource), // run command
    (0x020C, Some("F02.12"),    1, Plain,    ReadWrite, SecondSource), // stop mode
    (0x0300, Some("F03.00"),   10, Second,   ReadWrite, SecondSource), // acceleration time
    (0x0301, Some("F03.01"),   10, Second,   ReadWrite, SecondSource), // deceleration time
    (0x030C, Some("F03.12"),    1, Plain,    ReadWrite, SecondSource), // unit of both
    (0x0B0B, Some("F11.11"),    1, Plain,    ReadWrite, SecondSource), // reaction to loss
    (0x0B0E, Some("F11.14"),    1, Plain,    ReadWrite, SecondSource), // frequency while continuing
    (0x0B0F, Some("F11.15"),    1, Plain,    ReadWrite, SecondSource), // backup frequency
    (0x0B1B, Some("F11.27"),    1, Plain,    ReadWrite, SecondSource), // automatic resets
    (0x0D00, Some("F13.00"),    1, Plain,    ReadWrite, SecondSource), // PID setpoint source
    (0x0D02, Some("F13.02"),    1, Plain,    ReadWrite, SecondSource), // PID feedback source
    (0x0F00, Some("F15.00"),    1, Plain,    ReadWrite, SecondSource), // speed
    (0x0F01, Some("F15.01"),    1, Plain,    ReadWrite, SecondSource), // format
    (0x0F02, Some("F15.02"),    1, Plain,    ReadWrite, SecondSource), // address
    (0x0F03, Some("F15.03"),   10, Second,   ReadWrite, SecondSource), // time-out
    (0x0F04, Some("F15.04"), 1000, Second,   ReadWrite, SecondSource), // reply delay, in ms
    (0x0F05, Some("F15.05"),    1, Plain,    ReadWrite, SecondSource), // slave or master
    (0x0F06, Some("F15.06"),    1, Plain,    ReadWrite, SecondSource), // what a master sends
    (0x0F07, Some("F15.07"),    1, Plain,    ReadWrite, SecondSource), // reply on errors
    (0x0F08, Some("F15.08"),    1, Plain,    ReadWrite, SecondSource), // signs in group U
    (0x2000, None,              1, Plain,    Write,     SecondSource), // run command
    (0x2001, None,            100, Hertz,    Write,     SecondSource), // frequency setpoint
    (0x2002, None,             10, Percent,  Write,     SecondSource), // PID setpoint
    (0x2003, None,             10, Percent,  Write,     SecondSource), // PID feedback
    (0x2004, None,             10, Percent,  Write,     SecondSource), // torque setpoint
    (0x2100, None,              1, Plain,    Read,      SecondSource), // state
    (0x2101, None,              1, Plain,    Read,      SecondSource), // status bits
    (0x3000, Some("U00.00"),  100, Hertz,    Read,      SecondSource), // running frequency
    (0x3001, Some("U00.01"),  100, Hertz,    Read,      SecondSource), // set frequency
    (0x3002, Some("U00.02"),   10, Volt,     Read,      SecondSource), // output voltage
    (0x3003, Some("U00.03"),   10, Ampere,   Read,      SecondSource), // output current
    (0x3004, Some("U00.04"),   10, Kilowatt, Read,      SecondSource), // output power
    (0x3005, Some("U00.05"),    1, Rpm,      Read,      SecondSource), // motor speed
    (0x3006, Some("U00.06"),    1, Volt,     Read,      SecondSource), // bus voltage
    (0x3007, Some("U00.07"),  100, Hertz,    Read,      SecondSource), // synchronous frequency
    (0x3008, Some("U00.08"),    1, Plain,    Read,      SecondSource), // PLC step
    (0x3009, Some("U00.09"),   10, Plain,    Read,      SecondSource), // program time
    (0x300A, Some("U00.10"),    1, Plain,    Read,      SecondSource), // PID setpoint
    (0x300B, Some("U00.11"),    1, Plain,    Read,      SecondSource), // PID feedback
    (0x300C, Some("U00.12"),    1, Plain,    Read,      SecondSource), // DI5 to DI1
    (0x300D, Some("U00.13"),    1, Plain,    Read,      SecondSource), // DI7, DI6
    (0x300E, Some("U00.14"),    1, Plain,    Read,      SecondSource), // outputs
    (0x300F, Some("U00.15"),   10, Percent,  Read,      SecondSource), // AI1
    (0x3010, Some("U00.16"),   10, Percent,  Read,      SecondSource), // AI2
    (0x3011, Some("U00.17"),   10, Percent,  Read,      SecondSource), // AI3
    (0x3012, Some("U00.18"),   10, Percent,  Read,      SecondSource), // keypad potentiometer
    (0x3013, Some("U00.19"),  100, Plain,    Read,      SecondSource), // pulse in, kHz
    (0x3014, Some("U00.20"),   10, Percent,  Read,      SecondSource), // AO1
    (0x3015, Some("U00.21"),   10, Percent,  Read,      SecondSource), // AO2
    (0x3016, Some("U00.22"),  100, Plain,    Read,      SecondSource), // pulse out, kHz
    (0x3017, Some("U00.23"),   10, Celsius,  Read,      SecondSource), // inverter temperature
    (0x3018, Some("U00.24"),    1, Plain,    Read,      SecondSource), // this power-on, min
    (0x3019, Some("U00.25"),   10, Plain,    Read,      SecondSource), // this run, min
    (0x301A, Some("U00.26"),    1, Hour,     Read,      SecondSource), // total power-on
    (0x301B, Some("U00.27"),    1, Hour,     Read,      SecondSource), // total running
    (0x301C, Some("U00.28"),    1, Plain,    Read,      SecondSource), // counter
    (0x301D, Some("U00.29"),    1, Plain,    Read,      SecondSource), // length, m
    (0x301E, Some("U00.30"),    1, Plain,    Read,      SecondSource), // line speed, m/min
    (0x301F, Some("U00.31"),   10, Percent,  Read,      SecondSource), // torque
    (0x3020, Some("U00.32"),    1, Celsius,  Read,      SecondSource), // motor temperature
    (0x3021, Some("U00.33"),    1, Rpm,      Read,      SecondSource), // encoder speed
    (0x3022, Some("U00.34"),    1, Plain,    Read,      SecondSource), // encoder lines
    (0x3023, Some("U00.35"),    1, KilowattHour, Read,   SecondSource),
    (0x3024, Some("U00.36"),    1, Plain,    Read,      SecondSource), // VDI5 to VDI1
    (0x3025, Some("U00.37"),    1, Plain,    Read,      SecondSource), // VDO5 to VDO1
    (0x3026, Some("U00.38"),    1, Plain,    Read,      SecondSource), // pulse or card lines
    (0x3100, Some("U01.00"),    1, Plain,    Read,      SecondSource), // latest fault
    (0x3101, Some("U01.01"),  100, Hertz,    Read,      SecondSource),
    (0x3102, Some("U01.02"),   10, Ampere,   Read,      SecondSource),
    (0x3103, Some("U01.03"),    1, Volt,     Read,      SecondSource),
    (0x3104, Some("U01.04"),    1, Hour,     Read,      SecondSource),
    (0x3105, Some("U01.05"),    1, Plain,    Read,      SecondSource), // the one before
    (0x3106, Some("U01.06"),  100, Hertz,    Read,      SecondSource),
    (0x3107, Some("U01.07"),   10, Ampere,   Read,      SecondSource),
    (0x3108, Some("U01.08"),    1, Volt,     Read,      SecondSource),
    (0x3109, Some("U01.09"),    1, Hour,     Read,      SecondSource),
    (0x310A, Some("U01.10"),    1, Plain,    Read,      SecondSource), // the one before that
    (0x310B, Some("U01.11"),  100, Hertz,    Read,      SecondSource),
    (0x310C, Some("U01.12"),   10, Ampere,   Read,      SecondSource),
    (0x310D, Some("U01.13"),    1, Volt,     Read,      SecondSource),
    (0x310E, Some("U01.14"),    1, Hour,     Read,      SecondSource),
    (0x310F, Some("U01.15"),    1, Plain,    Read,      SecondSource), // 3rd to 13th previous
    (0x3110, Some("U01.16"),    1, Plain,    Read,      SecondSource),
    (0x3111, Some("U01.17"),    1, Plain,    Read,      SecondSource),
    (0x3112, Some("U01.18"),    1, Plain,    Read,      SecondSource),
    (0x3113, Some("U01.19"),    1, Plain,    Read,      SecondSource),
    (0x3114, Some("U01.20"),    1, Plain,    Read,      SecondSource),
    (0x3115, Some("U01.21"),    1, Plain,    Read,      SecondSource),
    (0x3116, Some("U01.22"),    1, Plain,    Read,      SecondSource),
    (0x3117, Some("U01.23"),    1, Plain,    Read,      SecondSource),
    (0x3118, Some("U01.24"),    1, Plain,    Read,      SecondSource),
    (0x3119, Some("U01.25"),    1, Plain,    Read,      SecondSource),
];

#[test]
fn registers_are_those_of_the_manual() {
    let model = fr500a();
    assert_registers(&model, &REGISTERS);
    // The sign of the speeds 3005H and 3021H and of the torque 301FH is not stated.
    assert_eq!(
        signed(&model),
        [0x2004, 0x3004, 0x3005, 0x3011, 0x3017, 0x301F, 0x3021]
    );
    assert_eq!(
        back_doors(&model),
        [0x0108, 0x0109, 0x010A, 0x2002, 0x2003, 0x2004]
    );
    let ram = addresses(&model, |it| {
        it.access == ReadWrite || [0x2000, 0x2001].contains(&it.address.number())
    });
    assert_eq!(in_memory(&model, RegisterMemory::Ram), ram);
    assert_eq!(in_memory(&model, RegisterMemory::Stored), NOTHING);
    assert_eq!(
        ranges(&model),
        [
            (0x0108, 2000..=60_000),
            (0x0F02, 1..=247),
            (0x0F03, 0..=600),
            (0x0F04, 0..=200),
            (0x2002, 0..=1000),
            (0x2003, 0..=1000),
            (0x2004, -3000..=3000)
        ]
    );
    assert_eq!(
        meanings(&model, 0x0F01),
        [(0, "8N2"), (1, "8E1"), (2, "8O1"), (3, "8N1")]
    );
    assert_eq!(meanings(&model, 0x020C), [(0, "ramp"), (1, "coast")]);
    assert_eq!(meanings(&model, 0x0F00).len(), 6);
}

#[test]
fn registers_have_their_uses() {
    let model = fr500a();
    let history = [0x3105, 0x310A]
        .into_iter()
        .chain(0x310F..=0x3119)
        .map(|address| (RegisterRole::TripHistory, address));
    let single = [
        (RegisterRole::FrequencySource, 0x0101),
        (RegisterRole::RunSource, 0x0200),
        (RegisterRole::AccelerationTime, 0x0300),
        (RegisterRole::DecelerationTime, 0x0301),
        (RegisterRole::RunCommand, 0x2000),
        (RegisterRole::FrequencyCommand, 0x2001),
        (RegisterRole::OutputFrequency, 0x3000),
        (RegisterRole::FrequencySetting, 0x3001),
        (RegisterRole::OutputVoltage, 0x3002),
        (RegisterRole::OutputCurrent, 0x3003),
        (RegisterRole::OutputPower, 0x3004),
        (RegisterRole::DcLinkVoltage, 0x3006),
        (RegisterRole::Temperature, 0x3017),
        (RegisterRole::RunHours, 0x301B),
        (RegisterRole::Energy, 0x3023),
        (RegisterRole::Torque, 0x301F),
        (RegisterRole::TripCause, 0x3100),
        (RegisterRole::TripFrequency, 0x3101),
        (RegisterRole::TripCurrent, 0x3102),
        (RegisterRole::TripDcLinkVoltage, 0x3103),
    ];
    assert_roles(
        &model,
        &single.into_iter().chain(history).collect::<Vec<_>>(),
    );
    let fast: Vec<u16> = [0x2100, 0x2101]
        .into_iter()
        .chain(0x3000..=0x3007)
        .collect();
    assert_eq!(polled(&model, PollClass::Fast), fast);
    assert_eq!(polled(&model, PollClass::Second), NOTHING);
    assert_eq!(
        polled(&model, PollClass::Slow),
        [0x0101, 0x0200, 0x3017, 0x301B, 0x301F]
    );
    assert_eq!(
        polled(&model, PollClass::Hourly),
        [0x0014, 0x0015, 0x0016, 0x0017]
    );
    assert_eq!(
        polled(&model, PollClass::Minutely),
        [0x0B0B, 0x0F03, 0x3023],
        "its watchdog, and energy"
    );
}

#[test]
fn the_link_is_that_of_the_manual() {
    let model = fr500a();
    let link = &model.link;
    // The appendix says 8N1; the table of parameters, which the drive follows, 8N2.
    assert_eq!(
        parts(&link.default),
        (
            FactorySetting::Set(LinkSettings {
                stop_bits: 2,
                ..LinkSettings::DEFAULT
            }),
            SecondSource
        )
    );
    assert!(link.default.source.contains("8N1"));
    assert_eq!(
        parts(&link.bauds),
        (
            vec![4800, 9600, 19_200, 38_400, 57_600, 115_200],
            SecondSource
        )
    );
    assert_eq!(
        parts(&link.parities),
        (vec![Parity::None, Parity::Even, Parity::Odd], SecondSource)
    );
    assert_eq!(parts(&link.stop_bits), (vec![1, 2], SecondSource));
    assert_eq!(parts(&link.data_bits), (vec![8], SecondSource));
    assert_eq!(parts(&link.framings), (vec![Framing::Rtu], SecondSource));
    assert_eq!(
        parts(&link.interfaces),
        (vec![Interface::Rs485], SecondSource)
    );
    assert_eq!(parts(&link.stations), (1..=127, Manual));
    let broadcast = link.broadcast.as_ref().unwrap();
    assert_eq!(
        (parts(&broadcast.station), &broadcast.functions[..]),
        ((0, SecondSource), &[0x06][..])
    );
}

#[test]
fn times_and_limits_are_those_of_the_manual() {
    let model = fr500a();
    assert_eq!(parts(&model.timing.gap_chars), (3.5, Inferred));
    assert_eq!(parts(&model.timing.reply_timeout_cap), (ms(500), Default));
    assert_eq!(parts(&model.timing.max_lateness), (ms(500), Default));
    assert_eq!(
        maybe(model.timing.reply_delay_max.as_ref()),
        Some((ms(200), SecondSource))
    );
    assert_eq!(
        (&model.timing.processing_max, &model.timing.stored_write_max),
        (&None, &None)
    );
    assert_eq!(model.timing.reply_char_bits, None);
    assert_eq!(parts(&model.functions), (vec![3, 6, 8], SecondSource));
    assert_eq!(
        (parts(&model.read.max_words), model.read.boundary),
        ((8, SecondSource), Some(ReadBoundary::HighByte))
    );
    assert_eq!(
        parts(&model.write.refused),
        (RefusedWrite::Exception, SecondSource)
    );
    assert_eq!(model.write.block, None);
    let [reads @ .., Barrier::Loop(loop_test)] = &model.barriers[..] else {
        panic!("{:?}", model.barriers)
    };
    assert_eq!(
        reads,
        [
            barrier_read(0x3000, 3),
            barrier_read(0x3000, 5),
            barrier_read(0x3000, 1)
        ]
    );
    assert_eq!(loop_test.confidence, Inferred);
    assert_eq!(codes(&model.exceptions), [1, 2, 3, 4, 0x11]);
    assert!(
        model
            .exceptions
            .iter()
            .all(|it| it.confidence == SecondSource)
    );
    let quirks = &model.quirks;
    assert_eq!(
        maybe(quirks.stored_alias_bit.as_ref()),
        Some((15, SecondSource))
    );
    assert_eq!(
        (&quirks.decimal_numbers, &quirks.percent_of_rated),
        (&None, &None)
    );
    assert_eq!(
        (&quirks.setpoint_before_run, &quirks.pause_before_request),
        (&None, &None)
    );
    assert_eq!(
        (&quirks.deaf_after_power_up, &quirks.deaf_after_reset),
        (&None, &None)
    );
}

#[test]
fn run_commands_are_those_of_the_manual() {
    let model = fr500a();
    let [stop, forward, reverse, coast, reset] =
        [5, 1, 2, 6, 7].map(|word| Some((word, SecondSource)));
    assert_eq!(
        run_words(&model),
        [stop, forward, reverse, coast, reset, None]
    );
    let run = model.run.as_ref().unwrap();
    assert_eq!(
        (&run.form, run.reset_words()),
        (&RunForm::Values, vec![5, 7])
    );
    assert_eq!(
        run.never.iter().map(parts).collect::<Vec<_>>(),
        [(3, SecondSource), (4, SecondSource)]
    );
}

#[test]
fn the_state_is_that_of_the_manual() {
    let model = fr500a();
    assert_eq!(
        status(&model),
        [
            (
                IndicatedState::Running,
                0x2100,
                0xFFFF,
                vec![1, 2, 3],
                SecondSource
            ),
            (
                IndicatedState::Stopping,
                0x2100,
                0xFFFF,
                vec![4, 5],
                SecondSource
            ),
            (
                IndicatedState::Tripped,
                0x2100,
                0xFFFF,
                vec![6],
                SecondSource
            ),
            (
                IndicatedState::Reverse,
                0x2101,
                0x0002,
                vec![0x0002],
                SecondSource
            ),
            (
                IndicatedState::BusRun,
                0x2101,
                0x000C,
                vec![0x0008],
                SecondSource
            ),
            (
                IndicatedState::BusFrequency,
                0x0101,
                0xFFFF,
                vec![3],
                SecondSource
            )
        ]
    );
    // Running forward, the sign of the reference negative, run command from the terminals.
    let holds = |flag, word| model.status_flag(flag).unwrap().holds(word);
    assert!(
        !holds(IndicatedState::Reverse, 0b0101)
            && !holds(IndicatedState::BusRun, 0b0101)
            && holds(IndicatedState::BusRun, 0b1010)
    );
}

#[test]
fn trips_setup_and_codes_are_those_of_the_manual() {
    let model = fr500a();
    let listed: Vec<u16> = (1..=30).chain(36..=41).chain([44]).collect();
    assert_eq!(codes(&model.trip_codes), listed);
    assert!(
        model
            .trip_codes
            .iter()
            .all(|it| it.confidence == SecondSource)
    );
    assert_eq!(model.trip_text(18).unwrap().text, "communication time-out");
    assert_eq!(
        setup(&model),
        [
            ("F00.06", Some(0x0006), &[0, 2][..], SecondSource),
            ("F01.01", Some(0x0101), &[3][..], SecondSource),
            ("F02.00", Some(0x0200), &[2][..], SecondSource)
        ]
    );
    let watchdog = model.watchdog.as_ref().unwrap();
    assert_eq!(
        (
            watchdog.time.number(),
            parts(&watchdog.off),
            watchdog.action.map(Address::number)
        ),
        (0x0F03, (0, Inferred), Some(0x0B0B))
    );
    let rule = model.codes.as_ref().unwrap();
    assert_eq!(
        (rule.address("F01.02"), rule.address("F22.99")),
        (Some(0x0102), Some(0x1663))
    );
    assert_eq!(
        (rule.address("F31.00"), rule.address("U01.25")),
        (Some(0x1F00), Some(0x3119))
    );
    assert_eq!(rule.address("F23.00"), None);
}
