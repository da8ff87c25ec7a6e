//! Programs that nobody here wrote. A test without them fails: one that is skipped proves nothing.

use super::rig::text_of;
use super::started::{PATIENCE, Started, until};
use std::io::Write;
use std::net::SocketAddr;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};

/// One call of mbpoll.
pub struct Mbpoll {
    /// The values that it printed, in order.
    pub values: Vec<u16>,
    /// All that it printed.
    pub text: String,
}

/// Runs mbpoll once against unit 1 at `address`, counting registers from 0 as on the wire.
pub fn mbpoll(address: SocketAddr, args: &[&str]) -> Mbpoll {
    let mut command = Command::new("mbpoll");
    command.args([
        "-0",
        "-1",
        "-a",
        "1",
        "-o",
        "6",
        "-p",
        &address.port().to_string(),
    ]);
    mbpoll_output(command.args(args).arg(address.ip().to_string()))
}

/// Has mbpoll write `value` with `args`, and returns whether it says that it was written.
pub fn mbpoll_write(address: SocketAddr, args: &[&str], value: u16) -> bool {
    let mut command = Command::new("mbpoll");
    command
        .args(["-0", "-o", "6", "-p", &address.port().to_string()])
        .args(args);
    mbpoll_output(command.args([address.ip().to_string(), value.to_string()]))
        .text
        .contains("Written 1 references.")
}

/// What an mbpoll command that is complete prints.
pub fn mbpoll_output(command: &mut Command) -> Mbpoll {
    let Output { stdout, stderr, .. } = run(command);
    let text = format!(
        "{}{}",
        String::from_utf8_lossy(&stdout),
        String::from_utf8_lossy(&stderr)
    );
    Mbpoll {
        values: text.lines().filter_map(value).collect(),
        text,
    }
}

/// The value in a line like `[257]: 6000`; large ones stand there twice: `[3]: 65535 (-1)`.
fn value(line: &str) -> Option<u16> {
    let (_, value) = line.strip_prefix('[')?.split_once("]:")?;
    value.split_whitespace().next()?.parse().ok()
}

/// What a pymodbus client gets as answers to `requests`; see `client.py`.
pub fn pymodbus_client(address: SocketAddr, requests: &[&str]) -> Vec<serde_json::Value> {
    let output = run(Command::new(python())
        .arg(script("client.py"))
        .arg(address.port().to_string())
        .args(requests));
    assert!(
        output.status.success(),
        "{}",
        String::from_utf8_lossy(&output.stderr)
    );
    String::from_utf8(output.stdout)
        .unwrap()
        .lines()
        .map(|line| serde_json::from_str(line).unwrap())
        .collect()
}

/// What a pymodbus master at the serial `device` gets as answers to `requests`; see `client.py`.
pub fn pymodbus_serial(device: &Path, requests: &[&str]) -> Vec<serde_json::Value> {
    let output = run(Command::new(python())
        .arg(script("client.py"))
        .arg(device)
        .args(requests));
    assert!(
        output.status.success(),
        "{}",
        String::from_utf8_lossy(&output.stderr)
    );
    String::from_utf8(output.stdout)
        .unwrap()
        .lines()
        .map(|line| serde_json::from_str(line).unwrap())
        .collect()
}

/// A pymodbus client with TLS from the address `source`, whose requests are typed; see `client.py`.
pub fn pymodbus_tls_client(
    address: SocketAddr,
    directory: &Path,
    name: &str,
    source: &str,
) -> Started {
    let mut command = Command::new(python());
    command
        .arg(script("client.py"))
        .arg(address.port().to_string())
        .arg("--tls")
        .arg(directory);
    Started::at_a_keyboard({
        command.args([name, source, "-"]);
        command
    })
}

/// Makes certificates as `docs/modbus-tcp.md` shows; see `make-certificates.sh`.
pub fn make_certificates(directory: &Path, args: &[&str]) {
    let script = tests()
        .with_file_name("deploy")
        .join("modbus-security/make-certificates.sh");
    let output = run(Command::new(script).arg(directory).args(args));
    assert!(
        output.status.success(),
        "{args:?}: {}",
        String::from_utf8_lossy(&output.stderr)
    );
}

