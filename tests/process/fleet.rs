//! Many gateways on one broker, with the configuration files of `deploy/fleet`: each gateway is a user of its own, and what the
//! broker has acknowledged arrives.

use super::mosquitto::{Mosquitto, free_port};
use super::rig::{Place, fields, start, vfd_gateway};
use super::started::{PATIENCE, Started, until};
use serde_json::Value;
use std::io::Write;
use std::net::TcpStream;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use std::time::Duration;

const GATEWAYS: usize = 20;
const SHAPE: [&str; 6] = ["--gateways", "20", "--drives", "4", "--json", "--drain-seconds"];
/// Of the simulation, beyond the time for which it publishes.
const END_WITHIN: Duration = Duration::from_secs(180);

fn deploy(file: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("deploy/fleet").join(file)
}

/// A delivered file with other values in the place of those that it names.
fn delivered(file: &str, here: &[(&str, String)]) -> String {
    let text = std::fs::read_to_string(deploy(file)).unwrap();
    here.iter().fold(text, |text, (there, here)| {
        assert!(text.contains(there), "{file} has no {there}");
        text.replace(there, here)
    })
}

fn path(place: &Place, name: &str) -> String {
    place.file(name).to_str().unwrap().to_owned()
}

/// Credentials of the gateways, of a site and of who reads, in the forms that the brokers want.
fn make_users(place: &Place) {
    let mut script = Command::new(deploy("make-users.sh"));
    script.args([&path(place, "users"), "vfd", "historian"]).stdin(Stdio::piped());
    let mut script = script.spawn().unwrap();
    let names: Vec<_> = (1..=GATEWAYS).map(|number| format!("gw-{number:04}")).chain(["site-1".to_owned()]).collect();
    writeln!(script.stdin.take().unwrap(), "{}", names.join("\n")).unwrap();
    assert!(script.wait().unwrap().success());
}

fn password(place: &Place, user: &str) -> String {
    let credentials = std::fs::read_to_string(place.file("users/credentials")).unwrap();
    let found = credentials.lines().find_map(|line| line.strip_prefix(user)?.strip_prefix(':'));
    found.unwrap_or_else(|| panic!("no password of {user}")).to_owned()
}

/// The central mosquitto as it is delivered: TLS, a user for each gateway, each with its own topics.
fn central(place: &Place) -> Mosquitto {
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("deploy/modbus-security/make-certificates.sh");
    let made = Command::new(script).args([&path(place, ""), "gateway", "127.0.0.1", "localhost"]).output().unwrap();
    assert!(made.status.success(), "{}", said(&made));
    std::fs::create_dir(place.file("central")).unwrap();
    std::fs::copy(deploy("mosquitto.acl"), place.file("mosquitto.acl")).unwrap();
    std::fs::copy(place.file("users/mosquitto.passwd"), place.file("mosquitto.passwd")).unwrap();
    let port = free_port();
    // Started as root it would become another user, who may not read here.
    let here = [
        ("listener 8883", format!("user root\nlog_dest stderr\nlistener {port} 127.0.0.1")),
        ("/etc/mosquitto/server", path(place, "gateway")),
        ("/etc/mosquitto/", path(place, "")),
        ("/var/lib/mosquitto/", path(place, "central/")),
    ];
    Mosquitto::with_file(place.write("central.conf", &delivered("mosquitto.conf", &here)), port)
}

/// A mosquitto on a site, which tells the central one everything.
fn site(place: &Place, central: &Mosquitto) -> Mosquitto {
    let port = free_port();
    let here = [
        ("central.example:8883", format!("localhost:{}", central.address().port())),
        ("/etc/mosquitto/ca.pem", path(place, "ca.pem")),
        ("CHANGE-ME", password(place, "site-1")),
    ];
    let head = format!("listener {port} 127.0.0.1\nallow_anonymous true\nuser root\nlog_dest stderr\n");
    Mosquitto::with_file(place.write("site.conf", &(head + &delivered("mosquitto-bridge.conf", &here))), port)
}

fn url(scheme: &str, port: u16) -> String {
    format!("{scheme}://localhost:{port}")
}

fn said(output: &Output) -> String {
    [&output.stdout[..], &output.stderr].map(|it| String::from_utf8_lossy(it).into_owned()).concat()
}

/// A simulation that was started, up to its first updates.
fn begin(more: &[&str]) -> Started {
    let fleet = start(&[&["fleet", "simulate"], &SHAPE[..], &["60"], more].concat());
    fleet.wait_for("that it publishes", |line| (fields(line)?["message"] == "the fleet publishes").then_some(()));
    fleet
}

/// What it printed at its end.
fn result(mut fleet: Started) -> Value {
    let status = fleet.end_within(END_WITHIN);
    assert!(status.success(), "{}", fleet.text());
    fleet.wait_for("its result", |line| (line == "}").then_some(()));
    // The log is one object a line, the result one over many lines.
    let lines = fleet.find_all(|line| fields(line).is_none_or(|fields| fields.is_null()).then(|| line.clone()));
    let text = lines.join("\n");
    serde_json::from_str(&text).unwrap_or_else(|error| panic!("{error} in {text}"))
}

