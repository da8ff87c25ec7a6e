//! Two gateways on one played bus with two drives, and what a test does to them.

use crate::hub::{At, Frame, Hub, meetings};
use crate::raw::Raw;
use crate::rig::{Place, fields, program, terminal, vfd_gateway};
use crate::started::{Started, until};
use std::fmt::Write as _;
use std::fs::File;
use std::net::SocketAddr;
use std::ops::RangeBounds;
use std::path::PathBuf;
use std::process::Command;
use std::time::Duration;
use vfd_gateway::domain::time::MonoTime;

/// Longer than anything takes on a machine that is busy with other tests.
pub const PATIENCE: Duration = Duration::from_secs(60);
/// The ends of the bus.
pub const A: usize = 0;
pub const B: usize = 2;
pub const BABBLER: usize = 4;
/// The run command of the drives, the value that stops, and the uniform registers. Typed from the documents.
pub const STOP: (u16, u16) = (0x0002, 0);
pub const RUN_COMMAND: u16 = 256;
const SETPOINT: u16 = 257;
pub const REASON: u16 = 261;
/// In microhertz.
const TURNS: i64 = 25_000_000;

/// How many frames, and lines of each log, a test that fails prints.
const FRAMES_TOLD: usize = 3000;
const LINES_TOLD: usize = 40;

/// An order that went over the bus: its sender, station, register and word.
pub type Order = (usize, u8, u16, u16);

/// How the bus of a pair differs from the usual one.
#[derive(Clone, Copy)]
pub struct Wish<'a> {
    pub baud: u32,
    /// Where the halves listen for Modbus TCP, and from which network they may be commanded.
    pub listen: [&'a str; 2],
    pub write: &'a str,
    /// Both adapters hear themselves.
    pub echoes: bool,
    /// How long the adapters hold back what they hear.
    pub hold_back: Duration,
    /// The drives have no power.
    pub drives_are_off: bool,
    /// The first half is a gateway on a line of its own, which knows of no other one.
    pub alone: bool,
    /// The lease of a commander.
    pub lost_after: Duration,
}

impl Wish<'_> {
    /// The usual pair at `baud`.
    pub const fn at(baud: u32) -> Self {
        let listen = ["127.0.0.1:0"; 2];
        Self {
            baud,
            listen,
            write: "127.0.0.1/32",
            echoes: false,
            hold_back: Duration::ZERO,
            drives_are_off: false,
            alone: false,
            lost_after: Duration::from_secs(600),
        }
    }
}

pub struct Pair {
    pub halves: [Half; 2],
    pub hub: Hub,
    place: Place,
}

/// One of the two gateways.
pub struct Half {
    pub end: usize,
    pub file: PathBuf,
    pub modbus: SocketAddr,
    /// Enters the surroundings of this half, before the program's own words.
    pub inside: Vec<String>,
    program: Option<Started>,
}

/// The other half of the one at `end`.
pub const fn other(end: usize) -> usize {
    A + B - end
}

impl Pair {
    /// Both halves configured, and none started. The drive at station 1 is to be stopped when its gateway is lost, and the
    /// one at station 2 to be left alone.
    pub fn new(baud: u32) -> Self {
        Self::with(Wish::at(baud))
    }

