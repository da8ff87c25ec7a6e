//! One thread per line: it opens the port, feeds [`LineCore`] and executes its effects.
//!
//! A round: wait for an event; take all messages and all bytes; read the port once more, so that a frame of ours never
//! starts on top of bytes that have just arrived; let the core decide; act.

mod acting;
mod board;
mod connection;
mod memory;
mod opening;
mod rows;
mod serving;

use crate::config::PortAddress;
use crate::daemon::exchange::bell::BrokerBell;
use crate::daemon::exchange::inbox::LineMessage;
use crate::daemon::exchange::north_sides::NorthSides;
use crate::daemon::exchange::shared::{SharedDrive, SharedLine};
use crate::daemon::host::clock;
use crate::daemon::host::sys;
use crate::daemon::host::timer::TaskTimer;
use crate::daemon::journal::Journal;
use crate::daemon::port::{OpenBackoff, PortSettings};
use crate::domain::ids::DriveIndex;
use crate::domain::report::LineFault;
use crate::domain::time::MonoTime;
use crate::gateway::{LineCore, LineInput, LineSetup};
use crate::journal::RememberedDrive;
use board::LineBoard;
pub use memory::Memory;
use opening::LoggedFaults;
use std::io;
use std::sync::Arc;
use std::thread::JoinHandle;
use std::time::Duration;
use tokio::sync::oneshot;
use tokio::time::{Instant, timeout_at};

/// Most time for the declared actions at shutdown. Drives whose stop shows no effect by then are logged and left.
const ENDING_MAX: Duration = Duration::from_secs(5);
/// How much longer a stop that arrived at the very end may wait to be sent.
const UNSENT_MAX: Duration = Duration::from_secs(1);

/// What a line thread needs beside its core.
#[derive(Clone, Debug)]
pub struct LinePort {
    /// Name of the line, for messages.
    pub line: String,
    /// Names of its drives in order, for messages.
    pub drives: Vec<String>,
    /// Its port.
    pub settings: PortSettings,
}

/// The thread of a line. It waits for [`begin`](Self::begin) before it opens anything, and exits if the handle is
/// dropped before.
#[derive(Debug)]
pub struct LineHandle {
    line: Arc<SharedLine>,
    begin: Option<oneshot::Sender<Vec<RememberedDrive>>>,
    /// Notified when the thread has everything it needs.
    ready: oneshot::Receiver<()>,
    /// Closed when the declared actions at shutdown are done.
    rested: oneshot::Receiver<()>,
    has_rested: bool,
    /// Closed when the thread exits.
    ended: oneshot::Receiver<()>,
    has_ended: bool,
    thread: JoinHandle<()>,
}

/// The other ends of what a [`LineHandle`] holds.
struct HandleEnds {
    begin: oneshot::Receiver<Vec<RememberedDrive>>,
    ready: oneshot::Sender<()>,
    rests: oneshot::Sender<()>,
}

/// Dropped when the thread of a line exits in any way, so that no client waits for an answer that cannot arrive.
struct AliveGuard {
    line: Arc<SharedLine>,
    /// Dropped after the inbox is closed.
    _ends: oneshot::Sender<()>,
}

impl Drop for AliveGuard {
    fn drop(&mut self) {
        self.line.inbox.close();
    }
}

impl LineHandle {
    /// Starts the thread of `line`, which rings `changed` whenever it publishes something new. It answers to `north`, and
    /// its rows go to `journal`.
    ///
    /// # Errors
    /// The system's refusal to start a thread.
    pub fn prepare(
        port: LinePort,
        setup: LineSetup,
        line: Arc<SharedLine>,
        changed: Arc<BrokerBell>,
        north: NorthSides,
        journal: Option<&Arc<Journal>>,
    ) -> io::Result<Self> {
        let (begin, begun) = oneshot::channel();
        let (is_ready, ready) = oneshot::channel();
        let (rests, rested) = oneshot::channel();
        let (ends, ended) = oneshot::channel();
        let board = LineBoard::new(Arc::clone(&line), changed, north, journal);
        let alive = AliveGuard {
            line: Arc::clone(&line),
            _ends: ends,
        };
        let thread = std::thread::Builder::new()
            .name(format!("line {}", port.line))
            .spawn(move || {
                let _alive = alive;
                if let Err(error) = run(
                    &port,
                    setup,
                    board,
                    HandleEnds {
                        begin: begun,
                        ready: is_ready,
                        rests,
                    },
                ) {
                    tracing::error!(line = port.line, %error, "cannot start the line thread");
                }
            })?;
        let has_rested = false;
        let has_ended = false;
        Ok(Self {
            line,
            begin: Some(begin),
            ready,
            rested,
            has_rested,
            ended,
            has_ended,
            thread,
        })
    }

