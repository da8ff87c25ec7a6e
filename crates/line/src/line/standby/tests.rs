//! Whether two gateways ever may send at once: every order of events, and long random runs.

use super::*;
use crate::domain::link::{Framing, LinkSettings};
use crate::line::timing::LineTiming;
use crate::vendors;
use std::collections::HashSet;

const MS: fn(u64) -> Duration = Duration::from_millis;

fn timing(baud: u32) -> LineTiming {
    let catalog = vendors::catalog();
    let model = catalog.find("hyundai-n700").unwrap();
    let link = LinkSettings {
        baud,
        ..LinkSettings::DEFAULT
    };
    LineTiming::for_models(Framing::Rtu, link, [model.as_ref()], Duration::ZERO)
}

#[test]
fn the_times_are_the_usual_ones_except_on_slow_lines_and_for_slow_drives() {
    for (baud, exchange, silent, silence) in [
        (9600, 300, 1500, 2500),
        (38_400, 1200, 1700, 2500),
        (9600, 3000, 3500, 4342),
        (1200, 300, 1500, 4168),
    ] {
        let times = StandbyTimes::shortest(&timing(baud), MS(exchange));
        assert_eq!(times.silent_at_most, MS(silent), "{baud}");
        let off = times.take_over_after.as_millis().abs_diff(silence);
        assert!(off <= 1, "{baud}: {:?}", times.take_over_after);
    }
    let times = StandbyTimes::shortest(&timing(9600), MS(300));
    assert_eq!(times.with(None, 2).take_over_after, MS(3500));
    assert_eq!(
        times.with(Some(MS(1000)), 0).take_over_after,
        MS(2500),
        "never shorter than is safe"
    );
    assert_eq!(times.with(Some(MS(6000)), 1).take_over_after, MS(6500));
}

/// Lets a free line be silent up to `until`; returns the first change and when it came.
fn silent(rule: &mut StandbyRule, until: u64) -> Option<(u64, StandbyChange)> {
    while let Some(due) = rule
        .due_at()
        .filter(|due| *due <= MonoTime::from_millis(until))
    {
        if let Some(change) = rule.pass(due, true) {
            return Some((due.as_nanos() / 1_000_000, change));
        }
    }
    None
}

fn opened(at_ms: u64) -> StandbyRule {
    let mut rule = StandbyRule::new(StandbyTimes::shortest(&timing(9600), MS(300)), 1);
    assert_eq!((rule.role(), rule.due_at()), (LineRole::Listening, None));
    rule.port_opened(MonoTime::from_millis(at_ms));
    rule
}

#[test]
fn a_listener_takes_the_line_over_after_the_silence_and_sends_at_once() {
    let at = MonoTime::from_millis;
    let mut rule = opened(10_000);
    assert_eq!(silent(&mut rule, 12_499), None);
    rule.heard(at(12_499));
    assert!(rule.hears_other(at(12_600)) && !rule.may_send(at(12_600)));
    assert_eq!(silent(&mut rule, 14_998), None);
    assert_eq!(
        rule.pass(at(14_999), false),
        None,
        "something is on the wire"
    );
    assert_eq!(rule.pass(at(15_001), true), Some(StandbyChange::TakenOver));
    assert_eq!(
        (rule.claims_at(), rule.may_send(at(15_001))),
        (Some(at(15_001)), true)
    );
    rule.sent(at(15_010));
    assert_eq!(
        (
            rule.claims_at(),
            rule.signal_at(),
            rule.was_sent(at(15_011))
        ),
        (None, Some(at(15_510)), None)
    );
    // Its own exchange is no sign of another gateway.
    rule.heard(at(15_020));
    assert_eq!(
        (rule.role(), rule.hears_other(at(15_100))),
        (LineRole::Active, false)
    );
}

#[test]
fn a_listener_that_did_not_listen_has_not_heard_silence() {
    let at = MonoTime::from_millis;
    let mut rule = opened(0);
    assert_eq!(silent(&mut rule, 2000), None);
    assert_eq!(rule.pass(at(2401), true), None);
    assert_eq!(
        silent(&mut rule, 9000),
        Some((4901, StandbyChange::TakenOver))
    );
}

