//! Drives of other vendors, played by pymodbus from their documents: they are polled in full, they obey a controller and
//! a broker, and what they trip with is told.

use super::mosquitto::{Mosquitto, Subscriber};
use super::outsiders::{cable, mbpoll_output, pymodbus_client, pymodbus_vendor};
use super::raw::Raw;
use super::rig::{Place, fields, start};
use super::started::{PATIENCE, Started, until};
use serde_json::{Value, json};
use std::collections::BTreeSet;
use std::net::SocketAddr;
use std::process::Command;

/// Function, first address, words.
type Written = (u64, u64, Vec<u64>);

/// One drive on a line of its own, and the gateway before it. What is dropped first ends first.
struct Plant {
    _gateway: Started,
    modbus: SocketAddr,
    drive: Started,
    _cable: Started,
    broker: Mosquitto,
    _place: Place,
}

impl Plant {
    /// `drive` of `vendors.py` at `station`, which is its unit too, on a line with the keys `line`.
    fn new(drive: &str, model: &str, station: u8, line: &str, unproven: &str) -> Self {
        let place = Place::new();
        let (near, far) = (place.file("near"), place.file("far"));
        let cable = cable(&near, &far);
        let broker = Mosquitto::start(&place.file(""));
        let drive = pymodbus_vendor(drive, &far, station);
        let text = format!(
            "[gateway]\nname = \"plant\"\n\n[mqtt]\nbroker = \"mqtt://{}\"\n\n\
             [[modbus_tcp]]\nlisten = \"127.0.0.1:0\"\nwrite = [\"127.0.0.1/32\"]\n\n\
             [[line]]\nname = \"hall-1\"\nport = \"{}\"\n{line}\n\n\
             [[line.drive]]\nname = \"fan\"\nmodel = \"{model}\"\nstation = {station}\npoll = \"200ms\"\n\n\
             [line.drive.control]\nfrom = [\"mqtt\", \"modbus-tcp\"]\nfrequency_hz = {{ min = 5.0, max = 50.0 }}\n\
             directions = [\"forward\", \"reverse\"]\non_commander_lost = \"stop\"\nlost_after = \"60s\"\n\
             on_shutdown = \"stop\"\naccept_unverified = [{unproven}]\n",
            broker.address(),
            near.display(),
        );
        let file = place.write("gateway.toml", &text);
        let gateway = start(&["run", "-c", file.to_str().unwrap()]);
        let modbus = gateway.wait_for("where it listens", |line| {
            let fields = fields(line)?;
            (fields["message"] == "Modbus TCP").then(|| fields["address"].as_str()?.parse().ok())?
        });
        Self {
            _gateway: gateway,
            modbus,
            drive,
            _cable: cable,
            broker,
            _place: place,
        }
    }

    /// What the drive heard, in its own words.
    fn heard(&self) -> Vec<Value> {
        let heard = |line: &String| {
            serde_json::from_str(line)
                .ok()
                .filter(|it: &Value| it.get("heard").is_some())
        };
        self.drive.find_all(heard)
    }

    /// Waits until the drive was asked for all these registers, those that are polled by the hour among them.
    fn wait_until_read(&self, registers: &BTreeSet<u64>) {
        until(&format!("{registers:04X?} are read"), PATIENCE, || {
            self.read().is_superset(registers).then_some(())
        });
    }

    /// Every register that the drive was asked for.
    fn read(&self) -> BTreeSet<u64> {
        let span = |it: &Value| Some((it["address"].as_u64()?, it["count"].as_u64()?));
        self.heard()
            .iter()
            .filter_map(span)
            .flat_map(|(first, count)| first..first + count)
            .collect()
    }

    /// What was written to the drive. A stop is repeated where its effect shows late, so repeats count once.
    fn written(&self) -> Vec<Written> {
        let is_write = |it: &&Value| it["heard"] == 6 || it["heard"] == 16;
        let number = |it: &Value| it.as_u64().unwrap();
        let write = |it: &Value| {
            let words = it["words"].as_array().unwrap().iter().map(number).collect();
            (number(&it["heard"]), number(&it["address"]), words)
        };
        let mut written: Vec<_> = self.heard().iter().filter(is_write).map(write).collect();
        written.dedup();
        written
    }

