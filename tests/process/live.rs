//! What the page is told: the whole state first, then changes, trips, lost lines and reloads, to as many as may listen.

use super::mosquitto::free_port;
use super::raw::Raw;
use super::rig::{Place, fields, program, reserved, vfd_gateway};
use super::started::{PATIENCE, Started, until};
use serde_json::Value;
use std::fs::File;
use std::io::{BufRead, BufReader, Read, Write};
use std::net::{Ipv4Addr, SocketAddr, TcpStream};
use std::sync::mpsc::{Receiver, channel};
use std::time::{Duration, Instant};

/// How many may listen at once.
const LISTENERS_MAX: usize = 32;
/// The uniform unit of the first drive, and its words for run and setpoint.
const UNIFORM: u8 = 101;
const RUN: u16 = 256;
const SETPOINT: u16 = 257;

/// A simulated line with a gateway at it.
struct Site {
    place: Place,
    drives: Started,
    _reserved: File,
    gateway: Started,
    modbus: SocketAddr,
    http: SocketAddr,
}

impl Site {
    /// So many drives on one line, which trip when Enter is pressed.
    fn new(drives: u8) -> Self {
        let place = Place::new();
        let port = place.file("line");
        let mut simulate = program();
        simulate.args([
            "simulate",
            "--model",
            "hyundai-n700",
            "--baud",
            "38400",
            "--trip-on-enter",
        ]);
        simulate.arg("--link").arg(&port);
        for station in 1..=drives {
            simulate.args(["--station", &station.to_string()]);
        }
        let simulated = Started::at_a_keyboard(simulate);
        simulated.wait_for("that it plays", |line| {
            line.contains("station").then_some(())
        });
        let reserved = reserved(&port);
        std::fs::create_dir(place.file("data")).unwrap();
        let http = SocketAddr::from((Ipv4Addr::LOCALHOST, free_port()));
        let file = place.write("gateway.toml", &configuration(&place, drives, http));
        let mut command = program();
        command.arg("run").arg("-c").arg(file);
        let gateway = Started::new(command);
        let modbus = gateway.wait_for("where it listens", |line| {
            let fields = fields(line)?;
            (fields["message"] == "Modbus TCP").then(|| fields["address"].as_str()?.parse().ok())?
        });
        let site = Self {
            place,
            drives: simulated,
            _reserved: reserved,
            gateway,
            modbus,
            http,
        };
        until("all drives are known", PATIENCE, || {
            let state = site.json("/api/v1/state")?;
            let drives = state["drives"].as_array()?.clone();
            drives
                .iter()
                .all(|drive| drive["run_state"] == "stopped")
                .then_some(())
        });
        site
    }

    /// Status, head and body of `path`.
    fn get(&self, path: &str) -> Option<(u16, String, String)> {
        let mut stream = TcpStream::connect(self.http).ok()?;
        stream.set_read_timeout(Some(PATIENCE)).unwrap();
        write!(
            stream,
            "GET {path} HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n"
        )
        .ok()?;
        let mut answer = String::new();
        stream.read_to_string(&mut answer).ok()?;
        let (head, body) = answer.split_once("\r\n\r\n")?;
        Some((
            head.split(' ').nth(1)?.parse().ok()?,
            head.to_owned(),
            body.to_owned(),
        ))
    }

    fn json(&self, path: &str) -> Option<Value> {
        serde_json::from_str(&self.get(path)?.2).ok()
    }

    /// Runs the first drive at 30 Hz, as a controller does. Its connection is its lease.
    fn run(&self) -> Raw {
        let mut client = Raw::connect(self.modbus);
        for (register, word) in [(RUN, 0), (SETPOINT, 3000), (RUN, 1)] {
            until("it is taken", PATIENCE, || {
                client.write(UNIFORM, register, word).ok()
            });
        }
        client
    }