#[test]
fn one_that_was_suspended_listens_before_it_sends() {
    let at = MonoTime::from_millis;
    let mut rule = opened(0);
    assert_eq!(
        silent(&mut rule, 9000),
        Some((2500, StandbyChange::TakenOver))
    );
    rule.sent(at(2500));
    assert!(rule.may_send(at(3999)) && !rule.may_send(at(4000)));
    assert_eq!(rule.pass(at(3999), true), None);
    assert_eq!(rule.pass(at(4000), true), Some(StandbyChange::Stalled));
    let Some((taken, StandbyChange::TakenOver)) = silent(&mut rule, 9000) else {
        panic!("not taken over")
    };
    assert!((6500..=7000).contains(&taken), "{taken}");
    // Suspended while a frame was handed to the port.
    rule.sent(at(taken));
    assert_eq!(rule.was_sent(at(taken) + HAND_OVER_MAX), None);
    assert_eq!(
        rule.was_sent(at(taken) + HAND_OVER_MAX + MS(1)),
        Some(StandbyChange::Stalled)
    );
}

#[test]
fn a_rival_ends_the_role_and_a_lost_port_does() {
    let at = MonoTime::from_millis;
    let mut rule = opened(0);
    assert_eq!(
        rule.heard_request(at(1)),
        None,
        "a listener gives nothing up"
    );
    assert_eq!(
        silent(&mut rule, 9000),
        Some((2501, StandbyChange::TakenOver))
    );
    assert_eq!(rule.heard_request(at(2600)), Some(StandbyChange::Rival));
    assert!(rule.hears_other(at(2700)));
    assert!(!rule.port_gone() && rule.due_at().is_none());
    rule.port_opened(at(5000));
    assert_eq!(
        silent(&mut rule, 9000),
        Some((7500, StandbyChange::TakenOver))
    );
    assert_eq!(
        rule.give_up(at(7600), MS(4000)),
        Some(StandbyChange::Yielded)
    );
    assert_eq!(rule.give_up(at(7700), MS(1)), None);
    assert_eq!(
        silent(&mut rule, 90_000),
        Some((14_100, StandbyChange::TakenOver))
    );
    assert!(rule.port_gone());
}

#[test]
fn the_wait_of_one_that_gave_the_line_up_ends_when_another_one_has_it() {
    let at = MonoTime::from_millis;
    for gives_up in [
        |rule: &mut StandbyRule| rule.give_up(MonoTime::from_millis(2600), MS(2500)),
        |rule: &mut StandbyRule| rule.pass(MonoTime::from_millis(4000), true),
    ] {
        let mut rule = opened(0);
        assert_eq!(
            silent(&mut rule, 2500),
            Some((2500, StandbyChange::TakenOver))
        );
        rule.sent(at(2500));
        assert!(gives_up(&mut rule).is_some());
        assert_eq!(silent(&mut rule, 4200), None);
        rule.heard(at(4200));
        assert_eq!(
            silent(&mut rule, 90_000),
            Some((6700, StandbyChange::TakenOver))
        );
    }
}

#[test]
fn two_that_took_the_line_in_step_wait_for_different_times() {
    let at = MonoTime::from_millis;
    let claims = |seed| {
        let mut rule = StandbyRule::new(StandbyTimes::shortest(&timing(9600), MS(300)), seed);
        rule.port_opened(at(0));
        assert_eq!(
            silent(&mut rule, 9000),
            Some((2500, StandbyChange::TakenOver))
        );
        rule.sent(at(2500));
        assert_eq!(rule.unanswered(at(2600), true), None);
        assert_eq!(rule.role(), LineRole::Active, "for now");
        let claims_at = rule
            .claims_at()
            .expect("it says once more that it has taken the line");
        assert!(claims_at >= at(2600) && claims_at <= at(2600) + CONTEND_WAIT);
        (rule, claims_at)
    };
    let [(mut first, first_at), (mut second, second_at)] = [1, 2].map(claims);
    assert!(first_at < second_at);
    assert!(!second.may_send(first_at) && first.may_send(first_at) && second.may_send(second_at));
    assert_eq!(second.heard_request(first_at), Some(StandbyChange::Rival));

    // The first stays active. One that gets only damaged replies gives the line up in the end; silence does not matter.
    let mut now = first_at;
    for _ in 1..CONTEND_MAX {
        first.sent(now);
        assert_eq!(first.unanswered(now, true), None);
        now = first.claims_at().expect("it says so again");
    }
    first.sent(now);
    assert_eq!(
        (first.unanswered(now, false), first.claims_at()),
        (None, None)
    );
    assert_eq!(first.unanswered(now, true), Some(StandbyChange::Collided));
    // A drive that is off makes it wait once.
    let (mut unheard, _) = claims(4);
    unheard.sent(at(2800));
    assert_eq!(
        (unheard.unanswered(at(3100), false), unheard.claims_at()),
        (None, None)
    );
    // One that stalled meanwhile may not send for longer than any other.
    let (mut late, _) = claims(3);
    late.sent(at(3000));
    assert_eq!(late.unanswered(at(4400), true), None);
    assert!(!late.may_send(at(4500)));
    assert_eq!(
        silent(&mut late, 4600),
        Some((4500, StandbyChange::Stalled))
    );
}

