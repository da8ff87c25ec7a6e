//! The add-on for Home Assistant: its run script before a Supervisor that is played, with a real broker, and what its
//! description promises.

use super::mosquitto::{Mosquitto, Subscriber, free_port};
use super::outsiders::documents_of;
use super::rig::{Place, simulate, text_of};
use super::started::{PATIENCE, Started, until};
use serde_json::{Value, json};
use std::collections::BTreeSet;
use std::io::{Read, Write};
use std::net::{SocketAddr, TcpListener};
use std::path::{Path, PathBuf};
use std::process::Command;

const TOKEN: &str = "a-token-of-the-supervisor";
const PASSWORD: &str = "it's \"quoted\" \\ so";

fn directory() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("deploy/home-assistant-addon")
}

fn description() -> Value {
    documents_of("yaml", &[directory().join("config.yaml")]).remove(0)
}

/// A Supervisor that knows a broker, and answers only those who have its token. It ends with the test program.
fn supervisor(broker: SocketAddr, password: &str) -> SocketAddr {
    let data = json!({ "result": "ok", "data": { "addon": "core_mosquitto", "host": broker.ip().to_string(),
        "port": broker.port(), "ssl": false, "protocol": "3.1.1", "username": "addons", "password": password } });
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = listener.local_addr().unwrap();
    std::thread::spawn(move || {
        for mut stream in listener.incoming().map_while(Result::ok) {
            let mut head = [0; 2048];
            let length = stream.read(&mut head).unwrap_or(0);
            let head = String::from_utf8_lossy(&head[..length]).into_owned();
            let is_right = head.starts_with("GET /services/mqtt ")
                && head.contains(&format!("Bearer {TOKEN}"));
            let (status, body) = if is_right {
                ("200 OK", data.to_string())
            } else {
                ("403 Forbidden", String::new())
            };
            let length = body.len();
            let _ = write!(
                stream,
                "HTTP/1.1 {status}\r\nContent-Length: {length}\r\nConnection: close\r\n\r\n{body}"
            );
        }
    });
    address
}

/// The run script with these options, as the Supervisor starts it.
fn run(place: &Place, supervisor: SocketAddr, token: &str, options: &Value) -> Started {
    place.write("options.json", &options.to_string());
    let program = Path::new(env!("CARGO_BIN_EXE_vfd-gateway"))
        .parent()
        .unwrap();
    let path = format!("{}:{}", program.display(), std::env::var("PATH").unwrap());
    let mut command = Command::new("sh");
    command
        .arg(directory().join("run.sh"))
        .env("PATH", path)
        .env("DATA", place.file(""));
    command
        .env("OWN_CONFIGURATIONS", place.file(""))
        .env("SUPERVISOR", format!("http://{supervisor}"));
    command
        .env("SUPERVISOR_TOKEN", token)
        .env("INGRESS_PORT", free_port().to_string())
        .env("RUST_LOG", "info");
    Started::new(command)
}

/// The options that the description comes with, on the line of `place`.
fn options(place: &Place) -> Value {
    let mut options = description()["options"].clone();
    options["port"] = place.file("line").to_str().unwrap().into();
    options["drives"][0]["min_hz"] = 5.into();
    options["drives"][0]["max_hz"] = 50.into();
    options["drives"][0]["on_commander_lost"] = "stop".into();
    options["drives"][0]["lost_after"] = "3min".into();
    options["drives"][0]["on_shutdown"] = "stop".into();
    options["combined"] = json!(["switch"]);
    options
}

#[test]
fn its_options_and_the_broker_of_the_supervisor_make_a_gateway_that_announces_the_drive() {
    let place = Place::new();
    let _drive = simulate(&place.file("line"));
    let broker = Mosquitto::start(&place.file(""));
    let supervisor = supervisor(broker.address(), PASSWORD);
    let subscriber = Subscriber::new(&broker, "mqttv5", "homeassistant/#");
    let mut gateway = run(&place, supervisor, TOKEN, &options(&place));
    for entity in ["/switch/", "/button/", "/number/", "/sensor/"] {
        let is_there = |it: &super::mosquitto::Message| it.topic.contains(entity).then_some(());
        subscriber.wait_for("/config", is_there);
    }
    let configuration = std::fs::read_to_string(place.file("vfd-gateway.toml")).unwrap();
    assert!(!configuration.contains(PASSWORD), "{configuration}");
    let password = place.file("mqtt-password");
    assert_eq!(
        std::fs::read_to_string(&password).unwrap(),
        format!("{PASSWORD}\n")
    );
    let mode = std::os::unix::fs::PermissionsExt::mode(&password.metadata().unwrap().permissions());
    assert_eq!(mode & 0o077, 0, "{mode:o}");
    gateway.terminate();
    assert!(gateway.end_within(PATIENCE).success(), "{}", gateway.text());
}