    /// Reloads with the first drive in the group of this number.
    fn reload_with_another_group(&self, number: usize) {
        let file = self.place.file("gateway.toml");
        let text = std::fs::read_to_string(&file).unwrap();
        let without: String = text
            .lines()
            .filter(|line| !line.starts_with("group"))
            .flat_map(|line| [line, "\n"])
            .collect();
        let name = "name = \"pump-1\"\n";
        assert!(without.contains(name));
        std::fs::write(
            &file,
            without.replace(name, &format!("{name}group = \"group-{number}\"\n")),
        )
        .unwrap();
        self.gateway.signal("HUP");
    }

    /// Memory of its own in use: how much of the program's file is mapped as well, depends on what else the system does.
    fn resident_kb(&self) -> u64 {
        let status =
            std::fs::read_to_string(format!("/proc/{}/status", self.gateway.id())).unwrap();
        let line = status
            .lines()
            .find_map(|line| line.strip_prefix("RssAnon:"))
            .unwrap();
        line.trim().trim_end_matches(" kB").parse().unwrap()
    }
}

fn configuration(place: &Place, drives: u8, http: SocketAddr) -> String {
    let (data, port) = (place.file("data"), place.file("line"));
    let mut text = format!(
        "[gateway]\nname = \"plant\"\ndata_dir = \"{}\"\n\n[[line]]\nname = \"hall-1\"\nport = \"{}\"\nbaud = 38400\n",
        data.display(),
        port.display()
    );
    for station in 1..=drives {
        text += &format!(
            "\n[[line.drive]]\nname = \"pump-{station}\"\nmodel = \"hyundai-n700\"\nstation = {station}\n\
             poll = \"250ms\"\n\n[line.drive.control]\nfrom = [\"modbus-tcp\"]\nfrequency_hz = {{ min = 5.0, max = 50.0 }}\n\
             on_commander_lost = \"stop\"\nlost_after = \"60s\"\non_shutdown = \"stop\"\n"
        );
    }
    text + &format!(
        "\n[[modbus_tcp]]\nlisten = \"127.0.0.1:0\"\nwrite = [\"127.0.0.1/32\"]\n\n[http]\nlisten = \"{http}\"\n"
    )
}

/// What is heard, with the moment.
struct Heard {
    at: Instant,
    kind: String,
    data: Value,
}

/// One who listens; what it hears waits until it is wanted.
struct Listener {
    status: u16,
    stream: TcpStream,
    heard: Receiver<Heard>,
}

impl Listener {
    fn new(address: SocketAddr) -> Self {
        let mut stream = TcpStream::connect(address).unwrap();
        stream
            .write_all(b"GET /api/v1/events HTTP/1.1\r\nHost: localhost\r\n\r\n")
            .unwrap();
        let mut reader = BufReader::new(stream.try_clone().unwrap());
        let mut line = String::new();
        reader.read_line(&mut line).unwrap();
        let status = line.split(' ').nth(1).unwrap().parse().unwrap();
        let (say, heard) = channel();
        std::thread::spawn(move || {
            let mut kind = String::new();
            for line in reader.lines().map_while(Result::ok) {
                if let Some(name) = line.strip_prefix("event: ") {
                    kind = name.to_owned();
                } else if let Some(data) = line.strip_prefix("data: ") {
                    let data = serde_json::from_str(data).unwrap();
                    // Whoever has enough is gone.
                    let _ = say.send(Heard {
                        at: Instant::now(),
                        kind: kind.clone(),
                        data,
                    });
                }
            }
        });
        Self {
            status,
            stream,
            heard,
        }
    }

    fn next(&self) -> Heard {
        self.heard
            .recv_timeout(PATIENCE)
            .expect("there is something every two seconds")
    }

    /// Waits for an event of this kind of which `found` makes something.
    fn wait_for<T>(&self, kind: &str, mut found: impl FnMut(&Value) -> Option<T>) -> (Instant, T) {
        let end = Instant::now() + PATIENCE;
        let mut last = Value::Null;
        while Instant::now() < end {
            let heard = self.next();
            if heard.kind != kind {
                continue;
            }
            if let Some(it) = found(&heard.data) {
                return (heard.at, it);
            }
            last = heard.data;
        }
        panic!("no such {kind}; the last one: {last}");
    }

