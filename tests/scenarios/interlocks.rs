//! Interlocks between a command that is allowed and a motor that turns.

use crate::support::families::{LOCAL, accepting, listing, models, register, rig_of};
use crate::support::{MQTT, ORIGIN, Rig, STOP, model, run, setpoint};
use std::sync::Arc;
use std::time::Duration;
use vfd_gateway::domain::command::{Direction, Order, Origin, Outcome, Reason, RunIntent};
use vfd_gateway::domain::control::ControlSettings;
use vfd_gateway::domain::frequency::Hertz;
use vfd_gateway::domain::ids::Station;
use vfd_gateway::journal::RememberedDrive;
use vfd_gateway::profile::model::{IndicatedState, Model};

const SECOND: Duration = Duration::from_secs(1);
const FORWARD: Direction = Direction::Forward;
/// A trip number that every known table has.
const CAUSE: u16 = 2;

fn is_taken(rig: &mut Rig, order: Order) {
    is_taken_by(rig, MQTT, order);
}

fn is_taken_by(rig: &mut Rig, origin: Origin, order: Order) {
    let (outcome, reason) = rig.commanded(origin, order);
    assert!(
        matches!(outcome, Outcome::Acknowledged | Outcome::Confirmed),
        "{outcome:?} {reason:?}"
    );
}

/// A drive of `model` that runs at 30 Hz.
fn running(model: &Arc<Model>, control: ControlSettings) -> Rig {
    let mut rig = rig_of(model, control);
    is_taken(&mut rig, run(FORWARD, Some(3000)));
    rig.live(SECOND * 6);
    assert!(rig.output(1) > 0, "{}", model.id);
    rig
}

/// It is stopped, and at standstill.
fn stands(rig: &mut Rig) {
    is_taken(rig, STOP);
    rig.live(SECOND * 15);
    assert_eq!(rig.output(1), 0);
    rig.sent.clear();
}

#[test]
fn a_frequency_outside_the_window_is_refused_and_never_clamped() {
    for model in models() {
        let mut rig = running(&model, accepting());
        rig.sent.clear();
        for centihertz in [499, 5001] {
            for order in [setpoint(centihertz), run(FORWARD, Some(centihertz))] {
                assert_eq!(
                    rig.commanded(MQTT, order),
                    (Outcome::Refused, Reason::OutsideLimits),
                    "{}",
                    model.id
                );
            }
        }
        assert_eq!(rig.writes(), Vec::<Vec<u8>>::new(), "{}", model.id);
    }
}

#[test]
fn a_motor_is_started_no_sooner_than_after_the_interval() {
    for model in models() {
        let minute = SECOND * 60;
        let mut rig = rig_of(
            &model,
            ControlSettings {
                min_start_interval: minute,
                ..accepting()
            },
        );
        let started = rig.now;
        is_taken(&mut rig, run(FORWARD, Some(3000)));
        rig.live(SECOND * 6);
        stands(&mut rig);
        for _ in 0..3 {
            let told = rig.commanded(MQTT, run(FORWARD, Some(3000)));
            assert_eq!(
                told,
                (Outcome::Refused, Reason::StartsTooOften),
                "{}",
                model.id
            );
        }
        assert_eq!(rig.writes(), Vec::<Vec<u8>>::new(), "{}", model.id);
        let early = minute.saturating_sub(rig.now.since(started));
        rig.live(early + SECOND);
        is_taken(&mut rig, run(FORWARD, Some(3000)));
        rig.live(SECOND * 6);
        assert!(rig.output(1) > 0, "{}", model.id);
        assert_eq!(
            rig.commanded(MQTT, STOP).0,
            Outcome::Confirmed,
            "{}: a stop is no start",
            model.id
        );
    }
}

#[test]
fn a_start_that_was_never_sent_counts_for_nothing() {
    let model = &models()[0];
    let mut rig = rig_of(
        model,
        ControlSettings {
            min_start_interval: SECOND * 60,
            ..accepting()
        },
    );
    let refused = rig.command_unsettled(MQTT, 0, run(FORWARD, Some(3000)));
    let stop = rig.command_unsettled(MQTT, 0, STOP);
    rig.settle();
    assert_eq!(rig.outcome_of(refused).0, Outcome::Superseded);
    rig.outcome_of(stop);
    rig.live(SECOND * 5);
    is_taken(&mut rig, run(FORWARD, Some(3000)));
}

