//! `capture`: records the traffic of a line to a file for network analysers.

mod sse;
mod watching;

use crate::cli::tools::CommandFailure;
use crate::cli::tools::log::complain;
use crate::cli::tools::socket::{self, SocketRequest};
use crate::daemon::host::clock;
use crate::daemon::service::signals::told_to_end;
use crate::domain::link::Framing;
use crate::domain::time::MonoTime;
use crate::north::api::{HealthDocument, LostRecords, TrafficLineDocument};
use crate::north::traffic::packets::{PacketFrame, beginning_of, framing_of};
use crate::north::traffic::pcapng;
use std::env::consts::{ARCH, OS};
use std::fs::File;
use std::io::{self, IsTerminal, Write};
use std::path::{Path, PathBuf};
use std::pin::pin;
use std::time::Duration;
use tokio::time::sleep;
use watching::StreamingAnswer;

/// Longest wait for the gateway's description of itself.
const PATIENCE: Duration = Duration::from_secs(5);
/// How often the progress is shown.
const SHOW_EVERY: Duration = Duration::from_millis(500);
/// The longest capture that can be requested: a year.
const SECONDS_MAX: u64 = 366 * 24 * 3600;

/// Arguments of `capture`.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// Name of the line, as in the gateway's configuration; optional if there is only one
    #[arg(long, value_name = "LINE")]
    line: Option<String>,
    /// The pcapng file to write; `-` for stdout, such as a pipe into `wireshark -k -i -`
    #[arg(short, long, value_name = "FILE")]
    out: PathBuf,
    /// End after this time
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..=SECONDS_MAX))]
    seconds: Option<u64>,
    /// End after this many frames, including noise
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..))]
    frames: Option<u64>,
    #[command(flatten)]
    place: socket::SocketArgs,
}

/// Why a capture ended.
enum CaptureEnd {
    /// The arguments or the user wanted the end.
    Wanted,
    /// The gateway sends no more, for this reason.
    Lost(String),
}

/// Records the traffic of a line until it is interrupted, has enough, or the gateway is gone.
pub fn capture(args: &Args) -> Result<(), CommandFailure> {
    let socket = args.place.path()?;
    if is_stdout(&args.out) && io::stdout().is_terminal() {
        return Err(CommandFailure::wrong(
            "--out -: a capture is binary; pipe it into a program",
        ));
    }
    let runtime = tokio::runtime::Builder::new_current_thread()
        .enable_all()
        .build()
        .map_err(CommandFailure::failed)?;
    runtime.block_on(async {
        let stop_signal = pin!(told_to_end().map_err(CommandFailure::failed)?);
        let at =
            |reason| CommandFailure::failed(format!("gateway at {}: {reason}", socket.display()));
        let line = match &args.line {
            Some(line) => line.clone(),
            None => only_line(&socket).await?,
        };
        let mut source = EventSource {
            socket: &socket,
            line: &line,
            seen: None,
            watching: None,
        };
        let header = source.header().await.map_err(at)?;
        let mut capture = CaptureFile::new(args, &header)?;
        let end = tokio::select! {
            () = stop_signal => Ok(CaptureEnd::Wanted),
            () = time_is_up(args.seconds) => Ok(CaptureEnd::Wanted),
            end = capture.run(&mut source) => end,
        };
        capture.finish();
        match end? {
            CaptureEnd::Wanted => Ok(()),
            CaptureEnd::Lost(reason) => {
                let kept = format!(
                    "the {} frames until then are in {}",
                    capture.frames,
                    capture.place()
                );
                Err(at(format!("{reason}; {kept}")))
            }
        }
    })
}

fn is_stdout(out: &Path) -> bool {
    out.as_os_str() == "-"
}

async fn time_is_up(seconds: Option<u64>) {
    match seconds {
        Some(seconds) => sleep(Duration::from_secs(seconds)).await,
        None => std::future::pending().await,
    }
}

/// The line of a gateway that has only one.
async fn only_line(socket: &Path) -> Result<String, CommandFailure> {
    let at =
        |reason: &str| CommandFailure::failed(format!("gateway at {}: {reason}", socket.display()));
    let (_, health) = socket::ask(socket, SocketRequest::get("/api/v1/health"), PATIENCE)
        .await
        .map_err(|reason| at(&reason))?;
    let health: HealthDocument = socket::document(health).map_err(|reason| at(&reason))?;
    let lines = health.lines.iter().map(|line| &*line.name);
    match lines.collect::<Vec<_>>()[..] {
        [line] => Ok(line.to_owned()),
        [] => Err(at("has no line")),
        ref lines => Err(CommandFailure::wrong(format!(
            "--line is needed, one of: {}",
            lines.join(", ")
        ))),
    }
}

/// The event stream of the gateway, over one connection after the other.
struct EventSource<'s> {
    socket: &'s Path,
    line: &'s str,
    /// The last record that was received.
    seen: Option<String>,
    watching: Option<StreamingAnswer>,
}

