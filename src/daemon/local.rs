//! Requests of the program's own tools and the page to the lines, and the answers.

use crate::daemon::exchange::answers::{AnswerBox, LineNews};
use crate::daemon::exchange::inbox::{InboxFull, LineMessage};
use crate::daemon::exchange::keeper::AttemptKeeper;
use crate::daemon::exchange::north_journal::Journal;
use crate::daemon::exchange::reload_request::{ReloadRequests, Reloaded};
use crate::daemon::exchange::shared::{CurrentPlant, SharedPlant};
use crate::daemon::host::clock;
use crate::daemon::host::stall::LastStalls;
use crate::domain::address::Address;
use crate::domain::command::{
    CommandRequest, Order, OrderManner, Origin, Outcome, Owner, Reason, Report, Rights,
};
use crate::domain::control::ControlAction;
use crate::domain::ids::{AskerId, CommanderName, Ticket};
use crate::domain::native::{NativeAsk, NativeOutcome, NativeRefusal, NativeRequest};
use crate::domain::time::MonoTime;
use crate::drive::description::DriveRef;
use crate::guard::COMMAND_DEADLINE;
use crate::journal::TriedWrite;
use std::collections::HashMap;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;
use tokio::sync::{OwnedSemaphorePermit, Semaphore, oneshot};
use tokio::time::{Instant, timeout_at};

/// Most tools that are served at once; a person has one or two.
pub const TOOLS_MAX: usize = 4;
/// The line ends every read by its deadline. This much later no answer is expected any more.
const LATE: Duration = Duration::from_secs(1);
/// How often a drive that is busy is asked again, and how long it is left alone before.
const BUSY_READS_MAX: usize = 8;
const BUSY_REST: Duration = Duration::from_millis(250);
/// Longest duration of a command that has begun: several slow writes, each read back.
const COMMAND_WITHIN: Duration = Duration::from_secs(15);

/// Who orders something.
#[derive(Clone, Copy, Debug)]
pub struct OrderingClient {
    asker: AskerId,
    origin: Origin,
}

impl OrderingClient {
    /// A tool: any process that may open the socket. Its orders take no lease, so it needs no right to stop.
    pub const TOOL: Self = Self {
        asker: AskerId::LOCAL,
        origin: Origin {
            owner: Owner::Local,
            rights: Rights {
                write: true,
                stop: false,
            },
            manner: OrderManner::Once,
        },
    };

    /// A person who qualifies a drive by a tool: the same, but a motor that runs in a trial is leased and stopped.
    pub const TRIAL: Self = Self {
        asker: AskerId::LOCAL,
        origin: Origin {
            owner: Owner::Local,
            rights: Rights {
                write: true,
                stop: true,
            },
            manner: OrderManner::Once,
        },
    };

    /// The user who is signed in as `user` on the page.
    #[must_use]
    pub const fn signed_in(user: CommanderName) -> Self {
        let rights = Rights {
            write: true,
            stop: true,
        };
        Self {
            asker: AskerId::PAGE,
            origin: Origin {
                owner: Owner::Page(user),
                rights,
                manner: OrderManner::Once,
            },
        }
    }

    /// The owner of what this person or program orders.
    #[must_use]
    pub const fn owner(&self) -> Owner {
        self.origin.owner
    }
}

/// What a command carries besides its order.
#[derive(Clone, Copy, Debug, Default)]
pub struct CommandMarks {
    /// The drive's epoch as the sender last saw it.
    pub epoch: Option<u64>,
    /// The unproven action that it tries.
    pub trial: Option<ControlAction>,
}

/// The path of the tools and the page to all lines.
#[derive(Debug)]
pub struct LocalSide {
    current: CurrentPlant,
    reloads: Option<ReloadRequests>,
    keeper: AttemptKeeper,
    last: AtomicU64,
    waiting: Mutex<HashMap<Ticket, oneshot::Sender<LineNews>>>,
    places: Arc<Semaphore>,
    stalls: Arc<LastStalls>,
}

/// Why a line cannot be asked.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum LineUnavailable {
    /// Its inbox is full or closed.
    Full,
    /// There is no such line.
    Line,
}

