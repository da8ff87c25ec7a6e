//! A broker for a measurement, which may be killed: mosquitto if installed, else the embedded broker.

use std::fmt::Write as _;
use std::net::{Ipv4Addr, SocketAddr, TcpListener};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};
use vfd_gateway::daemon::mqtt::broker_child::BrokerChild;

use crate::bare_mqtt::Talker;
use crate::plant::Place;

/// Time for a broker to listen.
const PATIENCE: Duration = Duration::from_secs(10);

/// A broker on loopback.
pub struct Broker {
    pub port: u16,
    place: Place,
    program: Option<PathBuf>,
    running: Option<Running>,
}

enum Running {
    Mosquitto(Child),
    Own(BrokerChild),
}

impl Broker {
    /// Starts one; with `keeps` it keeps retained messages across a kill, which only mosquitto can.
    pub fn start(keeps: bool) -> Self {
        let port = free_port();
        let place = Place::new();
        // As root it would drop its privileges, and with them access to the directory.
        let mut text = format!(
            "listener {port} 127.0.0.1\nallow_anonymous true\nset_tcp_nodelay true\nuser root\n"
        );
        text += "log_dest none\n";
        if keeps {
            let _ = write!(
                text,
                "persistence true\npersistence_location {}/\n",
                place.path().display()
            );
            text += "autosave_interval 1\nautosave_on_changes true\n";
        }
        std::fs::write(place.path().join("mosquitto.conf"), text).expect("a file");
        let mut broker = Self {
            port,
            place,
            program: mosquitto(),
            running: None,
        };
        broker.restart();
        broker
    }

    pub const fn name(&self) -> &'static str {
        if self.program.is_some() {
            "mosquitto"
        } else {
            "the gateway's own broker"
        }
    }

    /// Starts it again on the same port; returns once it accepts connections.
    pub fn restart(&mut self) {
        let until = Instant::now() + PATIENCE;
        self.running = Some(self.spawn());
        while Talker::connect(self.port, "bench-look", &[]).is_err() {
            assert!(Instant::now() < until, "the broker does not listen");
            std::thread::sleep(Duration::from_millis(2));
        }
    }

    fn spawn(&self) -> Running {
        let Some(program) = &self.program else {
            let address = SocketAddr::from((Ipv4Addr::LOCALHOST, self.port));
            let own = Path::new(env!("CARGO_BIN_EXE_vfd-gateway"));
            return Running::Own(
                BrokerChild::start_program(own, address).expect("the broker starts"),
            );
        };
        let mut command = Command::new(program);
        command
            .arg("-c")
            .arg(self.place.path().join("mosquitto.conf"));
        command
            .stdin(Stdio::null())
            .stdout(Stdio::null())
            .stderr(Stdio::null());
        Running::Mosquitto(command.spawn().expect("mosquitto starts"))
    }

    /// SIGKILL.
    pub fn kill(&mut self) {
        match self.running.take() {
            Some(Running::Mosquitto(mut child)) => {
                child.kill().expect("killed");
                child.wait().expect("collected");
            }
            Some(Running::Own(child)) => drop(child),
            None => {}
        }
    }
}

impl Drop for Broker {
    fn drop(&mut self) {
        self.kill();
    }
}

/// The path of mosquitto, if it is installed.
pub fn mosquitto() -> Option<PathBuf> {
    let path = std::env::var_os("PATH")?;
    std::env::split_paths(&path)
        .map(|place| place.join("mosquitto"))
        .find(|program| program.is_file())
}

/// A port that was free just now.
pub fn free_port() -> u16 {
    let listener = TcpListener::bind((Ipv4Addr::LOCALHOST, 0)).expect("a port");
    listener.local_addr().expect("an address").port()
}