    /// What the drive refused, its reasons with it.
    fn refused(&self) -> Vec<Value> {
        let refused = |line: &String| {
            serde_json::from_str(line)
                .ok()
                .filter(|it: &Value| it.get("refused").is_some())
        };
        self.drive.find_all(refused)
    }

    /// What a pymodbus client gets for `request`.
    fn ask(&self, request: &str) -> Value {
        pymodbus_client(self.modbus, &[request]).remove(0)
    }

    /// A pymodbus client writes; a stop before may not be effective yet.
    fn ask_to_write(&self, request: &str) {
        until(&format!("{request} is taken"), PATIENCE, || {
            let answer = self.ask(request);
            assert!(
                answer.get("exception").is_none_or(|code| *code == 6),
                "{request}: {answer}"
            );
            answer.get("exception").is_none().then_some(())
        });
    }

    /// A pymodbus client's loop test at `unit` comes back, and it is the drive that has heard it.
    fn echoes(&self, unit: u8) {
        assert_eq!(
            self.ask(&format!("loop:{unit}:0:0xA537")),
            json!({"words": [0xA537]})
        );
        let is_test = |it: &Value| {
            it["heard"] == 8 && it["station"] == unit && it["words"] == json!([0xA537])
        };
        until("the drive has heard the loop test", PATIENCE, || {
            self.heard().iter().any(is_test).then_some(())
        });
    }