/// The outcome of an order without an answer.
const NOT_ANSWERED: Report = Report::new(Outcome::Unknown, Reason::NoReply);

impl LocalSide {
    /// A side without waiting requests.
    #[must_use]
    pub fn new(current: impl Into<CurrentPlant>, reloads: Option<ReloadRequests>) -> Self {
        let places = Arc::new(Semaphore::new(TOOLS_MAX));
        let last = AtomicU64::new(0);
        let waiting = Mutex::default();
        let keeper = AttemptKeeper::default();
        let stalls = Arc::default();
        Self {
            current: current.into(),
            reloads,
            keeper,
            last,
            waiting,
            places,
            stalls,
        }
    }

    /// This side with `stalls`: right after a stall it accepts only stops.
    #[must_use]
    pub fn with_stalls(self, stalls: Arc<LastStalls>) -> Self {
        Self { stalls, ..self }
    }

    /// This side with a journal for attempts that reach no line.
    #[must_use]
    pub fn keeping(self, journal: Journal) -> Self {
        Self {
            keeper: AttemptKeeper::new(journal),
            ..self
        }
    }

    /// Keeps what was tried and refused here. `drive` is `None` if it was for all drives or for one that does not
    /// exist.
    pub fn keep(
        &self,
        who: OrderingClient,
        drive: Option<DriveRef>,
        tried: TriedWrite,
        report: Report,
    ) {
        self.keeper.keep(drive, who.owner(), tried, report);
    }

    /// Lines and drives.
    #[must_use]
    pub fn shared(&self) -> Arc<SharedPlant> {
        self.current.get()
    }

    /// Reloads the configuration, and waits for the outcome.
    ///
    /// # Errors
    /// Why everything stays as it was.
    pub async fn reload(&self) -> Reloaded {
        match &self.reloads {
            Some(reloads) => reloads.ask().await,
            None => Err(crate::daemon::exchange::reload_request::ReloadRefusal::NoFile),
        }
    }

    /// A place for one tool while it is served; `None` if [`TOOLS_MAX`] are.
    #[must_use]
    pub fn place(&self) -> Option<OwnedSemaphorePermit> {
        Arc::clone(&self.places).try_acquire_owned().ok()
    }

    /// Passes the answers of the lines to those who wait, until the task is dropped.
    pub async fn distribute(self: Arc<Self>, answers: Arc<AnswerBox>) {
        let mut batch = Vec::new();
        loop {
            answers.fetch(&mut batch).await;
            let mut waiting = self.lock();
            for news in batch.drain(..) {
                let ticket = match &news {
                    LineNews::Native(answer) => answer.ticket,
                    LineNews::Command(answer) if answer.is_final => answer.ticket,
                    LineNews::Command(_) | LineNews::Trip(..) | LineNews::Events { .. } => continue,
                };
                if let Some(asked) = waiting.remove(&ticket) {
                    // The receiver may be gone.
                    let _ = asked.send(news);
                }
            }
        }
    }

    /// Reads the register at `address` of the drive at `place` now, by an exchange of its own. A drive that is busy is asked
    /// again.
    ///
    /// # Errors
    /// Why there is no word, as of a command that ended so.
    pub async fn read(
        &self,
        place: DriveRef,
        address: Address,
        deadline: MonoTime,
    ) -> Result<u16, Report> {
        let words = self.read_words(place, address, 1, deadline).await?;
        words
            .first()
            .copied()
            .ok_or(Report::refused(Reason::NoReply))
    }

    /// Reads `count` words from `address` on. A drive that is busy is asked again, while there is time.
    ///
    /// # Errors
    /// Why they could not be read.
    pub async fn read_words(
        &self,
        place: DriveRef,
        address: Address,
        count: u16,
        deadline: MonoTime,
    ) -> Result<Vec<u16>, Report> {
        for _ in 0..BUSY_READS_MAX {
            match self.read_once(place, address, count, deadline).await {
                Err(Report {
                    reason: Reason::DriveBusy,
                    ..
                }) if clock::now() + BUSY_REST < deadline => {
                    tokio::time::sleep(BUSY_REST).await;
                }
                ended => return ended,
            }
        }
        self.read_once(place, address, count, deadline).await
    }

