//! One thread per line: it opens the port, feeds [`LineCore`] and carries out what it says.
//!
//! A round: wait for anything; take all messages, all bytes; look at the port once more, so that a frame of
//! ours never starts on top of bytes that have just come; let the core decide; act.

use super::answers::AnswerBox;
use super::clock;
use super::port::{OpenError, Port};
use super::sys;
use super::timer::Timer;
use crate::domain::ids::AskerId;
use crate::domain::link::LinkSettings;
use crate::domain::native::{NativeAnswer, NativeRequest};
use crate::domain::report::{LineCounters, PortFault};
use crate::gateway::{Effect, Input, LineCore, LineSetup};
use std::future::poll_fn;
use std::io;
use std::path::PathBuf;
use std::sync::{Arc, Mutex, PoisonError};
use std::task::Poll;
use std::thread::JoinHandle;
use std::time::Duration;
use tokio::sync::mpsc;

/// Messages that may wait for a line thread. The north side answers exception 06 when it is full.
pub const INBOX_MAX: usize = 4096;
/// Messages taken in one round, so that bytes and deadlines are looked at in between.
const MESSAGES_PER_ROUND: usize = 256;
/// Reads of the port in one round. At 512 bytes each this is more than any port buffers.
const READS_PER_ROUND: usize = 64;
/// First wait before a port that could not be opened is tried again; doubled up to the longest.
const REOPEN_FIRST: Duration = Duration::from_millis(100);
/// Longest such wait: a replugged adapter is back within a second.
const REOPEN_MAX: Duration = Duration::from_millis(800);

/// Something for a line from the north side.
#[derive(Debug)]
pub enum Message {
    /// A client asks.
    Native(NativeRequest),
    /// A client is gone.
    AskerGone(AskerId),
}

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

/// A running line thread. It ends when this is dropped, and [`LineHandle::join`] waits for that.
#[derive(Debug)]
pub struct LineHandle {
    inbox: mpsc::Sender<Message>,
    counters: Arc<Mutex<LineCounters>>,
    thread: JoinHandle<()>,
}

impl LineHandle {
    /// Starts the thread of a line.
    ///
    /// # Errors
    /// The system's refusal to start a thread.
    pub fn start(port: LinePort, setup: LineSetup, answers: Arc<AnswerBox>) -> io::Result<Self> {
        let (inbox, messages) = mpsc::channel(INBOX_MAX);
        let counters = Arc::new(Mutex::new(LineCounters::default()));
        let shared = Arc::clone(&counters);
        let thread = std::thread::Builder::new().name(format!("line {}", port.line)).spawn(move || {
            if let Err(error) = run(&port, setup, messages, answers, shared) {
                tracing::error!(line = port.line, %error, "the line thread could not be set up");
            }
        })?;
        Ok(Self { inbox, counters, thread })
    }

    /// The way in. It is refused when too many messages wait.
    #[must_use]
    pub const fn inbox(&self) -> &mpsc::Sender<Message> {
        &self.inbox
    }

    /// The line's counters as of its last round.
    #[must_use]
    pub fn counters(&self) -> LineCounters {
        *self.counters.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Ends the thread and waits for its end.
    pub fn join(self) {
        drop(self.inbox);
        if self.thread.join().is_err() {
            tracing::error!("a line thread had panicked");
        }
    }
}

fn run(
    port: &LinePort,
    setup: LineSetup,
    messages: mpsc::Receiver<Message>,
    answers: Arc<AnswerBox>,
    counters: Arc<Mutex<LineCounters>>,
) -> io::Result<()> {
    if let Err(error) = sys::ask_for_real_time() {
        tracing::info!(line = port.line, %error, "no real-time priority: gaps may be longer under load, never shorter");
    }
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build()?;
    runtime.block_on(async {
        let core = LineCore::new(setup, clock::now());
        let timer = Timer::new()?;
        let round = Vec::with_capacity(MESSAGES_PER_ROUND);
        let line = LineTask { port, core, timer, messages, round, answers, batch: Vec::new(), counters };
        line.serve().await
    })
}

/// The end of all: nobody can send messages any more.
struct Closed;

struct LineTask<'a> {
    port: &'a LinePort,
    core: LineCore,
    timer: Timer,
    messages: mpsc::Receiver<Message>,
    /// The messages of this round.
    round: Vec<Message>,
    answers: Arc<AnswerBox>,
    /// The answers of this round.
    batch: Vec<NativeAnswer>,
    counters: Arc<Mutex<LineCounters>>,
}

