//! The disk under the real program fails in every way: control goes on, the state is seen, and nothing is lost in silence
//! or written twice.

use super::mosquitto::free_port;
use super::plant::output;
use super::raw::Raw;
use super::rig::{Place, fields, program};
use super::started::{PATIENCE, Started, until};
use super::yard::{Drive, FAMILIES, configuration};
use serde_json::Value;
use std::io::{Read, Write};
use std::net::{SocketAddr, TcpStream};
use std::path::PathBuf;
use std::process::Command;

/// The drive's uniform unit.
const UNIFORM: u8 = 101;
/// The reasons with which the uniform unit says that a stop is not over yet, that a trip is not seen to be cleared yet, or
/// that there is none.
const REASON: u16 = 261;
const SOON: [u16; 3] = [13, 19, 0];

/// An N700 that trips when it is told to, and a gateway.
struct Site {
    drive: Drive,
    place: Place,
    file: PathBuf,
    modbus: SocketAddr,
    http: SocketAddr,
}

impl Site {
    fn new() -> Self {
        let place = Place::new();
        let drive = Drive::new(&FAMILIES[0], &place);
        std::fs::create_dir(place.file("data")).unwrap();
        let address = || SocketAddr::from(([127, 0, 0, 1], free_port()));
        let (modbus, http) = (address(), address());
        let more = format!("[http]\nlisten = \"{http}\"\n");
        let file = place.write(
            "gateway.toml",
            &configuration(&place, [drive.family], modbus, &more),
        );
        Self {
            drive,
            place,
            file,
            modbus,
            http,
        }
    }

    /// Starts the gateway by way of `wrapper`, and waits until it serves the drive.
    fn run(&self, mut wrapper: Command) -> Started {
        let run = program();
        wrapper
            .arg(run.get_program())
            .args(run.get_args())
            .arg("run")
            .arg("-c")
            .arg(&self.file);
        wrapper.env("RUST_LOG", "info");
        let gateway = Started::new(wrapper);
        gateway.wait_for("that the drive is there", |line| {
            let fields = fields(line)?;
            (fields["message"] == "drive online").then_some(())
        });
        until("the drive is read", PATIENCE, || self.output());
        gateway
    }

    /// The gateway where the system answers these calls on files of the journal as `inject` says.
    fn run_where(&self, files: &[&str], inject: &str) -> Started {
        let mut strace = Command::new("strace");
        // As a grandchild, so that the gateway is the process that is started here and ends with the test.
        strace.args(["-D", "-f", "-qq", "-o", "/dev/null"]);
        for file in files {
            strace.arg("-P").arg(self.place.file("data").join(file));
        }
        strace.arg("-e").arg(format!("inject={inject}"));
        self.run(strace)
    }

    fn output(&self) -> Option<u16> {
        output(self.modbus)
    }

    fn get(&self, path: &str) -> Option<String> {
        let mut stream = TcpStream::connect(self.http).ok()?;
        stream.set_read_timeout(Some(PATIENCE)).unwrap();
        write!(
            stream,
            "GET {path} HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n"
        )
        .ok()?;
        let mut answer = String::new();
        stream.read_to_string(&mut answer).ok()?;
        answer
            .split_once("\r\n\r\n")
            .map(|(_, body)| body.to_owned())
    }

    fn journal(&self) -> Option<Value> {
        let health: Value = serde_json::from_str(&self.get("/api/v1/health")?).ok()?;
        Some(health["journal"].clone())
    }

    fn metric(&self, name: &str) -> Option<f64> {
        let text = self.get("/metrics")?;
        text.lines().find_map(|line| {
            line.strip_prefix(&format!("vfd_gateway_{name} "))?
                .parse()
                .ok()
        })
    }

    fn wait_until_it_works(&self, what: &str) {
        until(
            &format!("the journal can write again after {what}"),
            PATIENCE * 2,
            || (self.journal()?["state"] == "ok").then_some(()),
        );
        until("so do the metrics", PATIENCE, || {
            (self.metric("journal_ok")? == 1.0).then_some(())
        });
    }

