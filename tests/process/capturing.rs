//! What goes over a line is seen from outside: by whoever watches over the socket, and in a file that tshark decodes.

use super::raw::Raw;
use super::rig::{Place, fields, program, start, vfd_gateway};
use super::started::{PATIENCE, Started, until};
use std::collections::BTreeMap;
use std::io::{Read, Write};
use std::net::SocketAddr;
use std::os::unix::net::UnixStream;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use vfd_gateway::wire::crc;

/// Run command, frequency command, output frequency. Typed from the manual.
const RUN: u16 = 0x0002;
const FREQUENCY: u16 = 0x0004;
const OUTPUT: u16 = 0x0101;

/// A gateway with a simulated drive at station 1, and a socket.
struct Hall {
    gateway: Started,
    modbus: SocketAddr,
    _drive: Started,
    place: Place,
}

impl Hall {
    /// A drive that is simulated with `simulate`, polled every `poll`, on a line with the keys `line`.
    fn new(model: &str, simulate: &[&str], poll: &str, line: &str) -> Self {
        let place = Place::new();
        std::fs::create_dir(place.file("data")).unwrap();
        let port = place.file("line");
        let drive = start(
            &[
                &[
                    "simulate",
                    "--model",
                    model,
                    "--link",
                    port.to_str().unwrap(),
                ],
                simulate,
            ]
            .concat(),
        );
        drive.wait_for("that it plays", |line| {
            line.contains("station 1").then_some(())
        });
        let port = port.display().to_string();
        Self::before(place, drive, &port, (model, poll, line))
    }

    /// The N700 behind a Modbus TCP server.
    fn over_modbus_tcp() -> Self {
        let place = Place::new();
        std::fs::create_dir(place.file("data")).unwrap();
        let model = "hyundai-n700";
        let drive = start(&[
            "simulate",
            "--model",
            model,
            "--framing",
            "modbus-tcp",
            "--tcp",
            "127.0.0.1:0",
        ]);
        let port = drive.wait_for("where it listens", |line| {
            let (_, rest) = line.split_once(" on modbus-tcp://")?;
            Some(format!("modbus-tcp://{}", rest.split(',').next()?))
        });
        Self::before(place, drive, &port, (model, "200ms", ""))
    }

    /// A gateway before `drive` at `port`, with its model, its poll and the keys of its line.
    fn before(
        place: Place,
        drive: Started,
        port: &str,
        (model, poll, line): (&str, &str, &str),
    ) -> Self {
        let text = format!(
            "[gateway]\nname = \"plant\"\ndata_dir = \"{}\"\n\n[[modbus_tcp]]\nlisten = \"127.0.0.1:0\"\n\
             write = [\"127.0.0.1/32\"]\n\n[[line]]\nname = \"hall-1\"\nport = \"{}\"\n{line}\n\n\
             [[line.drive]]\nname = \"pump-1\"\nmodel = \"{model}\"\nstation = 1\npoll = \"{poll}\"\n\n\
             [line.drive.control]\nfrom = [\"modbus-tcp\"]\nfrequency_hz = {{ min = 5.0, max = 50.0 }}\n\
             directions = [\"forward\"]\non_commander_lost = \"stop\"\nlost_after = \"60s\"\non_shutdown = \"stop\"\n\
             accept_unverified = [\"basic\"]\n",
            place.file("data").display(),
            port
        );
        let file = place.write("gateway.toml", &text);
        let gateway = start(&["run", "-c", file.to_str().unwrap()]);
        let modbus = gateway.wait_for("where it listens", |line| {
            let fields = fields(line)?;
            (fields["message"] == "Modbus TCP").then(|| fields["address"].as_str()?.parse().ok())?
        });
        gateway.wait_for("that the drive is there", |line| {
            let fields = fields(line)?;
            (fields["message"] == "drive online").then_some(())
        });
        Self {
            gateway,
            modbus,
            _drive: drive,
            place,
        }
    }

    fn config(&self) -> String {
        self.place.file("gateway.toml").to_str().unwrap().to_owned()
    }

    fn out(&self) -> PathBuf {
        self.place.file("line.pcapng")
    }

    /// `capture` of this gateway into `out`, with `more`.
    fn capture(&self, out: &str, more: &[&str]) -> Started {
        start(&[&["capture", "-c", &self.config(), "--out", out], more].concat())
    }

