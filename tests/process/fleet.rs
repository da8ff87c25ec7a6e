//! Many gateways on one broker, with the configuration files of `deploy/fleet`: each gateway is a user of its own, and what the
//! broker has acknowledged arrives.

use super::mosquitto::{Mosquitto, Subscriber, free_port};
use super::rig::{Place, fields, fleet_program};
use super::started::{PATIENCE, Started, until};
use serde_json::Value;
use std::io::Write;
use std::net::TcpStream;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use std::time::Duration;

const GATEWAYS: usize = 20;
const SHAPE: [&str; 6] = [
    "--gateways",
    "20",
    "--drives",
    "4",
    "--json",
    "--drain-seconds",
];
/// Of the simulation, beyond the time for which it publishes.
const END_WITHIN: Duration = Duration::from_secs(180);

fn deploy(file: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("deploy/fleet")
        .join(file)
}

/// A delivered file with other values in the place of those that it names.
pub(super) fn delivered(file: &str, here: &[(&str, String)]) -> String {
    let text = std::fs::read_to_string(deploy(file)).unwrap();
    here.iter().fold(text, |text, (there, here)| {
        assert!(text.contains(there), "{file} has no {there}");
        text.replace(there, here)
    })
}

pub(super) fn path(place: &Place, name: &str) -> String {
    place.file(name).to_str().unwrap().to_owned()
}

/// Credentials of the gateways, of a site, and of who reads and commands, in the forms that the brokers want.
pub(super) fn make_users(place: &Place) {
    let mut script = Command::new(deploy("make-users.sh"));
    script
        .args([
            "--commander",
            "operator",
            &path(place, "users"),
            "vfd",
            "historian",
        ])
        .stdin(Stdio::piped());
    let mut script = script.spawn().unwrap();
    let names: Vec<_> = (1..=GATEWAYS)
        .map(|number| format!("gw-{number:04}"))
        .chain(["site-1".to_owned()])
        .collect();
    writeln!(script.stdin.take().unwrap(), "{}", names.join("\n")).unwrap();
    assert!(script.wait().unwrap().success());
}

pub(super) fn password(place: &Place, user: &str) -> String {
    let credentials = std::fs::read_to_string(place.file("users/credentials")).unwrap();
    let found = credentials
        .lines()
        .find_map(|line| line.strip_prefix(user)?.strip_prefix(':'));
    found
        .unwrap_or_else(|| panic!("no password of {user}"))
        .to_owned()
}

/// The central mosquitto as it is delivered: TLS, a user for each gateway, each with its own topics.
pub(super) struct Central {
    /// As gateways and sites reach it.
    pub broker: Mosquitto,
    /// As those reach it who read and command.
    pub others: Mosquitto,
}

pub(super) fn central(place: &Place) -> Central {
    let script =
        Path::new(env!("CARGO_MANIFEST_DIR")).join("deploy/modbus-security/make-certificates.sh");
    let made = Command::new(script)
        .args([&path(place, ""), "gateway", "127.0.0.1", "localhost"])
        .output()
        .unwrap();
    assert!(made.status.success(), "{}", said(&made));
    std::fs::create_dir(place.file("central")).unwrap();
    for file in ["gateways.passwd", "others.passwd", "mosquitto.acl"] {
        std::fs::copy(place.file("users").join(file), place.file(file)).unwrap();
    }
    let (port, others) = (free_port(), free_port());
    // Started as root it would become another user, who may not read here.
    let here = [
        (
            "listener 8883",
            format!("user root\nlog_dest stderr\nlistener {port} 127.0.0.1"),
        ),
        ("listener 8884", format!("listener {others} 127.0.0.1")),
        ("/etc/mosquitto/server", path(place, "gateway")),
        ("/etc/mosquitto/", path(place, "")),
        ("/var/lib/mosquitto/", path(place, "central/")),
    ];
    let broker = Mosquitto::with_file(
        place.write("central.conf", &delivered("mosquitto.conf", &here)),
        port,
    );
    Central {
        broker,
        others: Mosquitto::tools_for(others),
    }
}