#[test]
fn a_start_that_was_cut_off_on_the_wire_may_have_been_one() {
    for model in models() {
        let fresh = || {
            rig_of(
                &model,
                ControlSettings {
                    min_start_interval: SECOND * 60,
                    ..accepting()
                },
            )
        };
        // The last one is the order to run.
        let mut whole = fresh();
        is_taken(&mut whole, run(FORWARD, Some(3000)));
        let frames = whole.writes().len();
        let mut rig = fresh();
        let start = rig.command(MQTT, 0, run(FORWARD, Some(3000)));
        let limit = rig.now + SECOND * 5;
        while rig.writes().len() < frames {
            assert!(rig.step(limit), "{}: {:02X?}", model.id, rig.writes());
        }
        let stop = rig.command(MQTT, 0, STOP);
        assert_eq!(rig.outcome_of(start).0, Outcome::Superseded, "{}", model.id);
        assert_eq!(rig.outcome_of(stop).0, Outcome::Confirmed, "{}", model.id);
        rig.live(SECOND * 10);
        let told = rig.commanded(MQTT, run(FORWARD, Some(3000)));
        assert_eq!(
            told,
            (Outcome::Refused, Reason::StartsTooOften),
            "{}",
            model.id
        );
    }
}

#[test]
fn a_motor_that_was_started_in_reverse_elsewhere_is_not_reversed_at_speed() {
    let mut seen = Vec::new();
    for model in models()
        .iter()
        .filter(|model| model.status_flag(IndicatedState::Reverse).is_some())
    {
        seen.push(model.id.clone());
        let reverse_below = Hertz::from_centihertz(1000);
        let mut rig = rig_of(
            model,
            ControlSettings {
                reverse_below,
                ..accepting()
            },
        );
        is_taken(&mut rig, run(Direction::Reverse, Some(3000)));
        rig.live(SECOND * 15);
        assert!(rig.output(1) < -1000, "{}", model.id);
        rig.restart(RememberedDrive::default());
        rig.live(SECOND * 5);
        assert!(rig.output(1) < -1000, "{}: it goes on turning", model.id);
        rig.sent.clear();
        let told = rig.commanded(MQTT, run(FORWARD, Some(3000)));
        assert_eq!(told, (Outcome::Refused, Reason::Reversal), "{}", model.id);
        assert_eq!(rig.writes(), Vec::<Vec<u8>>::new(), "{}", model.id);
        is_taken(&mut rig, run(Direction::Reverse, Some(3000)));
    }
    assert_eq!(
        seen,
        [
            "frecon-fr500a",
            "teco-e510",
            "teco-e510s",
            "toshiba-vf-as1",
            "toshiba-vf-s15"
        ]
    );
}

/// Its output may have been read before it stopped.
#[test]
fn an_order_for_the_other_direction_behind_a_stop_is_judged_by_what_the_motor_does_now() {
    let is_refused = |told| told == (Outcome::Refused, Reason::Reversal);
    for model in models()
        .iter()
        .filter(|model| model.run.as_ref().is_some_and(|run| run.reverse.is_some()))
    {
        let mut rig = rig_of(model, accepting());
        is_taken_by(&mut rig, ORIGIN, STOP);
        for directions in [
            [Direction::Forward, Direction::Reverse],
            [Direction::Reverse, Direction::Forward],
        ] {
            let [one, other] = directions.map(|direction| run(direction, Some(500)));
            is_taken_by(&mut rig, ORIGIN, one);
            rig.live(SECOND * 3);
            is_taken_by(&mut rig, ORIGIN, STOP);
            while is_refused(rig.commanded(ORIGIN, other.clone())) {
                assert_ne!(rig.output(1), 0, "{}: it is at standstill", model.id);
                rig.pass(Duration::from_millis(7));
            }
            is_taken_by(&mut rig, ORIGIN, STOP);
            rig.live(SECOND * 15);
        }
    }
}

#[test]
fn a_motor_is_reversed_only_below_its_frequency() {
    let reverse_below = Hertz::from_centihertz(1000);
    for model in models()
        .iter()
        .filter(|model| model.run.as_ref().is_some_and(|run| run.reverse.is_some()))
    {
        let mut rig = running(
            model,
            ControlSettings {
                reverse_below,
                ..accepting()
            },
        );
        rig.sent.clear();
        let reverse = run(Direction::Reverse, Some(3000));
        assert_eq!(
            rig.commanded(MQTT, reverse.clone()),
            (Outcome::Refused, Reason::Reversal),
            "{}",
            model.id
        );
        assert_eq!(rig.writes(), Vec::<Vec<u8>>::new(), "{}", model.id);
        is_taken(&mut rig, setpoint(600));
        rig.live(SECOND * 15);
        is_taken(&mut rig, reverse);
        rig.live(SECOND * 15);
        assert!(rig.output(1) < 0, "{}", model.id);
    }
}

