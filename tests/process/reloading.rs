//! The configuration changes while the gateway runs: whole or not at all, and nobody who is not meant notices.

use super::mosquitto::free_port;
use super::plant::{OUTPUT, Plant, RUN, UNIFORM, Wish};
use super::raw::Raw;
use super::rig::{fields, program, start, vfd_gateway};
use super::started::{PATIENCE, Started, until};
use std::net::{Ipv4Addr, SocketAddr};
use std::os::unix::net::UnixDatagram;
use std::process::Output;
use std::time::Duration;

/// Long enough that no lease ends while the test looks.
const PATIENT: Wish<'_> = Wish {
    lost_after: "60s",
    ..Wish::NONE
};
/// Who holds control, in the uniform map; 0 is nobody.
const OWNER: u16 = 19;
/// The owner is the one who asks.
const OURSELVES: u16 = 3;

/// The file with `from` replaced by `to`.
fn edit(plant: &Plant, from: &str, to: &str) {
    let text = std::fs::read_to_string(&plant.file).unwrap();
    assert!(text.contains(from), "{from} in {text}");
    std::fs::write(&plant.file, text.replacen(from, to, 1)).unwrap();
}

/// `vfd-gateway reload`, with all that it says.
fn reload(plant: &Plant, more: &[&str]) -> (Option<i32>, String) {
    let socket = plant.place.file("data/vfd-gateway.sock");
    let args = [&["reload", "--socket", socket.to_str().unwrap()], more].concat();
    let Output {
        status,
        stdout,
        stderr,
    } = vfd_gateway(&args);
    (
        status.code(),
        [stdout, stderr]
            .map(|it| String::from_utf8(it).unwrap())
            .concat(),
    )
}

/// Sends SIGHUP, and waits for what the log says of it, beside what it had said before.
fn hang_up(plant: &Plant) -> String {
    let told = |line: &str| {
        let fields = fields(line)?;
        let message = fields["message"].as_str()?;
        let is_it =
            message == "configuration reloaded" || message.starts_with("configuration unchanged");
        is_it.then(|| {
            format!(
                "{message} {}",
                fields["changes"].as_str().unwrap_or_default()
            )
        })
    };
    let before = plant.gateway.find_all(|line| told(line)).len();
    plant.gateway.signal("HUP");
    until("the log tells of the reload", PATIENCE, || {
        plant
            .gateway
            .find_all(|line| told(line))
            .get(before)
            .cloned()
    })
}

fn connections_to_the_broker(plant: &Plant) -> usize {
    plant.logged(|line| is_connection(line)).len()
}

fn is_connection(line: &str) -> Option<()> {
    line.contains("connected to the broker").then_some(())
}

/// A second line with a drive, and the text for it.
fn second_line(plant: &Plant) -> (Started, String) {
    let port = plant.place.file("line-2");
    let link = port.to_str().unwrap();
    let drive = start(&[
        "simulate",
        "--model",
        "hyundai-n700",
        "--baud",
        "38400",
        "--station",
        "2",
        "--link",
        link,
    ]);
    drive.wait_for("that it plays", |line| {
        line.contains("station 2").then_some(())
    });
    let text = format!(
        "[[line]]\nname = \"hall-2\"\nport = \"{link}\"\nbaud = 38400\n\n[[line.drive]]\nname = \"pump-2\"\n\
         model = \"hyundai-n700\"\nstation = 2\nunit = 2\npoll = \"100ms\"\n\n"
    );
    (drive, text)
}

/// A controller that holds the plant's drive, which turns.
fn holding(plant: &Plant) -> Raw {
    let mut client = Raw::connect(plant.modbus);
    plant.run_over_modbus(&mut client);
    plant.wait_until_it_turns();
    client
}

fn assert_held(client: &mut Raw) {
    assert_eq!(client.read_unit(UNIFORM, OWNER, 1), Ok(vec![OURSELVES]));
    assert!(client.read_unit(1, OUTPUT, 1).unwrap()[0] > 200);
}

