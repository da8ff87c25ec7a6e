//! A stop by a tool: it is sent until the drive acknowledges it, and then watched until the drive shows its effect.

use super::CommandFailure;
use super::client::{ALARMS, NoAnswer, STATUS, UnitClient, reason};
use crate::drive::view::RunState;
use crate::north::modbus::address as map;
use crate::north::modbus::uniform::{alarm, bit, run};
use crate::wire::exception;
use std::time::Duration;
use tokio::time::{Instant, sleep};

/// How often it is attempted.
const TRIES: u32 = 3;
/// Wait between these attempts.
const AGAIN: Duration = Duration::from_millis(200);
/// Number of words from the status bits to the alarm bits.
const STATUS_TO_ALARMS: u16 = ALARMS - STATUS + 1;
/// Wait between two looks at them.
const LOOK_EVERY: Duration = Duration::from_millis(50);
/// Longest wait for the effect: longer than any `stop_effect_timeout`, after which the gateway itself says that there is none.
const EFFECT_WITHIN: Duration = Duration::from_secs(65);
/// What is said of a stop that has taken effect.
pub const CONFIRMED: &str = "confirmed: the drive shows its effect";
/// What follows from every stop that is not confirmed.
const MAY_RUN: &str = "the motor may still run: go to the drive";

/// Sends the stop `word`, and waits until the drive acknowledges it.
///
/// # Errors
/// It does not, or the gateway cannot be reached: in words.
pub async fn acknowledged(client: &mut UnitClient, word: u16) -> Result<(), CommandFailure> {
    let mut tries = 1;
    loop {
        let error = match client.write(map::RUN, word).await {
            Ok(()) => return Ok(()),
            Err(error) => error,
        };
        if tries == TRIES {
            let notes = if matches!(error, NoAnswer::Exception(_)) {
                reason(client).await
            } else {
                String::new()
            };
            return Err(CommandFailure::failed(format!(
                "{}{notes}; {MAY_RUN}",
                unacknowledged(&error)
            )));
        }
        tries += 1;
        sleep(AGAIN).await;
    }
}

fn unacknowledged(error: &NoAnswer) -> String {
    match error {
        NoAnswer::Exception(exception::GATEWAY_TARGET_FAILED) => {
            "THE STOP IS NOT ACKNOWLEDGED: the drive does not answer".to_owned()
        }
        other => format!("THE STOP IS NOT ACKNOWLEDGED: {other}"),
    }
}

/// Sends the stop `word`, and waits until the drive shows its effect.
///
/// # Errors
/// It is not acknowledged or shows no effect, or the gateway cannot be reached: in words.
pub async fn confirmed(client: &mut UnitClient, word: u16) -> Result<(), CommandFailure> {
    acknowledged(client, word).await?;
    let until = Instant::now() + EFFECT_WITHIN;
    loop {
        let why = match shown(client).await {
            Ok(Shown::Effect) => return Ok(()),
            Ok(Shown::NoEffect) => "but the drive shows no effect".to_owned(),
            Ok(Shown::Run) => "but the drive has been ordered to run again".to_owned(),
            Ok(Shown::Silence) => "but then the drive no longer answers".to_owned(),
            Ok(Shown::Nothing) if Instant::now() < until => {
                sleep(LOOK_EVERY).await;
                continue;
            }
            Ok(Shown::Nothing) => {
                format!("but no effect is seen within {} s", EFFECT_WITHIN.as_secs())
            }
            Err(error) => format!("but its effect cannot be seen: {error}"),
        };
        return Err(CommandFailure::failed(format!(
            "THE STOP IS NOT CONFIRMED: it is acknowledged, {why}; {MAY_RUN}"
        )));
    }
}

/// Stops the drive, and reports it.
///
/// # Errors
/// As of [`confirmed`].
pub async fn stop(client: &mut UnitClient) -> Result<String, CommandFailure> {
    confirmed(client, run::STOP).await?;
    Ok(format!("the stop is {CONFIRMED}"))
}

/// What is to be seen of a stop that was acknowledged.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Shown {
    /// Nothing yet.
    Nothing,
    /// Its effect, by the rule of the gateway.
    Effect,
    /// The stop is not pending any more, and the drive runs: another master or its panel has ordered it to.
    Run,
    /// No effect in time, although the drive answers.
    NoEffect,
    /// The drive does not answer any more.
    Silence,
}

/// One read, so that both words are of one moment.
async fn shown(client: &mut UnitClient) -> Result<Shown, NoAnswer> {
    let words = client.read(STATUS, STATUS_TO_ALARMS).await?;
    Ok(match words[..] {
        [status, run_state, .., alarms] => shown_by(status, run_state, alarms),
        _ => Shown::Nothing,
    })
}

const fn shown_by(status: u16, run_state: u16, alarms: u16) -> Shown {
    let runs = run_state == RunState::Forward.number()
        || run_state == RunState::Reverse.number()
        || run_state == RunState::Running.number();
    let is_online = status & bit::ONLINE != 0;
    let is_late = alarms & alarm::NOT_EFFECTIVE != 0;
    match (is_late, status & bit::PENDING != 0) {
        (false, true) => Shown::Nothing,
        (_, _) if !is_online => Shown::Silence,
        (true, _) => Shown::NoEffect,
        (false, false) if runs => Shown::Run,
        (false, false) => Shown::Effect,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_stop_is_confirmed_by_a_drive_that_answers_and_by_nothing_else() {
        let [stopped, running, stopping, offline] = [
            RunState::Stopped,
            RunState::Running,
            RunState::Stopping,
            RunState::Offline,
        ]
        .map(RunState::number);
        for (status, run_state, alarms, expected) in [
            (bit::ONLINE | bit::PENDING, running, 0, Shown::Nothing),
            (bit::PENDING, offline, 0, Shown::Nothing),
            (bit::ONLINE, stopped, 0, Shown::Effect),
            (
                bit::ONLINE | bit::RUNNING,
                stopping,
                alarm::FAIL_SAFE | alarm::STALE,
                Shown::Effect,
            ),
            (bit::ONLINE | bit::RUNNING, running, 0, Shown::Run),
            (
                bit::ONLINE | bit::PENDING,
                running,
                alarm::NOT_EFFECTIVE,
                Shown::NoEffect,
            ),
            (
                bit::PENDING,
                offline,
                alarm::NOT_EFFECTIVE | alarm::MAY_STILL_RUN,
                Shown::Silence,
            ),
            (0, offline, 0, Shown::Silence),
        ] {
            assert_eq!(
                shown_by(status, run_state, alarms),
                expected,
                "{status:#x} {run_state} {alarms:#x}"
            );
        }
    }

    #[test]
    fn a_silent_drive_is_not_taken_for_a_dead_gateway() {
        let silent = unacknowledged(&NoAnswer::Exception(exception::GATEWAY_TARGET_FAILED));
        assert!(silent.ends_with("the drive does not answer"), "{silent}");
        let dead = unacknowledged(&NoAnswer::Lost(
            "gateway at 127.0.0.1:1502: no answer".to_owned(),
        ));
        assert!(dead.contains("gateway at 127.0.0.1:1502"), "{dead}");
    }
}