#[test]
fn a_line_that_is_handed_over_is_taken_at_once_unless_another_was_faster() {
    let at = MonoTime::from_millis;
    let shortest = StandbyTimes::shortest(&timing(9600), MS(300));
    for (rank, taken) in [(0, 1000), (1, 1200), (2, 1400)] {
        let mut rule = StandbyRule::new(shortest.with(None, rank), 1);
        rule.port_opened(at(900));
        rule.handed_over(at(1000));
        assert_eq!(
            silent(&mut rule, 9000),
            Some((taken, StandbyChange::HandedOver)),
            "{rank}"
        );
        let mut slow = StandbyRule::new(shortest.with(None, rank), 1);
        slow.port_opened(at(900));
        slow.handed_over(at(1000));
        slow.heard(at(1000));
        assert_eq!(silent(&mut slow, 3499), None, "{rank}: the other one sends");
        let mut suspended = StandbyRule::new(shortest.with(None, rank), 1);
        suspended.port_opened(at(900));
        suspended.handed_over(at(1000));
        assert_eq!(
            suspended.pass(at(1500), true),
            None,
            "{rank}: it may have missed that one"
        );
        assert_eq!(silent(&mut suspended, 3999), None);
    }
}

/// Sends on and on from `from` to `until`, and asks in vain; returns the first change and when it came.
fn in_vain(rule: &mut StandbyRule, from: u64, until: u64) -> Option<(u64, StandbyChange)> {
    for now in (from..until).step_by(100) {
        rule.sent(MonoTime::from_millis(now));
        rule.missed();
        if let Some(change) = rule.pass(MonoTime::from_millis(now), true) {
            return Some((now, change));
        }
    }
    None
}

#[test]
fn one_that_hears_no_drive_leaves_the_line_for_longer_and_longer_until_it_hears_something() {
    let at = MonoTime::from_millis;
    let mut rule = opened(0);
    assert_eq!(
        silent(&mut rule, 9000),
        Some((2500, StandbyChange::TakenOver))
    );
    let mut now = 2500;
    for least in [10_000, 20_000, 40_000, 40_000] {
        assert_eq!(
            in_vain(&mut rule, now, now + 9000),
            Some((now + 3000, StandbyChange::Deaf))
        );
        assert!(rule.is_deaf());
        now += 3000;
        let Some((taken, StandbyChange::TakenOver)) = silent(&mut rule, now + 200_000) else {
            panic!("not taken over")
        };
        let waited = taken - now;
        assert!(
            waited >= least + 2500 && waited <= 2 * least + 2500,
            "{waited}"
        );
        now = taken;
    }
    assert!(in_vain(&mut rule, now, now + 9000).is_some());
    // Its receiver works: the drives are off, and it goes on alone.
    rule.heard(at(now + 9000));
    let Some((taken, StandbyChange::TakenOver)) = silent(&mut rule, now + 20_000) else {
        panic!("not taken over")
    };
    assert_eq!((taken, rule.is_deaf()), (now + 11_500, false));
    assert_eq!(in_vain(&mut rule, taken, taken + 60_000), None);
    // A drive is back. When it falls silent again, the line is left once more.
    rule.answered(at(taken + 60_000));
    assert!(matches!(
        in_vain(&mut rule, taken + 60_000, taken + 80_000),
        Some((_, StandbyChange::Deaf))
    ));
}

