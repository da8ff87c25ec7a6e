//! Whatever is commanded by whomever in whatever order on a bad line: an observer on the wire and of the reports finds
//! the promises kept.

use crate::support::{MQTT, ORIGIN, Rig, RigOptions, control, plc};
use proptest::prelude::*;
use std::collections::BTreeMap;
use std::time::Duration;
use vfd_gateway::domain::command::{
    Direction, GoOrder, Order, Origin, Outcome, RegisterWrite, Rights,
};
use vfd_gateway::domain::frequency::Hertz;
use vfd_gateway::domain::ids::{Station, Ticket};
use vfd_gateway::domain::report::LineFault;
use vfd_gateway::domain::time::MonoTime;
use vfd_gateway::gateway::{DriveNote, LineInput};
use vfd_gateway::sim::FaultPlan;

const RUN: u16 = 0x0002;
const FREQUENCY: u16 = 0x0004;
const RAMP: u16 = 0x020C;

#[derive(Clone, Debug)]
enum Step {
    Command(usize, Order),
    Pass(u64),
    Faults(usize),
    Trip,
    Power(bool),
    Alive,
    /// The connection breaks, and is back after this many milliseconds.
    Cut(u64),
}

/// What was commanded.
struct Given {
    at: MonoTime,
    order: Order,
}

fn origins() -> [Origin; 4] {
    let nobody = Origin {
        rights: Rights {
            write: false,
            stop: false,
        },
        ..plc(9)
    };
    [MQTT, ORIGIN, plc(1), nobody]
}

fn order() -> impl Strategy<Value = Order> {
    let go = |setpoint: Option<u16>, run: Option<Direction>, ramp: bool| {
        let ramp = if ramp {
            vec![RegisterWrite::new(RAMP, 30)]
        } else {
            Vec::new()
        };
        Order::Go(GoOrder::new(ramp, setpoint.map(Hertz::from_centihertz), run).expect("not empty"))
    };
    let direction = prop_oneof![Just(Direction::Forward), Just(Direction::Reverse)];
    prop_oneof![
        4 => prop::option::of(400..5200_u16).prop_map(|setpoint| Order::Stop { setpoint: setpoint.map(Hertz::from_centihertz) }),
        1 => Just(Order::Coast),
        2 => Just(Order::Reset),
        2 => Just(Order::Renew),
        6 => (prop::option::of(400..5200_u16), direction, any::<bool>()).prop_map(move |(setpoint, run, ramp)| go(setpoint, Some(run), ramp)),
        4 => (400..5200_u16).prop_map(move |setpoint| go(Some(setpoint), None, false)),
        1 => Just(go(None, None, true)),
    ]
}

fn step() -> impl Strategy<Value = Step> {
    prop_oneof![
        8 => (0..4_usize, order()).prop_map(|(who, order)| Step::Command(who, order)),
        6 => (1..3000_u64).prop_map(Step::Pass),
        1 => (0..4_usize).prop_map(Step::Faults),
        1 => Just(Step::Trip),
        1 => any::<bool>().prop_map(Step::Power),
        2 => Just(Step::Alive),
        1 => (0..1000_u64).prop_map(Step::Cut),
    ]
}

struct Observed {
    rig: Rig,
    plans: [&'static str; 4],
    given: BTreeMap<u64, Given>,
}

impl Observed {
    fn take(&mut self, step: Step) {
        let now = self.rig.now;
        match step {
            Step::Command(who, order) => {
                let ticket = self.rig.command(origins()[who], 0, order.clone());
                self.given.insert(ticket.0, Given { at: now, order });
            }
            Step::Pass(ms) => self.rig.pass(Duration::from_millis(ms)),
            Step::Faults(plan) => {
                self.rig
                    .bus
                    .set_faults(self.plans[plan].parse().expect("a plan"));
            }
            Step::Trip => {
                if let Some(drive) = self.rig.bus.drive_mut(Station(1)) {
                    drive.trip(now, 1);
                }
            }
            Step::Power(on) => self.rig.bus.set_powered(now, Station(1), on),
            Step::Alive => self.rig.core.handle(now, LineInput::PathAlive(MQTT.owner)),
            Step::Cut(ms) => {
                self.rig.close(LineFault::Gone);
                self.rig.pass(Duration::from_millis(ms));
                self.rig.open();
            }
        }
    }

    /// Orders that were accepted: neither refused nor expired nor overtaken before anything was sent.
    fn accepted(&self) -> Vec<(&Given, Ticket)> {
        let last = |ticket: Ticket| self.rig.told(ticket).last().map(|(outcome, ..)| *outcome);
        let accepted = self
            .given
            .iter()
            .map(|(number, given)| (given, Ticket(*number)));
        accepted
            .filter(|(_, ticket)| {
                !matches!(last(*ticket), Some(Outcome::Refused | Outcome::Expired))
            })
            .collect()
    }

    fn check(&self) -> Result<(), TestCaseError> {
        self.each_command_ends_once()?;
        self.each_write_was_ordered()?;
        self.nothing_moves_before_a_stop_is_effective()
    }

    fn each_command_ends_once(&self) -> Result<(), TestCaseError> {
        for (number, given) in &self.given {
            let told = self.rig.told(Ticket(*number));
            let ends = told.iter().filter(|(.., is_final)| *is_final).count();
            prop_assert_eq!(ends, 1, "{:?}: {:?}", given.order, told);
        }
        Ok(())
    }

