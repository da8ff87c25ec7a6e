//! The sequence of a simulation: consumers, gateways one after the other, updates, messages still under way, and
//! cleaning up.

use super::Plan;
use super::board::{Board, Phase};
use super::cost::Cost;
use super::player::{self, Place, Role};
use crate::books::Balance;
use std::pin::{Pin, pin};
use std::sync::Arc;
use std::thread::JoinHandle;
use std::time::Duration;
use tokio::sync::Notify;
use tokio::time::sleep;
use vfd_gateway::daemon::host::clock;
use vfd_gateway::daemon::host::descriptors;
use vfd_gateway::daemon::mqtt::BrokerKeeps;
use vfd_gateway::daemon::service::signals::told_to_end;
use vfd_gateway::domain::time::MonoTime;

/// How often the progress is checked.
const LOOK_EVERY: Duration = Duration::from_millis(50);
/// Longest time for a consumer to be subscribed, and for the last gateways to be connected.
const CONNECTED_MAX: Duration = Duration::from_secs(60);
/// Between the last connection and the first update.
const PAUSE: Duration = Duration::from_millis(500);
/// Longest time for clearing retained messages.
const CLEARING_MAX: Duration = Duration::from_secs(60);
/// Descriptors other than connections of the fleet.
const OTHER_FILES: usize = 64;

/// The progress of a simulation, for display.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Progress {
    /// The present stage.
    pub stage: Stage,
    /// How much of it is done.
    pub done: u64,
    /// How much of it there is.
    pub all: u64,
    /// Everything so far.
    pub balance: Balance,
}

/// The present stage.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stage {
    /// Consumers subscribe.
    Subscribing,
    /// Gateways connect.
    Connecting,
    /// Updates are published; counted in seconds.
    Publishing,
    /// Messages under way arrive.
    Draining,
    /// Retained messages are cleared.
    Clearing,
}

/// The result of a simulation.
#[derive(Clone, Debug)]
pub struct Outcome {
    /// Seconds for which updates were sent.
    pub seconds: f64,
    /// It was interrupted.
    pub is_cut: bool,
    /// Updates that were due in that time.
    pub due: u64,
    /// The books when the last update was due.
    pub at_last: Balance,
    /// The books in the end.
    pub at_end: Balance,
    /// Messages received, including copies.
    pub received: u64,
    /// Updates received again.
    pub again: u64,
    /// Updates received after a newer one of their drive.
    pub late: u64,
    /// Messages that are not updates of this simulation.
    pub foreign: u64,
    /// Updates that the broker refused.
    pub refused: u64,
    /// Updates that were sent again after a reconnect.
    pub repeated: u64,
    /// Connections that the broker accepted.
    pub connections: u64,
    /// Of these: those that broke.
    pub broken: u64,
    /// From due to received: median, 99 %, maximum.
    pub delays: [Duration; 3],
    /// From due to acknowledged, likewise.
    pub acknowledgements: [Duration; 3],
    /// Memory at the end and busy processors, this process first.
    pub costs: Vec<(Cost, f64)>,
}

/// Simulates `plan` and reports the progress to `watch`. Returns by itself, or after an orderly end on SIGINT or
/// SIGTERM.
///
/// # Errors
/// Why it could not be simulated, as text.
pub fn run(plan: Plan, watch: impl FnMut(&Progress)) -> Result<Outcome, String> {
    let wanted = plan.gateways.len() + plan.consumers.len() + OTHER_FILES;
    let room = descriptors::room_for_connections();
    if room < wanted {
        return Err(format!(
            "{wanted} connections need more open files than the system allows here: raise `ulimit -n`"
        ));
    }
    let updates = plan.shape.updates_of_all();
    let board = Board::new(plan).ok_or_else(|| {
        format!("{updates} updates are more than can be booked: simulate fewer gateways, or for a shorter time")
    })?;
    let runtime = tokio::runtime::Builder::new_current_thread()
        .enable_all()
        .build();
    let runtime = runtime.map_err(|error| error.to_string())?;
    runtime.block_on(
        Simulation {
            board: Arc::new(board),
            bells: Vec::new(),
            threads: Vec::new(),
            watch,
        }
        .play(),
    )
}

struct Simulation<W> {
    board: Arc<Board>,
    bells: Vec<Arc<Notify>>,
    threads: Vec<JoinHandle<()>>,
    watch: W,
}

