//! The demo does what it prints, for whoever tries it first.

use super::demo::Demo;
use super::outsiders::mbpoll_output;
use super::plant::{LOST_AFTER, MARGIN, output};
use super::raw::Raw;
use super::started::{PATIENCE, Started, until};
use std::net::TcpStream;
use std::path::Path;
use std::process::Command;
use std::time::Duration;

/// How long the demo says that a drive runs on at most without its broker, and a margin for a busy machine.
const STOPPED_WITHIN: Duration = LOST_AFTER
    .saturating_add(Duration::from_secs(2))
    .saturating_add(MARGIN);

/// A demo, and what it prints to try.
struct Trial {
    demo: Demo,
    lines: Vec<String>,
}

impl Trial {
    fn new() -> Self {
        let demo = Demo::new();
        let is_to_try = |line: &str| {
            ["mosquitto_", "mbpoll "]
                .iter()
                .any(|tool| line.starts_with(tool))
        };
        let lines = demo
            .program
            .find_all(|line| Some(line.trim().to_owned()).filter(|line| is_to_try(line)));
        assert_eq!(lines.len(), 3, "{lines:?}");
        Self { demo, lines }
    }

    /// Runs a printed line, as it is, in a shell; line by line, as in a terminal.
    fn in_a_terminal(&self, tool: &str) -> Started {
        let line = self
            .lines
            .iter()
            .find(|line| line.starts_with(tool))
            .unwrap();
        let mut shell = Command::new("stdbuf");
        shell.args(["-oL", "sh", "-c", &format!("exec {line}")]);
        Started::new(shell)
    }

    fn output(&self) -> Option<u16> {
        output(self.demo.modbus)
    }

    /// The processes that the demo has started.
    fn children(&self) -> Vec<u32> {
        let output = Command::new("pgrep")
            .args(["-P", &self.demo.program.id().to_string()])
            .output()
            .unwrap();
        String::from_utf8(output.stdout)
            .unwrap()
            .lines()
            .map(|line| line.parse().unwrap())
            .collect()
    }

    fn end(mut self) {
        let children = self.children();
        self.demo.program.interrupt();
        assert_eq!(
            self.demo.program.end_within(Duration::from_secs(10)).code(),
            Some(0),
            "{}",
            self.demo.program.text()
        );
        for child in children {
            assert!(
                !Path::new(&format!("/proc/{child}")).exists(),
                "{child} is left"
            );
        }
        assert!(TcpStream::connect(self.demo.modbus).is_err());
    }
}

#[test]
fn the_three_lines_that_the_demo_prints_work_as_they_are() {
    let mut trial = Trial::new();
    let watcher = trial.in_a_terminal("mosquitto_sub");
    let said = |what: &str| watcher.wait_for(what, |line| line.contains(what).then_some(()));
    said("vfd/demo/status online");
    said("drive/pump-1/run/state stopped");
    let mut publisher = trial.in_a_terminal("mosquitto_pub");
    assert!(
        publisher.end_within(PATIENCE).success(),
        "{}",
        publisher.text()
    );
    said("drive/pump-1/run/state forward");
    said("drive/pump-1/frequency/setpoint 42.50");
    until("the motor turns", PATIENCE, || {
        (trial.output() > Some(200)).then_some(())
    });
    let poller = trial.in_a_terminal("mbpoll");
    poller.wait_for("the setpoint", |line| {
        line.starts_with("[5]:")
            .then(|| line.contains("4250").then_some(()))?
    });
    trial.demo.program.type_line("");
    said("drive/pump-1/trip/active true");
    said("drive/pump-1/run/state tripped");
    until("the motor is off", PATIENCE, || {
        (trial.output() == Some(0)).then_some(())
    });
    let reset = format!(
        "mosquitto_pub -h {} -p {}",
        trial.demo.broker.ip(),
        trial.demo.broker.port()
    );
    let reset = format!("{reset} -t vfd/demo/drive/pump-1/trip/reset -m reset");
    assert!(
        Command::new("sh")
            .args(["-c", &reset])
            .status()
            .unwrap()
            .success()
    );
    said("drive/pump-1/trip/active false");
    drop((watcher, poller));
    trial.end();
}

#[test]
fn a_demo_that_loses_its_broker_stops_the_drive() {
    let trial = Trial::new();
    until("the demo takes the command", PATIENCE, || {
        trial.in_a_terminal("mosquitto_pub").end_within(PATIENCE);
        (trial.output() > Some(200)).then_some(())
    });
    let [broker] = trial.children()[..] else {
        panic!("the broker is the only one: {:?}", trial.children())
    };
    assert!(
        Command::new("sh")
            .args(["-c", &format!("kill -KILL {broker}")])
            .status()
            .unwrap()
            .success()
    );
    let command = |trial: &Trial| {
        Raw::connect(trial.demo.modbus)
            .read_unit(101, 256, 1)
            .unwrap()[0]
    };
    until("the drive is ordered to stop", STOPPED_WITHIN, || {
        (command(&trial) == 0).then_some(())
    });
    until("the motor stands still", PATIENCE, || {
        (trial.output() == Some(0)).then_some(())
    });
    trial.end();
}

#[test]
fn mbpoll_reads_the_drive_of_the_demo_at_both_units() {
    let trial = Trial::new();
    let poll = |unit: &str, register: &str| {
        let mut command = Command::new("mbpoll");
        command.args([
            "-0", "-1", "-o", "6", "-a", unit, "-t", "4", "-r", register, "-c", "1",
        ]);
        mbpoll_output(command.args(["-p", &trial.demo.modbus.port().to_string(), "127.0.0.1"]))
            .values
    };
    until("the drive answers", PATIENCE, || {
        Some(poll("1", "529")).filter(|values| *values == [3])
    });
    assert_eq!(poll("101", "0"), [1], "version of the uniform map");
    trial.end();
}
