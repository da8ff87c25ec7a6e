//! A state that no document names proves nothing: it ends no stop, clears no trip and is never `stopped`; the run state
//! follows the output frequency.

use crate::support::families::{accepting, each, rig_of};
use crate::support::{MQTT, Rig, STOP, model, run};
use std::cell::Cell;
use std::sync::Arc;
use std::time::Duration;
use vfd_gateway::domain::address::Address;
use vfd_gateway::domain::command::{Direction, Outcome};
use vfd_gateway::domain::ids::Station;
use vfd_gateway::drive::status::UndocumentedState;
use vfd_gateway::drive::view::{RunState, TripEventKind};
use vfd_gateway::gateway::DriveNote;
use vfd_gateway::profile::model::{IndicatedState, Model, RegisterRole};
use vfd_gateway::sim::SimDrive;

const SECOND: Duration = Duration::from_secs(1);

/// The register of `flag`, and words in it that no document names for it: with a low bit more, and with a high one.
fn undocumented(model: &Model, flag: IndicatedState) -> Vec<(Address, u16)> {
    let Some(flag) = model.status_flag(flag) else {
        return Vec::new();
    };
    let words = (0..=u16::MAX).filter(|word| flag.reads(*word).is_none());
    let high = words.clone().find(|word| *word > 0x00FF);
    words
        .take(1)
        .chain(high)
        .map(|word| (flag.address, word))
        .collect()
}

fn drive(rig: &mut Rig) -> &mut SimDrive {
    rig.bus.drive_mut(Station(1)).unwrap()
}

/// A drive of `model` that runs at 30 Hz.
fn running(model: &Arc<Model>) -> Rig {
    let mut rig = rig_of(model, accepting());
    rig.commanded(MQTT, run(Direction::Forward, Some(3000)));
    rig.live(SECOND * 12);
    rig
}

fn told(rig: &Rig, state: UndocumentedState) -> usize {
    rig.notes
        .iter()
        .filter(|(_, note)| *note == DriveNote::Undocumented(state))
        .count()
}

#[test]
fn it_ends_no_stop_of_any_model() {
    let played = Cell::new(0);
    each(|model| {
        let words = undocumented(model, IndicatedState::Running);
        if model.run.is_none() {
            return;
        }
        for (address, word) in words {
            let mut rig = running(model);
            // It acknowledges the stop, and turns on.
            let output = model
                .register_for(RegisterRole::OutputFrequency)
                .expect("it shows its output");
            for part in output.address.onwards().take(output.form.words().into()) {
                let held = rig.view(0).snapshot.reading(part).expect("it was read").raw;
                drive(&mut rig).shows_at(part, held);
            }
            drive(&mut rig).shows_at(address, word);
            rig.live(SECOND * 3);
            let state = rig.view(0).run_state;
            assert!(state.is_running(), "0x{word:04X}: {state:?}");
            let ticket = rig.command(MQTT, 0, STOP);
            rig.live(SECOND * 12);
            let confirmed = rig
                .told(ticket)
                .iter()
                .any(|(outcome, ..)| *outcome == Outcome::Confirmed);
            assert!(!confirmed, "0x{word:04X}: {:?}", rig.told(ticket));
            let control = rig.view(0).control.unwrap();
            assert!(
                control.stop_pending && control.not_effective,
                "0x{word:04X}"
            );
            assert!(
                rig.notes
                    .iter()
                    .any(|(_, note)| *note == DriveNote::NotEffective),
                "0x{word:04X}"
            );
            assert_eq!(
                told(&rig, UndocumentedState { address, word }),
                1,
                "0x{word:04X}"
            );
            assert_eq!(
                rig.view(0).status.undocumented,
                Some(UndocumentedState { address, word })
            );
            played.set(played.get() + 1);
        }
    });
    assert!(played.get() >= 20, "{}", played.get());
}

#[test]
fn it_clears_no_trip_of_any_model() {
    each(|model| {
        for (address, word) in undocumented(model, IndicatedState::Tripped) {
            let mut rig = rig_of(model, accepting());
            rig.live(SECOND * 3);
            let now = rig.now;
            drive(&mut rig).trip(now, 2);
            rig.live(SECOND * 3);
            assert_eq!(rig.view(0).trip.active, Some(true));
            drive(&mut rig).shows_at(address, word);
            rig.live(SECOND * 5);
            assert_eq!(rig.view(0).run_state, RunState::Tripped, "0x{word:04X}");
            assert!(
                rig.trips
                    .iter()
                    .all(|(_, event)| event.kind != TripEventKind::Cleared),
                "0x{word:04X}"
            );
        }
    });
}

#[test]
fn the_run_state_follows_the_output_until_a_documented_state_is_back() {
    let mut rig = running(&model("frecon-fr500a"));
    let address = Address::holding(0x2100);
    for word in [7, 8, 0x0101] {
        drive(&mut rig).shows_at(address, word);
        rig.live(SECOND * 3);
        assert_eq!(rig.view(0).run_state, RunState::Forward, "0x{word:04X}");
        assert_eq!(
            rig.view(0).status.undocumented,
            Some(UndocumentedState { address, word })
        );
    }
    drive(&mut rig).shows_the_truth();
    rig.live(SECOND * 3);
    assert_eq!(
        (rig.view(0).run_state, rig.view(0).status.undocumented),
        (RunState::Forward, None)
    );
    for word in [7, 8, 7, 8] {
        drive(&mut rig).shows_at(address, word);
        rig.live(SECOND * 2);
    }
    assert_eq!(
        told(&rig, UndocumentedState { address, word: 7 }),
        1,
        "each is told once"
    );
}