    /// A capture that has begun.
    fn capturing(&self, more: &[&str]) -> Started {
        let out = self.out();
        let capture = self.capture(out.to_str().unwrap(), more);
        until("the capture has begun", PATIENCE, || {
            out.metadata().ok().filter(|it| it.len() > 0)
        });
        capture
    }

    /// Whether the file shows the run that [`command`](Self::command) orders.
    fn shows_the_write(&self) -> Option<()> {
        let written = b"written: 0x0002 run command = 0x0001 (forward)";
        let bytes = std::fs::read(self.out()).unwrap();
        bytes
            .windows(written.len())
            .any(|it| it == written)
            .then_some(())
    }

    /// Runs the drive and stops it. Whoever starts must have stopped first, and a stop takes a moment to be effective.
    fn command(&self) {
        let mut client = Raw::connect(self.modbus);
        for (address, word) in [(RUN, 0), (FREQUENCY, 3000), (RUN, 1), (RUN, 0)] {
            until("a write is taken", PATIENCE, || {
                client.write(1, address, word).ok()
            });
        }
    }
}

/// Ends a capture as Ctrl-C does, and returns how many frames it says it has written.
fn ended(mut capture: Started) -> u64 {
    capture.interrupt();
    assert!(capture.end_within(PATIENCE).success(), "{}", capture.text());
    said_frames(&summary(&capture))
}

/// What a capture says at its end.
fn summary(capture: &Started) -> String {
    capture.wait_for("what it has captured", |line| {
        line.contains(" s into ").then(|| line.to_owned())
    })
}

fn said_frames(said: &str) -> u64 {
    let line = said
        .lines()
        .find(|line| line.contains(" frames"))
        .unwrap_or_else(|| panic!("{said}"));
    line.split(' ')
        .next()
        .unwrap()
        .parse()
        .unwrap_or_else(|_| panic!("{said}"))
}

/// What tshark makes of a file: one row of fields for each packet.
const FIELDS: [&str; 9] = [
    "frame.protocols",
    "frame.comment",
    "modbus.func_code",
    "modbus.reference_num",
    "modbus.regnum16",
    "mbrtu.crc16.status",
    "frame.packet_flags_direction",
    "exported_pdu.exported_pdu",
    "_ws.malformed",
];

type Row = BTreeMap<&'static str, String>;

fn tshark(file: &Path, options: &[&str]) -> Output {
    let mut command = Command::new("tshark");
    command
        .args([
            "-r",
            file.to_str().unwrap(),
            "-o",
            "mbrtu.crc_verification:TRUE",
        ])
        .args(options);
    command
        .args(["-T", "fields", "-E", "separator=|"])
        .args(FIELDS.iter().flat_map(|field| ["-e", field]));
    command
        .output()
        .unwrap_or_else(|error| panic!("cannot start tshark: {error}; run tests/run"))
}

fn rows(file: &Path, options: &[&str]) -> Vec<Row> {
    let output = tshark(file, options);
    assert!(
        output.status.success(),
        "{}",
        String::from_utf8_lossy(&output.stderr)
    );
    let text = String::from_utf8(output.stdout).unwrap();
    text.lines()
        .map(|line| {
            FIELDS
                .into_iter()
                .zip(line.split('|').map(str::to_owned))
                .collect()
        })
        .collect()
}

/// Something that watches over the socket.
struct Watcher {
    stream: UnixStream,
    text: String,
}

impl Watcher {
    fn new(hall: &Hall, line: &str) -> Self {
        let mut stream = UnixStream::connect(hall.place.file("data/vfd-gateway.sock")).unwrap();
        stream.set_read_timeout(Some(PATIENCE)).unwrap();
        write!(
            stream,
            "GET /api/v1/lines/{line}/traffic HTTP/1.1\r\nHost: localhost\r\n\r\n"
        )
        .unwrap();
        Self {
            stream,
            text: String::new(),
        }
    }

    fn until(&mut self, wanted: &str) -> &str {
        let mut bytes = [0; 16 * 1024];
        while !self.text.contains(wanted) {
            let read = self
                .stream
                .read(&mut bytes)
                .unwrap_or_else(|error| panic!("{error}: {}", self.text));
            assert!(read > 0, "no {wanted} in {}", self.text);
            self.text += &String::from_utf8_lossy(&bytes[..read]);
        }
        &self.text
    }
}

