//! Every attempt to write is accounted for exactly once: in one row, with one end that equals what was reported to its
//! client.

use super::checker::tables::Kind;
use super::trials::reads;
use super::world::World;
use fastrand::Rng;
use std::collections::HashMap;
use std::net::{IpAddr, Ipv4Addr};
use std::time::Duration;
use vfd_gateway::domain::command::{
    CommandRequest, Direction, GoOrder, Order, OrderManner, Origin, Owner, Report, Rights,
};
use vfd_gateway::domain::frequency::Hertz;
use vfd_gateway::domain::ids::{AskerId, CommanderName, DriveIndex, Ticket};
use vfd_gateway::domain::native::{NativeAsk, NativeRequest};
use vfd_gateway::domain::time::MonoTime;
use vfd_gateway::gateway::{LineEffect, LineInput};
use vfd_gateway::journal::{EntryToKeep, JournalEntry};
use vfd_gateway::sim::FaultPlan;

/// The receiver of the line's rows.
type Sink<'s> = &'s mut dyn FnMut(EntryToKeep);

/// The state of the attempts.
struct Books<'s> {
    sink: Sink<'s>,
    /// The attempt that belongs to a ticket, and its end.
    attempts: HashMap<u64, (u64, Option<Report>)>,
    /// Tickets with a final report.
    told: HashMap<u64, Report>,
    /// The attempts of this round, with their ends if they have any yet.
    said: Vec<(u64, Option<Report>)>,
    of_attempt: HashMap<u64, u64>,
    rows: u64,
}

/// Makes `count` write attempts. Returns how many were accounted for and how many of them were refused.
///
/// # Errors
/// Which attempt is missing, duplicate, or was reported differently.
pub fn audit(seed: u64, count: u64) -> Result<(u64, u64), String> {
    audit_into(seed, count, &mut drop)
}

/// The same, with `sink` as the receiver of the line's rows.
///
/// # Errors
/// The same.
pub fn audit_into(seed: u64, count: u64, sink: Sink<'_>) -> Result<(u64, u64), String> {
    let mut rng = Rng::with_seed(seed);
    let kind = Kind::ALL[rng.usize(0..3)];
    let faults = FaultPlan {
        lost: rng.u16(0..30),
        cut: rng.u16(0..20),
        ..FaultPlan::NONE
    };
    let mut plan = reads(2, kind, 0, faults);
    plan.keeps = true;
    let mut world = World::with(plan, Rng::with_seed(rng.u64(..)));
    world.bus.set_faults(faults);
    let attempts = HashMap::new();
    let told = HashMap::new();
    let of_attempt = HashMap::new();
    let mut books = Books {
        sink,
        attempts,
        told,
        said: Vec::new(),
        of_attempt,
        rows: 0,
    };
    let wrong = |text: String| format!("O14, seed {seed}: {text}");
    for ticket in 1..=count {
        let is_native = give(&mut world, &mut rng, ticket);
        drain(&mut world, &mut books).map_err(wrong)?;
        let said = std::mem::take(&mut books.said);
        match said[..] {
            [(attempt, end)] => {
                books.attempts.insert(ticket, (attempt, end));
                books.of_attempt.insert(attempt, ticket);
            }
            // An unchanged register is not an attempt.
            [] if is_native => {}
            _ => {
                return Err(wrong(format!(
                    "ticket {ticket} is said {} times",
                    said.len()
                )));
            }
        }
        let pause = [0, 1, 5, 20, 100, 400][rng.usize(0..6)];
        pass(&mut world, &mut books, Duration::from_millis(pause)).map_err(wrong)?;
        if ticket % 4_000 == 0 {
            pass(&mut world, &mut books, Duration::from_secs(60)).map_err(wrong)?;
            books.settle().map_err(wrong)?;
        }
    }
    pass(&mut world, &mut books, Duration::from_secs(60)).map_err(wrong)?;
    world.core.end_attempts(world.now);
    drain(&mut world, &mut books).map_err(wrong)?;
    books.settle().map_err(wrong)?;
    Ok((books.rows, count))
}

impl Books<'_> {
    fn note(&mut self, entry: &JournalEntry) -> Result<(), String> {
        match entry {
            JournalEntry::Attempt(attempt) => {
                self.rows += 1;
                self.said.push((attempt.id.0, attempt.report));
            }
            JournalEntry::Ended { attempt, report } => {
                let said = self
                    .said
                    .iter_mut()
                    .find(|(id, _)| *id == attempt.0)
                    .map(|(_, end)| end);
                let ticket = self.of_attempt.get(&attempt.0);
                let known = ticket
                    .and_then(|ticket| self.attempts.get_mut(ticket))
                    .map(|(_, end)| end);
                match said.or(known) {
                    Some(end @ None) => *end = Some(*report),
                    other => {
                        return Err(format!(
                            "{attempt:?} ends with {report:?}, before: {other:?}"
                        ));
                    }
                }
            }
            _ => {}
        }
        Ok(())
    }

    /// Checks that every attempt has its end, equal to what was reported. Settled ones are removed.
    fn settle(&mut self) -> Result<(), String> {
        for (ticket, (attempt, end)) in self.attempts.drain() {
            let end = end.ok_or(format!("attempt {attempt} of ticket {ticket} has no end"))?;
            // A client that writes registers gets one report, at the acknowledgement: what follows is in the journal
            // only.
            if let Some(told) = self.told.get(&ticket)
                && *told != end
            {
                return Err(format!(
                    "ticket {ticket} was told {told:?}, its row says {end:?}"
                ));
            }
        }
        self.told.clear();
        self.of_attempt.clear();
        Ok(())
    }
}

