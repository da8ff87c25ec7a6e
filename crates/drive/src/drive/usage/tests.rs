//! What is summed up, and what is not: gaps, energy that is fed back, counters that fall or jump.

use super::*;
use crate::domain::address::Address;
use crate::domain::time::MonoTime;
use crate::drive::plan::PollPace;
use crate::drive::snapshot::DriveSnapshot;
use crate::profile::model::PollClass;
use crate::vendors::testing::{model, with_status};

const POLL: Duration = Duration::from_secs(1);

fn seconds(seconds: u64) -> MonoTime {
    MonoTime::from_millis(seconds * 1000)
}

fn pace() -> PollPace {
    PollPace::new(POLL, 1.0)
}

/// A model with a register of this role at 0x3000, polled slowly: every 4 s.
fn with(role: RegisterRole, unit: UnitOfMeasure, scale: u32) -> Model {
    let mut model = model();
    model.registers.retain(|it| {
        !matches!(
            it.role,
            Some(RegisterRole::OutputPower | RegisterRole::Energy)
        )
    });
    let other = model
        .register_for(RegisterRole::OutputFrequency)
        .cloned()
        .unwrap();
    let address = Address::from(0x3000_u16);
    let poll = Some(PollClass::Slow);
    model.registers.push(Register {
        address,
        role: Some(role),
        unit,
        scale,
        poll,
        ..other
    });
    model.registers.sort_by_key(|register| register.address);
    model
}

/// The energy in millijoules after these readings, each a second and a word; what an earlier process has kept before.
fn energy_after(model: &Model, kept: KeptUsage, readings: &[(u64, u16)]) -> u64 {
    let mut meter = UsageMeter::new(model, pace());
    meter.remember(kept);
    let mut snapshot = DriveSnapshot::default();
    for (second, word) in readings {
        snapshot.take(Address::from(0x3000_u16), &[*word], seconds(*second));
        meter.take_readings(&snapshot);
        // Other registers are read in between, and change nothing.
        meter.take_readings(&snapshot);
    }
    meter.totals().energy_mj - kept.totals.energy_mj
}

#[test]
fn power_is_summed_up_between_readings_that_follow_each_other() {
    let power = with(RegisterRole::OutputPower, UnitOfMeasure::Kilowatt, 10);
    const KWS: u64 = 1_000_000;
    let of_power = |readings: &[(u64, u16)]| energy_after(&power, KeptUsage::default(), readings);
    for (readings, kilowatt_seconds, why) in [
        (&[(0, 10)][..], 0, "one reading has no duration"),
        (&[(0, 10), (4, 10)], 4, "1 kW for 4 s"),
        (&[(0, 10), (4, 30)], 8, "it rose from 1 to 3 kW"),
        (&[(0, 10), (12, 10)], 12, "three periods"),
        (&[(0, 10), (13, 10)], 0, "a reading is missing"),
        (&[(0, 10), (13, 10), (17, 10)], 4, "it goes on after a gap"),
        (&[(0, 0), (4, 0)], 0, "at rest"),
    ] {
        assert_eq!(of_power(readings), kilowatt_seconds * KWS, "{why}");
    }
}

#[test]
fn energy_that_is_fed_back_is_not_subtracted() {
    let mut power = with(RegisterRole::OutputPower, UnitOfMeasure::Kilowatt, 10);
    power
        .registers
        .iter_mut()
        .filter(|it| it.role == Some(RegisterRole::OutputPower))
        .for_each(|it| it.signed = true);
    let fed_back = (-20_i16).cast_unsigned();
    assert_eq!(
        energy_after(
            &power,
            KeptUsage::default(),
            &[(0, 10), (4, 10), (8, fed_back), (12, fed_back)]
        ),
        6_000_000
    );
}

#[test]
fn nothing_is_measured_over_a_time_in_which_the_drive_was_offline() {
    let power = with(RegisterRole::OutputPower, UnitOfMeasure::Kilowatt, 10);
    let mut meter = UsageMeter::new(&power, pace());
    let mut snapshot = DriveSnapshot::default();
    for second in [0, 4] {
        snapshot.take(Address::from(0x3000_u16), &[10], seconds(second));
        meter.take_readings(&snapshot);
        meter.take_running(Some(true), seconds(second));
        meter.out_of_sight();
    }
    assert_eq!(
        (meter.totals().energy_mj, meter.totals().running),
        (0, Duration::ZERO)
    );
}

