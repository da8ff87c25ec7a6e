//! Gives lines to the other gateway on request, and keeps the outcome in the audit.

use super::answers::{json, refusal};
use crate::daemon::exchange::hand_over::{HandOver, hand_over};
use crate::daemon::exchange::shared::SharedLine;
use crate::daemon::local::{LocalSide, OrderingClient};
use crate::journal::TriedWrite;
use crate::north::api::{
    HandOverBody, HandOverDocument, LineHandOver, UnknownLineDocument, read_exactly,
};
use axum::http::StatusCode;
use axum::response::{IntoResponse, Response};
use std::sync::Arc;

const EXPECTED: &str = r#"a body such as {"line": "hall-1"} is expected, or none for all lines"#;

/// Carries out what `body` asks for: one line, or all lines on which this gateway sends.
pub(super) async fn answer(side: Arc<LocalSide>, who: OrderingClient, body: &[u8]) -> Response {
    let Ok(named) = line_in(body) else {
        return refusal(StatusCode::BAD_REQUEST, EXPECTED);
    };
    let Some(place) = side.place() else {
        return refusal(
            StatusCode::SERVICE_UNAVAILABLE,
            "too many tools are served at once",
        );
    };
    let lines = match chosen(&side, named.as_deref()) {
        Ok(lines) => lines,
        Err(unknown) => return *unknown,
    };
    // A client that disconnects does not cancel it; its outcome is kept.
    let done = tokio::spawn(async move {
        let _place = place;
        let ended = hand_over(&lines).await;
        for (line, outcome) in &ended {
            journal_attempt(&side, who, line, *outcome);
        }
        ended
    });
    let Ok(ended) = done.await else {
        return StatusCode::INTERNAL_SERVER_ERROR.into_response();
    };
    let is_done = |outcome: &HandOver| {
        *outcome == HandOver::HandedOver || named.is_none() && !was_tried(*outcome)
    };
    let status = if ended.iter().all(|(_, outcome)| is_done(outcome)) {
        StatusCode::OK
    } else {
        StatusCode::CONFLICT
    };
    let line = |(line, outcome): &(Arc<SharedLine>, HandOver)| {
        let partner = line
            .standby
            .as_ref()
            .map_or("the other one", |share| share.pair.partner.as_str());
        LineHandOver {
            line: line.name.to_string().into(),
            outcome: outcome.keyword().into(),
            message: outcome.message(partner).into(),
        }
    };
    let answer = HandOverDocument {
        yielded: ended
            .iter()
            .any(|(_, outcome)| *outcome == HandOver::HandedOver),
        lines: ended.iter().map(line).collect(),
    };
    (status, json(&answer)).into_response()
}

/// Whether a line of several had anything to hand over.
const fn was_tried(outcome: HandOver) -> bool {
    !matches!(outcome, HandOver::NotActive | HandOver::Alone)
}

/// The line that `body` names; `None` for all.
fn line_in(body: &[u8]) -> Result<Option<String>, ()> {
    if body.is_empty() || body.trim_ascii() == b"null" {
        return Ok(None);
    }
    let HandOverBody { line } = read_exactly(body).ok_or(())?;
    Ok(line)
}

/// The line called `named`, or all that have a second gateway.
fn chosen(side: &LocalSide, named: Option<&str>) -> Result<Vec<Arc<SharedLine>>, Box<Response>> {
    let shared = side.shared();
    let Some(named) = named else {
        return Ok(shared
            .lines
            .iter()
            .filter(|line| line.standby.is_some())
            .cloned()
            .collect());
    };
    let found = shared
        .lines
        .iter()
        .find(|line| line.name.as_str() == named)
        .cloned();
    found.map(|line| vec![line]).ok_or_else(|| {
        let answer = UnknownLineDocument {
            error: format!("there is no line `{named}`").into(),
            lines: shared
                .lines
                .iter()
                .map(|line| line.name.to_string())
                .collect(),
        };
        Box::new((StatusCode::NOT_FOUND, json(&answer)).into_response())
    })
}

fn journal_attempt(side: &LocalSide, who: OrderingClient, line: &SharedLine, outcome: HandOver) {
    if let Some(report) = outcome.report() {
        side.keep(
            who,
            None,
            TriedWrite::Text(format!("standby yield {}", line.name)),
            report,
        );
        tracing::info!(line = %line.name, by = %who.owner(), outcome = outcome.keyword(), "partner asked to take the line");
    }
}

