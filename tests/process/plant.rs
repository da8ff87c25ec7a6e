//! A small plant: a simulated drive, mosquitto, the gateway between them, and an observer of what goes to the line.

use super::mosquitto::{Mosquitto, Subscriber, free_port};
use super::raw::Raw;
use super::rig::{Place, fields, program, start};
use super::started::{PATIENCE, Started, until};
use serde_json::Value;
use std::io::{Read, Write};
use std::net::{Ipv4Addr, SocketAddr, TcpStream};
use std::path::PathBuf;
use std::sync::atomic::{AtomicU32, Ordering};
use std::time::Duration;

/// How long the commander of the plant's drive may be silent.
pub const LOST_AFTER: Duration = Duration::from_secs(3);
/// What the promise of a fail-safe action allows on a machine that is busy with other tests.
pub const MARGIN: Duration = Duration::from_secs(5);

/// Run command, frequency command, output frequency. Typed from the manual.
pub const RUN: u16 = 0x0002;
pub const FREQUENCY: u16 = 0x0004;
pub const OUTPUT: u16 = 0x0101;
/// The native and the uniform unit of the drive.
pub const NATIVE: u8 = 1;
pub const UNIFORM: u8 = 101;
/// The reason of the last outcome: a stop is not effective yet, or none, when that stop has become effective since.
const REASON: u16 = 261;
const STOP_PENDING: u16 = 13;
const NO_REASON: u16 = 0;

/// How a plant differs from the usual one.
#[derive(Clone, Copy, Default)]
pub struct Wish<'a> {
    /// More arguments of the simulator.
    pub simulate: &'a [&'a str],
    /// Keys of `[mqtt]`; MQTT 5 without.
    pub mqtt: &'a str,
    /// How long a commander may be silent; [`LOST_AFTER`] without.
    pub lost_after: &'a str,
    /// Who may publish and read what at the broker, as mosquitto reads it; anybody anything without.
    pub access: &'a str,
    /// More lines of the broker's configuration.
    pub broker: &'a str,
    /// The drive has no control section.
    pub read_only: bool,
    /// More keys of the drive's control section.
    pub control: &'a str,
    /// More ways by which the drive is commanded, each behind a comma.
    pub from: &'a str,
    /// More keys of `[http]`, with those who may command from the page; nobody without.
    pub page: &'a str,
    /// Who may write over Modbus TCP; 127.0.0.1 without.
    pub write: &'a str,
    /// More keys of the Modbus TCP listener.
    pub listener: &'a str,
    /// Given the broker's port, starts something before it, and names the port that the gateway is to use.
    pub through: Option<&'a dyn Fn(u16) -> u16>,
}

impl Wish<'_> {
    /// The usual plant.
    pub const NONE: Self = Self {
        simulate: &[],
        mqtt: "",
        lost_after: "",
        access: "",
        broker: "",
        read_only: false,
        control: "",
        from: "",
        page: "",
        write: "",
        listener: "",
        through: None,
    };
}

/// All of it. What is dropped first ends first.
pub struct Plant {
    pub gateway: Started,
    pub modbus: SocketAddr,
    pub http: SocketAddr,
    drive: Started,
    pub broker: Mosquitto,
    pub file: PathBuf,
    pub place: Place,
}

/// A word that was written over the line.
pub type Written = (u16, u16);

impl Plant {
    /// Starts everything, and waits until the gateway is ready and the drive is known to stand still.
    pub fn new() -> Self {
        Self::with(Wish::default())
    }

    pub fn with(wish: Wish<'_>) -> Self {
        Self::prepared(wish, |_| {})
    }

    /// Like [`with`](Self::with), with something that happens at the broker before the gateway comes.
    pub fn prepared(wish: Wish<'_>, before: impl FnOnce(&Mosquitto)) -> Self {
        let place = Place::new();
        let port = place.file("line");
        let broker = broker(&place, &wish);
        let drive = simulate(port.to_str().unwrap(), wish.simulate);
        before(&broker);
        std::fs::create_dir(place.file("data")).unwrap();
        let http = SocketAddr::from((Ipv4Addr::LOCALHOST, free_port()));
        let port = broker.address().port();
        let port = wish.through.map_or(port, |through| through(port));
        let text = configuration(&place, port, http, &wish);
        let file = place.write("gateway.toml", &text);
        let (gateway, modbus) = run(&file);
        let plant = Self {
            gateway,
            modbus,
            http,
            drive,
            broker,
            file,
            place,
        };
        plant.wait_until_ready();
        plant
    }

