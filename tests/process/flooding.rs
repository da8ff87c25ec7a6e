//! A line whose peer sends without an end, beside another one, on one processor: the other one is served.

use super::mosquitto::free_port;
use super::plant::{OUTPUT, get};
use super::raw::Raw;
use super::rig::{Place, fields, program, start};
use super::started::{PATIENCE, Started, until};
use std::io::Write;
use std::net::{SocketAddr, TcpListener};
use std::process::Command;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

const UNIFORM: u8 = 102;
/// Starts and stops that are measured.
const TIMES: usize = 5;

/// A device server that sends without an end from the first connection on. Returns its port, and what it has got rid of.
fn flooding() -> (u16, Arc<AtomicU64>) {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let (port, sent) = (
        listener.local_addr().unwrap().port(),
        Arc::<AtomicU64>::default(),
    );
    let count = Arc::clone(&sent);
    std::thread::spawn(move || {
        for stream in listener.incoming() {
            let count = Arc::clone(&count);
            std::thread::spawn(move || {
                let mut stream = stream.unwrap();
                while let Ok(bytes) = stream.write(&[0x55; 64 * 1024]) {
                    count.fetch_add(bytes as u64, Ordering::Relaxed);
                }
            });
        }
    });
    (port, sent)
}

fn configuration(place: &Place, port: u16, http: SocketAddr) -> String {
    let link = place.file("line");
    format!(
        "[gateway]\nname = \"plant\"\n[[line]]\nname = \"loud\"\nport = \"tcp://127.0.0.1:{port}\"\nbaud = 38400\n\
         [[line.drive]]\nname = \"pump-1\"\nmodel = \"hyundai-n700\"\nstation = 1\nunit = 1\n\
         [[line]]\nname = \"calm\"\nport = \"{}\"\nbaud = 38400\nreply_timeout = \"500ms\"\n\
         [[line.drive]]\nname = \"pump-2\"\nmodel = \"hyundai-n700\"\nstation = 1\nunit = 2\npoll = \"100ms\"\n\
         [line.drive.control]\nfrom = [\"modbus-tcp\"]\nfrequency_hz = {{ min = 5.0, max = 50.0 }}\n\
         on_commander_lost = \"stop\"\nlost_after = \"1min\"\non_shutdown = \"stop\"\n\
         [[modbus_tcp]]\nlisten = \"127.0.0.1:0\"\nwrite = [\"127.0.0.1/32\"]\n[http]\nlisten = \"{http}\"\n",
        link.display()
    )
}

/// How the system runs the thread of `line`: its policy, 0 for ordinary ones.
fn policy_of(gateway: &Started, line: &str) -> u32 {
    let tasks = std::fs::read_dir(format!("/proc/{}/task", gateway.id()))
        .unwrap()
        .map(|task| task.unwrap().path());
    let is_it = |task: &std::path::PathBuf| {
        std::fs::read_to_string(task.join("comm"))
            .is_ok_and(|name| name.trim() == format!("line {line}"))
    };
    let task = tasks.into_iter().find(is_it).unwrap();
    let stat = std::fs::read_to_string(task.join("stat")).unwrap();
    // Behind the name, which ends with the last bracket, comes the third field; the policy is the forty-first.
    let (_, rest) = stat.rsplit_once(") ").unwrap();
    rest.split(' ').nth(41 - 3).unwrap().parse().unwrap()
}

#[test]
fn a_peer_that_floods_its_line_keeps_no_stop_of_another_line_waiting_on_one_processor() {
    let place = Place::new();
    let link = place.file("line");
    let drive = start(&[
        "simulate",
        "--model",
        "hyundai-n700",
        "--baud",
        "38400",
        "--link",
        link.to_str().unwrap(),
    ]);
    drive.wait_for("that it plays", |line| {
        line.contains("station 1").then_some(())
    });
    let (port, sent) = flooding();
    let http = SocketAddr::from(([127, 0, 0, 1], free_port()));
    let file = place.write("gateway.toml", &configuration(&place, port, http));
    let run = program();
    let mut taskset = Command::new("taskset");
    taskset
        .args(["-c", "0"])
        .arg(run.get_program())
        .args(run.get_args())
        .arg("run")
        .arg("-c")
        .arg(&file);
    taskset.env("RUST_LOG", "info");
    let gateway = Started::new(taskset);
    let modbus: SocketAddr = gateway.wait_for("where it listens", |line| {
        let fields = fields(line)?;
        (fields["message"] == "Modbus TCP").then(|| fields["address"].as_str()?.parse().ok())?
    });
    until("the other drive is read", PATIENCE * 2, || {
        Raw::connect(modbus).read_unit(2, OUTPUT, 1).ok()
    });
    until("the flood is on", PATIENCE, || {
        (sent.load(Ordering::Relaxed) > 1024 * 1024).then_some(())
    });
    // Where the system grants no rights at all, none can be withheld.
    println!(
        "policies: {} of the serial line, {} of tcp://",
        policy_of(&gateway, "calm"),
        policy_of(&gateway, "loud")
    );
    assert_eq!(
        policy_of(&gateway, "loud"),
        0,
        "real-time rights are for lines whose silence is kept here"
    );

    let mut client = Raw::connect(modbus);
    let mut slowest = Duration::ZERO;
    for _ in 0..TIMES {
        for (register, word) in [(256, 0), (257, 3000), (256, 1)] {
            until("the order is taken", PATIENCE, || {
                client.write(UNIFORM, register, word).ok()
            });
        }
        until("the motor turns", PATIENCE, || {
            (client.read_unit(2, OUTPUT, 1).ok()?[0] > 200).then_some(())
        });
        let flooded = sent.load(Ordering::Relaxed);
        let begun = Instant::now();
        assert_eq!(
            client.write(UNIFORM, 256, 0),
            Ok(()),
            "a stop is answered while the flood goes on"
        );
        slowest = slowest.max(begun.elapsed());
        until("the motor stands", PATIENCE, || {
            (client.read_unit(2, OUTPUT, 1).ok()?[0] == 0).then_some(())
        });
        until("the flood goes on", PATIENCE, || {
            (sent.load(Ordering::Relaxed) > flooded).then_some(())
        });
    }
    println!("the slowest of {TIMES} stops was answered after {slowest:?}");
    let (status, _) = until("the page answers", PATIENCE, || get(http, "/healthz"));
    assert_eq!(status, 200);
}
