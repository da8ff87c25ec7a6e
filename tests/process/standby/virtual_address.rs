//! keepalived as it stands, with the configuration of `deploy/keepalived`, moves one address to the gateway that is active:
//! two hosts and a client on a switch, each a network namespace of its own.

use super::super::outsiders::mbpoll_output;
use super::super::rig::{Place, text_of, vfd_gateway};
use super::super::started::{Started, until};
use super::pair::{A, B, PATIENCE, Pair, Wish, other};
use std::process::{Command, Output};

/// As in `deploy/keepalived/keepalived.conf`.
const VIRTUAL: &str = "192.0.2.40";

/// A network of two hosts and a client. It ends with the processes that hold its namespaces.
struct Network {
    client: Started,
    hosts: [Started; 2],
}

impl Network {
    fn new() -> Self {
        // A user who is not root becomes it in a user namespace, as far as the network is concerned.
        let is_root = rustix::process::geteuid().is_root();
        let mut outer = Command::new("unshare");
        outer.args([
            if is_root { "-n" } else { "-rn" },
            "sh",
            "-c",
            "echo ready; exec sleep infinity",
        ]);
        let client = ready(outer);
        let hosts = [(); 2].map(|()| {
            ready(inside(
                &client,
                &[
                    "unshare",
                    "-n",
                    "sh",
                    "-c",
                    "echo ready; exec sleep infinity",
                ],
            ))
        });
        let network = Self { client, hosts };
        network.on_client(
            "ip link set lo up && ip link add name switch type bridge && ip link set switch up",
        );
        network.on_client("ip addr add 192.0.2.100/24 dev switch");
        for (number, host) in network.hosts.iter().enumerate() {
            let (name, pid, address) = (format!("to-{number}"), host.id(), number + 1);
            network.on_client(&format!(
                "ip link add name {name} type veth peer name eth0 netns {pid} && ip link set {name} master switch up"
            ));
            let on_host = format!(
                "ip link set lo up && ip link set eth0 up && ip addr add 192.0.2.{address}/24 dev eth0"
            );
            assert_done(&run(network.on_host(number, &["sh", "-c", &on_host])));
        }
        network
    }

    #[track_caller]
    fn on_client(&self, script: &str) {
        assert_done(&run(inside(&self.client, &["sh", "-c", script])));
    }

    fn on_host(&self, number: usize, words: &[&str]) -> Command {
        inside(&self.hosts[number], words)
    }

    /// Whether the virtual address is at this host.
    fn is_virtual_at(&self, number: usize) -> bool {
        let output = run(self.on_host(number, &["ip", "-br", "addr", "show", "dev", "eth0"]));
        String::from_utf8_lossy(&output.stdout).contains(&format!("{VIRTUAL}/"))
    }

    /// The output frequency of the drive at station 1 in 0.01 Hz, read by mbpoll at the virtual address.
    fn output(&self) -> Option<u16> {
        let words = [
            "mbpoll", "-m", "tcp", "-p", "1502", "-a", "1", "-0", "-1", "-r", "257", "-c", "1",
            VIRTUAL,
        ];
        mbpoll_output(&mut inside(&self.client, &words))
            .values
            .first()
            .copied()
    }
}

/// `words` in the namespaces of `program`.
fn inside(program: &Started, words: &[&str]) -> Command {
    let mut command = Command::new("nsenter");
    // What configures a network is not in everybody's path.
    let path = std::env::var("PATH").unwrap_or_default();
    command
        .args(entering(program))
        .args(words)
        .env("PATH", format!("{path}:/usr/sbin:/sbin"));
    command
}

/// What makes nsenter enter the namespaces of `program`.
fn entering(program: &Started) -> Vec<String> {
    let mut words = vec!["-t".to_owned(), program.id().to_string(), "-n".to_owned()];
    if !rustix::process::geteuid().is_root() {
        words.extend(["-U".to_owned(), "--preserve-credentials".to_owned()]);
    }
    words
}

/// Starts a program that says when it is ready.
fn ready(command: Command) -> Started {
    let started = Started::new(command);
    started.wait_for("that it is ready", |line| (line == "ready").then_some(()));
    started
}

fn run(mut command: Command) -> Output {
    command.output().unwrap()
}

#[track_caller]
fn assert_done(output: &Output) {
    assert!(
        output.status.success(),
        "{}",
        String::from_utf8_lossy(&output.stderr)
    );
}

/// keepalived on a host of the pair, with the delivered configuration and the places of this test in it.
fn keepalived(network: &Network, number: usize, place: &Place, pair: &Pair) -> Started {
    let end = [A, B][number];
    let config = pair.half(end).file.display().to_string();
    let mut text = text_of("deploy/keepalived/keepalived.conf");
    for (delivered, ours) in [
        ("/usr/bin/vfd-gateway", env!("CARGO_BIN_EXE_vfd-gateway")),
        ("/etc/vfd-gateway/vfd-gateway.toml", &config),
        // The gateways of this test run as the user of this test.
        (
            "script_user vfd-gateway vfd-gateway",
            "script_user root root",
        ),
        // The directories of a developer may be open to a group.
        ("enable_script_security", ""),
    ] {
        assert!(text.contains(delivered), "no {delivered}");
        text = text.replace(delivered, ours);
    }
    let file = place.write(&format!("keepalived-{number}.conf"), &text);
    let option = |name: &str, file: &str| {
        format!(
            "{name}={}",
            place.file(&format!("{file}-{number}")).display()
        )
    };
    let words = [
        "keepalived".to_owned(),
        "--dont-fork".to_owned(),
        "--log-console".to_owned(),
        format!("--use-file={}", file.display()),
        option("--pid", "keepalived.pid"),
        option("--vrrp_pid", "vrrp.pid"),
    ];
    Started::new(network.on_host(number, &words.each_ref().map(String::as_str)))
}

#[test]
fn one_address_follows_the_active_gateway_and_clients_read_through_it() {
    let network = Network::new();
    let mut pair = Pair::with(Wish {
        listen: ["0.0.0.0:1502"; 2],
        write: "192.0.2.0/24",
        ..Wish::at(9_600)
    });
    for (number, half) in pair.halves.iter_mut().enumerate() {
        half.inside = [vec!["nsenter".to_owned()], entering(&network.hosts[number])].concat();
    }
    pair.start_one_behind_the_other();
    let place = Place::new();
    let keepers = [0, 1].map(|number| keepalived(&network, number, &place, &pair));
    let at = |end: usize| usize::from(end == B);
    let follows = |pair: &Pair, end: usize| {
        until(&format!("the address is at {end}"), PATIENCE, || {
            (network.is_virtual_at(at(end)) && !network.is_virtual_at(at(other(end)))).then_some(())
        });
        until("the drive is read there", PATIENCE, || network.output());
        let active = |end: usize| {
            let config = pair.half(end).file.to_str().unwrap();
            vfd_gateway(&["health", "--active", "-c", config])
                .status
                .code()
        };
        assert_eq!(active(end), Some(0), "{}", keepers[at(end)].text());
    };
    follows(&pair, A);
    assert_eq!(network.output(), Some(0));
    pair.kill(A);
    follows(&pair, B);
    // The one that is back listens, and the address stays.
    pair.start(A);
    let seen = pair.hub.count();
    pair.wait_for_requests(B, 60, seen);
    follows(&pair, B);
    pair.assert_one_master();
}