    /// A controller stops, sets, starts and stops the drive, and the motor follows.
    fn control(&self) {
        let mut client = Raw::connect(self.modbus);
        for (register, word) in [(256, 0), (257, 3000), (256, 1)] {
            self.write(&mut client, register, word);
        }
        until("the motor turns", PATIENCE, || {
            self.write(&mut client, 256, 1);
            (self.output()? > 200).then_some(())
        });
        self.write(&mut client, 256, 0);
        until("the motor stands", PATIENCE, || {
            (self.output()? == 0).then_some(())
        });
    }

    fn write(&self, client: &mut Raw, register: u16, word: u16) {
        let answer = until("the stop before is effective", PATIENCE, || {
            match client.write(UNIFORM, register, word) {
                Err(6)
                    if client
                        .read_unit(UNIFORM, REASON, 1)
                        .is_ok_and(|reason| SOON.contains(&reason[0])) =>
                {
                    // An order to run that came before the trip was seen to be cleared is given again, behind a stop.
                    (register == 256 && word == 1).then(|| client.write(UNIFORM, register, 0));
                    None
                }
                answer => Some(answer),
            }
        });
        let mut reason = || client.read_unit(UNIFORM, REASON, 1);
        assert!(
            answer == Ok(()),
            "{word} to {register} is answered {answer:?} for the reason {:?}",
            reason()
        );
    }

    /// Trips the drive, and resets it as soon as the gateway has seen that.
    fn trip_and_reset(&self) {
        let seen = || self.metric("drive_trips_seen_total{line=\"n700\",drive=\"n700\"}");
        let before = seen().unwrap();
        self.drive.trip();
        until("the trip is seen", PATIENCE, || {
            (seen()? > before).then_some(())
        });
        let mut client = Raw::connect(self.modbus);
        until("the reset is taken", PATIENCE, || {
            client.write(UNIFORM, 256, 4).ok()
        });
        self.write(&mut client, 256, 0);
    }

    /// The rows of the journal, read by a program that `wrapper` starts.
    fn rows(&self, mut wrapper: Command, which: &str) -> Vec<Value> {
        let run = program();
        let data = self.place.file("data");
        let args = [
            "journal",
            which,
            "--json",
            "--last",
            "100000",
            "--data-dir",
            data.to_str().unwrap(),
        ];
        let said = wrapper.arg(run.get_program()).args(args).output().unwrap();
        assert!(
            said.status.success(),
            "{}",
            String::from_utf8_lossy(&said.stderr)
        );
        String::from_utf8(said.stdout)
            .unwrap()
            .lines()
            .map(|line| serde_json::from_str(line).unwrap())
            .collect()
    }

    /// Every trip stands in the journal once, under numbers without a hole, and so does every order to run.
    fn assert_everything_is_there_once(&self, wrapper: fn(u32) -> Command, id: u32, what: &str) {
        let events = self.rows(wrapper(id), "trips");
        let numbers: Vec<_> = events
            .iter()
            .map(|row| row["number"].as_u64().unwrap())
            .collect();
        let tripped = events.iter().filter(|row| row["kind"] == "tripped");
        let told: u64 = tripped
            .map(|row| row["body"]["trips"].as_u64().unwrap())
            .sum();
        assert_eq!(told, self.drive.trips(), "{what}: {events:?}");
        assert_eq!(
            numbers,
            (1..=numbers.len() as u64).collect::<Vec<_>>(),
            "{what}"
        );
        let audit = self.rows(wrapper(id), "audit");
        let ran = |row: &&Value| {
            let has_run = ["acknowledged", "confirmed"]
                .iter()
                .any(|outcome| row["body"]["outcome"] == *outcome);
            row["body"]["tried"] == "run forward" && has_run
        };
        assert_eq!(
            audit.iter().filter(ran).count(),
            self.drive.runs(),
            "{what}: each order to run is one row: {audit:?}"
        );
        assert_eq!(self.metric("journal_lost_total"), Some(0.0), "{what}");
    }
}

/// A command as it is.
fn as_it_is(_: u32) -> Command {
    Command::new("env")
}

