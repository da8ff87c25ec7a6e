//! The compose file as docker-compose reads it, and its broker: mosquitto with the delivered configuration and access rules,
//! the passwords and certificates that the delivered script makes, and the gateway that is configured beside them.

use super::mosquitto::{Mosquitto, Subscriber, free_port};
use super::outsiders::documents_of;
use super::rig::{Place, assert_says, fields, simulate, start};
use super::started::{PATIENCE, Started, until};
use serde_json::Value;
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

/// The users of the containers, as compose.yaml has them.
const GATEWAY: u32 = 10001;
const BROKER: u32 = 1883;
/// How long the end of the gateway may take: the declared actions and the last words to the broker.
const END_MAX_S: u64 = 7;

/// `deploy` in a place of its own, with secrets.
struct Delivered {
    place: Place,
    is_root: bool,
}

impl Delivered {
    fn new() -> Self {
        let place = Place::new();
        let from = Path::new(env!("CARGO_MANIFEST_DIR")).join("deploy");
        assert!(
            Command::new("cp")
                .arg("-r")
                .arg(from)
                .arg(place.file("deploy"))
                .status()
                .unwrap()
                .success()
        );
        // The files are made for users whom only root can give them to.
        let is_root = std::fs::metadata(place.file("deploy")).unwrap().uid() == 0;
        let delivered = Self { place, is_root };
        delivered.make_secrets();
        delivered
    }

    fn make_secrets(&self) {
        let output = self.run_script("10.0.0.5");
        assert!(output.status.success(), "{}", said(&output));
    }

    /// make-secrets.sh for a broker that others reach by `name`.
    fn run_script(&self, name: &str) -> Output {
        let mut command = Command::new(self.compose("make-secrets.sh"));
        if !self.is_root {
            command.arg("--as-me");
        }
        command
            .arg(name)
            .env("PATH", path_with_sbin())
            .output()
            .unwrap()
    }

    fn compose(&self, name: &str) -> PathBuf {
        self.place.file("deploy/compose").join(name)
    }

    fn text(&self, name: &str) -> String {
        std::fs::read_to_string(self.compose(name)).unwrap()
    }

    fn password(&self, user: &str) -> String {
        self.text(&format!("secrets/passwords/{user}"))
            .trim()
            .to_owned()
    }

    /// What docker-compose makes of the files, with every profile.
    fn composed(&self, files: &[&str]) -> Value {
        let mut command = Command::new("docker-compose");
        for file in files {
            // The version of Debian 12 is older than names of projects.
            let text = self.text(file).replace("\nname: vfd-gateway\n", "\n");
            std::fs::write(self.compose(file), text).unwrap();
            command.arg("-f").arg(self.compose(file));
        }
        command.args(["--profile", "monitoring", "--profile", "telegraf", "config"]);
        command.env("VFD_SERIAL_DEVICE", "/dev/serial/by-id/usb-x");
        let output = command
            .output()
            .expect("docker-compose; run tests/run, which installs it");
        assert!(output.status.success(), "{}", said(&output));
        let file = self.place.file("composed.yaml");
        std::fs::write(&file, output.stdout).unwrap();
        documents_of("yaml", &[file]).remove(0)
    }
}

/// Debian keeps mosquitto's programs where an ordinary user does not look.
fn path_with_sbin() -> String {
    format!("{}:/usr/sbin", std::env::var("PATH").unwrap())
}

fn said(output: &Output) -> String {
    format!(
        "{}{}",
        String::from_utf8_lossy(&output.stdout),
        String::from_utf8_lossy(&output.stderr)
    )
}

fn texts(value: &Value) -> Vec<&str> {
    value
        .as_array()
        .map(|it| it.iter().filter_map(Value::as_str).collect())
        .unwrap_or_default()
}

