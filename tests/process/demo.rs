//! The demo, as somebody at a keyboard starts it.

use super::rig::{only_demo, program};
use super::started::Started;
use std::net::SocketAddr;
use std::sync::MutexGuard;

/// A demo at a keyboard, and where what it prints says that its parts are.
pub struct Demo {
    pub program: Started,
    pub modbus: SocketAddr,
    pub broker: SocketAddr,
    /// The page, without a slash behind.
    pub page: String,
    _alone: MutexGuard<'static, ()>,
}

impl Demo {
    pub fn new() -> Self {
        let alone = only_demo();
        let mut command = program();
        command.args(["demo", "--port", "0", "--http-port", "0"]);
        let program = Started::at_a_keyboard(command);
        program.wait_for("how it ends", |line| line.contains("Ctrl-C").then_some(()));
        let word = |prefix: &str| {
            let found = program.find_all(|line| {
                line.strip_prefix(prefix)?
                    .split([',', ' '])
                    .next()
                    .map(str::to_owned)
            });
            found
                .into_iter()
                .next()
                .unwrap_or_else(|| panic!("no `{prefix}` in: {}", program.text()))
        };
        let (modbus, broker) = (
            word("Modbus TCP ").parse().unwrap(),
            word("MQTT broker ").parse().unwrap(),
        );
        let page = word("Page ").trim_end_matches('/').to_owned();
        Self {
            program,
            modbus,
            broker,
            page,
            _alone: alone,
        }
    }
}
