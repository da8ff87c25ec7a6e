//! One thread per line: it opens the port, feeds [`LineCore`] and carries out what it says.
//!
//! A round: wait for anything; take all messages, all bytes; look at the port once more, so that a frame of
//! ours never starts on top of bytes that have just come; let the core decide; act.

use super::answers::{News, NorthSides};
use super::board::Board;
use super::clock;
use super::inbox::Message;
use super::port::{OpenError, Port};
use super::shared::Shared;
use super::sys;
use super::timer::Timer;
use crate::domain::ids::DriveIndex;
use crate::domain::link::LinkSettings;
use crate::domain::report::{LineFault, LineState};
use crate::domain::time::MonoTime;
use crate::drive::view::TripEventKind;
use crate::gateway::{Effect, Input, LineCore, LineSetup, Wake, WakeReason};
use std::future::poll_fn;
use std::io;
use std::ops::ControlFlow;
use std::path::PathBuf;
use std::pin::pin;
use std::sync::Arc;
use std::task::Poll;
use std::thread::JoinHandle;
use std::time::Duration;
use tokio::sync::oneshot;

/// Reads of the port in one round. At 512 bytes each this is more than any port buffers.
const READS_PER_ROUND: usize = 64;
/// How long before the end of the silence the thread wakes up and then watches the clock: what waking up takes
/// on an ordinary machine. It keeps gaps exact at the cost of this much processor time a frame.
const WAKE_EARLY: Duration = Duration::from_micros(100);
/// How long a line without character times looks for the reply before it sleeps. Such a reply comes sooner than a
/// sleeping thread is woken; a paced one never does.
const LOOK_BEFORE_SLEEP: Duration = Duration::from_micros(60);
/// First wait before a port that could not be opened is tried again; doubled up to the longest.
const REOPEN_FIRST: Duration = Duration::from_millis(100);
/// Longest such wait: a replugged adapter is back within a second.
const REOPEN_MAX: Duration = Duration::from_millis(800);

/// A port that was open for less than this was not really back: the next attempt waits longer.
const STABLE_AFTER: Duration = Duration::from_secs(1);

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
    /// The device.
    pub path: PathBuf,
    /// Speed and character format.
    pub link: LinkSettings,
    /// Whether only a pseudo-terminal will do, because the silence is shorter than the models need.
    pub needs_pty: bool,
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
    runtime.block_on(async {
        let core = LineCore::new(setup, clock::now());
        let timer = Timer::new()?;
        let line = LineTask {
            port,
            core,
            timer,
            is_paced,
            reopen_wait: REOPEN_FIRST,
            round: Vec::new(),
            board,
            ending: None,
            to_reopen: None,
        };
        line.serve().await
    })
}

/// Why an open port was left.
enum Left {
    /// The thread was told to end.
    Closed,
    /// The port shall be opened anew.
    ToReopen(LineFault),
}

struct LineTask<'a> {
    port: &'a LinePort,
    core: LineCore,
    timer: Timer,
    is_paced: bool,
    /// Wait before the port is tried again.
    reopen_wait: Duration,
    /// The messages of this round.
    round: Vec<Message>,
    /// The gateway ends: until then the thread waits for its stops to show their effect.
    ending: Option<MonoTime>,
    /// The core wants the port opened anew.
    to_reopen: Option<LineFault>,
    board: Board<'a>,
}