    /// Publishes a command that names the present epoch, until it is not too soon for it, and waits for its good end.
    fn command(&self, subscriber: &Subscriber, id: &str, rest: &str) {
        let mut tries = 0;
        until(&format!("{id} is taken"), PATIENCE, || {
            tries += 1;
            let state: Value =
                serde_json::from_str(&subscriber.on("fan/state").last()?.payload).ok()?;
            let (id, epoch) = (format!("{id}-{tries}"), state["control"]["epoch"].as_u64()?);
            let order = format!(r#"{{"id": "{id}", "epoch": {epoch}, {rest}}}"#);
            self.broker.publish("vfd/plant/drive/fan/command", &order);
            let told = subscriber.results(&id);
            let last = told.last().unwrap();
            let is_too_soon = last["reason"] == "stop_pending" || last["reason"] == "stale_epoch";
            assert!(is_too_soon || last["outcome"] == "confirmed", "{told:?}");
            (!is_too_soon).then_some(())
        });
    }

    /// Registers of the drive itself, by mbpoll.
    fn mbpoll(&self, unit: u8, first: u16, count: u16) -> Vec<u16> {
        let (port, unit) = (self.modbus.port().to_string(), unit.to_string());
        let mut command = Command::new("mbpoll");
        command.args(["-0", "-1", "-t", "4", "-o", "6", "-a", &unit, "-p", &port]);
        mbpoll_output(command.args([
            "-r",
            &first.to_string(),
            "-c",
            &count.to_string(),
            "127.0.0.1",
        ]))
        .values
    }
}

/// Waits until word `at` of the uniform `unit` is `word`.
fn waits_for(client: &mut Raw, unit: u8, at: u16, word: u16) {
    until(&format!("word {at} is {word}"), PATIENCE, || {
        (client.read_unit(unit, at, 1).ok()? == [word]).then_some(())
    });
}

/// Words of the uniform map, typed from `docs/modbus-tcp.md`, and states of one of them.
const STATUS: u16 = 1;
const RUN_STATE: u16 = 2;
const TRIP_CODE: u16 = 3;
const OUTPUT: u16 = 4;
const STOPPED: u16 = 1;
const FORWARD: u16 = 2;
const REVERSE: u16 = 3;
const TRIPPED: u16 = 4;

/// Online, and no polled value is stale or was never read.
fn waits_until_polled_in_full(client: &mut Raw, unit: u8) {
    until("every polled value is there", PATIENCE, || {
        (client.read_unit(unit, STATUS, 1).ok()?[0] & (1 | 1 << 8) == 1).then_some(())
    });
}

/// Operation command, frequency command. Typed from the manual, like every number in this test.
const E510_RUN: u64 = 0x2501;
const E510_FREQUENCY: u64 = 0x2502;

#[test]
fn an_ascii_drive_obeys_a_controller_and_echoes_its_loop_test() {
    let mut plant = Plant::new(
        "e510",
        "teco-e510",
        7,
        "framing = \"ascii\"",
        "\"basic\", \"reverse\", \"reset\"",
    );
    let mut client = Raw::connect(plant.modbus);
    waits_until_polled_in_full(&mut client, 107);
    let polled = [0x0002, 0x0005, 0x0906, 0x0907, 0x0D00, 0x0D01]
        .into_iter()
        .chain(0x2520..0x2528);
    plant.wait_until_read(&polled.collect());
    waits_for(&mut client, 107, RUN_STATE, STOPPED);
    assert_eq!(plant.written(), [], "nothing is written before a command");

    plant.ask_to_write("write:107:256:0");
    plant.ask_to_write("write:107:256:1,3000");
    waits_for(&mut client, 107, RUN_STATE, FORWARD);
    waits_for(&mut client, 107, OUTPUT, 3000);
    let in_one_frame = (16, E510_RUN, vec![1, 3000]);
    assert_eq!(plant.written(), [(6, E510_RUN, vec![0]), in_one_frame]);
    until("all measurements of 30 Hz", PATIENCE, || {
        (client.read_unit(107, TRIP_CODE, 6).ok()? == [0, 3000, 3000, 52, 2400, 5650]).then_some(())
    });

    // The drive gives 17 words in one ASCII frame at most.
    let mut native = vec![0b0101, 0, 0, 3000, 3000, 2400, 565, 52];
    assert_eq!(plant.mbpoll(7, 0x2520, 8), native);
    native.extend(0x2528..0x2533);
    assert_eq!(plant.ask("read:7:0x2520:19"), json!({"words": native}));
    plant.echoes(7);
    assert_eq!(plant.refused(), Vec::<Value>::new());
    assert_eq!(
        plant.ask("read:7:0x2540:1"),
        json!({"exception": 0x52}),
        "the drive's own code"
    );
    let refused = until("the drive tells what it refused", PATIENCE, || {
        plant.refused().pop()
    });
    assert_eq!(
        refused,
        json!({"refused": 3, "station": 7, "exception": 0x52})
    );

    plant.ask_to_write("write:107:257:2000");
    waits_for(&mut client, 107, OUTPUT, 2000);
    plant.ask_to_write("write:107:256:0");
    waits_for(&mut client, 107, OUTPUT, 0);
    waits_for(&mut client, 107, RUN_STATE, STOPPED);
    assert_eq!(
        plant.written()[2..],
        [(6, E510_FREQUENCY, vec![2000]), (6, E510_RUN, vec![0])]
    );

    plant.ask_to_write("write:107:256:2,3000");
    waits_for(&mut client, 107, RUN_STATE, REVERSE);
    assert_eq!(plant.written()[4..], [(16, E510_RUN, vec![3, 3000])]);
    plant.drive.type_line("trip 13");
    waits_for(&mut client, 107, RUN_STATE, TRIPPED);
    waits_for(&mut client, 107, TRIP_CODE, 13);
    assert_eq!(plant.ask("write:107:256:1"), json!({"exception": 6}));
    plant.ask_to_write("write:107:256:4");
    waits_for(&mut client, 107, RUN_STATE, STOPPED);
    waits_for(&mut client, 107, TRIP_CODE, 0);
    assert!(
        plant
            .written()
            .ends_with(&[0, 8, 0].map(|word| (6, E510_RUN, vec![word]))),
        "{:?}",
        plant.written()
    );
    assert_eq!(plant.refused().len(), 1, "{:?}", plant.refused());

    // Nobody answers for a drive that is silent.
    plant.drive.signal("STOP");
    assert_eq!(plant.ask("loop:7:0:0xA538"), json!({"exception": 0x0B}));
}

/// Run command, set frequency. Typed from the manual, like every number in this test.
const FR500A_RUN: u64 = 0x2000;
const FR500A_FREQUENCY: u64 = 0x2001;

#[test]
fn a_drive_with_numbers_for_commands_obeys_a_broker() {
    let mut plant = Plant::new(
        "fr500a",
        "frecon-fr500a",
        5,
        "baud = 9600\nparity = \"none\"\nstop_bits = 2",
        "",
    );
    let subscriber = Subscriber::new(&plant.broker, "mqttv5", "vfd/plant/#");
    let mut client = Raw::connect(plant.modbus);
    waits_until_polled_in_full(&mut client, 105);
    let parameters = [
        0x0014, 0x0015, 0x0016, 0x0017, 0x0101, 0x0200, 0x0B0B, 0x0F03,
    ];
    let monitors = [0x2100, 0x2101, 0x3017, 0x301B, 0x301F]
        .into_iter()
        .chain(0x3000..0x3008);
    let polled: BTreeSet<u64> = parameters.into_iter().chain(monitors).collect();
    plant.wait_until_read(&polled);
    subscriber.wait_for_payload("run/state", "stopped");
    assert_eq!(plant.written(), [], "nothing is written before a command");

    plant.command(
        &subscriber,
        "first",
        r#""run": "forward", "frequency_hz": 30"#,
    );
    subscriber.wait_for_payload("run/state", "forward");
    for (topic, payload) in [
        ("frequency/output", "30.00"),
        ("frequency/setpoint", "30.00"),
        ("measure/voltage", "240.0"),
        ("measure/current", "5.2"),
        ("measure/power", "1.5"),
        ("measure/motor_speed", "900"),
        ("measure/dc_voltage", "565"),
        ("measure/temperature", "-3.5"),
        ("measure/torque", "40.1"),
        ("measure/run_hours", "1234"),
    ] {
        subscriber.wait_for_payload(topic, payload);
    }
    assert_eq!(
        plant.written(),
        [(6, FR500A_FREQUENCY, vec![3000]), (6, FR500A_RUN, vec![1])]
    );

    // The drive gives 8 words at once at most.
    let mut native = vec![3000, 3000, 2400, 52, 15, 900, 565, 3000];
    assert_eq!(plant.mbpoll(5, 0x3000, 8), native);
    native.resize(20, 0);
    assert_eq!(plant.ask("read:5:0x3000:20"), json!({"words": native}));
    plant.echoes(5);

    plant.broker.publish("vfd/plant/drive/fan/run/set", "stop");
    subscriber.wait_for_payload("run/state", "stopping");
    waits_for(&mut client, 105, RUN_STATE, STOPPED);
    assert_eq!(plant.written()[2..], [(6, FR500A_RUN, vec![5])]);

    plant.command(
        &subscriber,
        "second",
        r#""run": "reverse", "frequency_hz": 20"#,
    );
    subscriber.wait_for_payload("run/state", "reverse");
    waits_for(&mut client, 105, OUTPUT, 2000);
    assert_eq!(
        plant.written()[3..],
        [(6, FR500A_FREQUENCY, vec![2000]), (6, FR500A_RUN, vec![2])]
    );
    plant.drive.type_line("trip 8");
    subscriber.wait_for_payload("run/state", "tripped");
    let last = subscriber.wait_for("trip/last", |it| {
        serde_json::from_str::<Value>(&it.payload).ok()
    });
    assert_eq!(
        (&last["code"], &last["text"]),
        (&json!(8), &json!("short circuit"))
    );
    let record = ["trip_frequency", "trip_current", "trip_dc_voltage"]
        .map(|name| last["values"][name]["value"].as_f64());
    assert_eq!(record, [20.0, 9.9, 612.0].map(Some));
    plant.command(&subscriber, "third", r#""reset": true"#);
    waits_for(&mut client, 105, RUN_STATE, STOPPED);
    assert!(
        plant
            .written()
            .ends_with(&[5, 7].map(|word| (6, FR500A_RUN, vec![word]))),
        "{:?}",
        plant.written()
    );
    assert_eq!(plant.refused(), Vec::<Value>::new());
}
