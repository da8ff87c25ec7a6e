//! Cases that no simulated drive reaches: rests, repeats, and slow read-backs.

use super::*;
use crate::domain::address::Address;
use crate::domain::command::{
    CommandRequest, Direction, GoOrder, OrderManner, Origin, Owner, RegisterWrite, Rights,
};
use crate::domain::control::ControlSettings;
use crate::domain::frequency::Hertz;
use crate::domain::ids::{AskerId, DriveIndex, Ticket};
use crate::guard::{CommandVerdict, DriveFacts, DriveGuard};
use crate::profile::model::{Model, ModelIdentity};
use crate::vendors::testing::{control, fact, model, with_status};
use std::sync::Arc;

const NOW: MonoTime = MonoTime::from_millis(100_000);
const RUN: u16 = 0x0002;
const FREQUENCY: u16 = 0x0004;
const STATUS: u16 = 0x2100;
const SETTING: u16 = 0x0201;
const RUNNING: u16 = 1;
const TRIPPED: u16 = 8;
const DEAF: Duration = Duration::from_secs(2);
/// Results of a step while the execution continues, and after an unanswered write.
const ACKNOWLEDGED: StepResult =
    StepResult::Goes(Some(Report::new(Outcome::Acknowledged, Reason::None)));
const IN_DOUBT: StepResult = StepResult::Goes(Some(Report::new(Outcome::Unknown, Reason::NoReply)));
const QUIETLY: StepResult = StepResult::Goes(None);

fn execution_by(model: &Model, order: Order, owner: Owner) -> CommandExecution {
    let settings = ControlSettings {
        strict: false,
        ..control()
    };
    let mut guard = DriveGuard::new(
        Arc::new(model.clone()),
        Some(Arc::new(settings)),
        1,
        MonoTime::ZERO,
    );
    let command = CommandRequest {
        asker: AskerId(1),
        ticket: Ticket(1),
        drive: DriveIndex(0),
        origin: Origin {
            owner,
            rights: Rights {
                write: true,
                stop: true,
            },
            manner: OrderManner::Once,
        },
        order,
        start_before: NOW + Duration::from_secs(1),
        issued: None,
        epoch: None,
        trial: None,
    };
    let facts = DriveFacts {
        line_is_up: true,
        listens: false,
        line_is_bad: false,
        is_offline: false,
        is_implausible: false,
        stop_pending: false,
        tripped: Some(matches!(command.order, Order::Reset)),
        rests: true,
        stop_refused: false,
        at_standstill: true,
        output: Some(Hertz::ZERO),
        turns: None,
        is_local: None,
        is_watched: false,
    };
    let Ok(CommandVerdict::Go(approved)) = guard.review(&command, &facts, NOW) else {
        panic!("approved")
    };
    CommandExecution::new(
        approved,
        ReportWaiter::of_command(AskerId(1), Ticket(1), DriveIndex(0)),
    )
}

fn execution(model: &Model, order: Order) -> CommandExecution {
    execution_by(model, order, Owner::Mqtt)
}

fn go(frequency: Option<u16>, run: Option<Direction>) -> Order {
    Order::Go(GoOrder::new(Vec::new(), frequency.map(Hertz::from_centihertz), run).unwrap())
}

/// A drive with a status word that ignores requests after a reset.
fn deaf() -> Model {
    let mut model = with_status();
    model.quirks.deaf_after_reset = Some(fact(DEAF));
    model
}

/// The next request is sent; it writes `value` to the run command.
#[track_caller]
fn sends(execution: &mut CommandExecution, value: u16) -> MonoTime {
    let (at, request) = execution.request().unwrap();
    assert_eq!(
        request,
        Request::WriteSingle {
            address: RUN.into(),
            value
        }
    );
    execution.was_sent();
    at
}

/// The next request is sent; it reads the word at `address`.
#[track_caller]
fn reads(execution: &CommandExecution, address: Address) -> MonoTime {
    let (at, request) = execution.request().unwrap();
    assert_eq!(request, Request::Read { address, count: 1 });
    at
}

fn holds(execution: &mut CommandExecution, value: u16, now: MonoTime) -> StepResult {
    execution.answered(&Reply::Holds { value }, now)
}

