//! A bus that is played: any number of pseudo-terminals and simulated drives on one pair of wires, where every end hears
//! every other one with character times, and all of it is recorded.

mod record;
mod wire;

pub use record::{FOR_ALL, Frame, meetings};

use record::Record;
use rustix::event::{EventfdFlags, PollFd, PollFlags, eventfd, poll};
use std::os::fd::{AsFd, OwnedFd};
use std::path::{Path, PathBuf};
use std::sync::mpsc::{Receiver, Sender, channel};
use std::sync::{Arc, Mutex};
use std::thread::JoinHandle;
use std::time::Duration;
use vfd_gateway::daemon::host::pty::Pty;
use vfd_gateway::daemon::host::timer::RawTimer;
use vfd_gateway::daemon::host::{clock, sys};
use vfd_gateway::daemon::lines::simulated_end::LineEnd;
use vfd_gateway::domain::ids::Station;
use vfd_gateway::domain::link::{LinkSettings, Parity};
use vfd_gateway::domain::time::MonoTime;
use vfd_gateway::sim::{BusOptions, BusPacing, DriveOptions, SimBus, SimDrive};
use vfd_gateway::vendors;
use wire::Wire;

/// How long an adapter keeps what it has heard while more comes. A pause makes it hand over what it has.
const LATENCY: Duration = Duration::from_millis(4);
/// How often the outputs of the drives are looked at.
const LOOK_UP: Duration = Duration::from_millis(20);
/// From the end of a request to the start of its reply.
const TURNAROUND: Duration = Duration::from_millis(2);

/// What is at an end of the bus.
pub enum At {
    /// A port that a program opens by this name.
    Port(PathBuf),
    /// The same behind an adapter that hears itself.
    Echoing(PathBuf),
    /// N700 drives with ramps of a second.
    Drives(&'static [u8]),
    /// Something that speaks without order when it is told to.
    Babbler,
}

/// The bus. Its ends are numbered as they lie on the pair.
pub struct Hub {
    orders: Sender<(Order, Sender<MonoTime>)>,
    bell: Arc<OwnedFd>,
    seen: Arc<Mutex<Seen>>,
    player: Option<JoinHandle<()>>,
}

/// What a test may see.
struct Seen {
    record: Record,
    /// Station and output frequency in microhertz.
    outputs: Vec<(u8, i64)>,
}

enum Order {
    PlugIn(usize),
    PullOut(usize),
    Cut(Option<usize>),
    Trip(Station, u16),
    Deafen(usize, bool),
    Babble(usize, Duration),
    End,
}

impl Hub {
    /// Plays a bus at `baud` with 8 data bits, no parity and one stop bit. All ports are plugged in.
    pub fn new(baud: u32, ends: Vec<At>) -> Self {
        Self::holding_back(Duration::ZERO, baud, ends)
    }

    /// The same with adapters that hand over what they have heard only this often, as usual USB adapters do: frames come
    /// in pieces with holes between them.
    pub fn holding_back(hold_back: Duration, baud: u32, ends: Vec<At>) -> Self {
        let link = LinkSettings {
            baud,
            data_bits: 8,
            parity: Parity::None,
            stop_bits: 1,
        };
        let bell = Arc::new(
            eventfd(0, EventfdFlags::NONBLOCK | EventfdFlags::CLOEXEC).expect("an eventfd"),
        );
        let seen = Arc::new(Mutex::new(Seen {
            record: Record::new(ends.len()),
            outputs: Vec::new(),
        }));
        let (orders, taken) = channel();
        let mut player = Player {
            wire: Wire::new(ends.len(), link.chars(1.0)),
            ends: ends.into_iter().map(|at| End::new(at, link)).collect(),
            seen: Arc::clone(&seen),
            hold_back,
            hand_over_at: MonoTime::ZERO,
            orders: taken,
            bell: Arc::clone(&bell),
        };
        let player = std::thread::spawn(move || player.play());
        Self {
            orders,
            bell,
            seen,
            player: Some(player),
        }
    }

