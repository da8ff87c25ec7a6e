//! More clients than there is room for: who is let in, who gives way, and that nothing spins meanwhile.

use super::mosquitto::free_port;
use super::raw::Raw;
use super::rig::{Place, fields, simulate};
use super::started::{PATIENCE, Started, until};
use rustix::net::{AddressFamily, SocketType, bind, connect, socket};
use std::io::Write;
use std::net::{IpAddr, Ipv4Addr, SocketAddr, TcpStream};
use std::process::Command;
use std::time::{Duration, Instant};

/// Open files that the gateway may have: few, and no more than the shell grants.
const FILES: usize = 64;
/// Half of them are for clients, and of those a quarter for priority.
const ORDINARY: usize = FILES / 2 / 4 * 3;
const ORDINARY_FROM: Ipv4Addr = Ipv4Addr::LOCALHOST;
const PRIORITY_FROM: Ipv4Addr = Ipv4Addr::new(127, 0, 0, 2);

struct Crowded {
    gateway: Started,
    address: SocketAddr,
    http: SocketAddr,
    _drive: Started,
    _place: Place,
}

impl Crowded {
    fn new() -> Self {
        let place = Place::new();
        let port = place.file("line");
        let drive = simulate(&port);
        let http = SocketAddr::from((Ipv4Addr::LOCALHOST, free_port()));
        let text = format!(
            "[[line]]\nname = \"test\"\nport = \"{}\"\n[[line.drive]]\nname = \"pump-1\"\nmodel = \"hyundai-n700\"\n\
             station = 1\n[[modbus_tcp]]\nlisten = \"127.0.0.1:0\"\nallow = [\"127.0.0.0/8\"]\n\
             priority = [\"{PRIORITY_FROM}/32\"]\n[http]\nlisten = \"{http}\"\n",
            port.display()
        );
        let file = place.write("gateway.toml", &text);
        let mut command = Command::new("sh");
        command
            .env("RUST_LOG", "info")
            .args(["-c", &format!("ulimit -n {FILES} && exec \"$0\" \"$@\"")]);
        command
            .args([
                env!("CARGO_BIN_EXE_vfd-gateway"),
                "--log-format",
                "json",
                "run",
                "-c",
            ])
            .arg(file);
        let gateway = Started::new(command);
        let address = gateway.wait_for("where it listens", |line| {
            let fields = fields(line)?;
            (fields["message"] == "Modbus TCP").then(|| fields["address"].as_str()?.parse().ok())?
        });
        gateway.wait_for("that the drive is there", |line| {
            let fields = fields(line)?;
            (fields["message"] == "drive online").then_some(())
        });
        Self {
            gateway,
            address,
            http,
            _drive: drive,
            _place: place,
        }
    }

    /// A client from one of this host's addresses.
    fn client_from(&self, from: Ipv4Addr) -> Raw {
        let any = SocketAddr::from((from, 0));
        let descriptor = socket(AddressFamily::INET, SocketType::STREAM, None).unwrap();
        bind(&descriptor, &any).unwrap();
        connect(&descriptor, &self.address).unwrap();
        Raw::from(TcpStream::from(descriptor))
    }

    /// A client that was let in and has asked once.
    fn served_from(&self, from: Ipv4Addr) -> Raw {
        let mut client = self.client_from(from);
        assert!(is_served(&mut client), "from {from}");
        client
    }

    /// The descriptors that the gateway has of those which the limit leaves it: one that it inherited may stand above the
    /// limit, which then does not count it.
    fn open_files(&self) -> usize {
        let open = std::fs::read_dir(format!("/proc/{}/fd", self.gateway.id())).unwrap();
        let numbers = open.map(|file| {
            file.unwrap()
                .file_name()
                .into_string()
                .unwrap()
                .parse::<usize>()
                .unwrap()
        });
        numbers.filter(|number| *number < FILES).count()
    }

    /// What the gateway has had of the processors so far, in hundredths of a second.
    fn busy(&self) -> u64 {
        let stat = std::fs::read_to_string(format!("/proc/{}/stat", self.gateway.id())).unwrap();
        let (_, behind) = stat.rsplit_once(')').unwrap();
        behind
            .split_whitespace()
            .skip(11)
            .take(2)
            .map(|ticks| ticks.parse::<u64>().unwrap())
            .sum()
    }

    fn assert_does_not_spin(&self) {
        let (before, begun) = (self.busy(), Instant::now());
        std::thread::sleep(Duration::from_secs(1));
        let busy = (self.busy() - before) as f64 / begun.elapsed().as_secs_f64();
        assert!(
            busy < 50.0,
            "{busy} % of a processor while nobody asks anything"
        );
    }
}

/// Whether the gateway answers it.
fn is_served(client: &mut Raw) -> bool {
    client.is_answered(101, &[3, 0, 0, 0, 1])
}

#[test]
fn a_full_gateway_lets_newcomers_in_instead_of_the_silent_and_priority_always() {
    let crowded = Crowded::new();
    assert_eq!(crowded.address.ip(), IpAddr::V4(ORDINARY_FROM));
    let mut all: Vec<Raw> = (0..ORDINARY)
        .map(|_| crowded.served_from(ORDINARY_FROM))
        .collect();
    assert!(
        is_served(&mut all[0]),
        "so that the second is the one that was silent for longest"
    );
    let mut more: Vec<Raw> = (0..4).map(|_| crowded.served_from(ORDINARY_FROM)).collect();
    let mut urgent: Vec<Raw> = (0..8).map(|_| crowded.served_from(PRIORITY_FROM)).collect();
    for (number, client) in all.iter_mut().enumerate() {
        assert_eq!(
            is_served(client),
            !(1..5).contains(&number),
            "client {number}"
        );
    }
    assert!(urgent.iter_mut().chain(&mut more).all(is_served));
    crowded.assert_does_not_spin();
}

#[test]
fn a_gateway_without_descriptors_still_lets_in_those_who_count_and_does_not_spin() {
    let crowded = Crowded::new();
    let mut clients: Vec<Raw> = (0..8).map(|_| crowded.served_from(ORDINARY_FROM)).collect();
    // Something else uses all that is left: requests that never end, at another listener.
    let mut hogs = Vec::new();
    until("no descriptor is left", PATIENCE, || {
        let mut hog = TcpStream::connect(crowded.http).unwrap();
        hog.write_all(b"GET").unwrap();
        hogs.push(hog);
        // Some are open for a moment only.
        let is_full = || crowded.open_files() >= FILES;
        (is_full()
            && (0..10).all(|_| {
                std::thread::sleep(Duration::from_millis(10));
                is_full()
            }))
        .then_some(())
    });
    let mut newcomer = crowded.served_from(ORDINARY_FROM);
    let mut urgent = crowded.served_from(PRIORITY_FROM);
    assert!(is_served(&mut newcomer) && is_served(&mut urgent));
    let gone = clients
        .iter_mut()
        .map(|client| !is_served(client))
        .collect::<Vec<_>>();
    let lost = gone.iter().filter(|it| **it).count();
    assert!(
        (1..=6).contains(&lost) && gone[..lost].iter().all(|it| *it),
        "the first ones gave way: {gone:?}"
    );
    crowded.assert_does_not_spin();
    drop(hogs);
    until("all is well again", PATIENCE, || {
        is_served(&mut crowded.client_from(ORDINARY_FROM)).then_some(())
    });
}