    pub fn with(wish: Wish<'_>) -> Self {
        let Wish {
            baud,
            write,
            echoes,
            alone,
            ..
        } = wish;
        let place = Place::new();
        let port = |name: &str| {
            if echoes {
                At::Echoing(place.file(name))
            } else {
                At::Port(place.file(name))
            }
        };
        let drives = At::Drives(if wish.drives_are_off { &[] } else { &[1, 2] });
        // At the fourth end a test may speak itself.
        let ends = vec![
            port("line-a"),
            drives,
            port("line-b"),
            At::Port(place.file("foreign")),
            At::Babbler,
        ];
        let hub = Hub::holding_back(wish.hold_back, baud, ends);
        let echo = if echoes { "echo = \"strip\"\n" } else { "" };
        let halves = [(A, "a", "b", 0), (B, "b", "a", 1)].map(|(end, name, partner, rank)| {
            let data = place.file(&format!("data-{name}"));
            std::fs::create_dir(&data).unwrap();
            let listen = wish.listen[usize::from(end == B)];
            let line = place.file(&format!("line-{name}"));
            let standby = format!("[standby]\nhalf = \"{name}\"\npartner = \"{partner}\"\nrank = {rank}\n\n");
            let (standby, of_line) = if alone { (String::new(), "") } else { (standby, "standby = true\n") };
            let head = format!(
                "[gateway]\nname = \"plant\"\ndata_dir = \"{}\"\n\n{standby}[[modbus_tcp]]\nlisten = \"{listen}\"\n\
                 allow = [\"{write}\"]\nwrite = [\"{write}\"]\n\n[[line]]\nname = \"hall-1\"\nport = \"{}\"\nbaud = {baud}\n\
                 {of_line}{echo}",
                data.display(),
                line.display()
            );
            let drives = [(1, "stop"), (2, "hold")].map(|(station, lost)| drive(station, (!alone).then_some(lost), wish.lost_after));
            let text = head + &drives.concat();
            let file = place.write(&format!("{name}.toml"), &text);
            Half { end, file, modbus: ([127, 0, 0, 1], 0).into(), inside: Vec::new(), program: None }
        });
        Self { halves, hub, place }
    }

    /// The port of another device on the bus.
    pub fn foreign(&self) -> File {
        terminal(&self.place.file("foreign"))
    }

    pub fn half(&self, end: usize) -> &Half {
        self.halves.iter().find(|half| half.end == end).unwrap()
    }

    fn half_mut(&mut self, end: usize) -> &mut Half {
        self.halves.iter_mut().find(|half| half.end == end).unwrap()
    }

    /// Starts a half, and waits until it listens on its port.
    pub fn start(&mut self, end: usize) {
        let half = self.half_mut(end);
        half.start();
        half.wait_until_its_line_is_up(1);
    }

    /// Starts both, whose adapters are out.
    pub fn start_without_ports(&mut self) {
        self.halves.iter_mut().for_each(Half::start);
    }

    /// Starts the one, and the other as soon as the first is active.
    pub fn start_one_behind_the_other(&mut self) {
        self.start(A);
        assert_eq!(self.wait_for_master(0), A);
        self.start(B);
    }

    /// Kills a half. Returns when.
    pub fn kill(&mut self, end: usize) -> MonoTime {
        self.half_mut(end).program.as_mut().expect("it runs").kill();
        vfd_gateway::daemon::host::clock::now()
    }

    /// Starts a half without waiting for its line.
    pub fn start_at_once(&mut self, end: usize) {
        self.half_mut(end).start();
    }

    pub fn program(&self, end: usize) -> &Started {
        self.half(end).program.as_ref().expect("it was started")
    }

    /// Waits until only one half has sent for a second, behind the first `seen` frames; returns its end.
    pub fn wait_for_master(&self, seen: usize) -> usize {
        self.wait_for_master_for(Duration::from_secs(1), seen)
    }

    /// The same for another time.
    pub fn wait_for_master_for(&self, time: Duration, seen: usize) -> usize {
        until("one is active", PATIENCE, || {
            let now = vfd_gateway::daemon::host::clock::now();
            let requests = requests(self.hub.frames(seen));
            let newest: Vec<_> = requests
                .iter()
                .filter(|frame| now.since(frame.start) < time)
                .collect();
            let first = newest.first()?.from;
            (newest.len() > 1 && newest.iter().all(|frame| frame.from == first)).then_some(first)
        })
    }

    /// Waits until `end` has sent this many requests behind the first `seen` frames.
    pub fn wait_for_requests(&self, end: usize, count: usize, seen: usize) {
        until("it polls", PATIENCE, || {
            (requests(self.hub.frames(seen))
                .iter()
                .filter(|frame| frame.from == end)
                .count()
                >= count)
                .then_some(())
        });
    }

    /// Waits for a frame from `end` that stops the drive at station 1, behind the first `seen` frames.
    pub fn wait_for_stop(&self, end: usize, seen: usize) -> Frame {
        until("the drive is stopped", PATIENCE, || {
            self.hub
                .frames(seen)
                .into_iter()
                .find(|frame| frame.from == end && frame.written(1) == Some(STOP))
        })
    }

