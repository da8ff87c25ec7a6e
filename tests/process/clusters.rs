//! The Kubernetes files: each is held strictly against the schemas of Kubernetes, all of them against each other and against
//! the configuration beside them; and the gateway answers the probes over its socket.

use super::mosquitto::free_port;
use super::outsiders::documents_of;
use super::rig::{Place, fields, simulate, start, vfd_gateway};
use super::started::{PATIENCE, Started, until};
use serde_json::{Value, json};
use std::path::{Path, PathBuf};

/// How long the end of the gateway may take: the declared actions and the last words to the broker.
const END_MAX_S: u64 = 7;

fn folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("deploy/kubernetes")
}

/// Everything that kustomization.yaml lists, and the device plugin.
struct Manifests(Vec<Value>);

impl Manifests {
    fn read() -> Self {
        let kustomization = documents_of("yaml", &[folder().join("kustomization.yaml")]).remove(0);
        let listed = kustomization["resources"]
            .as_array()
            .unwrap()
            .iter()
            .map(|it| folder().join(it.as_str().unwrap()));
        let files: Vec<_> = listed
            .chain([folder().join("device-plugin.yaml")])
            .collect();
        Self(documents_of("kubernetes", &files))
    }

    fn all(&self, kind: &str) -> Vec<&Value> {
        self.0.iter().filter(|it| it["kind"] == kind).collect()
    }

    fn only(&self, kind: &str) -> &Value {
        let [it] = self.all(kind)[..] else {
            panic!("one {kind}")
        };
        it
    }

    fn pod(&self) -> &Value {
        &self.only("StatefulSet")["spec"]["template"]
    }
}

fn configuration() -> String {
    std::fs::read_to_string(folder().join("gateway/vfd-gateway.toml")).unwrap()
}

#[test]
fn every_file_is_listed_and_meets_the_schema() {
    let manifests = Manifests::read();
    assert!(manifests.0.len() > 6);
    let kustomization = documents_of("yaml", &[folder().join("kustomization.yaml")]).remove(0);
    let text = kustomization.to_string();
    for entry in std::fs::read_dir(folder()).unwrap() {
        let name = entry.unwrap().file_name().into_string().unwrap();
        let is_listed = text.contains(&name)
            || ["kustomization.yaml", "device-plugin.yaml"].contains(&name.as_str());
        assert!(
            is_listed || !name.ends_with(".yaml"),
            "{name} is not applied"
        );
    }
    let namespace = &manifests.only("Namespace")["metadata"]["name"];
    assert_eq!(&kustomization["namespace"], namespace);
}

#[test]
fn two_gateways_never_own_one_line_and_nothing_ends_one_by_itself() {
    let manifests = Manifests::read();
    let set = &manifests.only("StatefulSet")["spec"];
    // A Deployment starts a second pod while the host of the first is out of sight.
    assert!(manifests.all("Deployment").is_empty());
    assert_eq!(
        (&set["replicas"], &set["updateStrategy"]["type"]),
        (&1.into(), &"OnDelete".into())
    );
    let pod = &manifests.pod()["spec"];
    assert!(pod["terminationGracePeriodSeconds"].as_u64().unwrap() > END_MAX_S);
    let labels = &manifests.pod()["metadata"]["labels"];
    let rules =
        &pod["affinity"]["podAntiAffinity"]["requiredDuringSchedulingIgnoredDuringExecution"][0];
    assert_eq!(&rules["labelSelector"]["matchLabels"], labels);
    let budget = &manifests.only("PodDisruptionBudget")["spec"];
    assert_eq!(
        (
            &budget["maxUnavailable"],
            &budget["selector"]["matchLabels"]
        ),
        (&0.into(), labels)
    );
    let endured = pod["tolerations"].as_array().unwrap();
    for taint in [
        "node.kubernetes.io/unreachable",
        "node.kubernetes.io/not-ready",
    ] {
        let toleration = endured.iter().find(|it| it["key"] == taint).unwrap();
        assert_eq!(
            (&toleration["effect"], &toleration["tolerationSeconds"]),
            (&"NoExecute".into(), &Value::Null)
        );
    }
    let container = &pod["containers"][0];
    let asked = |probe: &str| container[probe]["exec"]["command"].clone();
    let alive = json!(["vfd-gateway", "health", "--alive"]);
    assert_eq!(
        (asked("startupProbe"), asked("livenessProbe")),
        (alive.clone(), alive)
    );
    assert_eq!(asked("readinessProbe"), json!(["vfd-gateway", "health"]));
    for service in manifests.all("Service") {
        assert_eq!(&service["spec"]["selector"], labels);
        assert_eq!(
            service["spec"]["publishNotReadyAddresses"], true,
            "a line that is down cuts off the others"
        );
    }
    assert_eq!(
        &manifests.only("NetworkPolicy")["spec"]["podSelector"]["matchLabels"],
        labels
    );
    assert_eq!(
        pod["priorityClassName"],
        manifests.only("PriorityClass")["metadata"]["name"]
    );
}