#[test]
fn what_is_missing_is_said_and_a_file_of_ones_own_stands_for_all() {
    let place = Place::new();
    let nobody = SocketAddr::from(([127, 0, 0, 1], 9));
    let supervisor = supervisor(nobody, PASSWORD);
    let says = |token: &str, options: &Value, what: &str| {
        let mut script = run(&place, supervisor, token, options);
        let status = script.end_within(PATIENCE);
        until("all of it is read", PATIENCE, || {
            script.is_silent().then_some(())
        });
        assert!(
            !status.success() && script.text().contains(what),
            "{}",
            script.text()
        );
    };
    says("wrong", &options(&place), "knows no MQTT broker");
    let mut unsaid = options(&place);
    unsaid["drives"][0]
        .as_object_mut()
        .unwrap()
        .remove("on_commander_lost");
    says(TOKEN, &unsaid, "`on_commander_lost` is missing");
    let mut wanted = options(&place);
    wanted["own_configuration"] = "own.toml".into();
    says(TOKEN, &wanted, "there is no own.toml");
    wanted["own_configuration"] = "../../etc/passwd".into();
    says(TOKEN, &wanted, "is not the name of a file");
    wanted["own_configuration"] = "own.toml".into();
    let line = "[[line]]\nname = \"own\"\nport = \"/dev/null\"\n[[line.drive]]\nname = \"p\"\nmodel = \"hyundai-n700\"\nstation = 1\n";
    place.write(
        "own.toml",
        &format!("{line}[[modbus_tcp]]\nlisten = \"127.0.0.1:0\"\n"),
    );
    let gateway = run(&place, supervisor, TOKEN, &wanted);
    gateway.wait_for("that it runs", |line| {
        line.contains("running").then_some(())
    });
}

/// What the Supervisor requires of an add-on's description (developers.home-assistant.io, Add-on configuration).
#[test]
fn its_description_holds_together() {
    let it = description();
    for key in ["name", "version", "slug", "description", "arch"] {
        assert!(!it[key].is_null(), "{key} is required");
    }
    assert_eq!(it["version"], env!("CARGO_PKG_VERSION"));
    let architectures = ["armhf", "armv7", "aarch64", "amd64", "i386"];
    assert!(
        it["arch"]
            .as_array()
            .unwrap()
            .iter()
            .all(|arch| architectures.contains(&arch.as_str().unwrap()))
    );
    assert!(
        ["initialize", "system", "services", "application", "once"]
            .contains(&it["startup"].as_str().unwrap())
    );
    let keys = |of: &Value| {
        of.as_object()
            .unwrap()
            .keys()
            .cloned()
            .collect::<BTreeSet<_>>()
    };
    assert_eq!(
        keys(&it["options"]),
        keys(&it["schema"]),
        "a key without `?` needs a value to begin with"
    );
    let types = [
        "str", "bool", "int", "float", "email", "url", "password", "port", "match(", "list(",
        "device",
    ];
    let mut all = vec![&it["schema"]];
    while let Some(part) = all.pop() {
        match part {
            Value::String(kind) => assert!(types.iter().any(|it| kind.starts_with(it)), "{kind}"),
            Value::Array(items) => all.extend(items),
            Value::Object(fields) => all.extend(fields.values()),
            other => panic!("{other}"),
        }
    }
    for language in ["en", "de"] {
        let file = directory().join(format!("translations/{language}.yaml"));
        let translated = documents_of("yaml", &[file]).remove(0);
        assert_eq!(
            keys(&translated["configuration"]),
            keys(&it["schema"]),
            "{language}"
        );
        assert_eq!(
            keys(&translated["network"]),
            keys(&it["ports"]),
            "{language}"
        );
    }
    let listens = format!("INGRESS_PORT:-{}}}", it["ingress_port"]);
    assert!(
        text_of("deploy/home-assistant-addon/run.sh").contains(&listens),
        "the proxy asks at {listens}"
    );
    let image = text_of("deploy/home-assistant-addon/Dockerfile");
    assert!(
        image.contains("--no-install-recommends") && image.contains("rm -rf /var/lib/apt/lists/*")
    );
    assert!(
        !image.contains(":latest") && image.contains("pipefail"),
        "what hadolint asks for"
    );
    let icon = std::fs::read(directory().join("icon.png")).unwrap();
    let size = |at: usize| u32::from_be_bytes(icon[at..at + 4].try_into().unwrap());
    assert_eq!((&icon[1..4], size(16), size(20)), (&b"PNG"[..], 128, 128));
}
