//! `doctor` on lines with one thing wrong each: it names the right cause.

use super::rig::{Place, start, vfd_gateway};
use super::started::{PATIENCE, Started, until};
use serde_json::Value;
use std::io::{Read, Write};
use std::net::{SocketAddr, TcpListener};
use std::os::unix::net::UnixStream;
use std::path::PathBuf;
use std::sync::atomic::{AtomicU32, Ordering};

/// Looks of five seconds before a cause must have been named.
const LOOKS: usize = 6;

/// A gateway whose doctor is asked; what is dropped first ends first.
struct Patient {
    _gateway: Started,
    _drive: Option<Started>,
    file: PathBuf,
    place: Place,
}

impl Patient {
    /// A drive whose replies suffer `faults`, and a gateway with `more` keys of its line.
    fn with(faults: &str, more: &str) -> Self {
        let place = Place::new();
        let port = place.file("line");
        let link = port.to_str().unwrap();
        let drive = [
            "simulate",
            "--model",
            "hyundai-n700",
            "--baud",
            "38400",
            "--link",
            link,
            "--faults",
            faults,
        ];
        let drive = start(&drive);
        drive.wait_for("that it plays", |line| {
            line.contains("station 1").then_some(())
        });
        Self::on(place, link, Some(drive), more)
    }

    /// A gateway on a network port where `answer` makes replies of requests.
    fn over_tcp(answer: fn(&[u8]) -> Vec<u8>) -> Self {
        Self::on(
            Place::new(),
            &format!("tcp://{}", answering(answer)),
            None,
            "",
        )
    }

    fn on(place: Place, port: &str, drive: Option<Started>, more: &str) -> Self {
        std::fs::create_dir(place.file("data")).unwrap();
        let text = format!(
            "[gateway]\ndata_dir = \"{}\"\n\n[[line]]\nname = \"hall-1\"\nport = \"{port}\"\nbaud = 38400\n{more}\n\n\
             [[line.drive]]\nname = \"pump-1\"\nmodel = \"hyundai-n700\"\nstation = 1\npoll = \"100ms\"\n",
            place.file("data").display()
        );
        let file = place.write("gateway.toml", &text);
        let gateway = start(&["run", "-c", file.to_str().unwrap()]);
        let socket = place.file("data/vfd-gateway.sock");
        // The file is there a moment before anybody may connect.
        until("the gateway is reached", PATIENCE, || {
            UnixStream::connect(&socket).ok()
        });
        Self {
            _gateway: gateway,
            _drive: drive,
            file,
            place,
        }
    }

    /// The exit code and the report after so many seconds.
    fn report(&self, seconds: &str) -> (Option<i32>, Value) {
        let data = self.place.file("data");
        let args = [
            "doctor",
            "--data-dir",
            data.to_str().unwrap(),
            "--line",
            "hall-1",
            "--seconds",
            seconds,
            "--json",
        ];
        let output = vfd_gateway(&args);
        let text = String::from_utf8_lossy(&output.stdout);
        let reports: Value = serde_json::from_str(&text)
            .unwrap_or_else(|error| panic!("{error}: {text} {output:?}"));
        (output.status.code(), reports["lines"][0].clone())
    }
}

/// A serial device server whose line answers each request with what `answer` makes of it. It ends with the test program.
pub fn answering(answer: fn(&[u8]) -> Vec<u8>) -> SocketAddr {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = listener.local_addr().unwrap();
    std::thread::spawn(move || {
        for mut stream in listener.incoming().map_while(Result::ok) {
            let mut request = [0; 256];
            while let Ok(length @ 1..) = stream.read(&mut request) {
                if stream.write_all(&answer(&request[..length])).is_err() {
                    break;
                }
            }
        }
    });
    address
}

/// The texts of the findings with this sign.
fn texts<'a>(report: &'a Value, sign: &str) -> Vec<&'a str> {
    let findings = report["verdict"].as_array().into_iter().flatten();
    findings
        .filter(|finding| finding["sign"] == sign)
        .filter_map(|finding| finding["text"].as_str())
        .collect()
}

/// The doctor names this cause. What is rare may take more than one look.
#[track_caller]
fn assert_finds(patient: &Patient, sign: &str, part: &str) {
    let mut reports = Vec::new();
    for _ in 0..LOOKS {
        let (code, report) = patient.report("5");
        if texts(&report, sign).iter().any(|text| text.contains(part)) {
            assert_eq!(code, Some(1), "{report:#}");
            return;
        }
        reports.push(report);
    }
    panic!("no {sign} with {part}: {reports:#?}");
}