    /// Whether the connection has ended.
    fn has_ended(&self) -> bool {
        loop {
            match self.heard.try_recv() {
                Ok(_) => {}
                Err(error) => return error == std::sync::mpsc::TryRecvError::Disconnected,
            }
        }
    }
}

impl Drop for Listener {
    fn drop(&mut self) {
        // One that has ended already is as good.
        let _ = self.stream.shutdown(std::net::Shutdown::Both);
    }
}

fn first_drive(update: &Value) -> Option<&Value> {
    update["drives"]
        .as_array()?
        .iter()
        .find(|drive| drive["name"] == "pump-1")
}

#[test]
fn the_page_hears_of_values_a_trip_and_a_line_that_is_gone() {
    let mut site = Site::new(1);
    let listener = Listener::new(site.http);
    assert_eq!(listener.status, 200);
    let first = listener.next();
    assert_eq!(first.kind, "state");
    let (line, drive) = (&first.data["lines"][0], &first.data["drives"][0]);
    assert_eq!(
        (&line["link"], &line["framing"], &line["state"]),
        (&"38400 8N1".into(), &"rtu".into(), &"up".into())
    );
    assert_eq!(line["port"], site.place.file("line").to_str().unwrap());
    assert!(line["stop_ms"]["one_silent"].as_u64() > line["stop_ms"]["all_healthy"].as_u64());
    assert_eq!(
        (&drive["station"], &drive["presence"]),
        (&1.into(), &"online".into())
    );
    assert_eq!(drive["control"]["from"], serde_json::json!(["modbus-tcp"]));

    let _commander = site.run();
    let mut drive = drive.clone();
    listener.wait_for("update", |update| {
        // An update has what has changed.
        drive
            .as_object_mut()?
            .extend(first_drive(update)?.as_object()?.clone());
        let is_running =
            drive["run_state"] == "forward" && drive["output_frequency_hz"].as_f64()? > 2.0;
        (is_running && drive["control"]["intent"] == "forward").then_some(())
    });
    listener.wait_for("update", |update| {
        update["lines"][0]["use_per_cent"]
            .as_f64()
            .filter(|used| *used > 0.0)
    });
    until("the trend has it", PATIENCE, || {
        let trend = site.json("/api/v1/trend?drive=pump-1")?;
        trend["values"][0]
            .as_array()?
            .iter()
            .any(|hertz| hertz.as_f64() > Some(2.0))
            .then_some(())
    });

    site.drives.type_line("");
    // The log has it as soon as the line does.
    let seen = site.gateway.wait_for("that the drive has tripped", |line| {
        (fields(line)?["message"] == "drive tripped").then(Instant::now)
    });
    let (heard, trip) = listener.wait_for("trip", |trip| Some(trip.clone()));
    assert!(
        heard.saturating_duration_since(seen) < Duration::from_secs(1),
        "{:?}",
        heard.saturating_duration_since(seen)
    );
    assert_eq!(
        (&trip["drive"], &trip["kind"]),
        (&"pump-1".into(), &"tripped".into())
    );
    listener.wait_for("update", |update| {
        (first_drive(update)?["trip"]["active"] == true).then_some(())
    });

    let rows = until("the journal has it", PATIENCE, || {
        let rows = site.json("/api/v1/journal?table=trips&drive=pump-1&since=1h")?["rows"].clone();
        (!rows.as_array()?.is_empty()).then_some(rows)
    });
    assert!(
        rows[0]["kind"] == "tripped"
            && rows[0]["text"]
                .as_str()
                .unwrap()
                .starts_with("tripped, code"),
        "{rows}"
    );
    let (_, head, csv) = site.get("/api/v1/journal?table=trips&format=csv").unwrap();
    let data = site.place.file("data");
    let printed = vfd_gateway(&[
        "journal",
        "trips",
        "--csv",
        "--data-dir",
        data.to_str().unwrap(),
    ]);
    assert_eq!(
        csv,
        String::from_utf8(printed.stdout).unwrap(),
        "as the command prints it"
    );
    assert!(
        head.to_lowercase().contains("content-type: text/csv"),
        "{head}"
    );

    site.drives.kill();
    listener.wait_for("update", |update| {
        (update["lines"][0]["state"] == "down").then_some(())
    });
    // Not always the first: a drive that has just tripped may still turn its motor.
    let advice = until("there is advice on the line", PATIENCE, || {
        let advice = site.json("/api/v1/advice")?["advice"].clone();
        let mut advice = advice.as_array()?.iter();
        advice
            .find(|advice| {
                advice["text"]
                    .as_str()
                    .is_some_and(|text| text.contains("the line is down"))
            })
            .cloned()
    });
    assert_eq!(
        (&advice["severity"], &advice["line"]),
        (&"problem".into(), &"hall-1".into())
    );
}