fn word(execution: &mut CommandExecution, word: u16, now: MonoTime) -> StepResult {
    execution.answered(&Reply::Words(vec![word]), now)
}

const fn ends(outcome: Outcome, reason: Reason) -> StepResult {
    StepResult::Ends(Report::new(outcome, reason))
}

/// A reset of [`deaf`] whose reset word is answered.
fn reset_taken() -> CommandExecution {
    let mut execution = execution(&deaf(), Order::Reset);
    for value in [0, 4] {
        sends(&mut execution, value);
        assert_eq!(holds(&mut execution, value, NOW), QUIETLY);
    }
    execution
}

#[test]
fn a_reset_that_is_answered_rests_and_is_looked_at_afterwards() {
    let mut execution = reset_taken();
    assert_eq!(execution.rest_at(NOW), None);
    sends(&mut execution, 0);
    assert_eq!(holds(&mut execution, 0, NOW), QUIETLY);
    let (until, _) = execution.rest_at(NOW).unwrap();
    assert_eq!(until, NOW + DEAF);
    assert_eq!(execution.request(), None, "nothing is sent before");
    assert_eq!(execution.rest(until), ACKNOWLEDGED);
    assert_eq!(reads(&execution, STATUS.into()), until);
    assert_eq!(
        word(&mut execution, 0, until),
        ends(Outcome::Confirmed, Reason::None)
    );
    assert_eq!(execution.request(), None);
}

#[test]
fn a_stop_to_which_the_drive_is_deaf_goes_once_more_after_the_rest() {
    let mut execution = reset_taken();
    sends(&mut execution, 0);
    assert_eq!(execution.unanswered(), QUIETLY);
    let (until, _) = execution.rest_at(NOW).unwrap();
    assert_eq!(execution.rest(until), QUIETLY);
    assert_eq!(sends(&mut execution, 0), until);
    assert_eq!(
        holds(&mut execution, 0, until),
        ACKNOWLEDGED,
        "one rest is enough"
    );
    assert!(execution.is_sure());
    reads(&execution, STATUS.into());
    assert_eq!(
        word(&mut execution, 0, until),
        ends(Outcome::Confirmed, Reason::None)
    );
}

#[test]
fn the_stop_that_ends_a_reset_is_given_up_at_last() {
    let mut execution = reset_taken();
    sends(&mut execution, 0);
    assert_eq!(execution.unanswered(), QUIETLY);
    assert_eq!(execution.rest(NOW + DEAF), QUIETLY);
    for _ in 1..STOPS_MAX {
        sends(&mut execution, 0);
        assert_eq!(execution.unanswered(), QUIETLY);
    }
    sends(&mut execution, 0);
    assert_eq!(
        execution.unanswered(),
        ends(Outcome::Unknown, Reason::NoReply),
        "the drive may still hold the reset bit"
    );
}

#[test]
fn a_reset_word_without_an_answer_is_taken_back_and_settled_by_the_status_word() {
    for (status, expected) in [
        (0, ends(Outcome::Confirmed, Reason::None)),
        (TRIPPED, ends(Outcome::Failed, Reason::NotReadBack)),
    ] {
        let mut execution = execution(&deaf(), Order::Reset);
        sends(&mut execution, 0);
        holds(&mut execution, 0, NOW);
        sends(&mut execution, 4);
        assert_eq!(execution.unanswered(), IN_DOUBT);
        let (until, _) = execution.rest_at(NOW).unwrap();
        assert_eq!(execution.rest(until), QUIETLY);
        sends(&mut execution, 0);
        assert_eq!(
            holds(&mut execution, 0, until),
            QUIETLY,
            "no acknowledgement of what was in doubt"
        );
        assert!(!execution.is_sure());
        word(&mut execution, status, until);
        let late = until + Duration::from_secs(2);
        if execution.request().is_some() {
            let held = word(&mut execution, status, late);
            let StepResult::Ends(report) = held else {
                panic!("{held:?}")
            };
            assert_eq!(
                StepResult::Ends(Report {
                    held: None,
                    ..report
                }),
                expected
            );
        } else {
            assert_eq!(status, 0);
        }
    }
}

