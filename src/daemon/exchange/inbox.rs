//! The way from the north side into a line thread.

use crate::domain::command::{CommandRequest, Owner};
use crate::domain::ids::{AskerId, DriveIndex};
use crate::domain::native::{NativeAsk, NativeRequest};
use crate::journal::RowNumber;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, MutexGuard, PoisonError};
use tokio::sync::{Notify, oneshot};

/// Messages that may wait for a line thread. The north side answers exception 06 when it is full.
pub const INBOX_MAX: usize = 4096;
/// Further room for writes and commands: no flood of reads keeps them out.
pub const COMMANDS_MAX: usize = 512;
/// Further room for stops and other messages that must not be lost: no flood of commands keeps them out.
pub const STOPS_MAX: usize = 1024;
/// Room in [`STOPS_MAX`] for clients that left: thousands may leave at once, and keep no stop out.
pub const GONE_MAX: usize = STOPS_MAX / 2;

/// A message from the north side to a line.
#[derive(Debug)]
pub enum LineMessage {
    /// A native request of a client.
    Native(NativeRequest),
    /// A native request of a client to write what the drive's model knows as a stop.
    NativeStop(NativeRequest),
    /// A command.
    Command(CommandRequest),
    /// A client is gone.
    AskerGone(AskerId),
    /// The path from this client is open: its leases stay alive.
    PathAlive(Owner),
    /// The path from this client was reopened: what was issued before is stale.
    PathOpened(Owner),
    /// This client sets the sums of what the drive has used back to 0.
    ResetUsage(DriveIndex, Owner),
    /// This person confirms that the motor of the drive stands.
    ConfirmStandstill(DriveIndex, Owner),
    /// The gateway shuts down: each drive gets its declared action.
    Shutdown,
    /// The gateway shuts down now: the effect of stops that were sent is not waited for.
    Hurry,
    /// The line is removed by a change of the configuration and accepts only stops from now on.
    Leave {
        /// Drives in use are stopped, and the answer waits for that.
        stops: bool,
        /// Receives the drives that are in use.
        tell: oneshot::Sender<Vec<DriveIndex>>,
    },
    /// The line continues after all.
    Stay,
    /// Another gateway of the line is to take it over, if this one is active.
    Yield,
    /// The journal has kept the line's rows up to this one.
    Kept(RowNumber),
}

/// The inbox is full; the message was not taken.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct InboxFull;

/// A bounded inbox that wakes its line thread only if the thread has nothing else to wait for. While an exchange is on
/// the wire or the silence before the next one runs, the thread cannot act on a message anyway and reads the inbox when
/// that is over; waking it for each message would cost more than the message.
#[derive(Debug, Default)]
pub struct LineInbox {
    waiting: Mutex<WaitingMessages>,
    /// The line thread sleeps until the bell rings.
    is_idle: AtomicBool,
    is_closed: AtomicBool,
    bell: Notify,
}

/// What waits, and what has been accepted.
#[derive(Debug, Default)]
struct WaitingMessages {
    messages: Vec<LineMessage>,
    /// Orders and writes accepted so far, by drive, wrapping.
    orders: Vec<u64>,
}

impl WaitingMessages {
    fn push(&mut self, message: LineMessage) {
        if let Some(drive) = message.orders() {
            if self.orders.len() <= drive.get() {
                self.orders.resize(drive.get() + 1, 0);
            }
            self.count(drive, 1);
        }
        self.messages.push(message);
    }

    /// Drops all messages except those that stay. Orders among them were never accepted.
    fn make_room(&mut self) {
        let dropped: Vec<_> = self
            .messages
            .extract_if(.., |message| !stays(message))
            .collect();
        // Wrapping: one less.
        dropped
            .iter()
            .filter_map(LineMessage::orders)
            .for_each(|drive| self.count(drive, u64::MAX));
    }

    fn count(&mut self, drive: DriveIndex, more: u64) {
        self.orders
            .get_mut(drive.get())
            .into_iter()
            .for_each(|orders| *orders = orders.wrapping_add(more));
    }
}

