//! The audit on a real disk: every attempt is in exactly one row or in the counter of lost ones, also while the file is
//! locked and after a kill.
//!
//! Some thousands here; `ATTEMPTS=1000000 cargo test --test suite accounting` for more.

use crate::simulation::audit::audit_into;
use rusqlite::Connection;
use serde_json::Value;
use std::collections::BTreeMap;
use std::io::{BufRead, BufReader, Write};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::sync::Arc;
use std::time::Duration;
use vfd_gateway::config;
use vfd_gateway::daemon::exchange::north_sides::NorthSides;
use vfd_gateway::daemon::exchange::shared::{CurrentPlant, SharedPlant};
use vfd_gateway::daemon::host::clock;
use vfd_gateway::daemon::journal::{
    Journal, JournalReport, JournalSource, JournalState, NorthSource, Settings, file_in,
};
use vfd_gateway::daemon::lines::build;
use vfd_gateway::domain::command::{Owner, Reason, Report};
use vfd_gateway::domain::time::MonoTime;
use vfd_gateway::journal::{AttemptId, EntryToKeep, JournalEntry, TriedWrite, WriteAttempt};
use vfd_gateway::vendors;

/// Attempts at one line.
const OF_A_LINE: u64 = 5_000;
/// Rows after which the line waits until they are kept, so that nothing is dropped.
const PAUSE_AFTER: u64 = 1_000;
/// Longer than any write takes.
const PATIENCE: Duration = Duration::from_secs(60);
/// The directory and the seed of a child process of this test.
const CHILD: &str = "ACCOUNTING_CHILD";

fn attempts() -> u64 {
    std::env::var("ATTEMPTS")
        .ok()
        .and_then(|text| text.parse().ok())
        .unwrap_or(20_000)
}

/// A temporary directory that is removed when this is dropped.
struct Place(PathBuf);

impl Place {
    fn new(name: &str) -> Self {
        let path =
            std::env::temp_dir().join(format!("vfd-accounting-{}-{name}", std::process::id()));
        std::fs::create_dir(&path).expect("a directory");
        Self(path)
    }

    /// The contents of the audit: the number of attempts, and how often each text of the north side occurs.
    fn counted(&self) -> (u64, BTreeMap<String, u64>) {
        let connection = Connection::open(file_in(&self.0)).expect("the journal");
        let sql = "SELECT body FROM audit WHERE kind = 'attempt'";
        let mut select = connection.prepare(sql).expect("its table");
        let bodies = select
            .query_map([], |row| row.get::<_, String>(0))
            .expect("its rows");
        let mut all = 0;
        let mut texts = BTreeMap::new();
        for body in bodies {
            let body: Value = serde_json::from_str(&body.expect("a row")).expect("an object");
            let count = body["count"].as_u64().expect("a count");
            all += count;
            if let Some(text) = body["tried"]
                .as_str()
                .filter(|text| text.starts_with("no "))
            {
                *texts.entry(text.to_owned()).or_default() += count;
            }
        }
        (all, texts)
    }
}

impl Drop for Place {
    fn drop(&mut self) {
        let _ = std::fs::remove_dir_all(&self.0);
    }
}

/// A journal with lines and a north side.
struct Desk {
    journal: Arc<Journal>,
    shared: Arc<SharedPlant>,
    north: NorthSource,
    /// Attempts so far.
    said: u64,
    /// Those of the north side.
    of_north: u64,
    waits: bool,
}

impl Desk {
    fn open(directory: &Path) -> Self {
        let drive = |name: &str, station: u8| {
            format!(
                "[[line.drive]]\nname = \"{name}\"\nmodel = \"hyundai-n700\"\nstation = {station}\nunit = {station}\n"
            )
        };
        let text = format!(
            "[[line]]\nname = \"hall-1\"\nport = \"/dev/ttyUSB0\"\n{}{}[[modbus_tcp]]\nlisten = \"127.0.0.1:1502\"\n",
            drive("pump-1", 1),
            drive("pump-2", 2)
        );
        let catalog = vendors::catalog();
        let shared = Arc::new(build::shared(
            &config::load(&text, &catalog).expect("a configuration"),
        ));
        let settings = Settings {
            directory: directory.to_owned(),
            max_bytes: 16_000_000_000,
            configuration: String::new(),
        };
        let (journal, _) = Journal::start(
            &settings,
            NorthSides::default(),
            Arc::clone(&shared.changed),
        )
        .expect("a journal");
        let north = journal.north(CurrentPlant::from(Arc::clone(&shared)));
        Self {
            journal,
            shared,
            north,
            said: 0,
            of_north: 0,
            waits: true,
        }
    }