/// What `openssl s_client` says with `args` of the server at `address`, and whether it is content. Its input ends at once.
pub fn openssl_client(address: SocketAddr, args: &[&str]) -> (bool, String) {
    let mut command = Command::new("openssl");
    command
        .args(["s_client", "-connect", &address.to_string()])
        .args(args)
        .stdin(Stdio::null());
    let Output {
        status,
        stdout,
        stderr,
    } = run(&mut command);
    (
        status.success(),
        [stdout, stderr]
            .map(|it| String::from_utf8_lossy(&it).into_owned())
            .concat(),
    )
}

/// How many samples of metrics a strict parser finds in `text`; see `metrics.py`.
pub fn samples(text: &str) -> usize {
    let mut command = Command::new(python());
    command
        .arg(script("metrics.py"))
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped());
    let output = fed(command, text);
    assert!(
        output.status.success(),
        "{}",
        String::from_utf8_lossy(&output.stderr)
    );
    String::from_utf8(output.stdout)
        .unwrap()
        .trim()
        .parse()
        .unwrap()
}

/// `promtool` with `args` in `directory`, and `input` on its standard input.
pub fn promtool(directory: &Path, args: &[&str], input: &str) -> Output {
    let mut command = Command::new("promtool");
    command
        .args(args)
        .current_dir(directory)
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped());
    fed(command, input)
}

/// `command` run to its end with `input`, of which it may read as little as it likes.
fn fed(mut command: Command, input: &str) -> Output {
    let name = command.get_program().to_string_lossy().into_owned();
    let mut child = command
        .spawn()
        .unwrap_or_else(|error| panic!("cannot start {name}: {error}; run tests/run"));
    let _ = child.stdin.take().unwrap().write_all(input.as_bytes());
    child.wait_with_output().unwrap()
}

/// What a client from npm, `modbus-serial` or `jsmodbus`, gets as answers to `requests`; see `npm/client.js`.
pub fn npm_client(name: &str, address: SocketAddr, requests: &[&str]) -> Vec<serde_json::Value> {
    let output = run(node(name).arg(address.port().to_string()).args(requests));
    assert!(
        output.status.success(),
        "{name}: {}",
        String::from_utf8_lossy(&output.stderr)
    );
    String::from_utf8(output.stdout)
        .unwrap()
        .lines()
        .map(|line| serde_json::from_str(line).unwrap())
        .collect()
}

/// aedes as the broker at `port`; see `npm/aedes.js`. It returns once somebody may connect.
pub fn aedes(port: u16) -> Started {
    let mut command = node("aedes");
    command.arg(port.to_string());
    let broker = Started::new(command);
    broker.wait_for("that it listens", |line| {
        line.contains("\"listens\"").then_some(())
    });
    broker
}

/// A program of `npm` under node.
pub fn node(name: &str) -> Command {
    let folder = tests().join("process/npm");
    assert!(
        folder.join("node_modules").exists(),
        "{} has no packages; run tests/run",
        folder.display()
    );
    let mut command = Command::new("node");
    command.arg(folder.join(format!("{name}.js")));
    command
}

/// libmodbus against `unit` at `place`, a port of this host or a serial device, compiled into `directory` with the test
/// client that comes with it; see `libmodbus.c`.
pub fn libmodbus(directory: &Path, place: &str, unit: u8) -> Output {
    const EXAMPLES: &str = "/usr/share/doc/libmodbus-dev/examples";
    assert!(
        Path::new(EXAMPLES).join("unit-test-client.c").exists(),
        "{EXAMPLES} is missing; run tests/run"
    );
    let program = directory.join("libmodbus");
    let mut compiler = Command::new("cc");
    // Its own client is compiled as it is, warnings and all.
    compiler
        .args(["-w", "-I/usr/include/modbus", "-I", EXAMPLES, "-o"])
        .arg(&program);
    let output = run(compiler.arg(script("libmodbus.c")).arg("-lmodbus"));
    assert!(
        output.status.success(),
        "{}",
        String::from_utf8_lossy(&output.stderr)
    );
    run(Command::new(program).args([place, &unit.to_string()]))
}