/// What the tools of mosquitto need to be `user` at the central broker.
pub(super) fn as_user(place: &Place, user: &str) -> [String; 6] {
    [
        "--cafile",
        &path(place, "ca.pem"),
        "-u",
        user,
        "-P",
        &password(place, user),
    ]
    .map(str::to_owned)
}

/// A mosquitto on a site, which tells everything to the central one at the port `central`.
pub(super) fn site(place: &Place, central: u16) -> Mosquitto {
    let port = free_port();
    let here = [
        ("central.example:8883", format!("localhost:{central}")),
        ("/etc/mosquitto/ca.pem", path(place, "ca.pem")),
        ("CHANGE-ME", password(place, "site-1")),
    ];
    let head =
        format!("listener {port} 127.0.0.1\nallow_anonymous true\nuser root\nlog_dest stderr\n");
    Mosquitto::with_file(
        place.write(
            "site.conf",
            &(head + &delivered("mosquitto-bridge.conf", &here)),
        ),
        port,
    )
}

pub(super) fn url(scheme: &str, port: u16) -> String {
    format!("{scheme}://localhost:{port}")
}

fn said(output: &Output) -> String {
    [&output.stdout[..], &output.stderr]
        .map(|it| String::from_utf8_lossy(it).into_owned())
        .concat()
}

/// A simulation that was started, up to its first updates.
fn begin(more: &[&str]) -> Started {
    let mut command = fleet_program();
    command.args([&SHAPE[..], &["60"], more].concat());
    let fleet = Started::new(command);
    fleet.wait_for("that it publishes", |line| {
        (fields(line)?["message"] == "fleet is publishing").then_some(())
    });
    fleet
}

/// What it printed at its end.
fn result(mut fleet: Started) -> Value {
    let status = fleet.end_within(END_WITHIN);
    assert!(status.success(), "{}", fleet.text());
    fleet.wait_for("its result", |line| (line == "}").then_some(()));
    // The log is one object a line, the result one over many lines.
    let lines = fleet.find_all(|line| {
        fields(line)
            .is_none_or(|fields| fields.is_null())
            .then(|| line.clone())
    });
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
    assert_eq!(
        (&result["acknowledged_missing"], &result["foreign"]),
        (&0.into(), &0.into()),
        "{result:#}"
    );
}

#[test]
fn gateways_with_a_user_each_on_a_mosquitto_lose_nothing() {
    let place = Place::new();
    make_users(&place);
    let Central { broker, others } = central(&place);
    let (near, far) = (
        url("mqtts", broker.address().port()),
        url("mqtts", others.address().port()),
    );
    let (ca, credentials) = (path(&place, "ca.pem"), path(&place, "users/credentials"));
    let common = [
        "--broker",
        &near,
        "--ca",
        &ca,
        "--credentials",
        &credentials,
        "--prefix",
        "vfd",
        "--seconds",
        "5",
    ];
    let pid = broker.id().to_string();
    let shared = [
        "--consumer-broker",
        &far,
        "--qos",
        "1",
        "--consumers",
        "3",
        "--reading",
        "shared",
        "--watch-pid",
        &pid,
    ];
    let result = result(begin(&[&common[..], &shared].concat()));
    assert_nothing_is_lost(&result);
    assert_eq!(
        (&result["again"], &result["broken"]),
        (&0.into(), &0.into()),
        "{result:#}"
    );
    assert_eq!(result["processes"][1]["name"], "mosquitto");
    assert_eq!(result["connections"], GATEWAYS + 3);

    // Nothing of it is left at the broker.
    let kept = Command::new("mosquitto_sub")
        .args([
            "-h",
            "localhost",
            "-p",
            &others.address().port().to_string(),
        ])
        .args(as_user(&place, "historian"))
        .args(["-t", "vfd/#", "--retained-only", "-W", "2", "-v"])
        .output()
        .unwrap();
    assert_eq!(String::from_utf8_lossy(&kept.stdout), "", "{}", said(&kept));
}