#[test]
fn a_line_comes_and_goes_and_the_others_do_not_notice() {
    let plant = Plant::with(PATIENT);
    let subscriber = plant.subscriber();
    let mut client = holding(&plant);
    let written = plant.written();
    let (_drive, line) = second_line(&plant);
    assert_eq!(client.read_unit(102, 0, 1), Err(0x0A));

    // In front of the line that runs: it has another place in the file now.
    edit(&plant, "[[line]]\n", &format!("{line}[[line]]\n"));
    edit(
        &plant,
        "name = \"pump-1\"\n",
        "name = \"pump-1\"\nunit = 1\n",
    );
    assert_eq!(
        hang_up(&plant),
        "configuration reloaded line hall-2: added; drive pump-2: added"
    );
    until(
        "the new drive is read on the old connection",
        PATIENCE,
        || (client.read_unit(102, 2, 1) == Ok(vec![1])).then_some(()),
    );
    assert_held(&mut client);
    subscriber.wait_for_payload("drive/pump-2/availability", "online");

    // By the command, with the drive at rest.
    edit(&plant, &line, "");
    let (code, said) = reload(&plant, &[]);
    assert_eq!(
        (code, said.as_str()),
        (Some(0), "line hall-2: removed\ndrive pump-2: removed\n")
    );
    assert_eq!(client.read_unit(102, 0, 1), Err(0x0A));
    assert_held(&mut client);
    subscriber.wait_for_payload("drive/pump-2/availability", "");
    let late = plant.subscriber();
    late.wait_for_payload("drive/pump-1/availability", "online");
    late.wait_for_payload("plant/status", "online");
    assert!(
        !late.has("pump-2") && !late.has("hall-2"),
        "what is gone was cleared"
    );

    assert_eq!(
        reload(&plant, &[]),
        (Some(0), "reloaded; nothing has changed\n".to_owned())
    );
    assert_eq!(plant.written(), written, "nothing was written over it all");
    assert_eq!(connections_to_the_broker(&plant), 1);
    assert_eq!(
        plant
            .logged(|line| line.contains("\"line up\"").then_some(()))
            .len(),
        2,
        "none came again"
    );
}

#[test]
fn what_has_no_effect_is_warned_about_and_taken() {
    let plant = Plant::new();
    let text = std::fs::read_to_string(&plant.file).unwrap();
    std::fs::write(
        &plant.file,
        text.replacen("station = ", "rated_current_a = 7.5\nstation = ", 1),
    )
    .unwrap();
    let socket = plant.place.file("data/vfd-gateway.sock");
    let reloaded = super::rig::vfd_gateway(&["reload", "--socket", socket.to_str().unwrap()]);
    super::rig::assert_says(
        &reloaded,
        0,
        &["warning: line[0].drive[0].rated_current_a: has no effect"],
    );
    plant.gateway.wait_for("the warning", |line| {
        (line.contains("configuration: has no effect") && line.contains("WARN")).then_some(())
    });
}

#[test]
fn a_file_with_problems_changes_nothing() {
    let plant = Plant::with(PATIENT);
    let mut client = holding(&plant);
    let good = std::fs::read_to_string(&plant.file).unwrap();
    edit(&plant, "poll = \"100ms\"", "poll = \"never\"\nspeed = 3");
    let told = hang_up(&plant);
    assert!(
        told.contains("unknown key `speed`") && told.contains("2 problems"),
        "{told}"
    );
    let (code, said) = reload(&plant, &[]);
    assert!(
        code == Some(2) && said.contains("2 problems") && said.contains("unchanged"),
        "{said}"
    );
    let (code, said) = reload(&plant, &["--json"]);
    let answer: serde_json::Value = serde_json::from_str(said.lines().next().unwrap()).unwrap();
    assert_eq!(
        (code, &answer["reloaded"], &answer["reason"]),
        (Some(2), &false.into(), &"configuration".into())
    );
    // An address that is not to be had.
    std::fs::write(&plant.file, &good).unwrap();
    let taken = std::net::TcpListener::bind("127.0.0.1:0").unwrap();
    edit(
        &plant,
        "[http]",
        &format!(
            "[[modbus_tcp]]\nlisten = \"{}\"\n\n[http]",
            taken.local_addr().unwrap()
        ),
    );
    edit(&plant, "poll = \"100ms\"", "poll = \"200ms\"");
    let (code, said) = reload(&plant, &[]);
    assert!(
        code == Some(1) && said.contains("cannot listen on"),
        "{said}"
    );
    // What only a restart changes.
    std::fs::write(&plant.file, &good).unwrap();
    edit(&plant, "name = \"plant\"", "name = \"other\"");
    let (code, said) = reload(&plant, &[]);
    assert!(
        code == Some(1) && said.contains("gateway.name") && said.contains("restart"),
        "{said}"
    );
    assert_held(&mut client);
    assert_eq!(plant.written().last(), Some(&(RUN, 1)));
}