#[test]
fn tshark_decodes_every_frame_with_its_function_and_register() {
    let hall = Hall::new("hyundai-n700", &[], "200ms", "");
    let capture = hall.capturing(&["--line", "hall-1"]);
    hall.command();
    // What goes over the line is told a moment later.
    until("the capture has what was written", PATIENCE, || {
        hall.shows_the_write()
    });
    let frames = ended(capture);
    let rows = rows(&hall.out(), &["-o", "mbrtu.tcp.port:502"]);
    assert!(
        frames >= 6 && rows.len() as u64 == frames,
        "{frames} frames, {} packets",
        rows.len()
    );
    let mut writes = Vec::new();
    for pair in rows.windows(2) {
        let [asked, replied] = pair else {
            panic!("two rows")
        };
        for row in [asked, replied] {
            assert_eq!(
                row["frame.protocols"], "exported_pdu:mbrtu:modbus",
                "{row:?}"
            );
            assert_eq!(
                (
                    row["mbrtu.crc16.status"].as_str(),
                    row["_ws.malformed"].as_str()
                ),
                ("1", ""),
                "{row:?}"
            );
        }
        if !asked["frame.comment"].starts_with("request to pump-1") {
            continue;
        }
        assert!(
            replied["frame.comment"].starts_with("reply of pump-1"),
            "{replied:?}"
        );
        assert_eq!(
            (
                asked["frame.packet_flags_direction"].as_str(),
                replied["frame.packet_flags_direction"].as_str()
            ),
            ("0x00000002", "0x00000001")
        );
        assert_eq!(asked["modbus.func_code"], replied["modbus.func_code"]);
        // The register that tshark sees is the one that our own words name.
        let register: u16 = asked["modbus.reference_num"].parse().unwrap();
        assert!(
            asked["frame.comment"].contains(&format!("0x{register:04X} ")),
            "{asked:?}"
        );
        match asked["modbus.func_code"].as_str() {
            "3" => assert!(
                replied["modbus.regnum16"]
                    .split(',')
                    .any(|it| it == register.to_string()),
                "{replied:?}"
            ),
            "6" => {
                assert_eq!(
                    replied["modbus.reference_num"],
                    asked["modbus.reference_num"]
                );
                writes.push((register, asked["frame.comment"].clone()));
            }
            other => panic!("function {other}"),
        }
    }
    let said = |register, words: &str| {
        assert!(
            writes
                .iter()
                .any(|(at, comment)| *at == register && comment.contains(words)),
            "{words}: {writes:?}"
        );
    };
    said(FREQUENCY, "frequency command = 30.00 Hz");
    said(RUN, "(forward)");
    said(RUN, "(stop): write 0x0002 run command = 0x0000 (stop)");
    // Without any setting reads are decoded in full, and writes as what they are.
    let plain = self::rows(&hall.out(), &[]);
    assert!(
        plain
            .iter()
            .all(|row| row["frame.protocols"] == "exported_pdu:mbrtu:modbus")
    );
    let reads = |rows: &[Row]| {
        rows.iter()
            .filter(|row| row["modbus.func_code"] == "3")
            .cloned()
            .collect::<Vec<_>>()
    };
    assert_eq!(reads(&plain), reads(&rows));
}

#[test]
fn noise_is_there_as_noise_and_nothing_is_hidden() {
    let hall = Hall::new("hyundai-n700", &["--faults", "noise=300,flip=30"], "5s", "");
    let capture = hall.capturing(&[]);
    let mut client = Raw::connect(hall.modbus);
    for _ in 0..60 {
        // Damaged twice in a row, a read ends with an exception.
        let _ = client.read(OUTPUT, 1);
    }
    let frames = ended(capture);
    let rows = rows(&hall.out(), &[]);
    assert_eq!(rows.len() as u64, frames);
    let (noise, sound): (Vec<_>, Vec<_>) = rows
        .iter()
        .partition(|row| row["frame.comment"].starts_with("noise: "));
    assert!(
        noise.len() > 5 && sound.len() > 60,
        "{} and {}",
        noise.len(),
        sound.len()
    );
    for row in noise {
        assert_eq!(
            (
                row["frame.protocols"].as_str(),
                row["modbus.func_code"].as_str()
            ),
            ("exported_pdu:data", "")
        );
    }
    for row in sound {
        assert_eq!(
            row["frame.protocols"], "exported_pdu:mbrtu:modbus",
            "{row:?}"
        );
        let bytes = &row["exported_pdu.exported_pdu"].replace(':', "");
        let bytes: Vec<u8> = (0..bytes.len())
            .step_by(2)
            .map(|at| u8::from_str_radix(&bytes[at..at + 2], 16).unwrap())
            .collect();
        assert!(crc::is_sound(&bytes), "{row:?}");
    }
}

