//! What the gateway keeps: trips over kills, what goes on when the disk does not, and what a person reads of it.

use super::plant::{Plant, Wish};
use super::raw::Raw;
use super::rig::{Place, fields, program, simulate, vfd_gateway};
use super::started::{PATIENCE, Started, until};
use serde_json::Value;
use std::net::SocketAddr;
use std::path::Path;
use std::process::Command;

/// The rows of the journal in `data`, as `vfd-gateway journal` prints them.
fn rows(which: &str, data: &Path) -> Vec<Value> {
    let output = vfd_gateway(&[
        "journal",
        which,
        "--data-dir",
        data.to_str().unwrap(),
        "--json",
        "--last",
        "1000",
    ]);
    assert!(
        output.status.success(),
        "{}",
        String::from_utf8_lossy(&output.stderr)
    );
    String::from_utf8(output.stdout)
        .unwrap()
        .lines()
        .map(|line| serde_json::from_str(line).unwrap())
        .collect()
}

/// The numbers and kinds of the trip events.
fn events(data: &Path) -> Vec<(u64, String)> {
    let event = |row: &Value| {
        (
            row["number"].as_u64().unwrap(),
            row["kind"].as_str().unwrap().to_owned(),
        )
    };
    rows("trips", data).iter().map(event).collect()
}

#[test]
fn a_file_that_was_cut_is_shown_as_far_as_it_can_be_and_said_to_be() {
    let place = Place::new();
    let whole = place.file("whole");
    std::fs::create_dir(&whole).unwrap();
    {
        let mut database = rusqlite::Connection::open(whole.join("journal.db")).unwrap();
        vfd_gateway::daemon::journal::schema::make(&mut database, "test").unwrap();
    }
    super::beginning::fill(&whole.join("journal.db"), 100);
    let bytes = std::fs::read(whole.join("journal.db")).unwrap();
    let cuts =
        (0..bytes.len() / 4096).flat_map(|page| [0, 1, 47, 2000].map(|more| page * 4096 + more));
    for cut in cuts {
        let data = place.file("cut");
        std::fs::create_dir(&data).unwrap();
        std::fs::write(data.join("journal.db"), &bytes[..cut]).unwrap();
        let mut journal = program();
        journal.args([
            "journal",
            "--last",
            "1000",
            "--data-dir",
            data.to_str().unwrap(),
        ]);
        let mut journal = Started::new(journal);
        assert_eq!(journal.end_within(PATIENCE).code(), Some(1), "cut to {cut}");
        until("it says why", PATIENCE, || {
            let said = journal.text();
            (said.contains("damaged")
                || said.contains("the journal is empty")
                || said.contains("short"))
            .then_some(())
        });
        std::fs::remove_dir_all(&data).unwrap();
    }
}

#[test]
fn a_trip_outlives_a_kill_once_and_numbers_go_on() {
    let mut plant = Plant::with(Wish {
        simulate: &["--trip-every", "5"],
        ..Wish::default()
    });
    let data = plant.place.file("data");
    plant.run_over_mqtt();
    let right = [
        (1, "tripped".to_owned()),
        (2, "cleared".to_owned()),
        (3, "tripped".to_owned()),
    ];
    until(
        "the trip is in the journal while the gateway runs",
        PATIENCE,
        || (events(&data) == right[..1]).then_some(()),
    );
    plant.order("trip/reset", "reset");
    until("so is its end", PATIENCE, || {
        (events(&data) == right[..2]).then_some(())
    });
    plant.gateway.kill();
    plant.start_gateway_again();
    assert_eq!(events(&data), right[..2]);
    plant.run_over_mqtt();
    until("the next trip has the next number", PATIENCE, || {
        (events(&data) == right).then_some(())
    });
    let started = rows("availability", &data)
        .into_iter()
        .filter(|row| row["body"]["state"] == "started");
    assert_eq!(
        started
            .map(|row| row["body"]["changed"].clone())
            .collect::<Vec<_>>(),
        [Value::Bool(false), Value::Bool(false)]
    );
}

/// A gateway with a drive and a data directory, without a broker.
struct Small {
    place: Place,
    gateway: Option<(Started, SocketAddr)>,
    _drive: Started,
}

impl Small {
    fn new() -> Self {
        let place = Place::new();
        let port = place.file("line");
        let drive = simulate(&port);
        std::fs::create_dir(place.file("data")).unwrap();
        let text = format!(
            "[gateway]\ndata_dir = \"{}\"\n[[line]]\nname = \"hall-1\"\nport = \"{}\"\n[[line.drive]]\nname = \"pump-1\"\n\
             model = \"hyundai-n700\"\nstation = 1\npoll = \"200ms\"\n[[modbus_tcp]]\nlisten = \"127.0.0.1:0\"\n",
            place.file("data").display(),
            port.display()
        );
        place.write("gateway.toml", &text);
        Self {
            place,
            gateway: None,
            _drive: drive,
        }
    }

