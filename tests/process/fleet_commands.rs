//! The gateway that `docs/fleet.md` configures takes commands from the centre: over the bridge of a site, and from a cluster of NATS.

use super::fleet::{Cluster, Node, as_user, central, make_users, password, site};
use super::half_open::Relay;
use super::mosquitto::{Mosquitto, Subscriber};
use super::rig::{Place, simulate, start, text_of};
use super::started::{PATIENCE, Started, until};
use serde_json::{Value, json};
use std::time::{SystemTime, UNIX_EPOCH};

/// A drive and the gateway of the guide, with other values in the place of those that `here` names.
fn gateway(place: &Place, here: &[(&str, String)]) -> [Started; 2] {
    let guide = text_of("docs/fleet.md");
    let block = guide
        .split("```toml\n")
        .nth(1)
        .unwrap()
        .split("```")
        .next()
        .unwrap();
    let line = place.file("line");
    let secret = place.write("password", &password(place, "gw-0001"));
    let paths = [
        ("/dev/ttyUSB0", line.display().to_string()),
        ("/run/secrets/mqtt", secret.display().to_string()),
    ];
    let text = here
        .iter()
        .chain(&paths)
        .fold(block.to_owned(), |text, (there, here)| {
            assert!(text.contains(there), "the guide has no {there}");
            text.replace(there, here)
        });
    let drive = simulate(&line);
    let file = place.write("gateway.toml", &text);
    [drive, start(&["run", "-c", file.to_str().unwrap()])]
}

/// Somebody at `broker` who commands the drive of the gateway below `base`, and sees what becomes of it.
struct Centre {
    broker: Mosquitto,
    base: &'static str,
    /// What the tools of mosquitto need to be the commander.
    operator: Vec<String>,
    seen: Subscriber,
}

impl Centre {
    fn new(
        broker: Mosquitto,
        version: &str,
        base: &'static str,
        [operator, reader]: [Vec<String>; 2],
    ) -> Self {
        let reader: Vec<_> = reader.iter().map(String::as_str).collect();
        let seen = Subscriber::with(&broker, version, &format!("{base}/#"), &reader);
        Self {
            broker,
            base,
            operator,
            seen,
        }
    }

    fn publish(&self, topic: &str, payload: &str) {
        self.try_publish(topic, payload).unwrap();
    }

    fn try_publish(&self, topic: &str, payload: &str) -> Result<(), String> {
        let topic = format!("{}/{topic}", self.base);
        let operator = self.operator.iter().map(String::as_str);
        self.broker.try_publish_with(
            &operator
                .chain(["-t", &topic, "-m", payload])
                .collect::<Vec<_>>(),
        )
    }

    fn order(&self, rest: &str, payload: &str) {
        self.publish(&format!("by/operator/drive/pump-1/{rest}"), payload);
    }

    /// Each document of the drive that came so far.
    fn documents(&self) -> Vec<Value> {
        self.seen
            .on("drive/pump-1/state")
            .iter()
            .filter_map(|it| serde_json::from_str(&it.payload).ok())
            .collect()
    }

    /// Waits until the newest document has `run_state`, and returns that document.
    fn wait_for_state(&self, run_state: &str) -> Value {
        until(run_state, PATIENCE, || {
            self.documents()
                .pop()
                .filter(|it| it["run_state"] == run_state)
        })
    }

    /// What became of the command `id`, as far as it came.
    fn results(&self, id: &str) -> Vec<Value> {
        let all = self.seen.on("drive/pump-1/result");
        all.iter()
            .filter_map(|it| serde_json::from_str(&it.payload).ok())
            .filter(|it: &Value| it["id"] == id)
            .collect()
    }

    fn run_now(&self) {
        let issued_at = SystemTime::now()
            .duration_since(UNIX_EPOCH)
            .unwrap()
            .as_millis() as u64;
        let run =
            json!({"id": "run", "frequency_hz": 20, "run": "forward", "issued_at": issued_at});
        self.order("command", &run.to_string());
        assert_eq!(
            self.seen.results("run").last().unwrap()["outcome"],
            "acknowledged",
            "{:?}",
            self.results("run")
        );
        self.wait_for_state("forward");
    }
}

