//! The same orders work unchanged on every drive that is built in, from a broker and from a controller, or are refused
//! by name.

use super::mosquitto::{Mosquitto, Subscriber, free_port};
use super::raw::Raw;
use super::rig::{Place, fields, program, start};
use super::started::{PATIENCE, Started, until};
use serde_json::Value;
use std::fmt::Write as _;
use std::net::{Ipv4Addr, SocketAddr};
use std::time::Duration;

/// A family, and what of it is unproven, typed from the documents' sheets.
struct Family {
    model: &'static str,
    name: &'static str,
    unproven: &'static [&'static str],
    can_coast: bool,
    /// Keys that its drive needs.
    keys: &'static str,
}

#[rustfmt::skip]
const FAMILIES: [Family; 7] = [
    Family { model: "hyundai-n700", name: "n700", unproven: &[], can_coast: true, keys: "" },
    Family { model: "hyundai-n100plus", name: "n100plus", unproven: &[], can_coast: false, keys: "" },
    Family { model: "toshiba-vf-as1", name: "vf-as1", unproven: &["basic", "reverse", "reset", "coast"], can_coast: true, keys: "rated_current_a = 11.0\nrated_voltage_v = 400.0" },
    Family { model: "toshiba-vf-s15", name: "vf-s15", unproven: &["basic", "reverse", "reset", "coast"], can_coast: true, keys: "rated_current_a = 11.0\nrated_voltage_v = 400.0" },
    Family { model: "teco-e510", name: "e510", unproven: &["basic", "reverse", "reset"], can_coast: false, keys: "" },
    Family { model: "teco-e510s", name: "e510s", unproven: &["basic", "reverse", "reset"], can_coast: false, keys: "" },
    Family { model: "frecon-fr500a", name: "fr500a", unproven: &[], can_coast: true, keys: "" },
];

/// Longest time for a ramp to 30 Hz and back, on a machine that is busy with other tests.
const RAMP: Duration = Duration::from_secs(40);

/// One simulated drive of every family, each on a line of its own, one gateway, one broker. What is dropped first ends first.
struct Plant {
    _gateway: Started,
    modbus: SocketAddr,
    drives: Vec<Started>,
    broker: Mosquitto,
    _place: Place,
}

impl Plant {
    fn new() -> Self {
        let place = Place::new();
        let broker = Mosquitto::start(&place.file(""));
        let drives = FAMILIES
            .iter()
            .map(|family| simulated(&place, family))
            .collect();
        std::fs::create_dir(place.file("data")).unwrap();
        let http = SocketAddr::from((Ipv4Addr::LOCALHOST, free_port()));
        let mut text = format!(
            "[gateway]\nname = \"plant\"\ndata_dir = \"{}\"\n\n[mqtt]\nbroker = \"mqtt://{}\"\n\n\
             [[modbus_tcp]]\nlisten = \"127.0.0.1:0\"\nwrite = [\"127.0.0.1/32\"]\n\n[http]\nlisten = \"{http}\"\n",
            place.file("data").display(),
            broker.address()
        );
        for (unit, family) in (1..).zip(&FAMILIES) {
            line(&mut text, &place, family, unit);
        }
        let file = place.write("gateway.toml", &text);
        let gateway = start(&["run", "-c", file.to_str().unwrap()]);
        let modbus = gateway.wait_for("where it listens", |line| {
            let fields = fields(line)?;
            (fields["message"] == "Modbus TCP").then(|| fields["address"].as_str()?.parse().ok())?
        });
        Self {
            _gateway: gateway,
            modbus,
            drives,
            broker,
            _place: place,
        }
    }

    fn subscriber(&self) -> Subscriber {
        Subscriber::new(&self.broker, "mqttv5", "vfd/plant/#")
    }

    fn order(&self, family: &Family, rest: &str, payload: &str) {
        self.broker.publish(&topic(family, rest), payload);
    }

    /// The last word about the command `id`.
    fn told(
        &self,
        subscriber: &Subscriber,
        family: &Family,
        command: &str,
        id: &str,
    ) -> (String, String) {
        self.order(family, "command", &command.replace("ID", id));
        let told = until(&format!("the last word about {id}"), PATIENCE, || {
            let told = subscriber.results(id);
            told.last().filter(|it| it["final"] != false).cloned()
        });
        let word = |key: &str| told[key].as_str().unwrap_or_default().to_owned();
        (word("outcome"), word("reason"))
    }

    /// Every drive trips.
    fn trip_all(&mut self) {
        self.drives
            .iter_mut()
            .for_each(|drive| drive.type_line("trip"));
    }
}

fn simulated(place: &Place, family: &Family) -> Started {
    let link = place.file(family.name);
    let mut command = program();
    command.args([
        "simulate",
        "--model",
        family.model,
        "--link",
        link.to_str().unwrap(),
        "--trip-on-enter",
    ]);
    let drive = Started::at_a_keyboard(command);
    drive.wait_for("that it plays", |line| {
        line.contains("station 1").then_some(())
    });
    drive
}

fn line(text: &mut String, place: &Place, family: &Family, unit: u8) {
    let Family {
        model,
        name,
        unproven,
        keys,
        ..
    } = family;
    let unproven: Vec<_> = unproven
        .iter()
        .map(|action| format!("\"{action}\""))
        .collect();
    write!(
        text,
        "\n[[line]]\nname = \"{name}\"\nport = \"{}\"\n\n[[line.drive]]\nname = \"{name}\"\nmodel = \"{model}\"\n\
         station = 1\nunit = {unit}\nuniform_unit = {}\n{keys}\n\n[line.drive.control]\n\
         from = [\"mqtt\", \"modbus-tcp\"]\nfrequency_hz = {{ min = 5.0, max = 50.0 }}\n\
         directions = [\"forward\", \"reverse\"]\non_commander_lost = \"stop\"\nlost_after = \"60s\"\n\
         on_shutdown = \"stop\"\naccept_unverified = [{}]\n",
        place.file(name).display(),
        100 + unit,
        unproven.join(", ")
    )
    .unwrap();
}

