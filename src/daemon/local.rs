//! The program's own tools at the lines: what they ask over the socket, and the answers on their way back.

use super::answers::{AnswerBox, News};
use super::clock;
use super::inbox::{Full, Message};
use super::shared::Shared;
use crate::domain::command::{CommandRequest, Manner, Order, Origin, Outcome, Owner, Reason, Report, Rights};
use crate::domain::ids::{AskerId, Ticket};
use crate::domain::native::{NativeAsk, NativeOutcome, NativeRequest, Refusal};
use crate::domain::time::MonoTime;
use crate::drive::description::DriveRef;
use crate::guard::COMMAND_DEADLINE;
use std::collections::HashMap;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;
use tokio::sync::{OwnedSemaphorePermit, Semaphore, oneshot};
use tokio::time::timeout;

/// Most tools that are served at once; a person has one or two.
pub const TOOLS_MAX: usize = 4;
/// The line ends every read by its deadline. This much later nobody answers any more.
const LATE: Duration = Duration::from_secs(1);
/// Longest time in which a command that has begun may end: several slow writes, each read back.
const COMMAND_WITHIN: Duration = Duration::from_secs(15);

/// Who may open the socket may do what only that side may do. Its orders take no lease, so that it needs no stop.
const ORIGIN: Origin =
    Origin { owner: Owner::Local, rights: Rights { write: true, stop: false }, manner: Manner::Once };

/// The tools' way to all lines.
#[derive(Debug)]
pub struct LocalSide {
    shared: Arc<Shared>,
    last: AtomicU64,
    waiting: Mutex<HashMap<Ticket, oneshot::Sender<News>>>,
    places: Arc<Semaphore>,
}

/// Why a request has no answer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Missing {
    /// The line takes nothing more.
    Full,
    /// It did not answer in time, or there is no such line.
    Silent,
}

impl LocalSide {
    /// A side on which nobody waits.
    #[must_use]
    pub fn new(shared: Arc<Shared>) -> Self {
        let places = Arc::new(Semaphore::new(TOOLS_MAX));
        Self { shared, last: AtomicU64::new(0), waiting: Mutex::default(), places }
    }

    /// Lines and drives.
    #[must_use]
    pub fn shared(&self) -> &Shared {
        &self.shared
    }

    /// A place for one tool as long as it is served; nothing if [`TOOLS_MAX`] are.
    #[must_use]
    pub fn place(&self) -> Option<OwnedSemaphorePermit> {
        Arc::clone(&self.places).try_acquire_owned().ok()
    }

    /// Hands the answers of the lines to those who wait, until the task is dropped.
    pub async fn distribute(self: Arc<Self>, answers: Arc<AnswerBox>) {
        let mut batch = Vec::new();
        loop {
            answers.fetch(&mut batch).await;
            let mut waiting = self.lock();
            for news in batch.drain(..) {
                let ticket = match &news {
                    News::Native(answer) => answer.ticket,
                    News::Command(answer) if answer.is_final => answer.ticket,
                    News::Command(_) | News::Trip(..) | News::Events { .. } => continue,
                };
                if let Some(asked) = waiting.remove(&ticket) {
                    // Who has gone away waits for nothing.
                    let _ = asked.send(news);
                }
            }
        }
    }

    /// Reads the register at `address` of the drive at `place` now, by an exchange of its own.
    ///
    /// # Errors
    /// Why there is no word, as of a command that ended so.
    pub async fn read(&self, place: DriveRef, address: u16, deadline: MonoTime) -> Result<u16, Report> {
        let ask = NativeAsk::Read { address, count: 1 };
        let request = |ticket| {
            let (asker, drive) = (AskerId::LOCAL, place.drive);
            Message::Native(NativeRequest { asker, ticket, drive, origin: ORIGIN, ask, deadline })
        };
        let outcome = match self.ask(place, deadline.since(clock::now()) + LATE, request).await {
            Ok(News::Native(answer)) => answer.outcome,
            Err(Missing::Full) => NativeOutcome::Refused(Refusal::QueueFull),
            Ok(_) | Err(Missing::Silent) => NativeOutcome::NoReply,
        };
        match &outcome {
            NativeOutcome::Words(words) => words.first().copied().ok_or_else(|| outcome.read_failure()),
            _ => Err(outcome.read_failure()),
        }
    }

    /// Orders something of the drive at `place`, and waits for its end.
    pub async fn command(&self, place: DriveRef, order: Order) -> Report {
        let start_before = clock::now() + COMMAND_DEADLINE;
        let request = |ticket| {
            let (asker, drive, origin) = (AskerId::LOCAL, place.drive, ORIGIN);
            let (issued, epoch) = (None, None);
            Message::Command(CommandRequest { asker, ticket, drive, origin, order, start_before, issued, epoch })
        };
        match self.ask(place, COMMAND_WITHIN, request).await {
            Ok(News::Command(answer)) => answer.report,
            Err(Missing::Full) => Report::refused(Reason::QueueFull),
            Ok(_) | Err(Missing::Silent) => Report::new(Outcome::Unknown, Reason::NoReply),
        }
    }