impl LineTask<'_> {
    async fn serve(mut self) -> io::Result<()> {
        let mut told = None;
        loop {
            let Some(mut device) = self.open(&mut told).await? else { return Ok(()) };
            let opened_at = clock::now();
            self.core.handle(opened_at, Input::PortUp(device.kind()));
            if self.core.report().state == LineState::Up {
                tracing::info!(line = self.port.line, port = %self.port.path.display(), link = %self.port.link, "line up");
            }
            let fault = match self.serve_port(&mut device).await {
                Ok(Left::Closed) => return Ok(()),
                Ok(Left::ToReopen(fault)) => fault,
                Err(error) => {
                    let fault = fault_of(&error);
                    tracing::warn!(line = self.port.line, %fault, %error, "line down");
                    fault
                }
            };
            self.core.handle(clock::now(), Input::PortDown(fault));
            self.act(None)?;
            if clock::now().since(opened_at) >= STABLE_AFTER {
                self.reopen_wait = REOPEN_FIRST;
            } else if self.pause().await?.is_break() {
                return Ok(());
            }
        }
    }

    /// Opens the port, again and again with growing waits; nothing if the thread was told to end.
    async fn open(&mut self, told: &mut Option<String>) -> io::Result<Option<Port>> {
        loop {
            match Port::open(&self.port.path, self.port.link, self.port.needs_pty) {
                Ok(device) => {
                    *told = None;
                    return Ok(Some(device));
                }
                Err(error) => self.tell_once(told, &error),
            }
            if self.pause().await?.is_break() {
                return Ok(None);
            }
        }
    }

    /// Waits before the port is tried again, the next time longer; meanwhile requests are answered. A break means
    /// that the thread was told to end.
    async fn pause(&mut self) -> io::Result<ControlFlow<()>> {
        let again = clock::now() + self.reopen_wait;
        self.reopen_wait = (self.reopen_wait * 2).min(REOPEN_MAX);
        while clock::now() < again {
            // Leases end and stops are late whether or not there is a port.
            let due = self.core.next_wake().map_or(again, |wake| wake.at.min(again));
            self.timer.arm(due)?;
            self.wait(None).await?;
            self.take_messages();
            self.core.handle(clock::now(), Input::Time);
            self.act(None)?;
            if self.is_over() {
                return Ok(ControlFlow::Break(()));
            }
        }
        Ok(ControlFlow::Continue(()))
    }

    /// Whether nothing is left to do on this line.
    fn is_over(&self) -> bool {
        let Some(until) = self.ending else { return self.board.inbox().is_closed() };
        let is_late = clock::now() >= until;
        if is_late && !self.core.is_at_rest() {
            tracing::error!(line = self.port.line, "a stop shows no effect; the gateway ends all the same");
        }
        is_late || self.core.is_at_rest()
    }

    /// One message per reason, however often the port is tried.
    fn tell_once(&self, told: &mut Option<String>, error: &OpenError) {
        let text = error.to_string();
        if told.as_ref() != Some(&text) {
            tracing::warn!(line = self.port.line, port = %self.port.path.display(), error = text, "cannot open the port; trying again");
            *told = Some(text);
        }
    }

    async fn serve_port(&mut self, device: &mut Port) -> io::Result<Left> {
        let mut buffer = [0; 512];
        let mut has_more = false;
        loop {
            self.act(Some(device))?;
            if self.is_over() {
                return Ok(Left::Closed);
            }
            if let Some(fault) = self.to_reopen.take() {
                return Ok(Left::ToReopen(fault));
            }
            if let Some(wake) = self.core.next_wake() {
                let ends_silence = wake.reason == WakeReason::SilentInterval;
                self.timer.arm(if ends_silence { wake.at.before(WAKE_EARLY) } else { wake.at })?;
            }
            if !has_more && !self.reply_comes_at_once(device, &mut buffer)? {
                self.wait(Some(&mut *device)).await?;
            }
            self.watch_the_silence_end();
            self.take_messages();
            has_more = self.drain(device, &mut buffer)?;
            self.core.handle(clock::now(), Input::Time);
        }
    }

    /// On a line without character times: looks for the reply for a moment, letting others run meanwhile. Returns
    /// whether something came.
    fn reply_comes_at_once(&mut self, device: &mut Port, buffer: &mut [u8]) -> io::Result<bool> {
        if self.is_paced || !self.core.is_occupied() {
            return Ok(false);
        }
        let until = clock::now() + LOOK_BEFORE_SLEEP;
        while clock::now() < until {
            match device.read_now(buffer)? {
                Some(0) => return Err(io::ErrorKind::UnexpectedEof.into()),
                Some(bytes) => {
                    self.core.handle(clock::now(), Input::Bytes(&buffer[..bytes]));
                    return Ok(true);
                }
                None => std::thread::yield_now(),
            }
        }
        Ok(false)
    }

    /// Watches the clock while the silence before the next frame is about to end.
    fn watch_the_silence_end(&self) {
        let Some(Wake { at, reason: WakeReason::SilentInterval }) = self.core.next_wake() else { return };
        if at.since(clock::now()) <= WAKE_EARLY {
            while clock::now() < at {
                std::hint::spin_loop();
            }
        }
    }

    /// Waits until the timer fires, a message calls, or there is something to read.
    async fn wait(&mut self, mut device: Option<&mut Port>) -> io::Result<()> {
        if !self.board.inbox().may_sleep(!self.core.is_occupied()) {
            return Ok(());
        }
        let inbox = self.board.inbox();
        let mut called = pin!(inbox.called());
        poll_fn(|cx| {
            let fired = self.timer.poll_fired(cx).is_ready();
            let called = called.as_mut().poll(cx).is_ready();
            match device.as_mut().map_or(Poll::Pending, |device| device.poll_readable(cx)) {
                Poll::Pending if fired || called => Poll::Ready(Ok(())),
                read => read,
            }
        })
        .await
    }

    /// Reads until the port has nothing more, asking the port itself and not what the runtime remembers. A
    /// node that never stops is left after a while, so that messages and deadlines have their turn; returns
    /// whether that happened.
    fn drain(&mut self, device: &mut Port, buffer: &mut [u8]) -> io::Result<bool> {
        for _ in 0..READS_PER_ROUND {
            let Some(bytes) = device.read_now(buffer)? else { return Ok(false) };
            if bytes == 0 {
                return Err(io::ErrorKind::UnexpectedEof.into());
            }
            self.core.handle(clock::now(), Input::Bytes(&buffer[..bytes]));
        }
        Ok(true)
    }

    fn take_messages(&mut self) {
        self.board.inbox().take(&mut self.round);
        let now = clock::now();
        for message in self.round.drain(..) {
            let input = match message {
                Message::Native(request) => Input::Native(request),
                Message::Command(command) => Input::Command(command),
                Message::AskerGone(asker) => Input::AskerGone(asker),
                Message::PathAlive(owner) => Input::PathAlive(owner),
                Message::PathOpened(owner) => Input::PathOpened(owner),
                Message::Shutdown => {
                    self.ending = Some(now + ENDING_MAX);
                    Input::Shutdown
                }
            };
            self.core.handle(now, input);
        }
    }

    /// Carries out what the core says.
    fn act(&mut self, mut device: Option<&mut Port>) -> io::Result<()> {
        while let Some(effect) = self.core.next_effect() {
            match effect {
                Effect::Transmit(frame) => {
                    if let Some(device) = &mut device {
                        device.write_frame(&frame)?;
                    }
                }
                Effect::Reopen(fault) => self.to_reopen = Some(fault),
                Effect::Answer(answer) => self.board.tell(News::Native(answer)),
                Effect::Command(answer) => self.board.tell(News::Command(answer)),
                Effect::Trip(drive, event) => {
                    self.log_trip(drive, &event.kind);
                    self.board.tell_trip(drive, event);
                }
                Effect::Note(drive, note) => {
                    tracing::warn!(line = self.port.line, drive = self.name_of(drive), "{note}");
                }
                Effect::LineNote(note) => tracing::warn!(line = self.port.line, "{note}"),
                Effect::Presence(drive, presence) => {
                    tracing::info!(line = self.port.line, drive = self.name_of(drive), ?presence, "drive");
                }
                Effect::Traffic(record) => {
                    tracing::trace!(line = self.port.line, kind = ?record.kind, bytes = ?record.bytes, "traffic");
                }
            }
        }
        self.board.show(&mut self.core);
        Ok(())
    }

    fn log_trip(&self, drive: DriveIndex, kind: &TripEventKind) {
        let (line, drive) = (&self.port.line, self.name_of(drive));
        match kind {
            TripEventKind::Tripped { trips, record } => {
                tracing::warn!(line, drive, trips, code = record.code, "tripped")
            }
            TripEventKind::Cleared => tracing::info!(line, drive, "the trip is cleared"),
        }
    }

    fn name_of(&self, drive: DriveIndex) -> &str {
        self.port.drives.get(drive.get()).map_or("?", String::as_str)
    }
}

fn fault_of(error: &io::Error) -> LineFault {
    match error.kind() {
        io::ErrorKind::UnexpectedEof => LineFault::Gone,
        io::ErrorKind::WriteZero | io::ErrorKind::WouldBlock => LineFault::Stuck,
        _ => LineFault::Failed,
    }
}