    /// Starts the line again.
    fn line(&self) -> JournalSource {
        let line = &self.shared.lines[0];
        let drives = self
            .shared
            .drives
            .iter()
            .map(|drive| drive.description.clone())
            .collect();
        self.journal
            .line(line.name.clone(), drives, Arc::clone(&line.inbox))
    }

    /// The line makes an attempt; now and then the north side refuses one, each with another text.
    fn keep(&mut self, source: &JournalSource, keep: EntryToKeep, first: u64) {
        let row = keep.row;
        let is_attempt = matches!(keep.entry, JournalEntry::Attempt(_));
        source.keep(keep);
        self.said += u64::from(is_attempt);
        if is_attempt && row.0.is_multiple_of(3) {
            self.of_north += 1;
            self.said += 1;
            let tried = TriedWrite::Text(format!("no {}", first + self.of_north));
            let report = Some(Report::refused(Reason::NotUnderstood));
            self.north.keep(
                None,
                WriteAttempt {
                    id: AttemptId(self.of_north),
                    owner: Owner::Mqtt,
                    tried,
                    report,
                },
            );
        }
        if self.waits && row.0.is_multiple_of(PAUSE_AFTER) {
            let until = clock::now() + PATIENCE;
            while !source.origin().has_kept(row) {
                assert!(
                    clock::now() < until,
                    "row {row:?} is not kept: {:?}",
                    self.journal.report()
                );
                std::thread::sleep(Duration::from_micros(100));
            }
        }
    }

    /// Lines whose clients make `count` write attempts altogether.
    fn play(&mut self, seed: u64, count: u64) {
        let mut left = count;
        for life in 0.. {
            let now = left.min(OF_A_LINE);
            if now == 0 {
                return;
            }
            left -= now;
            let source = self.line();
            audit_into(seed + life, now, &mut |keep| self.keep(&source, keep, 0))
                .unwrap_or_else(|text| panic!("{text}"));
        }
    }

    fn wait_until_all_is_written(&self) {
        let until = clock::now() + PATIENCE;
        loop {
            let report = self.journal.report();
            if report.state == JournalState::Ok && report.waiting == 0 {
                return;
            }
            assert!(clock::now() < until, "{report:?}");
            std::thread::sleep(Duration::from_millis(10));
        }
    }

    fn close(self) -> JournalReport {
        let runtime = tokio::runtime::Builder::new_current_thread()
            .enable_time()
            .build()
            .expect("a runtime");
        runtime.block_on(self.journal.close(PATIENCE));
        self.journal.report()
    }
}

#[test]
fn every_attempt_is_counted_once_in_the_file() {
    let place = Place::new("calm");
    let mut desk = Desk::open(&place.0);
    desk.play(1, attempts());
    let said = desk.said;
    let of_north = desk.of_north;
    let report = desk.close();
    let (counted, texts) = place.counted();
    println!(
        "{said} attempts were said, {counted} stand in the file, {} are lost",
        report.attempts_lost
    );
    assert!(said > attempts() / 2 && of_north > 100);
    assert_eq!((counted, report.attempts_lost, report.lost), (said, 0, 0));
    assert!(texts.len() as u64 == of_north && texts.values().all(|count| *count == 1));
}

