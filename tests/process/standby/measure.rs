//! How long it takes until a drive is stopped whose gateway is lost, by real programs.
//!
//! `ROUNDS=200 cargo test --locked --test process how_long_a_drive_runs_on -- --ignored --nocapture`

use super::super::hub::meetings;
use super::pair::{A, B, PATIENCE, Pair, STOP, other};
use std::fmt::{self, Display};
use std::time::Duration;
use vfd_gateway::daemon::host::clock;
use vfd_gateway::domain::time::MonoTime;

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
            Self::Kill => "kill -9",
            Self::Hang => "SIGSTOP",
            Self::Unplug => "unplug",
        })
    }
}

/// What one kind of loss led to.
#[derive(Default)]
struct Found {
    until_stop: Vec<Duration>,
    until_fresh: Vec<Duration>,
    /// How many frames the one sent that left, each time that two met, and for how long there were two.
    met: Vec<(usize, Duration)>,
    /// Orders other than the declared one.
    wrong: usize,
}

#[test]
#[ignore = "a measurement of many minutes"]
fn how_long_a_drive_runs_on_when_its_gateway_is_lost() {
    let (rounds, buses) = (rounds(), buses());
    let begun = clock::now();
    let rows: Vec<_> = std::thread::scope(|scope| {
        let cases = [9_600, 38_400]
            .into_iter()
            .flat_map(|baud| [Loss::Kill, Loss::Hang, Loss::Unplug].into_iter().map(move |loss| (baud, loss)));
        let players: Vec<_> = (0..buses)
            .map(|bus| {
                let cases: Vec<_> = cases.clone().collect();
                scope.spawn(move || {
                    let mine = cases.into_iter().enumerate().filter(|(number, _)| number % buses == bus);
                    mine.map(|(number, (baud, loss))| (number, baud, loss, measured(baud, loss, rounds)))
                        .collect::<Vec<_>>()
                })
            })
            .collect();
        let mut rows: Vec<_> = players.into_iter().flat_map(|player| player.join().unwrap()).collect();
        rows.sort_by_key(|row| row.0);
        rows
    });
    println!("{rounds} rounds of each, {buses} buses at once, {:.0?}", clock::now().since(begun));
    for baud in [9_600, 38_400] {
        let checked = Pair::new(baud).checked(A);
        let of_standby: Vec<_> = checked.lines().filter(|line| line.to_lowercase().contains("standby")).collect();
        println!("check at {baud}:\n{}", of_standby.join("\n"));
    }
    println!(
        "| baud | loss | to STOP: p50 | p99 | longest | to fresh values: p50 | p99 | longest | two masters | wrong |"
    );
    println!("| --- | --- | --- | --- | --- | --- | --- | --- | --- | --- |");
    for (_, baud, loss, found) in &rows {
        let [stop, fresh] = [&found.until_stop, &found.until_fresh].map(|times| columns(times));
        let longest = found.met.iter().map(|(_, lasted)| *lasted).max().unwrap_or_default();
        let most = found.met.iter().map(|(frames, _)| *frames).max().unwrap_or_default();
        let met = format!("{} times, at most {most} frames, {:.0} ms", found.met.len(), longest.as_secs_f64() * 1e3);
        println!("| {baud} | {loss} | {stop} | {fresh} | {met} | {} |", found.wrong);
    }
    assert!(rows.iter().all(|row| row.3.wrong == 0 && row.3.met.iter().all(|(frames, _)| *frames <= 1)));
}

/// p50, p99 and the longest, in seconds.
fn columns(times: &[Duration]) -> String {
    let mut times = times.to_vec();
    times.sort();
    let at = |hundredths: usize| times[(times.len() * hundredths / 100).min(times.len() - 1)].as_secs_f64();
    format!("{:.2} s | {:.2} s | {:.2} s", at(50), at(99), at(100))
}

fn measured(baud: u32, loss: Loss, rounds: usize) -> Found {
    let mut pair = Pair::new(baud);
    let mut random = fastrand::Rng::with_seed(baud.into());
    let mut found = Found::default();
    pair.start_one_behind_the_other();
    let mut ups = [1, 1];
    for round in 0..rounds {
        let from = pair.hub.count();
        let active = pair.run_where_it_is_active(1);
        std::thread::sleep(Duration::from_millis(random.u64(0..700)));
        let lost_at = lose(&mut pair, active, loss);
        let seen = pair.hub.count();
        let next = other(active);
        let stop = pair.wait_for_stop(next, seen);
        found.until_stop.push(stop.start.since(lost_at));
        found.until_fresh.push(first_reply(&pair, next, seen).since(lost_at));
        bring_back(&mut pair, active, loss, &mut ups);
        pair.wait_until_it_stands(1);
        // Long enough for one that has not given up to be heard.
        let back = pair.hub.count();
        pair.wait_for_requests(next, 20, back);
        let wrong = pair.orders(seen).into_iter().filter(|order| *order != (next, 1, STOP.0, STOP.1)).count();
        let met = meetings(&pair.hub.frames(from), &[A, B]);
        if wrong > 0 || met.iter().any(|meeting| meeting.frames > 1) {
            println!("{baud} {loss}, round {round}: {:?}, {met:?}", pair.orders(seen));
            println!("{}", pair.told(pair.hub.frames(seen)));
        }
        found.wrong += wrong;
        found.met.extend(met.into_iter().map(|meeting| (meeting.frames, meeting.lasted)));
    }
    found
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
    let mut pair = Pair::new([9_600, 38_400][bus % 2]);
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
        assert!(orders.iter().all(|order| (order.1, order.2, order.3) == (1, STOP.0, STOP.1)), "{round}: {orders:?}");
        assert!(met.iter().all(|meeting| meeting.frames <= 1), "{round}: {met:?}");
        let now = pair.hub.count();
        changes += usize::from(pair.wait_for_master(now) != active);
    }
    println!("bus {bus}: {rounds} stalls of the active one, {changes} changes, never two masters");
}

fn rounds() -> usize {
    std::env::var("ROUNDS").map_or(20, |text| text.parse().expect("ROUNDS is a number"))
}

fn buses() -> usize {
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

/// The end of the first reply to a read of `end`.
fn first_reply(pair: &Pair, end: usize, seen: usize) -> MonoTime {
    super::until("a drive answers", PATIENCE, || {
        let frames = pair.hub.frames(seen);
        let mut behind =
            frames.iter().skip_while(|frame| !(frame.from == end && matches!(frame.bytes[..], [_, 3, ..])));
        behind.find(|frame| frame.from == 1 && frame.is_sound() && frame.bytes[1] == 3).map(|frame| frame.end)
    })
}
