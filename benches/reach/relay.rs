//! The path of a command without the gateway: a subscriber, a thread, a pseudo-terminal, a simulated line.

use crate::bare_mqtt::Talker;
use crate::tapped::TappedLine;
use std::fs::OpenOptions;
use std::io::Write;
use std::sync::mpsc::sync_channel;
use std::time::Duration;
use vfd_gateway::daemon::host::sys;
use vfd_gateway::sim::BusOptions;

/// What it waits for.
pub const TOPIC: &str = "bench/relay";
/// What it sends to the line, which no drive there understands.
const FRAME: [u8; 8] = [1, 6, 0, 4, 0, 0, 0, 0];
const PATIENCE: Duration = Duration::from_secs(60);

/// Starts it at the broker at `port`; its threads end with the broker. As in the gateway, the thread that writes to the
/// line is a real-time one if the line has character times.
pub fn start(port: u16, bus: BusOptions, real_time: bool) -> TappedLine {
    let line = TappedLine::start(1, bus);
    let mut device = OpenOptions::new()
        .write(true)
        .open(line.path())
        .expect("the pseudo-terminal");
    let (tell, told) = sync_channel(1);
    std::thread::spawn(move || {
        if real_time {
            let _ = sys::ask_for_real_time();
        }
        while told.recv().is_ok() && device.write_all(&FRAME).is_ok() {}
    });
    let mut talker = Talker::connect(port, "bench-relay", &[TOPIC]).expect("the broker accepts");
    std::thread::spawn(move || {
        while let Ok(message) = talker.next(PATIENCE) {
            if message.is_some() && tell.send(()).is_err() {
                return;
            }
        }
    });
    line
}
