//! The real program in its roles, each test in a directory of its own.

use super::started::Started;
use rustix::fs::OFlags;
use std::fs::File;
use std::net::SocketAddr;
use std::os::unix::fs::OpenOptionsExt;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use std::sync::atomic::{AtomicU32, Ordering};
use std::sync::{Mutex, MutexGuard, PoisonError};

/// What stands at `path` of this repository.
#[track_caller]
pub fn text_of(path: &str) -> String {
    std::fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join(path)).unwrap()
}

/// A directory that is gone after the test.
pub struct Place {
    path: PathBuf,
}

impl Place {
    pub fn new() -> Self {
        static COUNT: AtomicU32 = AtomicU32::new(0);
        let number = COUNT.fetch_add(1, Ordering::Relaxed);
        let path =
            std::env::temp_dir().join(format!("vfd-gateway-test-{}-{number}", std::process::id()));
        std::fs::create_dir(&path).unwrap();
        Self { path }
    }

    pub fn file(&self, name: &str) -> PathBuf {
        self.path.join(name)
    }

    pub fn write(&self, name: &str, text: &str) -> PathBuf {
        let file = self.file(name);
        std::fs::write(&file, text).unwrap();
        file
    }
}

impl Drop for Place {
    fn drop(&mut self) {
        // What is left in the temporary directory harms nobody.
        let _ = std::fs::remove_dir_all(&self.path);
    }
}

/// The program with a log that can be read line by line.
pub fn program() -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_vfd-gateway"));
    command
        .env("RUST_LOG", "info")
        .args(["--log-format", "json"]);
    command
}

/// `vfd-fleet`, with a log that can be read line by line.
pub fn fleet_program() -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_vfd-fleet"));
    command
        .env("RUST_LOG", "info")
        .args(["--log-format", "json"]);
    command
}

/// `vfd-gateway` with `args`, run to its end.
pub fn vfd_gateway(args: &[&str]) -> Output {
    program().args(args).output().unwrap()
}

/// It ended with `code`, and each of `words` stands somewhere in what it printed.
#[track_caller]
pub fn assert_says(output: &Output, code: i32, words: &[&str]) {
    let said = [&output.stdout[..], &output.stderr].concat();
    let said = String::from_utf8_lossy(&said);
    assert_eq!(output.status.code(), Some(code), "{said}");
    for word in words {
        assert!(said.contains(word), "no `{word}` in: {said}");
    }
}

/// `vfd-gateway` with `args`, running.
pub fn start(args: &[&str]) -> Started {
    let mut command = program();
    command.args(args);
    Started::new(command)
}

/// `vfd-gateway` with `args`, logging all there is, before a reader that leaves after one line. Returns that line.
pub fn start_before_a_reader_that_leaves(args: &[&str]) -> (Started, String) {
    let mut command = program();
    command.env("RUST_LOG", "trace").args(args);
    Started::before_a_reader_that_leaves(command)
}

/// Held by who runs a demo. All demos want the usual port for their broker, and one that has lost its own broker
/// would find that of another there.
pub fn only_demo() -> MutexGuard<'static, ()> {
    static DEMO: Mutex<()> = Mutex::new(());
    // A test that failed with it has ended its demo all the same.
    DEMO.lock().unwrap_or_else(PoisonError::into_inner)
}

/// A simulated drive at station 1 whose port is reached as `link`.
pub fn simulate(link: &Path) -> Started {
    let drive = start(&[
        "simulate",
        "--model",
        "hyundai-n700",
        "--station",
        "1",
        "--link",
        link.to_str().unwrap(),
    ]);
    drive.wait_for("that it plays", |line| {
        line.contains("station 1").then_some(())
    });
    drive
}

/// The device that `link` leads to, open and left alone. As long as it is, nobody else gets that device: where a simulator
/// is killed, its link stays and would lead a gateway to the drive of another test.
pub fn reserved(link: &Path) -> File {
    terminal(link)
}

/// The terminal at `path`. It does not become that of this program, which would end with it.
pub fn terminal(path: &Path) -> File {
    let not_ours = i32::try_from(OFlags::NOCTTY.bits()).unwrap();
    File::options()
        .read(true)
        .write(true)
        .custom_flags(not_ours)
        .open(path)
        .unwrap()
}

/// How many requests a simulated drive says at its end that it has heard.
pub fn requests_heard(mut drive: Started) -> u64 {
    drive.terminate();
    assert!(drive.end_within(super::started::PATIENCE).success());
    drive.wait_for("how many requests it heard", |line| {
        let fields = fields(line)?;
        (fields["message"] == "simulation ended").then(|| fields["requests"].as_u64())?
    })
}

/// A gateway and where its clients reach it.
pub struct Gateway {
    pub program: Started,
    pub address: SocketAddr,
}

/// A gateway with one drive at station 1 behind `port`, on a TCP port that the system chooses. It polls once,
/// at its start, so that a test can count what else goes over the line.
pub fn gateway(place: &Place, port: &Path) -> Gateway {
    gateway_with(place, port, "")
}

/// Like [`gateway`], with `more` keys of the listener.
pub fn gateway_with(place: &Place, port: &Path, more: &str) -> Gateway {
    let text = format!(
        "[[line]]\nname = \"test\"\nport = \"{}\"\n\n[[line.drive]]\nname = \"pump-1\"\nmodel = \"hyundai-n700\"\n\
         station = 1\npoll = \"1h\"\n\n[[modbus_tcp]]\nlisten = \"127.0.0.1:0\"\n{more}\n",
        port.display()
    );
    let file = place.write("gateway.toml", &text);
    let program = start(&["run", "-c", file.to_str().unwrap()]);
    let address = program.wait_for("where it listens", |line| {
        let fields = fields(line)?;
        (fields["message"] == "Modbus TCP").then(|| fields["address"].as_str()?.parse().ok())?
    });
    Gateway { program, address }
}

impl Gateway {
    /// Waits until the drive has answered for the first time.
    pub fn wait_for_drive(&self) {
        self.program.wait_for("that the drive is there", |line| {
            let fields = fields(line)?;
            (fields["message"] == "drive online").then_some(())
        });
    }
}

/// What a line of the log says.
pub fn fields(line: &str) -> Option<serde_json::Value> {
    let mut entry: serde_json::Value = serde_json::from_str(line).ok()?;
    Some(entry["fields"].take())
}