#[test]
fn each_user_publishes_where_it_may_and_nowhere_else() {
    let place = Place::new();
    make_users(&place);
    let Central { broker, others } = central(&place);
    let tell = |broker: &Mosquitto, user: &str, topic: &str| {
        let mut publish = Command::new("mosquitto_pub");
        publish
            .args([
                "-h",
                "localhost",
                "-p",
                &broker.address().port().to_string(),
            ])
            .args(as_user(&place, user));
        said(
            &publish
                .args(["-V", "mqttv5", "-q", "1", "-d", "-t", topic, "-m", "x"])
                .output()
                .unwrap(),
        )
    };
    let allowed = [
        (&broker, "gw-0001", "vfd/gw-0001/drive/pump/run/state"),
        (
            &others,
            "operator",
            "vfd/gw-0001/by/operator/drive/pump/run/set",
        ),
        (
            &others,
            "operator",
            "vfd/site-1/gw-0001/by/operator/drive/pump/lease",
        ),
        (&others, "operator", "vfd/gw-0001/all/run/set"),
    ];
    for (broker, user, topic) in allowed {
        let told = tell(broker, user, topic);
        // 16: nobody has subscribed it.
        assert!(
            told.contains("RC:0") || told.contains("RC:16"),
            "{user} to {topic}: {told}"
        );
    }
    let forbidden = [
        (&broker, "gw-0001", "vfd/gw-0002/drive/pump/run/state"),
        (&broker, "gw-0001", "vfd/gw-0002/drive/pump/run/set"),
        (&broker, "gw-0001", "vfd/all/run/set"),
        // As a gateway of that name would.
        (&others, "historian", "vfd/historian/drive/pump/run/state"),
        (&others, "operator", "vfd/operator/drive/pump/run/state"),
        (&others, "operator", "vfd/gw-0001/drive/pump/run/set"),
        (
            &others,
            "operator",
            "vfd/gw-0001/by/historian/drive/pump/run/set",
        ),
    ];
    for (broker, user, topic) in forbidden {
        let told = tell(broker, user, topic);
        // 135: not authorised.
        assert!(told.contains("RC:135"), "{user} to {topic}: {told}");
    }
    for (broker, user) in [(&broker, "historian"), (&others, "gw-0001")] {
        let told = tell(broker, user, "vfd/x");
        assert!(
            told.contains("Not authorized"),
            "{user} at the listener of others: {told}"
        );
    }
}

#[test]
fn a_gateway_cannot_throw_out_another_one_by_its_identifier() {
    let place = Place::new();
    make_users(&place);
    let Central { broker, others } = central(&place);
    let with_its_identifier = |user| {
        [
            &["-i", "gw-0001"].map(str::to_owned)[..],
            &as_user(&place, user),
        ]
        .concat()
    };
    let subscribe = |user, filter| {
        let more = with_its_identifier(user);
        Subscriber::with(
            &broker,
            "mqttv5",
            filter,
            &more.iter().map(String::as_str).collect::<Vec<_>>(),
        )
    };
    let victim = subscribe("gw-0001", "vfd/gw-0001/#");
    let _thief = subscribe("gw-0002", "vfd/gw-0002/#");
    let operator = as_user(&place, "operator");
    let order = [
        "-t",
        "vfd/gw-0001/by/operator/drive/pump/run/set",
        "-m",
        "stop",
    ];
    let args: Vec<_> = operator.iter().map(String::as_str).chain(order).collect();
    others.publish_with(&args);
    victim.wait_for_payload("drive/pump/run/set", "stop");
    assert_eq!(victim.connects(), 1, "it was thrown out and came back");
}

#[test]
fn wrong_credentials_are_reported_before_anything_is_sent() {
    let place = Place::new();
    make_users(&place);
    let central = central(&place);
    let url = url("mqtts", central.broker.address().port());
    let ca = path(&place, "ca.pem");
    let common = [
        "--broker",
        &url,
        "--ca",
        &ca,
        "--gateways",
        "21",
        "--credentials",
    ];
    let unknown = fleet_program()
        .args([&common[..], &[&path(&place, "users/credentials")]].concat())
        .output()
        .unwrap();
    assert_eq!(unknown.status.code(), Some(2));
    assert!(
        said(&unknown).contains("no line for the user gw-0021"),
        "{}",
        said(&unknown)
    );
    let embedded = fleet_program()
        .args(["--broker", "embedded"])
        .output()
        .unwrap();
    assert_eq!(embedded.status.code(), Some(2));
    assert!(said(&embedded).contains("embedded"), "{}", said(&embedded));
}