impl LineMessage {
    /// The drive for which it is an order or a write; `None` if it is neither, or only renews a lease.
    fn orders(&self) -> Option<DriveIndex> {
        match self {
            Self::Native(request) | Self::NativeStop(request) => {
                request.writes().then_some(request.drive)
            }
            Self::Command(command) => (!command.order.is_no_attempt()).then_some(command.drive),
            _ => None,
        }
    }
}

impl LineInbox {
    /// Adds a message.
    ///
    /// # Errors
    /// [`InboxFull`] if too many messages wait, or the line has ended.
    pub fn put(&self, message: LineMessage) -> Result<(), InboxFull> {
        let mut waiting = self.lock();
        // Under the lock, so that no message is added after the last one is taken.
        if self.is_closed() || waiting.messages.len() >= room_for(&message) {
            return Err(InboxFull);
        }
        waiting.push(message);
        drop(waiting);
        if self.is_idle.load(Ordering::SeqCst) {
            self.bell.notify_one();
        }
        Ok(())
    }

    /// Adds messages that the line thread finds together. Returns which of them were accepted.
    pub fn put_together(&self, messages: impl IntoIterator<Item = LineMessage>) -> Vec<bool> {
        let mut waiting = self.lock();
        let mut take = |message: LineMessage| {
            let is_taken = !self.is_closed() && waiting.messages.len() < room_for(&message);
            if is_taken {
                waiting.push(message);
            }
            is_taken
        };
        let taken: Vec<_> = messages.into_iter().map(&mut take).collect();
        drop(waiting);
        if self.is_idle.load(Ordering::SeqCst) {
            self.bell.notify_one();
        }
        taken
    }

    /// Adds a message that must not be kept out, and wakes the line thread at once. If there is no room, all waiting
    /// messages are dropped except stops and messages added in this way.
    pub fn put_surely(&self, message: LineMessage) {
        let mut waiting = self.lock();
        if waiting.messages.len() >= room_for(&message) {
            waiting.make_room();
        }
        waiting.push(message);
        drop(waiting);
        self.bell.notify_one();
    }

    /// Wakes the line thread without a message.
    pub fn ring(&self) {
        self.bell.notify_one();
    }

    /// Accepts no more messages and asks the line thread to exit.
    pub fn close(&self) {
        let waiting = self.lock();
        self.is_closed.store(true, Ordering::SeqCst);
        drop(waiting);
        self.bell.notify_one();
    }

    /// Whether the line thread is to exit.
    #[must_use]
    pub fn is_closed(&self) -> bool {
        self.is_closed.load(Ordering::SeqCst)
    }

    /// Whether it is closed and empty.
    #[must_use]
    pub fn is_done(&self) -> bool {
        self.is_closed() && self.lock().messages.is_empty()
    }

    /// Swaps the messages for the empty `batch`.
    pub fn take(&self, batch: &mut Vec<LineMessage>) {
        std::mem::swap(&mut self.lock().messages, batch);
    }

    /// Sets whether the line thread is about to sleep until the bell rings. Returns whether it may sleep: messages
    /// added before this call have rung no bell.
    #[must_use]
    pub fn may_sleep(&self, until_called: bool) -> bool {
        self.is_idle.store(until_called, Ordering::SeqCst);
        !until_called || self.lock().messages.is_empty()
    }

    /// Waits until the bell rings.
    pub async fn called(&self) {
        self.bell.notified().await;
    }

    /// Orders and writes accepted for `drive` so far, wrapping. The line has taken them all when it has taken as many.
    #[must_use]
    pub fn orders(&self, drive: DriveIndex) -> u64 {
        self.lock().orders.get(drive.get()).copied().unwrap_or(0)
    }

