//! One thread per line: it opens the port, feeds [`LineCore`] and carries out what it says.
//!
//! A round: wait for anything; take all messages, all bytes; look at the port once more, so that a frame of
//! ours never starts on top of bytes that have just come; let the core decide; act.

mod acting;
mod opening;
mod serving;

use super::answers::NorthSides;
use super::board::Board;
use super::clock;
use super::inbox::Message;
use super::port::PortSettings;
use super::shared::Shared;
use super::sys;
use super::timer::Timer;
use crate::domain::report::LineFault;
use crate::domain::time::MonoTime;
use crate::gateway::{LineCore, LineSetup};
use opening::{Attempts, Told};
use std::io;
use std::sync::Arc;
use std::thread::JoinHandle;
use std::time::Duration;
use tokio::sync::oneshot;

/// Most time that the declared actions at the end of the gateway may take. Drives whose stop shows no effect until then
/// are named in the log and left.
const ENDING_MAX: Duration = Duration::from_secs(5);

/// What a line thread needs to know beside what its core knows.
#[derive(Clone, Debug)]
pub struct LinePort {
    /// Name of the line, for messages.
    pub line: String,
    /// Names of its drives in order, for messages.
    pub drives: Vec<String>,
    /// What it is reached through.
    pub settings: PortSettings,
}

/// A running line thread.
#[derive(Debug)]
pub struct LineHandle {
    shared: Arc<Shared>,
    place: usize,
    /// Closed when the thread ends.
    ended: oneshot::Receiver<()>,
    thread: JoinHandle<()>,
}

impl LineHandle {
    /// Starts the thread of the line at `place` of `shared`.
    ///
    /// # Errors
    /// The system's refusal to start a thread.
    pub fn start(
        port: LinePort,
        setup: LineSetup,
        shared: Arc<Shared>,
        place: usize,
        north: NorthSides,
    ) -> io::Result<Self> {
        let ours = Arc::clone(&shared);
        let (ends, ended) = oneshot::channel();
        let thread = std::thread::Builder::new().name(format!("line {}", port.line)).spawn(move || {
            if let Err(error) = run(&port, setup, &ours, place, north) {
                tracing::error!(line = port.line, %error, "the line thread could not be set up");
            }
            drop(ends);
        })?;
        Ok(Self { shared, place, ended, thread })
    }

    /// Has the declared action carried out for every drive that is under control; then the thread ends.
    pub fn begin_shutdown(&self) {
        if let Some(line) = self.shared.lines.get(self.place)
            && line.inbox.put(Message::Shutdown).is_err()
        {
            // Whoever floods the line must not keep its drives running.
            line.inbox.clear_for(Message::Shutdown);
        }
    }

    /// Waits for the end of the thread.
    pub async fn ended(&mut self) {
        // An error is what the end of the thread looks like.
        let _ = (&mut self.ended).await;
    }

    /// Ends the thread, if it has not ended yet, and waits for that.
    pub fn join(self) {
        if let Some(line) = self.shared.lines.get(self.place) {
            line.inbox.close();
        }
        if self.thread.join().is_err() {
            tracing::error!("a line thread had panicked");
        }
    }
}

fn run(port: &LinePort, setup: LineSetup, shared: &Shared, place: usize, north: NorthSides) -> io::Result<()> {
    // Without character times there is no moment to hit, and preempting everybody only costs throughput.
    if setup.timing.paced
        && let Err(error) = sys::ask_for_real_time()
    {
        tracing::info!(line = port.line, %error, "no real-time priority: gaps may be longer under load, never shorter");
    }
    let board = Board::new(shared, place, north).ok_or_else(|| io::Error::other("no such line"))?;
    let is_paced = setup.timing.paced;
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build()?;
    let ended = runtime.block_on(async {
        let core = LineCore::new(setup, clock::now());
        let timer = Timer::new()?;
        let line = LineTask {
            port,
            core,
            timer,
            is_paced,
            attempts: Attempts::default(),
            told: Told::default(),
            round: Vec::new(),
            board,
            ending: None,
            to_reopen: None,
        };
        line.serve().await
    });
    // A name that is still being looked for must not hold up the end.
    runtime.shutdown_background();
    ended
}

struct LineTask<'a> {
    port: &'a LinePort,
    core: LineCore,
    timer: Timer,
    is_paced: bool,
    /// When the port is tried again.
    attempts: Attempts,
    /// What the log was told about the port.
    told: Told,
    /// The messages of this round.
    round: Vec<Message>,
    /// The gateway ends: until then the thread waits for its stops to show their effect.
    ending: Option<MonoTime>,
    /// The core wants the port opened anew.
    to_reopen: Option<LineFault>,
    board: Board<'a>,
}

impl LineTask<'_> {
    /// Whether nothing is left to do on this line.
    fn is_over(&self) -> bool {
        let Some(until) = self.ending else { return self.board.inbox().is_closed() };
        let is_late = clock::now() >= until;
        if is_late && !self.core.is_at_rest() {
            tracing::error!(line = self.port.line, "a stop shows no effect; the gateway ends all the same");
        }
        is_late || self.core.is_at_rest()
    }
}
