//! What a subscriber of mosquitto sees while two gateways of one name come and go.

use super::super::mosquitto::{Mosquitto, Subscriber};
use super::super::rig::Place;
use super::super::started::until;
use super::pair::{A, B, PATIENCE, Pair};
use serde_json::Value;

/// A pair at a broker, and a subscriber to everything.
struct Plant {
    pair: Pair,
    broker: Mosquitto,
    outsider: Subscriber,
    _place: Place,
}

impl Plant {
    /// Both are started; `a` is active.
    fn new() -> Self {
        let place = Place::new();
        let broker = Mosquitto::start(&place.file(""));
        let outsider = Subscriber::new(&broker, "mqttv5", "vfd/plant/#");
        let pair = Pair::new(9_600);
        for half in &pair.halves {
            let text = std::fs::read_to_string(&half.file).unwrap();
            let text = text.replace("from = [\"modbus-tcp\"]", "from = [\"modbus-tcp\", \"mqtt\"]");
            std::fs::write(&half.file, format!("{text}\n[mqtt]\nbroker = \"mqtt://{}\"\n", broker.address())).unwrap();
        }
        let mut plant = Self { pair, broker, outsider, _place: place };
        plant.pair.start_one_behind_the_other();
        plant.wait_for_last("status", |it| it == "online");
        plant.wait_for_last("standby/b", |it| role(it).as_deref() == Some("listening"));
        plant
    }

    fn all(&self, topic: &str) -> Vec<String> {
        self.outsider.on(&format!("plant/{topic}")).into_iter().map(|it| it.payload).collect()
    }

    /// Waits until the last message on `topic` is one like this.
    #[track_caller]
    fn wait_for_last(&self, topic: &str, is: impl Fn(&str) -> bool) {
        let what = format!("the last one on {topic}, of {:?}", self.all(topic));
        until(&what, PATIENCE, || self.all(topic).last().filter(|it| is(it)).map(|_| ()));
    }

    /// Commands the drive at station 2 until a gateway carries it out. The command that was has one result, and no other one has
    /// more than one.
    #[track_caller]
    fn runs(&self, hertz: f64, name: &str) {
        let mut count = 0;
        let id = until("a command is carried out", PATIENCE, || {
            count += 1;
            let id = format!("{name}-{count}");
            let command = format!(r#"{{"id": "{id}", "run": "forward", "frequency_hz": {hertz:.1}}}"#);
            self.broker.publish("vfd/plant/drive/pump-2/command", &command);
            let outcome = until("it is answered", PATIENCE, || {
                let last = self.final_results(&id).pop()?;
                Some(last["outcome"].as_str().unwrap().to_owned())
            });
            ["acknowledged", "confirmed"].contains(&outcome.as_str()).then_some(id)
        });
        assert_eq!(self.final_results(&id).len(), 1, "{:?}", self.all("drive/pump-2/result"));
    }

    fn final_results(&self, id: &str) -> Vec<Value> {
        let results = self.all("drive/pump-2/result").into_iter().map(|it| serde_json::from_str::<Value>(&it).unwrap());
        results.filter(|it| it["id"] == id && it["final"] == true).collect()
    }
}

/// The role on its line in the document of a half; `None` if it is offline.
fn role(document: &str) -> Option<String> {
    let document: Value = serde_json::from_str(document).ok()?;
    document["lines"][0]["role"].as_str().map(str::to_owned)
}

#[test]
fn a_killed_half_hides_the_other_from_no_one_for_long() {
    let mut plant = Plant::new();
    plant.wait_for_last("line/hall-1/active", |it| it == "a");
    plant.wait_for_last("drive/pump-2/availability", |it| it == "online");
    plant.runs(30.0, "at-a");
    let (status, shown) = (plant.all("status").len(), plant.all("drive/pump-2/availability").len());

    plant.pair.kill(A);
    plant.wait_for_last("line/hall-1/active", |it| it == "b");
    plant.wait_for_last("status", |it| it == "online");
    assert_eq!(plant.all("status")[status..], ["offline", "online"]);
    plant.wait_for_last("standby/a", |it| role(it).is_none());
    plant.wait_for_last("standby/b", |it| role(it).as_deref() == Some("active"));
    assert!(plant.all("drive/pump-2/availability")[shown..].iter().all(|it| it == "online"));
    assert!(plant.all("drive/pump-2/availability").len() > shown, "it is published again");
    plant.runs(20.0, "at-b");

    // It is back and listens: nothing of that is seen but its own document.
    let (status, actives) = (plant.all("status").len(), plant.all("line/hall-1/active").len());
    plant.pair.start(A);
    plant.wait_for_last("standby/a", |it| role(it).as_deref() == Some("listening"));
    plant.runs(25.0, "still-at-b");
    assert_eq!(plant.all("status").len(), status);
    assert_eq!(plant.all("line/hall-1/active").len(), actives);

    // The end of a listener is seen for a moment only.
    plant.pair.kill(A);
    until("both words are there", PATIENCE, || (plant.all("status").len() >= status + 2).then_some(()));
    assert_eq!(plant.all("status")[status..], ["offline", "online"]);
    plant.wait_for_last("standby/a", |it| role(it).is_none());
    plant.runs(30.0, "at-b-again");
    plant.pair.assert_one_master();
}

#[test]
fn a_listener_that_is_ended_in_good_order_leaves_the_gateway_online() {
    let plant = Plant::new();
    let status = plant.all("status").len();
    plant.pair.program(B).terminate();
    plant.wait_for_last("standby/b", |it| role(it).is_none());
    plant.runs(30.0, "alone");
    assert_eq!(plant.all("status").len(), status, "{:?}", plant.all("status"));
    plant.pair.program(A).terminate();
    plant.wait_for_last("status", |it| it == "offline");
}
