//! Whatever is commanded by whomever on a bad line, also where an order takes several writes: no order is given by half, nothing
//! of a start follows a stop, and no word is left standing that moves the motor later.

use crate::support::families::{accepting, options_of};
use crate::support::{MQTT, ORIGIN, Rig, RigOptions, plc};
use proptest::prelude::*;
use std::sync::Arc;
use std::time::Duration;
use vfd_gateway::domain::command::{Direction, GoOrder, Order, Outcome};
use vfd_gateway::domain::frequency::Hertz;
use vfd_gateway::domain::ids::{Station, Ticket};
use vfd_gateway::domain::time::MonoTime;
use vfd_gateway::gateway::{DriveNote, LineInput};
use vfd_gateway::profile::check;
use vfd_gateway::sim::FaultPlan;

const APART: &str = include_str!("../golden/models/orders.toml");
const IN_WORDS: &str = include_str!("../golden/models/start.toml");
const RUN: u16 = 0x2000;
const DIRECTION: u16 = 0x2001;
const RESET: u16 = 0x2002;
/// The words before the run word, and the run words, of the drive that starts in several words.
const FIRST: u16 = 0x0006;
const SECOND: u16 = 0x0007;
const RUNS: [u16; 2] = [0x000F, 0x080F];

#[derive(Clone, Debug)]
enum Step {
    Command(usize, Order),
    Pass(u64),
    Faults(usize),
    Trip,
    Clear,
    Power(bool),
    HoldBack(bool),
    /// The word for reverse does not reach the drive.
    Loses(bool),
    Alive,
}

fn order() -> impl Strategy<Value = Order> {
    let hertz = || (500..5000_u16).prop_map(|it| Some(Hertz::from_centihertz(it)));
    let direction = prop_oneof![Just(Direction::Forward), Just(Direction::Reverse)];
    prop_oneof![
        3 => Just(Order::Stop { setpoint: None }),
        1 => Just(Order::Coast),
        2 => Just(Order::Reset),
        6 => (hertz(), direction).prop_map(|(hertz, run)| Order::Go(GoOrder::new(Vec::new(), hertz, Some(run)).expect("not empty"))),
        2 => Just(Order::Go(GoOrder::new(Vec::new(), Some(Hertz::from_centihertz(2000)), None).expect("not empty"))),
    ]
}

fn step() -> impl Strategy<Value = Step> {
    prop_oneof![
        8 => (0..3_usize, order()).prop_map(|(who, order)| Step::Command(who, order)),
        3 => (1..100_u64).prop_map(Step::Pass),
        5 => (100..5000_u64).prop_map(Step::Pass),
        3 => (0..4_usize).prop_map(Step::Faults),
        1 => Just(Step::Trip),
        1 => Just(Step::Clear),
        1 => any::<bool>().prop_map(Step::Power),
        2 => any::<bool>().prop_map(Step::HoldBack),
        2 => any::<bool>().prop_map(Step::Loses),
        2 => Just(Step::Alive),
    ]
}

struct Observed {
    rig: Rig,
    given: Vec<(Ticket, MonoTime, Order)>,
    /// When the drive was switched off or on.
    power_at: MonoTime,
    /// The direction that the drive held when a run word left, and the one that was written before.
    directions: Vec<(Option<u16>, Option<u16>)>,
    /// It moved when it was let go, although no start was told as done.
    moved_late: bool,
}

impl Observed {
    fn new(text: &str, seed: u64) -> Self {
        let model = Arc::new(check::model(text).expect("a sound model"));
        let poll = Duration::from_millis(100);
        Self {
            rig: Rig::new(&RigOptions {
                seed,
                poll,
                ..options_of(&model, accepting())
            }),
            given: Vec::new(),
            power_at: MonoTime::ZERO,
            directions: Vec::new(),
            moved_late: false,
        }
    }