#[test]
fn without_a_status_word_a_reset_in_doubt_stays_unknown() {
    let mut execution = execution(&model(), Order::Reset);
    sends(&mut execution, 0);
    holds(&mut execution, 0, NOW);
    sends(&mut execution, 4);
    assert_eq!(execution.unanswered(), IN_DOUBT);
    sends(&mut execution, 0);
    assert_eq!(holds(&mut execution, 0, NOW), QUIETLY);
    reads(&execution, 0x0101_u16.into());
    assert_eq!(
        word(&mut execution, 0, NOW),
        ends(Outcome::Unknown, Reason::NoReply)
    );
}

#[test]
fn a_first_stop_without_an_answer_resets_nothing() {
    let mut execution = execution(&deaf(), Order::Reset);
    sends(&mut execution, 0);
    assert_eq!(
        execution.unanswered(),
        ends(Outcome::Unknown, Reason::NoReply)
    );
}

#[test]
fn a_reset_that_is_cut_says_what_rest_is_still_to_come() {
    let mut execution = execution(&deaf(), Order::Reset);
    assert_eq!(
        (execution.rest_to_come(false), execution.rest_to_come(true)),
        (None, None),
        "only a stop at most"
    );
    sends(&mut execution, 0);
    holds(&mut execution, 0, NOW);
    assert_eq!(
        (execution.rest_to_come(false), execution.rest_to_come(true)),
        (None, Some(DEAF)),
        "the reset is on the wire"
    );
    sends(&mut execution, 4);
    holds(&mut execution, 4, NOW);
    assert_eq!(
        (execution.rest_to_come(false), execution.rest_to_come(true)),
        (Some(DEAF), Some(DEAF))
    );
    sends(&mut execution, 0);
    execution.unanswered();
    execution.rest(NOW + DEAF);
    assert_eq!(execution.rest_to_come(true), None, "it has rested");
    assert_eq!(reset_taken().rest_to_come(false), Some(DEAF));
    let mut without = execution_by(&with_status(), Order::Reset, Owner::Mqtt);
    sends(&mut without, 0);
    holds(&mut without, 0, NOW);
    assert_eq!(
        without.rest_to_come(true),
        None,
        "a drive that is never deaf"
    );
}

#[test]
fn what_is_to_show_is_looked_at_with_patience() {
    let patience = Duration::from_secs(1);
    for (shows_at, expected) in [
        (
            Duration::from_millis(900),
            ends(Outcome::Confirmed, Reason::None),
        ),
        (
            Duration::from_secs(100),
            StepResult::Ends(Report {
                held: Some(0),
                ..Report::new(Outcome::Failed, Reason::NotReadBack)
            }),
        ),
    ] {
        let mut execution = execution(&with_status(), go(Some(2000), Some(Direction::Forward)));
        for (address, value) in [(FREQUENCY, 2000), (RUN, 1)] {
            assert_eq!(
                execution.request().unwrap().1,
                Request::WriteSingle {
                    address: address.into(),
                    value
                }
            );
            execution.was_sent();
            holds(&mut execution, value, NOW);
        }
        reads(&execution, SETTING.into());
        assert_eq!(word(&mut execution, 2000, NOW), QUIETLY);
        let mut now = NOW;
        let mut looks = 0;
        let last = loop {
            now = now.max(reads(&execution, STATUS.into()));
            looks += 1;
            let status = if now.since(NOW) >= shows_at {
                RUNNING
            } else {
                0
            };
            let next = word(&mut execution, status, now);
            if next != QUIETLY {
                break next;
            }
        };
        assert_eq!(last, expected);
        assert!(
            now.since(NOW) <= patience + Duration::from_millis(50),
            "{:?}",
            now.since(NOW)
        );
        assert!((18..=22).contains(&looks), "{looks} looks, one every 50 ms");
    }
}

#[test]
fn patience_begins_with_the_first_look() {
    let mut execution = execution(&with_status(), go(Some(2000), None));
    execution.was_sent();
    assert_eq!(holds(&mut execution, 2000, NOW), ACKNOWLEDGED);
    let late = NOW + Duration::from_secs(30);
    assert_eq!(
        word(&mut execution, 0, late),
        QUIETLY,
        "the line was busy for long"
    );
    assert_eq!(
        word(&mut execution, 2000, late + Duration::from_millis(60)),
        ends(Outcome::Confirmed, Reason::None)
    );
}

