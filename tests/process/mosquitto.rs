//! A broker that nobody here wrote, and its tools: one that can be ended, killed, stalled and started again.

use super::started::{PATIENCE, Started, until};
use serde_json::Value;
use std::net::{Ipv4Addr, SocketAddr, TcpListener, TcpStream};
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::atomic::{AtomicU16, Ordering};

/// A mosquitto of the test's own, on a loopback port that it keeps when it is started again. An installed service is
/// never used.
pub struct Mosquitto {
    running: Option<Started>,
    file: PathBuf,
    port: u16,
}

impl Mosquitto {
    /// Starts a broker that keeps its files in `directory`, retained messages over a restart too.
    pub fn start(directory: &Path) -> Self {
        Self::start_with(directory, "")
    }

    /// Starts a broker with `more` in its configuration.
    pub fn start_with(directory: &Path, more: &str) -> Self {
        let (port, data) = (free_port(), directory.join("mosquitto"));
        std::fs::create_dir(&data).unwrap();
        let file = directory.join("mosquitto.conf");
        // Started as root it would become another user, who may not write here.
        let text = format!(
            "listener {port} 127.0.0.1\nallow_anonymous true\nuser root\npersistence true\n\
             persistence_location {}/\nlog_dest stderr\n{more}",
            data.display()
        );
        std::fs::write(&file, text).unwrap();
        let mut broker = Self {
            running: None,
            file,
            port,
        };
        broker.start_again();
        broker
    }

    /// Starts a broker with the configuration in `file`, which says itself that it listens on loopback at `port`.
    pub fn with_file(file: PathBuf, port: u16) -> Self {
        let mut broker = Self {
            running: None,
            file,
            port,
        };
        broker.start_again();
        broker
    }

    /// The number of its process.
    pub fn id(&self) -> u32 {
        self.running.as_ref().expect("it runs").id()
    }

    /// The tools alone, for another broker at `port`.
    pub fn tools_for(port: u16) -> Self {
        Self {
            running: None,
            file: PathBuf::new(),
            port,
        }
    }

    /// Starts it where it was, once it has ended.
    pub fn start_again(&mut self) {
        let mut command = Command::new(mosquitto());
        command.arg("-c").arg(&self.file);
        self.running = Some(Started::new(command));
        until("mosquitto listens", PATIENCE, || {
            TcpStream::connect(self.address()).ok()
        });
    }

    /// Ends it in good order: what it keeps is written.
    pub fn end(&mut self) {
        let mut running = self.running.take().expect("it runs");
        running.terminate();
        assert!(running.end_within(PATIENCE).success(), "{}", running.text());
    }

    /// Ends it with SIGKILL.
    pub fn kill(&mut self) {
        self.running.take().expect("it runs").kill();
    }

    /// Stalls it: connections stay, and nothing comes any more.
    pub fn stall(&self) {
        self.running.as_ref().expect("it runs").signal("STOP");
    }

    /// Lets a stalled one go on.
    pub fn go_on(&self) {
        self.running.as_ref().expect("it runs").signal("CONT");
    }

    /// Has it read users, rights and certificates anew.
    pub fn read_anew(&self) {
        self.running.as_ref().expect("it runs").signal("HUP");
    }

    pub fn address(&self) -> SocketAddr {
        SocketAddr::from((Ipv4Addr::LOCALHOST, self.port))
    }

    /// mosquitto_pub with QoS 1, so that the broker has the message when this returns.
    pub fn publish(&self, topic: &str, payload: &str) {
        self.publish_with(&["-t", topic, "-m", payload]);
    }

    /// The same with the retain flag.
    pub fn publish_retained(&self, topic: &str, payload: &str) {
        self.publish_with(&["-r", "-t", topic, "-m", payload]);
    }

    /// mosquitto_pub with `args`.
    pub fn publish_with(&self, args: &[&str]) {
        self.try_publish_with(args).unwrap();
    }

    /// The same; what mosquitto_pub says if the broker does not take it.
    pub fn try_publish_with(&self, args: &[&str]) -> Result<(), String> {
        let mut command = Command::new("mosquitto_pub");
        command
            .args(["-h", "127.0.0.1", "-p", &self.port.to_string(), "-q", "1"])
            .args(args);
        let output = command
            .output()
            .expect("mosquitto_pub; run tests/run, which installs it");
        let said = || format!("{args:?}: {}", String::from_utf8_lossy(&output.stderr));
        if output.status.success() {
            Ok(())
        } else {
            Err(said())
        }
    }
}

/// A running mosquitto_sub.
pub struct Subscriber {
    program: Started,
}

/// A message as mosquitto_sub got it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Message {
    pub topic: String,
    pub payload: String,
    pub retain: bool,
    pub qos: u64,
}

impl Subscriber {
    /// Subscribes `filter`, and returns when the broker has granted that.
    pub fn new(broker: &Mosquitto, version: &str, filter: &str) -> Self {
        Self::with(broker, version, filter, &[])
    }