#[test]
fn docker_compose_takes_the_files_and_every_file_that_they_name_is_there() {
    let delivered = Delivered::new();
    let composed = delivered.composed(&["compose.yaml"]);
    let services = composed["services"].as_object().unwrap();
    assert_eq!(
        services.keys().collect::<Vec<_>>(),
        ["gateway", "grafana", "mosquitto", "prometheus", "telegraf"]
    );
    for (name, service) in services {
        for source in texts(&service["volumes"])
            .iter()
            .filter_map(|it| it.split(':').next())
        {
            assert!(
                !source.starts_with('/') || Path::new(source).exists(),
                "{name}: there is no {source}"
            );
        }
    }
    for (name, secret) in composed["secrets"].as_object().unwrap() {
        let file = Path::new(secret["file"].as_str().unwrap());
        let mode = std::fs::metadata(file).unwrap().mode() & 0o777;
        let expected = if name == "broker-ca" { 0o444 } else { 0o400 };
        assert_eq!(mode, expected, "{name}");
    }
    if delivered.is_root {
        for (file, owner) in [
            ("gateway/mqtt-password", GATEWAY),
            ("mosquitto/users", BROKER),
            ("mosquitto/broker.key", BROKER),
        ] {
            assert_eq!(
                std::fs::metadata(delivered.compose("secrets").join(file))
                    .unwrap()
                    .uid(),
                owner,
                "{file}"
            );
        }
    }
    // A file that is mounted alone stays the old one when another takes its place, and these two read anew while they run.
    for (name, files) in [
        ("gateway", &["mqtt-password", "broker-ca.pem"][..]),
        (
            "mosquitto",
            &[
                "users",
                "broker.pem",
                "broker.key",
                "broker-ca.pem",
                "mosquitto_sub",
            ],
        ),
    ] {
        assert!(
            services[name]["secrets"].is_null(),
            "{name} mounts files alone"
        );
        let mounts = texts(&services[name]["volumes"]);
        let folder = mounts
            .iter()
            .find_map(|it| it.strip_suffix(":/run/secrets:ro"))
            .unwrap();
        for file in files {
            assert!(Path::new(folder).join(file).is_file(), "{name}: no {file}");
        }
    }
    let replug = delivered.composed(&["compose.yaml", "compose.replug.yaml"]);
    let gateway = &replug["services"]["gateway"];
    assert!(
        texts(&gateway["volumes"]).contains(&"/dev:/dev:rw")
            && !texts(&gateway["device_cgroup_rules"]).is_empty()
    );
}

#[test]
fn every_container_is_locked_in_and_the_gateway_has_time_to_end() {
    let composed = Delivered::new().composed(&["compose.yaml"]);
    for (name, service) in composed["services"].as_object().unwrap() {
        assert_eq!(service["read_only"], true, "{name}");
        assert_eq!(texts(&service["cap_drop"]), ["ALL"], "{name}");
        assert_eq!(
            texts(&service["security_opt"]),
            ["no-new-privileges:true"],
            "{name}"
        );
        assert_eq!(service["restart"], "unless-stopped", "{name}");
        assert!(
            service["privileged"].is_null() && service["cap_add"].is_null(),
            "{name}"
        );
        let user = service["user"].as_str().unwrap();
        assert!(
            user.split(':')
                .all(|id| id.parse::<u32>().is_ok_and(|id| id > 0)),
            "{name} runs as {user}"
        );
    }
    let gateway = &composed["services"]["gateway"];
    assert_eq!(
        gateway["network_mode"], "host",
        "the addresses of the clients are kept"
    );
    let grace = gateway["stop_grace_period"]
        .as_str()
        .unwrap()
        .trim_end_matches('s');
    assert!(grace.parse::<u64>().unwrap() > END_MAX_S, "{grace}");
    let device = texts(&gateway["devices"])[0].split(':').nth(1).unwrap();
    let file = std::fs::read_to_string(
        Path::new(env!("CARGO_MANIFEST_DIR")).join("deploy/compose/gateway/vfd-gateway.toml"),
    );
    let file: toml::Table = file.unwrap().parse().unwrap();
    assert_eq!(file["line"][0]["port"].as_str(), Some(device));
}