#[test]
fn a_pipe_in_the_place_of_the_file_holds_up_no_reload() {
    let plant = Plant::with(PATIENT);
    let mut client = holding(&plant);
    let good = std::fs::read_to_string(&plant.file).unwrap();
    for make in ["mkfifo", "mkdir", "ln -s /dev/zero", "truncate -s 50M"] {
        let make = format!("rm '{0}' && {make} '{0}'", plant.file.display());
        assert!(
            std::process::Command::new("sh")
                .args(["-c", &make])
                .status()
                .unwrap()
                .success(),
            "{make}"
        );
        let (code, said) = reload(&plant, &[]);
        let is_told =
            said.contains("a regular file is needed") || said.contains("bytes are the most");
        assert!(
            code == Some(2) && is_told && said.contains("unchanged"),
            "{make}: {code:?} {said}"
        );
        // To write into a pipe would wait for who reads it.
        std::fs::remove_file(&plant.file)
            .or_else(|_| std::fs::remove_dir(&plant.file))
            .unwrap();
        std::fs::write(&plant.file, &good).unwrap();
        assert_eq!(
            reload(&plant, &[]),
            (Some(0), "reloaded; nothing has changed\n".to_owned()),
            "behind {make}"
        );
    }
    assert_held(&mut client);
}

#[test]
fn a_running_drive_is_not_taken_away_unless_that_is_declared() {
    let plant = Plant::with(PATIENT);
    let mut client = holding(&plant);
    let seen = plant.written().len();
    edit(&plant, "poll = \"100ms\"", "poll = \"200ms\"");
    let (code, said) = reload(&plant, &[]);
    assert!(
        code == Some(1) && said.contains("drive pump-1 is in use") && said.contains("on_removal"),
        "{said}"
    );
    assert_held(&mut client);
    assert_eq!(
        client.write(UNIFORM, 257, 3100),
        Ok(()),
        "its commander goes on"
    );
    assert_eq!(plant.written().len(), seen + 1);

    edit(&plant, "[gateway]\n", "[gateway]\non_removal = \"stop\"\n");
    assert_eq!(
        reload(&plant, &[]),
        (
            Some(0),
            "gateway: changed\nline hall-1: changed\ndrive pump-1: changed\n".to_owned()
        )
    );
    let written = plant.written();
    assert!(
        written.len() > seen + 1 && written[seen + 1..].iter().all(|it| *it == (RUN, 0)),
        "{written:?}"
    );
    plant.wait_until_ready();
    plant.wait_until_it_stands();
    assert_eq!(
        client.read_unit(UNIFORM, OWNER, 1),
        Ok(vec![0]),
        "on the same connection"
    );
    assert_eq!(
        client.write(UNIFORM, 256, 1),
        Err(6),
        "nobody goes on by itself"
    );
    plant.run_over_modbus(&mut client);
    plant.wait_until_it_turns();
}

