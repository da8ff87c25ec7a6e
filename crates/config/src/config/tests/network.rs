//! What clients connect to: who may write and stop, the HTTP listener, the tools' directory.

use super::*;
use ipnet::IpNet;
use std::path::PathBuf;

/// `CONTROLLED` with other rights of its listener.
fn rights(lines: &str) -> String {
    with(CONTROLLED, "write = [\"127.0.0.1/32\"]", lines)
}

#[test]
fn nobody_may_write_unless_it_is_said() {
    let listener = &good(MINIMAL).listeners[0];
    assert_eq!(
        (&listener.write, &listener.stop, listener.reads_renew),
        (&Vec::new(), &None, false)
    );
    let text = rights(
        "allow = ['10.0.0.0/24']\nwrite = ['10.0.0.10/32']\nstop = ['10.0.0.0/24']\nreads_renew = true",
    );
    let listener = &good(&text).listeners[0];
    let network = |text: &str| text.parse::<IpNet>().unwrap();
    assert_eq!(listener.write, [network("10.0.0.10/32")]);
    assert_eq!(
        (&listener.stop, listener.reads_renew),
        (&Some(vec![network("10.0.0.0/24")]), true)
    );
}

#[test]
fn nothing_is_answered_from_memory_unless_it_is_said() {
    assert!(!good(MINIMAL).listeners[0].cached);
    assert!(good(&rights("write = ['127.0.0.1/32']\ncached = true")).listeners[0].cached);
    let master =
        "[[modbus_rtu]]\nname = 'panel'\nport = '/dev/ttyS9'\nbaud = 9600\nparity = 'none'\n";
    assert!(
        !good(&format!("{MINIMAL}\n{master}")).serial_masters[0]
            .serving
            .cached
    );
    assert!(
        good(&format!("{MINIMAL}\n{master}cached = true\n")).serial_masters[0]
            .serving
            .cached
    );
}

#[test]
fn anyone_who_may_write_can_connect() {
    for (key, more) in [("write", ""), ("stop", "\nwrite = ['10.0.0.10/32']")] {
        let list = |list: &str| {
            rights(&format!(
                "allow = ['10.0.0.0/24', '10.1.0.0/24']\n{key} = [{list}]{more}"
            ))
        };
        let found = problems(&list("'10.0.0.0/24', '10.2.0.1/32'"));
        assert_eq!(
            found,
            [format!(
                "modbus_tcp[0].{key}[1]: 10.2.0.1/32 is in no network of `allow`; \
                 a network inside \"10.0.0.0/24\", \"10.1.0.0/24\""
            )]
        );
        let wide = problems(&list("'10.0.0.0/8'"));
        assert!(
            wide[0].contains("10.0.0.0/8 is in no network of `allow`"),
            "{wide:?}"
        );
    }
    only(
        &rights("write = ['10.0.0.10/32']"),
        "modbus_tcp[0].write[0]: 10.0.0.10/32 cannot reach 127.0.0.1:1502, which is this host only; \"127.0.0.1/32\"",
    );
}

#[test]
fn anyone_who_may_start_may_stop() {
    only(
        &rights("write = ['127.0.0.0/8']\nstop = ['127.0.0.1/32']"),
        "modbus_tcp[0].write[0]: 127.0.0.0/8 may write and is not in `stop`: a client that may start must be allowed to stop; \
         \"127.0.0.0/8\" in `stop` as well",
    );
    only(
        &rights("write = ['127.0.0.1/32']\nstop = []"),
        "modbus_tcp[0].write[0]: 127.0.0.1/32 may write and is not in `stop`: a client that may start must be allowed to stop; \
         \"127.0.0.1/32\" in `stop` as well",
    );
}

#[test]
fn a_right_that_nobody_can_use_is_refused() {
    let leave =
        "`from = [\"modbus-tcp\"]` in the `[line.drive.control]` of a drive, or leave it out";
    only(
        &listener_with("write = ['127.0.0.1/32']"),
        &format!(
            "modbus_tcp[0].write: has no effect: no drive that is served here takes commands from \"modbus-tcp\"; {leave}"
        ),
    );
    only(
        &listener_with("stop = ['127.0.0.1/32']"),
        &format!(
            "modbus_tcp[0].stop: has no effect: no drive that is served here has a control section; {leave}"
        ),
    );
    let by_mqtt = with(CONTROLLED, ", \"modbus-tcp\"", "");
    only(
        &by_mqtt,
        &format!(
            "modbus_tcp[0].write: has no effect: no drive that is served here takes commands from \"modbus-tcp\"; {leave}"
        ),
    );
    good(&with(
        &by_mqtt,
        "write = [\"127.0.0.1/32\"]",
        "stop = ['127.0.0.1/32']",
    ));
    only(
        &listener_with("reads_renew = true"),
        "modbus_tcp[0].reads_renew: has no effect: no client may write here, so there is no lease to renew; \
         `write` with the networks that may, or leave it out",
    );
    good(&listener_with("write = []\nstop = []\nreads_renew = false"));
}

#[test]
fn http_has_an_address_of_its_own() {
    let http = |listen: &str| format!("{MINIMAL}[http]\nlisten = '{listen}'\n");
    assert_eq!(
        good(&http("127.0.0.1:8080")).http.unwrap().listen.port(),
        8080
    );
    good(&http("[::1]:8080"));
    only(
        &http("127.0.0.1:1502"),
        "http.listen: 127.0.0.1:1502 is taken by the listener 127.0.0.1:1502; a different address or port",
    );
    only(
        &format!("{MINIMAL}[http]"),
        "http.listen: `listen` is missing; an address with a port: \"127.0.0.1:8080\", \"[::1]:8080\"",
    );
}

