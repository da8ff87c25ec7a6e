//! What is read from the drive during a trial, compared with what should be seen.

use crate::north::api::TrialStateDocument;
use std::time::Duration;

/// What the drive does, as it was last polled.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct SeenState {
    /// The word of its run state.
    pub run_state: String,
    /// Its output frequency.
    pub output_hz: Option<f64>,
    /// How long ago that was read.
    pub age: Option<Duration>,
    /// Whether it is tripped, if that is known.
    pub tripped: Option<bool>,
    /// Whether it obeys its panel or terminals, if that is known.
    pub local: Option<bool>,
    /// Its epoch, to be named by a start.
    pub epoch: Option<u64>,
}

/// The state in `answer`; what is missing is not known, because another version may send less.
pub(super) fn state_of(answer: TrialStateDocument) -> SeenState {
    SeenState {
        run_state: answer.run_state.unwrap_or_else(|| "unknown".to_owned()),
        output_hz: answer.output_hz,
        age: answer.age_ms.map(Duration::from_millis),
        tripped: answer.tripped,
        local: answer.local,
        epoch: answer.epoch,
    }
}

/// What should be seen.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum ExpectedState {
    /// The motor stands still, and has not moved.
    StaysAtRest,
    /// The motor comes to rest.
    ComesToRest,
    /// The motor runs in this direction, at about this frequency.
    Runs(&'static str, f64),
    /// A trip is gone, and nothing moves.
    TripIsGone,
    /// The drive obeys its panel or terminals, as far as it shows that, and nothing moves.
    ObeysPanel,
}

/// How a state compares with it.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum ComparedState {
    /// The drive shows what was expected.
    Seen,
    /// The drive may still come to show it.
    NotYet,
    /// The drive shows something else.
    Against(String),
}

/// Compares `state` with what should be seen. A reading from before the order, `since` when that was sent, shows nothing.
pub(super) fn compare(
    expected: ExpectedState,
    state: &SeenState,
    since: Duration,
) -> ComparedState {
    if state.run_state == "offline" {
        return ComparedState::Against("the drive no longer answers".to_owned());
    }
    let is_new = state.age.is_some_and(|age| age < since);
    if !is_new {
        return ComparedState::NotYet;
    }
    let is_tripped = state.tripped == Some(true) || state.run_state == "tripped";
    if is_tripped && expected != ExpectedState::TripIsGone && expected != ExpectedState::StaysAtRest
    {
        return ComparedState::Against("the drive has tripped".to_owned());
    }
    let moves = ["forward", "reverse", "running", "stopping"].contains(&state.run_state.as_str());
    let has_output = state.output_hz.is_some_and(|hertz| hertz.abs() > 0.0);
    let at_rest =
        !moves && !has_output && ["stopped", "tripped"].contains(&state.run_state.as_str());
    match expected {
        ExpectedState::StaysAtRest if moves || has_output => {
            ComparedState::Against(format!("the motor moves: {}", state_text(state)))
        }
        ExpectedState::StaysAtRest | ExpectedState::ComesToRest => seen_if(at_rest),
        ExpectedState::Runs(direction, hertz) => runs(direction, hertz, state),
        ExpectedState::TripIsGone if moves || has_output => {
            ComparedState::Against(format!("the motor moves: {}", state_text(state)))
        }
        ExpectedState::TripIsGone => seen_if(!is_tripped && state.tripped == Some(false)),
        ExpectedState::ObeysPanel if moves || has_output => {
            ComparedState::Against(format!("the motor moves: {}", state_text(state)))
        }
        ExpectedState::ObeysPanel => seen_if(state.local != Some(false)),
    }
}

fn seen_if(it: bool) -> ComparedState {
    if it {
        ComparedState::Seen
    } else {
        ComparedState::NotYet
    }
}

/// Half of the frequency is enough: some drives show it with little resolution, and slip is subtracted by others.
fn runs(direction: &str, hertz: f64, state: &SeenState) -> ComparedState {
    let other = if direction == "forward" {
        "reverse"
    } else {
        "forward"
    };
    if state.run_state == other {
        return ComparedState::Against(format!(
            "the motor turns the other way: {}",
            state_text(state)
        ));
    }
    let output = state.output_hz.map_or(0.0, f64::abs);
    if output > hertz * 1.5 + 1.0 {
        return ComparedState::Against(format!(
            "the output is much higher than ordered: {}",
            state_text(state)
        ));
    }
    let runs = state.run_state == direction || state.run_state == "running";
    seen_if(runs && (output >= hertz / 2.0 || state.output_hz.is_none()))
}