#[test]
fn frames_of_an_ascii_line_are_text_with_our_words() {
    let hall = Hall::new(
        "teco-e510",
        &["--framing", "ascii"],
        "200ms",
        "framing = \"ascii\"",
    );
    let capture = hall.capturing(&["--frames", "8"]);
    let mut capture = capture;
    assert!(capture.end_within(PATIENCE).success());
    let rows = rows(&hall.out(), &[]);
    assert_eq!((rows.len(), said_frames(&summary(&capture))), (8, 8));
    for row in rows {
        assert_eq!(
            row["frame.protocols"], "exported_pdu:data-text-lines",
            "{row:?}"
        );
        assert!(
            row["exported_pdu.exported_pdu"].starts_with("3a"),
            "begins with a colon: {row:?}"
        );
        assert!(row["frame.comment"].contains("pump-1"), "{row:?}");
    }
}

#[test]
fn messages_of_a_modbus_tcp_line_are_decoded_by_tshark() {
    let hall = Hall::over_modbus_tcp();
    let capture = hall.capturing(&[]);
    hall.command();
    until("the file shows the write", PATIENCE, || {
        hall.shows_the_write()
    });
    let frames = ended(capture);
    let rows = rows(&hall.out(), &[]);
    assert_eq!(rows.len() as u64, frames);
    for row in &rows {
        assert_eq!(
            row["frame.protocols"], "exported_pdu:mbtcp:modbus",
            "{row:?}"
        );
        assert_eq!(row["_ws.malformed"], "", "{row:?}");
    }
    let wrote = rows
        .iter()
        .filter(|row| row["modbus.func_code"] == "6")
        .count();
    assert!(wrote >= 6, "three writes and their replies: {wrote}");
}

#[test]
fn a_pipe_into_another_program_is_fed_as_it_goes() {
    let hall = Hall::new("hyundai-n700", &[], "200ms", "");
    let mut capture = program()
        .args(["capture", "-c", &hall.config(), "--out", "-"])
        .stdin(Stdio::null())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    // It ends by itself after six packets, and the capture with it.
    let tshark = Command::new("tshark")
        .args([
            "-l",
            "-i",
            "-",
            "-c",
            "6",
            "-T",
            "fields",
            "-e",
            "frame.protocols",
        ])
        .stdin(capture.stdout.take().unwrap())
        .output()
        .unwrap_or_else(|error| panic!("cannot start tshark: {error}; run tests/run"));
    let text = String::from_utf8_lossy(&tshark.stdout).into_owned();
    assert_eq!(
        text,
        "exported_pdu:mbrtu:modbus\n".repeat(6),
        "{}",
        String::from_utf8_lossy(&tshark.stderr)
    );
    let mut said = String::new();
    capture
        .stderr
        .take()
        .unwrap()
        .read_to_string(&mut said)
        .unwrap();
    assert!(
        capture.wait().unwrap().success() && said_frames(&said) >= 6,
        "{said}"
    );
}

#[test]
fn a_gateway_that_goes_leaves_a_whole_file() {
    let hall = Hall::new("hyundai-n700", &[], "200ms", "");
    let mut capture = hall.capturing(&[]);
    let out = hall.out();
    let begun = out.metadata().unwrap().len();
    until("some frames are in the file", PATIENCE, || {
        (out.metadata().ok()?.len() > begun + 400).then_some(())
    });
    let Hall {
        mut gateway, place, ..
    } = hall;
    gateway.kill();
    assert_eq!(capture.end_within(PATIENCE).code(), Some(1));
    let said = capture.wait_for("what it has", |line| {
        line.contains("until then").then(|| line.to_owned())
    });
    assert!(
        said.contains("it closed the connection; ") && said.contains("frames until then are in"),
        "{said}"
    );
    let rows = rows(&place.file("line.pcapng"), &[]);
    assert_eq!(rows.len() as u64, said_frames(&summary(&capture)));
}

#[test]
fn a_change_of_the_line_is_followed() {
    let hall = Hall::new("hyundai-n700", &[], "200ms", "");
    let capture = hall.capturing(&[]);
    let text = std::fs::read_to_string(hall.config()).unwrap();
    std::fs::write(hall.config(), text.replace("200ms", "300ms")).unwrap();
    let reloaded = vfd_gateway(&["reload", "-c", &hall.config()]);
    assert!(
        reloaded.status.success(),
        "{}",
        String::from_utf8_lossy(&reloaded.stderr)
    );
    until("the drive is there again", PATIENCE, || {
        Raw::connect(hall.modbus).read(OUTPUT, 1).ok()
    });
    // The capture needs a moment to come back.
    until("the capture has what was written", PATIENCE, || {
        hall.command();
        hall.shows_the_write()
    });
    let frames = ended(capture);
    assert_eq!(rows(&hall.out(), &[]).len() as u64, frames);
}