    /// Subscribes `filter` for a client called `id`, for which the broker keeps what comes while it is away.
    pub fn lasting(broker: &Mosquitto, id: &str, filter: &str) -> Self {
        Self::with(broker, "mqttv311", filter, &["-c", "-i", id])
    }

    /// Subscribes `filter` with `more` arguments.
    pub fn with(broker: &Mosquitto, version: &str, filter: &str, more: &[&str]) -> Self {
        let mut command = Command::new("stdbuf");
        command.args([
            "-oL",
            "mosquitto_sub",
            "-h",
            "127.0.0.1",
            "-p",
            &broker.port.to_string(),
            "-V",
            version,
        ]);
        // -d tells when the subscription is granted.
        command
            .args(["-q", "1", "-d", "-F", "%j", "-t", filter])
            .args(more);
        let program = Started::new(command);
        program.wait_for("that it is subscribed", |line| {
            line.starts_with("Subscribed (").then_some(())
        });
        Self { program }
    }

    /// How often it has connected so far.
    pub fn connects(&self) -> usize {
        self.program
            .find_all(|line| line.contains("sending CONNECT").then_some(()))
            .len()
    }

    /// Everything that came so far on the topics that end with `topic`.
    pub fn on(&self, topic: &str) -> Vec<Message> {
        self.program
            .find_all(|line| message(line).filter(|it| it.topic.ends_with(topic)))
    }

    /// Whether anything stands on a topic with `part` in it, as far as has come.
    pub fn has(&self, part: &str) -> bool {
        let stands = |line: &String| {
            message(line).filter(|it| it.topic.contains(part) && !it.payload.is_empty())
        };
        !self.program.find_all(stands).is_empty()
    }

    /// Waits for a message on a topic that ends with `topic` of which `found` makes something.
    pub fn wait_for<T>(&self, topic: &str, mut found: impl FnMut(&Message) -> Option<T>) -> T {
        let what = format!("what is waited for on {topic}");
        self.program.wait_for(&what, |line| {
            found(&message(line).filter(|it| it.topic.ends_with(topic))?)
        })
    }

    /// Waits for `payload` on a topic that ends with `topic`.
    pub fn wait_for_payload(&self, topic: &str, payload: &str) -> Message {
        self.wait_for(topic, |it| (it.payload == payload).then(|| it.clone()))
    }

    /// The results that tell of the command `id`, waiting for the last one.
    pub fn results(&self, id: &str) -> Vec<Value> {
        let result = |it: &Message| {
            serde_json::from_str(&it.payload)
                .ok()
                .filter(|it: &Value| it["id"] == id)
        };
        self.wait_for("/result", |it| result(it).filter(|it| it["final"] == true));
        self.on("/result").iter().filter_map(result).collect()
    }
}

/// A client of the broker that has somebody else's identifier, and comes back whenever it is thrown out.
pub struct Rival {
    program: Started,
}

impl Rival {
    pub fn new(broker: &Mosquitto, version: &str, id: &str) -> Self {
        let again = "while :; do mosquitto_sub -h 127.0.0.1 -p \"$1\" -V \"$2\" -i \"$3\" -t rival & wait; sleep 0.3; done";
        let mut command = Command::new("sh");
        // What it has started ends with it.
        let guarded = format!("trap 'kill $!; exit' TERM; {again}");
        command.args(["-c", &guarded, "sh", &broker.port.to_string(), version, id]);
        Self {
            program: Started::new(command),
        }
    }
}

impl Drop for Rival {
    fn drop(&mut self) {
        self.program.terminate();
        self.program.end_within(PATIENCE);
    }
}

fn message(line: &str) -> Option<Message> {
    let value: Value = line
        .starts_with('{')
        .then(|| serde_json::from_str(line).ok())??;
    Some(Message {
        topic: value["topic"].as_str()?.to_owned(),
        payload: value["payload"].as_str().unwrap_or_default().to_owned(),
        retain: value["retain"] == 1,
        qos: value["qos"].as_u64()?,
    })
}

/// Debian keeps it where an ordinary user does not look.
fn mosquitto() -> &'static str {
    const HERE: &str = "/usr/sbin/mosquitto";
    if Path::new(HERE).exists() {
        HERE
    } else {
        "mosquitto"
    }
}

/// A port that nobody has, below those that the system gives to whoever connects.
pub fn free_port() -> u16 {
    static NEXT: AtomicU16 = AtomicU16::new(0);
    const FIRST: u32 = 20_000;
    const COUNT: u32 = 12_000;
    let base = std::process::id().wrapping_mul(97);
    loop {
        let number = base.wrapping_add(u32::from(NEXT.fetch_add(1, Ordering::Relaxed))) % COUNT;
        let port = u16::try_from(FIRST + number).unwrap();
        if TcpListener::bind((Ipv4Addr::LOCALHOST, port)).is_ok() {
            return port;
        }
    }
}
