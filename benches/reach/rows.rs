//! The rows of the table.

use crate::bare::{self, Bare};
use crate::clients;
use crate::rig::{Options, Rig};
use crate::support::{self, PROOF, RigOptions};
use crate::table::{Row, medians};
use std::net::TcpStream;
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};
use vfd_gateway::domain::native::NativeOutcome;
use vfd_gateway::sim::{BusOptions, FaultPlan};

const SECOND: Duration = Duration::from_secs(1);

/// No character times, no silence: the cost of the program itself.
pub fn unpaced() -> Vec<Row> {
    let (one, bare) = one_client();
    let rig = Rig::start(&Options::unpaced(1));
    let before = Instant::now();
    clients::run(rig.address, 8, SECOND, 5 * SECOND, |client, n| {
        (1, PROOF + client as u16 * 8 + (n % 8) as u16, 1)
    });
    let took = before.elapsed();
    let line = rig.stop().line;
    vec![
        Row::rate("unpaced: exchanges/s, one client that waits", 7_000.0, one),
        Row::told(
            "bare threads over the same hops in the same run, exchanges/s",
            format!("{bare:.0}"),
        ),
        Row::told(
            "unpaced: one client, part of what the bare threads reach",
            format!("{:.2}", one / bare),
        ),
        Row::rate(
            "unpaced: line exchanges/s, 8 clients",
            15_000.0,
            line.replies as f64 / took.as_secs_f64(),
        ),
    ]
}

/// One client that waits for each answer, and the same hops without the gateway, in turn: medians of five.
fn one_client() -> (f64, f64) {
    let ask = |_: usize, n: u64| (1, PROOF + (n % 64) as u16, 1);
    let rig = Rig::start(&Options::unpaced(1));
    let mut pairs = [(0.0, 0.0); 5];
    for pair in &mut pairs {
        pair.0 = clients::run(rig.address, 1, SECOND / 4, 2 * SECOND, ask).rate();
        let bare = Bare::start();
        pair.1 = clients::run(bare.address, 1, SECOND / 4, 2 * SECOND, ask).rate();
        bare.stop();
    }
    rig.stop();
    medians(&pairs)
}

/// Many clients with the same request, and a thread that answers as many with constant data, in turn: medians of three.
pub fn shared() -> Vec<Row> {
    const CLIENTS: usize = 64;
    let rig = Rig::start(&Options::unpaced(1));
    let mut pairs = [(0.0, 0.0); 3];
    for pair in &mut pairs {
        let load = clients::run(rig.address, CLIENTS, SECOND / 2, 3 * SECOND, |_, _| {
            (1, PROOF, 8)
        });
        assert_eq!(load.exceptions, 0);
        let (address, answerer) = bare::answerer(CLIENTS);
        let from_nothing = clients::run(address, CLIENTS, SECOND / 2, 3 * SECOND, |_, _| {
            (1, PROOF, 8)
        });
        answerer.join().expect("the answerer ends");
        *pair = (load.rate(), from_nothing.rate());
    }
    rig.stop();
    let (answers, from_nothing) = medians(&pairs);
    vec![
        Row::rate("unpaced: shared answers/s, 64 clients", 100_000.0, answers),
        Row::told(
            "a bare thread that answers from nothing, in the same run",
            format!("{from_nothing:.0}"),
        ),
    ]
}

/// Twenty clients that read the same eight drives at 9600.
pub fn fair() -> Vec<Row> {
    let walk = |clients: usize| {
        let rig = Rig::start(&Options::paced(8));
        let next = |client: usize, n: u64| (1 + ((client as u64 * 3 + n) % 8) as u8, 0x0101, 1);
        let load = clients::run(rig.address, clients, 2 * SECOND, 20 * SECOND, next);
        rig.stop();
        load.right
            .into_iter()
            .map(|right| right as f64 / load.took.as_secs_f64())
            .collect::<Vec<_>>()
    };
    let alone = walk(1)[0];
    let worst = walk(20).into_iter().fold(f64::MAX, f64::min);
    vec![
        Row::told(
            "8 drives at 9600: reads/s of one client alone",
            format!("{alone:.2}"),
        ),
        Row::at_least(
            "8 drives at 9600: slowest of 20 clients, part of that",
            0.9,
            worst / alone,
        ),
    ]
}

/// One client that walks over eight drives at 9600, beside polls every second: what it gets if it reads what is not polled,
/// all that is polled, and the same with answers from memory.
pub fn along() -> Vec<Row> {
    const POLLED: [(u16, u16); 4] = [(0x0101, 1), (0x0112, 1), (0x0201, 1), (0x0211, 2)];
    const OTHERS: [(u16, u16); 4] = [(PROOF, 1), (PROOF + 1, 1), (PROOF + 2, 1), (PROOF + 3, 2)];
    let walk = |poll: &'static str, listener_keys: &'static str, reads: [(u16, u16); 4]| {
        let rig = Rig::start(&Options {
            poll,
            listener_keys,
            ..Options::paced(8)
        });
        let next = |_: usize, n: u64| {
            let (address, count) = reads[(n / 8 % 4) as usize];
            (1 + (n % 8) as u8, address, count)
        };
        let load = clients::run(rig.address, 1, 5 * SECOND, 20 * SECOND, next);
        rig.stop();
        load.rate()
    };
    let bare = walk("1h", "", POLLED);
    let beside = walk("1s", "", OTHERS);
    let polled = walk("1s", "", POLLED);
    let cached = walk("1s", "cached = true\n", POLLED);
    vec![
        Row::told(
            "8 drives at 9600: reads/s of one client on the bare line",
            format!("{bare:.2}"),
        ),
        Row::told(
            "the same beside polls every second, of what is not polled",
            format!("{beside:.2}"),
        ),
        Row::told("the same, of all that is polled", format!("{polled:.2}")),
        Row::at_least("what is polled, part of the bare line", 0.96, polled / bare),
        Row::told(
            "the same with `cached`, line and memory",
            format!("{cached:.0}"),
        ),
    ]
}

