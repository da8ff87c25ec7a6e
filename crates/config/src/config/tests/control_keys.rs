//! Every key of `[line.drive.control]` and `[line.drive.native]` reaches its own setting.

use super::watchdog::catalog_with;
use super::*;
use crate::config::file::{ControlFile, NativeFile};
use crate::domain::command::Direction;
use crate::domain::control::{
    BusFunctions, ControlAction, ControlSettings, FailSafe, LeaseMode, OnOutputOutside, Ownership,
    SiteEvidence,
};
use crate::domain::frequency::Hertz;
use crate::domain::standby::OnGatewayLost;

/// A word by which the model stores parameters.
const STORE: &str = r#"
[commit.store]
register = "save"
value = 1
confidence = "manual"
source = "D save"
[[register]]
name = "save"
title = "Stores all parameters"
address = 0x1F00
unit = "-"
access = "write"
back_door = "it wears out the memory"
confidence = "manual"
source = "D save"
"#;

/// Every key but `qualify`, which needs the default of `bus`. No value is the default of its key.
const EVERY_KEY: &str = r#"
[gateway]
data_dir = "/var/lib/vfd-gateway"
[standby]
half = "a"
partner = "b"
[[line]]
name = "hall-1"
port = "/dev/ttyUSB0"
standby = true
[[line.drive]]
name = "pump-1"
model = "teco-e510"
station = 1
[line.drive.control]
from = ["mqtt", "modbus-tcp", "page", "sparkplug"]
bus = "run"
frequency_hz = { min = 5.0, max = 50.0 }
directions = ["reverse", "forward"]
reverse_below_hz = 2.5
on_commander_lost = "stop"
lost_after = "40s"
on_shutdown = "hold"
on_output_outside = "stop"
on_gateway_lost = "adopt"
accept_unverified = ["reset"]
allow_release = true
commands = "strict"
restart_delay = "4s"
stop_effect_timeout = "5s"
stop_pending_for = "6min"
ownership = "any"
allow_take = true
lease = "explicit"
min_start_interval = "7s"
watchdog = "20s"
require_watchdog = true
failsafe_confirm_timeout = "8s"
[line.drive.native]
write = ["00-14"]
stored_write_interval = "9s"
store = true
[mqtt]
broker = "mqtt://127.0.0.1"
[mqtt.sparkplug]
group = "plant"
[[modbus_tcp]]
listen = "127.0.0.1:1502"
write = ["127.0.0.1/32"]
[http]
listen = "127.0.0.1:8080"
[[http.users]]
name = "anna"
role = "operate"
password_hash_file = "/etc/vfd-gateway/anna"
"#;

/// The settings of `EVERY_KEY`.
fn settings() -> ControlSettings {
    ControlSettings {
        from_mqtt: true,
        from_modbus_tcp: true,
        from_page: true,
        from_sparkplug: true,
        bus: BusFunctions::Run,
        least: Hertz::from_millihertz(5000),
        most: Hertz::from_millihertz(50_000),
        directions: vec![Direction::Reverse, Direction::Forward],
        reverse_below: Hertz::from_millihertz(2500),
        on_commander_lost: FailSafe::Stop,
        lost_after: Duration::from_secs(40),
        on_shutdown: FailSafe::Hold,
        on_output_outside: OnOutputOutside::Stop,
        accept_unverified: vec![ControlAction::Reset],
        site: SiteEvidence::default(),
        qualify: false,
        allow_release: true,
        strict: true,
        restart_delay: Duration::from_secs(4),
        stop_effect_timeout: Duration::from_secs(5),
        stop_pending_for: Duration::from_secs(360),
        native_write: vec![0x000E],
        ownership: Ownership::Any,
        allow_take: true,
        lease: LeaseMode::Explicit,
        min_start_interval: Duration::from_secs(7),
        stored_write_interval: Duration::from_secs(9),
        stores_native_writes: true,
        require_watchdog: true,
        watchdog: Some(Duration::from_secs(20)),
        failsafe_confirm_timeout: Duration::from_secs(8),
        on_gateway_lost: Some(OnGatewayLost::Adopt),
    }
}

#[test]
fn every_key_of_a_control_section_reaches_its_setting() {
    let catalog = catalog_with(STORE);
    let control = |text: &str| {
        let config = load(text, &catalog).map_err(|problems| shown(text, &problems))?;
        Ok::<_, String>(config.lines[0].drives[0].control.as_deref().cloned())
    };
    assert_eq!(control(EVERY_KEY), Ok(Some(settings())));

    let qualify = with(EVERY_KEY, "bus = \"run\"", "qualify = true");
    let tried = ControlSettings {
        qualify: true,
        bus: BusFunctions::Both,
        ..settings()
    };
    assert_eq!(control(&qualify), Ok(Some(tried)));

    let keys = [ControlFile::declared().keys, NativeFile::declared().keys].concat();
    for key in keys {
        let text = if key.name == "qualify" {
            qualify.as_str()
        } else {
            EVERY_KEY
        };
        let line = text
            .lines()
            .find(|line| line.starts_with(&format!("{} = ", key.name)));
        let without = with(text, line.expect(key.name), "");
        assert_ne!(
            control(&without),
            control(text),
            "{} has its default",
            key.name
        );
    }
}

#[test]
fn each_interface_has_a_setting_of_its_own() {
    let catalog = catalog_with(STORE);
    let all = "\"mqtt\", \"modbus-tcp\", \"page\", \"sparkplug\"";
    for (index, way) in all.split(", ").enumerate() {
        let text = with(EVERY_KEY, all, way);
        let config =
            load(&text, &catalog).unwrap_or_else(|found| panic!("{}", shown(&text, &found)));
        let control = config.lines[0].drives[0].control.as_deref().unwrap();
        let from = [
            control.from_mqtt,
            control.from_modbus_tcp,
            control.from_page,
            control.from_sparkplug,
        ];
        assert_eq!(from, [0, 1, 2, 3].map(|it| it == index), "{way}");
    }
}