#[test]
fn a_reload_is_reported_with_what_is_there_now() {
    let site = Site::new(1);
    let listener = Listener::new(site.http);
    assert_eq!(listener.next().kind, "state");
    let file = site.place.file("gateway.toml");
    let text = std::fs::read_to_string(&file).unwrap();
    std::fs::write(&file, text.replace("pump-1", "fan-1")).unwrap();
    site.gateway.signal("HUP");
    listener.wait_for("configuration", |_| Some(()));
    let state = listener.next();
    assert_eq!(
        (state.kind.as_str(), &state.data["drives"][0]["name"]),
        ("state", &"fan-1".into())
    );
    let (status, _, body) = site.get("/api/v1/trend?drive=pump-1").unwrap();
    assert!(status == 404 && body.contains("fan-1"), "{status} {body}");
}

#[test]
fn listeners_have_a_bound_and_take_no_place_of_others() {
    let site = Site::new(1);
    let mut listeners: Vec<_> = (0..LISTENERS_MAX)
        .map(|_| Listener::new(site.http))
        .collect();
    assert!(listeners.iter().all(|listener| listener.status == 200));
    assert_eq!(Listener::new(site.http).status, 503);
    assert_eq!(site.get("/healthz").unwrap().0, 200);
    assert_eq!(site.get("/metrics").unwrap().0, 200);
    assert!(
        listeners
            .iter()
            .all(|listener| listener.next().kind == "state")
    );
    listeners.pop();
    until("the place is free again", PATIENCE, || {
        (Listener::new(site.http).status == 200).then_some(())
    });
    assert!(listeners.iter().all(|listener| !listener.has_ended()));
}

#[test]
fn who_does_not_read_is_let_go_and_memory_stays_bounded() {
    let site = Site::new(16);
    let good = Listener::new(site.http);
    assert_eq!(good.next().kind, "state");
    let before = site.resident_kb();
    let slow: Vec<_> = (0..4).map(|_| who_does_not_read(site.http)).collect();
    // Idle drives send little, and a reload all there is.
    let mut reloads = 0;
    until("all of them are let go", PATIENCE * 3, || {
        if site
            .gateway
            .find_all(|line| line.contains("configuration reloaded").then_some(()))
            .len()
            == reloads
        {
            site.reload_with_another_group(reloads);
            reloads += 1;
        }
        let gone = site.gateway.find_all(|line| {
            (line.contains("event stream client is too slow")
                || line.contains("does not read its response"))
            .then_some(())
        });
        (gone.len() == slow.len()).then_some(())
    });
    let grown = site.resident_kb().saturating_sub(before);
    assert!(grown < 8 * 1024, "{grown} kB");
    good.wait_for("update", |_| Some(()));
    assert!(!good.has_ended());
}

/// Asks for the events and takes nothing, with little room on its own side.
fn who_does_not_read(address: SocketAddr) -> TcpStream {
    let runtime = tokio::runtime::Builder::new_current_thread()
        .enable_all()
        .build()
        .unwrap();
    let connect = async {
        let socket = tokio::net::TcpSocket::new_v4().unwrap();
        socket.set_recv_buffer_size(4096).unwrap();
        socket.connect(address).await.unwrap().into_std().unwrap()
    };
    let mut stream = runtime.block_on(connect);
    stream.set_nonblocking(false).unwrap();
    stream
        .write_all(b"GET /api/v1/events HTTP/1.1\r\nHost: localhost\r\n\r\n")
        .unwrap();
    stream
}