    async fn read_once(
        &self,
        place: DriveRef,
        address: Address,
        count: u16,
        deadline: MonoTime,
    ) -> Result<Vec<u16>, Report> {
        let ask = NativeAsk::Read { address, count };
        let request = |ticket| {
            let OrderingClient { asker, origin } = OrderingClient::TOOL;
            LineMessage::Native(NativeRequest {
                asker,
                ticket,
                drive: place.drive,
                origin,
                ask,
                deadline,
            })
        };
        let outcome = match self.put(place, deadline.since(clock::now()) + LATE, request) {
            Ok(asked) => match asked.answer().await {
                Some(LineNews::Native(answer)) => answer.outcome,
                _ => NativeOutcome::NoReply,
            },
            Err(LineUnavailable::Full) => NativeOutcome::Refused(NativeRefusal::QueueFull),
            Err(LineUnavailable::Line) => NativeOutcome::NoReply,
        };
        match outcome {
            NativeOutcome::Words(words) => Ok(words.to_vec()),
            outcome => Err(outcome.read_failure()),
        }
    }

    /// Sends an order to the drive at `place`, and waits for its outcome.
    pub async fn command(&self, who: OrderingClient, place: DriveRef, order: Order) -> Report {
        self.order(who, place, order).end().await
    }

    /// Sends an order to the drive at `place` at once. Dropping the result does not cancel the order.
    pub fn order(&self, who: OrderingClient, place: DriveRef, order: Order) -> SentOrder<'_> {
        self.order_marked(who, place, order, CommandMarks::default())
    }

    /// Sends an order with `marks` to the drive at `place` at once. Dropping the result does not cancel the order.
    pub fn order_marked(
        &self,
        who: OrderingClient,
        place: DriveRef,
        order: Order,
        marks: CommandMarks,
    ) -> SentOrder<'_> {
        let now = clock::now();
        let tried = (!order.is_no_attempt()).then(|| TriedWrite::Order(order.clone()));
        let refused = |reason| {
            let report = Report::refused(reason);
            if let Some(tried) = tried {
                self.keep(who, Some(place), tried, report);
            }
            SentOrder(Err(report))
        };
        // When the sockets were last read empty is unknown here.
        if !order.is_stop() && self.stalls.may_have_waited(now, MonoTime::ZERO) {
            return refused(Reason::Stale);
        }
        let start_before = now + COMMAND_DEADLINE;
        let request = |ticket| {
            let OrderingClient { asker, origin } = who;
            let drive = place.drive;
            let issued = None;
            let CommandMarks { epoch, trial } = marks;
            LineMessage::Command(CommandRequest {
                asker,
                ticket,
                drive,
                origin,
                order,
                start_before,
                issued,
                epoch,
                trial,
            })
        };
        match self.put(place, COMMAND_WITHIN, request) {
            Ok(asked) => SentOrder(Ok(asked)),
            Err(LineUnavailable::Full) => refused(Reason::QueueFull),
            Err(LineUnavailable::Line) => SentOrder(Err(NOT_ANSWERED)),
        }
    }

    /// Sets the sums of what the drive at `place` has used back to 0. Returns whether its line took the message.
    #[must_use]
    pub fn reset_usage(&self, who: OrderingClient, place: DriveRef) -> bool {
        let shared = self.shared();
        let message = LineMessage::ResetUsage(place.drive, who.owner());
        shared
            .inbox(place)
            .is_some_and(|inbox| inbox.put(message).is_ok())
    }

    /// Orders the drives at `places` to stop, all at once: each line finds its stops together.
    pub fn stop_all(&self, who: OrderingClient, places: &[DriveRef]) -> Vec<SentOrder<'_>> {
        let start_before = clock::now() + COMMAND_DEADLINE;
        let order = Order::Stop { setpoint: None };
        let (commands, asked): (Vec<_>, Vec<_>) = places
            .iter()
            .map(|place| {
                let (ticket, asked) = self.ask(COMMAND_WITHIN);
                let OrderingClient { asker, origin } = who;
                let drive = place.drive;
                let order = order.clone();
                let issued = None;
                let (epoch, trial) = (None, None);
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
                ((*place, command), asked)
            })
            .unzip();
        let taken = self.shared().put_together(commands);
        let all = places.iter().zip(asked).zip(taken);
        all.map(|((place, asked), is_taken)| {
            if is_taken {
                return SentOrder(Ok(asked));
            }
            let report = Report::refused(Reason::QueueFull);
            self.keep(who, Some(*place), TriedWrite::Order(order.clone()), report);
            SentOrder(Err(report))
        })
        .collect()
    }

    /// Passes a message to the line of `place`; its answer may take `within`.
    fn put(
        &self,
        place: DriveRef,
        within: Duration,
        message: impl FnOnce(Ticket) -> LineMessage,
    ) -> Result<LineRequest<'_>, LineUnavailable> {
        let (ticket, asked) = self.ask(within);
        let shared = self.shared();
        let inbox = shared.inbox(place).ok_or(LineUnavailable::Line)?;
        inbox
            .put(message(ticket))
            .map_err(|InboxFull| LineUnavailable::Full)?;
        Ok(asked)
    }

    /// Reserves a ticket and a place for the answer to a request, which may take `within`.
    fn ask(&self, within: Duration) -> (Ticket, LineRequest<'_>) {
        let ticket = Ticket(self.last.fetch_add(1, Ordering::Relaxed));
        let (give, answer) = oneshot::channel();
        self.lock().insert(ticket, give);
        let waits = WaitingRequest { side: self, ticket };
        let until = Instant::now() + within;
        (
            ticket,
            LineRequest {
                answer,
                until,
                _waits: waits,
            },
        )
    }

    fn lock(&self) -> MutexGuard<'_, HashMap<Ticket, oneshot::Sender<LineNews>>> {
        self.waiting.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// A request that was passed to a line.
