//! Forty mistakes that people make, and the first thing that each makes them see: `docs/mistakes.md` is what this test finds.

use super::doctoring::{answering, words_of_zero};
use super::encrypted::{CERTIFICATE, Guarded, TRUSTED, USER};
use super::mosquitto::free_port;
use super::plant::get;
use super::rig::{Place, fields, simulate, start, vfd_gateway};
use super::started::{PATIENCE, Started, until};
use serde_json::Value;
use std::net::{Ipv4Addr, SocketAddr, TcpListener};
use std::path::Path;

/// A configuration with nothing wrong in it. `PLACE` is a directory of the test's own.
const SOUND: &str = r#"[gateway]
name = "plant-a"
data_dir = "PLACE/data"

[[line]]
name = "hall-1"
port = "PLACE/line"
baud = 9600

[[line.drive]]
name = "pump-1"
model = "hyundai-n700"
station = 1

[line.drive.control]
from = ["modbus-tcp"]
frequency_hz = { min = 5.0, max = 50.0 }
on_commander_lost = "stop"
lost_after = "10s"
on_shutdown = "stop"

[[modbus_tcp]]
listen = "127.0.0.1:0"
write = ["127.0.0.1/32"]

[http]
listen = "127.0.0.1:0"
"#;

/// Mistakes in the file: in words, what stands there, and what should.
const IN_THE_FILE: [(&str, &str, &str); 26] = [
    (
        "a quotation mark is missing",
        "name = \"pump-1\"",
        "name = \"pump-1",
    ),
    ("a key is misspelt", "baud = 9600", "buad = 9600"),
    ("a model is misspelt", "\"hyundai-n700\"", "\"hyundai-n70\""),
    (
        "a model that is not known",
        "\"hyundai-n700\"",
        "\"acme-9000\"",
    ),
    (
        "a station that the drive cannot have",
        "station = 1",
        "station = 33",
    ),
    (
        "two drives with one station",
        "[line.drive.control]",
        "[[line.drive]]\nname = \"pump-2\"\nmodel = \"hyundai-n700\"\nstation = 1\n[line.drive.control]",
    ),
    (
        "two drives with one name",
        "[line.drive.control]",
        "[[line.drive]]\nname = \"pump-1\"\nmodel = \"hyundai-n700\"\nstation = 2\n[line.drive.control]",
    ),
    (
        "a speed that the drive does not have",
        "baud = 9600",
        "baud = 115200",
    ),
    (
        "a parity that does not exist",
        "baud = 9600",
        "parity = \"mark\"",
    ),
    (
        "a port without its directory",
        "\"PLACE/line\"",
        "\"ttyUSB0\"",
    ),
    ("a name with a blank", "\"pump-1\"", "\"pump 1\""),
    (
        "what happens when the client is lost is not said",
        "on_commander_lost = \"stop\"\n",
        "",
    ),
    (
        "a word that does not exist for it",
        "on_commander_lost = \"stop\"",
        "on_commander_lost = \"halt\"",
    ),
    (
        "no limits for the frequency",
        "frequency_hz = { min = 5.0, max = 50.0 }\n",
        "",
    ),
    (
        "limits the wrong way round",
        "min = 5.0, max = 50.0",
        "min = 50.0, max = 5.0",
    ),
    ("a time without its unit", "\"10s\"", "10"),
    (
        "a drive whose stop is not proven",
        "\"hyundai-n700\"",
        "\"teco-e510\"",
    ),
    (
        "commands from a broker that is not there",
        "from = [\"modbus-tcp\"]",
        "from = [\"mqtt\"]",
    ),
    (
        "commands from the page, and no user",
        "from = [\"modbus-tcp\"]",
        "from = [\"page\"]",
    ),
    (
        "everybody may connect, unsaid",
        "\"127.0.0.1:0\"\nwrite",
        "\"0.0.0.0:1502\"\nwrite",
    ),
    (
        "the page for everybody, unsaid",
        "[http]\nlisten = \"127.0.0.1:0\"",
        "[http]\nlisten = \"0.0.0.0:8080\"",
    ),
    (
        "a password in the file",
        "[http]",
        "[mqtt]\nbroker = \"mqtts://broker\"\nuser = \"vfd\"\npassword = \"secret\"\n[http]",
    ),
    (
        "a password in plain view",
        "[http]",
        "[mqtt]\nbroker = \"mqtt://broker\"\nuser = \"vfd\"\npassword_file = \"/run/secrets/mqtt\"\n[http]",
    ),
    (
        "a broker without its scheme",
        "[http]",
        "[mqtt]\nbroker = \"broker:1883\"\n[http]",
    ),
    (
        "a data directory that is not absolute",
        "\"PLACE/data\"",
        "\"data\"",
    ),
    (
        "a poll that is far too quick",
        "station = 1",
        "station = 1\npoll = \"1ms\"",
    ),
];