/// What Telegraf does with the messages stands once more in compose/telegraf.conf.
#[test]
fn both_files_for_telegraf_read_the_state_alike() {
    let deploy = Path::new(env!("CARGO_MANIFEST_DIR")).join("deploy");
    let rest = |file: &str, differs: &[&str]| {
        let text = std::fs::read_to_string(deploy.join(file)).unwrap();
        let (_, text) = text.split_once("[agent]").unwrap();
        let kept = text.lines().filter(|line| {
            !differs
                .iter()
                .any(|it| line.trim_start_matches(['#', ' ']).starts_with(it))
        });
        kept.map(str::to_owned).collect::<Vec<_>>()
    };
    let differs = [
        "servers = ",
        "topics = ",
        "username = ",
        "password = ",
        "tls_ca = ",
    ];
    let (one, other) = (
        rest("telegraf/telegraf.conf", &differs),
        rest("compose/telegraf.conf", &differs),
    );
    assert!(one.len() > 30);
    assert_eq!(one, other);
}

/// Broker, gateway and drive of the compose file, on this machine.
struct Running {
    delivered: Delivered,
    broker: Mosquitto,
    gateway: Started,
    _drive: Started,
}

impl Running {
    fn new() -> Self {
        let delivered = Delivered::new();
        let port = free_port();
        let (health, data) = (
            delivered.place.file("health"),
            delivered.place.file("broker-data"),
        );
        std::fs::create_dir(&health).unwrap();
        std::fs::create_dir(&data).unwrap();
        // With what compose.yaml mounts there for `service`.
        let here = |service: &str, text: &str| {
            let (secrets, config) = (
                delivered.compose("secrets").join(service),
                delivered.compose("mosquitto"),
            );
            [
                ("/run/secrets/", format!("{}/", secrets.display())),
                ("/mosquitto/config/", format!("{}/", config.display())),
                ("/mosquitto/data/", format!("{}/", data.display())),
                ("8883", port.to_string()),
            ]
            .iter()
            .fold(text.to_owned(), |text, (there, here)| {
                text.replace(there, here)
            })
        };
        // On loopback only; and root's broker would become another user, who may not read here.
        let text = here("mosquitto", &delivered.text("mosquitto/mosquitto.conf")).replace(
            &format!("listener {port}"),
            &format!("listener {port} 127.0.0.1"),
        );
        let user = if delivered.is_root { "user root\n" } else { "" };
        let file = delivered
            .place
            .write("mosquitto.conf", &format!("{text}{user}"));
        let options = here(
            "mosquitto",
            &delivered.text("secrets/mosquitto/mosquitto_sub"),
        );
        std::fs::write(health.join("mosquitto_sub"), options).unwrap();
        let broker = Mosquitto::with_file(file, port);
        let line = delivered.place.file("line");
        let drive = simulate(&line);
        std::fs::create_dir(delivered.place.file("data")).unwrap();
        let text = here("gateway", &configuration(&delivered, &line));
        let file = delivered.place.write("gateway.toml", &text);
        let gateway = start(&["run", "-c", file.to_str().unwrap()]);
        gateway.wait_for("that the drive is there", |line| {
            let fields = fields(line)?;
            (fields["message"] == "drive online").then_some(())
        });
        Self {
            delivered,
            broker,
            gateway,
            _drive: drive,
        }
    }

    /// What a client says of itself as `user`.
    fn credentials(&self, user: &str) -> Vec<String> {
        let ca = self.delivered.compose("secrets/broker-ca.pem");
        let words = [
            "--cafile",
            ca.to_str().unwrap(),
            "-u",
            user,
            "-P",
            &self.delivered.password(user),
        ];
        words.iter().map(|it| (*it).to_owned()).collect()
    }