/// It may do everything on its host.
#[test]
fn the_device_plugin_is_a_known_one_where_an_adapter_is_and_changes_when_somebody_says_so() {
    let manifests = Manifests::read();
    let plugin = &manifests.only("DaemonSet")["spec"];
    assert_eq!(plugin["updateStrategy"]["type"], "OnDelete");
    let pod = &plugin["template"]["spec"];
    let (_, sum) = pod["containers"][0]["image"]
        .as_str()
        .unwrap()
        .split_once("@sha256:")
        .unwrap();
    assert!(
        sum.len() == 64 && sum.bytes().all(|it| it.is_ascii_hexdigit()),
        "{sum}"
    );
    assert_eq!(
        pod["affinity"]["nodeAffinity"],
        manifests.pod()["spec"]["affinity"]["nodeAffinity"]
    );
}

#[test]
fn the_pod_has_what_its_configuration_names() {
    let manifests = Manifests::read();
    let file: toml::Table = configuration().parse().unwrap();
    let container = &manifests.pod()["spec"]["containers"][0];
    let port = |listen: &toml::Value| {
        listen
            .as_str()
            .unwrap()
            .rsplit_once(':')
            .unwrap()
            .1
            .parse::<u64>()
            .unwrap()
    };
    let named = |name: &str| {
        let ports = container["ports"].as_array().unwrap();
        ports.iter().find(|it| it["name"] == name).unwrap()["containerPort"]
            .as_u64()
            .unwrap()
    };
    assert_eq!(named("modbus"), port(&file["modbus_tcp"][0]["listen"]));
    assert_eq!(named("http"), port(&file["http"]["listen"]));
    let mounted: Vec<_> = container["volumeMounts"]
        .as_array()
        .unwrap()
        .iter()
        .map(|it| it["mountPath"].as_str().unwrap())
        .collect();
    for path in [
        &file["gateway"]["data_dir"],
        &file["mqtt"]["password_file"],
        &file["mqtt"]["ca_file"],
    ] {
        let path = path.as_str().unwrap();
        assert!(
            mounted.iter().any(|it| path.starts_with(it)),
            "nothing is mounted for {path}"
        );
    }
    let plugin = &manifests.only("DaemonSet")["spec"]["template"]["spec"]["containers"][0]["args"];
    let args: Vec<_> = plugin
        .as_array()
        .unwrap()
        .iter()
        .map(|it| it.as_str().unwrap())
        .collect();
    let after = |name: &str| args[args.iter().position(|it| *it == name).unwrap() + 1];
    let place = Place::new();
    let device = documents_of("yaml", &[place.write("device.yaml", after("--device"))]).remove(0);
    let resource = format!("{}/{}", after("--domain"), device["name"].as_str().unwrap());
    assert_eq!(container["resources"]["limits"][&resource], 1, "{resource}");
    assert_eq!(
        device["groups"][0]["paths"][0]["mountPath"].as_str(),
        file["line"][0]["port"].as_str()
    );
    let secured = &container["securityContext"];
    assert_eq!(
        (
            &secured["readOnlyRootFilesystem"],
            &secured["allowPrivilegeEscalation"]
        ),
        (&true.into(), &false.into())
    );
    assert_eq!(
        manifests.pod()["spec"]["securityContext"]["runAsNonRoot"],
        true
    );
}

