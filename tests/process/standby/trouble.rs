//! How long a drive runs on where the line, the ears of the active gateway or both gateways are gone, by real programs.
//!
//! `ROUNDS=100 BUSES=6 cargo test --locked --test process how_long_a_drive_runs_on -- --ignored --nocapture`

use super::measure;
use super::pair::{A, B, BABBLER, Pair, RUN_COMMAND, STOP, Wish, other};
use super::watching::Bounds;
use std::fmt::{self, Display};
use std::time::Duration;
use vfd_gateway::daemon::host::clock;
use vfd_gateway::domain::time::MonoTime;

/// Longest jam.
const JAM_MS: u64 = 8_000;
/// How long a gateway that took the line and hears no drive goes on, as the design document says.
const DEAF_FOR: Duration = Duration::from_secs(3);
/// Time for a program to start and to open its port.
const STARTS: Duration = Duration::from_secs(2);
/// A gateway that had commanded the drive before it restarts waits for its commander first.
const LOST_AFTER: Duration = Duration::from_secs(8);
/// The supply of the second half comes back so much later.
const LATER_MS: u64 = 2_000;

/// What goes wrong.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Trouble {
    /// A babbler speaks over everything; meanwhile a client stops the drive at both halves. Measured from its end.
    Jam,
    /// The receiver of the active half dies.
    Deaf,
    /// Both are killed, and the half that was active is started first.
    BothActiveFirst,
    /// The other one is started first.
    BothOtherFirst,
}

const TROUBLES: [Trouble; 4] = [
    Trouble::Jam,
    Trouble::Deaf,
    Trouble::BothActiveFirst,
    Trouble::BothOtherFirst,
];

impl Display for Trouble {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(match self {
            Self::Jam => "a jam, from its end",
            Self::Deaf => "a dead receiver",
            Self::BothActiveFirst => "both restart, the active one first",
            Self::BothOtherFirst => "both restart, the other one first",
        })
    }
}

impl Trouble {
    const fn restarts_both(self) -> bool {
        matches!(self, Self::BothActiveFirst | Self::BothOtherFirst)
    }

    /// How much longer than a take-over it may last.
    fn more(self) -> Duration {
        match self {
            Self::Jam => Duration::ZERO,
            Self::Deaf => DEAF_FOR,
            // The half that had commanded the drive may take the line in either order.
            Self::BothActiveFirst | Self::BothOtherFirst => STARTS + LOST_AFTER,
        }
    }
}

/// What one kind led to at one speed.
struct Found {
    baud: u32,
    trouble: Trouble,
    bound: Duration,
    until_stop: Vec<Duration>,
    /// Rounds in which the drive ran on.
    ran_on: usize,
    /// Orders other than the stop.
    wrong: usize,
}

#[test]
#[ignore = "a measurement of many minutes"]
fn how_long_a_drive_runs_on_in_trouble() {
    let (rounds, buses) = (measure::rounds(), measure::buses());
    let cases: Vec<_> = measure::BAUDS
        .iter()
        .flat_map(|baud| TROUBLES.map(|trouble| (*baud, trouble)))
        .collect();
    let mut rows: Vec<_> = std::thread::scope(|scope| {
        let cases = &cases;
        let players: Vec<_> = (0..buses)
            .map(|bus| {
                scope.spawn(move || {
                    let mine = cases
                        .iter()
                        .enumerate()
                        .filter(|(number, _)| number % buses == bus);
                    mine.map(|(number, (baud, trouble))| {
                        (number, measured(*baud, *trouble, rounds))
                    })
                    .collect::<Vec<_>>()
                })
            })
            .collect();
        players
            .into_iter()
            .flat_map(|player| player.join().unwrap())
            .collect()
    });
    rows.sort_by_key(|row| row.0);
    println!(
        "\nSeconds until the first STOP, each median, 99 %, longest and the bound (`check`, and what the trouble adds):\n"
    );
    println!("| bit/s | what happens | first STOP after | ran on |\n| --- | --- | --- | --- |");
    for (
        _,
        Found {
            baud,
            trouble,
            bound,
            until_stop,
            ran_on,
            ..
        },
    ) in &rows
    {
        println!(
            "| {baud} | {trouble} | {} | {ran_on} of {rounds} |",
            measure::column(until_stop, *bound)
        );
    }
    assert!(
        rows.iter()
            .all(|(_, row)| row.wrong == 0 && row.ran_on == 0)
    );
    assert!(
        rows.iter()
            .all(|(_, row)| row.until_stop.iter().all(|time| *time <= row.bound))
    );
}