    fn lock(&self) -> MutexGuard<'_, WaitingMessages> {
        self.waiting.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Whether it is a stop or a message of the gateway itself.
const fn stays(message: &LineMessage) -> bool {
    match message {
        LineMessage::Command(command) => command.order.is_stop(),
        LineMessage::NativeStop(_)
        | LineMessage::Shutdown
        | LineMessage::Hurry
        | LineMessage::Leave { .. }
        | LineMessage::Stay
        | LineMessage::Yield => true,
        _ => false,
    }
}

const fn room_for(message: &LineMessage) -> usize {
    match message {
        LineMessage::Native(NativeRequest {
            ask: NativeAsk::Read { .. },
            ..
        }) => INBOX_MAX,
        message if stays(message) || matches!(message, LineMessage::Kept(_)) => {
            INBOX_MAX + COMMANDS_MAX + STOPS_MAX
        }
        LineMessage::AskerGone(_) => INBOX_MAX + COMMANDS_MAX + GONE_MAX,
        _ => INBOX_MAX + COMMANDS_MAX,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::daemon::testing::Sleeper;
    use crate::domain::command::{OrderManner, Origin, Rights};
    use crate::domain::ids::Ticket;
    use crate::domain::time::MonoTime;
    use std::sync::Arc;
    use std::time::Duration;

    const GONE: LineMessage = LineMessage::AskerGone(AskerId(1));

    /// A write that stops.
    fn stop() -> LineMessage {
        let origin = Origin {
            owner: Owner::Mqtt,
            rights: Rights {
                write: true,
                stop: true,
            },
            manner: OrderManner::Once,
        };
        let ask = NativeAsk::Write {
            address: 2_u16.into(),
            values: vec![0],
        };
        let asker = AskerId(1);
        let ticket = Ticket(1);
        let drive = DriveIndex(0);
        let deadline = MonoTime::NEVER;
        LineMessage::NativeStop(NativeRequest {
            asker,
            ticket,
            drive,
            origin,
            ask,
            deadline,
        })
    }

    #[test]
    fn who_sleeps_until_called_is_called() {
        let inbox = LineInbox::default();
        assert!(inbox.may_sleep(true));
        inbox.put(GONE).unwrap();
        let mut called = std::pin::pin!(inbox.called());
        let mut cx = std::task::Context::from_waker(std::task::Waker::noop());
        assert!(called.as_mut().poll(&mut cx).is_ready());
    }

    #[test]
    fn orders_count_for_their_drive_until_they_are_dropped() {
        let inbox = LineInbox::default();
        let orders = || [0, 1].map(|drive| inbox.orders(DriveIndex(drive)));
        let write = |drive: u16| {
            let LineMessage::NativeStop(request) = stop() else {
                panic!("a stop")
            };
            LineMessage::Native(NativeRequest {
                drive: DriveIndex(drive),
                ..request
            })
        };
        let read = |drive: u16| {
            let LineMessage::Native(request) = write(drive) else {
                panic!("a write")
            };
            let ask = NativeAsk::Read {
                address: 2_u16.into(),
                count: 1,
            };
            LineMessage::Native(NativeRequest { ask, ..request })
        };
        inbox.put(read(0)).unwrap();
        inbox.put(GONE).unwrap();
        assert_eq!(orders(), [0, 0]);
        inbox.put(write(1)).unwrap();
        inbox.put(stop()).unwrap();
        assert_eq!(inbox.put_together([write(1), read(1)]), [true, true]);
        assert_eq!(orders(), [1, 2]);
        // Those that were taken stay counted, and those that are dropped for want of room were never given.
        inbox.take(&mut Vec::new());
        while inbox.put(write(0)).is_ok() {}
        while inbox.put(stop()).is_ok() {}
        let full = orders()[0];
        inbox.put_surely(LineMessage::Shutdown);
        assert_eq!(orders(), [full - (INBOX_MAX + COMMANDS_MAX) as u64, 2]);
    }

    #[test]
    fn what_came_before_the_sleep_keeps_awake() {
        let inbox = LineInbox::default();
        inbox.put(GONE).unwrap();
        assert!(inbox.may_sleep(false), "it looks by itself soon");
        assert!(!inbox.may_sleep(true));
        let mut batch = Vec::new();
        inbox.take(&mut batch);
        assert_eq!(batch.len(), 1);
        assert!(inbox.may_sleep(true));
    }

    #[test]
    fn it_is_bounded() {
        let inbox = LineInbox::default();
        for _ in 0..INBOX_MAX + COMMANDS_MAX {
            inbox.put(LineMessage::PathAlive(Owner::Mqtt)).unwrap();
        }
        assert_eq!(
            inbox.put(LineMessage::PathAlive(Owner::Mqtt)),
            Err(InboxFull)
        );
        for _ in 0..GONE_MAX {
            inbox.put(GONE).unwrap();
        }
        assert_eq!(
            inbox.put(GONE),
            Err(InboxFull),
            "however many clients leave, stops find room"
        );
        for _ in GONE_MAX..STOPS_MAX {
            inbox.put(LineMessage::Kept(RowNumber::default())).unwrap();
        }
        assert_eq!(inbox.put(stop()), Err(InboxFull));
        inbox.put_surely(LineMessage::Shutdown);
        let mut batch = Vec::new();
        inbox.take(&mut batch);
        assert!(
            matches!(batch.as_slice(), [LineMessage::Shutdown]),
            "whoever floods the line does not keep its end out"
        );
    }

    #[test]
    fn neither_a_stop_nor_the_end_gives_way() {
        let inbox = LineInbox::default();
        for _ in 0..INBOX_MAX + COMMANDS_MAX {
            inbox.put(LineMessage::PathAlive(Owner::Mqtt)).unwrap();
        }
        (0..STOPS_MAX).for_each(|_| inbox.put(stop()).unwrap());
        inbox.put_surely(LineMessage::Shutdown);
        inbox.put_surely(LineMessage::Hurry);
        let mut batch = Vec::new();
        inbox.take(&mut batch);
        let (stops, rest) = batch.split_at(STOPS_MAX);
        assert!(
            stops
                .iter()
                .all(|it| matches!(it, LineMessage::NativeStop(_))),
            "of which somebody waits for the answer"
        );
        assert!(matches!(rest, [LineMessage::Shutdown, LineMessage::Hurry]));
    }

    /// So a stop for all drives of an idle line is one frame, whenever its thread reads the inbox.
    #[test]
    fn what_is_put_together_is_found_together() {
        const TOGETHER: usize = 3;
        const TIMES: usize = 100;
        // Long enough for the other thread to read the inbox, if it could.
        let slow_stop = |_| {
            std::thread::sleep(Duration::from_micros(100));
            stop()
        };
        let inbox = LineInbox::default();
        std::thread::scope(|threads| {
            threads.spawn(|| {
                for _ in 0..TIMES {
                    while inbox.lock().messages.len() > STOPS_MAX - TOGETHER {
                        std::thread::yield_now();
                    }
                    assert_eq!(
                        inbox.put_together((0..TOGETHER).map(slow_stop)),
                        [true; TOGETHER]
                    );
                }
            });
            let mut found = 0;
            let mut batch = Vec::new();
            while found < TIMES * TOGETHER {
                inbox.take(&mut batch);
                assert_eq!(batch.len() % TOGETHER, 0, "some of them only");
                found += batch.drain(..).count();
                std::thread::yield_now();
            }
        });
    }

    #[test]
    fn a_line_that_looks_as_soon_as_it_is_called_finds_all_that_was_put_together() {
        let inbox = Arc::<LineInbox>::default();
        let sleeper = Sleeper::new(&inbox);
        assert_eq!(inbox.put_together([stop(), stop(), stop()]), [true; 3]);
        assert_eq!(sleeper.found(), 3);
    }

    #[test]
    fn what_does_not_fit_of_those_put_together_is_reported() {
        let inbox = LineInbox::default();
        let room = INBOX_MAX + COMMANDS_MAX + STOPS_MAX;
        (1..room).for_each(|_| inbox.put(stop()).unwrap());
        assert_eq!(inbox.put_together([stop(), stop()]), [true, false]);
        inbox.close();
        assert_eq!(inbox.put_together([stop()]), [false]);
    }

    #[test]
    fn a_line_that_ends_takes_nothing_more() {
        let inbox = LineInbox::default();
        inbox.close();
        assert_eq!(inbox.put(GONE), Err(InboxFull));
    }
}