    /// Waits for a frame that stops the drive at station 1, or for its answer, behind the first `seen` frames;
    /// `None` if there is none for a long time.
    pub fn stop_by_any(&self, seen: usize) -> Option<Frame> {
        // On a busy machine the hub may play two frames of a half as one. The drive answers with a copy.
        let is_stop = |frame: &Frame| frame.from != BABBLER && frame.written(1) == Some(STOP);
        let mut looks = 0..PATIENCE.as_millis() / 20;
        looks.find_map(|_| {
            std::thread::sleep(Duration::from_millis(20));
            self.hub.frames(seen).into_iter().find(is_stop)
        })
    }

    /// Starts the drive at `station` by way of the gateway at `end`, at 30 Hz, and waits until it turns.
    pub fn run(&self, end: usize, station: u8) {
        for (register, word) in [(RUN_COMMAND, 0), (SETPOINT, 3000), (RUN_COMMAND, 1)] {
            until(&format!("{word} in {register} is taken"), PATIENCE, || {
                self.write(end, station, register, word).ok()
            });
        }
        until("the motor turns", PATIENCE, || {
            (self.hub.output(station) > TURNS).then_some(())
        });
    }

    /// The same at the half that is active, which may change on a busy machine; returns its end.
    pub fn run_where_it_is_active(&self, station: u8) -> usize {
        until(
            "the motor turns by the order of the active half",
            PATIENCE,
            || {
                let active = self.wait_for_master(self.hub.count());
                for (register, word) in [(RUN_COMMAND, 0), (SETPOINT, 3000), (RUN_COMMAND, 1)] {
                    let mut tries = 0..300;
                    tries.find(|_| {
                        std::thread::sleep(Duration::from_millis(10));
                        self.write(active, station, register, word).is_ok()
                    })?;
                }
                let mut looks = 0..300;
                looks.find(|_| {
                    std::thread::sleep(Duration::from_millis(10));
                    self.hub.output(station) > TURNS
                })?;
                Some(active)
            },
        )
    }

    /// Writes to a uniform register of the drive at `station`.
    pub fn write(&self, end: usize, station: u8, register: u16, word: u16) -> Result<(), u8> {
        Raw::connect(self.half(end).modbus).write(100 + station, register, word)
    }

    pub fn wait_until_it_stands(&self, station: u8) {
        until("the motor stands", PATIENCE, || {
            (self.hub.output(station) == 0).then_some(())
        });
    }

    pub fn assert_turns(&self, station: u8) {
        assert!(
            self.hub.output(station) > TURNS,
            "station {station}: {} uHz",
            self.hub.output(station)
        );
    }

    /// Whatever was sent behind the first `seen` frames that is no read.
    pub fn orders(&self, seen: usize) -> Vec<Order> {
        orders(self.hub.frames(seen))
    }

    /// Behind the first `seen` frames the one at `end` has stopped station 1, once or more, and nothing else was ordered.
    #[track_caller]
    pub fn assert_only_stopped_by(&self, end: usize, seen: usize) {
        let orders = self.orders(seen);
        let is_stop = |order: &Order| *order == (end, 1, STOP.0, STOP.1);
        assert!(
            !orders.is_empty() && orders.iter().all(is_stop),
            "{orders:?}"
        );
    }

    /// Among these frames `end` has sent none.
    #[track_caller]
    pub fn assert_silent(&self, end: usize, frames: impl RangeBounds<usize>) {
        let all = self.hub.frames(0).into_iter().enumerate();
        let among = all
            .filter(|(number, _)| frames.contains(number))
            .map(|(_, frame)| frame);
        let sent: Vec<_> = among
            .filter(|frame| frame.from == end && !frame.is_of_listener())
            .collect();
        assert!(sent.is_empty(), "{sent:?}");
    }

    /// Two were never masters for longer than one frame.
    #[track_caller]
    pub fn assert_one_master(&self) {
        let met = meetings(&self.hub.frames(0), &[A, B]);
        assert!(met.iter().all(|meeting| meeting.frames <= 1), "{met:?}");
    }