#[test]
fn a_drive_whose_stop_shows_no_effect_stays() {
    let plant = Plant::with(PATIENT);
    holding(&plant);
    let seen = plant.written().len();
    plant.silence_the_drive();
    edit(&plant, "[gateway]\n", "[gateway]\non_removal = \"stop\"\n");
    edit(&plant, "poll = \"100ms\"", "poll = \"200ms\"");
    let (code, said) = reload(&plant, &[]);
    assert!(
        code == Some(1) && said.contains("pump-1 is being stopped without effect"),
        "{said}"
    );
    assert_eq!(plant.written()[seen], (RUN, 0));
    assert_eq!(
        Raw::connect(plant.modbus).read_unit(UNIFORM, 2, 1),
        Ok(vec![5]),
        "it is still looked after"
    );
}

#[test]
fn listeners_come_and_go_and_what_they_grant_holds_for_the_next_request() {
    let plant = Plant::with(PATIENT);
    let mut client = Raw::connect(plant.modbus);
    assert_eq!(client.write(UNIFORM, 256, 0), Ok(()));
    let second = SocketAddr::from((Ipv4Addr::LOCALHOST, free_port()));
    let listener = format!("[[modbus_tcp]]\nlisten = \"{second}\"\n\n");
    edit(&plant, "[http]", &format!("{listener}[http]"));
    edit(
        &plant,
        "write = [\"127.0.0.1/32\"]",
        "write = [\"127.0.0.2/32\"]",
    );
    let told = hang_up(&plant);
    assert!(
        told.contains(&format!("modbus_tcp {second}: added")),
        "{told}"
    );
    assert_eq!(
        client.write(UNIFORM, 257, 3000),
        Err(1),
        "it may write no more"
    );
    let mut other = Raw::connect(second);
    assert_eq!(other.read_unit(UNIFORM, 0, 1), Ok(vec![1]));
    edit(&plant, &listener, "");
    hang_up(&plant);
    assert!(other.is_closed_in_silence());
    assert!(std::net::TcpStream::connect(second).is_err());
    assert_eq!(client.read_unit(UNIFORM, 0, 1), Ok(vec![1]));
    edit(&plant, "write =", "allow = [\"127.0.0.2/32\"]\nwrite =");
    hang_up(&plant);
    assert!(client.is_closed_in_silence());
    // Nobody is let in any more who could ask; the log has told of the reload.
    assert_eq!(plant.gateway.find_all(|line| is_connection(line)).len(), 1);
}

#[test]
fn a_change_of_the_broker_side_makes_a_new_connection_and_says_goodbye_on_the_old_one() {
    let plant = Plant::with(PATIENT);
    let subscriber = plant.subscriber();
    subscriber.wait_for_payload("plant/status", "online");
    let mut client = holding(&plant);
    edit(
        &plant,
        "probe_interval",
        "prefix = \"works\"\nprobe_interval",
    );
    assert_eq!(hang_up(&plant), "configuration reloaded mqtt: changed");
    subscriber.wait_for_payload("plant/status", "offline");
    let moved = super::mosquitto::Subscriber::new(&plant.broker, "mqttv5", "works/plant/#");
    moved.wait_for_payload("plant/status", "online");
    plant
        .broker
        .publish("works/plant/drive/pump-1/run/set", "stop");
    plant.wait_until_it_stands();
    assert_eq!(client.read_unit(UNIFORM, 0, 1), Ok(vec![1]));
    assert_eq!(connections_to_the_broker(&plant), 2);
}

#[test]
fn a_second_signal_ends_the_gateway_once_the_stops_were_sent() {
    let mut plant = Plant::with(PATIENT);
    let seen = plant.run_over_mqtt();
    plant.silence_the_drive();
    plant.gateway.terminate();
    plant.wait_for_write(seen, (RUN, 0), PATIENCE);
    plant.gateway.terminate();
    assert_eq!(plant.gateway.end_within(PATIENCE).code(), Some(0));
    assert!(
        plant.gateway.text().contains("second signal"),
        "{}",
        plant.gateway.text()
    );
    assert!(
        !plant
            .gateway
            .text()
            .contains("a STOP had no effect; shutting down"),
        "it did not wait for that"
    );
}