#[test]
fn what_is_lost_while_the_file_is_locked_is_counted_and_nothing_else_is() {
    let place = Place::new("locked");
    let mut desk = Desk::open(&place.0);
    desk.play(10, 1_000);
    // Another process writes to it and does not finish: rows wait, and then the oldest are dropped.
    let mut other = Connection::open(file_in(&place.0)).expect("the journal");
    let lock = other
        .transaction_with_behavior(rusqlite::TransactionBehavior::Immediate)
        .expect("a lock");
    desk.waits = false;
    // Faster than the writer accepts it, and then so slowly that the writer itself has too much.
    desk.play(20, 10_000);
    for part in 0..20 {
        desk.play(30 + part, 1_000);
        std::thread::sleep(Duration::from_millis(120));
    }
    drop(lock);
    desk.wait_until_all_is_written();
    desk.waits = true;
    desk.play(60, 1_000);
    let said = desk.said;
    let report = desk.close();
    let (counted, texts) = place.counted();
    println!(
        "{said} attempts were said, {counted} stand in the file, {} are lost",
        report.attempts_lost
    );
    assert!(
        report.attempts_lost > 100 && report.failures > 0,
        "{report:?}"
    );
    assert_eq!(counted + report.attempts_lost, said, "{report:?}");
    assert!(texts.values().all(|count| *count == 1));
}

/// What was reported as kept before the kill is in the file, and nothing is there twice.
#[test]
fn a_kill_loses_only_what_was_not_kept_and_doubles_nothing() {
    let place = Place::new("killed");
    let mut rng = fastrand::Rng::with_seed(7);
    let mut least = 0;
    let mut most = 0;
    for life in 0..4_u64 {
        let mut command = Command::new(std::env::current_exe().expect("this program"));
        command.args([
            "accounting::plays_until_it_is_killed",
            "--exact",
            "--nocapture",
            "--ignored",
        ]);
        command
            .env(CHILD, format!("{life} {}", place.0.display()))
            .stdout(Stdio::piped())
            .stderr(Stdio::null());
        let mut child = command.spawn().expect("a child");
        let mut lines = BufReader::new(child.stdout.take().expect("its words")).lines();
        // The first output appears when the journal is open.
        let mut last = (0, 0);
        let mut until = MonoTime::NEVER;
        for line in lines.by_ref().map_while(Result::ok) {
            if let Some((said, kept)) = line
                .strip_prefix("said ")
                .and_then(|rest| rest.split_once(" kept "))
            {
                last = (
                    said.parse().expect("a number"),
                    kept.parse().expect("a number"),
                );
                if until == MonoTime::NEVER {
                    until = clock::now() + Duration::from_millis(rng.u64(20..300));
                }
            }
            if clock::now() >= until {
                child.kill().expect("it is killed");
                until = clock::now() + PATIENCE;
            }
        }
        child.wait().expect("it has ended");
        assert!(last.0 > 0, "it was not killed at work");
        least += last.1;
        most += last.0;
    }
    let (counted, texts) = place.counted();
    println!(
        "{least} attempts were kept for sure, {counted} stand in the file, {most} were said at most"
    );
    assert!(
        (least..=most).contains(&counted),
        "{least}, {counted}, {most}"
    );
    assert!(texts.values().all(|count| *count == 1), "a text twice");
}

#[test]
#[ignore = "the child of another test"]
fn plays_until_it_is_killed() {
    let text = std::env::var(CHILD).expect("who started it says where");
    let (life, directory) = text.split_once(' ').expect("a number and a directory");
    let life: u64 = life.parse().expect("a number");
    let mut desk = Desk::open(Path::new(directory));
    let mut kept = 0;
    for part in 0.. {
        let source = desk.line();
        let tell = |desk: &Desk, kept| {
            // One more than may be attempted until the next output.
            let line = format!("said {} kept {kept}\n", desk.said + 2 * PAUSE_AFTER);
            std::io::stdout()
                .write_all(line.as_bytes())
                .expect("somebody listens");
        };
        tell(&desk, kept);
        let played = audit_into(life * 1_000 + part, OF_A_LINE, &mut |keep| {
            let row = keep.row.0;
            desk.keep(&source, keep, (life + 1) * 1_000_000);
            if row % PAUSE_AFTER == 0 {
                // It waited for that row; attempts of the north side meanwhile may come after it.
                kept = desk.said - desk.of_north;
                tell(&desk, kept);
            }
        });
        played.unwrap_or_else(|text| panic!("{text}"));
    }
}
