//! Ordinary clients read a drive through the gateway, and ordinary drives are read.

use super::outsiders::{cable, mbpoll, pymodbus_client, pymodbus_drive};
use super::rig::{Place, gateway, simulate};
use super::started::{PATIENCE, until};
use serde_json::json;

/// F010, frequency source: 3 (communication) in a simulated drive. Typed from the manual.
const F010: &str = "0x0211";

#[test]
fn mbpoll_reads_a_simulated_drive_through_the_gateway() {
    let place = Place::new();
    let port = place.file("line");
    let _drive = simulate(&port);
    let gateway = gateway(&place, &port);
    gateway.wait_for_drive();
    let holding = mbpoll(gateway.address, &["-t", "4", "-r", "529", "-c", "1"]);
    assert_eq!(holding.values, [3], "{}", holding.text);
    let input = mbpoll(gateway.address, &["-t", "3", "-r", "529", "-c", "2"]);
    assert_eq!(
        input.values,
        [3, 3],
        "F010 and F011 as input registers: {}",
        input.text
    );
}

#[test]
fn pymodbus_reads_with_03_and_04_and_more_words_than_the_drive_gives_at_once() {
    let place = Place::new();
    let port = place.file("line");
    let _drive = simulate(&port);
    let gateway = gateway(&place, &port);
    gateway.wait_for_drive();
    let f010 = |verb: &str| format!("{verb}:1:{F010}:1");
    let answers = pymodbus_client(
        gateway.address,
        &[&f010("read"), &f010("read_input"), "read:1:0x0112:20"],
    );
    assert_eq!(answers[0], json!({"words": [3]}));
    assert_eq!(answers[1], json!({"words": [3]}));
    // Trip count and trip records of a drive that never tripped: three frames of at most 8 words.
    assert_eq!(answers[2], json!({"words": vec![0; 20]}));
}

#[test]
fn a_drive_that_pymodbus_plays_is_read_word_for_word() {
    let place = Place::new();
    let (near, far) = (place.file("near"), place.file("far"));
    let _cable = cable(&near, &far);
    let _drive = pymodbus_drive(&far, 1);
    let gateway = gateway(&place, &near);
    // The gateway may have asked before the drive was ready; then it asks again when a client does.
    let first = until("the drive answers", PATIENCE, || {
        Some(mbpoll(gateway.address, &["-t", "4", "-r", "257", "-c", "1"]).values)
            .filter(|values| !values.is_empty())
    });
    assert_eq!(first, [0x0101]);
    // Every register of this drive holds its own address, so that no word can stand in for another.
    let words: Vec<u16> = (0x0201..0x0201 + 20).collect();
    let block = mbpoll(gateway.address, &["-t", "4", "-r", "513", "-c", "20"]);
    assert_eq!(block.values, words, "{}", block.text);
}