    /// The shared state of the line.
    #[must_use]
    pub const fn line(&self) -> &Arc<SharedLine> {
        &self.line
    }

    /// Waits until the thread has everything it needs to begin. Returns whether it has; if not, the reason was logged.
    pub async fn is_ready(&mut self) -> bool {
        (&mut self.ready).await.is_ok()
    }

    /// Opens the port and serves the line, with the remembered state of its drives.
    pub fn begin(&mut self, memory: &Memory) {
        let of = |drive: &Arc<SharedDrive>| {
            memory
                .get(&drive.description.name)
                .copied()
                .unwrap_or_default()
        };
        let remembered = self.line.drives.iter().map(of).collect();
        // A thread that has exited already has logged the reason.
        let _ = self.begin.take().map(|begin| begin.send(remembered));
    }

    /// From now on only stops are accepted; with `stops`, drives in use are stopped. Answered with the drives that are
    /// in use, or with `stops` once all of them may be left. The sender is dropped if the thread has exited.
    #[must_use]
    pub fn leave(&self, stops: bool) -> oneshot::Receiver<Vec<DriveIndex>> {
        let (tell, answer) = oneshot::channel();
        self.tell(LineMessage::Leave { stops, tell });
        answer
    }

    /// The line continues after all.
    pub fn stay(&self) {
        self.tell(LineMessage::Stay);
    }

    /// Executes the declared action for every drive that is under control. From then on only stops are accepted, until
    /// the line is [closed](Self::close).
    pub fn begin_shutdown(&self) {
        self.tell(LineMessage::Shutdown);
    }

    /// The effect of stops is no longer waited for, once each was sent.
    pub fn hurry(&self) {
        self.tell(LineMessage::Hurry);
    }

    /// Makes the thread exit: at shutdown after the stops that it has, otherwise now. Open requests are answered, and
    /// no more are accepted.
    pub fn close(&self) {
        self.line.inbox.close();
    }

    /// Waits until the declared actions at shutdown are done or timed out, at most until `until`. Returns whether they
    /// are.
    pub async fn rested_by(&mut self, until: Instant) -> bool {
        // The sender is dropped then, which is an error here.
        self.has_rested = self.has_rested || timeout_at(until, &mut self.rested).await.is_ok();
        self.has_rested
    }

    /// Whether [`rested_by`](Self::rested_by) has returned true.
    #[must_use]
    pub const fn has_rested(&self) -> bool {
        self.has_rested
    }

    /// Waits for the thread to exit. Returns whether it has.
    pub async fn ended_by(&mut self, until: Instant) -> bool {
        // The sender is dropped then, which is an error here.
        self.has_ended = self.has_ended || timeout_at(until, &mut self.ended).await.is_ok();
        self.has_ended
    }

    /// Joins the thread if it is known to have exited. One that hangs ends with the process.
    pub fn join(self) {
        if self.has_ended && self.thread.join().is_err() {
            tracing::error!("line thread panicked");
        }
    }

    fn tell(&self, message: LineMessage) {
        self.line.inbox.put_surely(message);
    }
}

