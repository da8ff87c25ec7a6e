//! Values that are more than one word with a scale are shown as the manual means them, and a setpoint that is a fraction
//! of a full scale is ordered only while that full scale is known.

use crate::support::families::{accepting, options_of, refused, rig_of, write};
use crate::support::{MQTT, Rig, RigOptions, STOP, run, setpoint};
use std::sync::Arc;
use std::time::Duration;
use vfd_gateway::domain::command::{Direction, Outcome, Reason};
use vfd_gateway::domain::ids::{DriveIndex, Station};
use vfd_gateway::domain::native::NativeOutcome;
use vfd_gateway::drive::view::RunState;
use vfd_gateway::profile::check;
use vfd_gateway::sim::BadRequest;

const SECOND: Duration = Duration::from_secs(1);
const VALUES: &str = include_str!("../golden/models/values.toml");
/// The register that holds the full scale in tenths of a hertz.
const FULL_SCALE: u16 = 0x0010;

/// A rig whose drive has shown everything, and has been stopped, so that it may be started.
fn ready() -> Rig {
    let mut rig = rig_of(&Arc::new(check::model(VALUES).unwrap()), accepting());
    rig.pass(SECOND * 5);
    assert_eq!(
        rig.commanded(MQTT, STOP),
        (Outcome::Confirmed, Reason::None)
    );
    rig.pass(SECOND * 3);
    rig.sent.clear();
    rig
}

fn shown(rig: &Rig, name: &str) -> Option<String> {
    let snapshot = rig.core.snapshot(DriveIndex(0)).unwrap();
    let model = check::model(VALUES).unwrap();
    Some(
        snapshot
            .value(model.register_named(name).unwrap())?
            .value
            .to_string(),
    )
}

/// The setpoints of these writes.
fn setpoints(rig: &Rig) -> Vec<u16> {
    let writes = rig
        .writes()
        .into_iter()
        .filter(|pdu| pdu.starts_with(&[6, 0x00, 0x02]));
    writes
        .map(|pdu| u16::from_be_bytes([pdu[3], pdu[4]]))
        .collect()
}

/// The full scale is set at the panel.
fn set_full_scale(rig: &mut Rig, tenths: u16) {
    let now = rig.now;
    rig.bus
        .drive_mut(Station(1))
        .unwrap()
        .set_locally(now, FULL_SCALE.into(), tenths);
}

#[test]
fn a_setpoint_is_a_fraction_of_what_the_drive_says() {
    let mut rig = ready();
    // 42.5 Hz of 60.0 Hz are 11605.33 of 16384.
    assert_eq!(
        rig.commanded(MQTT, setpoint(4250)),
        (Outcome::Confirmed, Reason::None)
    );
    assert_eq!(setpoints(&rig), [11_605]);
    // Without a status word nothing confirms that it runs.
    assert_eq!(
        rig.commanded(MQTT, run(Direction::Reverse, None)),
        (Outcome::Acknowledged, Reason::None)
    );
    for _ in 0..10 {
        // A client that keeps commanding keeps control.
        rig.pass(SECOND);
        assert_eq!(
            rig.commanded(MQTT, setpoint(4250)),
            (Outcome::Confirmed, Reason::None)
        );
    }
    assert_eq!(
        shown(&rig, "output_frequency").as_deref(),
        Some("42.499"),
        "a magnitude"
    );
    assert_eq!(
        rig.view(0).run_state,
        RunState::Reverse,
        "the sign tells the direction"
    );
    assert_eq!(
        shown(&rig, "output_voltage").as_deref(),
        Some("284"),
        "a field: 283 V in steps of 4 V"
    );
    assert_eq!(
        shown(&rig, "trip_code").as_deref(),
        Some("0"),
        "the other field"
    );
    let power: f64 = shown(&rig, "output_power").unwrap().parse().unwrap();
    assert!((3.0..6.0).contains(&power), "two words: {power}");
    assert_eq!(
        shown(&rig, "dc_link_voltage").as_deref(),
        Some("525.0"),
        "with an exponent"
    );
    assert!(
        shown(&rig, "output_current").unwrap().starts_with("8."),
        "two decimals by another register"
    );
    assert!(shown(&rig, "run_hours").is_some());
}