    /// A device appears again under the name of the port at `end`. Returns when.
    pub fn plug_in(&self, end: usize) -> MonoTime {
        self.order(Order::PlugIn(end))
    }

    /// The adapter at `end` is pulled out, in the middle of whatever it sends. Returns when.
    pub fn pull_out(&self, end: usize) -> MonoTime {
        self.order(Order::PullOut(end))
    }

    /// Cuts the pair behind `end`.
    pub fn cut_behind(&self, end: usize) -> MonoTime {
        self.order(Order::Cut(Some(end)))
    }

    /// The pair is whole again.
    pub fn repair(&self) -> MonoTime {
        self.order(Order::Cut(None))
    }

    /// The drive at `station` trips, with this number of the cause.
    pub fn trip(&self, station: u8, cause: u16) -> MonoTime {
        self.order(Order::Trip(Station(station), cause))
    }

    /// The receiver of the adapter at `end` dies. Returns when.
    pub fn deafen(&self, end: usize) -> MonoTime {
        self.order(Order::Deafen(end, true))
    }

    /// It hears again.
    pub fn hears_again(&self, end: usize) -> MonoTime {
        self.order(Order::Deafen(end, false))
    }

    /// The babbler at `end` speaks for `time` without a pause. Returns when it began.
    pub fn babble(&self, end: usize, time: Duration) -> MonoTime {
        self.order(Order::Babble(end, time))
    }

    /// How many frames there were so far.
    pub fn count(&self) -> usize {
        self.seen.lock().unwrap().record.frames.len()
    }

    /// All frames behind the first `seen`.
    pub fn frames(&self, seen: usize) -> Vec<Frame> {
        self.seen.lock().unwrap().record.frames[seen..].to_vec()
    }

    /// The output frequency of the drive at `station` in microhertz.
    pub fn output(&self, station: u8) -> i64 {
        let outputs = &self.seen.lock().unwrap().outputs;
        outputs
            .iter()
            .find(|(at, _)| *at == station)
            .map_or(0, |(_, output)| *output)
    }