    /// These frames, and what the halves had to say so far.
    pub fn told(&self, frames: Vec<Frame>) -> String {
        let mut text = String::new();
        for Frame {
            from,
            start,
            bytes,
            is_damaged,
            ..
        } in &frames
        {
            let damaged = if *is_damaged { " damaged" } else { "" };
            let _ = writeln!(text, "{start:?} {from} {bytes:02X?}{damaged}");
        }
        for half in &self.halves {
            let said = half.program.as_ref().map(Started::text).unwrap_or_default();
            let lines: Vec<_> = said.lines().rev().take(LINES_TOLD).collect();
            let _ = writeln!(text, "half at {}:", half.end);
            lines
                .iter()
                .rev()
                .for_each(|line| text.push_str(&format!("  {line}\n")));
        }
        text + &format!("now it is {:?}", vfd_gateway::daemon::host::clock::now())
    }

    /// What `check` prints of a half.
    pub fn checked(&self, end: usize) -> String {
        let output = vfd_gateway(&["check", "-c", self.half(end).file.to_str().unwrap()]);
        let said = String::from_utf8_lossy(&output.stdout).into_owned();
        assert!(
            output.status.success(),
            "{said}{}",
            String::from_utf8_lossy(&output.stderr)
        );
        said
    }
}

/// A test that fails says what went over the bus at its end, and what the halves had to say.
impl Drop for Pair {
    fn drop(&mut self) {
        if !std::thread::panicking() {
            return;
        }
        println!(
            "{}",
            self.told(
                self.hub
                    .frames(self.hub.count().saturating_sub(FRAMES_TOLD))
            )
        );
    }
}

impl Half {
    fn start(&mut self) {
        let run = program();
        let mut words = self
            .inside
            .iter()
            .map(String::as_str)
            .chain([run.get_program().to_str().unwrap()]);
        let mut command = Command::new(words.next().unwrap());
        command
            .args(words)
            .args(run.get_args())
            .arg("run")
            .arg("-c")
            .arg(&self.file)
            .env("RUST_LOG", "info");
        let started = Started::new(command);
        self.modbus = started.wait_for("where it listens", |line| {
            let fields = fields(line)?;
            (fields["message"] == "Modbus TCP").then(|| fields["address"].as_str()?.parse().ok())?
        });
        self.program = Some(started);
    }

    /// Waits until the log has said for the `count`th time that the port is open.
    pub fn wait_until_its_line_is_up(&self, count: usize) {
        let is_up = |line: &String| (fields(line)?["message"] == "line up").then_some(());
        let program = self.program.as_ref().expect("it was started");
        until("the line is up", PATIENCE, || {
            (program.find_all(is_up).len() >= count).then_some(())
        });
    }
}

/// What was sent by the halves among `frames` that is no read.
pub fn orders(frames: Vec<Frame>) -> Vec<Order> {
    let orders = requests(frames)
        .into_iter()
        .filter(|frame| !matches!(frame.bytes[1], 3 | 4 | 8));
    orders
        .map(|frame| {
            let number = |at: usize| u16::from_be_bytes([frame.bytes[at], frame.bytes[at + 1]]);
            (frame.from, frame.bytes[0], number(2), number(4))
        })
        .collect()
}

/// The whole frames of the halves.
pub fn requests(frames: Vec<Frame>) -> Vec<Frame> {
    frames
        .into_iter()
        .filter(|frame| {
            (frame.from == A || frame.from == B) && frame.is_sound() && !frame.is_of_listener()
        })
        .collect()
}

fn drive(station: u8, on_gateway_lost: Option<&str>, lost_after: Duration) -> String {
    let seconds = lost_after.as_secs();
    let lost = on_gateway_lost
        .map(|action| format!("on_gateway_lost = \"{action}\"\n"))
        .unwrap_or_default();
    format!(
        "\n[[line.drive]]\nname = \"pump-{station}\"\nmodel = \"hyundai-n700\"\nstation = {station}\npoll = \"250ms\"\n\n\
         [line.drive.control]\nfrom = [\"modbus-tcp\"]\nfrequency_hz = {{ min = 5.0, max = 50.0 }}\n\
         on_commander_lost = \"stop\"\nlost_after = \"{seconds}s\"\non_shutdown = \"stop\"\n{lost}"
    )
}