#[derive(Debug)]
struct LineRequest<'a> {
    answer: oneshot::Receiver<LineNews>,
    until: Instant,
    _waits: WaitingRequest<'a>,
}

impl LineRequest<'_> {
    /// The answer; `None` if it did not arrive in time.
    async fn answer(self) -> Option<LineNews> {
        timeout_at(self.until, self.answer).await.ok()?.ok()
    }
}

/// An order that was sent, or its immediate outcome.
#[derive(Debug)]
pub struct SentOrder<'a>(Result<LineRequest<'a>, Report>);

impl SentOrder<'_> {
    /// Waits for its outcome.
    pub async fn end(self) -> Report {
        match self.0 {
            Err(report) => report,
            Ok(asked) => match asked.answer().await {
                Some(LineNews::Command(answer)) => answer.report,
                _ => NOT_ANSWERED,
            },
        }
    }
}

/// A waiting request. Its entry is removed when this is dropped, also without an answer.
#[derive(Debug)]
struct WaitingRequest<'a> {
    side: &'a LocalSide,
    ticket: Ticket,
}

impl Drop for WaitingRequest<'_> {
    fn drop(&mut self) {
        self.side.lock().remove(&self.ticket);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::domain::command::{CommandAnswer, Direction, GoOrder};
    use crate::domain::ids::{DriveIndex, Name};
    use crate::domain::link::Interface;
    use crate::domain::native::NativeAnswer;

    const PLACE: DriveRef = DriveRef {
        line: 0,
        drive: DriveIndex(0),
    };

    fn side() -> Arc<LocalSide> {
        let line = (Name::new("hall-1").unwrap(), Interface::Rs485);
        Arc::new(LocalSide::new(
            Arc::new(SharedPlant::new(vec![line], Vec::new())),
            None,
        ))
    }

    /// Runs `test` with the answers that `line` gives to each message to the line.
    fn with_a_line<T>(
        side: &Arc<LocalSide>,
        mut line: impl FnMut(LineMessage) -> Vec<LineNews> + 'static,
        test: impl Future<Output = T>,
    ) -> T {
        let runtime = tokio::runtime::Builder::new_current_thread()
            .enable_time()
            .start_paused(true)
            .build()
            .unwrap();
        let answers = Arc::<AnswerBox>::default();
        let shared = side.shared();
        tokio::task::LocalSet::new().block_on(&runtime, async {
            tokio::task::spawn_local(Arc::clone(side).distribute(Arc::clone(&answers)));
            tokio::task::spawn_local(async move {
                let mut batch = Vec::new();
                loop {
                    shared.lines[0].inbox.take(&mut batch);
                    answers.put(&mut batch.drain(..).flat_map(&mut line).collect());
                    tokio::time::sleep(Duration::from_millis(1)).await;
                }
            });
            test.await
        })
    }

    fn deadline() -> MonoTime {
        clock::now() + Duration::from_secs(1)
    }

    #[test]
    fn a_busy_drive_is_read_again_and_not_for_ever() {
        for (busy, asked, expected) in [
            (3, 4, Ok(7)),
            (usize::MAX, BUSY_READS_MAX + 1, Err(Reason::DriveBusy)),
        ] {
            let side = side();
            let count = Arc::new(AtomicU64::new(0));
            let seen = Arc::clone(&count);
            let line = move |message| {
                let LineMessage::Native(NativeRequest { asker, ticket, .. }) = message else {
                    panic!("{message:?}")
                };
                let outcome = if seen.fetch_add(1, Ordering::Relaxed) < busy as u64 {
                    NativeOutcome::DriveException {
                        code: 5,
                        reason: Reason::DriveBusy,
                    }
                } else {
                    NativeOutcome::Words(vec![7].into())
                };
                vec![LineNews::Native(NativeAnswer {
                    asker,
                    ticket,
                    outcome,
                })]
            };
            let until = clock::now() + Duration::from_secs(60);
            let read = with_a_line(&side, line, async {
                side.read(PLACE, 1_u16.into(), until).await
            });
            assert_eq!(
                (
                    read.map_err(|report| report.reason),
                    count.load(Ordering::Relaxed)
                ),
                (expected, asked as u64)
            );
        }
    }

    #[test]
    fn each_read_gets_the_answer_to_its_own_question() {
        let side = side();
        let line = |message| {
            let LineMessage::Native(NativeRequest {
                asker,
                ticket,
                ask: NativeAsk::Read { address, .. },
                ..
            }) = message
            else {
                panic!("{message:?}")
            };
            let outcome = if address == 7 {
                NativeOutcome::DriveException {
                    code: 2,
                    reason: Reason::DriveException,
                }
            } else {
                NativeOutcome::Words(vec![address.number() * 10].into())
            };
            vec![LineNews::Native(NativeAnswer {
                asker,
                ticket,
                outcome,
            })]
        };
        let (first, second, third) = with_a_line(&side, line, async {
            tokio::join!(
                side.read(PLACE, 1_u16.into(), deadline()),
                side.read(PLACE, 2_u16.into(), deadline()),
                side.read(PLACE, 7_u16.into(), deadline())
            )
        });
        assert_eq!((first, second), (Ok(10), Ok(20)));
        let failed = third.unwrap_err();
        assert_eq!(
            (failed.reason, failed.exception),
            (Reason::DriveException, Some(2))
        );
        assert!(side.lock().is_empty());
    }

    #[test]
    fn behind_a_stall_only_stops_are_orders() {
        let side = Arc::try_unwrap(side())
            .unwrap()
            .with_stalls(Arc::new(LastStalls::just_ended()));
        let who = OrderingClient::signed_in(CommanderName::new("anna").unwrap());
        let stale = |order| {
            assert_eq!(
                side.order(who, PLACE, order).0.err(),
                Some(Report::refused(Reason::Stale))
            )
        };
        stale(Order::Go(
            GoOrder::new(Vec::new(), None, Some(Direction::Forward)).unwrap(),
        ));
        stale(Order::Renew);
        for stop in [Order::Stop { setpoint: None }, Order::Coast] {
            assert!(side.order(who, PLACE, stop).0.is_ok());
        }
        let mut batch = Vec::new();
        side.shared().lines[0].inbox.take(&mut batch);
        assert_eq!(batch.len(), 2);
    }

    #[test]
    fn a_command_ends_with_its_last_word() {
        let side = side();
        let line = |message| {
            let LineMessage::Command(CommandRequest {
                asker,
                ticket,
                drive,
                origin,
                order,
                ..
            }) = message
            else {
                panic!("{message:?}")
            };
            assert_eq!(
                (origin.owner, order),
                (Owner::Local, Order::Setup(vec![0x0211_u16.into()]))
            );
            let answered = |outcome, is_final| {
                let report = Report::new(outcome, Reason::None);
                LineNews::Command(CommandAnswer {
                    asker,
                    ticket,
                    drive,
                    report,
                    is_final,
                })
            };
            vec![
                answered(Outcome::Acknowledged, false),
                answered(Outcome::Confirmed, true),
            ]
        };
        let report = with_a_line(
            &side,
            line,
            side.command(
                OrderingClient::TOOL,
                PLACE,
                Order::Setup(vec![0x0211_u16.into()]),
            ),
        );
        assert_eq!(report.outcome, Outcome::Confirmed);
    }

    #[test]
    fn anyone_who_is_signed_in_orders_under_a_name_of_their_own() {
        let side = side();
        let anna = CommanderName::new("anna").unwrap();
        let line = move |message| {
            let LineMessage::Command(CommandRequest {
                asker,
                ticket,
                drive,
                origin,
                ..
            }) = message
            else {
                panic!("{message:?}")
            };
            assert_eq!(
                (asker, origin.owner, origin.manner),
                (AskerId::PAGE, Owner::Page(anna), OrderManner::Once)
            );
            assert!(origin.rights.write && origin.rights.stop);
            let report = Report::held_by(Owner::Mqtt);
            vec![LineNews::Command(CommandAnswer {
                asker,
                ticket,
                drive,
                report,
                is_final: true,
            })]
        };
        let ordered = async {
            // Both are sent before either is waited for.
            let both = [(); 2].map(|()| {
                side.order(
                    OrderingClient::signed_in(anna),
                    PLACE,
                    Order::Stop { setpoint: None },
                )
            });
            let mut ends = Vec::new();
            for ordered in both {
                ends.push(ordered.end().await.message());
            }
            ends
        };
        assert_eq!(
            with_a_line(&side, line, ordered),
            ["mqtt holds control of the drive"; 2]
        );
    }

    #[test]
    fn who_is_not_answered_is_reported_so_and_nothing_is_kept_for_him() {
        let side = side();
        let (read, command) = with_a_line(&side, |_| Vec::new(), async {
            let read = side.read(PLACE, 1_u16.into(), deadline()).await;
            (
                read,
                side.command(OrderingClient::TOOL, PLACE, Order::Setup(Vec::new()))
                    .await,
            )
        });
        assert_eq!(read.unwrap_err().reason, Reason::NoReply);
        assert_eq!(
            (command.outcome, command.reason),
            (Outcome::Unknown, Reason::NoReply)
        );
        assert!(side.lock().is_empty());
    }

    #[test]
    fn a_line_that_is_full_or_not_there_is_distinguished() {
        let side = side();
        while side.shared().lines[0]
            .inbox
            .put(LineMessage::AskerGone(AskerId(1)))
            .is_ok()
        {}
        let nowhere = DriveRef { line: 9, ..PLACE };
        let runtime = tokio::runtime::Builder::new_current_thread()
            .enable_time()
            .build()
            .unwrap();
        let (full, missing) = runtime.block_on(async {
            (
                side.read(PLACE, 1_u16.into(), deadline()).await,
                side.read(nowhere, 1_u16.into(), deadline()).await,
            )
        });
        assert_eq!(full.unwrap_err().reason, Reason::QueueFull);
        assert_eq!(missing.unwrap_err().reason, Reason::NoReply);
    }

    #[test]
    fn places_are_bounded() {
        let side = side();
        let held: Vec<_> = (0..TOOLS_MAX).map(|_| side.place().unwrap()).collect();
        assert!(side.place().is_none());
        drop(held);
        assert!(side.place().is_some());
    }
}