#[test]
fn the_data_directory_is_an_absolute_path() {
    let text = |path: &str| format!("[gateway]\ndata_dir = '{path}'\n{MINIMAL}");
    assert_eq!(
        good(&text("/var/lib/vfd")).gateway.data_dir,
        Some(PathBuf::from("/var/lib/vfd"))
    );
    assert_eq!(good(MINIMAL).gateway.data_dir, None);
    only(
        &text("vfd"),
        "gateway.data_dir: `vfd` is not valid; an absolute path",
    );
}

#[test]
fn connections_are_as_the_listener_says() {
    let listener = &good(MINIMAL).listeners[0];
    assert_eq!(
        (
            listener.connections_max,
            &listener.priority,
            &listener.units
        ),
        (None, &Vec::new(), &None)
    );
    let ten_minutes = Duration::from_secs(600);
    assert_eq!(
        (listener.idle_timeout, listener.keep_alive),
        (Some(ten_minutes), Some(Duration::from_secs(60)))
    );
    let text = "connections_max = 20000\npriority = ['127.0.0.1/32']\nidle_timeout = '1h'\nkeep_alive = '2s'";
    let listener = &good(&listener_with(text)).listeners[0];
    assert_eq!(
        (listener.connections_max, listener.priority.len()),
        (Some(20_000), 1)
    );
    let times = (
        Some(Duration::from_secs(3600)),
        Some(Duration::from_secs(2)),
    );
    assert_eq!((listener.idle_timeout, listener.keep_alive), times);
    let none = &good(&listener_with("idle_timeout = '0s'\nkeep_alive = '0s'")).listeners[0];
    assert_eq!((none.idle_timeout, none.keep_alive), (None, None));
}

#[test]
fn a_limit_that_makes_no_sense_is_refused() {
    for (line, right) in [
        (
            "connections_max = 0",
            "connections_max: 0 is out of range; a whole number from 1 to 65536",
        ),
        (
            "connections_max = 65537",
            "connections_max: 65537 is out of range; a whole number from 1 to 65536",
        ),
        (
            "idle_timeout = '500ms'",
            "idle_timeout: clients that ask once a second would be closed in between; at least \"1s\", or \"0s\" for none",
        ),
        (
            "keep_alive = '1500ms'",
            "keep_alive: the system uses whole seconds for this time; \"1s\"",
        ),
        (
            "keep_alive = '200ms'",
            "keep_alive: the system uses whole seconds for this time; \"1s\"",
        ),
        (
            "priority = ['10.0.0.10/32']",
            "priority[0]: 10.0.0.10/32 cannot reach 127.0.0.1:1502, which is this host only; \"127.0.0.1/32\"",
        ),
    ] {
        only(&listener_with(line), &format!("modbus_tcp[0].{right}"));
    }
    assert!(
        problems(&listener_with("idle_timeout = '25h'"))[0]
            .contains("a time from \"0ms\" to \"24h\"")
    );
    assert!(
        problems(&listener_with("keep_alive = '3h'"))[0].contains("a time from \"0ms\" to \"2h\"")
    );
    let allowed = "allow = ['10.0.0.0/24']\npriority = ['10.0.0.0/16']";
    only(
        &listener_with(allowed),
        "modbus_tcp[0].priority[0]: 10.0.0.0/16 is in no network of `allow`; a network inside \"10.0.0.0/24\"",
    );
}

#[test]
fn units_that_are_served_are_units_of_drives() {
    let numbers = |text: &str| -> Vec<u8> {
        good(text).listeners[0]
            .units
            .as_ref()
            .unwrap()
            .iter()
            .map(|unit| unit.get())
            .collect()
    };
    assert_eq!(numbers(&listener_with("units = [101, 1]")), [101, 1]);
    only(
        &listener_with("units = [1, 255]"),
        "modbus_tcp[0].units[1]: 255 is out of range; a whole number from 1 to 247",
    );
    only(
        &listener_with("units = []"),
        "modbus_tcp[0].units: an empty list of units serves no drive; units of drives, or leave it out to serve all",
    );
    only(
        &listener_with("units = [1, 1]"),
        "modbus_tcp[0].units[1]: unit 1 is listed twice; each once",
    );
    let listed = format!("{TWO_LINES}lines = ['hall-1']\nunits = [2, 101]\n");
    only(
        &listed,
        "modbus_tcp[0].units[0]: has no effect: no drive that is served here has unit 2; of 1, 101; 255 is always served",
    );
    assert_eq!(
        problems(&listener_with("units = [7, 8]")).len(),
        2,
        "all at once"
    );
}

#[test]
fn anyone_who_is_to_command_a_drive_reaches_one_of_its_units() {
    for unit in [1, 101] {
        good(&rights(&format!(
            "write = ['127.0.0.1/32']\nunits = [{unit}]"
        )));
    }
    let found = problems(&rights("write = ['127.0.0.1/32']\nunits = [2]"));
    assert_eq!(found.len(), 2, "{found:?}");
    assert!(found[0].starts_with(
        "line[0].drive[0].control.from[1]: commands from \"modbus-tcp\" are impossible: no listener of line `hall-1` allows"
    ));
    assert!(
        found[1].starts_with(
            "modbus_tcp[0].write: has no effect: no drive that is served here takes commands"
        ),
        "{found:?}"
    );
}