    fn take(&mut self, step: Step) {
        let now = self.rig.now;
        match step {
            Step::Command(who, order) => {
                let ticket = self
                    .rig
                    .command([MQTT, ORIGIN, plc(1)][who], 0, order.clone());
                self.given.push((ticket, now, order));
                return;
            }
            Step::Pass(ms) => return self.pass(Duration::from_millis(ms)),
            Step::Faults(plan) => {
                let plans = ["", "lost=300", "late=300,flip=50", "noise=100,cut=100"];
                return self
                    .rig
                    .bus
                    .set_faults(plans[plan].parse().expect("a plan"));
            }
            Step::Power(on) => {
                self.power_at = now;
                return self.rig.bus.set_powered(now, Station(1), on);
            }
            Step::Loses(it) => {
                self.rig.swallows = it.then(|| vec![6, 0x20, 1, 0, 1]);
                return;
            }
            Step::Alive => return self.rig.core.handle(now, LineInput::PathAlive(MQTT.owner)),
            Step::Trip | Step::Clear | Step::HoldBack(_) => {}
        }
        let Some(drive) = self.rig.bus.drive_mut(Station(1)) else {
            return;
        };
        match step {
            Step::Trip => drive.trip(now, 2),
            Step::Clear => drive.clear_trip(now, None),
            Step::HoldBack(is_held_back) => drive.hold_back(now, is_held_back),
            _ => {}
        }
    }

    /// Lets time pass, and looks at the drive whenever a run word leaves.
    fn pass(&mut self, time: Duration) {
        let until = self.rig.now + time;
        while self.rig.now < until {
            let before = self.rig.sent.len();
            self.rig.step(until);
            let has_run = self.rig.sent[before..]
                .iter()
                .any(|sent| sent.pdu == [6, 0x20, 0, 0, 1]);
            let drive = self.rig.bus.drive_mut(Station(1));
            let held = drive
                .filter(|drive| drive.is_powered())
                .and_then(|drive| drive.word(DIRECTION.into()));
            // A drive that has just lost its power may have lost the direction with it.
            if has_run
                && held.is_some()
                && self.rig.now.since(self.power_at) > Duration::from_secs(10)
            {
                let given = self
                    .writes()
                    .into_iter()
                    .rev()
                    .find(|write| write.1 == DIRECTION)
                    .map(|write| write.2);
                self.directions.push((held, given));
            }
        }
    }

    /// The drive is let go while a client keeps control: what it does then, it was ordered.
    fn let_go(&mut self) {
        self.rig.bus.set_faults(FaultPlan::NONE);
        let now = self.rig.now;
        self.rig.bus.set_powered(now, Station(1), true);
        self.rig.live(Duration::from_secs(7));
        self.take(Step::Clear);
        let is_at_rest = self.rig.output(1) == 0;
        self.take(Step::HoldBack(false));
        self.rig.live(Duration::from_secs(3));
        // A start that was told as failed, or not at all.
        let runs = self
            .given
            .iter()
            .rev()
            .find(|(.., order)| matches!(order, Order::Go(go) if go.run().is_some()));
        let told = runs.and_then(|(ticket, ..)| self.rig.told(*ticket).last().copied());
        let is_ordered = matches!(told, Some((Outcome::Confirmed | Outcome::Acknowledged, ..)));
        self.moved_late = is_at_rest && !is_ordered && self.rig.output(1) != 0;
    }

    /// Nobody is left who commands, and everything works again.
    fn calm_down(&mut self) {
        self.rig.swallows = None;
        self.rig.bus.set_faults(FaultPlan::NONE);
        let now = self.rig.now;
        self.rig.bus.set_powered(now, Station(1), true);
        self.rig.pass(Duration::from_secs(60));
        self.take(Step::Clear);
        self.take(Step::HoldBack(false));
        self.rig.pass(Duration::from_secs(20));
    }

    /// When each word was written, and to which register.
    fn writes(&self) -> Vec<(MonoTime, u16, u16)> {
        let writes = self.rig.sent.iter().filter(|sent| sent.pdu[0] == 6);
        let word = |pdu: &[u8], at: usize| u16::from_be_bytes([pdu[at], pdu[at + 1]]);
        writes
            .map(|sent| (sent.at, word(&sent.pdu, 1), word(&sent.pdu, 3)))
            .collect()
    }