#[test]
fn conditions_in_one_register_cost_one_look() {
    let mut execution = execution(&with_status(), go(Some(2000), Some(Direction::Reverse)));
    for value in [2000, 2] {
        execution.was_sent();
        holds(&mut execution, value, NOW);
    }
    word(&mut execution, 2000, NOW);
    reads(&execution, STATUS.into());
    assert_eq!(
        word(&mut execution, RUNNING, NOW),
        QUIETLY,
        "it runs, and not yet in reverse"
    );
    assert_eq!(
        word(&mut execution, RUNNING | 2, NOW),
        ends(Outcome::Confirmed, Reason::None)
    );
}

#[test]
fn a_write_without_an_answer_is_looked_for_and_never_repeated() {
    for (shown, expected) in [
        (2000, ends(Outcome::Confirmed, Reason::None)),
        (
            1500,
            StepResult::Ends(Report {
                held: Some(1500),
                ..Report::new(Outcome::Failed, Reason::NoReply)
            }),
        ),
    ] {
        let mut execution = execution(&model(), go(Some(2000), None));
        execution.was_sent();
        assert_eq!(execution.unanswered(), IN_DOUBT);
        reads(&execution, SETTING.into());
        let first = word(&mut execution, shown, NOW);
        let last = if first == QUIETLY {
            word(&mut execution, shown, NOW + Duration::from_millis(1001))
        } else {
            first
        };
        assert_eq!(last, expected);
    }
    let mut execution = execution(&model(), go(Some(2000), Some(Direction::Forward)));
    execution.was_sent();
    assert_eq!(execution.unanswered(), IN_DOUBT);
    let run_was_not_sent = ends(Outcome::Failed, Reason::NoReply);
    assert_eq!(
        word(&mut execution, 2000, NOW),
        run_was_not_sent,
        "the setpoint took effect, and RUN was never sent"
    );
}

#[test]
fn a_look_without_an_answer_is_repeated_and_given_up() {
    let mut execution = execution(&model(), go(Some(2000), None));
    execution.was_sent();
    holds(&mut execution, 2000, NOW);
    assert_eq!(execution.unanswered(), QUIETLY);
    assert_eq!(execution.unanswered(), QUIETLY);
    assert_eq!(
        execution.unanswered(),
        ends(Outcome::Acknowledged, Reason::NoReply)
    );
    let mut execution = execution_by(&model(), go(Some(2000), None), Owner::Mqtt);
    execution.was_sent();
    holds(&mut execution, 2000, NOW);
    assert_eq!(
        execution.excepted(2, None),
        ends(Outcome::Acknowledged, Reason::NoReply),
        "the drive does not show it"
    );
}

#[test]
fn a_check_that_fails_writes_nothing() {
    let checking = || execution(&model(), go(None, Some(Direction::Forward)));
    for wrong in [0, 499, 5001] {
        let mut execution = checking();
        reads(&execution, SETTING.into());
        execution.was_sent();
        assert!(!execution.has_begun(), "a look is no beginning");
        assert_eq!(
            word(&mut execution, wrong, NOW),
            StepResult::Ends(Report::refused(Reason::SetpointUnknown)),
            "{wrong}"
        );
    }
    let mut execution = checking();
    for _ in 1..3 {
        assert_eq!(execution.unanswered(), QUIETLY);
    }
    assert_eq!(
        execution.unanswered(),
        StepResult::Ends(Report::refused(Reason::NoReply))
    );
    let mut execution = checking();
    assert_eq!(word(&mut execution, 500, NOW), QUIETLY);
    sends(&mut execution, 1);
    assert!(execution.has_begun());
    assert_eq!(
        holds(&mut execution, 1, NOW),
        ends(Outcome::Acknowledged, Reason::None),
        "no register shows it"
    );
}