/// A mistake, and what is seen of it first.
struct Row {
    mistake: &'static str,
    run: String,
    /// `None` where the gateway does not start.
    health: Option<String>,
    page: Option<String>,
}

impl Row {
    fn shown(&self) -> String {
        let cell = |text: &Option<String>| {
            text.as_deref()
                .map_or("-".to_owned(), |it| it.replace('|', "\\|"))
        };
        let run = self.run.replace('|', "\\|");
        format!(
            "| {} | {run} | {} | {} |\n",
            self.mistake,
            cell(&self.health),
            cell(&self.page)
        )
    }
}

/// What a gateway that does not start says first.
fn refused(mistake: &'static str, place: &Place, file: &Path) -> Row {
    let mut gateway = start(&["run", "-c", file.to_str().unwrap()]);
    let status = gateway.end_within(PATIENCE);
    until("all of it is read", PATIENCE, || {
        gateway.is_silent().then_some(())
    });
    assert!(
        matches!(status.code(), Some(1 | 2)),
        "{mistake}: {}",
        gateway.text()
    );
    Row {
        mistake,
        run: first_of(&gateway.text(), place),
        health: None,
        page: None,
    }
}

/// The first line, with where it is and what would be right, as far as these follow.
fn first_of(said: &str, place: &Place) -> String {
    let said = said.replace(place.file("").to_str().unwrap(), "/");
    let mut lines = said.lines().filter(|line| !line.starts_with('{'));
    let first = lines
        .next()
        .unwrap_or_default()
        .trim_start_matches("vfd-gateway: ")
        .to_owned();
    let lines: Vec<_> = lines.collect();
    let at = lines
        .iter()
        .find_map(|line| line.trim_start().strip_prefix("--> "));
    let help = lines.iter().find_map(|line| {
        line.trim_start()
            .trim_start_matches("= ")
            .strip_prefix("help: ")
    });
    let parts = [
        Some(first),
        at.map(|at| format!("at {at}")),
        help.map(|help| format!("help: {help}")),
    ];
    parts.into_iter().flatten().collect::<Vec<_>>().join("; ")
}

fn in_the_file() -> Vec<Row> {
    let rows = IN_THE_FILE.iter().map(|(mistake, right, wrong)| {
        assert!(SOUND.contains(right), "{mistake}: {right}");
        let place = Place::new();
        let text = SOUND.replacen(right, wrong, 1).replace(
            "PLACE",
            place.file("").to_str().unwrap().trim_end_matches('/'),
        );
        refused(mistake, &place, &place.write("plant.toml", &text))
    });
    rows.collect()
}

/// A gateway that runs beside a mistake.
struct Running {
    gateway: Started,
    http: SocketAddr,
    place: Place,
}

impl Running {
    fn start(place: Place, text: &str) -> Self {
        let text = text.replace(
            "PLACE",
            place.file("").to_str().unwrap().trim_end_matches('/'),
        );
        let http = SocketAddr::from((Ipv4Addr::LOCALHOST, free_port()));
        let text = text.replace(
            "[http]\nlisten = \"127.0.0.1:0\"",
            &format!("[http]\nlisten = \"{http}\""),
        );
        let file = place.write("plant.toml", &text);
        let gateway = start(&["run", "-c", file.to_str().unwrap()]);
        gateway.wait_for("that it runs", |line| {
            (fields(line)?["message"] == "running").then_some(())
        });
        Self {
            gateway,
            http,
            place,
        }
    }

    /// What is seen of the mistake where `part` stands.
    fn row(&self, mistake: &'static str, part: &str) -> Row {
        let plain =
            |text: &str| without_ports(&text.replace(self.place.file("").to_str().unwrap(), "/"));
        let run = self.gateway.wait_for(part, |line| {
            let fields = fields(line)?;
            let words: Vec<_> = ["message", "error", "reason"]
                .iter()
                .filter_map(|key| fields[*key].as_str())
                .collect();
            let words = words.join(": ");
            words.contains(part).then_some(words)
        });
        let health = until(&format!("health tells of {part}"), PATIENCE, || {
            let output = vfd_gateway(&["health", "--url", &format!("http://{}", self.http)]);
            let said = String::from_utf8_lossy(&output.stdout).into_owned();
            said.lines()
                .find(|line| line.contains(part))
                .map(str::to_owned)
        });
        let page = until(&format!("the page tells of {part}"), PATIENCE, || {
            let (_, body) = get(self.http, "/api/v1/advice")?;
            let advice: Value = serde_json::from_str(&body).ok()?;
            let texts = advice["advice"]
                .as_array()?
                .iter()
                .filter_map(|it| it["text"].as_str());
            texts
                .filter(|text| text.contains(part))
                .map(str::to_owned)
                .next()
        });
        Row {
            mistake,
            run: plain(&run),
            health: Some(plain(&health)),
            page: Some(plain(&page)),
        }
    }
}