    fn order(&self, order: Order) -> MonoTime {
        let (done, answer) = channel();
        self.orders.send((order, done)).expect("the bus is played");
        rustix::io::write(&self.bell, &1_u64.to_ne_bytes()).expect("the bell rings");
        answer.recv().expect("the bus is played")
    }
}

impl Drop for Hub {
    fn drop(&mut self) {
        let (done, _) = channel();
        let is_taken = self.orders.send((Order::End, done)).is_ok();
        let _ = rustix::io::write(&self.bell, &1_u64.to_ne_bytes());
        let ended = self.player.take().map(JoinHandle::join);
        let is_well = is_taken && ended.is_some_and(|ended| ended.is_ok());
        assert!(is_well || std::thread::panicking(), "the player failed");
    }
}

/// An end as it is played.
enum End {
    Port {
        link: PathBuf,
        pty: Option<Pty>,
        echoes: bool,
        /// What it has heard and the program has not got yet.
        heard: Vec<u8>,
        is_deaf: bool,
    },
    Drives(Box<SimBus>),
    Babbler,
}

impl End {
    fn new(at: At, link: LinkSettings) -> Self {
        let port = |link: PathBuf, echoes| {
            let pty = Some(plugged_in(&link));
            Self::Port {
                pty,
                link,
                echoes,
                heard: Vec::new(),
                is_deaf: false,
            }
        };
        match at {
            At::Port(link) => port(link, false),
            At::Echoing(link) => port(link, true),
            At::Drives(stations) => Self::Drives(Box::new(drives(stations, link))),
            At::Babbler => Self::Babbler,
        }
    }
}

fn plugged_in(link: &Path) -> Pty {
    let mut pty = Pty::new().expect("a pseudo-terminal");
    pty.link_as(link).expect("a link");
    pty
}

/// The wire has the character times here, and not the simulated bus.
fn drives(stations: &[u8], link: LinkSettings) -> SimBus {
    let model = Arc::clone(
        vendors::catalog()
            .find("hyundai-n700")
            .expect("the model is built in"),
    );
    let ramp = Duration::from_secs(1);
    let options = DriveOptions {
        acceleration: ramp,
        deceleration: ramp,
        ..DriveOptions::default()
    };
    let mut bus = SimBus::new(
        link,
        BusOptions {
            pacing: BusPacing::None,
            ..BusOptions::default()
        },
        1,
    );
    for station in stations {
        bus.connect(
            Station(*station),
            SimDrive::new(Arc::clone(&model), options.clone()),
        );
    }
    bus
}

struct Player {
    wire: Wire,
    ends: Vec<End>,
    seen: Arc<Mutex<Seen>>,
    hold_back: Duration,
    hand_over_at: MonoTime,
    orders: Receiver<(Order, Sender<MonoTime>)>,
    bell: Arc<OwnedFd>,
}

impl Player {
    fn play(&mut self) {
        // Without it, characters are late while other tests compute; nothing else changes.
        let _ = sys::ask_for_real_time();
        let mut timer = RawTimer::new().expect("a timer");
        let mut look_up = clock::now();
        loop {
            while let Ok((order, done)) = self.orders.try_recv() {
                if matches!(order, Order::End) {
                    return;
                }
                self.obey(&order);
                // A test that has failed meanwhile does not listen.
                let _ = done.send(clock::now());
            }
            self.take_what_programs_sent();
            let now = clock::now();
            self.pass_on(now);
            if now >= look_up {
                look_up = now + LOOK_UP;
                self.look_at_drives(now);
            }
            if now >= self.hand_over_at {
                self.hand_over_at = now + self.hold_back;
                self.hand_over();
            }
            let on_wire = self.wire.next_pause().map(|pause| pause.min(now + LATENCY));
            let is_held = self
                .ends
                .iter()
                .any(|end| matches!(end, End::Port { heard, .. } if !heard.is_empty()));
            let held = is_held.then_some(self.hand_over_at);
            let dues = self.ends.iter().filter_map(|end| match end {
                End::Drives(bus) => bus.next_due(),
                End::Port { .. } | End::Babbler => None,
            });
            let wake = dues.chain(on_wire).chain(held).fold(look_up, MonoTime::min);
            if wake > clock::now() {
                timer.arm(wake).expect("the timer is armed");
                self.wait(&mut timer);
            }
        }
    }

    fn obey(&mut self, order: &Order) {
        match *order {
            Order::PlugIn(end) => {
                if let End::Port { link, pty, .. } = &mut self.ends[end] {
                    assert!(pty.is_none(), "it is plugged in already");
                    *pty = Some(plugged_in(link));
                }
            }
            Order::PullOut(end) => {
                self.wire.silence(end);
                if let End::Port { pty, heard, .. } = &mut self.ends[end] {
                    *pty = None;
                    heard.clear();
                }
            }
            Order::Cut(behind) => self.wire.cut(behind),
            Order::Trip(station, cause) => self.trip(station, cause),
            Order::Deafen(end, now) => {
                if let End::Port { is_deaf, .. } = &mut self.ends[end] {
                    *is_deaf = now;
                }
            }
            Order::Babble(end, time) => self.wire.babble(clock::now(), end, time),
            Order::End => {}
        }
    }

    fn trip(&mut self, station: Station, cause: u16) {
        let buses = self.ends.iter_mut().filter_map(|end| match end {
            End::Drives(bus) => Some(bus),
            End::Port { .. } | End::Babbler => None,
        });
        let mut drives = buses.filter_map(|bus| bus.drive_mut(station));
        drives
            .next()
            .expect("a drive of this bus")
            .trip(clock::now(), cause);
    }

    fn take_what_programs_sent(&mut self) {
        let mut buffer = [0; 4096];
        for (number, end) in self.ends.iter().enumerate() {
            let End::Port { pty: Some(pty), .. } = end else {
                continue;
            };
            let mut port = pty;
            if let Ok(Some(count @ 1..)) = port.read(&mut buffer) {
                self.wire.put(clock::now(), number, &buffer[..count]);
            }
        }
    }

