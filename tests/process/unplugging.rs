//! A device that comes and goes, and two who want the same one.

use super::adapter::Adapter;
use super::raw::Raw;
use super::rig::{Gateway, Place, fields, gateway, gateway_with, simulate, start};
use super::started::{PATIENCE, until};
use std::path::Path;
use std::time::Duration;

/// A register that only a client reads.
const F010: u16 = 0x0211;

/// A gateway that has heard the drive behind an adapter.
fn plugged_in() -> (Place, Adapter, Gateway) {
    let place = Place::new();
    let port = place.file("line");
    let mut adapter = Adapter::new(&port);
    adapter.plug_in();
    let gateway = gateway(&place, &port);
    gateway.wait_for_drive();
    (place, adapter, gateway)
}

#[test]
fn an_adapter_that_comes_and_goes_leaks_nothing_and_is_back_within_a_second() {
    let (_place, mut adapter, gateway) = plugged_in();
    let mut client = Raw::connect(gateway.address);
    assert_eq!(client.read(F010, 1), Ok(vec![3]));
    let descriptors = descriptors(&gateway);
    for cycle in 0..20 {
        // Every other time in the middle of an exchange; whoever waits is answered all the same.
        if cycle % 2 == 1 {
            let mut busy = Raw::connect(gateway.address);
            let asking = std::thread::spawn(move || busy.read(F010, 1));
            std::thread::sleep(Duration::from_millis(5));
            adapter.pull_out();
            let answer = asking.join().unwrap();
            assert!(matches!(answer, Ok(_) | Err(0x0A | 0x0B)), "{answer:?}");
        } else {
            adapter.pull_out();
        }
        until("the line is down", Duration::from_secs(1), || {
            (client.read(F010, 1) == Err(0x0A)).then_some(())
        });
        adapter.plug_in();
        let words = until("the drive is back", Duration::from_secs(1), || {
            client.read(F010, 1).ok()
        });
        assert_eq!(words, [3]);
    }
    // The clients that came and went are closed a moment later.
    until("no more descriptors than before", PATIENCE, || {
        (self::descriptors(&gateway) <= descriptors).then_some(())
    });
}

#[test]
fn a_device_that_is_away_is_reported_once() {
    let (_place, mut adapter, gateway) = plugged_in();
    adapter.pull_out();
    gateway.program.wait_for("that the line is down", |line| {
        (message(line)? == "line down").then_some(())
    });
    std::thread::sleep(Duration::from_secs(2));
    assert_eq!(told(&gateway, "line down"), 1, "{}", gateway.program.text());
    assert_eq!(
        told(&gateway, "cannot open the port; retrying"),
        1,
        "{}",
        gateway.program.text()
    );
    adapter.plug_in();
    until("the line is up again", PATIENCE, || {
        (told(&gateway, "line up") == 2).then_some(())
    });
}

/// Two programs, one device, two names for it.
#[test]
fn a_second_gateway_is_informed_who_has_the_device_and_the_first_is_undisturbed() {
    let place = Place::new();
    let (one, other) = (place.file("line"), place.file("by-id"));
    let _drive = simulate(&one);
    std::os::unix::fs::symlink(std::fs::read_link(&one).unwrap(), &other).unwrap();
    let mut first = gateway(&place, &one);
    first.wait_for_drive();
    let second = gateway_with(&place, &other, "reads_renew = false");
    let refusal = second
        .program
        .wait_for("that the device is in use", |line| {
            let fields = fields(line)?;
            let is_refusal = fields["message"] == "cannot open the port; retrying";
            is_refusal.then(|| fields["error"].as_str().map(str::to_owned))?
        });
    let holder = format!(
        "line test of the vfd-gateway that is process {}",
        first.program.id()
    );
    assert!(refusal.contains(&holder), "{refusal}");
    let mut client = Raw::connect(first.address);
    for _ in 0..20 {
        assert_eq!(client.read(F010, 1), Ok(vec![3]));
    }
    assert_eq!(told(&first, "line down"), 0);
    assert_eq!(Raw::connect(second.address).read(F010, 1), Err(0x0A));
    first.program.terminate();
    assert!(first.program.end_within(PATIENCE).success());
    let mut client = Raw::connect(second.address);
    until("the second has the device", Duration::from_secs(2), || {
        client.read(F010, 1).ok()
    });
}

#[test]
fn the_lock_of_a_gateway_that_was_killed_holds_nobody_up() {
    let place = Place::new();
    let port = place.file("line");
    let _drive = simulate(&port);
    let mut first = gateway(&place, &port);
    first.wait_for_drive();
    first.program.kill();
    let second = gateway(&place, &port);
    second.wait_for_drive();
    assert_eq!(
        told(&second, "cannot open the port; retrying"),
        0,
        "{}",
        second.program.text()
    );
}

#[test]
fn one_device_under_two_names_serves_one_line_of_a_gateway() {
    let place = Place::new();
    let (one, other) = (place.file("line"), place.file("by-id"));
    let _drive = simulate(&one);
    std::os::unix::fs::symlink(std::fs::read_link(&one).unwrap(), &other).unwrap();
    let line = |name: &str, port: &Path, unit: u8| {
        format!(
            "[[line]]\nname = \"{name}\"\nport = \"{}\"\n[[line.drive]]\nname = \"of-{name}\"\nmodel = \"hyundai-n700\"\n\
             station = 1\nunit = {unit}\n",
            port.display()
        )
    };
    let text = line("hall-1", &one, 1)
        + &line("hall-2", &other, 2)
        + "[[modbus_tcp]]\nlisten = \"127.0.0.1:0\"\n";
    let file = place.write("two.toml", &text);
    let gateway = start(&["run", "-c", file.to_str().unwrap()]);
    let (line, error) =
        gateway.wait_for("that the device is in use by another line of it", |line| {
            let fields = fields(line)?;
            let error = fields["error"]
                .as_str()
                .filter(|error| error.contains("of this gateway"))?
                .to_owned();
            Some((fields["line"].as_str()?.to_owned(), error))
        });
    let holder = if line == "hall-1" {
        "line hall-2 of this gateway"
    } else {
        "line hall-1 of this gateway"
    };
    assert!(error.contains(holder), "{line}: {error}");
}

#[test]
fn a_driver_that_cannot_turn_the_direction_is_reported_by_the_name_of_the_call() {
    let place = Place::new();
    let port = place.file("line");
    let _drive = simulate(&port);
    for (rs485, call) in [("kernel", "TIOCSRS485"), ("rts", "TIOCMBIC")] {
        let text = format!(
            "[[line]]\nname = \"test\"\nport = \"{}\"\nrs485 = \"{rs485}\"\n[[line.drive]]\nname = \"pump-1\"\n\
             model = \"hyundai-n700\"\nstation = 1\n",
            port.display()
        );
        let file = place.write("gateway.toml", &text);
        let gateway = start(&["run", "-c", file.to_str().unwrap()]);
        gateway.wait_for("which call is missing", |line| {
            let error = fields(line)?["error"].as_str()?.to_owned();
            (error.contains(call) && error.contains("\"adapter\"")).then_some(())
        });
    }
}

fn message(line: &str) -> Option<String> {
    fields(line)?["message"].as_str().map(str::to_owned)
}

/// How often the log has said `message`.
fn told(gateway: &Gateway, wanted: &str) -> usize {
    gateway
        .program
        .find_all(|line| message(line).filter(|it| it == wanted))
        .len()
}

fn descriptors(gateway: &Gateway) -> usize {
    std::fs::read_dir(format!("/proc/{}/fd", gateway.program.id()))
        .unwrap()
        .count()
}