/// Mistakes that only show when the gateway starts, and keep it from starting.
fn at_the_start() -> Vec<Row> {
    let place = Place::new();
    let here = place
        .file("")
        .to_str()
        .unwrap()
        .trim_end_matches('/')
        .to_owned();
    let sound = SOUND.replace("PLACE", &here);
    let written = |text: &str| place.write("plant.toml", text);
    let taken = TcpListener::bind("127.0.0.1:0").unwrap();
    let taken = taken.local_addr().unwrap();
    let with_port = |text: &str| text.replace(&taken.port().to_string(), "PORT");
    let tls = |section: &str| {
        format!("{section}\ncert_file = \"{here}/page.pem\"\nkey_file = \"{here}/page.key\"\n")
    };
    let user = "[[http.users]]\nname = \"anna\"\npassword_hash_file = \"/nonexistent/hash\"\n";
    let mqtt = "[mqtt]\nbroker = \"mqtts://broker\"\nuser = \"vfd\"\npassword_file = \"/nonexistent/password\"\n";
    let broken = place.write("broken.pem", "no certificate\n");
    let mut rows = vec![
        refused(
            "the file is not there",
            &place,
            Path::new("/etc/vfd-gateway/plant.toml"),
        ),
        refused("the file is a directory", &place, &place.file("")),
    ];
    for (mistake, text) in [
        (
            "the port for Modbus TCP is taken",
            sound.replacen("127.0.0.1:0", &taken.to_string(), 1),
        ),
        (
            "the port of the page is taken",
            sound.replace(
                "[http]\nlisten = \"127.0.0.1:0\"",
                &format!("[http]\nlisten = \"{taken}\""),
            ),
        ),
        (
            "an address that this host does not have",
            sound.replacen(
                "\"127.0.0.1:0\"",
                "\"192.0.2.7:1502\"\nallow = [\"192.0.2.0/24\", \"127.0.0.0/8\"]",
                1,
            ),
        ),
        (
            "the certificate of the page is not there",
            sound.clone() + &tls("[http.tls]"),
        ),
        (
            "the certificate of the page is none",
            sound.clone()
                + &tls("[http.tls]").replace(&format!("{here}/page.pem"), broken.to_str().unwrap()),
        ),
        (
            "the file with a user's hash is not there",
            sound.clone() + user,
        ),
        (
            "the file with the broker's password is not there",
            sound.clone() + mqtt,
        ),
    ] {
        let row = refused(mistake, &place, &written(&text));
        rows.push(Row {
            run: with_port(&row.run),
            ..row
        });
    }
    let _first = Running::start(Place::new(), &sound);
    rows.push(refused(
        "a second gateway on one data directory",
        &place,
        &written(&sound),
    ));
    rows
}

/// Mistakes at the port and on the line.
fn on_the_line() -> Vec<Row> {
    let mut rows = Vec::new();
    let mut seen = |mistake: &'static str, port: &str, part: &str| {
        let place = Place::new();
        let running = Running::start(place, &SOUND.replace("PLACE/line", port));
        rows.push(running.row(mistake, part));
    };
    seen("no such device", "/dev/ttyUSB77", "there is no such device");
    seen(
        "a device that is no serial port",
        "/dev/null",
        "not a serial device",
    );
    let nobody = format!("tcp://127.0.0.1:{}", free_port());
    seen(
        "the serial device server is off",
        &nobody,
        "Connection refused",
    );
    let at = |answer: fn(&[u8]) -> Vec<u8>| format!("tcp://{}", answering(answer));
    seen(
        "no power, or A and B swapped",
        &at(|_| Vec::new()),
        "nothing received from any drive",
    );
    seen(
        "the drives are set to a higher speed",
        &at(|_| vec![0xF0, 0x3C]),
        "higher speed",
    );
    seen(
        "the drives are set to a lower speed",
        &at(|_| vec![0xFE; 40]),
        "lower speed",
    );
    seen("another parity", &at(damaged), "check parity");
    seen(
        "an adapter that echoes",
        &at(<[u8]>::to_vec),
        "echoes what is sent",
    );
    let place = Place::new();
    let _drive = simulate(&place.file("line"));
    let port = place.file("line");
    let first = Running::start(place, SOUND);
    first.gateway.wait_for("that the drive is there", |line| {
        line.contains("drive online").then_some(())
    });
    seen(
        "two gateways on one port",
        port.to_str().unwrap(),
        "in use by line hall-1 of the vfd-gateway",
    );
    rows
}