    fn subscribed(&self, user: &str, filter: &str) -> Subscriber {
        let credentials = self.credentials(user);
        let words: Vec<_> = credentials.iter().map(String::as_str).collect();
        Subscriber::with(&self.broker, "mqttv5", filter, &words)
    }

    /// Whether `user` may publish at `topic`.
    fn publishes(&self, user: &str, topic: &str, payload: &str) -> bool {
        let output = self.pub_as(&self.credentials(user), topic, payload);
        assert!(output.status.success(), "{}", said(&output));
        !said(&output).contains("Not authorized")
    }

    fn pub_as(&self, credentials: &[String], topic: &str, payload: &str) -> Output {
        let port = self.broker.address().port().to_string();
        let mut command = Command::new("mosquitto_pub");
        command.args([
            "-h",
            "127.0.0.1",
            "-p",
            &port,
            "-V",
            "mqttv5",
            "-q",
            "1",
            "-t",
            topic,
            "-m",
            payload,
        ]);
        command.args(credentials).output().unwrap()
    }
}

/// The delivered file with its control section, on this machine.
fn configuration(delivered: &Delivered, line: &Path) -> String {
    let text = delivered.text("gateway/vfd-gateway.toml");
    let (before, commented) = text.split_once("# [line.drive.control]\n").unwrap();
    let (control, after) = commented.split_once("\n\n").unwrap();
    let control: Vec<_> = control
        .lines()
        .map(|line| line.strip_prefix("# ").unwrap())
        .collect();
    let text = format!(
        "{before}[line.drive.control]\n{}\n\n{after}",
        control.join("\n")
    );
    let data = delivered.place.file("data");
    [
        ("/dev/vfd-line-1", line.to_str().unwrap()),
        ("/var/lib/vfd-gateway", data.to_str().unwrap()),
        ("127.0.0.1:1502", "127.0.0.1:0"),
        ("127.0.0.1:8080", "127.0.0.1:0"),
    ]
    .iter()
    .fold(text, |text, (there, here)| {
        assert!(text.contains(there), "no {there}");
        text.replace(there, here)
    })
}

#[test]
fn each_user_of_the_broker_may_what_it_is_there_for_and_nothing_else() {
    let running = Running::new();
    let watchman = running.subscribed("watchman", "vfd/#");
    watchman.wait_for_payload("vfd/plant-a/status", "online");
    watchman.wait_for_payload("drive/pump-1/availability", "online");
    let announced = running.subscribed("home-assistant", "homeassistant/#");
    announced.wait_for("_last_reason/config", |_| Some(()));

    let drive = "vfd/plant-a/drive/pump-1";
    assert!(running.publishes("home-assistant", &format!("{drive}/frequency/set"), "20.5"));
    watchman.wait_for("/result", |it| {
        it.payload.contains("\"confirmed\"").then_some(())
    });
    assert!(running.publishes("scada", "vfd/plant-a/by/scada/drive/pump-1/run/set", "stop"));
    assert!(running.publishes("watchman", "vfd/plant-a/all/run/set", "stop"));

    for (user, topic) in [
        ("watchman", format!("{drive}/run/set")),
        ("telegraf", format!("{drive}/run/set")),
        ("health", "vfd/plant-a/all/run/set".to_owned()),
        ("scada", format!("{drive}/run/set")),
        (
            "scada",
            "vfd/plant-a/by/somebody-else/drive/pump-1/run/set".to_owned(),
        ),
        (
            "home-assistant",
            "vfd/plant-a/by/scada/drive/pump-1/run/set".to_owned(),
        ),
        ("home-assistant", format!("{drive}/state")),
        ("plant-a", "vfd/plant-b/drive/pump-1/run/set".to_owned()),
        (
            "plant-a",
            "homeassistant/sensor/vfd-gateway-plant-b/x/config".to_owned(),
        ),
    ] {
        assert!(
            !running.publishes(user, &topic, "stop"),
            "{user} may publish at {topic}"
        );
    }
    // Telegraf asks for everything and is given the states.
    let telegraf = running.subscribed("telegraf", "#");
    telegraf.wait_for("drive/pump-1/state", |_| Some(()));
    for part in ["status", "availability", "info", "result"] {
        assert!(
            !telegraf.has(&format!("plant-a/{part}")) && !telegraf.has(&format!("pump-1/{part}")),
            "{part}"
        );
    }
}

