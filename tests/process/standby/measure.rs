//! How long it takes until a drive is stopped whose gateway is lost, until a client reads fresh values of the other gateway,
//! and until that one carries out a command, by real programs. Clients look every 10 ms.
//!
//! `ROUNDS=200 BUSES=6 cargo test --locked --test process how_long_a_drive_runs_on -- --ignored --nocapture`

use super::super::hub::meetings;
use super::pair::{A, B, Pair, STOP, other};
use super::watching::{Bounds, Watched, watch, wrong_orders};
use std::fmt::{self, Display};
use std::time::Duration;
use vfd_gateway::daemon::host::clock;
use vfd_gateway::domain::time::MonoTime;

pub const BAUDS: [u32; 2] = [9_600, 38_400];

/// How a gateway is lost.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Loss {
    Kill,
    Hang,
    Unplug,
}

impl Display for Loss {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(match self {
            Self::Kill => "killed",
            Self::Hang => "stopped (SIGSTOP)",
            Self::Unplug => "unplugged",
        })
    }
}

/// What one kind of loss led to at one speed where the half with this rank took the line.
struct Found {
    baud: u32,
    loss: Loss,
    rank: usize,
    bounds: Bounds,
    until_stop: Vec<Duration>,
    /// Where no client commanded.
    until_fresh: Vec<Duration>,
    /// Where a client commanded as soon as it could: until its RUN was carried out, and until all values were fresh.
    until_command: Vec<Duration>,
    until_fresh_beside: Vec<Duration>,
    /// How many of all these took longer than `check` says.
    beyond: usize,
    /// How many frames the one sent that left, each time that two met, and for how long there were two.
    met: Vec<(usize, Duration)>,
    /// Orders other than the declared one and those of the client.
    wrong: usize,
}

#[test]
#[ignore = "a measurement of many minutes"]
fn how_long_a_drive_runs_on_when_its_gateway_is_lost() {
    let (rounds, buses) = (rounds(), buses());
    let begun = clock::now();
    let bounds = BAUDS.map(|baud| (baud, Bounds::checked(&Pair::new(baud))));
    let cases: Vec<_> = bounds
        .iter()
        .flat_map(|(baud, bounds)| {
            [Loss::Kill, Loss::Hang, Loss::Unplug].map(|loss| (*baud, loss, bounds))
        })
        .collect();
    let rows: Vec<_> = std::thread::scope(|scope| {
        let cases = &cases;
        let players: Vec<_> = (0..buses)
            .map(|bus| {
                scope.spawn(move || {
                    let mine = cases
                        .iter()
                        .enumerate()
                        .filter(|(number, _)| number % buses == bus);
                    mine.map(|(number, (baud, loss, bounds))| {
                        (number, measured(*baud, *loss, bounds, rounds))
                    })
                    .collect::<Vec<_>>()
                })
            })
            .collect();
        let mut rows: Vec<_> = players
            .into_iter()
            .flat_map(|player| player.join().unwrap())
            .collect();
        rows.sort_by_key(|row| row.0);
        rows.into_iter().flat_map(|row| row.1).collect()
    });
    println!(
        "{rounds} rounds of each, {buses} buses at once, {:.0?}",
        clock::now().since(begun)
    );
    print_times(&rows);
    assert!(
        rows.iter()
            .all(|row| row.wrong == 0 && row.met.iter().all(|(frames, _)| *frames <= 1))
    );
}