/// The responses that a requester with MQTT 5 gets from paho-mqtt; see `requester.py`.
pub fn requester(
    port: u16,
    topic: &str,
    payload: &str,
    response: &str,
    correlation: &str,
) -> Vec<serde_json::Value> {
    let mut command = Command::new(python());
    command.arg(script("requester.py")).args([
        &port.to_string(),
        topic,
        payload,
        response,
        correlation,
    ]);
    let output = run(&mut command);
    assert!(
        output.status.success(),
        "{}",
        String::from_utf8_lossy(&output.stderr)
    );
    String::from_utf8(output.stdout)
        .unwrap()
        .lines()
        .map(|line| serde_json::from_str(line).unwrap())
        .collect()
}

/// The last result of a command that paho-mqtt sends with MQTT `version` 4 (3.1.1) or 5; see `commander.py`.
pub fn paho(
    port: u16,
    version: &str,
    topic: &str,
    payload: &str,
    retain: bool,
) -> serde_json::Value {
    let retain = if retain { "retain" } else { "live" };
    let mut command = Command::new(python());
    let output = run(command.arg(script("commander.py")).args([
        &port.to_string(),
        version,
        topic,
        payload,
        retain,
    ]));
    assert!(
        output.status.success(),
        "{}",
        String::from_utf8_lossy(&output.stderr)
    );
    serde_json::from_slice(&output.stdout).unwrap()
}

/// What came in a round of all that paho-mqtt asks of the broker at `port` with MQTT `version` 4 (3.1.1) or 5; see
/// `round.py`.
pub fn paho_round(port: u16, version: &str) -> serde_json::Value {
    let output = run(Command::new(python())
        .arg(script("round.py"))
        .args([&port.to_string(), version]));
    assert!(
        output.status.success(),
        "{}",
        String::from_utf8_lossy(&output.stderr)
    );
    serde_json::from_slice(&output.stdout).unwrap()
}

/// A drive played by pymodbus at `station` on `port`; see `drive.py`.
pub fn pymodbus_drive(port: &Path, station: u8) -> Started {
    let mut command = Command::new(python());
    command
        .arg(script("drive.py"))
        .arg(port)
        .arg(station.to_string());
    Started::new(command)
}

/// A drive of another vendor played by pymodbus, which `trip CODE` trips; see `vendors.py`.
pub fn pymodbus_vendor(drive: &str, port: &Path, station: u8) -> Started {
    let mut command = Command::new(python());
    command
        .arg(script("vendors.py"))
        .arg(drive)
        .arg(port)
        .arg(station.to_string());
    let started = Started::at_a_keyboard(command);
    started.wait_for("that it plays", |line| {
        line.starts_with("{\"plays\"").then_some(())
    });
    started
}

/// The same with a Modbus TCP server on `port` of this machine, as `unit`.
pub fn pymodbus_vendor_at(drive: &str, port: u16, unit: u8) -> Started {
    pymodbus_vendor(drive, Path::new(&format!("tcp:{port}")), unit)
}

/// A drive played by a Modbus TCP server of libmodbus on `port` of this machine, compiled into `directory`; see
/// `libmodbus_drive.c`.
pub fn libmodbus_drive(directory: &Path, port: u16) -> Started {
    let program = directory.join("libmodbus_drive");
    let mut compiler = Command::new("cc");
    compiler
        .args(["-Wall", "-I/usr/include/modbus", "-o"])
        .arg(&program);
    let output = run(compiler.arg(script("libmodbus_drive.c")).arg("-lmodbus"));
    assert!(
        output.status.success(),
        "{}",
        String::from_utf8_lossy(&output.stderr)
    );
    let mut command = Command::new(program);
    command.arg(port.to_string());
    let started = Started::new(command);
    started.wait_for("that it listens", |line| {
        line.starts_with("{\"plays\"").then_some(())
    });
    started
}