/// A command in the name spaces of the process `id`.
fn inside(id: u32) -> Command {
    let mut nsenter = Command::new("nsenter");
    if !is_root() {
        nsenter.args(["--preserve-credentials", "-U"]);
    }
    nsenter.args(["-m", "-t", &id.to_string()]);
    nsenter
}

/// Root may mount without being root of a name space, where the system forbids that to others.
fn is_root() -> bool {
    let said = Command::new("id").arg("-u").output().unwrap().stdout;
    said == b"0\n"
}

fn end(mut gateway: Started) {
    gateway.terminate();
    assert!(gateway.end_within(PATIENCE).success(), "{}", gateway.text());
}

#[test]
fn a_call_that_fails_loses_and_doubles_nothing() {
    let (file, log) = ("journal.db", "journal.db-wal");
    let table: [(&[&str], &str); 4] = [
        // The rows of a trip are written, and only then it is said that they are not.
        (&[log], "fsync,fdatasync:error=EIO:when=2..3"),
        (&[log], "fsync,fdatasync:error=ENOSPC:when=1+3"),
        (
            &[file, log],
            "pwrite64,fsync,fdatasync,ftruncate:error=EROFS:when=12..16",
        ),
        (&[file], "fsync,fdatasync,pwrite64:error=EIO"),
    ];
    for (files, inject) in table {
        let site = Site::new();
        // The file is there before the disk begins to fail.
        end(site.run(Command::new("env")));
        let gateway = site.run_where(files, inject);
        site.trip_and_reset();
        site.control();
        site.trip_and_reset();
        let is_seen = || (site.metric("journal_failures_total")? > 0.0).then_some(());
        if files.contains(&log) {
            until(&format!("{inject} was met"), PATIENCE, || {
                is_seen().or_else(|| {
                    site.trip_and_reset();
                    None
                })
            });
        }
        site.wait_until_it_works(inject);
        until("nothing waits", PATIENCE, || {
            (site.metric("journal_waiting")? == 0.0).then_some(())
        });
        site.assert_everything_is_there_once(as_it_is, gateway.id(), inject);
        end(gateway);
    }
}

/// What is done to the data directory before the gateway starts, what undoes it, and what the journal says meanwhile.
const AT_START: [(&str, &str, &str); 3] = [
    (
        "mount -t tmpfs none \"$D\" && mount -o remount,ro \"$D\"",
        "mount -o remount,rw \"$D\"",
        "memory",
    ),
    (
        "mount -t tmpfs -o size=64k none \"$D\" && { cat /dev/zero >\"$D/ballast\" 2>/dev/null; :; }",
        "rm \"$D/ballast\" && mount -o remount,size=8m \"$D\"",
        "memory",
    ),
    (
        "rmdir \"$D\" && ln -s \"$D-away/data\" \"$D\"",
        "mkdir -p \"$D-away/data\"",
        "memory",
    ),
];

