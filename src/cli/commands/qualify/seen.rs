//! What is read from the drive during a trial, compared with what should be seen.

use serde_json::Value;
use std::time::Duration;

/// What the drive does, as it was last polled.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct State {
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
pub(super) fn state_of(answer: &Value) -> State {
    State {
        run_state: answer["run_state"].as_str().unwrap_or("unknown").to_owned(),
        output_hz: answer["output_hz"].as_f64(),
        age: answer["age_ms"].as_u64().map(Duration::from_millis),
        tripped: answer["tripped"].as_bool(),
        local: answer["local"].as_bool(),
        epoch: answer["epoch"].as_u64(),
    }
}

/// What should be seen.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Expected {
    /// The motor stands still, and has not moved.
    StaysAtRest,
    /// The motor comes to rest.
    ComesToRest,
    /// It runs in this direction, at about this frequency.
    Runs(&'static str, f64),
    /// A trip is gone, and nothing moves.
    TripIsGone,
    /// The drive obeys its panel or terminals, as far as it shows that, and nothing moves.
    ObeysPanel,
}

/// How a state compares with it.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Compared {
    /// It shows it.
    Seen,
    /// It may still come.
    NotYet,
    /// It is something else.
    Against(String),
}

/// Compares `state` with what should be seen. A reading from before the order, `since` when that was sent, shows nothing.
pub(super) fn compare(expected: Expected, state: &State, since: Duration) -> Compared {
    if state.run_state == "offline" {
        return Compared::Against("the drive does not answer any more".to_owned());
    }
    let is_new = state.age.is_some_and(|age| age < since);
    if !is_new {
        return Compared::NotYet;
    }
    let is_tripped = state.tripped == Some(true) || state.run_state == "tripped";
    if is_tripped && expected != Expected::TripIsGone && expected != Expected::StaysAtRest {
        return Compared::Against("the drive has tripped".to_owned());
    }
    let moves = ["forward", "reverse", "running", "stopping"].contains(&state.run_state.as_str());
    let has_output = state.output_hz.is_some_and(|hertz| hertz.abs() > 0.0);
    let at_rest =
        !moves && !has_output && ["stopped", "tripped"].contains(&state.run_state.as_str());
    match expected {
        Expected::StaysAtRest if moves || has_output => {
            Compared::Against(format!("the motor moves: {}", said(state)))
        }
        Expected::StaysAtRest | Expected::ComesToRest => seen_if(at_rest),
        Expected::Runs(direction, hertz) => runs(direction, hertz, state),
        Expected::TripIsGone if moves || has_output => {
            Compared::Against(format!("the motor moves: {}", said(state)))
        }
        Expected::TripIsGone => seen_if(!is_tripped && state.tripped == Some(false)),
        Expected::ObeysPanel if moves || has_output => {
            Compared::Against(format!("the motor moves: {}", said(state)))
        }
        Expected::ObeysPanel => seen_if(state.local != Some(false)),
    }
}

fn seen_if(it: bool) -> Compared {
    if it { Compared::Seen } else { Compared::NotYet }
}

/// Half of the frequency is enough: some drives show it with little resolution, and slip is subtracted by others.
fn runs(direction: &str, hertz: f64, state: &State) -> Compared {
    let other = if direction == "forward" {
        "reverse"
    } else {
        "forward"
    };
    if state.run_state == other {
        return Compared::Against(format!("the motor turns the other way: {}", said(state)));
    }
    let output = state.output_hz.map_or(0.0, f64::abs);
    if output > hertz * 1.5 + 1.0 {
        return Compared::Against(format!(
            "the output is much higher than ordered: {}",
            said(state)
        ));
    }
    let runs = state.run_state == direction || state.run_state == "running";
    seen_if(runs && (output >= hertz / 2.0 || state.output_hz.is_none()))
}

