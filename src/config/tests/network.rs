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
    assert_eq!((&listener.write, &listener.stop, listener.reads_renew), (&Vec::new(), &None, false));
    let text = rights("allow = ['10.0.0.0/24']\nwrite = ['10.0.0.10/32']\nstop = ['10.0.0.0/24']\nreads_renew = true");
    let listener = &good(&text).listeners[0];
    let network = |text: &str| text.parse::<IpNet>().unwrap();
    assert_eq!(listener.write, [network("10.0.0.10/32")]);
    assert_eq!((&listener.stop, listener.reads_renew), (&Some(vec![network("10.0.0.0/24")]), true));
}

#[test]
fn whoever_may_write_can_connect() {
    for (key, more) in [("write", ""), ("stop", "\nwrite = ['10.0.0.10/32']")] {
        let list = |list: &str| rights(&format!("allow = ['10.0.0.0/24', '10.1.0.0/24']\n{key} = [{list}]{more}"));
        let found = problems(&list("'10.0.0.0/24', '10.2.0.1/32'"));
        assert_eq!(
            found,
            [format!(
                "modbus_tcp[0].{key}[1]: 10.2.0.1/32 is in no network of `allow`; \
                 a network inside \"10.0.0.0/24\", \"10.1.0.0/24\""
            )]
        );
        let wide = problems(&list("'10.0.0.0/8'"));
        assert!(wide[0].contains("10.0.0.0/8 is in no network of `allow`"), "{wide:?}");
    }
    only(
        &rights("write = ['10.0.0.10/32']"),
        "modbus_tcp[0].write[0]: 10.0.0.10/32 cannot reach 127.0.0.1:1502, which is this host only; \"127.0.0.1/32\"",
    );
}

#[test]
fn whoever_may_start_may_stop() {
    only(
        &rights("write = ['127.0.0.0/8']\nstop = ['127.0.0.1/32']"),
        "modbus_tcp[0].write[0]: 127.0.0.0/8 may write and is not in `stop`: whoever may start may stop; \
         \"127.0.0.0/8\" in `stop` as well",
    );
    only(
        &rights("write = ['127.0.0.1/32']\nstop = []"),
        "modbus_tcp[0].write[0]: 127.0.0.1/32 may write and is not in `stop`: whoever may start may stop; \
         \"127.0.0.1/32\" in `stop` as well",
    );
}

#[test]
fn a_right_that_nobody_can_use_is_refused() {
    let leave = "`from = [\"modbus-tcp\"]` in the `[line.drive.control]` of a drive, or leave it out";
    only(
        &listener_with("write = ['127.0.0.1/32']"),
        &format!("modbus_tcp[0].write: no drive that is served here takes commands from \"modbus-tcp\"; {leave}"),
    );
    only(
        &listener_with("stop = ['127.0.0.1/32']"),
        &format!("modbus_tcp[0].stop: no drive that is served here has a control section; {leave}"),
    );
    let by_mqtt = with(CONTROLLED, ", \"modbus-tcp\"", "");
    only(
        &by_mqtt,
        &format!("modbus_tcp[0].write: no drive that is served here takes commands from \"modbus-tcp\"; {leave}"),
    );
    good(&with(&by_mqtt, "write = [\"127.0.0.1/32\"]", "stop = ['127.0.0.1/32']"));
    only(
        &listener_with("reads_renew = true"),
        "modbus_tcp[0].reads_renew: nobody may write here, so there is no lease to renew; \
         `write` with those who may, or leave it out",
    );
    good(&listener_with("write = []\nstop = []\nreads_renew = false"));
}

#[test]
fn http_stays_on_this_host() {
    let http = |listen: &str| format!("{MINIMAL}[http]\nlisten = '{listen}'\n");
    assert_eq!(good(&http("127.0.0.1:8080")).http.unwrap().listen.port(), 8080);
    good(&http("[::1]:8080"));
    only(
        &http("0.0.0.0:8080"),
        "http.listen: 0.0.0.0:8080 can be reached from other hosts, and there is no sign-in; \
         a loopback address, as \"127.0.0.1:8080\"",
    );
    only(
        &http("127.0.0.1:1502"),
        "http.listen: 127.0.0.1:1502 is taken by the listener 127.0.0.1:1502; an address or a port of its own",
    );
    only(
        &format!("{MINIMAL}[http]"),
        "http.listen: `listen` is missing; an address with a port: \"127.0.0.1:8080\", \"[::1]:8080\"",
    );
}

#[test]
fn the_data_directory_is_an_absolute_path() {
    let text = |path: &str| format!("[gateway]\ndata_dir = '{path}'\n{MINIMAL}");
    assert_eq!(good(&text("/var/lib/vfd")).gateway.data_dir, Some(PathBuf::from("/var/lib/vfd")));
    assert_eq!(good(MINIMAL).gateway.data_dir, None);
    only(&text("vfd"), "gateway.data_dir: `vfd` will not do; an absolute path");
}