impl<W: FnMut(&Progress)> Simulation<W> {
    async fn play(mut self) -> Result<Outcome, String> {
        let mut told = pin!(told_to_end().map_err(|error| error.to_string())?);
        self.forget_sessions().await;
        let outcome = self.play_until(told.as_mut()).await;
        self.enter(Phase::Ending);
        let board = Arc::clone(&self.board);
        tokio::task::spawn_blocking(move || {
            self.threads.into_iter().for_each(|it| drop(it.join()))
        })
        .await
        .map_err(|error| error.to_string())?;
        forget_sessions(&board).await;
        outcome
    }

    async fn play_until<S: Future<Output = ()>>(
        &mut self,
        mut told: Pin<&mut S>,
    ) -> Result<Outcome, String> {
        let gateways = self.board.plan.gateways.len();
        let consumers = self.board.plan.consumers.len();
        self.start(Role::Consumer, consumers, 1)?;
        let subscribed = (Stage::Subscribing, consumers as u64, CONNECTED_MAX);
        self.wait_for_all(subscribed, |board| board.consumers.get(), told.as_mut())
            .await?;
        self.start(Role::Gateway, gateways, self.board.plan.threads)?;
        let ramp = Duration::from_secs_f64(
            gateways as f64 / f64::from(self.board.plan.connects_per_second.max(1)),
        );
        let connected = (Stage::Connecting, gateways as u64, ramp + CONNECTED_MAX);
        self.wait_for_all(connected, |board| board.gateways.get(), told.as_mut())
            .await?;

        let start = clock::now() + PAUSE;
        let costs = self.costs();
        self.enter(Phase::Publishing(start));
        tracing::info!(gateways, consumers, "fleet is publishing");
        let is_cut = self.publish(start, told.as_mut()).await;
        let span = clock::now().since(start);
        let at_last = self.board.ledger.balance();
        let costs = with_shares(costs, &self.costs(), span);
        self.enter(Phase::Draining);
        self.drain().await;
        let outcome = self.outcome((span, is_cut), at_last, costs);
        self.clear().await;
        Ok(outcome)
    }

    /// Starts `count` clients on `threads` threads.
    fn start(&mut self, role: Role, count: usize, threads: usize) -> Result<(), String> {
        let threads = threads.clamp(1, count.max(1));
        let all: Vec<_> = (0..count)
            .map(|number| Place {
                role,
                number,
                bell: Arc::new(Notify::new()),
            })
            .collect();
        self.bells
            .extend(all.iter().map(|place| Arc::clone(&place.bell)));
        for thread in 0..threads {
            let own = all
                .iter()
                .filter(|place| place.number % threads == thread)
                .cloned()
                .collect();
            let started = player::thread(Arc::clone(&self.board), own);
            self.threads
                .push(started.map_err(|error| format!("cannot start a thread: {error}"))?);
        }
        Ok(())
    }

    fn enter(&self, phase: Phase) {
        self.board.enter(phase);
        self.bells.iter().for_each(|bell| bell.notify_one());
    }

    fn tell(&mut self, stage: Stage, done: u64, all: u64) {
        let balance = self.board.ledger.balance();
        (self.watch)(&Progress {
            stage,
            done,
            all,
            balance,
        });
    }

    async fn wait_for_all<S: Future<Output = ()>>(
        &mut self,
        (stage, all, longest): (Stage, u64, Duration),
        count: impl Fn(&Board) -> u64,
        mut told: Pin<&mut S>,
    ) -> Result<(), String> {
        let end = clock::now() + longest;
        loop {
            let done = count(&self.board);
            self.tell(stage, done, all);
            if let Some(failure) = self.board.failure() {
                return Err(failure);
            }
            if done >= all {
                return Ok(());
            }
            if clock::now() >= end {
                let who = if stage == Stage::Subscribing {
                    "consumers are subscribed"
                } else {
                    "gateways are connected"
                };
                let reason = self
                    .board
                    .reason()
                    .map(|reason| format!(": {reason}"))
                    .unwrap_or_default();
                return Err(format!(
                    "only {done} of {all} {who} after {} s{reason}",
                    longest.as_secs()
                ));
            }
            tokio::select! {
                () = sleep(LOOK_EVERY) => {}
                () = told.as_mut() => return Err("ended before the first update".to_owned()),
            }
        }
    }