/// One dead drive of eight; eight clients, one a drive.
pub fn dead() -> Vec<Row> {
    let seven = |dead: Option<u8>| {
        let rig = Rig::start(&Options {
            dead,
            ..Options::paced(8)
        });
        // From the very start, so that finding out that the drive is dead counts too.
        let load = clients::run(rig.address, 7, Duration::ZERO, 60 * SECOND, |client, n| {
            // A client reads its own drive and, every eighth time, the eighth.
            (if n % 8 == 7 { 8 } else { 1 + client as u8 }, 0x0101, 1)
        });
        rig.stop();
        load.rate()
    };
    let all = seven(None) * 7.0 / 8.0;
    let rest = seven(Some(8));
    vec![Row::at_least(
        "one dead drive of 8: rate of the other 7, part of full",
        0.95,
        rest / all,
    )]
}

/// Late replies, in simulation and on a pseudo-terminal.
pub fn late() -> Vec<Row> {
    let begun = Instant::now();
    let runs: Vec<(u64, u64)> = (1..=4)
        .map(|seed| late_in_simulation(seed, 250_000))
        .collect();
    let took = begun.elapsed();
    let (late, wrong) = runs
        .iter()
        .fold((0, 0), |(late, wrong), run| (late + run.0, wrong + run.1));
    let (pty_late, pty_right, pty_wrong) = late_on_pty(if crate::is_quick() { 50 } else { 1000 });
    vec![
        Row::told(
            "late replies in simulation",
            format!("{late} in {:.0} s", took.as_secs_f64()),
        ),
        Row::none(
            "late replies in simulation: taken for another request",
            wrong,
        ),
        Row::told(
            "late replies on a pseudo-terminal / right answers",
            format!("{pty_late} / {pty_right}"),
        ),
        Row::none(
            "late replies on a pseudo-terminal: taken for another",
            pty_wrong,
        ),
    ]
}

fn late_in_simulation(seed: u64, wanted: u64) -> (u64, u64) {
    let faults = FaultPlan {
        late: 300,
        ..FaultPlan::NONE
    };
    let bus = BusOptions {
        faults,
        ..BusOptions::default()
    };
    let mut rig = support::Rig::new(&RigOptions {
        drives: 4,
        bus,
        seed,
        ..RigOptions::default()
    });
    rig.keeps_sent = false;
    for asker in 0..6 {
        rig.read(asker, asker as u16 % 4, PROOF, 1 + asker as u16);
    }
    let mut wrong = 0;
    while rig.bus.report().replies_late < wanted {
        let until = rig.now + 600 * SECOND;
        rig.run_until(until, |rig, answer| {
            if let NativeOutcome::Words(words) = &answer.outcome {
                let expected = rig.sent.last().expect("an answer follows a request").proof;
                wrong += u64::from(words.iter().any(|word| *word != expected));
            }
            let n = answer.ticket.0;
            rig.read(answer.asker.0, (n % 4) as u16, PROOF, 1 + (n % 8) as u16);
        });
    }
    (rig.bus.report().replies_late, wrong)
}

fn late_on_pty(wanted: u64) -> (u64, u64, u64) {
    let faults: FaultPlan = "late=400,timeout-ms=50,lateness-ms=100"
        .parse()
        .expect("a plan");
    let options = Options {
        bus: BusOptions {
            faults,
            ..BusOptions::default()
        },
        line_keys: "reply_timeout = \"50ms\"\n",
        drive_keys: "max_lateness = \"150ms\"\n",
        ..Options::paced(1)
    };
    let rig = Rig::start(&options);
    let mut stream = TcpStream::connect(rig.address).expect("the gateway accepts");
    let mut right = 0;
    let mut wrong = 0;
    let mut n = 0_u16;
    while rig.late.load(Ordering::Acquire) < wanted {
        let heard = rig.exchanges.load(Ordering::Acquire);
        n += 1;
        if let Ok(words) = clients::once(&mut stream, (1, PROOF, 1 + n % 3)) {
            // Every exchange that this request caused is later than all that the drive had received before it.
            let fresh = words
                .iter()
                .all(|word| (word.wrapping_sub(heard as u16) as i16) > 0);
            *(if fresh { &mut right } else { &mut wrong }) += 1;
        }
    }
    (rig.stop().bus.replies_late, right, wrong)
}