#[test]
fn rounding_never_crosses_a_limit() {
    let mut rig = ready();
    // 5 Hz are 1365.33 steps, but 1365 steps are less than 5 Hz, the least that is allowed.
    assert_eq!(
        rig.commanded(MQTT, setpoint(500)),
        (Outcome::Confirmed, Reason::None)
    );
    // 50 Hz are 13653.33 steps.
    assert_eq!(
        rig.commanded(MQTT, setpoint(5000)),
        (Outcome::Confirmed, Reason::None)
    );
    assert_eq!(setpoints(&rig), [1366, 13_653]);
    assert_eq!(
        rig.commanded(MQTT, setpoint(5001)),
        (Outcome::Refused, Reason::OutsideLimits)
    );
}

#[test]
fn no_setpoint_while_the_full_scale_cannot_be_read() {
    let really = VALUES.replace("address = 0x0010", "address = 0x0012");
    let model = Arc::new(check::model(VALUES).unwrap());
    let really = Some(Arc::new(check::model(&really).unwrap()));
    let mut rig = Rig::new(&RigOptions {
        really,
        bad_request: BadRequest::Exception,
        ..options_of(&model, accepting())
    });
    rig.pass(SECOND * 5);
    assert_eq!(
        rig.commanded(MQTT, setpoint(4250)),
        (Outcome::Refused, Reason::FullScaleUnknown)
    );
    assert!(setpoints(&rig).is_empty());
    assert_eq!(
        rig.commanded(MQTT, STOP),
        (Outcome::Confirmed, Reason::None),
        "a stop never depends on it"
    );
}

#[test]
fn a_changed_full_scale_is_read_twice_before_it_is_believed() {
    let mut rig = ready();
    assert_eq!(
        rig.commanded(MQTT, setpoint(3000)),
        (Outcome::Confirmed, Reason::None)
    );
    set_full_scale(&mut rig, 500);
    rig.pass(SECOND * 10);
    assert_eq!(
        rig.commanded(MQTT, setpoint(3000)),
        (Outcome::Confirmed, Reason::None)
    );
    assert_eq!(
        setpoints(&rig),
        [8192, 9830],
        "30 Hz of 60 Hz, then of 50 Hz"
    );
}

#[test]
fn another_drive_in_its_place_is_read_first() {
    let mut rig = ready();
    let now = rig.now;
    rig.bus
        .drive_mut(Station(1))
        .unwrap()
        .set_powered(now, false);
    rig.pass(SECOND * 20);
    set_full_scale(&mut rig, 1000);
    let now = rig.now;
    rig.bus
        .drive_mut(Station(1))
        .unwrap()
        .set_powered(now, true);
    rig.pass(SECOND * 60);
    assert_eq!(
        rig.commanded(MQTT, STOP),
        (Outcome::Confirmed, Reason::None)
    );
    assert_eq!(
        rig.commanded(MQTT, setpoint(2500)),
        (Outcome::Confirmed, Reason::None)
    );
    assert_eq!(setpoints(&rig), [4096], "25 Hz of 100 Hz");
}

#[test]
fn a_drive_whose_full_scale_is_0_gets_no_setpoint() {
    let mut rig = ready();
    set_full_scale(&mut rig, 0);
    rig.pass(SECOND * 10);
    assert_eq!(
        rig.commanded(MQTT, setpoint(3000)),
        (Outcome::Refused, Reason::BetweenSteps)
    );
    assert!(setpoints(&rig).is_empty());
}

#[test]
fn a_native_word_is_judged_as_the_frequency_that_it_means() {
    let mut rig = ready();
    assert_eq!(write(&mut rig, 0x0002, &[8192]), NativeOutcome::Written);
    assert_eq!(
        write(&mut rig, 0x0002, &[16_384]),
        refused(Reason::OutsideLimits),
        "60 Hz"
    );
    assert_eq!(setpoints(&rig), [8192]);
}