#[cfg(test)]
mod tests {
    use super::super::setup_tests::ask;
    use super::*;
    use crate::daemon::exchange::inbox::LineMessage;
    use crate::daemon::exchange::north_journal::NorthJournal;
    use crate::daemon::exchange::shared::{SharedPlant, StandbyShare};
    use crate::domain::command::{Outcome, Owner};
    use crate::domain::ids::Name;
    use crate::domain::link::{Framing, Interface, LinkSettings};
    use crate::domain::report::LineReport;
    use crate::domain::standby::{LineRole, StandbyPair, StandbyReport, StandbyTrouble};
    use crate::drive::description::DriveRef;
    use crate::journal::WriteAttempt;
    use crate::line::standby::StandbyTimes;
    use crate::line::timing::LineTiming;
    use serde_json::{Value, json as value};
    use std::sync::Mutex;
    use std::time::Duration;
    use tokio::time::sleep;

    const PATH: &str = "/api/v1/standby/yield";
    const ACTIVE: StandbyReport = StandbyReport {
        role: LineRole::Active,
        take_overs: 1,
        given_up: 0,
        rivals: 0,
        hears_other: false,
        listener: None,
        kept: 0,
        trouble: StandbyTrouble {
            is_deaf: false,
            files_differ: false,
            unknown_station: None,
        },
    };
    const LISTENING: StandbyReport = StandbyReport {
        role: LineRole::Listening,
        given_up: 1,
        ..ACTIVE
    };
    const HEARS: StandbyReport = StandbyReport {
        hears_other: true,
        ..LISTENING
    };
    const KEPT: StandbyReport = StandbyReport { kept: 1, ..ACTIVE };
    const BACK: StandbyReport = StandbyReport {
        take_overs: 2,
        given_up: 1,
        ..ACTIVE
    };

    /// Keeps what was tried, by whom, and how it ended.
    #[derive(Debug, Default)]
    struct Kept(Mutex<Vec<(Owner, String, Outcome)>>);

    impl NorthJournal for Kept {
        fn keep(&self, drive: Option<DriveRef>, attempt: WriteAttempt) {
            let TriedWrite::Text(text) = attempt.tried else {
                panic!("{attempt:?}")
            };
            assert_eq!(drive, None);
            self.0
                .lock()
                .unwrap()
                .push((attempt.owner, text, attempt.report.unwrap().outcome));
        }

        fn event_taken(&self, _: u64) {}

        fn want_events(&self, _: u64) {}
    }

    /// Lines with their reports; `None`: the line has no second gateway.
    fn side(lines: &[(&str, Option<StandbyReport>)], kept: &Arc<Kept>) -> Arc<LocalSide> {
        let name = |text: &str| Name::new(text).unwrap();
        let pair = StandbyPair {
            half: name("a"),
            partner: name("b"),
            rank: 0,
            take_over_after: None,
        };
        let timing =
            LineTiming::for_models(Framing::Rtu, LinkSettings::DEFAULT, [], Duration::ZERO);
        let times = StandbyTimes::shortest(&timing, Duration::from_millis(600));
        let line = |(number, (text, report)): (u16, &(&str, Option<StandbyReport>))| {
            let share = report.map(|_| StandbyShare {
                pair: pair.clone(),
                times,
            });
            let line = SharedLine::new(number, name(text), Interface::Rs485, []).shared_with(share);
            line.set_report(LineReport {
                standby: *report,
                ..LineReport::default()
            });
            Arc::new(line)
        };
        let shared = SharedPlant::of((0..).zip(lines).map(line).collect(), Arc::default());
        let journal: Arc<dyn NorthJournal> = Arc::<Kept>::clone(kept);
        Arc::new(LocalSide::new(Arc::new(shared), None).keeping(Some(journal)))
    }

    /// The answer to `body`, if the lines of `side` have these reports, one a second, once they are asked to yield.
    fn asked(side: &Arc<LocalSide>, body: &str, then: &'static [StandbyReport]) -> (u16, Value) {
        let runtime = tokio::runtime::Builder::new_current_thread()
            .enable_all()
            .start_paused(true)
            .build()
            .unwrap();
        tokio::task::LocalSet::new().block_on(&runtime, async {
            for line in side.shared().lines.iter().cloned() {
                tokio::task::spawn_local(async move {
                    let mut batch = Vec::new();
                    loop {
                        line.inbox.take(&mut batch);
                        for message in batch.drain(..) {
                            assert!(matches!(message, LineMessage::Yield), "{message:?}");
                            for report in then {
                                sleep(Duration::from_secs(1)).await;
                                line.set_report(LineReport {
                                    standby: Some(*report),
                                    ..LineReport::default()
                                });
                            }
                        }
                        sleep(Duration::from_millis(10)).await;
                    }
                });
            }
            ask(side, "POST", PATH, body).await
        })
    }