fn topic(family: &Family, rest: &str) -> String {
    format!("vfd/plant/drive/{}/{rest}", family.name)
}

fn waits_for_state(subscriber: &Subscriber, family: &Family, state: &str) {
    until(&format!("{}: {state}", family.name), RAMP, || {
        (subscriber.on(&topic(family, "run/state")).last()?.payload == state).then_some(())
    });
}

#[test]
fn a_broker_commands_every_family_in_the_same_words() {
    let mut plant = Plant::new();
    let subscriber = plant.subscriber();
    for family in &FAMILIES {
        waits_for_state(&subscriber, family, "stopped");
        plant.order(family, "frequency/set", "30");
        let id = format!("{}-reverse", family.name);
        let (outcome, reason) = plant.told(
            &subscriber,
            family,
            r#"{"id": "ID", "run": "reverse", "frequency_hz": 30}"#,
            &id,
        );
        assert!(
            matches!(&outcome[..], "acknowledged" | "confirmed"),
            "{id}: {outcome} {reason}"
        );
    }
    for family in &FAMILIES {
        waits_for_state(&subscriber, family, "reverse");
        plant.order(family, "run/set", "stop");
    }
    for family in &FAMILIES {
        waits_for_state(&subscriber, family, "stopped");
        let run = format!("{}-forward", family.name);
        let epoch = epoch(&subscriber, family);
        let command =
            format!(r#"{{"id": "ID", "run": "forward", "frequency_hz": 30, "epoch": {epoch}}}"#);
        let (outcome, reason) = plant.told(&subscriber, family, &command, &run);
        assert!(
            matches!(&outcome[..], "acknowledged" | "confirmed"),
            "{run}: {outcome} {reason}"
        );
        let coast = format!("{}-coast", family.name);
        let told = plant.told(
            &subscriber,
            family,
            r#"{"id": "ID", "run": "coast"}"#,
            &coast,
        );
        let expected = if family.can_coast {
            ("confirmed", "none")
        } else {
            ("refused", "not_capable")
        };
        assert_eq!((&told.0[..], &told.1[..]), expected, "{coast}");
    }
    plant.trip_all();
    for family in &FAMILIES {
        waits_for_state(&subscriber, family, "tripped");
        let id = format!("{}-reset", family.name);
        let (outcome, reason) =
            plant.told(&subscriber, family, r#"{"id": "ID", "reset": true}"#, &id);
        assert!(
            matches!(&outcome[..], "acknowledged" | "confirmed"),
            "{id}: {outcome} {reason}"
        );
        waits_for_state(&subscriber, family, "stopped");
    }
}

fn epoch(subscriber: &Subscriber, family: &Family) -> u64 {
    let state = topic(family, "state");
    until("the drive's epoch", PATIENCE, || {
        let state: Value = serde_json::from_str(&subscriber.on(&state).last()?.payload).ok()?;
        state["control"]["epoch"].as_u64()
    })
}

/// Words of the uniform map, typed from `docs/modbus-tcp.md`.
const RUN: u16 = 256;
const SETPOINT: u16 = 257;
const RUN_STATE: u16 = 2;
const OUTPUT: u16 = 4;

#[test]
fn a_controller_commands_every_family_in_the_same_registers() {
    let mut plant = Plant::new();
    let mut client = Raw::connect(plant.modbus);
    let units: Vec<u8> = (101..).take(FAMILIES.len()).collect();
    let is = |client: &mut Raw, unit: u8, state: u16| {
        until(&format!("unit {unit} in state {state}"), RAMP, || {
            (client.read_unit(unit, RUN_STATE, 1).ok()? == [state]).then_some(())
        });
    };
    let writes = |client: &mut Raw, unit: u8, register: u16, word: u16| {
        // A stop before may not be effective yet.
        let answer = until(
            &format!("unit {unit} takes {word}"),
            PATIENCE,
            || match client.write(unit, register, word) {
                Err(6) => None,
                answer => Some(answer),
            },
        );
        assert_eq!(answer, Ok(()), "unit {unit}: {word} to {register}");
    };
    for unit in &units {
        is(&mut client, *unit, 1);
        for (register, word) in [(RUN, 0), (SETPOINT, 3000), (RUN, 2)] {
            writes(&mut client, *unit, register, word);
        }
    }
    for unit in &units {
        is(&mut client, *unit, 3);
        until("30 Hz", RAMP, || {
            (client.read_unit(*unit, OUTPUT, 1).ok()? == [3000]).then_some(())
        });
        writes(&mut client, *unit, RUN, 0);
    }
    for (unit, family) in units.iter().zip(&FAMILIES) {
        is(&mut client, *unit, 1);
        writes(&mut client, *unit, RUN, 1);
        let answer = client.write(*unit, RUN, 3);
        assert_eq!(
            answer,
            if family.can_coast { Ok(()) } else { Err(1) },
            "{}: coast",
            family.name
        );
    }
    plant.trip_all();
    for unit in &units {
        is(&mut client, *unit, 4);
        writes(&mut client, *unit, RUN, 4);
        is(&mut client, *unit, 1);
    }
}