#[test]
fn a_good_line_is_good() {
    let patient = Patient::with("", "");
    let (code, report) = patient.report("4");
    assert_eq!(
        (code, texts(&report, "good").len()),
        (Some(0), 1),
        "{report:#}"
    );
    assert!(
        report["rates"]["exchanges"].as_u64().unwrap() > 20,
        "{report:#}"
    );
    assert_eq!(report["rates"]["good_per_mille"], 1000.0);
    let (drive, reads) = (&report["drives"][0], &report["drives"][0]["replies"][0]);
    assert_eq!(
        (&drive["name"], &drive["station"]),
        (&"pump-1".into(), &1.into())
    );
    assert_eq!(
        (&reads["class"], &report["link"]),
        (&"read".into(), &"38400 8N1".into())
    );
    assert!(
        reads["p50_ms"].as_f64().unwrap() >= 2.0,
        "the drive takes 2 ms: {reads}"
    );
    // For people, and for the configuration that names the data directory.
    let output = vfd_gateway(&[
        "doctor",
        "-c",
        patient.file.to_str().unwrap(),
        "--seconds",
        "1",
    ]);
    let text = String::from_utf8_lossy(&output.stdout);
    for part in ["line hall-1 (38400 8N1 on ", "pump-1  online", "suggested"] {
        assert!(text.contains(part), "no {part} in {text}");
    }
}

#[test]
fn wrong_questions_are_distinguished_from_bad_lines() {
    let patient = Patient::with("", "");
    let file = patient.file.to_str().unwrap();
    let output = vfd_gateway(&["doctor", "-c", file, "--line", "attic"]);
    assert_eq!(output.status.code(), Some(2));
    assert!(
        String::from_utf8_lossy(&output.stderr).contains("the lines are: hall-1"),
        "{output:?}"
    );
    assert_eq!(
        vfd_gateway(&["doctor", "-c", file, "--seconds", "0"])
            .status
            .code(),
        Some(2)
    );
    let nowhere = patient.place.file("nowhere");
    let output = vfd_gateway(&["doctor", "--data-dir", nowhere.to_str().unwrap()]);
    assert_eq!(output.status.code(), Some(1));
    assert!(
        String::from_utf8_lossy(&output.stderr).contains("cannot connect"),
        "{output:?}"
    );
}

#[test]
fn bytes_in_front_of_replies_are_a_floating_line() {
    assert_finds(
        &Patient::with("noise=200", ""),
        "floating",
        "bias resistors",
    );
}

#[test]
fn replies_without_their_end_are_cut() {
    assert_finds(&Patient::with("cut=250", ""), "cut", "latency timer");
}

#[test]
fn wrong_bits_anywhere_are_damage() {
    assert_finds(&Patient::with("flip=200", ""), "damaged", "termination");
}

#[test]
fn replies_behind_the_time_out_are_late() {
    let slow = Patient::with(
        "late=150,timeout-ms=150,lateness-ms=200",
        "reply_timeout = \"100ms\"",
    );
    assert_finds(&slow, "late", "reply_timeout");
}

#[test]
fn two_replies_to_one_request_are_a_number_given_twice() {
    let patient = Patient::with("foreign=300", "");
    assert_finds(
        &patient,
        "suspicion",
        "two drives probably have this number",
    );
    assert_finds(&patient, "stranger", "not configured here");
}

#[test]
fn requests_without_an_answer_are_silence() {
    assert_finds(&Patient::with("lost=150", ""), "silent", "got no answer");
}

#[test]
fn too_few_and_too_many_bytes_are_another_speed() {
    assert_finds(
        &Patient::over_tcp(|_| vec![0xF0, 0x3C]),
        "suspicion",
        "higher speed",
    );
    assert_finds(
        &Patient::over_tcp(|_| vec![0xFE; 40]),
        "suspicion",
        "lower speed",
    );
}

#[test]
fn what_is_sent_and_comes_back_is_an_echo() {
    assert_finds(
        &Patient::over_tcp(<[u8]>::to_vec),
        "suspicion",
        "echoes what is sent",
    );
}

#[test]
fn nothing_at_all_is_wiring() {
    assert_finds(
        &Patient::over_tcp(|_| Vec::new()),
        "suspicion",
        "nothing received from any drive",
    );
}

#[test]
fn first_characters_that_are_missing_are_the_direction_of_the_adapter() {
    // Every fifth reply loses its first character.
    static COUNT: AtomicU32 = AtomicU32::new(0);
    let answer = |request: &[u8]| {
        let reply = words_of_zero(request);
        reply[usize::from(COUNT.fetch_add(1, Ordering::Relaxed).is_multiple_of(5))..].to_vec()
    };
    assert_finds(
        &Patient::over_tcp(answer),
        "first_characters",
        "switches direction",
    );
}

/// The reply to a read: all words are 0.
pub fn words_of_zero(request: &[u8]) -> Vec<u8> {
    let [station, function, _, _, _, count, ..] = *request else {
        return Vec::new();
    };
    let mut reply = vec![station, function, count * 2];
    reply.resize(3 + usize::from(count) * 2, 0);
    let check = crc16(&reply);
    reply.extend(check.to_le_bytes());
    reply
}

/// As the standard defines it, bit by bit.
fn crc16(bytes: &[u8]) -> u16 {
    bytes.iter().fold(0xFFFF, |crc, byte| {
        (0..8).fold(crc ^ u16::from(*byte), |crc, _| {
            if crc & 1 == 1 {
                crc >> 1 ^ 0xA001
            } else {
                crc >> 1
            }
        })
    })
}