/// What must hold at quality of service 1, whatever was lost meanwhile.
#[track_caller]
fn assert_nothing_is_lost(result: &Value) {
    assert!(result["sent"].as_u64().unwrap() > 0, "{result:#}");
    for (one, other) in [("sent", "acknowledged"), ("sent", "received")] {
        assert_eq!(result[one], result[other], "{result:#}");
    }
    assert_eq!((&result["acknowledged_missing"], &result["foreign"]), (&0.into(), &0.into()), "{result:#}");
}

#[test]
fn gateways_with_a_user_each_on_a_mosquitto_lose_nothing() {
    let place = Place::new();
    make_users(&place);
    let broker = central(&place);
    let (url, ca, credentials) =
        (url("mqtts", broker.address().port()), path(&place, "ca.pem"), path(&place, "users/credentials"));
    let common = ["--broker", &url, "--ca", &ca, "--credentials", &credentials, "--prefix", "vfd", "--seconds", "5"];
    let pid = broker.id().to_string();
    let shared = ["--qos", "1", "--consumers", "3", "--reading", "shared", "--watch-pid", &pid];
    let result = result(begin(&[&common[..], &shared].concat()));
    assert_nothing_is_lost(&result);
    assert_eq!((&result["again"], &result["broken"]), (&0.into(), &0.into()), "{result:#}");
    assert_eq!(result["processes"][1]["name"], "mosquitto");
    assert_eq!(result["connections"], GATEWAYS + 3);

    // Nothing of it is left at the broker.
    let kept = Command::new("mosquitto_sub")
        .args(["-h", "localhost", "-p", &broker.address().port().to_string(), "--cafile", &ca, "-u", "historian"])
        .args(["-P", &password(&place, "historian"), "-t", "vfd/#", "--retained-only", "-W", "2", "-v"])
        .output()
        .unwrap();
    assert_eq!(String::from_utf8_lossy(&kept.stdout), "", "{}", said(&kept));
}

#[test]
fn a_gateway_cannot_speak_for_another_one() {
    let place = Place::new();
    make_users(&place);
    let broker = central(&place);
    let tell = |topic: &str| {
        let mut publish = Command::new("mosquitto_pub");
        publish.args([
            "-h",
            "localhost",
            "-p",
            &broker.address().port().to_string(),
            "--cafile",
            &path(&place, "ca.pem"),
        ]);
        publish.args(["-V", "mqttv5", "-q", "1", "-d", "-u", "gw-0001", "-P", &password(&place, "gw-0001")]);
        said(&publish.args(["-t", topic, "-m", "x"]).output().unwrap())
    };
    // 135: not authorised.
    assert!(!tell("vfd/gw-0001/drive/pump/run/state").contains("RC:135"));
    for topic in ["vfd/gw-0002/drive/pump/run/state", "vfd/gw-0002/drive/pump/run/set", "vfd/all/run/set"] {
        let told = tell(topic);
        assert!(told.contains("RC:135"), "{topic}: {told}");
    }
}

#[test]
fn wrong_credentials_are_told_before_anything_is_sent() {
    let place = Place::new();
    make_users(&place);
    let broker = central(&place);
    let url = url("mqtts", broker.address().port());
    let ca = path(&place, "ca.pem");
    let common = ["fleet", "simulate", "--broker", &url, "--ca", &ca, "--gateways", "21", "--credentials"];
    let unknown = vfd_gateway(&[&common[..], &[&path(&place, "users/credentials")]].concat());
    assert_eq!(unknown.status.code(), Some(2));
    assert!(said(&unknown).contains("no line for the user gw-0021"), "{}", said(&unknown));
    let embedded = vfd_gateway(&["fleet", "simulate", "--broker", "embedded"]);
    assert_eq!(embedded.status.code(), Some(2));
    assert!(said(&embedded).contains("embedded"), "{}", said(&embedded));
}

#[test]
fn a_site_tells_everything_over_its_bridge_also_what_the_central_broker_missed() {
    let place = Place::new();
    make_users(&place);
    let mut central = central(&place);
    let site = site(&place, &central);
    let (here, there) = (url("mqtt", site.address().port()), url("mqtts", central.address().port()));
    let (ca, credentials) = (path(&place, "ca.pem"), path(&place, "users/credentials"));
    let fleet = begin(&[
        "--broker",
        &here,
        "--consumer-broker",
        &there,
        "--ca",
        &ca,
        "--credentials",
        &credentials,
        "--prefix",
        "vfd/site-1",
        "--seconds",
        "8",
        "--qos",
        "1",
    ]);
    central.end();
    central.start_again();
    let result = result(fleet);
    assert_nothing_is_lost(&result);
    assert_eq!(result["broken"], 1, "the consumer alone is at the central broker: {result:#}");
}