/// Two tables for the document, and what is said beside them.
fn print_times(rows: &[Found]) {
    const EDGES: &str = "bit/s | the active gateway is | rank of the other one";
    println!("\nSeconds, each median, 99 %, longest and what `check` says. Without commands:\n");
    println!(
        "| {EDGES} | first STOP after | all values fresh after |\n| --- | --- | --- | --- | --- |"
    );
    for row in rows {
        let (stop, fresh) = (
            column(&row.until_stop, row.bounds.stop),
            column(&row.until_fresh, row.bounds.fresh),
        );
        println!(
            "| {} | {} | {} | {stop} | {fresh} |",
            row.baud, row.loss, row.rank
        );
    }
    println!("\nWith a client that runs the other drive as soon as it may:\n");
    println!(
        "| {EDGES} | RUN carried out after | all values fresh after |\n| --- | --- | --- | --- | --- |"
    );
    for row in rows {
        let [command, fresh] = [&row.until_command, &row.until_fresh_beside]
            .map(|times| column(times, row.bounds.fresh));
        println!(
            "| {} | {} | {} | {command} | {fresh} |",
            row.baud, row.loss, row.rank
        );
    }
    println!();
    for Found {
        baud,
        loss,
        rank,
        until_stop,
        until_command,
        beyond,
        met,
        wrong,
        ..
    } in rows
    {
        let longest = met
            .iter()
            .map(|(_, lasted)| *lasted)
            .max()
            .unwrap_or_default();
        let most = met
            .iter()
            .map(|(frames, _)| *frames)
            .max()
            .unwrap_or_default();
        println!(
            "{baud}, {loss}, rank {rank}: {beyond} of {} times beyond `check`; two masters {} times, at most {most} \
             frames and {:.0} ms; {wrong} wrong orders",
            2 * until_stop.len() + until_command.len(),
            met.len(),
            longest.as_secs_f64() * 1e3,
        );
    }
}

/// p50, p99 and the longest in seconds, and what they are to be at most.
pub fn column(times: &[Duration], bound: Duration) -> String {
    let mut times = times.to_vec();
    times.sort();
    let at = |hundredths: usize| {
        times
            .get((times.len() * hundredths / 100).min(times.len().saturating_sub(1)))
            .copied()
    };
    let all = [at(50), at(99), at(100), Some(bound)];
    let shown = all.map(|time| {
        time.map_or_else(
            || "-".to_owned(),
            |time| format!("{:.2}", time.as_secs_f64()),
        )
    });
    shown.join(", ")
}

/// What `rounds` losses led to, of which each half takes the line over in every second one.
fn measured(baud: u32, loss: Loss, bounds: &[Bounds; 2], rounds: usize) -> [Found; 2] {
    let mut pair = Pair::new(baud);
    let mut random = fastrand::Rng::with_seed(baud.into());
    let mut of_ranks = [0, 1].map(|rank| Found::new(baud, loss, rank, bounds[rank]));
    pair.start_one_behind_the_other();
    let mut ups = [1, 1];
    for round in 0..rounds {
        let from = pair.hub.count();
        let active = pair.run_where_it_is_active(1);
        std::thread::sleep(Duration::from_millis(random.u64(0..700)));
        let lost_at = lose(&mut pair, active, loss);
        let seen = pair.hub.count();
        let next = other(active);
        // Each half takes the line over with such a client and without.
        let watched = watch(&pair, next, seen, round % 4 >= 2);
        let stop = pair.wait_for_stop(next, seen);
        let found = &mut of_ranks[usize::from(next == B)];
        found.add(lost_at, stop.start, &watched);
        bring_back(&mut pair, active, loss, &mut ups);
        pair.wait_until_it_stands(1);
        pair.wait_until_it_stands(2);
        // Long enough for one that has not given up to be heard.
        let back = pair.hub.count();
        pair.wait_for_requests(next, 20, back);
        let wrong = wrong_orders(&pair, next, seen, watched.commanded);
        let met = meetings(&pair.hub.frames(from), &[A, B]);
        if wrong > 0 || met.iter().any(|meeting| meeting.frames > 1) {
            println!(
                "{baud}, {loss}, round {round}: {:?}, {met:?}",
                pair.orders(seen)
            );
            println!("{}", pair.told(pair.hub.frames(seen)));
        }
        found.wrong += wrong;
        found.met.extend(
            met.into_iter()
                .map(|meeting| (meeting.frames, meeting.lasted)),
        );
    }
    of_ranks
}

