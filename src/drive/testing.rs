//! What tests of several rooms share: a built-in model and a control section for it.

use crate::domain::command::Direction;
use crate::domain::control::{ControlSettings, FailSafe};
use crate::domain::frequency::Hertz;
use crate::profile::check;
use crate::profile::model::Model;
use crate::vendors;
use std::time::Duration;

/// The first built-in model.
pub fn model() -> Model {
    let (_, text) = vendors::texts().first().expect("a built-in model");
    check::model(text).expect("a sound model")
}

/// Everything allowed from everywhere, 5 to 50 Hz, 3 s of lease, stops at the end.
pub fn control() -> ControlSettings {
    ControlSettings {
        from_mqtt: true,
        from_modbus_tcp: true,
        least: Hertz::from_centihertz(500),
        most: Hertz::from_centihertz(5000),
        directions: vec![Direction::Forward, Direction::Reverse],
        reverse_below: Hertz::ZERO,
        on_commander_lost: FailSafe::Stop,
        lost_after: Duration::from_secs(3),
        on_shutdown: FailSafe::Stop,
        accept_unverified: Vec::new(),
        allow_release: false,
        strict: false,
        restart_delay: Duration::from_secs(2),
        stop_effect_timeout: Duration::from_secs(3),
        stop_pending_for: Duration::from_secs(600),
        native_write: vec![0x020C, 0x020E],
    }
}
