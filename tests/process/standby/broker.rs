//! What a subscriber of mosquitto sees while two gateways of one name come and go.

use super::super::mosquitto::{Mosquitto, Subscriber};
use super::super::raw::Raw;
use super::super::rig::{Place, vfd_gateway};
use super::super::started::until;
use super::pair::{A, B, PATIENCE, Pair};
use serde_json::Value;

/// The register of an N700 with the number of its trips.
const TRIP_COUNT: u16 = 0x0112;

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
            let text = text.replace(
                "from = [\"modbus-tcp\"]",
                "from = [\"modbus-tcp\", \"mqtt\"]",
            );
            std::fs::write(
                &half.file,
                format!("{text}\n[mqtt]\nbroker = \"mqtt://{}\"\n", broker.address()),
            )
            .unwrap();
        }
        let mut plant = Self {
            pair,
            broker,
            outsider,
            _place: place,
        };
        plant.pair.start_one_behind_the_other();
        plant.wait_for_last("status", |it| it == "online");
        plant.wait_for_last("standby/b", |it| role(it).as_deref() == Some("listening"));
        plant
    }

    fn all(&self, topic: &str) -> Vec<String> {
        self.outsider
            .on(&format!("plant/{topic}"))
            .into_iter()
            .map(|it| it.payload)
            .collect()
    }

    /// Waits until the last message on `topic` is one like this.
    #[track_caller]
    fn wait_for_last(&self, topic: &str, is: impl Fn(&str) -> bool) {
        let what = format!("the last one on {topic}, of {:?}", self.all(topic));
        until(&what, PATIENCE, || {
            self.all(topic).last().filter(|it| is(it)).map(|_| ())
        });
    }

    /// Commands the drive at station 2 to run until a gateway carries it out.
    #[track_caller]
    fn runs(&self, hertz: f64, name: &str) {
        self.does(
            &format!(r#""run": "forward", "frequency_hz": {hertz:.1}"#),
            name,
        );
    }

    /// Commands the drive at station 2 until a gateway carries it out. The command that was has one result, and no other one has
    /// more than one.
    #[track_caller]
    fn does(&self, what: &str, name: &str) {
        let mut count = 0;
        let id = until("a command is carried out", PATIENCE, || {
            count += 1;
            let id = format!("{name}-{count}");
            self.broker.publish(
                "vfd/plant/drive/pump-2/command",
                &format!(r#"{{"id": "{id}", {what}}}"#),
            );
            let outcome = until("it is answered", PATIENCE, || {
                let last = self.final_results(&id).pop()?;
                Some(last["outcome"].as_str().unwrap().to_owned())
            });
            ["acknowledged", "confirmed"]
                .contains(&outcome.as_str())
                .then_some(id)
        });
        assert_eq!(
            self.final_results(&id).len(),
            1,
            "{:?}",
            self.all("drive/pump-2/result")
        );
    }

    /// The events of trips so far, of a kind.
    fn events(&self, kind: &str) -> Vec<Value> {
        let events = self
            .all("drive/pump-2/trip/event")
            .into_iter()
            .map(|it| serde_json::from_str::<Value>(&it).unwrap());
        events.filter(|it| it["kind"] == kind).collect()
    }

    /// The drive trips for this cause, for the `count`th time, and the half at each of `ends` has kept that.
    #[track_caller]
    fn trips(&self, cause: u16, count: usize, ends: &[usize]) {
        self.pair.hub.trip(2, cause);
        for end in ends {
            self.has_kept(*end, "tripped", count);
        }
        self.shows_trip(cause, count);
    }

    /// Waits until the half at `end` has heard how often the drive has tripped: one that never knew that finds no trip.
    #[track_caller]
    fn knows_the_count(&self, end: usize, count: u16) {
        until("the count is heard", PATIENCE, || {
            let answer = Raw::connect(self.pair.half(end).modbus).read_unit(2, TRIP_COUNT, 1);
            (answer == Ok(vec![count])).then_some(())
        });
    }

    /// Waits until the journal of the half at `end` has this many events of a kind.
    #[track_caller]
    fn has_kept(&self, end: usize, kind: &str, count: usize) {
        let file = self.pair.half(end).file.to_str().unwrap();
        until(&format!("the journal has {count} {kind}"), PATIENCE, || {
            let output = vfd_gateway(&["journal", "trips", "--json", "-c", file]);
            let said = String::from_utf8(output.stdout).unwrap();
            let rows = said
                .lines()
                .map(|line| serde_json::from_str::<Value>(line).unwrap());
            (rows.filter(|row| row["kind"] == kind).count() == count).then_some(())
        });
    }

    /// Waits until the broker has the `count`th trip, by its cause.
    #[track_caller]
    fn shows_trip(&self, cause: u16, count: usize) {
        self.wait_for_last("drive/pump-2/trip/count", |it| it == count.to_string());
        self.wait_for_last("drive/pump-2/trip/last", |it| {
            serde_json::from_str::<Value>(it).is_ok_and(|it| it["code"] == cause)
        });
        self.wait_for_last("drive/pump-2/trip/active", |it| it == "true");
        until("the trip is told", PATIENCE, || {
            (self.events("tripped").len() >= count).then_some(())
        });
    }

    /// Resets the drive behind its `count`th trip and lets it run, which shows to a listener that the trip is over. The half at
    /// each of `ends` has kept that.
    #[track_caller]
    fn resets_and_runs(&self, name: &str, count: usize, ends: &[usize]) {
        self.does(r#""reset": true"#, &format!("{name}-reset"));
        self.runs(30.0, name);
        for end in ends {
            self.has_kept(*end, "cleared", count);
        }
        self.wait_for_last("drive/pump-2/trip/active", |it| it == "false");
        until("its end is told", PATIENCE, || {
            (self.events("cleared").len() >= count).then_some(())
        });
    }

    fn final_results(&self, id: &str) -> Vec<Value> {
        let results = self
            .all("drive/pump-2/result")
            .into_iter()
            .map(|it| serde_json::from_str::<Value>(&it).unwrap());
        results
            .filter(|it| it["id"] == id && it["final"] == true)
            .collect()
    }
}

/// Whether the half at `end` of `pair` has it from the broker that its partner is there.
fn knows_its_partner(pair: &Pair, end: usize, is_there: bool) {
    until(
        &format!("the partner is there: {is_there}"),
        PATIENCE,
        || {
            let output = vfd_gateway(&[
                "health",
                "--json",
                "-c",
                pair.half(end).file.to_str().unwrap(),
            ]);
            let health: Value = serde_json::from_slice(&output.stdout).ok()?;
            (health["mqtt"]["partner_online"] == is_there).then_some(())
        },
    );
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
    let (status, shown) = (
        plant.all("status").len(),
        plant.all("drive/pump-2/availability").len(),
    );

    knows_its_partner(&plant.pair, A, true);
    knows_its_partner(&plant.pair, B, true);
    plant.pair.kill(A);
    plant.wait_for_last("line/hall-1/active", |it| it == "b");
    plant.wait_for_last("status", |it| it == "online");
    assert_eq!(plant.all("status")[status..], ["offline", "online"]);
    plant.wait_for_last("standby/a", |it| role(it).is_none());
    plant.wait_for_last("standby/b", |it| role(it).as_deref() == Some("active"));
    assert!(
        plant.all("drive/pump-2/availability")[shown..]
            .iter()
            .all(|it| it == "online")
    );
    assert!(
        plant.all("drive/pump-2/availability").len() > shown,
        "it is published again"
    );
    plant.runs(20.0, "at-b");

    // It is back and listens: nothing of that is seen but its own document.
    let (status, actives) = (
        plant.all("status").len(),
        plant.all("line/hall-1/active").len(),
    );
    plant.pair.start(A);
    plant.wait_for_last("standby/a", |it| role(it).as_deref() == Some("listening"));
    plant.runs(25.0, "still-at-b");
    assert_eq!(plant.all("status").len(), status);
    assert_eq!(plant.all("line/hall-1/active").len(), actives);

    // The end of a listener is seen for a moment only.
    plant.pair.kill(A);
    until("both words are there", PATIENCE, || {
        (plant.all("status").len() >= status + 2).then_some(())
    });
    assert_eq!(plant.all("status")[status..], ["offline", "online"]);
    plant.wait_for_last("standby/a", |it| role(it).is_none());
    knows_its_partner(&plant.pair, B, false);
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
    assert_eq!(
        plant.all("status").len(),
        status,
        "{:?}",
        plant.all("status")
    );
    plant.pair.program(A).terminate();
    plant.wait_for_last("status", |it| it == "offline");
}

#[test]
fn a_trip_that_both_halves_have_heard_is_told_once_and_the_next_ones_follow_behind_take_overs() {
    let mut plant = Plant::new();
    plant.knows_the_count(B, 0);
    plant.runs(30.0, "before");
    plant.trips(5, 1, &[A, B]);
    plant.resets_and_runs("behind-1", 1, &[A, B]);

    // The one that heard it tells nothing of it when the line is its own, and then the next one.
    plant.pair.kill(A);
    plant.wait_for_last("standby/b", |it| role(it).as_deref() == Some("active"));
    plant.wait_for_last("status", |it| it == "online");
    plant.runs(20.0, "at-b");
    plant.trips(9, 2, &[B]);

    // The one that was away finds that trip at the drive when it has the line and reads the record, and has learnt from the
    // broker that it was told.
    plant.pair.start(A);
    plant.wait_for_last("standby/a", |it| role(it).as_deref() == Some("listening"));
    plant.knows_the_count(A, 2);
    plant.resets_and_runs("behind-2", 2, &[B]);
    plant.pair.kill(B);
    plant.wait_for_last("standby/a", |it| role(it).as_deref() == Some("active"));
    plant.wait_for_last("status", |it| it == "online");
    plant.has_kept(A, "tripped", 2);
    plant.runs(20.0, "at-a");
    plant.trips(3, 3, &[A]);

    let told = plant.events("tripped");
    let of = |key: &str| told.iter().map(|it| it[key].clone()).collect::<Vec<_>>();
    assert_eq!(of("count"), [1, 2, 3], "{told:?}");
    assert_eq!(of("code"), [5, 9, 3], "{told:?}");
    let [first, second, third] = &of("session")[..] else {
        unreachable!()
    };
    assert!(
        first != second && first == third,
        "each journal numbers its own: {told:?}"
    );
    assert_eq!(
        plant.events("cleared").len(),
        2,
        "{:?}",
        plant.events("cleared")
    );
    plant.pair.assert_one_master();
}