    /// Waits until the last update is due. Returns whether it was interrupted.
    async fn publish<S: Future<Output = ()>>(
        &mut self,
        start: MonoTime,
        mut told: Pin<&mut S>,
    ) -> bool {
        let lasts = self.board.plan.shape.lasts();
        let mut shown = None;
        loop {
            let passed = clock::now().since(start);
            if shown != Some(passed.as_secs()) {
                shown = Some(passed.as_secs());
                self.tell(Stage::Publishing, passed.as_secs(), lasts.as_secs());
            }
            if clock::now() >= start + lasts {
                return false;
            }
            tokio::select! {
                () = sleep(LOOK_EVERY.min((start + lasts).since(clock::now()))) => {}
                () = told.as_mut() => return true,
            }
        }
    }

    /// Waits until everything has arrived, or it takes too long.
    async fn drain(&mut self) {
        let end = clock::now() + self.board.plan.drain;
        while clock::now() < end {
            let balance = self.board.ledger.balance();
            let has_consumers = !self.board.plan.consumers.is_empty();
            let is_acknowledged = self.board.plan.qos
                == vfd_gateway::north::broker::Qos::AtMostOnce
                || balance.acknowledged + self.board.refused.get() >= balance.sent;
            let arrived = if has_consumers {
                balance.received
            } else {
                balance.sent
            };
            self.tell(Stage::Draining, arrived, balance.sent);
            if is_acknowledged && arrived >= balance.sent {
                return;
            }
            sleep(LOOK_EVERY).await;
        }
    }

    /// The consumers stay until the end: clearing messages have no mark, so they ignore them.
    async fn clear(&mut self) {
        self.enter(Phase::Clearing);
        let end = clock::now() + CLEARING_MAX;
        let of_consumers = usize::from(!self.board.plan.consumers.is_empty());
        let all = self.board.plan.gateways.len() as u64;
        while clock::now() < end
            && !self
                .threads
                .iter()
                .skip(of_consumers)
                .all(JoinHandle::is_finished)
        {
            self.tell(Stage::Clearing, 0, all);
            sleep(LOOK_EVERY).await;
        }
    }

    fn costs(&self) -> Vec<Cost> {
        let own = std::process::id();
        [own]
            .iter()
            .chain(&self.board.plan.watched)
            .filter_map(|process| Cost::of(*process))
            .collect()
    }

    fn outcome(
        &self,
        (span, is_cut): (Duration, bool),
        at_last: Balance,
        costs: Vec<(Cost, f64)>,
    ) -> Outcome {
        let board = &self.board;
        let shape = &self.board.plan.shape;
        let share = span.as_secs_f64() / shape.lasts().as_secs_f64().max(f64::EPSILON);
        let shares = |delays: &crate::books::Delays| {
            [delays.within(500), delays.within(990), delays.longest()]
        };
        Outcome {
            seconds: span.as_secs_f64(),
            is_cut,
            due: (shape.updates_of_all() as f64 * share.min(1.0)).round() as u64,
            at_last,
            at_end: board.ledger.balance(),
            received: board.received.get(),
            again: board.again.get(),
            late: board.late.get(),
            foreign: board.foreign.get(),
            refused: board.refused.get(),
            repeated: board.repeated.get(),
            connections: board.connections.get(),
            broken: board.broken.get(),
            delays: shares(&board.delays),
            acknowledgements: shares(&board.acknowledgements),
            costs,
        }
    }

    async fn forget_sessions(&self) {
        forget_sessions(&self.board).await;
    }
}

/// Makes the broker forget the sessions that it keeps for the consumers.
async fn forget_sessions(board: &Board) {
    for settings in board
        .plan
        .consumers
        .iter()
        .filter(|settings| settings.keeps == BrokerKeeps::Session)
    {
        player::forget(settings.clone()).await;
    }
}

/// Each cost with its share of the processors since the first look.
fn with_shares(before: Vec<Cost>, after: &[Cost], span: Duration) -> Vec<(Cost, f64)> {
    let share = |before: Cost| {
        let after = after.iter().find(|after| after.process == before.process)?;
        Some((after.clone(), after.processors_since(&before, span)))
    };
    before.into_iter().filter_map(share).collect()
}