#[test]
fn a_site_tells_everything_over_its_bridge_also_what_the_central_broker_missed() {
    let place = Place::new();
    make_users(&place);
    let mut central = central(&place);
    let site = site(&place, central.broker.address().port());
    let (here, there) = (
        url("mqtt", site.address().port()),
        url("mqtts", central.others.address().port()),
    );
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
    central.broker.end();
    central.broker.start_again();
    let result = result(fleet);
    assert_nothing_is_lost(&result);
    assert_eq!(
        result["broken"], 1,
        "the consumer alone is at the central broker: {result:#}"
    );
}

/// Three nodes of NATS as they are delivered.
pub(super) struct Cluster {
    pub nodes: Vec<Node>,
}

pub(super) struct Node {
    program: Option<Started>,
    directory: PathBuf,
    pub mqtt: u16,
    monitor: u16,
}

impl Cluster {
    pub fn start(place: &Place) -> Self {
        let ports: Vec<_> = (0..3)
            .map(|_| [free_port(), free_port(), free_port(), free_port()])
            .collect();
        let routes: Vec<_> = ports
            .iter()
            .map(|[_, route, ..]| format!("\"nats://127.0.0.1:{route}\""))
            .collect();
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
        let mut cluster = Self {
            nodes: nodes.collect(),
        };
        cluster.nodes.iter_mut().for_each(Node::start);
        // Clients are let in before there is a leader, and wait then.
        until("the nodes have a leader", PATIENCE, || {
            let leader = |node: &Node| {
                node.ask("/jsz")?["meta_cluster"]["leader"]
                    .as_str()
                    .map(|it| !it.is_empty())
            };
            cluster
                .nodes
                .iter()
                .all(|node| leader(node) == Some(true))
                .then_some(())
        });
        cluster
    }

    fn urls(&self) -> Vec<String> {
        self.nodes
            .iter()
            .map(|node| url("mqtt", node.mqtt))
            .collect()
    }
}

impl Node {
    fn start(&mut self) {
        let mut command = Command::new("nats-server");
        command.arg("-c").arg(self.directory.join("nats.conf"));
        self.program = Some(Started::new(command));
        until("a node listens", PATIENCE, || {
            TcpStream::connect(("127.0.0.1", self.mqtt)).ok()
        });
    }

    pub fn kill(&mut self) {
        self.program.take().expect("it runs").kill();
    }

    /// What it says of itself.
    fn ask(&self, what: &str) -> Option<Value> {
        let url = format!("http://127.0.0.1:{}{what}", self.monitor);
        // Past any proxy.
        let get = "import sys, urllib.request as it; \
                   print(it.build_opener(it.ProxyHandler({})).open(sys.argv[1], timeout=5).read().decode())";
        let output = Command::new("python3")
            .args(["-c", get, &url])
            .output()
            .unwrap();
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
    let brokers: Vec<_> = urls
        .iter()
        .flat_map(|url| ["--broker", url.as_str()])
        .collect();
    let common = [
        "--credentials",
        &credentials,
        "--prefix",
        "vfd",
        "--mqtt-version",
        "4",
        "--qos",
        "1",
        "--seconds",
        "20",
    ];
    let fleet = begin(&[&common[..], &["--no-retain"], &brokers].concat());
    // The consumer and a third of the gateways are on the first node.
    let taken = |cluster: &Cluster| cluster.nodes[0].ask("/varz")?["in_msgs"].as_u64();
    let before = taken(&cluster).expect("a node that tells");
    until("updates go through the first node", PATIENCE, || {
        taken(&cluster).filter(|count| *count > before + 200)
    });
    cluster.nodes[0].kill();
    let result = result(fleet);
    println!("{result:#}");
    assert_nothing_is_lost(&result);
    assert!(
        result["broken"].as_u64().unwrap() as usize > GATEWAYS / 3,
        "{result:#}"
    );
    cluster.nodes[0].start();
    until("the node is back", PATIENCE, || {
        cluster.nodes[0].ask("/healthz")?["status"]
            .as_str()
            .filter(|it| *it == "ok")
            .map(drop)
    });
}