impl Found {
    fn new(baud: u32, loss: Loss, rank: usize, bounds: Bounds) -> Self {
        Self {
            baud,
            loss,
            rank,
            bounds,
            until_stop: Vec::new(),
            until_fresh: Vec::new(),
            until_command: Vec::new(),
            until_fresh_beside: Vec::new(),
            beyond: 0,
            met: Vec::new(),
            wrong: 0,
        }
    }

    /// One round.
    fn add(&mut self, lost_at: MonoTime, stop_at: MonoTime, watched: &Watched) {
        let (stop, fresh) = (stop_at.since(lost_at), watched.fresh_at.since(lost_at));
        let command = watched.commanded.map(|it| it.answered_at.since(lost_at));
        self.until_stop.push(stop);
        if command.is_some() {
            &mut self.until_fresh_beside
        } else {
            &mut self.until_fresh
        }
        .push(fresh);
        self.until_command.extend(command);
        let Bounds {
            stop: first_stop,
            fresh: all_fresh,
        } = self.bounds;
        let beyond = [
            stop > first_stop,
            fresh > all_fresh,
            command.is_some_and(|it| it > all_fresh),
        ];
        self.beyond += beyond.into_iter().filter(|it| *it).count();
    }
}

/// `ROUNDS=200 cargo test --locked --test process stalls_of_any_length -- --ignored --nocapture`
#[test]
#[ignore = "minutes"]
fn stalls_of_any_length_never_make_two_masters() {
    let rounds = rounds();
    std::thread::scope(|scope| {
        for bus in 0..buses() {
            scope.spawn(move || stall_again_and_again(bus, rounds / buses()));
        }
    });
}

fn stall_again_and_again(bus: usize, rounds: usize) {
    let mut pair = Pair::new(BAUDS[bus % 2]);
    let mut random = fastrand::Rng::with_seed(bus as u64);
    pair.start_one_behind_the_other();
    let mut changes = 0;
    for round in 0..rounds {
        let from = pair.hub.count();
        let active = pair.run_where_it_is_active(1);
        let seen = pair.hub.count();
        std::thread::sleep(Duration::from_millis(random.u64(0..700)));
        pair.program(active).signal("STOP");
        // Around the moments at which the one gives up and the other one takes over.
        std::thread::sleep(Duration::from_millis(random.u64(1_200..3_800)));
        pair.program(active).signal("CONT");
        std::thread::sleep(Duration::from_millis(random.u64(0..6_000)));
        let orders = pair.orders(seen);
        let met = meetings(&pair.hub.frames(from), &[A, B]);
        assert!(
            orders
                .iter()
                .all(|order| (order.1, order.2, order.3) == (1, STOP.0, STOP.1)),
            "{round}: {orders:?}"
        );
        assert!(
            met.iter().all(|meeting| meeting.frames <= 1),
            "{round}: {met:?}"
        );
        let now = pair.hub.count();
        changes += usize::from(pair.wait_for_master(now) != active);
    }
    println!("bus {bus}: {rounds} stalls of the active one, {changes} changes, never two masters");
}

pub fn rounds() -> usize {
    std::env::var("ROUNDS").map_or(20, |text| text.parse().expect("ROUNDS is a number"))
}

pub fn buses() -> usize {
    std::env::var("BUSES").map_or(2, |text| text.parse().expect("BUSES is a number"))
}

fn lose(pair: &mut Pair, end: usize, loss: Loss) -> MonoTime {
    match loss {
        Loss::Kill => pair.kill(end),
        Loss::Hang => {
            pair.program(end).signal("STOP");
            clock::now()
        }
        Loss::Unplug => pair.hub.pull_out(end),
    }
}

fn bring_back(pair: &mut Pair, end: usize, loss: Loss, ups: &mut [usize; 2]) {
    match loss {
        Loss::Kill => pair.start(end),
        Loss::Hang => pair.program(end).signal("CONT"),
        Loss::Unplug => {
            pair.hub.plug_in(end);
            let count = &mut ups[usize::from(end == B)];
            *count += 1;
            pair.half(end).wait_until_its_line_is_up(*count);
        }
    }
}