#[test]
fn anyone_who_is_not_known_or_not_encrypted_is_turned_away() {
    let running = Running::new();
    let topic = "vfd/plant-a/all/run/set";
    let ca = running.credentials("watchman")[..2].to_vec();
    let with =
        |more: &[&str]| [ca.clone(), more.iter().map(|it| (*it).to_owned()).collect()].concat();
    for credentials in [
        with(&[]),
        with(&["-u", "watchman", "-P", "guessed"]),
        with(&["-u", "stranger", "-P", "guessed"]),
    ] {
        let output = running.pub_as(&credentials, topic, "stop");
        assert!(
            !output.status.success() && said(&output).contains("ot authori"),
            "{credentials:?}: {}",
            said(&output)
        );
    }
    let plain = running.credentials("watchman")[2..].to_vec();
    assert!(
        !running.pub_as(&plain, topic, "stop").status.success(),
        "without TLS"
    );
}

#[test]
fn the_health_check_of_the_broker_works_and_a_second_run_of_the_script_adds_a_user_and_keeps_the_rest()
 {
    let running = Running::new();
    let composed = running.delivered.composed(&["compose.yaml"]);
    let test = &composed["services"]["mosquitto"]["healthcheck"]["test"];
    let words = texts(test);
    assert_eq!(words[0], "CMD");
    let mut command = Command::new(words[1]);
    // Compose makes one dollar of two.
    command.args(words[2..].iter().map(|it| it.replace("$$", "$")));
    let output = command
        .env("XDG_CONFIG_HOME", running.delivered.place.file("health"))
        .output()
        .unwrap();
    assert!(
        output.status.success() && said(&output).contains("seconds"),
        "{}",
        said(&output)
    );

    let kept = |name: &str| running.delivered.text(&format!("secrets/{name}"));
    let names = [
        "passwords/plant-a",
        "mosquitto/broker.pem",
        "broker-ca.pem",
        "gateway/mqtt-password",
    ];
    let before = names.map(kept);
    let acl =
        running.delivered.text("mosquitto/acl") + "\nuser plant-b\ntopic readwrite vfd/plant-b/#\n";
    std::fs::write(running.delivered.compose("mosquitto/acl"), acl).unwrap();
    running.delivered.make_secrets();
    assert_eq!(names.map(kept), before);
    assert!(!running.delivered.password("plant-b").is_empty());
    let users = kept("mosquitto/users");
    assert!(
        users.contains("plant-b:$") && !users.contains(&running.delivered.password("plant-b")),
        "hashes alone"
    );
    running.broker.read_anew();
    let (mine, topic) = (running.credentials("plant-b"), "vfd/plant-b/status");
    until("the broker knows the user", PATIENCE, || {
        running
            .pub_as(&mine, topic, "x")
            .status
            .success()
            .then_some(())
    });
    drop(running.gateway);
}

#[test]
fn a_name_that_is_not_in_the_certificate_that_stays_is_not_passed_over() {
    let delivered = Delivered::new();
    let file = "secrets/mosquitto/broker.pem";
    let before = delivered.text(file);
    assert_says(
        &delivered.run_script("10.0.0.6"),
        2,
        &["`10.0.0.6` is not in", file, "IP Address:10.0.0.5"],
    );
    assert_eq!(delivered.text(file), before);
    std::fs::remove_file(delivered.compose(file)).unwrap();
    for _ in 0..2 {
        let output = delivered.run_script("10.0.0.6");
        assert!(output.status.success(), "{}", said(&output));
    }
}
