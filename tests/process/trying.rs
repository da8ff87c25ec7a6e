//! The demo does what it prints, for whoever tries it first.

use super::outsiders::mbpoll_output;
use super::plant::{LOST_AFTER, MARGIN};
use super::raw::Raw;
use super::rig::{only_demo, program};
use super::started::{PATIENCE, Started, until};
use std::net::{SocketAddr, TcpStream};
use std::path::Path;
use std::process::Command;
use std::sync::MutexGuard;
use std::time::Duration;

/// How long the demo says that a drive runs on at most without its broker, and a margin for a busy machine.
const STOPPED_WITHIN: Duration = LOST_AFTER.saturating_add(Duration::from_secs(2)).saturating_add(MARGIN);

/// A demo at a keyboard, and what it prints to try.
struct Demo {
    program: Started,
    modbus: SocketAddr,
    broker: SocketAddr,
    lines: Vec<String>,
    alone: MutexGuard<'static, ()>,
}

impl Demo {
    fn new() -> Self {
        let alone = only_demo();
        let mut command = program();
        command.args(["demo", "--port", "0", "--http-port", "0"]);
        let program = Started::at_a_keyboard(command);
        program.wait_for("how it ends", |line| line.contains("Ctrl-C").then_some(()));
        let address = |prefix: &str| {
            let found = program.find_all(|line| {
                line.strip_prefix(prefix)?.split([',', ' ']).next()?.trim_end_matches(':').parse::<SocketAddr>().ok()
            });
            found[0]
        };
        let is_to_try = |line: &str| ["mosquitto_", "mbpoll "].iter().any(|tool| line.starts_with(tool));
        let lines = program.find_all(|line| Some(line.trim().to_owned()).filter(|line| is_to_try(line)));
        assert_eq!(lines.len(), 3, "{lines:?}");
        let (modbus, broker) = (address("Modbus TCP "), address("MQTT broker "));
        Self { program, modbus, broker, lines, alone }
    }

    /// Runs a printed line, as it is, in a shell; line by line, as in a terminal.
    fn in_a_terminal(&self, tool: &str) -> Started {
        let line = self.lines.iter().find(|line| line.starts_with(tool)).unwrap();
        let mut shell = Command::new("stdbuf");
        shell.args(["-oL", "sh", "-c", &format!("exec {line}")]);
        Started::new(shell)
    }

    fn output(&self) -> u16 {
        Raw::connect(self.modbus).read(0x0101, 1).map_or(0, |words| words[0])
    }

    /// The processes that the demo has started.
    fn children(&self) -> Vec<u32> {
        let output = Command::new("pgrep").args(["-P", &self.program.id().to_string()]).output().unwrap();
        String::from_utf8(output.stdout).unwrap().lines().map(|line| line.parse().unwrap()).collect()
    }

    fn end(mut self) {
        let children = self.children();
        self.program.interrupt();
        assert_eq!(self.program.end_within(Duration::from_secs(10)).code(), Some(0), "{}", self.program.text());
        for child in children {
            assert!(!Path::new(&format!("/proc/{child}")).exists(), "{child} is left");
        }
        assert!(TcpStream::connect(self.modbus).is_err());
        drop(self.alone);
    }
}

#[test]
fn the_three_lines_that_the_demo_prints_work_as_they_are() {
    let mut demo = Demo::new();
    let watcher = demo.in_a_terminal("mosquitto_sub");
    let said = |what: &str| watcher.wait_for(what, |line| line.contains(what).then_some(()));
    said("vfd/demo/status online");
    said("drive/pump-1/run/state stopped");
    let mut publisher = demo.in_a_terminal("mosquitto_pub");
    assert!(publisher.end_within(PATIENCE).success(), "{}", publisher.text());
    said("drive/pump-1/run/state forward");
    said("drive/pump-1/frequency/setpoint 42.50");
    until("the motor turns", PATIENCE, || (demo.output() > 200).then_some(()));
    let poller = demo.in_a_terminal("mbpoll");
    poller.wait_for("the setpoint", |line| line.starts_with("[5]:").then(|| line.contains("4250").then_some(()))?);
    demo.program.type_line("");
    said("drive/pump-1/trip/active true");
    said("drive/pump-1/run/state tripped");
    until("the motor is off", PATIENCE, || (demo.output() == 0).then_some(()));
    let reset = format!("mosquitto_pub -h {} -p {}", demo.broker.ip(), demo.broker.port());
    let reset = format!("{reset} -t vfd/demo/drive/pump-1/trip/reset -m reset");
    assert!(Command::new("sh").args(["-c", &reset]).status().unwrap().success());
    said("drive/pump-1/trip/active false");
    drop((watcher, poller));
    demo.end();
}

#[test]
fn a_demo_that_loses_its_broker_stops_the_drive() {
    let demo = Demo::new();
    until("the demo takes the command", PATIENCE, || {
        demo.in_a_terminal("mosquitto_pub").end_within(PATIENCE);
        (demo.output() > 200).then_some(())
    });
    let [broker] = demo.children()[..] else { panic!("the broker is the only one: {:?}", demo.children()) };
    assert!(Command::new("sh").args(["-c", &format!("kill -KILL {broker}")]).status().unwrap().success());
    let command = |demo: &Demo| Raw::connect(demo.modbus).read_unit(101, 256, 1).unwrap()[0];
    until("the drive is ordered to stop", STOPPED_WITHIN, || (command(&demo) == 0).then_some(()));
    until("the motor stands still", PATIENCE, || (demo.output() == 0).then_some(()));
    demo.end();
}

#[test]
fn mbpoll_reads_the_drive_of_the_demo_at_both_units() {
    let demo = Demo::new();
    let poll = |unit: &str, register: &str| {
        let mut command = Command::new("mbpoll");
        command.args(["-0", "-1", "-o", "6", "-a", unit, "-t", "4", "-r", register, "-c", "1"]);
        mbpoll_output(command.args(["-p", &demo.modbus.port().to_string(), "127.0.0.1"])).values
    };
    until("the drive answers", PATIENCE, || Some(poll("1", "529")).filter(|values| *values == [3]));
    assert_eq!(poll("101", "0"), [1], "version of the uniform map");
    demo.end();
}
