//! What clients of a gateway see while it takes a line over: when all values are fresh, and when a command is carried out.

use super::super::hub::FOR_ALL;
use super::super::raw::Raw;
use super::super::started::until;
use super::pair::{A, B, Order, PATIENCE, Pair, RUN_COMMAND, STOP, orders};
use std::time::Duration;
use vfd_gateway::daemon::host::clock;
use vfd_gateway::domain::time::MonoTime;

/// The uniform words with the status, and with the age of the oldest value, its unit, and what it reads without an age.
const STATUS: u16 = 1;
const AGE: u16 = 12;
const AGE_UNIT: Duration = Duration::from_millis(10);
const NO_AGE: u16 = u16::MAX;
/// Bits of the status word.
const START_INHIBITED: u16 = 1 << 9;
const ON_STANDBY: u16 = 1 << 13;
/// The drive that the client commands. The lost gateway has not run it.
const COMMANDED: u8 = 2;
/// Run forward at 30 Hz, as one request to the uniform unit, and its answer.
const RUN: [u8; 10] = [0x10, 1, 0, 0, 2, 4, 0, 1, 0x0B, 0xB8];
const RUN_IS_TAKEN: [u8; 5] = [0x10, 1, 0, 0, 2];
/// What may go to that drive by the client's orders: the frequency, the run command, and a stop.
const ORDERED: [(u16, u16); 3] = [(0x0004, 3000), (0x0002, 1), STOP];

/// What `check` says that a take-over takes at most.
#[derive(Clone, Copy, Debug)]
pub struct Bounds {
    pub stop: Duration,
    /// Until all values are fresh and commands are accepted.
    pub fresh: Duration,
}

impl Bounds {
    /// Those of the halves with rank 0 and rank 1.
    pub fn checked(pair: &Pair) -> [Self; 2] {
        [A, B].map(|end| {
            let said = pair.checked(end);
            let [stop, fresh] =
                ["first STOP after ", "fresh values and commands after "].map(|what| {
                    said.split_once(what)
                        .and_then(|(_, rest)| time(rest))
                        .unwrap_or_else(|| panic!("no {what}in:\n{said}"))
                });
            Self { stop, fresh }
        })
    }
}

/// The time at the beginning of `text`, as `check` prints it.
fn time(text: &str) -> Option<Duration> {
    let mut words = text.split([' ', ',', '\n']);
    let number: f64 = words.next()?.parse().ok()?;
    match words.next()? {
        "ms" => Some(Duration::from_secs_f64(number / 1e3)),
        "s" => Some(Duration::from_secs_f64(number)),
        _ => None,
    }
}

/// What clients saw of a take-over.
pub struct Watched {
    /// When a client had read that every value was read behind the take-over.
    pub fresh_at: MonoTime,
    pub commanded: Option<Commanded>,
}

/// What a client that commands saw.
#[derive(Clone, Copy)]
pub struct Commanded {
    /// When it had the answer that its RUN is carried out.
    pub answered_at: MonoTime,
    /// How many frames there were when it sent its first order.
    pub idle_until: usize,
}

/// Watches the half at `end` take the line over, behind the first `seen` frames, while a client commands or none does.
pub fn watch(pair: &Pair, end: usize, seen: usize, commands: bool) -> Watched {
    std::thread::scope(|scope| {
        let reader = scope.spawn(|| wait_for_fresh_values(pair, end, seen));
        let commanded = commands.then(|| command(pair, end));
        Watched {
            fresh_at: reader.join().unwrap(),
            commanded,
        }
    })
}

/// Reads the ages of the values every 10 ms, until all are younger than the first frame of `end`.
fn wait_for_fresh_values(pair: &Pair, end: usize, seen: usize) -> MonoTime {
    let mut client = Raw::connect(pair.half(end).modbus);
    let mut taken_over_at = None;
    until("all values are fresh", PATIENCE, || {
        let asked_at = clock::now();
        let ages = [101, 102].map(|unit| client.read_unit(unit, AGE, 1));
        let answered_at = clock::now();
        let first = || {
            pair.hub
                .frames(seen)
                .into_iter()
                .find(|frame| frame.from == end && !frame.is_of_listener())
                .map(|frame| frame.start)
        };
        taken_over_at = taken_over_at.or_else(first);
        let since = taken_over_at?;
        let is_fresh = |age: &Result<Vec<u16>, u8>| match age.as_deref() {
            Ok([age]) if *age != NO_AGE => asked_at >= since + AGE_UNIT * u32::from(*age),
            _ => false,
        };
        ages.iter().all(is_fresh).then_some(answered_at)
    })
}

/// Orders RUN as soon as the half at `end` says that it is not on standby, again every 10 ms until it is carried out, and
/// then STOP. Where the start is inhibited, it orders STOP first, as the documents want it.
fn command(pair: &Pair, end: usize) -> Commanded {
    let unit = 100 + COMMANDED;
    let mut client = Raw::connect(pair.half(end).modbus);
    let mut idle_until = None;
    let answered_at = until("a RUN is carried out", PATIENCE, || {
        let status = client.read_unit(unit, STATUS, 1).ok()?[0];
        if status & ON_STANDBY != 0 {
            return None;
        }
        idle_until = idle_until.or_else(|| Some(pair.hub.count()));
        if status & START_INHIBITED != 0 {
            client.write(unit, RUN_COMMAND, 0).ok()?;
        }
        (client.ask(unit, &RUN) == RUN_IS_TAKEN).then(clock::now)
    });
    until("the drive is stopped again", PATIENCE, || {
        client.write(unit, RUN_COMMAND, 0).ok()
    });
    Commanded {
        answered_at,
        idle_until: idle_until.expect("it has sent an order"),
    }
}

/// Orders behind the first `seen` frames other than the declared stop of station 1 by the half at `end`, and what its client
/// ordered since it commands.
pub fn wrong_orders(pair: &Pair, end: usize, seen: usize, commanded: Option<Commanded>) -> usize {
    let is_declared = |order: &Order| *order == (end, 1, STOP.0, STOP.1);
    // With the declared stop still to be sent, its STOP goes to both drives in one frame.
    let stops_all =
        |order: &Order| order.0 == end && FOR_ALL.contains(&order.1) && (order.2, order.3) == STOP;
    let is_commanded = |order: &Order| {
        (order.0, order.1) == (end, COMMANDED) && ORDERED.contains(&(order.2, order.3))
    };
    let is_of_client = |order: &Order| is_commanded(order) || stops_all(order);
    let mut before = pair.hub.frames(seen);
    let behind = commanded
        .map(|it| before.split_off(it.idle_until - seen))
        .unwrap_or_default();
    let wrong_before = orders(before)
        .iter()
        .filter(|order| !is_declared(order))
        .count();
    let wrong_behind = orders(behind)
        .iter()
        .filter(|order| !is_declared(order) && !is_of_client(order))
        .count();
    wrong_before + wrong_behind
}