    /// Everything whose time has come by `now`.
    fn pass_on(&mut self, now: MonoTime) {
        while let Some((character, hearers)) = self.wire.take(now) {
            self.seen.lock().unwrap().record.add(&character);
            if let End::Port {
                echoes: true,
                is_deaf: false,
                heard,
                ..
            } = &mut self.ends[character.from]
            {
                heard.push(character.heard);
            }
            for hearer in hearers {
                match &mut self.ends[hearer] {
                    End::Port {
                        pty,
                        heard,
                        is_deaf: false,
                        ..
                    } if pty.is_some() => heard.push(character.heard),
                    End::Port { .. } | End::Babbler => {}
                    End::Drives(bus) => {
                        bus.receive(character.end, &[character.heard]);
                        let mut reply = Vec::new();
                        bus.take_due(character.end, |_, bytes| reply.extend_from_slice(bytes));
                        self.wire.put(character.end + TURNAROUND, hearer, &reply);
                    }
                }
            }
        }
        for (number, end) in self.ends.iter_mut().enumerate() {
            if let End::Drives(bus) = end {
                // Silence ends a request too.
                bus.take_due(now, |_, bytes| self.wire.put(now, number, bytes));
            }
        }
    }

    fn look_at_drives(&self, now: MonoTime) {
        let mut outputs = Vec::new();
        for end in &self.ends {
            let End::Drives(bus) = end else { continue };
            let stations: Vec<_> = bus.stations().collect();
            outputs.extend(
                stations
                    .iter()
                    .filter_map(|at| Some((at.0, bus.drive(*at)?.output(now)))),
            );
        }
        self.seen.lock().unwrap().outputs = outputs;
    }

    /// Programs get what their adapters have heard.
    fn hand_over(&mut self) {
        for end in &mut self.ends {
            let End::Port {
                pty: Some(pty),
                heard,
                ..
            } = end
            else {
                continue;
            };
            if !heard.is_empty() {
                let mut port = &*pty;
                // What the system has no room for is lost, as in a real driver.
                let _ = port.write(heard);
                heard.clear();
            }
        }
    }