/// Two pseudo-terminals, `one` and `other`, joined by socat like the two ends of a cable.
pub fn cable(one: &Path, other: &Path) -> Started {
    let end = |path: &Path| format!("pty,raw,echo=0,link={}", path.display());
    let mut command = Command::new("socat");
    command.args([end(one), end(other)]);
    let cable = Started::new(command);
    until("socat makes both ends", PATIENCE, || {
        (one.exists() && other.exists()).then_some(())
    });
    cable
}

/// ser2net before the line at `device`, on `port` of this machine, set up in `file` as `docs/real-drive.md` shows. It
/// returns once somebody may connect.
pub fn ser2net(file: &Path, port: u16, device: &Path) -> Started {
    let guide = text_of("docs/real-drive.md");
    let (_, rest) = guide
        .split_once("```yaml\n")
        .expect("the guide shows a configuration of ser2net");
    let shown = rest.split_once("```").unwrap().0;
    assert!(
        shown.contains("tcp,4001") && shown.contains("/dev/ttyUSB0"),
        "{shown}"
    );
    let here = shown.replace("tcp,4001", &format!("tcp,127.0.0.1,{port}"));
    std::fs::write(file, here.replace("/dev/ttyUSB0", device.to_str().unwrap())).unwrap();
    // Debian keeps it where an ordinary user does not look.
    const HERE: &str = "/usr/sbin/ser2net";
    let mut command = Command::new(if Path::new(HERE).exists() {
        HERE
    } else {
        "ser2net"
    });
    // In the foreground, and without its lock files, which are named like those of other tests' devices.
    command.args(["-n", "-d", "-u", "-c"]).arg(file);
    let server = Started::new(command);
    until("ser2net listens", PATIENCE, || {
        is_listened_to(port).then_some(())
    });
    server
}

/// The documents of YAML `files`, held against what `kind` says; see `deployed.py`.
pub fn documents_of(kind: &str, files: &[PathBuf]) -> Vec<serde_json::Value> {
    let output = run(Command::new(python())
        .arg(script("deployed.py"))
        .arg(kind)
        .args(files));
    assert!(
        output.status.success(),
        "{}",
        String::from_utf8_lossy(&output.stderr)
    );
    serde_json::from_slice(&output.stdout).unwrap()
}

/// A controller with the function block in `file`, towards `unit` at `address`; see `plc.py`.
pub fn controller(file: &Path, address: SocketAddr, unit: u8) -> Started {
    let mut command = Command::new(python());
    command
        .arg(script("plc.py"))
        .arg(file)
        .arg(address.ip().to_string());
    Started::at_a_keyboard({
        command.args([address.port().to_string(), unit.to_string()]);
        command
    })
}

/// Whether somebody on this machine listens on `port`, without connecting.
fn is_listened_to(port: u16) -> bool {
    let table = std::fs::read_to_string("/proc/net/tcp").unwrap();
    let (local, listening) = (format!(":{port:04X}"), "0A");
    let mut rows = table
        .lines()
        .map(|row| row.split_whitespace().collect::<Vec<_>>());
    rows.any(|row| row.len() > 3 && row[1].ends_with(&local) && row[3] == listening)
}

fn run(command: &mut Command) -> Output {
    let name = command.get_program().to_string_lossy().into_owned();
    command.output().unwrap_or_else(|error| {
        panic!("cannot start {name}: {error}; run tests/run, which installs it")
    })
}

/// The Python of the tests, with what `requirements.txt` names.
pub fn python() -> PathBuf {
    let python = tests().join(".venv/bin/python");
    assert!(
        python.exists(),
        "{} is missing; run tests/run, which makes it",
        python.display()
    );
    python
}

fn script(name: &str) -> PathBuf {
    tests().join("process").join(name)
}

fn tests() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests")
}