#[test]
fn a_site_is_commanded_over_its_bridge_and_what_came_while_it_was_lost_moves_nothing() {
    let place = Place::new();
    make_users(&place);
    let far = central(&place);
    let way = Relay::default();
    let site = site(&place, way.start(far.broker.address().port()));
    let _running = gateway(
        &place,
        &[
            (
                "mqtts://broker.example:8883",
                format!("mqtt://127.0.0.1:{}", site.address().port()),
            ),
            ("ca_file = \"/etc/vfd-gateway/ca.pem\"\n", String::new()),
            ("prefix = \"vfd\"", "prefix = \"vfd/site-1\"".to_owned()),
        ],
    );
    let users = ["operator", "historian"].map(|user| as_user(&place, user).to_vec());
    let centre = Centre::new(far.others, "mqttv5", "vfd/site-1/gw-0001", users);
    centre.seen.wait_for_payload("gw-0001/status", "online");
    let epoch = centre.wait_for_state("stopped")["control"]["epoch"].clone();

    way.cut();
    let late = json!({"id": "late", "frequency_hz": 20, "run": "forward", "epoch": epoch});
    centre.order("command", &late.to_string());
    way.mend();
    // Behind it on the same way.
    until("a later command arrives", PATIENCE, || {
        centre.order("command", r#"{"id": "later", "frequency_hz": 21}"#);
        centre.results("later").pop()
    });
    assert_eq!(
        centre.results("late"),
        [] as [Value; 0],
        "it waited, and came"
    );
    centre.wait_for_state("stopped");

    centre.run_now();
    let lease = |document: &Value| {
        document["control"]["lease_until"]
            .as_str()
            .map(str::to_owned)
    };
    let first = lease(&centre.wait_for_state("forward"));
    assert!(first.is_some());
    until("a lease is renewed over the bridge", PATIENCE, || {
        centre.order("lease", "x");
        centre.documents().pop().filter(|it| lease(it) > first)
    });
    centre.publish("all/run/set", "stop");
    centre.wait_for_state("stopped");
}

/// The gateway of the guide at the first two nodes, with what the guide adds at NATS, and a commander at the third one.
fn at_nats(place: &Place, cluster: &Cluster) -> ([Started; 2], Centre) {
    let guide = text_of("docs/fleet.md");
    let keys = guide
        .split("## Gateways at NATS")
        .nth(1)
        .unwrap()
        .split("```\n")
        .nth(1)
        .unwrap();
    let at = |node: usize| format!("mqtt://127.0.0.1:{}", cluster.nodes[node].mqtt);
    let also_at = keys
        .lines()
        .find(|line| line.starts_with("also_at = "))
        .unwrap();
    let keys = keys.replace(also_at, &format!("also_at = [\"{}\"]", at(1)));
    let running = gateway(
        place,
        &[
            ("mqtts://broker.example:8883", at(0)),
            ("ca_file = \"/etc/vfd-gateway/ca.pem\"\n", String::new()),
            ("prefix = \"vfd\"\n", format!("prefix = \"vfd\"\n{keys}")),
        ],
    );
    let user = |name: &str| {
        ["-V", "mqttv311", "-u", name, "-P", &password(place, name)]
            .map(str::to_owned)
            .to_vec()
    };
    let (operator, reader) = (user("operator"), user("historian")[2..].to_vec());
    let broker = Mosquitto::tools_for(cluster.nodes[2].mqtt);
    (
        running,
        Centre::new(broker, "mqttv311", "vfd/gw-0001", [operator, reader]),
    )
}

/// `tests/run fleet` installs what it needs and runs it.
#[test]
#[ignore = "needs nats-server, which `tests/run fleet` installs"]
fn a_gateway_at_a_cluster_of_nats_obeys_and_goes_on_at_another_node() {
    let place = Place::new();
    make_users(&place);
    let mut cluster = Cluster::start(&place);
    let ([_drive, gateway], centre) = at_nats(&place, &cluster);
    centre.seen.wait_for_payload("gw-0001/status", "online");
    centre.wait_for_state("stopped");
    centre.run_now();
    // While the cluster begins it may have gone on already.
    let connected = |line: &str| {
        line.contains("connected to the broker")
            .then(|| line.to_owned())
    };
    let last = gateway.find_all(|line| connected(line)).pop().unwrap();
    let is_at = |node: &Node, line: &str| line.contains(&format!("\"port\":{}}}", node.mqtt));
    let node = cluster
        .nodes
        .iter()
        .position(|node| is_at(node, &last))
        .unwrap();
    cluster.nodes[node].kill();
    let begun = std::time::Instant::now();
    until("the gateway is at the other node", 4 * PATIENCE, || {
        let seen = gateway.find_all(|line| connected(line));
        seen.last()
            .filter(|line| is_at(&cluster.nodes[1 - node], line))
            .map(|_| ())
    });
    until(
        "a setpoint is taken at the other node",
        3 * PATIENCE,
        || {
            // While the nodes have no leader they end connections.
            let topic = "by/operator/drive/pump-1/command";
            let _ = centre.try_publish(topic, r#"{"id": "there", "frequency_hz": 21}"#);
            centre.results("there").pop()
        },
    );
    eprintln!(
        "heard at another node {:?} after the first one was killed",
        begun.elapsed()
    );
    centre.order("run/set", "stop");
    centre.wait_for_state("stopped");
    let refused = gateway.find_all(|line| line.contains("did not grant").then(|| line.clone()));
    assert_eq!(refused, [] as [String; 0]);
}