/// Three nodes of NATS as they are delivered.
struct Cluster {
    nodes: Vec<Node>,
}

struct Node {
    program: Option<Started>,
    directory: PathBuf,
    mqtt: u16,
    monitor: u16,
}

impl Cluster {
    fn start(place: &Place) -> Self {
        let ports: Vec<_> = (0..3).map(|_| [free_port(), free_port(), free_port(), free_port()]).collect();
        let routes: Vec<_> = ports.iter().map(|[_, route, ..]| format!("\"nats://127.0.0.1:{route}\"")).collect();
        let nodes = ports.iter().zip(1..).map(|([clients, route, mqtt, monitor], number)| {
            let directory = place.file(&format!("n{number}"));
            std::fs::create_dir(&directory).unwrap();
            for file in ["nats.conf", "nats-mqtt.conf"] {
                std::fs::copy(deploy(file), directory.join(file)).unwrap();
            }
            std::fs::copy(place.file("users/nats-users.conf"), directory.join("nats-users.conf")).unwrap();
            let text = format!(
                "server_name: n{number}\nlisten: \"127.0.0.1:{clients}\"\nhttp: \"127.0.0.1:{monitor}\"\n\
                 jetstream {{ store_dir: \"{}/store\", max_file_store: 2GB }}\n\
                 cluster {{ name: fleet, listen: \"127.0.0.1:{route}\", routes: [{}] }}\n\
                 mqtt {{ listen: \"127.0.0.1:{mqtt}\"\n include ./nats-mqtt.conf\n}}\n",
                directory.display(),
                routes.join(", ")
            );
            std::fs::write(directory.join("node.conf"), text).unwrap();
            Node { program: None, directory, mqtt: *mqtt, monitor: *monitor }
        });
        let mut cluster = Self { nodes: nodes.collect() };
        cluster.nodes.iter_mut().for_each(Node::start);
        // Clients are let in before there is a leader, and wait then.
        until("the nodes have a leader", PATIENCE, || {
            let leader = |node: &Node| node.ask("/jsz")?["meta_cluster"]["leader"].as_str().map(|it| !it.is_empty());
            cluster.nodes.iter().all(|node| leader(node) == Some(true)).then_some(())
        });
        cluster
    }

    fn urls(&self) -> Vec<String> {
        self.nodes.iter().map(|node| url("mqtt", node.mqtt)).collect()
    }
}

impl Node {
    fn start(&mut self) {
        let mut command = Command::new("nats-server");
        command.arg("-c").arg(self.directory.join("nats.conf"));
        self.program = Some(Started::new(command));
        until("a node listens", PATIENCE, || TcpStream::connect(("127.0.0.1", self.mqtt)).ok());
    }

    fn kill(&mut self) {
        self.program.take().expect("it runs").kill();
    }

    /// What it says of itself.
    fn ask(&self, what: &str) -> Option<Value> {
        let url = format!("http://127.0.0.1:{}{what}", self.monitor);
        let get = "import sys, urllib.request; print(urllib.request.urlopen(sys.argv[1], timeout=5).read().decode())";
        let output = Command::new("python3").args(["-c", get, &url]).output().unwrap();
        serde_json::from_slice(&output.stdout).ok()
    }
}

/// `tests/run fleet` installs what it needs and runs it; it takes about a minute.
#[test]
#[ignore = "needs nats-server, which `tests/run fleet` installs"]
fn a_cluster_of_nats_loses_nothing_that_it_acknowledged_when_a_node_is_killed() {
    let place = Place::new();
    make_users(&place);
    let mut cluster = Cluster::start(&place);
    let (urls, credentials) = (cluster.urls(), path(&place, "users/credentials"));
    let brokers: Vec<_> = urls.iter().flat_map(|url| ["--broker", url.as_str()]).collect();
    let common =
        ["--credentials", &credentials, "--prefix", "vfd", "--mqtt-version", "4", "--qos", "1", "--seconds", "20"];
    let fleet = begin(&[&common[..], &["--no-retain"], &brokers].concat());
    // The consumer and a third of the gateways are on the first node.
    let taken = |cluster: &Cluster| cluster.nodes[0].ask("/varz")?["in_msgs"].as_u64();
    let before = taken(&cluster).expect("a node that tells");
    until("updates go through the first node", PATIENCE, || taken(&cluster).filter(|count| *count > before + 200));
    cluster.nodes[0].kill();
    let result = result(fleet);
    println!("{result:#}");
    assert_nothing_is_lost(&result);
    assert!(result["broken"].as_u64().unwrap() as usize > GATEWAYS / 3, "{result:#}");
    cluster.nodes[0].start();
    until("the node is back", PATIENCE, || {
        cluster.nodes[0].ask("/healthz")?["status"].as_str().filter(|it| *it == "ok").map(drop)
    });
}