    /// Starts the gateway again after its end.
    pub fn start_gateway_again(&mut self) {
        (self.gateway, self.modbus) = run(&self.file);
        self.wait_until_ready();
    }

    pub fn wait_until_ready(&self) {
        until("the gateway is ready and knows the drive", PATIENCE, || {
            let health: Value = serde_json::from_str(&self.get("/api/v1/health")?.1).ok()?;
            let drive = &health["drives"][0];
            let is_known = drive["presence"] == "online" && drive["run_state"] != "unknown";
            (health["ready"] == true && is_known).then_some(())
        });
    }

    /// Waits until the gateway itself shows that the drive is stopped, which takes two readings of zero.
    pub fn wait_until_shown_as_stopped(&self) {
        until("the drive is shown as stopped", PATIENCE, || {
            let health: Value = serde_json::from_str(&self.get("/api/v1/health")?.1).ok()?;
            (health["drives"][0]["run_state"] == "stopped").then_some(())
        });
    }

    /// Waits until the gateway has noticed that its broker is gone.
    pub fn wait_until_not_ready(&self) {
        until("the gateway is not ready", PATIENCE, || {
            self.get("/readyz").filter(|(status, _)| *status == 503)
        });
    }

    /// The value of a metric that has no labels.
    pub fn metric(&self, name: &str) -> f64 {
        let (_, text) = self.get("/metrics").expect("HTTP answers");
        let value = text
            .lines()
            .find_map(|line| line.strip_prefix(name)?.strip_prefix(' ')?.parse().ok());
        value.unwrap_or_else(|| panic!("no {name} in {text}"))
    }

    /// Status and body of `path`; nothing as long as nobody answers.
    pub fn get(&self, path: &str) -> Option<(u16, String)> {
        get(self.http, path)
    }

    /// The drive neither hears nor says anything from now on; its port is still there.
    pub fn silence_the_drive(&self) {
        self.drive.signal("STOP");
    }

    /// The drive goes on.
    pub fn wake_the_drive(&self) {
        self.drive.signal("CONT");
    }

    /// A topic of the drive.
    pub fn topic(rest: &str) -> String {
        format!("vfd/plant/drive/pump-1/{rest}")
    }

    /// Publishes on an input of the drive.
    pub fn order(&self, rest: &str, payload: &str) {
        self.broker.publish(&Self::topic(rest), payload);
    }

    /// A subscriber of everything, with MQTT 5.
    pub fn subscriber(&self) -> Subscriber {
        Subscriber::new(&self.broker, "mqttv5", "vfd/plant/#")
    }

    /// The words that were written over the line so far, in order: whatever was sent and is no read.
    pub fn written(&self) -> Vec<Written> {
        self.logged(|line| written(line))
    }

    /// What `found` makes of all that the gateway has logged up to this moment, or to its end.
    ///
    /// A thread of its own writes the log, so what has happened may stand there later than its effect is seen elsewhere.
    /// The lines keep their order: behind one that tells of something that happens now, nothing of before comes.
    pub fn logged<T>(&self, found: impl FnMut(&String) -> Option<T>) -> Vec<T> {
        let seen = self.gateway.lines();
        if let Ok(visitor) = TcpStream::connect(self.modbus) {
            let address = format!("\"{}\"", visitor.local_addr().unwrap());
            drop(visitor);
            let is_it = |line: &str| {
                (line.contains("connection closed") && line.contains(&address)).then_some(())
            };
            let told = self.gateway.look_for(seen, is_it);
            assert!(
                told.is_some() || self.gateway.is_silent(),
                "the log never tells that {address} has gone"
            );
        }
        self.gateway.find_all(found)
    }

    pub fn output(&self) -> Option<u16> {
        output(self.modbus)
    }

    /// Waits for this word on the line, after `seen` others, at most for `within`.
    pub fn wait_for_write(&self, seen: usize, written: Written, within: Duration) {
        until(&format!("{written:X?} on the line"), within, || {
            self.gateway
                .find_all(|line| self::written(line))
                .get(seen..)?
                .contains(&written)
                .then_some(())
        });
    }