/// What the drive does, in words.
pub(super) fn said(state: &State) -> String {
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
    const FORWARD: Expected = Expected::Runs("forward", 5.0);

    fn state(run_state: &str, output_hz: f64) -> State {
        let age = Some(Duration::from_millis(300));
        State {
            run_state: run_state.to_owned(),
            output_hz: Some(output_hz),
            age,
            ..State::default()
        }
    }

    #[test]
    fn a_run_is_seen_in_its_direction_at_its_frequency() {
        assert_eq!(
            compare(FORWARD, &state("stopped", 0.0), SINCE),
            Compared::NotYet
        );
        assert_eq!(
            compare(FORWARD, &state("forward", 1.0), SINCE),
            Compared::NotYet
        );
        assert_eq!(
            compare(FORWARD, &state("forward", 4.9), SINCE),
            Compared::Seen
        );
        assert_eq!(
            compare(FORWARD, &state("running", -4.9), SINCE),
            Compared::Seen,
            "the direction is not shown"
        );
        for against in [
            state("reverse", 5.0),
            state("tripped", 0.0),
            state("forward", 50.0),
            state("offline", 0.0),
        ] {
            assert!(
                matches!(compare(FORWARD, &against, SINCE), Compared::Against(_)),
                "{against:?}"
            );
        }
    }

    #[test]
    fn a_reading_from_before_the_order_shows_nothing() {
        let old = State {
            age: Some(SINCE),
            ..state("stopped", 0.0)
        };
        for expected in [Expected::StaysAtRest, Expected::ComesToRest, FORWARD] {
            assert_eq!(compare(expected, &old, SINCE), Compared::NotYet);
            assert_eq!(
                compare(expected, &State::default(), SINCE),
                Compared::NotYet
            );
        }
    }

    #[test]
    fn at_rest_nothing_may_move_and_after_a_run_it_may_take_its_time() {
        let turning = state("stopping", 2.0);
        assert!(matches!(
            compare(Expected::StaysAtRest, &turning, SINCE),
            Compared::Against(_)
        ));
        assert!(matches!(
            compare(Expected::StaysAtRest, &state("stopped", 0.1), SINCE),
            Compared::Against(_)
        ));
        assert_eq!(
            compare(Expected::ComesToRest, &turning, SINCE),
            Compared::NotYet
        );
        for expected in [Expected::StaysAtRest, Expected::ComesToRest] {
            assert_eq!(
                compare(expected, &state("stopped", 0.0), SINCE),
                Compared::Seen
            );
            assert_eq!(
                compare(expected, &state("unknown", 0.0), SINCE),
                Compared::NotYet
            );
        }
    }

    #[test]
    fn a_trip_is_gone_and_a_release_is_seen_while_nothing_moves() {
        let tripped = State {
            tripped: Some(true),
            ..state("tripped", 0.0)
        };
        assert_eq!(
            compare(Expected::TripIsGone, &tripped, SINCE),
            Compared::NotYet
        );
        let reset = State {
            tripped: Some(false),
            ..state("stopped", 0.0)
        };
        assert_eq!(compare(Expected::TripIsGone, &reset, SINCE), Compared::Seen);
        assert!(matches!(
            compare(Expected::TripIsGone, &state("forward", 3.0), SINCE),
            Compared::Against(_)
        ));
        let on_bus = State {
            local: Some(false),
            ..state("stopped", 0.0)
        };
        assert_eq!(
            compare(Expected::ObeysPanel, &on_bus, SINCE),
            Compared::NotYet
        );
        assert_eq!(
            compare(Expected::ObeysPanel, &state("stopped", 0.0), SINCE),
            Compared::Seen
        );
    }

    #[test]
    fn a_state_that_lacks_something_is_not_known() {
        let answer = json!({ "run_state": "stopped", "output_hz": 0, "age_ms": 20, "tripped": null, "epoch": 4 });
        let expected = State {
            age: Some(Duration::from_millis(20)),
            epoch: Some(4),
            ..state("stopped", 0.0)
        };
        assert_eq!(state_of(&answer), expected);
        assert_eq!(state_of(&json!({})).run_state, "unknown");
    }
}