    /// No write that nobody ordered, none more often than it was ordered, none outside the limits, none too late.
    fn each_write_was_ordered(&self) -> Result<(), TestCaseError> {
        let mut budget: BTreeMap<(u16, u16), Vec<MonoTime>> = BTreeMap::new();
        for (given, _) in self.accepted() {
            let Order::Go(go) = &given.order else {
                continue;
            };
            let run = go.run().map(|direction| {
                (
                    RUN,
                    if direction == Direction::Forward {
                        1
                    } else {
                        2
                    },
                )
            });
            let setpoint = go
                .frequency()
                .map(|hertz| (FREQUENCY, hertz.to_word(100).expect("a word")));
            let ramps = go
                .registers()
                .iter()
                .map(|write| (write.address.number(), write.value));
            for write in run.into_iter().chain(setpoint).chain(ramps) {
                budget.entry(write).or_default().push(given.at);
            }
        }
        for (given, _) in self.accepted() {
            if let Order::Stop {
                setpoint: Some(hertz),
            } = &given.order
            {
                budget
                    .entry((FREQUENCY, hertz.to_word(100).expect("a word")))
                    .or_default()
                    .push(given.at);
            }
        }
        for sent in self.rig.sent.iter().filter(|sent| sent.pdu[0] == 6) {
            let word = |at: usize| u16::from_be_bytes([sent.pdu[at], sent.pdu[at + 1]]);
            let (address, value) = (word(1), word(3));
            if address == RUN && matches!(value, 0 | 3 | 4) {
                continue;
            }
            if address == FREQUENCY {
                prop_assert!((500..=5000).contains(&value), "setpoint {}", value);
            }
            let times = budget.get_mut(&(address, value));
            let fits =
                |at: &MonoTime| *at <= sent.at && sent.at.since(*at) <= Duration::from_millis(1500);
            let found = times.as_ref().and_then(|times| times.iter().position(fits));
            prop_assert!(
                found.is_some(),
                "nobody ordered {:04X} = {} at {:?}",
                address,
                value,
                sent.at
            );
            if let (Some(times), Some(found)) = (times, found) {
                times.remove(found);
            }
        }
        Ok(())
    }

    /// From a stop's acceptance until it is effective, no frame starts that runs the motor or sets its speed.
    fn nothing_moves_before_a_stop_is_effective(&self) -> Result<(), TestCaseError> {
        for (given, ticket) in self.accepted() {
            if !matches!(given.order, Order::Stop { .. } | Order::Coast) {
                continue;
            }
            let confirmed = self.rig.reports.iter().find(|(_, answer)| {
                answer.ticket == ticket && answer.report.outcome == Outcome::Confirmed
            });
            let acts = self
                .rig
                .sent
                .iter()
                .any(|sent| sent.at >= given.at && sent.pdu.starts_with(&[6, 0, 2, 0]));
            let Some((until, _)) = confirmed.filter(|_| acts) else {
                continue;
            };
            let moves = |pdu: &[u8]| {
                let runs = pdu.starts_with(&[6, 0, 2, 0]) && matches!(pdu[4], 1 | 2);
                runs || pdu.starts_with(&[6, 0, 4])
            };
            let early = self
                .rig
                .sent
                .iter()
                .find(|sent| sent.at > given.at && sent.at < *until && moves(&sent.pdu));
            // A setpoint beside a stop that changes nothing is confirmed by its own write.
            let is_setpoint = matches!(given.order, Order::Stop { setpoint: Some(_) });
            prop_assert!(
                early.is_none() || is_setpoint,
                "{:02X?} before {:?}",
                early,
                given.order
            );
        }
        Ok(())
    }
}

/// Takes `steps`, waits until all is over, and checks the promises.
fn observe(
    options: &RigOptions,
    plans: [&'static str; 4],
    steps: Vec<Step>,
) -> Result<(), TestCaseError> {
    let mut observed = Observed {
        rig: Rig::new(options),
        plans,
        given: BTreeMap::new(),
    };
    for step in steps {
        observed.take(step);
    }
    observed.rig.bus.set_faults(FaultPlan::NONE);
    let now = observed.rig.now;
    observed.rig.bus.set_powered(now, Station(1), true);
    observed.rig.pass(Duration::from_secs(60));
    observed.check()?;
    // Every lease has ended: whatever was started here has been stopped.
    let was_stopped = !observed
        .rig
        .notes
        .iter()
        .any(|(_, note)| matches!(note, DriveNote::StopDropped));
    prop_assert!(
        !was_stopped || observed.rig.output(1) == 0,
        "it still turns"
    );
    prop_assert!(
        observed
            .rig
            .view(0)
            .control
            .is_some_and(|control| !control.command_pending)
    );
    Ok(())
}

fn options(seed: u64) -> RigOptions {
    RigOptions {
        control: Some(control()),
        seed,
        ..RigOptions::controlled()
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 200, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn the_promises_hold_whatever_is_commanded(seed in any::<u64>(), steps in prop::collection::vec(step(), 1..60)) {
        observe(&options(seed), ["", "lost=300", "late=300,flip=50", "noise=100,cut=100"], steps)?;
    }

    #[test]
    fn they_hold_over_modbus_tcp(seed in any::<u64>(), steps in prop::collection::vec(step(), 1..60)) {
        observe(&options(seed).modbus_tcp(), ["", "lost=300", "late=300,beyond=100", "twin=500,late=100"], steps)?;
    }
}