fn measured(baud: u32, trouble: Trouble, rounds: usize) -> Found {
    let usual = Wish::at(baud);
    // In the other kinds no lease may end.
    let lost_after = if trouble.restarts_both() {
        LOST_AFTER
    } else {
        usual.lost_after
    };
    let mut pair = Pair::with(Wish {
        lost_after,
        ..usual
    });
    let mut random = fastrand::Rng::with_seed(baud.into());
    let stop = Bounds::checked(&pair)
        .map(|bounds| bounds.stop)
        .into_iter()
        .max()
        .unwrap_or_default();
    let bound = stop + trouble.more();
    let mut found = Found {
        baud,
        trouble,
        bound,
        until_stop: Vec::new(),
        ran_on: 0,
        wrong: 0,
    };
    pair.start_one_behind_the_other();
    for round in 0..rounds {
        let active = pair.run_where_it_is_active(1);
        // The other one has heard who sends.
        let seen = pair.hub.count();
        pair.wait_for_requests(active, 10, seen);
        std::thread::sleep(Duration::from_millis(random.u64(0..700)));
        let seen = pair.hub.count();
        let from = goes_wrong(&mut pair, active, trouble, &mut random);
        let until_stop = pair.stop_by_any(seen).map(|stop| stop.start.since(from));
        if until_stop.is_none_or(|time| time > bound) {
            let trace = pair.told(pair.hub.frames(seen));
            println!("{baud}, {trouble}, round {round}: {until_stop:?}\n{trace}");
        }
        match until_stop {
            Some(time) => found.until_stop.push(time),
            None => found.ran_on += 1,
        }
        if trouble == Trouble::Deaf {
            pair.hub.hears_again(active);
        }
        let orders = pair.orders(seen);
        found.wrong += orders
            .iter()
            .filter(|order| (order.2, order.3) != STOP)
            .count();
        let seen = pair.hub.count();
        pair.wait_for_master_for(Duration::from_secs(3), seen);
        while pair.hub.output(1) != 0 {
            for end in [A, B] {
                let _ = pair.write(end, 1, RUN_COMMAND, 0);
            }
            std::thread::sleep(Duration::from_millis(100));
        }
    }
    found
}

/// Lets it happen. Returns from when on the drive runs for too long.
fn goes_wrong(
    pair: &mut Pair,
    active: usize,
    trouble: Trouble,
    random: &mut fastrand::Rng,
) -> MonoTime {
    match trouble {
        Trouble::Jam => {
            let lasts = Duration::from_millis(random.u64(200..JAM_MS));
            let begun = pair.hub.babble(BABBLER, lasts);
            for end in [A, B] {
                // Whatever the answer is: it is a stop.
                let _ = pair.write(end, 1, RUN_COMMAND, 0);
            }
            (begun + lasts).max(clock::now())
        }
        Trouble::Deaf => pair.hub.deafen(active),
        Trouble::BothActiveFirst | Trouble::BothOtherFirst => {
            let first = if trouble == Trouble::BothActiveFirst {
                active
            } else {
                other(active)
            };
            pair.kill(other(active));
            let killed = pair.kill(active);
            pair.start_at_once(first);
            std::thread::sleep(Duration::from_millis(random.u64(0..LATER_MS)));
            pair.start_at_once(other(first));
            for end in [A, B] {
                pair.half(end).wait_until_its_line_is_up(1);
            }
            killed
        }
    }
}