#[test]
fn a_line_with_nothing_left_to_do_serves_stops_as_long_as_another_ends() {
    let mut plant = Plant::with(PATIENT);
    let (_drive, line) = second_line(&plant);
    let control = "[line.drive.control]\nfrom = [\"modbus-tcp\"]\nfrequency_hz = { min = 5.0, max = 50.0 }\n\
                   on_commander_lost = \"stop\"\nlost_after = \"60s\"\non_shutdown = \"stop\"\n\n";
    edit(&plant, "[[line]]\n", &format!("{line}{control}[[line]]\n"));
    edit(
        &plant,
        "name = \"pump-1\"\n",
        "name = \"pump-1\"\nunit = 1\n",
    );
    hang_up(&plant);
    let mut client = Raw::connect(plant.modbus);
    until("the second drive is known to stand", PATIENCE, || {
        (client.read_unit(102, 2, 1) == Ok(vec![1])).then_some(())
    });
    // Its line has restarted, so that a plain start would have to wait.
    plant.order("frequency/set", "30");
    plant.run_over_mqtt_behind_a_stop();
    let seen = plant.written().len();
    // The stop of the first drive shows no effect, so that its line waits for that.
    plant.silence_the_drive();
    plant.gateway.terminate();
    plant.wait_for_write(seen, (RUN, 0), PATIENCE);
    assert_eq!(
        client.write(102, 256, 0),
        Ok(()),
        "the drive answers to the stop"
    );
    assert_eq!(client.write(102, 256, 1), Err(6), "nothing else is taken");
    assert_eq!(plant.gateway.end_within(PATIENCE).code(), Some(0));
    assert!(
        plant
            .gateway
            .text()
            .contains("a STOP had no effect; shutting down"),
        "{}",
        plant.gateway.text()
    );
}

#[test]
fn the_service_manager_is_reported() {
    let plant = Plant::with(PATIENT);
    let socket = UnixDatagram::bind(plant.place.file("notify")).unwrap();
    socket.set_read_timeout(Some(PATIENCE)).unwrap();
    let heard = |what: &str| loop {
        let mut buffer = [0; 512];
        let length = socket
            .recv(&mut buffer)
            .unwrap_or_else(|error| panic!("{what}: {error}"));
        let text = String::from_utf8(buffer[..length].to_vec()).unwrap();
        if text.lines().any(|line| line == what) {
            return text;
        }
    };
    // Another gateway, whose port and broker are not there.
    std::fs::create_dir(plant.place.file("other")).unwrap();
    edit(&plant, "/data\"", "/other\"");
    edit(&plant, "/line\"", "/nowhere\"");
    edit(
        &plant,
        "broker = \"mqtt://127.0.0.1:",
        "client_id = \"other\"\nbroker = \"mqtt://127.0.0.2:",
    );
    edit(&plant, &plant.http.to_string(), "127.0.0.1:0");
    let mut command = program();
    command
        .env("NOTIFY_SOCKET", plant.place.file("notify"))
        .env("WATCHDOG_USEC", "400000");
    command.arg("run").arg("-c").arg(&plant.file);
    let mut gateway = Started::new(command);
    let ready = heard("READY=1");
    assert!(
        ready.contains("STATUS=0 of 1 lines up, 0 of 1 drives online"),
        "{ready}"
    );
    let address = gateway.wait_for("where it listens", |line| {
        let fields = fields(line)?;
        (fields["message"] == "Modbus TCP").then(|| fields["address"].as_str()?.parse().ok())?
    });
    assert_eq!(
        Raw::connect(address).read_unit(UNIFORM, 2, 1),
        Ok(vec![5]),
        "it serves without port and broker"
    );
    for _ in 0..4 {
        heard("WATCHDOG=1");
    }
    gateway.signal("HUP");
    let reloading = heard("RELOADING=1");
    let since = reloading
        .lines()
        .find_map(|line| line.strip_prefix("MONOTONIC_USEC="))
        .unwrap();
    assert!(since.parse::<u64>().unwrap() > 0);
    heard("READY=1");
    heard("WATCHDOG=1");
    gateway.terminate();
    heard("STOPPING=1");
    assert_eq!(gateway.end_within(Duration::from_secs(10)).code(), Some(0));
}