    fn wait(&self, timer: &mut RawTimer) {
        let ports = self.ends.iter().filter_map(|end| match end {
            End::Port { pty, .. } => pty.as_ref().map(|pty| pty.master().as_fd()),
            End::Drives(_) | End::Babbler => None,
        });
        let others = [timer.as_fd(), self.bell.as_fd()];
        let mut fds: Vec<_> = others
            .into_iter()
            .chain(ports)
            .map(|fd| PollFd::from_borrowed_fd(fd, PollFlags::IN))
            .collect();
        // Woken by a signal, it looks in vain.
        let _ = poll(&mut fds, None);
        let has_come = |place: usize| fds[place].revents().contains(PollFlags::IN);
        let (has_fired, has_rung) = (has_come(0), has_come(1));
        drop(fds);
        if has_fired {
            timer.acknowledge();
        }
        if has_rung {
            let _ = rustix::io::read(&*self.bell, &mut [0; 8]);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::rig::{Place, gateway, terminal};
    use super::super::started::{PATIENCE, until};
    use super::*;
    use rustix::time::Timespec;
    use std::fs::File;
    use std::io::{Read, Write};

    /// The read of the output frequency of station 2.
    const READ: [u8; 8] = [2, 3, 1, 1, 0, 1, 0xD4, 0x05];
    const STANDS: [u8; 7] = [2, 3, 2, 0, 0, 0xFC, 0x44];
    /// A read of a register that the gateway does not poll, and its reply, from station 1.
    const ASKED: [u8; 15] = [1, 3, 2, 0x11, 0, 1, 0xD5, 0xB7, 1, 3, 2, 0, 3, 0xF8, 0x45];

    /// What is heard at `port` up to the moment when it ends with `wanted`.
    fn heard_up_to(mut port: &File, wanted: &[u8]) -> Vec<u8> {
        let mut heard = Vec::new();
        while !heard.ends_with(wanted) {
            let mut ready = [PollFd::new(port, PollFlags::IN)];
            let patience = Timespec {
                tv_sec: 20,
                tv_nsec: 0,
            };
            assert!(
                poll(&mut ready, Some(&patience)) == Ok(1),
                "no {wanted:X?} in {heard:X?}"
            );
            let mut byte = [0];
            port.read_exact(&mut byte).unwrap();
            heard.extend(byte);
        }
        heard
    }

    #[test]
    fn every_end_hears_a_request_and_its_reply_in_their_times() {
        let place = Place::new();
        let (one, other) = (place.file("one"), place.file("other"));
        let hub = Hub::new(
            9_600,
            vec![
                At::Port(one.clone()),
                At::Drives(&[1, 2]),
                At::Port(other.clone()),
            ],
        );
        let (speaker, listener) = (terminal(&one), terminal(&other));
        (&speaker).write_all(&READ).unwrap();
        let reply = heard_up_to(&speaker, &STANDS);
        assert_eq!(reply, STANDS);
        assert_eq!(
            heard_up_to(&listener, &STANDS),
            [&READ[..], &STANDS].concat()
        );
        let frames = hub.frames(0);
        assert_eq!(
            frames.iter().map(|frame| frame.from).collect::<Vec<_>>(),
            [0, 1]
        );
        assert!(frames.iter().all(Frame::is_sound), "{frames:?}");
        let [request, reply] = frames.as_slice() else {
            unreachable!()
        };
        let tolerance = Duration::from_micros(1);
        let lasted = |frame: &Frame| frame.end.since(frame.start);
        let is =
            |time: Duration, wanted: u64| time.abs_diff(Duration::from_micros(wanted)) <= tolerance;
        assert!(
            is(lasted(request), 8_333)
                && is(lasted(reply), 7_292)
                && is(reply.start.since(request.end), 2_000)
        );
        assert!(meetings(&frames, &[0, 2]).is_empty());
    }

    #[test]
    fn a_gateway_is_heard_at_another_end_until_its_adapter_is_out_or_the_pair_is_cut() {
        let place = Place::new();
        let port = place.file("line");
        let hub = Hub::new(
            9_600,
            vec![
                At::Port(port.clone()),
                At::Drives(&[1]),
                At::Port(place.file("other")),
            ],
        );
        let listener = terminal(&place.file("other"));
        let gateway = gateway(&place, &port);
        gateway.wait_for_drive();
        let client = || super::super::raw::Raw::connect(gateway.address).read(0x0211, 1);
        assert_eq!(client(), Ok(vec![3]));
        heard_up_to(&listener, &ASKED);
        hub.cut_behind(0);
        assert!(client().is_err(), "the drive is on the other side");
        hub.repair();
        until("the drive is back", PATIENCE, || client().ok());
        hub.pull_out(0);
        until("the line is down", PATIENCE, || {
            (client() == Err(0x0A)).then_some(())
        });
        let seen = hub.count();
        hub.plug_in(0);
        until("the drive is back behind another device", PATIENCE, || {
            client().ok()
        });
        assert!(
            hub.frames(seen)
                .iter()
                .any(|frame| frame.from == 0 && frame.is_sound())
        );
        assert_eq!(hub.output(1), 0);
    }

    /// What looks for two masters finds them.
    #[test]
    fn two_gateways_that_do_not_know_of_each_other_are_seen_as_two_masters() {
        let place = Place::new();
        let ports = ["one", "other"].map(|name| place.file(name));
        let [one, other] = ports.clone().map(At::Port);
        let hub = Hub::new(38_400, vec![one, At::Drives(&[1]), other]);
        let gateways = ports.map(|port| {
            let gateway = gateway(&place, &port);
            gateway.wait_for_drive();
            gateway
        });
        for gateway in gateways.iter().cycle().take(20) {
            // One may damage what the other asks.
            let _ = super::super::raw::Raw::connect(gateway.address).read(0x0211, 1);
        }
        let met = meetings(&hub.frames(0), &[0, 2]);
        assert!(met.iter().any(|meeting| meeting.frames > 1), "{met:?}");
    }
}
