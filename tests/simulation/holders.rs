//! All owners of the drives of a line vanish at once.

use super::checker::tables::Kind;
use super::plan::model_of;
use super::trials::reads;
use super::world::World;
use fastrand::Rng;
use std::net::{IpAddr, Ipv4Addr};
use std::time::Duration;
use vfd_gateway::domain::command::{
    CommandRequest, Direction, GoOrder, Order, OrderManner, Origin, Owner, Rights,
};
use vfd_gateway::domain::frequency::Hertz;
use vfd_gateway::domain::ids::{AskerId, DriveIndex, Ticket};
use vfd_gateway::domain::time::MonoTime;
use vfd_gateway::gateway::{LineEffect, LineInput};
use vfd_gateway::sim::FaultPlan;

/// Drives of one line.
pub const DRIVES: u8 = 32;

/// One line whose drives all run, each by the order of another holder; then all stop responding at the same moment.
/// Returns how many holders there were, the longest wait from the end of a lease to the first bit of the frame that
/// stops its drive, and the bound that is printed.
///
/// # Errors
/// Which frame was sent too late.
pub fn holders(seed: u64) -> Result<(u64, Duration, Duration), String> {
    let mut rng = Rng::with_seed(seed);
    let kind = Kind::ALL[rng.usize(0..3)];
    let mut plan = reads(DRIVES, kind, 0, FaultPlan::NONE);
    plan.line
        .drives
        .iter_mut()
        .for_each(|drive| drive.lost_after = 30_000_000_000);
    let bounds = plan.setup(1).stop_bounds();
    let facts = kind.facts();
    let stop = model_of(kind)
        .run
        .as_ref()
        .map(|run| run.stop.value)
        .expect("it can be stopped");
    let mut line = Line {
        world: World::with(plan, rng),
        ticket: 0,
        stops: Vec::new(),
        run: facts.run,
        stop,
    };
    line.pass(Duration::from_secs(20));
    for drive in 0..u16::from(DRIVES) {
        let run = GoOrder::new(
            Vec::new(),
            Some(Hertz::from_centihertz(3_000)),
            Some(Direction::Forward),
        )
        .expect("an order");
        line.order(drive, Order::Go(run));
        line.pass(Duration::from_millis(600));
    }
    (0..u16::from(DRIVES)).for_each(|drive| line.order(drive, Order::Renew));
    let lost_at = line.world.now + Duration::from_secs(30);
    line.stops.clear();
    line.pass(Duration::from_secs(60));
    let mut worst = Duration::ZERO;
    let most = bounds.all_healthy + bounds.each_further * u32::from(DRIVES - 1);
    for station in line
        .world
        .plan
        .line
        .drives
        .iter()
        .map(|drive| drive.station)
    {
        let is_for = |to: u8| to == station || Some(to) == line.world.plan.line.broadcast();
        let first = line
            .stops
            .iter()
            .find(|(_, to)| is_for(*to))
            .ok_or(format!("seed {seed}: {station} runs on"))?;
        let waited = first.0.since(lost_at);
        if first.0 < lost_at || waited > most {
            return Err(format!(
                "seed {seed}: station {station} after {waited:?}, {most:?} are printed"
            ));
        }
        worst = worst.max(waited);
    }
    Ok((u64::from(DRIVES), worst, most))
}

struct Line {
    world: World,
    ticket: u64,
    stops: Vec<(MonoTime, u8)>,
    run: u16,
    stop: u16,
}

impl Line {
    fn order(&mut self, drive: u16, order: Order) {
        self.ticket += 1;
        let world = &mut self.world;
        let owner = Owner::ModbusTcp(IpAddr::V4(Ipv4Addr::new(10, 9, 0, drive as u8)));
        let origin = Origin {
            owner,
            rights: Rights {
                write: true,
                stop: true,
            },
            manner: OrderManner::Once,
        };
        let command = CommandRequest {
            asker: AskerId(1_000),
            ticket: Ticket(self.ticket),
            drive: DriveIndex(drive),
            origin,
            order,
            start_before: world.now + Duration::from_secs(1),
            issued: Some(world.now),
            epoch: None,
            trial: None,
        };
        world.core.handle(world.now, LineInput::Command(command));
    }

    /// Lets time pass and notes stop frames. The checker is not used: it does not know the orders.
    fn pass(&mut self, time: Duration) {
        let until = self.world.now + time;
        loop {
            let world = &mut self.world;
            world.core.handle(world.now, LineInput::Time);
            while let Some(effect) = world.core.next_effect() {
                if let LineEffect::Transmit(frame) = effect {
                    let word = |at: usize| u16::from_be_bytes([frame[at], frame[at + 1]]);
                    if frame[1] == 6 && (word(2), word(4)) == (self.run, self.stop) {
                        self.stops.push((world.now, frame[0]));
                    }
                    world.bus.receive(world.now, &frame);
                    world.core.transmitted(world.now);
                }
            }
            let wake = world
                .core
                .next_wake()
                .map_or(MonoTime::NEVER, |wake| wake.at);
            let next = wake.min(world.bus.next_due().unwrap_or(MonoTime::NEVER));
            if next > until {
                world.now = until;
                return;
            }
            world.now = world.now.max(next);
            let core = &mut world.core;
            world.bus.take_due(world.now, |at, bytes| {
                core.handle(at, LineInput::Bytes(bytes))
            });
        }
    }
}