    fn outcomes(answer: &Value) -> Vec<(String, String)> {
        let word = |line: &Value, key: &str| line[key].as_str().unwrap().to_owned();
        answer["lines"]
            .as_array()
            .unwrap()
            .iter()
            .map(|it| (word(it, "line"), word(it, "outcome")))
            .collect()
    }

    #[test]
    fn a_line_is_given_up_and_what_came_of_it_is_told_and_kept() {
        let table: [(&'static [StandbyReport], u16, &str, Outcome); 6] = [
            (&[HEARS], 200, "handed_over", Outcome::Confirmed),
            (
                &[LISTENING, LISTENING, HEARS],
                200,
                "handed_over",
                Outcome::Confirmed,
            ),
            (&[LISTENING, BACK], 409, "taken_back", Outcome::Failed),
            (&[LISTENING], 409, "taken_back", Outcome::Failed),
            (&[KEPT], 409, "no_other", Outcome::Failed),
            (&[], 409, "no_answer", Outcome::Failed),
        ];
        for (then, status, word, outcome) in table {
            let kept = Arc::<Kept>::default();
            let side = side(&[("hall-1", Some(ACTIVE))], &kept);
            let (found, answer) = asked(&side, r#"{"line": "hall-1"}"#, then);
            assert_eq!(
                (found, outcomes(&answer)),
                (status, vec![("hall-1".to_owned(), word.to_owned())]),
                "{answer}"
            );
            assert_eq!(answer["yielded"], status == 200);
            let row = (Owner::Local, "standby yield hall-1".to_owned(), outcome);
            assert_eq!(*kept.0.lock().unwrap(), [row]);
        }
    }

    #[test]
    fn without_a_name_only_lines_on_which_it_sends_are_given_up() {
        let kept = Arc::<Kept>::default();
        let side = side(
            &[("own", None), ("far", Some(HEARS)), ("near", Some(ACTIVE))],
            &kept,
        );
        for body in ["", "null", "{}"] {
            side.shared().lines[2].set_report(LineReport {
                standby: Some(ACTIVE),
                ..LineReport::default()
            });
            let (status, answer) = asked(&side, body, &[HEARS]);
            let expected = [("far", "not_active"), ("near", "handed_over")];
            let expected: Vec<_> = expected
                .iter()
                .map(|(line, it)| ((*line).to_owned(), (*it).to_owned()))
                .collect();
            assert_eq!((status, outcomes(&answer)), (200, expected), "{answer}");
        }
        // Now it sends on none.
        let (status, answer) = asked(&side, "{}", &[]);
        assert_eq!(
            (status, &answer["yielded"]),
            (200, &Value::Bool(false)),
            "{answer}"
        );
    }

    #[test]
    fn a_named_line_with_nothing_to_hand_over_is_an_error() {
        let kept = Arc::<Kept>::default();
        let side = side(&[("own", None), ("far", Some(HEARS))], &kept);
        for (name, word) in [("own", "alone"), ("far", "not_active")] {
            let (status, answer) = asked(&side, &value!({ "line": name }).to_string(), &[]);
            assert_eq!(
                (status, outcomes(&answer)),
                (409, vec![(name.to_owned(), word.to_owned())]),
                "{answer}"
            );
        }
        let (status, answer) = asked(&side, r#"{"line": "hall-9"}"#, &[]);
        assert_eq!(
            (status, &answer["lines"]),
            (404, &value!(["own", "far"])),
            "{answer}"
        );
        for body in [
            "{",
            r#"{"line": 1}"#,
            r#"{"lines": "own"}"#,
            "[]",
            r#"{"line": "own", "now": true}"#,
        ] {
            assert_eq!(asked(&side, body, &[]).0, 400, "{body}");
        }
        let alone = self::side(&[("own", None)], &kept);
        assert_eq!(
            asked(&alone, "", &[]),
            (200, value!({ "yielded": false, "lines": [] }))
        );
    }
}