fn run(
    port: &LinePort,
    mut setup: LineSetup,
    board: LineBoard,
    waits: HandleEnds,
) -> io::Result<()> {
    // Without character times there is no exact moment to meet, and preempting other threads only costs throughput.
    // With `tcp://` the device server keeps the silence, and the peer may send endlessly.
    if setup.timing.paced
        && matches!(port.settings.address, PortAddress::Device(_))
        && let Err(error) = sys::ask_for_real_time()
    {
        tracing::info!(line = port.line, %error, "no real-time priority; gaps between frames may grow under load");
    }
    let is_paced = setup.timing.paced;
    let logs_traffic = setup.tells_traffic;
    let runtime = tokio::runtime::Builder::new_current_thread()
        .enable_all()
        .build()?;
    let ended = runtime.block_on(async {
        let timer = TaskTimer::new()?;
        // A handle that does not wait for it has given the line up, which is noticed below.
        let _ = waits.ready.send(());
        let Ok(remembered) = waits.begin.await else {
            return Ok(());
        };
        for (drive, remembered) in setup.drives.iter_mut().zip(remembered) {
            drive.remembered = remembered;
        }
        let line = LineTask {
            port,
            core: LineCore::new(setup, clock::now()),
            timer,
            is_paced,
            logs_traffic,
            attempts: OpenBackoff::default(),
            logged: LoggedFaults::default(),
            round: Vec::new(),
            board,
            ending: None,
            rests: Some(waits.rests),
            is_hurried: false,
            left_behind: Vec::new(),
            leaving: None,
            to_reopen: None,
            connection: ServerConnection::default(),
        };
        line.serve().await
    });
    // A name lookup in progress must not delay the exit.
    runtime.shutdown_background();
    ended
}

/// What is known of the connection to a Modbus TCP server.
#[derive(Debug, Default)]
struct ServerConnection {
    /// Valid replies on the line up to its beginning.
    replies_before: u64,
    /// The server closes each after one reply.
    closes_each: bool,
}

struct LineTask<'a> {
    port: &'a LinePort,
    core: LineCore,
    timer: TaskTimer,
    is_paced: bool,
    /// The traffic is logged, even without listeners.
    logs_traffic: bool,
    /// When the port is retried.
    attempts: OpenBackoff,
    /// The faults of the port that were logged.
    logged: LoggedFaults,
    /// The messages of this round.
    round: Vec<LineMessage>,
    /// Set at shutdown: until then the thread waits for its stops to take effect.
    ending: Option<MonoTime>,
    /// Dropped when nothing is left to wait for at shutdown. Other lines may take longer, and until they are done stops
    /// are served here too.
    rests: Option<oneshot::Sender<()>>,
    /// The effect of stops is no longer waited for.
    is_hurried: bool,
    /// The drives that the log names because a shutdown leaves their stop open.
    left_behind: Vec<DriveIndex>,
    /// Receives an answer once the drives may be left.
    leaving: Option<oneshot::Sender<Vec<DriveIndex>>>,
    /// The core wants the port reopened.
    to_reopen: Option<LineFault>,
    /// The connection to a Modbus TCP server.
    connection: ServerConnection,
    board: LineBoard,
}

impl LineTask<'_> {
    /// Whether nothing is left to do on this line.
    fn is_over(&mut self) -> bool {
        let Some(until) = self.ending else {
            return self.board.inbox().is_closed();
        };
        let now = clock::now();
        let has_unsent = self.core.has_unsent_stop();
        let is_through = self.core.is_at_rest() || self.is_hurried && !has_unsent;
        if (is_through || now >= until) && self.rests.take().is_some() {
            // From now on the process may end at any moment.
            self.log_open_stops(|was_sent| was_sent);
        }
        let is_late = now
            >= if has_unsent {
                until + UNSENT_MAX
            } else {
                until
            };
        (is_through || is_late) && self.board.inbox().is_done()
    }

    /// Answers all open requests before the thread exits.
    fn take_leave(&mut self) -> io::Result<()> {
        self.board.inbox().close();
        self.take_messages();
        if self.ending.is_none() {
            self.core
                .handle(clock::now(), LineInput::PortDown(LineFault::Gone));
        } else {
            self.log_open_stops(|_| true);
        }
        self.core.end_attempts(clock::now());
        self.act(None)
    }
}