/// Makes a write attempt. Returns whether it is for a register of the drive.
fn give(world: &mut World, rng: &mut Rng, ticket: u64) -> bool {
    let owner = match rng.u8(0..6) {
        0 | 1 => Owner::Mqtt,
        2 => Owner::MqttBy(CommanderName::new("panel").expect("a name")),
        who => Owner::ModbusTcp(IpAddr::V4(Ipv4Addr::new(10, 0, 0, who))),
    };
    let rights = Rights {
        write: rng.u8(0..20) > 0,
        stop: true,
    };
    let drive = DriveIndex(rng.u16(0..2));
    let facts = Kind::ALL
        .iter()
        .map(|kind| kind.facts())
        .nth(rng.usize(0..3))
        .expect("a kind");
    let asker = AskerId(7);
    if rng.u8(0..4) == 0 {
        let (address, value) = match rng.u8(0..4) {
            0 => (facts.run, rng.u16(0..9)),
            1 => (facts.setpoint, rng.u16(0..6_000)),
            2 => (facts.listed, rng.u16(10..80)),
            _ => (rng.u16(..), rng.u16(..)),
        };
        let ask = NativeAsk::Write {
            address: address.into(),
            values: vec![value],
        };
        let origin = Origin {
            owner,
            rights,
            manner: OrderManner::Cyclic,
        };
        let deadline = world.now + Duration::from_secs(5);
        let request = NativeRequest {
            asker,
            ticket: Ticket(ticket),
            drive,
            origin,
            ask,
            deadline,
        };
        world.core.handle(world.now, LineInput::Native(request));
        return true;
    }
    let direction = if rng.bool() {
        Direction::Forward
    } else {
        Direction::Reverse
    };
    let frequency = Some(Hertz::from_centihertz(rng.u16(300..6_000)));
    let go =
        |frequency, run| Order::Go(GoOrder::new(Vec::new(), frequency, run).expect("an order"));
    let order = match rng.u8(0..12) {
        0..3 => go(frequency, Some(direction)),
        3..8 => go(frequency, None),
        8 => go(None, Some(direction)),
        9 => Order::Reset,
        10 if rng.bool() => Order::Coast,
        _ => Order::Stop { setpoint: None },
    };
    let origin = Origin {
        owner,
        rights,
        manner: OrderManner::Once,
    };
    let start_before = world.now + Duration::from_millis(rng.u64(1..1_500));
    let issued = rng.bool().then_some(world.now);
    let (ticket, epoch, trial) = (Ticket(ticket), None, None);
    let command = CommandRequest {
        asker,
        ticket,
        drive,
        origin,
        order,
        start_before,
        issued,
        epoch,
        trial,
    };
    world.core.handle(world.now, LineInput::Command(command));
    false
}

fn pass(world: &mut World, books: &mut Books<'_>, time: Duration) -> Result<(), String> {
    let until = world.now + time;
    loop {
        world.core.handle(world.now, LineInput::Time);
        drain(world, books)?;
        if let Some(attempt) = books.said.first() {
            return Err(format!("attempt {attempt:?} is said without one"));
        }
        let wake = world
            .core
            .next_wake()
            .map_or(MonoTime::NEVER, |wake| wake.at);
        let next = wake.min(world.bus.next_due().unwrap_or(MonoTime::NEVER));
        if next > until {
            world.now = until;
            return Ok(());
        }
        world.now = world.now.max(next);
        let core = &mut world.core;
        world.bus.take_due(world.now, |at, bytes| {
            core.handle(at, LineInput::Bytes(bytes))
        });
    }
}

fn drain(world: &mut World, books: &mut Books<'_>) -> Result<(), String> {
    while let Some(effect) = world.core.next_effect() {
        match effect {
            LineEffect::Transmit(frame) => {
                world.bus.receive(world.now, &frame);
                world.core.transmitted(world.now);
            }
            LineEffect::Command(answer) if answer.is_final => {
                let before = books.told.insert(answer.ticket.0, answer.report);
                before.map_or(Ok(()), |before| {
                    Err(format!("{:?} was told before: {before:?}", answer.ticket))
                })?;
            }
            LineEffect::Keep(keep) => {
                books.note(&keep.entry)?;
                (books.sink)(keep);
            }
            _ => {}
        }
    }
    Ok(())
}