    /// Starts the drive over MQTT at 30 Hz, and waits until the motor turns. Returns how many words that wrote.
    pub fn run_over_mqtt(&self) -> usize {
        self.order("command", r#"{"run": "forward", "frequency_hz": 30}"#);
        self.wait_until_it_turns();
        self.written().len()
    }

    /// The epoch that a commander names to show that it knows of the last stop.
    pub fn epoch(&self) -> u64 {
        let subscriber = Subscriber::new(&self.broker, "mqttv5", &Self::topic("state"));
        let epoch =
            |text: &str| serde_json::from_str::<Value>(text).ok()?["control"]["epoch"].as_u64();
        subscriber.wait_for("state", |it| epoch(&it.payload))
    }

    /// Starts the drive over MQTT behind a stop. A plain start would have to wait, so this one names the epoch; it comes
    /// too soon as long as the stop is not effective or its epoch not published.
    pub fn run_over_mqtt_behind_a_stop(&self) {
        static NUMBER: AtomicU32 = AtomicU32::new(0);
        let subscriber = self.subscriber();
        until("the start is taken", PATIENCE, || {
            let (id, epoch) = (
                format!("start-{}", NUMBER.fetch_add(1, Ordering::Relaxed)),
                self.epoch(),
            );
            self.order(
                "command",
                &format!(r#"{{"id": "{id}", "run": "forward", "epoch": {epoch}}}"#),
            );
            let told = subscriber.results(&id);
            let last = told.last().unwrap();
            let is_too_soon = last["reason"] == "stop_pending" || last["reason"] == "stale_epoch";
            assert!(is_too_soon || last["outcome"] == "acknowledged", "{told:?}");
            (!is_too_soon).then_some(())
        });
        self.wait_until_it_turns();
    }

    /// A Modbus client writes `word` to the uniform unit. After a stop it tries again until that is effective.
    pub fn write_uniform(&self, client: &mut Raw, register: u16, word: u16) {
        let answer = until("the stop before is effective", PATIENCE, || {
            match client.write(UNIFORM, register, word) {
                Err(6)
                    if matches!(
                        client.read_unit(UNIFORM, REASON, 1).as_deref(),
                        Ok([STOP_PENDING | NO_REASON])
                    ) =>
                {
                    None
                }
                answer => Some(answer),
            }
        });
        assert_eq!(answer, Ok(()), "{word} to {register}");
    }

    /// A Modbus client starts the drive at 30 Hz, as a controller does: stop, setpoint, run.
    pub fn run_over_modbus(&self, client: &mut Raw) {
        for (register, word) in [(256, 0), (257, 3000), (256, 1)] {
            self.write_uniform(client, register, word);
        }
    }

    pub fn wait_until_it_turns(&self) {
        until("the motor turns", PATIENCE, || {
            (self.output() > Some(200)).then_some(())
        });
    }

    /// What becomes of `asks` that begin while the gateway is stopped.
    pub fn while_it_stands_still<T: Send, const N: usize>(
        &self,
        asks: [&mut (dyn FnMut() -> T + Send); N],
    ) -> [T; N] {
        self.gateway.signal("STOP");
        std::thread::scope(|scope| {
            let asked = asks.map(|ask| scope.spawn(ask));
            // Longer than a busy machine lets anybody wait.
            std::thread::sleep(Duration::from_secs(2));
            self.gateway.signal("CONT");
            asked.map(|asked| asked.join().unwrap())
        })
    }

    pub fn wait_until_it_stands(&self) {
        until("the motor stands still", PATIENCE, || {
            (self.output() == Some(0)).then_some(())
        });
    }

    /// Proves that the observer sees: a start that is written, as the first word after `seen` others.
    pub fn assert_nothing_was_written_since(&self, seen: usize) {
        let id = format!("proof-{seen}");
        let subscriber = self.subscriber();
        self.order(
            "command",
            &format!(r#"{{"id": "{id}", "frequency_hz": 12.34}}"#),
        );
        let results = subscriber.results(&id);
        assert_eq!(
            results.last().unwrap()["outcome"],
            "confirmed",
            "{results:?}"
        );
        assert_eq!(self.written()[seen..], [(FREQUENCY, 1234)]);
    }
}

/// The output frequency that the N700 at unit 1 of `modbus` says it has, in 0.01 Hz; nothing if nobody answers.
pub fn output(modbus: SocketAddr) -> Option<u16> {
    Raw::connect(modbus)
        .read(OUTPUT, 1)
        .ok()
        .map(|words| words[0])
}

/// Status and body of `path` at `address`; nothing as long as nobody answers.
pub fn get(address: SocketAddr, path: &str) -> Option<(u16, String)> {
    let mut stream = TcpStream::connect(address).ok()?;
    stream.set_read_timeout(Some(PATIENCE)).unwrap();
    write!(
        stream,
        "GET {path} HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n"
    )
    .ok()?;
    let mut answer = String::new();
    stream.read_to_string(&mut answer).ok()?;
    let (head, body) = answer.split_once("\r\n\r\n")?;
    Some((head.split(' ').nth(1)?.parse().ok()?, body.to_owned()))
}

fn broker(place: &Place, wish: &Wish<'_>) -> Mosquitto {
    let access = if wish.access.is_empty() {
        String::new()
    } else {
        format!(
            "acl_file {}\n",
            place.write("access", wish.access).display()
        )
    };
    Mosquitto::start_with(&place.file(""), &format!("{access}{}", wish.broker))
}

fn simulate(link: &str, more: &[&str]) -> Started {
    let args = [
        "simulate",
        "--model",
        "hyundai-n700",
        "--baud",
        "38400",
        "--link",
        link,
    ];
    let drive = start(&[&args, more].concat());
    drive.wait_for("that it plays", |line| {
        line.contains("station 1").then_some(())
    });
    drive
}

/// The gateway with `file`, logging every frame.
fn run(file: &std::path::Path) -> (Started, SocketAddr) {
    let mut command = program();
    command
        .env("RUST_LOG", "info,vfd_gateway=trace")
        .arg("run")
        .arg("-c")
        .arg(file);
    let gateway = Started::new(command);
    let modbus = gateway.wait_for("where it listens", |line| {
        let fields = fields(line)?;
        (fields["message"] == "Modbus TCP").then(|| fields["address"].as_str()?.parse().ok())?
    });
    (gateway, modbus)
}

fn configuration(place: &Place, broker: u16, http: SocketAddr, wish: &Wish<'_>) -> String {
    let lost_after = if wish.lost_after.is_empty() {
        "3s"
    } else {
        wish.lost_after
    };
    let mqtt = wish.mqtt;
    let (control, write) = match wish.read_only {
        true => (String::new(), String::new()),
        false => {
            let write = if wish.write.is_empty() {
                "127.0.0.1/32"
            } else {
                wish.write
            };
            (control(lost_after, wish), format!("write = [\"{write}\"]"))
        }
    };
    let (port, data, page, listener) = (
        place.file("line"),
        place.file("data"),
        wish.page,
        wish.listener,
    );
    format!(
        r#"
[gateway]
name = "plant"
data_dir = "{}"

[[line]]
name = "hall-1"
port = "{}"
baud = 38400
# As long as nothing is learned. On a busy machine a reply may take longer than all that have come before.
reply_timeout = "500ms"

[[line.drive]]
name = "pump-1"
model = "hyundai-n700"
station = 1
poll = "100ms"

{control}
[mqtt]
broker = "mqtt://127.0.0.1:{broker}"
probe_interval = "500ms"
{mqtt}

[[modbus_tcp]]
listen = "127.0.0.1:0"
{write}
{listener}

[http]
listen = "{http}"
{page}
"#,
        data.display(),
        port.display()
    )
}

fn control(lost_after: &str, wish: &Wish<'_>) -> String {
    let (more, from) = (wish.control, wish.from);
    let page = if wish.page.is_empty() {
        ""
    } else {
        ", \"page\""
    };
    format!(
        r#"
[line.drive.control]
from = ["mqtt", "modbus-tcp"{page}{from}]
frequency_hz = {{ min = 5.0, max = 50.0 }}
directions = ["forward", "reverse"]
on_commander_lost = "stop"
lost_after = "{lost_after}"
on_shutdown = "stop"
{more}
"#
    )
}

/// The word in a log line of a request that writes. Anything but a read counts, so that nothing escapes.
fn written(line: &str) -> Option<Written> {
    let fields = line.contains("traffic").then(|| fields(line))??;
    let is_request = fields["message"] == "traffic" && fields["kind"] == "Request";
    let bytes: Vec<u8> =
        serde_json::from_str(fields["bytes"].as_str().filter(|_| is_request)?).unwrap();
    let number = |at: usize| u16::from_be_bytes([bytes[at], bytes[at + 1]]);
    (bytes[1] != 3).then(|| (number(2), number(4)))
}