/// The gateway of the pod on this machine, with a drive.
struct Pod {
    socket: PathBuf,
    drive: Started,
    _gateway: Started,
    _place: Place,
}

impl Pod {
    /// With `broker` as its section `[mqtt]`.
    fn new(broker: &str) -> Self {
        let place = Place::new();
        let (line, data) = (place.file("line"), place.file("data"));
        std::fs::create_dir(&data).unwrap();
        let drive = simulate(&line);
        let text = configuration();
        let (before, there) = text.split_once("[mqtt]").unwrap();
        let (_, after) = there.split_once("# The controllers' network").unwrap();
        let text = format!("{before}{broker}\n# {after}");
        let here = [
            ("/dev/vfd-line-1", line.to_str().unwrap()),
            ("/var/lib/vfd-gateway", data.to_str().unwrap()),
            ("0.0.0.0:1502", "127.0.0.1:0"),
            ("0.0.0.0:8080", "127.0.0.1:0"),
        ];
        let text = here.iter().fold(text, |text, (there, here)| {
            assert!(text.contains(there), "no {there}");
            text.replace(there, here)
        });
        let file = place.write("gateway.toml", &text);
        let gateway = start(&["run", "-c", file.to_str().unwrap()]);
        gateway.wait_for("that the drive is there", |line| {
            let fields = fields(line)?;
            (fields["message"] == "drive online").then_some(())
        });
        Self {
            socket: data.join("vfd-gateway.sock"),
            drive,
            _gateway: gateway,
            _place: place,
        }
    }

    /// Whether the gateway says yes to what the manifests have as `probe`.
    fn passes(&self, probe: &Value) -> bool {
        let words: Vec<_> = probe["exec"]["command"]
            .as_array()
            .unwrap()
            .iter()
            .map(|it| it.as_str().unwrap())
            .collect();
        assert_eq!(words[0], "vfd-gateway");
        // In the image it lies where it is looked for.
        let output =
            vfd_gateway(&[&words[1..], &["--socket", self.socket.to_str().unwrap()]].concat());
        assert!(
            matches!(output.status.code(), Some(0 | 1)),
            "{words:?}: {output:?}"
        );
        output.status.success()
    }
}

#[test]
fn the_probes_are_answered_and_a_broker_or_a_line_that_is_away_restarts_nothing() {
    let manifests = Manifests::read();
    let container = &manifests.pod()["spec"]["containers"][0];
    let probes = ["startupProbe", "livenessProbe", "readinessProbe"];
    let answers = |pod: &Pod| probes.map(|probe| pod.passes(&container[probe]));
    let mut pod = Pod::new("");
    // What the log says of a drive is shown a moment later.
    until("that it is ready", PATIENCE, || {
        pod.passes(&container["readinessProbe"]).then_some(())
    });
    assert_eq!(answers(&pod), [true, true, true]);
    pod.drive.kill();
    until("that the line is gone", PATIENCE, || {
        (!pod.passes(&container["readinessProbe"])).then_some(())
    });
    assert_eq!(answers(&pod), [true, true, false]);
    // Its gateway may still hold the name of the pseudo-terminal, which the next drive may get.
    drop(pod);
    let away = format!("[mqtt]\nbroker = \"mqtt://127.0.0.1:{}\"\n", free_port());
    assert_eq!(answers(&Pod::new(&away)), [true, true, false]);
}