#[test]
fn the_drives_own_counter_is_believed_as_far_as_a_drive_can_use() {
    let counter = with(RegisterRole::Energy, UnitOfMeasure::KilowattHour, 10);
    const TENTH: u64 = 360_000_000;
    let totals = UsageTotals {
        energy_mj: 7,
        ..UsageTotals::default()
    };
    let kept = |counter_mj| KeptUsage {
        totals,
        counter_mj,
        ..KeptUsage::default()
    };
    for (before, readings, tenths, why) in [
        (
            None,
            &[(0, 500)][..],
            0,
            "what it counted before it was connected",
        ),
        (None, &[(0, 500), (60, 501), (120, 503)], 3, "rises"),
        (
            None,
            &[(0, 500), (60, 501), (120, 4), (180, 6)],
            3,
            "a reset, or another drive",
        ),
        (
            None,
            &[(0, 500), (60, 60_500), (120, 60_501)],
            1,
            "another drive with a higher counter",
        ),
        (
            None,
            &[(0, 9_999), (60, 9), (119, 10_009), (180, 10_010)],
            11,
            "read while it carried: it was never lower",
        ),
        (None, &[(0, 65_535), (60, 0), (120, 2)], 2, "it wrapped"),
        (
            Some(499 * TENTH),
            &[(0, 500), (60, 501)],
            2,
            "what was used while the gateway was away",
        ),
        (
            Some(501 * TENTH),
            &[(0, 500), (30, 500), (60, 501)],
            1,
            "replaced while the gateway was away",
        ),
    ] {
        assert_eq!(
            energy_after(&counter, kept(before), readings),
            tenths * TENTH,
            "{why}"
        );
    }
    let megawatt_hours = with(RegisterRole::Energy, UnitOfMeasure::MegawattHour, 1000);
    assert_eq!(
        energy_after(&megawatt_hours, KeptUsage::default(), &[(0, 1), (60, 2)]),
        10 * TENTH
    );
}

#[test]
fn between_two_steps_of_a_counter_the_output_power_tells_what_is_used() {
    let mut both = with(RegisterRole::Energy, UnitOfMeasure::KilowattHour, 1);
    let counter = both.register_for(RegisterRole::Energy).cloned().unwrap();
    let power = Register {
        address: Address::from(0x3001_u16),
        role: Some(RegisterRole::OutputPower),
        unit: UnitOfMeasure::Kilowatt,
        ..counter
    };
    both.registers.push(power);
    let mut meter = UsageMeter::new(&both, pace());
    let mut snapshot = DriveSnapshot::default();
    let mut now = 0;
    // For so many seconds at this power, read every 4 s, the counter standing at so many kilowatt hours.
    let mut run = |meter: &mut UsageMeter, for_s: u64, kilowatts: u16, counted: u16| {
        let before = meter.totals().energy_mj;
        for _ in 0..for_s / 4 {
            now += 4;
            snapshot.take(
                Address::from(0x3000_u16),
                &[counted, kilowatts],
                seconds(now),
            );
            meter.take_readings(&snapshot);
            assert!(meter.totals().energy_mj >= before, "it never falls");
        }
        (meter.totals().energy_mj - before) / 3_600_000
    };
    assert_eq!(run(&mut meter, 4, 36, 500), 0, "the first reading");
    assert_eq!(
        run(&mut meter, 60, 36, 500),
        600,
        "36 kW for a minute: 600 Wh"
    );
    assert_eq!(
        run(&mut meter, 4, 36, 501),
        400,
        "the step settles it at 1 kWh, whatever the power showed"
    );
    assert_eq!(run(&mut meter, 200, 36, 501), 999, "less than a step");
    assert_eq!(run(&mut meter, 4, 36, 502), 0, "the step was there already");
    assert_eq!(run(&mut meter, 60, 36, 502), 600);
    let kept = meter
        .take_unkept(MonoTime::from_millis(1), Duration::ZERO)
        .unwrap();
    let mut meter = UsageMeter::new(&both, pace());
    meter.remember(kept);
    assert_eq!(run(&mut meter, 4, 36, 503), 400, "after a restart, too");
    assert_eq!(run(&mut meter, 60, 36, 503), 600);
    assert_eq!(
        run(&mut meter, 12, 36, 3),
        0,
        "the drive was replaced: what the power showed stays"
    );
    assert_eq!(run(&mut meter, 4, 36, 4), 1000);
}