#[test]
fn a_data_directory_that_cannot_be_written_at_the_start_is_reported_and_stops_no_control() {
    for (before, after, state) in AT_START {
        let site = Site::new();
        let data = site.place.file("data");
        let mut unshare = Command::new("unshare");
        let prepare = format!("{before} && exec \"$@\"");
        unshare
            .args([
                if is_root() { "-m" } else { "-rm" },
                "sh",
                "-c",
                &prepare,
                "sh",
            ])
            .env("D", &data);
        let gateway = site.run(unshare);
        let shell = |text: &str| {
            inside(gateway.id())
                .env("D", &data)
                .args(["sh", "-c", text])
                .status()
                .unwrap()
        };
        site.control();
        let health: Value = serde_json::from_str(&site.get("/api/v1/health").unwrap()).unwrap();
        assert_eq!(health["journal"]["state"], state, "{before}: {health}");
        assert_eq!(site.metric("journal_ok"), Some(0.0), "{before}");
        let is_reached = health["socket"]["state"] == "ok";
        assert_eq!(
            site.metric("socket_ok"),
            Some(f64::from(u8::from(is_reached))),
            "{before}"
        );
        let advice = site.get("/api/v1/advice").unwrap();
        assert!(
            advice.contains("the journal cannot be written"),
            "{before}: {advice}"
        );
        assert!(
            is_reached || advice.contains("do not reach the gateway"),
            "{before}: {advice}"
        );
        assert!(
            gateway.text().contains("ALARM: cannot write the journal"),
            "{before}"
        );

        // Nobody else may command the same drives meanwhile.
        let text = std::fs::read_to_string(&site.file).unwrap();
        let text = [site.modbus, site.http].iter().fold(text, |text, address| {
            text.replace(
                &address.to_string(),
                &SocketAddr::from(([127, 0, 0, 1], free_port())).to_string(),
            )
        });
        let other = site.place.write("other.toml", &text);
        let run = program();
        let mut second = inside(gateway.id());
        second
            .arg(run.get_program())
            .arg("run")
            .arg("-c")
            .arg(&other);
        let mut second = Started::new(second);
        assert!(!second.end_within(PATIENCE).success(), "{before}");
        until("the second one says why", PATIENCE, || {
            second.text().contains("another gateway").then_some(())
        });

        assert!(shell(after).success(), "{after}");
        site.wait_until_it_works(before);
        until("its own commands reach it", PATIENCE * 2, || {
            (site.metric("socket_ok")? == 1.0).then_some(())
        });
        site.control();
        end(gateway);
    }
}

#[test]
fn a_disk_that_is_full_is_seen_and_what_waited_is_written_when_there_is_room() {
    let site = Site::new();
    let data = site.place.file("data");
    // In a mount name space of its own, with a small file system that lives as long as that.
    let mut unshare = Command::new("unshare");
    let mount = format!(
        "mount -t tmpfs -o size=1m none '{}' && exec \"$@\"",
        data.display()
    );
    unshare.args([
        if is_root() { "-m" } else { "-rm" },
        "sh",
        "-c",
        &mount,
        "sh",
    ]);
    let gateway = site.run(unshare);
    let shell = |text: &str| {
        inside(gateway.id())
            .args(["sh", "-c", text])
            .status()
            .unwrap()
            .success()
    };
    site.trip_and_reset();
    let ballast = data.join("ballast");
    // It ends when there is no room any more.
    assert!(!shell(&format!(
        "exec cat /dev/zero > '{}' 2>/dev/null",
        ballast.display()
    )));
    let journal = until("the journal says that it cannot write", PATIENCE, || {
        site.trip_and_reset();
        site.journal()
            .filter(|journal| journal["state"] == "failed")
    });
    assert!(
        journal["reason"]
            .as_str()
            .is_some_and(|reason| reason.contains("full")),
        "{journal}"
    );
    assert_eq!(site.metric("journal_ok"), Some(0.0));
    site.control();
    assert!(
        site.metric("journal_waiting")
            .is_some_and(|rows| rows > 0.0)
    );
    assert!(shell(&format!("rm '{}'", ballast.display())));
    site.wait_until_it_works("it was full");
    until("nothing waits", PATIENCE, || {
        (site.metric("journal_waiting")? == 0.0).then_some(())
    });
    site.assert_everything_is_there_once(inside, gateway.id(), "full");
    end(gateway);
}

#[test]
fn a_missing_data_dir_is_made_or_said_how_to_make() {
    let site = Site::new();
    let data = site.place.file("data");
    std::fs::remove_dir(&data).unwrap();
    let mut gateway = site.run(Command::new("env"));
    assert!(data.join("journal.db").exists(), "{}", gateway.text());
    gateway.terminate();
    assert!(gateway.end_within(PATIENCE).success());

    let deeper = site.place.file("missing/data");
    let text = std::fs::read_to_string(&site.file).unwrap();
    let other = text.replace(data.to_str().unwrap(), deeper.to_str().unwrap());
    assert_ne!(text, other);
    std::fs::write(&site.file, other).unwrap();
    let gateway = site.run(Command::new("env"));
    let line = format!("-m 750 {}", deeper.display());
    assert!(
        gateway.text_so_far().contains(&line),
        "{}",
        gateway.text_so_far()
    );
    assert!(!deeper.exists());
}