impl EventSource<'_> {
    /// The gateway's description of the line, which precedes its traffic.
    async fn header(&mut self) -> Result<TrafficLineDocument, String> {
        match self.next().await? {
            Some(event) if event.name == "begin" => {
                serde_json::from_str(&event.data).map_err(|error| error.to_string())
            }
            _ => Err("the gateway did not describe the line".to_owned()),
        }
    }

    /// The next event. A connection that ends regularly is followed by another one.
    async fn next(&mut self) -> Result<Option<sse::SseEvent>, String> {
        loop {
            let watching = match &mut self.watching {
                Some(watching) => watching,
                None => self.watching.insert(
                    StreamingAnswer::begin(self.socket, self.line, self.seen.as_deref()).await?,
                ),
            };
            let event = watching.next().await?;
            match &event {
                Some(event) if event.name == "again" => self.watching = None,
                Some(sse::SseEvent {
                    id: id @ Some(_), ..
                }) => {
                    self.seen.clone_from(id);
                    return Ok(event);
                }
                _ => return Ok(event),
            }
        }
    }
}

/// A file that grows.
struct CaptureFile<'a> {
    args: &'a Args,
    out: Box<dyn Write>,
    framing: Framing,
    frames: u64,
    lost: u64,
    /// Lost since the last frame.
    dropped: u64,
    begun: MonoTime,
    shown: MonoTime,
    shows: bool,
}

impl<'a> CaptureFile<'a> {
    fn new(args: &'a Args, line: &TrafficLineDocument) -> Result<Self, CommandFailure> {
        let out: Box<dyn Write> = if is_stdout(&args.out) {
            Box::new(io::stdout())
        } else {
            let file = File::create(&args.out);
            Box::new(file.map_err(|error| {
                CommandFailure::failed(format!("{}: {error}", args.out.display()))
            })?)
        };
        let now = clock::now();
        let mut capture = Self {
            args,
            out,
            framing: framing_of(line),
            frames: 0,
            lost: 0,
            dropped: 0,
            begun: now,
            shown: MonoTime::ZERO,
            shows: io::stderr().is_terminal(),
        };
        capture.put(&beginning_of(line, (ARCH, OS)))?;
        capture.show();
        Ok(capture)
    }

    /// Writes the events of `source`.
    async fn run(&mut self, source: &mut EventSource<'_>) -> Result<CaptureEnd, CommandFailure> {
        loop {
            let event = match source.next().await {
                Ok(Some(event)) => event,
                Ok(None) => return Ok(CaptureEnd::Lost("it closed the connection".to_owned())),
                Err(reason) => return Ok(CaptureEnd::Lost(reason)),
            };
            let is_read = match event.name.as_str() {
                "frame" => self.frame(&event.data)?,
                "lost" => {
                    let LostRecords { records } =
                        serde_json::from_str(&event.data).unwrap_or_default();
                    self.lost += records;
                    self.dropped += records;
                    true
                }
                _ => true,
            };
            self.show();
            if !is_read || self.args.frames.is_some_and(|most| self.frames >= most) {
                return Ok(CaptureEnd::Wanted);
            }
        }
    }

    /// Writes a frame. Returns whether the output still has a reader.
    fn frame(&mut self, data: &str) -> Result<bool, CommandFailure> {
        let frame = serde_json::from_str(data).ok();
        let Some(packet_frame) = frame.and_then(|frame| PacketFrame::of(&frame, self.framing))
        else {
            return Err(CommandFailure::failed(
                "the gateway's answer cannot be parsed; it may be another version",
            ));
        };
        let dropped = std::mem::take(&mut self.dropped);
        let is_read = self.put(&pcapng::packet(&packet_frame.packet(dropped)))?;
        self.frames += u64::from(is_read);
        Ok(is_read)
    }

    /// Writes a whole block. Returns whether the output still has a reader.
    fn put(&mut self, block: &[u8]) -> Result<bool, CommandFailure> {
        match self.out.write_all(block).and_then(|()| self.out.flush()) {
            Ok(()) => Ok(true),
            Err(error)
                if error.kind() == io::ErrorKind::BrokenPipe && is_stdout(&self.args.out) =>
            {
                Ok(false)
            }
            Err(error) => Err(CommandFailure::failed(format!("{}: {error}", self.place()))),
        }
    }

    fn place(&self) -> String {
        if is_stdout(&self.args.out) {
            "stdout".to_owned()
        } else {
            self.args.out.display().to_string()
        }
    }

    fn summary(&self) -> String {
        let seconds = clock::now().since(self.begun).as_secs_f64();
        let lost = if self.lost == 0 {
            String::new()
        } else {
            format!(", {} lost", self.lost)
        };
        format!("{} frames{lost} in {seconds:.1} s", self.frames)
    }

    /// Shows the progress on a terminal.
    fn show(&mut self) {
        let now = clock::now();
        if self.shows && now.since(self.shown) >= SHOW_EVERY {
            self.shown = now;
            complain(format!("\r{}; Ctrl-C ends   ", self.summary()).as_bytes());
        }
    }

    fn finish(&self) {
        let begin = if self.shows { "\r" } else { "" };
        complain(
            format!(
                "{begin}{} into {}          \n",
                self.summary(),
                self.place()
            )
            .as_bytes(),
        );
    }
}