/// A reply of the right length whose check is wrong.
fn damaged(request: &[u8]) -> Vec<u8> {
    let mut reply = words_of_zero(request);
    if let Some(last) = reply.last_mut() {
        *last ^= 0x55;
    }
    reply
}

/// Mistakes on the way to the broker.
fn at_the_broker() -> Vec<Row> {
    let guarded = Guarded::new();
    let files = guarded
        .place
        .file("")
        .to_str()
        .unwrap()
        .trim_end_matches('/')
        .to_owned();
    let trusted = [TRUSTED, CERTIFICATE, USER].concat();
    let cases = [
        (
            "the broker is off",
            format!("mqtt://127.0.0.1:{}", free_port()),
            String::new(),
            "Connection refused",
        ),
        (
            "a wrong password",
            format!("mqtts://localhost:{}", guarded.ports[0]),
            trusted.replace("/password", "/wrong-password"),
            "user or password",
        ),
        (
            "the broker's certificate is for another name",
            format!("mqtts://localhost:{}", guarded.ports[1]),
            trusted.clone(),
            "another name",
        ),
        (
            "the broker's certificate has expired",
            format!("mqtts://localhost:{}", guarded.ports[2]),
            trusted.clone(),
            "has expired",
        ),
        (
            "the broker's authority is not trusted",
            format!("mqtts://localhost:{}", guarded.ports[0]),
            trusted.replace("ours.pem", "theirs.pem"),
            "not signed by an authority",
        ),
    ];
    let rows = cases.into_iter().map(|(mistake, url, keys, part)| {
        let mqtt = format!(
            "[mqtt]\nbroker = \"{url}\"\n{}\n[http]",
            keys.replace('@', &files)
        );
        let row = Running::start(Place::new(), &SOUND.replace("[http]", &mqtt)).row(mistake, part);
        let port = url.rsplit(':').next().unwrap();
        let plain = |text: String| text.replace(port, "PORT");
        Row {
            mistake,
            run: plain(row.run),
            health: row.health.map(plain),
            page: row.page.map(plain),
        }
    });
    rows.collect()
}

/// Numbers that differ from run to run, behind what they belong to, and the directories of the tests.
fn settled(text: &str) -> String {
    let mut text = text.to_owned();
    for mark in [
        "pts_",
        "process ",
        "(process ",
        "127.0.0.1:",
        "localhost:",
        "verification time ",
        "not valid after ",
        "not valid after N (",
    ] {
        text = without_numbers(&text, mark);
    }
    let directory = format!("{}/vfd-gateway-test-", std::env::temp_dir().display());
    let text = without_numbers(&text, &directory);
    without_numbers(&text.replace(&format!("{directory}N-"), "TEST"), "TEST").replace("TESTN", "/")
}

/// `text` with N in place of each number of more than two digits behind `mark`.
fn without_numbers(text: &str, mark: &str) -> String {
    let mut parts = text.split(mark);
    let mut settled = parts.next().unwrap_or_default().to_owned();
    for part in parts {
        let rest = part.trim_start_matches(|c: char| c.is_ascii_digit());
        let number = if rest.len() == part.len() { "" } else { "N" };
        settled += &format!("{mark}{number}{rest}");
    }
    settled
}

/// Which serial ports there are differs from host to host.
fn without_ports(text: &str) -> String {
    match text.split_once("no such device; ") {
        Some((before, _)) => format!("{before}no such device; serial ports of this host: ..."),
        None => text.to_owned(),
    }
}

/// A data directory whose parent is not there.
fn on_the_disk() -> Row {
    let text = SOUND.replace("PLACE/data", "/nonexistent/vfd-gateway");
    Running::start(Place::new(), &text).row("the data directory cannot be made", "/nonexistent")
}

#[test]
fn each_of_forty_mistakes_says_at_once_what_is_wrong() {
    let mut rows = in_the_file();
    rows.extend(at_the_start());
    rows.extend(on_the_line());
    rows.extend(at_the_broker());
    rows.push(on_the_disk());
    assert!(rows.len() >= 40, "{}", rows.len());
    let found: String = rows.iter().map(|row| settled(&row.shown())).collect();
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/docs/mistakes.md");
    let text = std::fs::read_to_string(path).unwrap();
    let (head, told) = text.split_once("| --- | --- | --- | --- |\n").unwrap();
    if std::env::var_os("UPDATE_GOLDEN").is_some() {
        std::fs::write(path, format!("{head}| --- | --- | --- | --- |\n{found}")).unwrap();
        return;
    }
    for (found, told) in found.lines().zip(told.lines()) {
        assert_eq!(found, told);
    }
    assert_eq!(found.lines().count(), told.lines().count());
}
