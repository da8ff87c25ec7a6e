//! What the tests of several crates share: models, and a control section for them.

#![allow(
    clippy::expect_used,
    clippy::missing_panics_doc,
    reason = "a test may panic"
)]

use crate::domain::command::Direction;
use crate::domain::control::{ControlSettings, FailSafe};
use crate::domain::frequency::Hertz;
use crate::profile::model::{
    BlockWrite, ClearWords, Confidence, Fact, IndicatedState, Model, Register, RegisterRole,
    SetupItem, StatusFlag,
};
use crate::vendors;
use std::time::Duration;

/// A model file with the required items only.
pub const MODEL: &str = r#"id = "acme-1"
vendor = "Acme"
title = "One"

[documents]
IM = "Interface manual"

[link]
default = { baud = 9600, data_bits = 8, parity = "none", stop_bits = 1, confidence = "manual", source = "IM 1" }
bauds = { value = [9600, 19200], confidence = "manual", source = "IM 1" }
parities = { value = ["none"], confidence = "manual", source = "IM 1" }
stop_bits = { value = [1], confidence = "manual", source = "IM 1" }
data_bits = { value = [8], confidence = "manual", source = "IM 1" }
framings = { value = ["rtu"], confidence = "manual", source = "IM 1" }
interfaces = { value = ["rs485"], confidence = "manual", source = "IM 1" }
stations = { from = 1, to = 247, confidence = "manual", source = "IM 1" }

[timing]
gap_chars = { value = 3.5, confidence = "manual", source = "IM 2" }
reply_timeout_cap = { value = "500ms", confidence = "default", source = "cautious" }
max_lateness = { value = "1s", confidence = "default", source = "cautious" }

[functions]
value = [3, 6]
confidence = "manual"
source = "IM 3"

[read]
max_words = { value = 4, confidence = "manual", source = "IM 3" }

[write]
refused = { value = "exception", confidence = "manual", source = "IM 3" }

[[register]]
name = "output_frequency"
title = "Output frequency"
code = "D001"
address = 0x0101
scale = 100
unit = "Hz"
access = "read"
role = "output-frequency"
poll = "fast"
confidence = "manual"
source = "IM 4"
"#;

/// [`MODEL`] without its register.
pub fn head() -> &'static str {
    MODEL
        .split_once("[[register]]")
        .map_or(MODEL, |(head, _)| head)
}

/// A built-in model.
pub fn model() -> Model {
    Model::clone(
        vendors::catalog()
            .find("hyundai-n700")
            .expect("it is built in"),
    )
}

/// Everything allowed from everywhere, 5 to 50 Hz, 3 s of lease, stops at the end.
pub fn control() -> ControlSettings {
    let limits = (Hertz::from_centihertz(500), Hertz::from_centihertz(5000));
    let lost = (FailSafe::Stop, Duration::from_secs(3));
    ControlSettings {
        from_mqtt: true,
        from_modbus_tcp: true,
        from_page: true,
        from_sparkplug: true,
        directions: vec![Direction::Forward, Direction::Reverse],
        native_write: vec![0x020C, 0x020E],
        ..ControlSettings::new(limits, lost, FailSafe::Stop)
    }
}

/// A fact that is proven.
pub fn fact<T>(value: T) -> Fact<T> {
    Fact {
        value,
        confidence: Confidence::Manual,
        source: "IM 1".to_owned(),
    }
}

/// The first built-in model with a status register at 0x2100: bit 0 running, 1 reverse, 2 ready, 3 tripped.
pub fn with_status() -> Model {
    let mut model = model();
    let output = model
        .register_for(RegisterRole::OutputFrequency)
        .cloned()
        .expect("an output frequency");
    let status = Register {
        name: "status".to_owned(),
        code: None,
        address: 0x2100_u16.into(),
        scale: 1,
        role: None,
        ..output
    };
    model.registers.push(status);
    model.registers.sort_by_key(|register| register.address);
    let flags = [
        (IndicatedState::Running, 1),
        (IndicatedState::Reverse, 2),
        (IndicatedState::Ready, 4),
        (IndicatedState::Tripped, 8),
    ];
    model.status = flags.map(|(flag, mask)| status_flag(flag, mask)).to_vec();
    model
}

fn status_flag(flag: IndicatedState, mask: u16) -> StatusFlag {
    let (confidence, source) = (Confidence::Manual, "IM 1".to_owned());
    StatusFlag {
        flag,
        address: 0x2100_u16.into(),
        mask,
        values: vec![mask],
        clear: ClearWords::Others,
        others_clear: None,
        confidence,
        source,
    }
}

/// The first built-in model with its frequency command after its run command, both to be written in one frame.
pub fn with_block() -> Model {
    let mut model = model();
    for register in &mut model.registers {
        if register.role == Some(RegisterRole::FrequencyCommand) {
            register.address = 0x0003_u16.into();
        }
    }
    model.write.block = Some(BlockWrite {
        address: 0x0002_u16.into(),
        count: fact(2),
    });
    model
}

/// Both sources at communication.
pub fn setup() -> Vec<SetupItem> {
    let item = |(what, address): (&str, u16)| SetupItem {
        what: what.to_owned(),
        text: "communication".to_owned(),
        address: Some(address.into()),
        mask: u16::MAX,
        values: fact(vec![3]),
        needed_for: Vec::new(),
        interface: None,
    };
    [("F010", 0x0211), ("F011", 0x0212)].map(item).to_vec()
}
