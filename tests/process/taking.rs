//! Control passes from one commander to another: two controllers, one on MQTT with a name of its own, and a person with a
//! terminal. The motor goes on meanwhile, and the journal tells who it was.

use super::mosquitto::free_port;
use super::plant::{Plant, UNIFORM, Wish};
use super::raw::Raw;
use super::rig::{program, start, vfd_gateway};
use super::started::{PATIENCE, Started, until};
use serde_json::Value;
use std::net::{Ipv4Addr, SocketAddr};
use std::process::Command;

/// The uniform words that tell the class of whoever holds control, and the reason of the last outcome.
const OWNER: u16 = 19;
const REASON: u16 = 261;
/// Another client, the asking client itself, somebody on MQTT.
const ON_MQTT: u16 = 1;
const ANOTHER: u16 = 2;
const ITSELF: u16 = 3;
const OTHER_OWNER: u16 = 14;

/// Somebody at 127.0.0.2.
struct Neighbour {
    client: Raw,
    _socat: Started,
}

impl Neighbour {
    fn new(modbus: SocketAddr) -> Self {
        let port = free_port();
        let mut socat = Command::new("socat");
        socat.arg(format!("TCP-LISTEN:{port},bind=127.0.0.1,reuseaddr"));
        socat.arg(format!("TCP:{modbus},bind=127.0.0.2"));
        let socat = Started::new(socat);
        let address = SocketAddr::from((Ipv4Addr::LOCALHOST, port));
        let client = until("socat listens", PATIENCE, || Raw::try_connect(address));
        Self {
            client,
            _socat: socat,
        }
    }
}

fn owner(client: &mut Raw) -> u16 {
    client.read_unit(UNIFORM, OWNER, 1).unwrap()[0]
}

fn assert_refused(client: &mut Raw, setpoint: u16) {
    assert_eq!(client.write(UNIFORM, 257, setpoint), Err(6));
    assert_eq!(client.read_unit(UNIFORM, REASON, 1), Ok(vec![OTHER_OWNER]));
}

#[test]
fn control_passes_on_while_the_motor_turns_and_the_journal_names_everybody() {
    let plant = Plant::with(Wish {
        control: "allow_take = true\n",
        write: "127.0.0.0/8",
        lost_after: "20s",
        ..Wish::default()
    });
    let subscriber = plant.subscriber();
    let (mut first, mut second) = (Raw::connect(plant.modbus), Neighbour::new(plant.modbus));
    let second = &mut second.client;
    plant.run_over_modbus(&mut first);
    plant.wait_until_it_turns();
    let seen = plant.written().len();
    until("the picture shows who holds control", PATIENCE, || {
        (owner(second) == ANOTHER).then_some(())
    });
    assert_refused(second, 3100);

    assert_eq!(second.write(UNIFORM, 256, 6), Ok(()));
    subscriber.wait_for_payload("control/owner", "modbus-tcp 127.0.0.2");
    assert_eq!((owner(second), owner(&mut first)), (ITSELF, ANOTHER));
    assert_refused(&mut first, 3200);
    assert_eq!(plant.written().len(), seen, "nobody wrote to the drive");
    assert_eq!(second.write(UNIFORM, 257, 3300), Ok(()));

    plant
        .broker
        .publish("vfd/plant/by/bob/drive/pump-1/control/take", "take");
    subscriber.wait_for_payload("control/owner", "mqtt bob");
    assert_eq!((owner(second), owner(&mut first)), (ON_MQTT, ON_MQTT));
    assert_refused(second, 3400);
    let state = subscriber.wait_for("pump-1/state", |it| {
        serde_json::from_str::<Value>(&it.payload).ok()
    });
    assert!(
        state["capabilities"]
            .as_array()
            .unwrap()
            .contains(&"take".into()),
        "{state}"
    );

    // A person takes it, stays, and stops it.
    let port = plant.modbus.port().to_string();
    let mut person = start(&[
        "write",
        "--host",
        "127.0.0.1",
        "--port",
        &port,
        "--unit",
        "101",
        "run",
        "take",
    ]);
    person.wait_for("that it holds control", |line| {
        line.contains("until Ctrl-C").then_some(())
    });
    subscriber.wait_for_payload("control/owner", "modbus-tcp 127.0.0.1");
    assert!(plant.output() > Some(200));
    person.interrupt();
    assert!(person.end_within(PATIENCE).success(), "{}", person.text());
    plant.wait_until_it_stands();
    subscriber.wait_for_payload("control/owner", "");
    assert_journal_names_everybody(&plant);
}

fn assert_journal_names_everybody(plant: &Plant) {
    let data = plant.place.file("data");
    let read = |more: &[&str]| {
        let said = vfd_gateway(
            &[
                &["journal", "audit", "--data-dir", data.to_str().unwrap()],
                more,
            ]
            .concat(),
        );
        String::from_utf8(said.stdout).unwrap()
    };
    let rows: Vec<Value> = read(&["--json"])
        .lines()
        .map(|line| serde_json::from_str(line).unwrap())
        .collect();
    let leases: Vec<_> = rows
        .iter()
        .filter(|row| row["kind"] == "lease")
        .map(|row| row["body"].clone())
        .collect();
    let told = |body: &Value| {
        ["state", "by", "from"].map(|key| body[key].as_str().unwrap_or("").to_owned())
    };
    let (one, two, bob) = ("modbus-tcp 127.0.0.1", "modbus-tcp 127.0.0.2", "mqtt bob");
    let right = [
        ["opened", one, ""],
        ["taken_over", two, one],
        ["taken_over", bob, two],
        ["taken_over", one, bob],
        ["ended", one, ""],
    ];
    assert_eq!(
        leases.iter().map(told).collect::<Vec<_>>(),
        right.map(|row| row.map(str::to_owned))
    );
    let holders = rows
        .iter()
        .filter(|row| row["body"]["reason"] == "other_owner");
    let holders: Vec<_> = holders
        .map(|row| row["body"]["holder"].as_str().unwrap().to_owned())
        .collect();
    assert_eq!(holders, [one, two, bob]);
    let words = read(&[]);
    for said in [
        format!("pump-1 {one} holds control\n"),
        format!("{bob} took control over from {two}\n"),
        format!("refused: {one} holds control of the drive\n"),
        format!("{one} does not hold control any more\n"),
    ] {
        assert!(words.contains(&said), "no `{said}` in:\n{words}");
    }
}

#[test]
fn a_person_is_informed_that_there_is_nothing_to_take() {
    let plant = Plant::with(Wish {
        control: "allow_take = true\n",
        ..Wish::default()
    });
    let port = plant.modbus.port().to_string();
    let mut take = program();
    take.args([
        "write",
        "--host",
        "127.0.0.1",
        "--port",
        &port,
        "--unit",
        "101",
        "run",
        "take",
    ]);
    let said = take.output().unwrap();
    assert_eq!(
        said.status.code(),
        Some(0),
        "{}",
        String::from_utf8_lossy(&said.stderr)
    );
    assert!(
        String::from_utf8_lossy(&said.stdout).contains("nothing to hold"),
        "{said:?}"
    );
    assert_eq!(plant.written(), []);
}