#[test]
fn bytes_of_any_kind_are_no_silence() {
    let at = MonoTime::from_millis;
    let mut rule = opened(0);
    for now in (0..20_000).step_by(1000) {
        rule.received(at(now));
        assert_eq!(silent(&mut rule, now + 900), None);
    }
    rule.jam_ended(at(20_000));
    let Some((taken, StandbyChange::TakenOver)) = silent(&mut rule, 30_000) else {
        panic!("not taken over")
    };
    assert!((22_500..=22_750).contains(&taken), "{taken}");
}

/// Two gateways in steps of a quarter of a second. One clock runs fast by two per cent.
const STEP: [Duration; 2] = [Duration::from_millis(250), Duration::from_millis(255)];
const MS_250: Duration = Duration::from_millis(250);

/// A gateway of the search: its rule, and a frame that passed the check but was not handed to the port yet.
#[derive(Clone)]
struct Node {
    rule: StandbyRule,
    now: MonoTime,
    /// Suspended between the check and the port.
    held: bool,
}

/// What happens to a gateway in one step.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Fate {
    /// It runs, and sends if something is due.
    Runs,
    /// It runs and has nothing to send before it must.
    RunsIdle,
    /// It runs, and if it sends, no drive answers.
    RunsInVain,
    /// It is suspended.
    Stalls,
    /// It is suspended between the check and the port.
    StallsAtThePort,
    /// It is started again, or its port goes and comes back.
    Restarts,
    /// It runs, and if it is active, it has heard no drive for too long.
    RunsDeaf,
    /// It runs, and if it listens, it sends a stop between the frames of the other one.
    Stops,
}

const FATES: [Fate; 8] = [
    Fate::Runs,
    Fate::RunsIdle,
    Fate::RunsInVain,
    Fate::Stalls,
    Fate::StallsAtThePort,
    Fate::Restarts,
    Fate::RunsDeaf,
    Fate::Stops,
];

/// What goes out in one step.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Out {
    Nothing,
    /// A frame of one that is active.
    Frame,
    /// A stop of one that is not.
    Stop,
}

impl Node {
    /// Everything that decides what may happen, without the absolute time. Longer ages make no difference.
    fn key(&self) -> (u8, u128, u128, u128, bool) {
        let age = |at: MonoTime| self.now.since(at).as_millis().min(4000);
        let heard = self.rule.heard_at().map_or(u128::MAX, age);
        match self.rule.state {
            SendState::Deaf { .. } => (0, 0, 0, heard, self.held),
            SendState::Listening {
                quiet_from,
                looked_at,
                extra,
            } => (
                1,
                age(quiet_from),
                age(looked_at).min(500) * 10_000 + extra.as_millis(),
                heard,
                self.held,
            ),
            SendState::Claiming { at, until } => {
                let rest = |at: MonoTime| at.since(self.now).as_millis();
                (
                    2,
                    age(at),
                    rest(at) + rest(until) * 10_000,
                    heard,
                    self.held,
                )
            }
            SendState::Active { sent_at } => {
                (3 + self.rule.contended, age(sent_at), 0, heard, self.held)
            }
        }
    }

    /// The step before anything is received. Returns what goes out.
    fn acts(&mut self, fate: Fate) -> Out {
        match fate {
            Fate::Stalls => Out::Nothing,
            Fate::Restarts => {
                self.held = false;
                self.rule.port_opened(self.now);
                Out::Nothing
            }
            Fate::Runs
            | Fate::RunsIdle
            | Fate::RunsInVain
            | Fate::StallsAtThePort
            | Fate::RunsDeaf
            | Fate::Stops => {
                if std::mem::take(&mut self.held) {
                    self.rule.was_sent(self.now);
                    return Out::Frame;
                }
                if fate == Fate::RunsDeaf {
                    self.rule.ears.taken(MonoTime::ZERO);
                    (0..3).for_each(|_| self.rule.missed());
                }
                self.rule.pass(self.now, true);
                // Neither the ears nor the time for which the line is left matter for who may send.
                self.rule.ears = SenderEars::NEW;
                if fate == Fate::Stops && self.rule.role() == LineRole::Listening {
                    return Out::Stop;
                }
                let is_due = self
                    .rule
                    .signal_at()
                    .is_some_and(|at| self.now + MS_250 > at);
                if !self.rule.may_send(self.now) || (fate == Fate::RunsIdle && !is_due) {
                    return Out::Nothing;
                }
                self.rule.sent(self.now);
                if fate == Fate::RunsInVain {
                    // One wait, then the line is given up: more of the same shows nothing new.
                    self.rule.contended = self.rule.contended.max(CONTEND_MAX - 1);
                    self.rule.unanswered(self.now, true);
                }
                self.held = fate == Fate::StallsAtThePort;
                if self.held { Out::Nothing } else { Out::Frame }
            }
        }
    }

