//! `diagnose`: an archive that other programs read, with what helps and without secrets, whether the gateway runs or not.

use super::rig::{Place, assert_says, start, vfd_gateway};
use super::started::{PATIENCE, Started, until};
use std::os::unix::net::UnixStream;
use std::path::Path;
use std::process::Command;

const SECRET: &str =
    "$argon2id$v=19$m=19456,t=2,p=1$c2VjcmV0c2VjcmV0$YWJjZGVmZ2hpamtsbW5vcHFyc3R1dnd4eXoxMjM0NTY";

struct Hall {
    place: Place,
    _drive: Started,
}

impl Hall {
    fn new() -> Self {
        let place = Place::new();
        let port = place.file("line");
        let drive = start(&[
            "simulate",
            "--model",
            "hyundai-n700",
            "--link",
            port.to_str().unwrap(),
        ]);
        drive.wait_for("that it plays", |line| {
            line.contains("station 1").then_some(())
        });
        let text = format!(
            "[gateway]\nname = \"plant-a\"\ndata_dir = \"{}\"\n\n[http]\nlisten = \"127.0.0.1:0\"\n\n[[http.users]]\n\
             name = \"anna\"\npassword_hash = \"{SECRET}\"\n\n[[line]]\nname = \"hall-1\"\nport = \"{}\"\n\n\
             [[line.drive]]\nname = \"pump-1\"\nmodel = \"hyundai-n700\"\nstation = 1\npoll = \"100ms\"\n",
            place.file("data").display(),
            port.display()
        );
        place.write("gateway.toml", &text);
        Self {
            place,
            _drive: drive,
        }
    }

    /// Has an archive made, which must not exist, and unpacks it with the system's own program.
    fn diagnose(&self, out: &str, more: &[&str]) -> (std::process::Output, String) {
        let (config, out) = (self.place.file("gateway.toml"), self.place.file(out));
        let args = [
            &[
                "diagnose",
                "-c",
                config.to_str().unwrap(),
                "--out",
                out.to_str().unwrap(),
            ],
            more,
        ]
        .concat();
        let output = vfd_gateway(&args);
        let unpacked = Command::new("tar")
            .arg("-xzf")
            .arg(&out)
            .arg("-C")
            .arg(self.place.file(""))
            .output()
            .unwrap();
        assert!(unpacked.status.success(), "{unpacked:?} {output:?}");
        let listed = Command::new("tar").arg("-tzf").arg(&out).output().unwrap();
        (output, String::from_utf8(listed.stdout).unwrap())
    }

    /// The unpacked file at the end of whose path `name` stands.
    fn unpacked(&self, listed: &str, name: &str) -> Vec<u8> {
        let path = listed
            .lines()
            .find(|path| path.ends_with(name))
            .unwrap_or_else(|| panic!("no {name} in {listed}"));
        std::fs::read(self.place.file(path)).unwrap()
    }

    fn text(&self, listed: &str, name: &str) -> String {
        String::from_utf8(self.unpacked(listed, name)).unwrap()
    }
}

fn tshark_frames(file: &Path) -> usize {
    let output = Command::new("tshark").arg("-r").arg(file).output().unwrap();
    String::from_utf8_lossy(&output.stdout)
        .lines()
        .filter(|line| line.contains("Modbus"))
        .count()
}

#[test]
fn a_running_gateway_tells_everything_but_secrets() {
    let hall = Hall::new();
    let gateway = start(&[
        "run",
        "-c",
        hall.place.file("gateway.toml").to_str().unwrap(),
    ]);
    gateway.wait_for("that the drive is there", |line| {
        line.contains("drive online").then_some(())
    });
    let socket = hall.place.file("data/vfd-gateway.sock");
    until("the gateway is reached", PATIENCE, || {
        UnixStream::connect(&socket).ok()
    });
    let (output, listed) = hall.diagnose("d.tar.gz", &["--seconds", "2"]);
    assert_says(&output, 0, &["d.tar.gz", "without passwords"]);
    assert!(
        listed
            .lines()
            .all(|path| path.starts_with("vfd-gateway-plant-a-")),
        "{listed}"
    );
    let configuration = hall.text(&listed, "configuration.toml");
    assert!(
        configuration.contains("name = \"anna\"") && !configuration.contains("argon2id"),
        "{configuration}"
    );
    assert!(hall.text(&listed, "log.txt").contains("drive online"));
    assert!(hall.text(&listed, "about.json").contains("\"version\""));
    assert!(hall.text(&listed, "health.json").contains("\"pump-1\""));
    assert!(hall.text(&listed, "metrics.txt").contains("vfd_"));
    assert!(
        hall.text(&listed, "journal.csv")
            .starts_with("table,number,at")
    );
    assert!(
        hall.text(&listed, "lines/hall-1/report.json")
            .contains("\"verdict\"")
    );
    let traffic = hall.place.write("traffic.pcapng", "");
    std::fs::write(
        &traffic,
        hall.unpacked(&listed, "lines/hall-1/traffic.pcapng"),
    )
    .unwrap();
    assert!(tshark_frames(&traffic) > 4, "{listed}");
    // Nothing is overwritten.
    let again = vfd_gateway(&[
        "diagnose",
        "-c",
        hall.place.file("gateway.toml").to_str().unwrap(),
        "--out",
        hall.place.file("d.tar.gz").to_str().unwrap(),
    ]);
    assert_says(&again, 1, &["File exists"]);
}

#[test]
fn of_a_gateway_that_does_not_run_what_is_known_is_told() {
    let hall = Hall::new();
    let (output, listed) = hall.diagnose("d.tar.gz", &[]);
    assert_says(
        &output,
        0,
        &["cannot connect", "only what is known without it"],
    );
    assert!(
        hall.text(&listed, "gateway.txt").contains("cannot connect"),
        "{listed}"
    );
    assert!(
        !hall
            .text(&listed, "configuration.toml")
            .contains("argon2id")
    );
    assert_eq!(hall.text(&listed, "check.txt"), "no problems\n");
    let nobody = vfd_gateway(&[
        "diagnose",
        "--socket",
        "/nonexistent",
        "--out",
        hall.place.file("e").to_str().unwrap(),
    ]);
    assert_says(&nobody, 1, &["/nonexistent", "with --config FILE"]);
    assert!(!hall.place.file("e").exists());
}