    /// Starts the gateway, behind `strace` with these options if there are any.
    fn run(&mut self, strace: &[&str]) {
        let run = program();
        let mut command = if strace.is_empty() {
            run
        } else {
            let mut command = Command::new("strace");
            // As a grandchild, so that the gateway is the process that is started here and ends with the test.
            command
                .args(["-D", "-f", "-qq", "-o", "/dev/null"])
                .args(strace)
                .arg(run.get_program())
                .args(run.get_args());
            command.env("RUST_LOG", "info");
            command
        };
        command
            .arg("run")
            .arg("-c")
            .arg(self.place.file("gateway.toml"));
        let gateway = Started::new(command);
        let address = gateway.wait_for("where it listens", |line| {
            let fields = fields(line)?;
            (fields["message"] == "Modbus TCP").then(|| fields["address"].as_str()?.parse().ok())?
        });
        self.gateway = Some((gateway, address));
    }

    fn health(&self) -> Option<Value> {
        let socket = self.place.file("data/vfd-gateway.sock");
        let output = vfd_gateway(&["health", "--socket", socket.to_str().unwrap(), "--json"]);
        serde_json::from_slice(&output.stdout).ok()
    }

    /// The drive is read through the gateway.
    fn answers(&self) -> Option<()> {
        let (_, address) = self.gateway.as_ref()?;
        Raw::connect(*address).read(0x0101, 1).ok().map(drop)
    }

    fn terminate(&mut self) {
        let (mut gateway, _) = self.gateway.take().unwrap();
        gateway.terminate();
        assert!(gateway.end_within(PATIENCE).success(), "{}", gateway.text());
    }
}

#[test]
fn while_the_disk_refuses_control_goes_on_and_the_journal_recovers_by_itself() {
    for error in ["EIO", "ENOSPC", "EROFS"] {
        let mut small = Small::new();
        let log = small.place.file("data/journal.db-wal");
        let inject = format!("inject=pwrite64:error={error}:when=1..4");
        small.run(&[
            "-P",
            log.to_str().unwrap(),
            "-e",
            "trace=pwrite64",
            "-e",
            &inject,
        ]);
        let health = until("the journal says that it cannot write", PATIENCE, || {
            let health = small.health()?;
            (health["journal"]["state"] != "ok").then_some(health)
        });
        assert!(health["journal"]["reason"].is_string(), "{health}");
        until("the drive is read all the same", PATIENCE, || {
            small.answers()
        });
        until("the journal can write again", PATIENCE * 2, || {
            (small.health()?["journal"]["state"] == "ok").then_some(())
        });
        small.terminate();
        let states: Vec<_> = rows("availability", &small.place.file("data"));
        for state in ["started", "up", "ended"] {
            assert!(
                states.iter().any(|row| row["body"]["state"] == state),
                "{error}: no {state} in {states:?}"
            );
        }
    }
}

#[test]
fn a_flipped_byte_costs_one_row_and_a_damaged_file_is_kept_beside() {
    let mut small = Small::new();
    let data = small.place.file("data");
    small.run(&[]);
    until("the line is up", PATIENCE, || {
        rows("availability", &data)
            .iter()
            .any(|row| row["kind"] == "line")
            .then_some(())
    });
    small.terminate();
    let file = data.join("journal.db");
    let mut bytes = std::fs::read(&file).unwrap();
    let at = bytes
        .windows(12)
        .position(|text| text == b"\"state\":\"up\"")
        .unwrap();
    bytes[at + 10] ^= 1;
    std::fs::write(&file, &bytes).unwrap();
    let shown = rows("all", &data);
    assert_eq!(
        shown.iter().filter(|row| row["damaged"] == true).count(),
        1,
        "{shown:?}"
    );
    let said = vfd_gateway(&["journal", "--data-dir", data.to_str().unwrap()]);
    assert!(
        String::from_utf8(said.stdout)
            .unwrap()
            .contains("is damaged")
    );

    std::fs::write(&file, &bytes[..bytes.len() / 3]).unwrap();
    small.run(&[]);
    let aside = until("it is moved aside", PATIENCE, || {
        small.health()?["journal"]["moved_aside"]
            .as_str()
            .map(str::to_owned)
    });
    assert_eq!(
        std::fs::metadata(&aside).unwrap().len() as usize,
        bytes.len() / 3
    );
    until("the drive is read", PATIENCE, || small.answers());
    small.terminate();
}

#[test]
fn without_a_journal_and_with_wrong_words_it_says_so() {
    let place = Place::new();
    let directory = place.file("");
    let output = vfd_gateway(&["journal", "--data-dir", directory.to_str().unwrap()]);
    assert_eq!(output.status.code(), Some(1));
    assert!(String::from_utf8_lossy(&output.stderr).contains("there is no journal"));
    assert_eq!(
        vfd_gateway(&["journal", "--since", "yesterday"])
            .status
            .code(),
        Some(2)
    );
}