#[test]
fn what_cannot_be_captured_is_said() {
    let hall = Hall::new("hyundai-n700", &[], "5s", "");
    let assert_fails = |args: &[&str], code: i32, words: &str| {
        let output = vfd_gateway(&[&["capture"], args].concat());
        let said = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(code), "{said}");
        assert!(said.contains(words), "{said}");
    };
    let (config, out) = (hall.config(), hall.out());
    let out = out.to_str().unwrap();
    assert_fails(
        &["-c", &config, "--out", out, "--line", "hall-2"],
        1,
        "no line is called hall-2; there is hall-1",
    );
    assert!(!hall.out().exists(), "nothing to write, no file");
    assert_fails(
        &["-c", &config, "--out", "/no/such/place.pcapng"],
        1,
        "/no/such/place.pcapng",
    );
    assert_fails(
        &["--socket", "/no/such.sock", "--out", out],
        1,
        "/no/such.sock",
    );
    assert_fails(
        &["-c", &config, "--out", out, "--seconds", "0"],
        2,
        "--seconds",
    );
    assert_fails(&["-c", &config], 2, "--out");
    let full = vfd_gateway(&[
        "capture",
        "-c",
        &config,
        "--out",
        "/dev/full",
        "--seconds",
        "9",
    ]);
    assert_eq!(
        full.status.code(),
        Some(1),
        "{}",
        String::from_utf8_lossy(&full.stderr)
    );
}

#[test]
fn a_line_has_four_places_and_each_sees_all() {
    let hall = Hall::new("hyundai-n700", &[], "5s", "");
    let mut watchers: Vec<_> = (0..4).map(|_| Watcher::new(&hall, "hall-1")).collect();
    for watcher in &mut watchers {
        watcher.until("event: begin");
    }
    let mut fifth = Watcher::new(&hall, "hall-1");
    assert!(fifth.until("already").starts_with("HTTP/1.1 503"));
    hall.command();
    for watcher in &mut watchers {
        let text = watcher.until("written: 0x0002 run command = 0x0000 (stop)");
        assert!(
            text.contains("write 0x0004 frequency command = 30.00 Hz")
                && !text.contains("event: lost")
        );
    }
    let capture = vfd_gateway(&[
        "capture",
        "-c",
        &hall.config(),
        "--out",
        hall.out().to_str().unwrap(),
    ]);
    assert_eq!(capture.status.code(), Some(1));
    drop(watchers);
    until("a place comes back", PATIENCE, || {
        Watcher::new(&hall, "hall-1")
            .until("\r\n")
            .starts_with("HTTP/1.1 200")
            .then_some(())
    });
}

#[test]
fn a_full_line_is_captured_whole_and_goes_on_as_before() {
    let hall = Hall::new("hyundai-n700", &["--unpaced"], "5s", "silence = \"0ms\"");
    let capture = hall.capturing(&[]);
    let mut client = Raw::connect(hall.modbus);
    let reads = 2_000;
    for _ in 0..reads {
        client.read(OUTPUT, 1).unwrap();
    }
    hall.command();
    until("the capture has what was written", PATIENCE, || {
        hall.shows_the_write()
    });
    capture.interrupt();
    let mut capture = capture;
    assert!(capture.end_within(PATIENCE).success(), "{}", capture.text());
    let said = summary(&capture);
    let lost = said
        .split(' ')
        .collect::<Vec<_>>()
        .windows(2)
        .find(|pair| pair[1] == "lost")
        .map_or(0, |pair| pair[0].parse().unwrap());
    let rows = rows(&hall.out(), &[]);
    assert_eq!(rows.len() as u64, said_frames(&said));
    let count = |words: &str| {
        rows.iter()
            .filter(|row| row["frame.comment"].starts_with(words))
            .count() as u64
    };
    let (asked, replied) = (
        count("request to pump-1 (client)"),
        count("reply of pump-1"),
    );
    assert!(
        asked + lost >= reads && replied + lost >= reads,
        "{asked} requests, {replied} replies, {lost} lost"
    );
}