    /// Whether `fate` is another one than to run.
    fn may_meet(&self, fate: Fate) -> bool {
        match fate {
            Fate::RunsDeaf => self.rule.role() == LineRole::Active,
            Fate::Stops => self.rule.role() == LineRole::Listening,
            _ => true,
        }
    }

    /// Whether it may send another frame than the one that it holds.
    fn may_send(&self) -> bool {
        self.rule.may_send(self.now) && !self.held
    }
}

/// Every order of stalls, stalls at the port, restarts, idle times, silence for want of ears, and stops of the one that listens, of
/// two gateways without losses on the line: never may both send, but for such stops and the one frame that was held at the port.
#[test]
fn in_every_order_of_events_at_most_one_may_send() {
    let shortest = StandbyTimes::shortest(&timing(9600), MS(300));
    for ranks in [[0, 1], [0, 0]] {
        let node = |rank| {
            let mut rule = StandbyRule::new(shortest.with(None, rank), 1);
            rule.port_opened(MonoTime::from_millis(10_000));
            Node {
                rule,
                now: MonoTime::from_millis(10_000),
                held: false,
            }
        };
        let mut seen = HashSet::new();
        let mut open = vec![[node(ranks[0]), node(ranks[1])]];
        let mut take_overs = 0_u64;
        while let Some(pair) = open.pop() {
            for first in FATES.into_iter().filter(|fate| pair[0].may_meet(*fate)) {
                for second in FATES.into_iter().filter(|fate| pair[1].may_meet(*fate)) {
                    let mut next = pair.clone();
                    next.iter_mut()
                        .zip(STEP)
                        .for_each(|(node, step)| node.now = node.now + step);
                    let before = next.clone().map(|node| node.may_send());
                    let sent = [next[0].acts(first), next[1].acts(second)];
                    hear(&mut next, sent, [first, second]);
                    let may = [next[0].may_send(), next[1].may_send()];
                    take_overs += u64::from(may[0] && !before[0]) + u64::from(may[1] && !before[1]);
                    // With one rank for both they may take a silent line in the same step; then both hear a rival.
                    let at_once = ranks[0] == ranks[1] && sent == [Out::Frame; 2];
                    assert!(
                        !(may[0] && may[1]) || at_once,
                        "{first:?} {second:?}: {:?}",
                        next.map(|it| it.rule)
                    );
                    let key = (next[0].key(), next[1].key());
                    if seen.insert(key) {
                        open.push(next);
                    }
                }
            }
        }
        assert!(
            seen.len() > 1000 && take_overs > 100,
            "{} states, {take_overs} take-overs",
            seen.len()
        );
    }
}

/// What was sent reaches the other one, unless that is suspended: then it lies in the port until it runs again, which for
/// the rule is the same as hearing it then.
fn hear(pair: &mut [Node; 2], sent: [Out; 2], fates: [Fate; 2]) {
    for (from, to) in [(0, 1), (1, 0)] {
        let runs = !matches!(fates[to], Fate::Stalls);
        let now = pair[to].now;
        match sent[from] {
            Out::Frame if runs => {
                pair[to].rule.heard_request(now);
            }
            // It ends no role.
            Out::Stop if runs => pair[to].rule.heard(now),
            Out::Nothing | Out::Frame | Out::Stop => {}
        }
        // A random wait is as short or as long as it can be.
        let now = pair[to].now;
        match &mut pair[to].rule.state {
            SendState::Listening { extra, .. } => {
                *extra = if *extra >= TIE_BREAK / 2 {
                    TIE_BREAK
                } else {
                    Duration::ZERO
                };
            }
            SendState::Claiming { at, .. } if *at > now => {
                *at = if at.since(now) >= CONTEND_WAIT / 2 {
                    now + CONTEND_WAIT
                } else {
                    now
                };
            }
            _ => {}
        }
    }
}
