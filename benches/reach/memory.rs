//! The memory of the program as a process: eight drives, a broker, a hundred clients.

use crate::brokers::{Broker, free_port};
use crate::commander::Commander;
use crate::plant::{Place, Setup, UNIFORM};
use crate::table::Row;
use crate::tapped::TappedLine;
use std::net::{Ipv4Addr, SocketAddr, TcpStream};
use std::process::{Child, Command, Stdio};
use std::time::Duration;
use vfd_gateway::sim::BusOptions;

const DRIVES: u8 = 8;
const CLIENTS: usize = 100;
/// Time for polls, births and telemetry.
const SETTLE: Duration = Duration::from_secs(4);

pub fn memory() -> Vec<Row> {
    let broker = Broker::start(false);
    let line = TappedLine::start(DRIVES, BusOptions::default());
    let listen = free_port();
    let mqtt = Some((broker.port, 5));
    let setup = Setup {
        device: line.path(),
        drives: DRIVES,
        unpaced: false,
        poll: "1s",
        mqtt,
        listen,
    };
    let place = Place::new();
    let file = place.path().join("gateway.toml");
    std::fs::write(&file, setup.text()).expect("a file");
    let mut command = Command::new(env!("CARGO_BIN_EXE_vfd-gateway"));
    command
        .args(["run", "-c"])
        .arg(&file)
        .stdin(Stdio::null())
        .stdout(Stdio::null())
        .stderr(Stdio::null());
    let mut gateway = command.spawn().expect("the gateway starts");
    let address = SocketAddr::from((Ipv4Addr::LOCALHOST, listen));
    wait_for(address);
    std::thread::sleep(SETTLE);
    let alone = resident_kb(&gateway);
    let mut clients: Vec<Commander> = (0..CLIENTS).map(|_| Commander::connect(address)).collect();
    for client in &mut clients {
        client.read(UNIFORM, 0, 16).expect("an answer");
    }
    std::thread::sleep(SETTLE / 2);
    let with_clients = resident_kb(&gateway);
    // It may be killed: its drives are not running.
    gateway.kill().expect("killed");
    gateway.wait().expect("collected");
    line.stop();
    let mb = |kb: u64| format!("{:.1}", kb as f64 / 1024.0);
    vec![
        Row::told(
            "memory: 8 drives, broker connected: resident, MB",
            mb(alone),
        ),
        Row::told(
            "memory: the same with 100 connections: resident, MB",
            mb(with_clients),
        ),
    ]
}

pub fn wait_for(address: SocketAddr) {
    for _ in 0..500 {
        if TcpStream::connect(address).is_ok() {
            return;
        }
        std::thread::sleep(Duration::from_millis(20));
    }
    panic!("the gateway does not listen");
}

pub fn resident_kb(program: &Child) -> u64 {
    let status =
        std::fs::read_to_string(format!("/proc/{}/status", program.id())).expect("its status");
    let line = status
        .lines()
        .find_map(|line| line.strip_prefix("VmRSS:"))
        .expect("its size");
    line.trim()
        .trim_end_matches(" kB")
        .parse()
        .expect("a number")
}
