//! A Sparkplug host that nobody here wrote, and what it has seen; see `npm/scada.js`.

use super::mosquitto::Mosquitto;
use super::outsiders::node;
use super::started::Started;
use serde_json::{Value, json};
use std::cell::RefCell;

/// A running host of the group `plant-a`, called `scada`.
pub struct Scada {
    program: RefCell<Started>,
}

impl Scada {
    /// Connects, and returns when the broker has granted its subscription.
    pub fn new(broker: &Mosquitto, version: &str) -> Self {
        let mut command = node("scada");
        command.args([
            &broker.address().port().to_string(),
            "scada",
            "plant-a",
            version,
        ]);
        let program = Started::at_a_keyboard(command);
        program.wait_for("that it is subscribed", |line| {
            line.contains("subscribed").then_some(())
        });
        Self {
            program: RefCell::new(program),
        }
    }

    /// The same, and it says that it is online.
    pub fn online(broker: &Mosquitto, version: &str) -> Self {
        let scada = Self::new(broker, version);
        scada.say(&json!({ "state": true }));
        scada
    }

    /// Tells the host what to do.
    pub fn say(&self, order: &Value) {
        self.program.borrow_mut().type_line(&order.to_string());
    }

    /// Writes metrics of the drive.
    pub fn write(&self, metrics: &Value) {
        self.say(&json!({ "to": "DCMD/plant/pump-1", "metrics": metrics }));
    }

    /// Writes a metric of text.
    pub fn write_text(&self, name: &str, text: &str) {
        self.write(&json!([{ "name": name, "type": "String", "value": text }]));
    }

    /// Asks for all births.
    pub fn ask_for_births(&self) {
        let metric = json!([{ "name": "Node Control/Rebirth", "type": "Boolean", "value": true }]);
        self.say(&json!({ "to": "NCMD/plant", "metrics": metric }));
    }

    /// All messages so far, in order.
    pub fn seen(&self) -> Vec<Value> {
        self.program.borrow().find_all(|line| message(line))
    }

    /// Waits for the first message behind `after` others of which `found` makes something.
    pub fn wait_for<T>(
        &self,
        what: &str,
        after: usize,
        mut found: impl FnMut(&Value) -> Option<T>,
    ) -> T {
        let mut count = 0;
        self.program.borrow().wait_for(what, |line| {
            let message = message(line)?;
            count += 1;
            if count > after { found(&message) } else { None }
        })
    }

    /// Waits for a message of this kind behind `after` others.
    pub fn wait_for_kind(&self, kind: &str, after: usize) -> Value {
        self.wait_for(kind, after, |it| (it["kind"] == kind).then(|| it.clone()))
    }

    /// Waits until a live metric of this name has this value, behind `after` messages.
    pub fn wait_for_value(&self, name: &str, value: &Value, after: usize) {
        self.wait_for(&format!("{name} = {value}"), after, |message| {
            let is_it = |it: &&Value| {
                it["name"] == name && it["value"] == *value && it["historical"] == false
            };
            metrics(message).iter().find(is_it).map(|_| ())
        });
    }

    /// Waits for the reason that is told of the next command, behind `after` messages.
    pub fn wait_for_reason(&self, reason: &str, after: usize) {
        self.wait_for_value("result/reason", &reason.into(), after);
    }
}

/// The metrics of a message.
pub fn metrics(message: &Value) -> &[Value] {
    message["metrics"].as_array().map_or(&[], Vec::as_slice)
}

/// The metric of this name.
pub fn metric<'m>(message: &'m Value, name: &str) -> &'m Value {
    let found = metrics(message).iter().find(|it| it["name"] == name);
    found.unwrap_or_else(|| panic!("no {name} in {message}"))
}

fn message(line: &str) -> Option<Value> {
    let value: Value = serde_json::from_str(line).ok()?;
    value["kind"].is_string().then_some(value)
}
