//! A line whose thread hangs is noticed by whoever looks after the gateway, and the drive's own watchdog can be seen and
//! set with a tool.

use super::mosquitto::free_port;
use super::rig::{Place, fields, program, vfd_gateway};
use super::started::{PATIENCE, Started, until};
use super::yard::{Drive, FAMILIES, configuration};
use std::io::{ErrorKind, Read, Write};
use std::net::{SocketAddr, TcpStream};
use std::os::unix::net::UnixDatagram;
use std::process::Command;
use std::time::{Duration, Instant};

/// How long a call of the system on the port takes, once.
const HANGS_FOR: Duration = Duration::from_secs(5);
/// What the service manager grants.
const GRANTED: Duration = Duration::from_millis(800);

fn healthz(http: SocketAddr) -> Option<(u16, String)> {
    let mut stream = TcpStream::connect(http).ok()?;
    stream.set_read_timeout(Some(PATIENCE)).unwrap();
    stream
        .write_all(b"GET /healthz HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n")
        .ok()?;
    let mut answer = String::new();
    stream.read_to_string(&mut answer).ok()?;
    let (head, body) = answer.split_once("\r\n\r\n")?;
    Some((head.split(' ').nth(1)?.parse().ok()?, body.to_owned()))
}

#[test]
fn a_line_whose_thread_hangs_ends_the_heartbeats_until_it_goes_on() {
    let place = Place::new();
    let drive = Drive::new(&FAMILIES[0], &place);
    std::fs::create_dir(place.file("data")).unwrap();
    let address = || SocketAddr::from(([127, 0, 0, 1], free_port()));
    let http = address();
    let more = format!("[http]\nlisten = \"{http}\"\n");
    let file = place.write(
        "gateway.toml",
        &configuration(&place, [drive.family], address(), &more),
    );
    let manager = UnixDatagram::bind(place.file("notify")).unwrap();
    manager
        .set_read_timeout(Some(Duration::from_millis(50)))
        .unwrap();
    let run = program();
    let mut strace = Command::new("strace");
    // As a grandchild, so that the gateway is the process that is started here.
    strace
        .args(["-D", "-f", "-qq", "-o", "/dev/null", "-P"])
        .arg(std::fs::canonicalize(place.file("n700")).unwrap());
    strace.args([
        "-e",
        &format!("inject=write:delay_enter={}:when=20", HANGS_FOR.as_micros()),
    ]);
    strace
        .arg(run.get_program())
        .args(run.get_args())
        .arg("run")
        .arg("-c")
        .arg(&file);
    strace
        .env("RUST_LOG", "info")
        .env("NOTIFY_SOCKET", place.file("notify"));
    strace.env("WATCHDOG_USEC", GRANTED.as_micros().to_string());
    let gateway = Started::new(strace);
    let mut last_sign = Instant::now();
    // The longest time between two signs of life so far.
    let mut listen = {
        let mut longest = Duration::ZERO;
        move || {
            let mut buffer = [0; 512];
            match manager.recv(&mut buffer) {
                Ok(length)
                    if buffer[..length]
                        .windows(10)
                        .any(|word| word == b"WATCHDOG=1") =>
                {
                    longest = longest.max(last_sign.elapsed());
                    last_sign = Instant::now();
                }
                Ok(_) => {}
                Err(error) => assert!(
                    matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut),
                    "{error}"
                ),
            }
            longest
        }
    };
    let hangs = (503, "lines whose threads hang: n700\n".to_owned());
    until("it is alive, or hangs already", PATIENCE, || {
        listen();
        let told = healthz(http)?;
        (told == (200, "ok\n".to_owned()) || told == hangs).then_some(())
    });
    let socket = place.file("data/vfd-gateway.sock");
    let health_says = |why: &str| {
        let asked = vfd_gateway(&["health", "--alive", "--socket", socket.to_str().unwrap()]);
        asked.status.code() == Some(1) && String::from_utf8_lossy(&asked.stderr).contains(why)
    };
    until("the line is said to hang", PATIENCE, || {
        listen();
        (healthz(http)? == hangs && health_says("lines whose threads hang: n700")).then_some(())
    });
    until("it goes on", PATIENCE, || {
        listen();
        (healthz(http)?.0 == 200).then_some(())
    });
    until("there are signs of life again", PATIENCE, || {
        (listen() > GRANTED).then_some(())
    });
    assert!(
        gateway.text().contains("line thread hangs"),
        "{}",
        gateway.text()
    );
}

#[test]
fn the_drives_own_watchdog_is_shown_and_set() {
    let place = Place::new();
    let drive = Drive::new(
        FAMILIES
            .iter()
            .find(|family| family.name == "e510")
            .unwrap(),
        &place,
    );
    std::fs::create_dir(place.file("data")).unwrap();
    let modbus = SocketAddr::from(([127, 0, 0, 1], free_port()));
    let file = place.write(
        "gateway.toml",
        &configuration(&place, [drive.family], modbus, ""),
    );
    let mut run = program();
    run.arg("run").arg("-c").arg(&file);
    let gateway = Started::new(run);
    gateway.wait_for("that the drive is there", |line| {
        let fields = fields(line)?;
        (fields["message"] == "drive online").then_some(())
    });
    let socket = place.file("data/vfd-gateway.sock");
    let watchdog = |more: &[&str]| {
        let output = vfd_gateway(
            &[
                &["watchdog", "e510", "--socket", socket.to_str().unwrap()],
                more,
            ]
            .concat(),
        );
        let said = [&output.stdout[..], &output.stderr].concat();
        (output.status.code(), String::from_utf8(said).unwrap())
    };
    let (code, said) = watchdog(&[]);
    assert!(
        code == Some(1) && said.contains("its watchdog is off"),
        "{said}"
    );
    let (code, said) = watchdog(&["--set", "2500ms"]);
    assert!(
        code == Some(2) && said.contains("--yes"),
        "nobody was asked: {said}"
    );
    let (code, said) = watchdog(&["--set", "2500ms", "--yes"]);
    assert!(
        code == Some(0) && said.contains("-> 2.5 s") && said.contains("confirmed"),
        "{said}"
    );
    let (code, said) = watchdog(&[]);
    assert!(code == Some(0) && said.contains("2.5 s"), "{said}");
    let (code, said) = watchdog(&["--set", "off", "--yes"]);
    assert!(code == Some(0), "{said}");
    assert_eq!(watchdog(&[]).0, Some(1));
    assert_eq!(drive.runs(), 0);
}