    async fn ask(
        &self,
        place: DriveRef,
        within: Duration,
        message: impl FnOnce(Ticket) -> Message,
    ) -> Result<News, Missing> {
        let ticket = Ticket(self.last.fetch_add(1, Ordering::Relaxed));
        let (give, answer) = oneshot::channel();
        self.lock().insert(ticket, give);
        let _waits = Waits { side: self, ticket };
        let inbox = self.shared.inbox(place).ok_or(Missing::Silent)?;
        inbox.put(message(ticket)).map_err(|Full| Missing::Full)?;
        match timeout(within, answer).await {
            Ok(Ok(news)) => Ok(news),
            Ok(Err(_)) | Err(_) => Err(Missing::Silent),
        }
    }

    fn lock(&self) -> MutexGuard<'_, HashMap<Ticket, oneshot::Sender<News>>> {
        self.waiting.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Somebody who waits, also one who goes away without an answer: nothing is kept for who is gone.
struct Waits<'a> {
    side: &'a LocalSide,
    ticket: Ticket,
}

impl Drop for Waits<'_> {
    fn drop(&mut self) {
        self.side.lock().remove(&self.ticket);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::domain::command::CommandAnswer;
    use crate::domain::ids::{DriveIndex, Name};
    use crate::domain::link::Interface;
    use crate::domain::native::NativeAnswer;

    const PLACE: DriveRef = DriveRef { line: 0, drive: DriveIndex(0) };

    fn side() -> Arc<LocalSide> {
        let line = (Name::new("hall-1").unwrap(), Interface::Rs485);
        Arc::new(LocalSide::new(Arc::new(Shared::new(vec![line], Vec::new()))))
    }

    /// Runs `test` with the answers that `line` gives to each message that has come to the line.
    fn with_a_line<T>(
        side: &Arc<LocalSide>,
        mut line: impl FnMut(Message) -> Vec<News> + 'static,
        test: impl Future<Output = T>,
    ) -> T {
        let runtime = tokio::runtime::Builder::new_current_thread().enable_time().start_paused(true).build().unwrap();
        let (answers, shared) = (Arc::<AnswerBox>::default(), Arc::clone(&side.shared));
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
    fn each_read_gets_the_answer_to_its_own_question() {
        let side = side();
        let line = |message| {
            let Message::Native(NativeRequest { asker, ticket, ask: NativeAsk::Read { address, .. }, .. }) = message
            else {
                panic!("{message:?}")
            };
            let outcome = if address == 7 {
                NativeOutcome::DriveException(2)
            } else {
                NativeOutcome::Words(vec![address * 10].into())
            };
            vec![News::Native(NativeAnswer { asker, ticket, outcome })]
        };
        let (first, second, third) = with_a_line(&side, line, async {
            tokio::join!(
                side.read(PLACE, 1, deadline()),
                side.read(PLACE, 2, deadline()),
                side.read(PLACE, 7, deadline())
            )
        });
        assert_eq!((first, second), (Ok(10), Ok(20)));
        let failed = third.unwrap_err();
        assert_eq!((failed.reason, failed.exception), (Reason::DriveException, Some(2)));
        assert!(side.lock().is_empty());
    }

    #[test]
    fn a_command_ends_with_its_last_word() {
        let side = side();
        let line = |message| {
            let Message::Command(CommandRequest { asker, ticket, drive, origin, order, .. }) = message else {
                panic!("{message:?}")
            };
            assert_eq!((origin.owner, order), (Owner::Local, Order::Setup(vec![0x0211])));
            let told = |outcome, is_final| {
                let report = Report::new(outcome, Reason::None);
                News::Command(CommandAnswer { asker, ticket, drive, report, is_final })
            };
            vec![told(Outcome::Acknowledged, false), told(Outcome::Confirmed, true)]
        };
        let report = with_a_line(&side, line, side.command(PLACE, Order::Setup(vec![0x0211])));
        assert_eq!(report.outcome, Outcome::Confirmed);
    }

    #[test]
    fn who_is_not_answered_is_told_so_and_nothing_is_kept_for_him() {
        let side = side();
        let (read, command) = with_a_line(&side, |_| Vec::new(), async {
            let read = side.read(PLACE, 1, deadline()).await;
            (read, side.command(PLACE, Order::Setup(Vec::new())).await)
        });
        assert_eq!(read.unwrap_err().reason, Reason::NoReply);
        assert_eq!((command.outcome, command.reason), (Outcome::Unknown, Reason::NoReply));
        assert!(side.lock().is_empty());
    }

    #[test]
    fn a_line_that_is_full_or_not_there_is_told_apart() {
        let side = side();
        while side.shared.lines[0].inbox.put(Message::AskerGone(AskerId(1))).is_ok() {}
        let nowhere = DriveRef { line: 9, ..PLACE };
        let runtime = tokio::runtime::Builder::new_current_thread().enable_time().build().unwrap();
        let (full, missing) = runtime
            .block_on(async { (side.read(PLACE, 1, deadline()).await, side.read(nowhere, 1, deadline()).await) });
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