/// What the drive does, in words.
pub(super) fn state_text(state: &SeenState) -> String {
    let output = state.output_hz.map_or_else(
        || "output not known".to_owned(),
        |hertz| format!("output {hertz:.2} Hz"),
    );
    format!("{}, {output}", state.run_state)
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    const SINCE: Duration = Duration::from_secs(2);
    const FORWARD: ExpectedState = ExpectedState::Runs("forward", 5.0);

    fn state(run_state: &str, output_hz: f64) -> SeenState {
        let age = Some(Duration::from_millis(300));
        SeenState {
            run_state: run_state.to_owned(),
            output_hz: Some(output_hz),
            age,
            ..SeenState::default()
        }
    }

    #[test]
    fn a_run_is_seen_in_its_direction_at_its_frequency() {
        assert_eq!(
            compare(FORWARD, &state("stopped", 0.0), SINCE),
            ComparedState::NotYet
        );
        assert_eq!(
            compare(FORWARD, &state("forward", 1.0), SINCE),
            ComparedState::NotYet
        );
        assert_eq!(
            compare(FORWARD, &state("forward", 4.9), SINCE),
            ComparedState::Seen
        );
        assert_eq!(
            compare(FORWARD, &state("running", -4.9), SINCE),
            ComparedState::Seen,
            "the direction is not shown"
        );
        for against in [
            state("reverse", 5.0),
            state("tripped", 0.0),
            state("forward", 50.0),
            state("offline", 0.0),
        ] {
            assert!(
                matches!(compare(FORWARD, &against, SINCE), ComparedState::Against(_)),
                "{against:?}"
            );
        }
    }

    #[test]
    fn a_reading_from_before_the_order_shows_nothing() {
        let old = SeenState {
            age: Some(SINCE),
            ..state("stopped", 0.0)
        };
        for expected in [
            ExpectedState::StaysAtRest,
            ExpectedState::ComesToRest,
            FORWARD,
        ] {
            assert_eq!(compare(expected, &old, SINCE), ComparedState::NotYet);
            assert_eq!(
                compare(expected, &SeenState::default(), SINCE),
                ComparedState::NotYet
            );
        }
    }

    #[test]
    fn at_rest_nothing_may_move_and_after_a_run_it_may_take_its_time() {
        let turning = state("stopping", 2.0);
        assert!(matches!(
            compare(ExpectedState::StaysAtRest, &turning, SINCE),
            ComparedState::Against(_)
        ));
        assert!(matches!(
            compare(ExpectedState::StaysAtRest, &state("stopped", 0.1), SINCE),
            ComparedState::Against(_)
        ));
        assert_eq!(
            compare(ExpectedState::ComesToRest, &turning, SINCE),
            ComparedState::NotYet
        );
        for expected in [ExpectedState::StaysAtRest, ExpectedState::ComesToRest] {
            assert_eq!(
                compare(expected, &state("stopped", 0.0), SINCE),
                ComparedState::Seen
            );
            assert_eq!(
                compare(expected, &state("unknown", 0.0), SINCE),
                ComparedState::NotYet
            );
        }
    }

    #[test]
    fn a_trip_is_gone_and_a_release_is_seen_while_nothing_moves() {
        let tripped = SeenState {
            tripped: Some(true),
            ..state("tripped", 0.0)
        };
        assert_eq!(
            compare(ExpectedState::TripIsGone, &tripped, SINCE),
            ComparedState::NotYet
        );
        let reset = SeenState {
            tripped: Some(false),
            ..state("stopped", 0.0)
        };
        assert_eq!(
            compare(ExpectedState::TripIsGone, &reset, SINCE),
            ComparedState::Seen
        );
        assert!(matches!(
            compare(ExpectedState::TripIsGone, &state("forward", 3.0), SINCE),
            ComparedState::Against(_)
        ));
        let on_bus = SeenState {
            local: Some(false),
            ..state("stopped", 0.0)
        };
        assert_eq!(
            compare(ExpectedState::ObeysPanel, &on_bus, SINCE),
            ComparedState::NotYet
        );
        assert_eq!(
            compare(ExpectedState::ObeysPanel, &state("stopped", 0.0), SINCE),
            ComparedState::Seen
        );
    }

    #[test]
    fn a_state_that_lacks_something_is_not_known() {
        let answer = json!({ "run_state": "stopped", "output_hz": 0, "age_ms": 20, "tripped": null, "epoch": 4 });
        let expected = SeenState {
            age: Some(Duration::from_millis(20)),
            epoch: Some(4),
            ..state("stopped", 0.0)
        };
        let answer = serde_json::from_value(answer).unwrap();
        assert_eq!(state_of(answer), expected);
        let nothing = serde_json::from_value(json!({})).unwrap();
        assert_eq!(state_of(nothing).run_state, "unknown");
    }
}