#[test]
fn running_time_and_starts_follow_the_readings() {
    for (readings, running, starts, why) in [
        (
            &[(0, Some(true)), (1, Some(true))][..],
            1,
            0,
            "found running",
        ),
        (
            &[
                (0, Some(false)),
                (1, Some(true)),
                (2, Some(true)),
                (3, Some(false)),
                (4, Some(false)),
            ],
            2,
            1,
            "one run",
        ),
        (
            &[
                (0, Some(true)),
                (3, Some(true)),
                (7, Some(true)),
                (8, Some(true)),
            ],
            4,
            0,
            "a gap of 4 s is not counted",
        ),
        (
            &[(0, Some(false)), (30, Some(true))],
            0,
            1,
            "started while nothing was read",
        ),
        (
            &[(0, Some(true)), (1, None), (2, Some(true))],
            2,
            0,
            "not known for a moment",
        ),
        (
            &[(0, None), (1, Some(true))],
            0,
            0,
            "nothing was known before",
        ),
        (
            &[
                (0, Some(false)),
                (1, Some(true)),
                (2, Some(false)),
                (3, Some(true)),
            ],
            1,
            2,
            "two runs",
        ),
    ] {
        let mut meter = UsageMeter::new(&model(), pace());
        readings
            .iter()
            .for_each(|(second, runs)| meter.take_running(*runs, seconds(*second)));
        let UsageTotals {
            running: time,
            starts: begun,
            ..
        } = *meter.totals();
        assert_eq!(
            (time, begun),
            (Duration::from_secs(running), starts),
            "{why}"
        );
    }
}

#[test]
fn sums_are_returned_when_they_have_changed_and_not_too_often() {
    let mut meter = UsageMeter::new(&model(), pace());
    let every = Duration::from_secs(3);
    assert_eq!(
        meter.take_unkept(seconds(10), every),
        None,
        "nothing was used"
    );
    meter.tripped(2);
    let unkept = meter.take_unkept(seconds(10), every).unwrap();
    assert_eq!(unkept.totals.trips, 2);
    meter.tripped(1);
    assert_eq!(meter.take_unkept(seconds(12), every), None, "too soon");
    assert_eq!(
        meter
            .take_unkept(seconds(12), Duration::ZERO)
            .unwrap()
            .totals
            .trips,
        3,
        "not for a trip"
    );
    assert_eq!(meter.take_unkept(seconds(99), every), None, "nothing since");
    meter.reset();
    assert_eq!(
        meter.take_unkept(seconds(99), every).unwrap().totals,
        UsageTotals::default()
    );
}

#[test]
fn a_drive_has_the_sums_that_its_model_can_tell() {
    let all = |model: &Model| UsagePart::ALL.map(|part| UsageParts::of(model).has(part));
    let power = with(RegisterRole::OutputPower, UnitOfMeasure::Kilowatt, 10);
    assert_eq!(
        (all(&power), UsageParts::of(&power).energy),
        ([true; 4], Some(EnergySource::Power))
    );
    let counter = with(RegisterRole::Energy, UnitOfMeasure::KilowattHour, 10);
    assert_eq!(UsageParts::of(&counter).energy, Some(EnergySource::Counter));
    let per_cent = with(RegisterRole::OutputPower, UnitOfMeasure::Percent, 10);
    assert_eq!(
        all(&per_cent),
        [false, true, true, true],
        "of an unknown value"
    );
    let mut meter = with_status();
    meter.registers.clear();
    meter.status.clear();
    assert_eq!(all(&meter), [false; 4], "another device on the line");
}

#[test]
fn a_sum_is_shown_in_full_steps() {
    let totals = UsageTotals {
        energy_mj: 3_599_999_999,
        running: Duration::from_millis(3_599_999),
        starts: 7,
        trips: 2,
    };
    let view = UsageView {
        parts: UsageParts::of(&with(
            RegisterRole::OutputPower,
            UnitOfMeasure::Kilowatt,
            10,
        )),
        totals,
    };
    let shown = UsagePart::ALL.map(|part| view.value(part).unwrap().to_string());
    assert_eq!(shown, ["0.99", "0.99", "7", "2"]);
    assert_eq!(view.steps(UsagePart::Energy, 10), Some(9));
    assert_eq!(
        UsageView {
            parts: UsageParts::default(),
            totals
        }
        .value(UsagePart::Energy),
        None
    );
}