#[test]
fn a_newer_order_takes_the_place_of_what_has_not_begun_and_says_no_more() {
    let model = model();
    let forward = Some(Direction::Forward);
    let ramp =
        Order::Go(GoOrder::new(vec![RegisterWrite::new(0x020C_u16, 7)], None, None).unwrap());
    for (old, new, replaced) in [
        (go(Some(2000), None), go(Some(2500), None), true),
        (go(Some(2000), None), go(Some(2500), forward), true),
        (go(Some(2000), forward), go(Some(2500), None), false),
        (go(None, forward), go(Some(2500), None), false),
        (ramp, go(Some(2500), forward), false),
        (Order::Reset, go(Some(2500), forward), false),
    ] {
        let is_replaced =
            execution(&model, old.clone()).is_replaced_by(&execution(&model, new.clone()));
        assert_eq!(is_replaced, replaced, "{old:?} by {new:?}");
    }
    let mut begun = execution(&model, go(Some(2000), None));
    let newer = || execution(&model, go(Some(2500), None));
    begun.was_sent();
    assert!(!begun.is_replaced_by(&newer()), "its frame is on the wire");
    let other = execution_by(&model, go(Some(2500), None), Owner::Local);
    assert!(
        !execution(&model, go(Some(2000), None)).is_replaced_by(&other),
        "another owner's"
    );
}

#[test]
fn what_is_left_is_what_was_not_taken() {
    let mut execution = execution(&model(), go(Some(2000), Some(Direction::Forward)));
    let setpoint = StepPart::Setpoint(Hertz::from_centihertz(2000));
    let run = StepPart::Run(Direction::Forward);
    assert_eq!(execution.parts_left().collect::<Vec<_>>(), [setpoint, run]);
    execution.was_sent();
    assert_eq!(
        execution.parts_left().collect::<Vec<_>>(),
        [setpoint, run],
        "sent is not taken"
    );
    holds(&mut execution, 2000, NOW);
    assert_eq!(execution.parts_left().collect::<Vec<_>>(), [run]);
    execution.was_sent();
    holds(&mut execution, 1, NOW);
    assert_eq!(execution.parts_left().count(), 0);
}

#[test]
fn what_was_held_up_for_too_long_starts_nothing_and_still_takes_a_reset_back() {
    let soon = NOW + Duration::from_millis(5_999);
    let late = NOW + Duration::from_secs(6);
    let mut start = execution(&model(), go(Some(2000), Some(Direction::Forward)));
    start.was_sent();
    assert_eq!(holds(&mut start, 2000, NOW), QUIETLY);
    assert_eq!(
        (start.may_go(soon, 0), start.may_go(late, 0)),
        (Ok(()), Err(VoidApproval::TooLate))
    );
    assert_eq!(
        reset_taken().may_go(late, 0),
        Ok(()),
        "the reset word must not stay"
    );
    let mut ends_with_it = model();
    ends_with_it
        .run
        .as_mut()
        .unwrap()
        .reset_sequence
        .truncate(2);
    let mut last_resets = execution(&ends_with_it, Order::Reset);
    sends(&mut last_resets, 0);
    assert_eq!(holds(&mut last_resets, 0, NOW), QUIETLY);
    assert_eq!(
        (last_resets.may_go(soon, 0), last_resets.may_go(late, 0)),
        (Ok(()), Err(VoidApproval::TooLate))
    );
}

#[test]
fn a_reset_whose_first_stop_is_lost_ends_the_same_after_an_identity_read() {
    let model = deaf();
    let mut guarded = model.clone();
    guarded.identity = Some(ModelIdentity {
        address: STATUS.into(),
        mask: 0xF000,
        values: fact(vec![0]),
        others: Vec::new(),
    });
    let (mut plain, mut identified) = (
        execution(&model, Order::Reset),
        execution(&guarded, Order::Reset),
    );
    reads(&identified, STATUS.into());
    assert_eq!(word(&mut identified, 0, NOW), QUIETLY);
    sends(&mut plain, 0);
    sends(&mut identified, 0);
    assert_eq!(identified.unanswered(), plain.unanswered());
    assert_eq!(identified.request(), plain.request());
    assert_eq!(identified.rest_at(NOW), plain.rest_at(NOW));
}
