//! The cost of processes: processor time and memory, as the system counts them.

use std::fs::read_to_string;
use std::time::Duration;

/// The system reports processor time in hundredths of a second, whatever its own tick.
const TICK: Duration = Duration::from_millis(10);

/// The cost of a process so far.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Cost {
    /// Its number.
    pub process: u32,
    /// Its name.
    pub name: String,
    /// Processor time of all its threads.
    pub cpu: Duration,
    /// Resident memory in kB.
    pub resident_kb: u64,
}

impl Cost {
    /// The cost of a process; `None` if it does not exist.
    #[must_use]
    pub fn of(process: u32) -> Option<Self> {
        let stat = read_to_string(format!("/proc/{process}/stat")).ok()?;
        let status = read_to_string(format!("/proc/{process}/status")).ok()?;
        let (name, cpu) = parse(&stat)?;
        let resident = status.lines().find_map(|line| line.strip_prefix("VmRSS:"));
        let resident_kb = resident
            .and_then(|it| it.split_whitespace().next()?.parse().ok())
            .unwrap_or(0);
        Some(Self {
            process,
            name,
            cpu,
            resident_kb,
        })
    }

    /// The processor time since `earlier`, in processors.
    #[must_use]
    pub fn processors_since(&self, earlier: &Self, span: Duration) -> f64 {
        self.cpu.saturating_sub(earlier.cpu).as_secs_f64() / span.as_secs_f64().max(f64::EPSILON)
    }
}

/// Name and processor time in the text of `stat`. The name may contain blanks and brackets.
fn parse(stat: &str) -> Option<(String, Duration)> {
    let (head, rest) = stat.rsplit_once(')')?;
    let (_, name) = head.split_once('(')?;
    // The state is the third field of all; user and system time are the 14th and 15th.
    let ticks = |place: usize| rest.split_whitespace().nth(place - 3)?.parse::<u32>().ok();
    Some((
        name.to_owned(),
        TICK * ticks(14)?.saturating_add(ticks(15)?),
    ))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_times_of_a_process_are_found_behind_any_name() {
        let stat = "42 (a ) (b) S 1 42 42 0 -1 4194560 100 0 0 0 250 50 0 0 20 0 9 0 100 1 2";
        assert_eq!(
            parse(stat),
            Some(("a ) (b".to_owned(), Duration::from_secs(3)))
        );
        assert_eq!(parse("42 (a) S 1"), None);
        assert_eq!(parse(""), None);
    }

    #[test]
    fn this_process_costs_something_and_one_that_is_not_there_nothing() {
        let own = Cost::of(std::process::id()).unwrap();
        assert!(own.resident_kb > 0 && !own.name.is_empty());
        let later = Cost {
            cpu: own.cpu + Duration::from_millis(500),
            ..own.clone()
        };
        assert!((later.processors_since(&own, Duration::from_secs(2)) - 0.25).abs() < 1e-9);
        assert_eq!(Cost::of(u32::MAX), None);
    }
}