    fn check(&mut self, moves: impl Fn(u16, u16) -> bool) -> Result<(), TestCaseError> {
        for (ticket, _, order) in &self.given {
            let ends = self
                .rig
                .told(*ticket)
                .iter()
                .filter(|(.., is_final)| *is_final)
                .count();
            prop_assert_eq!(ends, 1, "{:?}: {:?}", order, self.rig.told(*ticket));
        }
        let writes = self.writes();
        for (ticket, at, order) in &self.given {
            let told = self
                .rig
                .reports
                .iter()
                .filter(|(_, answer)| answer.ticket == *ticket);
            let until = told
                .filter(|(_, answer)| answer.report.outcome == Outcome::Confirmed)
                .map(|(at, _)| *at)
                .next();
            let Some(until) = until.filter(|_| order.is_stop()) else {
                continue;
            };
            let after = writes.iter().find(|(sent, register, word)| {
                sent > at && *sent < until && moves(*register, *word)
            });
            prop_assert!(
                after.is_none(),
                "{:?} between a stop at {:?} and its effect at {:?}",
                after,
                at,
                until
            );
        }
        let was_dropped = self
            .rig
            .notes
            .iter()
            .any(|(_, note)| matches!(note, DriveNote::StopDropped));
        let output = self.rig.output(1);
        prop_assert!(
            was_dropped || output == 0,
            "it turns at {}: {:04X?}",
            output,
            writes
        );
        prop_assert!(
            self.rig
                .view(0)
                .control
                .is_some_and(|control| !control.command_pending)
        );
        Ok(())
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 60, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn no_run_word_is_sent_without_its_direction_and_no_reset_stands(
        seed in any::<u64>(), steps in prop::collection::vec(step(), 1..50)
    ) {
        let mut observed = Observed::new(APART, seed);
        observed.take(Step::Command(0, Order::Stop { setpoint: None }));
        observed.take(Step::Pass(4000));
        steps.into_iter().for_each(|step| observed.take(step));
        observed.calm_down();
        observed.check(|register, word| (register, word) == (RUN, 1) || register == DIRECTION)?;
        prop_assert!(observed.directions.iter().all(|(held, given)| held == given), "{:?}", observed.directions);
        let writes = observed.writes();
        for (at, _) in writes.iter().enumerate().filter(|(_, (_, register, word))| (*register, *word) == (RUN, 1)) {
            let before = at.checked_sub(1).map(|before| writes[before].1);
            prop_assert_eq!(before, Some(DIRECTION), "{:?}", &writes[..=at]);
        }
        let held = observed.rig.bus.drive_mut(Station(1)).and_then(|drive| drive.word(RESET.into()));
        prop_assert_eq!(held, Some(0), "{:?}", writes);
    }

    #[test]
    fn no_start_is_left_standing(
        seed in any::<u64>(), steps in prop::collection::vec(step(), 1..50), start in order(), wait in 0..6000_u64
    ) {
        let mut observed = Observed::new(IN_WORDS, seed);
        observed.take(Step::Command(0, Order::Stop { setpoint: None }));
        observed.take(Step::Pass(4000));
        steps.into_iter().for_each(|step| observed.take(step));
        // Whatever went before, the last start meets a drive that is not ready.
        observed.take(Step::HoldBack(true));
        observed.take(Step::Command(0, start));
        observed.take(Step::Pass(wait));
        observed.let_go();
        prop_assert!(!observed.moved_late, "nobody ordered it: {:04X?}", observed.writes());
        observed.calm_down();
        observed.check(|register, word| register == RUN && (RUNS.contains(&word) || word == FIRST))?;
        let held = observed.rig.bus.drive_mut(Station(1)).and_then(|drive| drive.word(RUN.into()));
        prop_assert!(held.is_some_and(|word| !RUNS.contains(&word)), "{:04X?}: {:04X?}", held, observed.writes());
        // Each word of a start follows the one before, unless the drive runs.
        let words: Vec<_> = observed.writes().into_iter().filter(|it| it.1 == RUN).map(|it| it.2).collect();
        let starts = words.windows(2).filter(|pair| RUNS.contains(&pair[1]) && !RUNS.contains(&pair[0]));
        for pair in starts {
            prop_assert_eq!(pair[0], SECOND, "{:04X?}", words);
        }
    }
}