#[test]
fn a_drive_that_obeys_its_panel_is_refused_and_not_left_unanswered() {
    let mut seen = Vec::new();
    for model in models() {
        // What the drive shows of its sources, and a word there that is not the bus.
        let told = model
            .status_flag(IndicatedState::BusRun)
            .map(|flag| flag.address);
        let source = model
            .register_for(vfd_gateway::profile::model::RegisterRole::RunSource)
            .map(|register| register.address);
        let (Some(_), Some(source)) = (told, source) else {
            continue;
        };
        seen.push(model.id.clone());
        let mut rig = rig_of(&model, accepting());
        let now = rig.now;
        rig.bus
            .drive_mut(Station(1))
            .unwrap()
            .set_locally(now, source, 1);
        rig.live(SECOND * 5);
        assert_eq!(rig.view(0).status.is_local(), Some(true), "{}", model.id);
        rig.sent.clear();
        for order in [run(FORWARD, Some(3000)), setpoint(2000)] {
            assert_eq!(
                rig.commanded(MQTT, order),
                (Outcome::Refused, Reason::LocalControl),
                "{}",
                model.id
            );
        }
        assert_eq!(rig.writes(), Vec::<Vec<u8>>::new(), "{}", model.id);
        let ticket = rig.command(MQTT, 0, STOP);
        rig.live(SECOND * 2);
        assert!(
            !rig.writes().is_empty(),
            "{}: a stop goes out: {:?}",
            model.id,
            rig.told(ticket)
        );
    }
    assert_eq!(seen, ["frecon-fr500a", "hyundai-n100plus", "hyundai-n700"]);
}

#[test]
fn a_trip_ends_what_was_ordered_and_a_reset_starts_nothing() {
    for model in models() {
        let mut rig = running(&model, accepting());
        let now = rig.now;
        rig.bus.drive_mut(Station(1)).unwrap().trip(now, CAUSE);
        rig.live(SECOND * 4);
        let control = rig.view(0).control.unwrap();
        assert_eq!(
            (control.intent, control.start_inhibited),
            (RunIntent::Stop, true),
            "{}",
            model.id
        );
        assert_eq!(
            rig.commanded(MQTT, run(FORWARD, None)),
            (Outcome::Refused, Reason::Tripped),
            "{}",
            model.id
        );
        let ticket = rig.command(MQTT, 0, Order::Reset);
        rig.live(SECOND * 10);
        let (outcome, reason, _) = *rig.told(ticket).last().unwrap();
        assert!(
            matches!(outcome, Outcome::Acknowledged | Outcome::Confirmed),
            "{}: {outcome:?} {reason:?}",
            model.id
        );
        rig.live(SECOND * 10);
        assert_eq!(
            (rig.output(1), rig.view(0).control.unwrap().intent),
            (0, RunIntent::Stop),
            "{}",
            model.id
        );
    }
}

#[test]
fn a_reset_needs_a_trip_or_a_motor_at_rest() {
    for model in models() {
        let mut rig = running(&model, accepting());
        rig.sent.clear();
        assert_eq!(
            rig.commanded(MQTT, Order::Reset),
            (Outcome::Refused, Reason::NotTripped),
            "{}",
            model.id
        );
        assert_eq!(rig.writes(), Vec::<Vec<u8>>::new(), "{}", model.id);
    }
}

#[test]
fn a_register_that_wears_out_is_written_if_listed_and_then_seldom() {
    for model in models() {
        let stored = model.registers.iter().find(|register| {
            let is_plain =
                register.role.is_none_or(|role| !role.is_guarded()) && register.back_door.is_none();
            is_plain
                && register.access.can_write()
                && register.access.can_read()
                && model.is_stored(register.address)
                && !model.sets_watchdog(register.address)
        });
        let Some(stored) = stored else { continue };
        let least = stored
            .range
            .as_ref()
            .map_or(1, |range| *range.start())
            .max(1);
        let value = u16::try_from(least).unwrap();
        let address = stored.address;
        let mut rig = rig_of(&model, accepting());
        let told = rig.commanded(MQTT, register(address.number(), value));
        assert_eq!(told, (Outcome::Refused, Reason::NotListed), "{}", model.id);
        let mut rig = rig_of(&model, listing(vec![address.number()]));
        assert_ne!(
            rig.commanded(MQTT, register(address.number(), value)).0,
            Outcome::Refused,
            "{} {address}",
            model.id
        );
        rig.sent.clear();
        for _ in 0..3 {
            let told = rig.commanded(MQTT, register(address.number(), value));
            assert_eq!(
                told,
                (Outcome::Refused, Reason::WrittenTooOften),
                "{}",
                model.id
            );
        }
        assert_eq!(rig.writes(), Vec::<Vec<u8>>::new(), "{}", model.id);
        rig.live(SECOND * 11);
        assert_ne!(
            rig.commanded(MQTT, register(address.number(), value)).0,
            Outcome::Refused,
            "{}",
            model.id
        );
    }
    // Only the local socket may restore parameters, which no list names; no more often than that, and not while another
    // client runs the drive.
    let mut rig = rig_of(&model("hyundai-n700"), accepting());
    assert_eq!(
        rig.commanded(LOCAL, register(0x020C, 50)).0,
        Outcome::Confirmed
    );
    assert_eq!(
        rig.commanded(LOCAL, register(0x020C, 60)),
        (Outcome::Refused, Reason::WrittenTooOften)
    );
    let mut rig = running(&model("hyundai-n700"), accepting());
    assert_eq!(
        rig.commanded(LOCAL, register(0x020C, 50)),
        (Outcome::Refused, Reason::OtherOwner)
    );
}