impl LineTask<'_> {
    async fn serve(mut self) -> io::Result<()> {
        let mut told = None;
        loop {
            let Ok(mut device) = self.open(&mut told).await else { return Ok(()) };
            tracing::info!(line = self.port.line, port = %self.port.path.display(), link = %self.port.link, "line up");
            self.core.handle(clock::now(), Input::PortUp);
            let (fault, error) = match self.serve_port(&mut device).await {
                Ok(Closed) => return Ok(()),
                Err(error) => (fault_of(&error), error),
            };
            tracing::warn!(line = self.port.line, %fault, %error, "line down");
            self.core.handle(clock::now(), Input::PortDown(fault));
            self.act(None)?;
        }
    }

    /// Opens the port, again and again with growing waits; meanwhile requests are answered.
    async fn open(&mut self, told: &mut Option<String>) -> Result<Port, Closed> {
        let mut wait = REOPEN_FIRST;
        loop {
            match Port::open(&self.port.path, self.port.link, self.port.needs_pty) {
                Ok(device) => {
                    *told = None;
                    return Ok(device);
                }
                Err(error) => self.tell_once(told, &error),
            }
            let again = tokio::time::sleep(wait);
            tokio::pin!(again);
            loop {
                tokio::select! {
                    () = &mut again => break,
                    received = self.messages.recv_many(&mut self.round, MESSAGES_PER_ROUND) => {
                        if received == 0 {
                            return Err(Closed);
                        }
                        self.take_messages();
                        // Without a port the core transmits nothing, so acting cannot fail.
                        let _ = self.act(None);
                    }
                }
            }
            wait = (wait * 2).min(REOPEN_MAX);
        }
    }

    /// One message per reason, however often the port is tried.
    fn tell_once(&self, told: &mut Option<String>, error: &OpenError) {
        let text = error.to_string();
        if told.as_ref() != Some(&text) {
            tracing::warn!(line = self.port.line, port = %self.port.path.display(), error = text, "cannot open the port; trying again");
            *told = Some(text);
        }
    }

    async fn serve_port(&mut self, device: &mut Port) -> io::Result<Closed> {
        let mut buffer = [0; 512];
        loop {
            self.act(Some(device))?;
            if let Some(wake) = self.core.next_wake() {
                self.timer.arm(wake.at)?;
            }
            let bytes = poll_fn(|cx| {
                let mut woken = self.timer.poll_fired(cx).is_ready();
                if let Poll::Ready(received) = self.messages.poll_recv_many(cx, &mut self.round, MESSAGES_PER_ROUND) {
                    if received == 0 {
                        return Poll::Ready(Ok(None));
                    }
                    woken = true;
                }
                match device.poll_read(cx, &mut buffer) {
                    Poll::Ready(Ok(0)) => Poll::Ready(Err(io::ErrorKind::UnexpectedEof.into())),
                    Poll::Ready(Ok(bytes)) => Poll::Ready(Ok(Some(bytes))),
                    Poll::Ready(Err(error)) => Poll::Ready(Err(error)),
                    Poll::Pending if woken => Poll::Ready(Ok(Some(0))),
                    Poll::Pending => Poll::Pending,
                }
            });
            let Some(bytes) = bytes.await? else { return Ok(Closed) };
            if bytes > 0 {
                self.core.handle(clock::now(), Input::Bytes(&buffer[..bytes]));
            }
            self.take_messages();
            self.drain(device, &mut buffer)?;
            self.core.handle(clock::now(), Input::Time);
        }
    }

    /// Reads until the port has nothing more, asking the port itself and not what the runtime remembers. A
    /// node that never stops is left after a while, so that messages and deadlines have their turn.
    fn drain(&mut self, device: &mut Port, buffer: &mut [u8]) -> io::Result<()> {
        for _ in 0..READS_PER_ROUND {
            let Some(bytes) = device.read_now(buffer)? else { return Ok(()) };
            if bytes == 0 {
                return Err(io::ErrorKind::UnexpectedEof.into());
            }
            self.core.handle(clock::now(), Input::Bytes(&buffer[..bytes]));
        }
        Ok(())
    }

    fn take_messages(&mut self) {
        let now = clock::now();
        for message in self.round.drain(..) {
            let input = match message {
                Message::Native(request) => Input::Native(request),
                Message::AskerGone(asker) => Input::AskerGone(asker),
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
                Effect::Answer(answer) => self.batch.push(answer),
                Effect::Presence(drive, presence) => {
                    let name = self.port.drives.get(drive.get()).map_or("?", String::as_str);
                    tracing::info!(line = self.port.line, drive = name, ?presence, "drive");
                }
                Effect::Traffic(record) => {
                    tracing::trace!(line = self.port.line, kind = ?record.kind, bytes = ?record.bytes, "traffic");
                }
            }
        }
        self.answers.put(&mut self.batch);
        *self.counters.lock().unwrap_or_else(PoisonError::into_inner) = *self.core.counters();
        Ok(())
    }
}

fn fault_of(error: &io::Error) -> PortFault {
    match error.kind() {
        io::ErrorKind::UnexpectedEof => PortFault::Gone,
        io::ErrorKind::WriteZero | io::ErrorKind::WouldBlock => PortFault::Stuck,
        _ => PortFault::Failed,
    }
}
