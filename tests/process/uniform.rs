//! The uniform unit and the exceptions, as pymodbus and mbpoll see them.

use super::outsiders::{mbpoll_output, pymodbus_client};
use super::plant::{FREQUENCY, Plant, RUN, Wish};
use super::started::{PATIENCE, until};
use serde_json::{Value, json};
use std::process::Command;

#[test]
fn the_uniform_map_is_read_word_by_word_and_bit_by_bit() {
    let plant = Plant::new();
    let ask = |requests: &[&str]| pymodbus_client(plant.modbus, requests);
    let answers = ask(&[
        "read:101:0:16",
        "read_input:101:0:32",
        "read:101:256:6",
        "discrete:101:0:16",
        "coils:101:0:4",
    ]);
    let words = |at: usize| -> Vec<u64> {
        answers[at]["words"]
            .as_array()
            .unwrap()
            .iter()
            .map(|word| word.as_u64().unwrap())
            .collect()
    };
    let head = words(0);
    assert_eq!(head[0], 1, "version of the map");
    assert_eq!(
        head[1] & 0b1_1110,
        0,
        "not running, not reverse, not tripped: {:b}",
        head[1]
    );
    assert_eq!(head[1] & 1, 1, "online");
    assert_eq!(head[1] >> 9 & 1, 1, "start inhibited");
    assert_eq!(
        head[2..6],
        [1, head[3], 0, 0],
        "stopped, 0.00 Hz, setpoint 0.00 Hz"
    );
    assert_eq!(
        head[6..12],
        [65535, 65535, 65535, 65535, 32768, 32768],
        "what the model does not have"
    );
    assert!(head[12] < 6000, "age {}", head[12]);
    assert_eq!(head[13..15], [0, 0], "no trips");
    assert_eq!(words(1)[20..22], [500, 5000], "the limits");
    assert_eq!(words(1).len(), 32);
    assert_eq!(
        words(2)[..2],
        [0, 65535],
        "stopped, and no setpoint was accepted"
    );
    let bits = answers[3]["bits"].as_array().unwrap();
    let as_word = bits
        .iter()
        .enumerate()
        .fold(0, |word, (at, bit)| word | u64::from(*bit == true) << at);
    assert_eq!(
        as_word & 0b10_0001_1111,
        head[1] & 0b10_0001_1111,
        "inputs are the bits of word 1"
    );
    assert_eq!(answers[4]["bits"], json!([false, false, false, false]));
    // mbpoll sees the same.
    let mut command = Command::new("mbpoll");
    command.args([
        "-0",
        "-1",
        "-a",
        "101",
        "-t",
        "4",
        "-r",
        "0",
        "-c",
        "1",
        "-p",
        &plant.modbus.port().to_string(),
    ]);
    assert_eq!(mbpoll_output(command.arg("127.0.0.1")).values, [1]);
}

#[test]
fn every_refusal_has_its_exception_and_no_frame() {
    let plant = Plant::new();
    let refused = [
        ("coils:1:0:1", 0x01),          // not served on a native unit
        ("write:101:0:1", 0x02),        // measurements are not written
        ("write:101:259:1", 0x02),      // nor outcomes
        ("read:101:40:1", 0x02),        // behind the map
        ("read:101:262:1", 0x02),       // behind control
        ("read:101:39:2", 0x02),        // half outside
        ("write:1:0x020C:100", 0x02),   // a register that no list names
        ("write:1:0x0201:3000", 0x02),  // nor this one, which is the setting itself
        ("write:1:0x0002:7", 0x03),     // no run command
        ("write:1:0x0004:6000", 0x03),  // outside of the limits
        ("write:101:256:9", 0x03),      // no run command
        ("write:101:257:499", 0x03),    // below the limits
        ("write:101:257:5001", 0x03),   // above
        ("write:101:256:5,3000", 0x03), // a release with a setpoint
        ("coil:101:4:1", 0x02),         // there are four
        ("write:101:256:1,3000", 0x06), // nobody has commanded stop yet
        ("write:1:0x0002:1", 0x06),     // the same by the drive's own register
        ("write:2:0x0002:1", 0x0A),     // no such unit
        ("write:255:0:1", 0x01),        // the gateway's own words are read only
        ("write:0:256:0", 0x01),        // never a broadcast
        ("coil:0:0:1", 0x01),           // nor a stop for all
    ];
    let answers = pymodbus_client(plant.modbus, &refused.map(|(request, _)| request));
    for ((request, code), answer) in refused.iter().zip(&answers) {
        assert_eq!(answer, &json!({"exception": code}), "{request}");
    }
    assert_eq!(answers.len(), refused.len());
    plant.assert_nothing_was_written_since(0);
}

#[test]
fn a_client_that_writes_cyclically_runs_the_drive_with_one_frame_for_each_change() {
    let plant = Plant::with(Wish {
        lost_after: "30s",
        ..Wish::default()
    });
    let done = |requests: &[&str]| -> Vec<Value> { pymodbus_client(plant.modbus, requests) };
    // One block is one command, the setpoint first; what repeats it goes nowhere.
    let block = "write:101:256:1,3000,1";
    assert_eq!(done(&["write:101:256:0"])[0].get("exception"), None);
    until(
        "the stop is effective and the block taken",
        PATIENCE,
        || {
            let answer = &done(&[block])[0];
            assert!(
                answer["exception"] == 6 || answer.get("exception").is_none(),
                "{answer}"
            );
            answer.get("exception").is_none().then_some(())
        },
    );
    let answers = done(&[block, block, "read:101:256:2", "read:101:19:1"]);
    assert!(
        answers
            .iter()
            .all(|answer| answer.get("exception").is_none()),
        "{answers:?}"
    );
    assert_eq!(answers[2]["words"], json!([1, 3000]));
    assert_eq!(
        answers[3]["words"],
        json!([3]),
        "it is this client that holds control"
    );
    assert_eq!(plant.written(), [(RUN, 0), (FREQUENCY, 3000), (RUN, 1)]);
    plant.wait_until_it_turns();
    // Somebody else may not go on from here.
    let subscriber = plant.subscriber();
    plant.order("command", r#"{"id": "other", "frequency_hz": 40}"#);
    assert_eq!(
        subscriber.results("other").last().unwrap()["reason"],
        "other_owner"
    );
    // The coil for forward, released.
    assert_eq!(done(&["coil:101:0:0"])[0].get("exception"), None);
    plant.wait_until_it_stands();
    assert_eq!(plant.written()[3..], [(RUN, 0)]);
    // Stop repeated is in force already; the coil that stops is pressed anew each time.
    assert_eq!(done(&["write:101:256:0"])[0].get("exception"), None);
    assert_eq!(plant.written().len(), 4);
    for pressed in 1..=2 {
        assert_eq!(done(&["coil:101:3:1"])[0].get("exception"), None);
        assert_eq!(plant.written()[4..], vec![(RUN, 0); pressed]);
    }
}
