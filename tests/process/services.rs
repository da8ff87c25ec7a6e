//! The service unit, the udev rule and the configuration that the Debian package starts with, read by systemd and udev as
//! they stand. `tests/run package` installs the package and runs the service.

use super::rig::{Place, assert_says, fields, program, simulate, start, vfd_gateway};
use super::started::{PATIENCE, Started};
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

const UNIT: &str = "vfd-gateway.service";
/// The unit's own exposure, in tenths: what systemd calls OK ends at 4.
const EXPOSURE_MAX: &str = "29";

fn deploy() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("deploy")
}

fn unit() -> String {
    std::fs::read_to_string(deploy().join("systemd").join(UNIT)).unwrap()
}

/// The values of `key` in the unit, in its order.
fn values<'a>(unit: &'a str, key: &str) -> Vec<&'a str> {
    unit.lines()
        .filter_map(|line| line.strip_prefix(key)?.strip_prefix('='))
        .collect()
}

fn systemd_analyze(args: &[&str]) -> Output {
    Command::new("systemd-analyze")
        .args(args)
        .output()
        .expect("systemd-analyze; run tests/run, which installs it")
}

fn said(output: &Output) -> String {
    format!(
        "{}{}",
        String::from_utf8_lossy(&output.stdout),
        String::from_utf8_lossy(&output.stderr)
    )
}

/// What systemd has to say of `unit` where the program is the one that was built here.
fn verdict(place: &Place, unit: &str) -> String {
    assert!(unit.contains("/usr/bin/vfd-gateway"));
    let file = place.write(
        UNIT,
        &unit.replace("/usr/bin/vfd-gateway", env!("CARGO_BIN_EXE_vfd-gateway")),
    );
    said(&systemd_analyze(&[
        "verify",
        "--man=no",
        file.to_str().unwrap(),
    ]))
}

#[test]
fn systemd_has_nothing_to_say_of_the_unit() {
    let place = Place::new();
    let unit = unit();
    assert_eq!(verdict(&place, &unit), "");
    let misspelt = unit.replace("NoNewPrivileges=", "NoNewPrivilege=");
    assert!(
        verdict(&place, &misspelt).contains("NoNewPrivilege"),
        "a mistake is seen"
    );
}

#[test]
fn the_service_is_locked_in() {
    let place = Place::new();
    let exposed = |unit: &str| {
        let file = place.write(UNIT, unit);
        let threshold = format!("--threshold={EXPOSURE_MAX}");
        systemd_analyze(&[
            "security",
            "--offline=true",
            "--no-pager",
            &threshold,
            file.to_str().unwrap(),
        ])
    };
    let unit = unit();
    let output = exposed(&unit);
    assert!(output.status.success(), "{}", said(&output));
    let open =
        "[Service]\nExecStart=/usr/bin/vfd-gateway run -c /etc/vfd-gateway/vfd-gateway.toml\n";
    assert!(
        !exposed(open).status.success(),
        "an open one is above the threshold"
    );
}

/// `systemd-analyze syscall-filter` names all sets with what is in them, other sets too.
fn syscall_sets() -> BTreeMap<String, Vec<String>> {
    let output = systemd_analyze(&["syscall-filter", "--no-pager"]);
    let text = String::from_utf8(output.stdout).unwrap();
    let mut sets: BTreeMap<String, Vec<String>> = BTreeMap::new();
    let mut current = String::new();
    for line in text
        .lines()
        .filter(|line| !line.trim_start().starts_with('#') && !line.is_empty())
    {
        match line.strip_prefix("    ") {
            Some(item) => sets.get_mut(&current).unwrap().push(item.to_owned()),
            None => {
                line.clone_into(&mut current);
                sets.insert(current.clone(), Vec::new());
            }
        }
    }
    sets
}

fn expanded(sets: &BTreeMap<String, Vec<String>>, name: &str) -> BTreeSet<String> {
    match sets.get(name) {
        Some(items) => items.iter().flat_map(|item| expanded(sets, item)).collect(),
        None => {
            assert!(!name.starts_with('@'), "there is no set {name}");
            BTreeSet::from([name.to_owned()])
        }
    }
}

/// The system calls that the unit lets through: each line adds, one that begins with `~` takes away.
fn allowed_calls(unit: &str) -> BTreeSet<String> {
    let sets = syscall_sets();
    let mut allowed = BTreeSet::new();
    for value in values(unit, "SystemCallFilter") {
        match value.strip_prefix('~') {
            Some(names) => names.split(' ').for_each(|name| {
                for call in expanded(&sets, name) {
                    allowed.remove(&call);
                }
            }),
            None => value
                .split(' ')
                .for_each(|name| allowed.extend(expanded(&sets, name))),
        }
    }
    allowed
}

/// Runs the gateway with all that a service of it does under strace, and returns what strace has written.
fn traced(place: &Place) -> String {
    let (line, data) = (place.file("line"), place.file("data"));
    std::fs::create_dir(&data).unwrap();
    let _drive = simulate(&line);
    let text = format!(
        "[gateway]\ndata_dir = \"{}\"\n[[line]]\nname = \"hall-1\"\nport = \"{}\"\n[[line.drive]]\nname = \"pump-1\"\n\
         model = \"hyundai-n700\"\nstation = 1\n[mqtt]\nbroker = \"mqtt://localhost:9\"\n[[modbus_tcp]]\n\
         listen = \"127.0.0.1:0\"\n[http]\nlisten = \"127.0.0.1:0\"\n",
        data.display(),
        line.display()
    );
    let file = place.write("gateway.toml", &text);
    let trace = place.file("trace");
    let mut command = Command::new("strace");
    command
        .args(["-f", "-qq", "-e", "signal=none", "-o"])
        .arg(&trace)
        .arg(env!("CARGO_BIN_EXE_vfd-gateway"));
    command
        .args(["--log-format", "json", "run", "-c"])
        .arg(&file);
    let mut gateway = Started::new(command);
    gateway.wait_for("that the drive is there", |line| {
        let fields = fields(line)?;
        (fields["message"] == "drive online").then_some(())
    });
    let socket = data.join("vfd-gateway.sock");
    let reload = vfd_gateway(&["reload", "--socket", socket.to_str().unwrap()]);
    assert!(reload.status.success(), "{}", said(&reload));
    let child = Command::new("pgrep")
        .args(["-P", &gateway.id().to_string()])
        .output()
        .unwrap();
    let child = String::from_utf8(child.stdout).unwrap();
    let kill = format!("kill -TERM {}", child.trim());
    assert!(
        Command::new("sh")
            .args(["-c", &kill])
            .status()
            .unwrap()
            .success(),
        "{kill}"
    );
    assert!(gateway.end_within(PATIENCE).success(), "{}", gateway.text());
    std::fs::read_to_string(trace).unwrap()
}

#[test]
fn the_filters_let_through_all_that_the_gateway_does() {
    let (unit, trace) = (unit(), traced(&Place::new()));
    let allowed = allowed_calls(&unit);
    // A line is `1234  call(arguments) = result`; the end of one that was interrupted has no arguments, and of a thread
    // that ended with the process before its call could be read the line is `1234  ???( <unfinished ...>`.
    let done = || {
        trace
            .lines()
            .filter_map(|line| line.split_once(' ')?.1.trim_start().split_once('('))
    };
    let is_call = |name: &&str| {
        name.bytes()
            .all(|letter| letter == b'_' || letter.is_ascii_alphanumeric())
    };
    let called: BTreeSet<_> = done().map(|(name, _)| name).filter(is_call).collect();
    assert!(
        called.len() > 40 && called.contains("sched_setscheduler"),
        "{called:?}"
    );
    // SQLite keeps the owner of its files where it is root, which the service is not.
    let refused: Vec<_> = called
        .iter()
        .filter(|name| !allowed.contains(**name) && **name != "fchown")
        .collect();
    assert_eq!(
        refused,
        Vec::<&&str>::new(),
        "SystemCallFilter= refuses them"
    );
    assert!(
        !allowed.contains("mount") && !allowed.contains("ptrace"),
        "the filter takes something away"
    );
    let families: BTreeSet<_> = values(&unit, "RestrictAddressFamilies")
        .iter()
        .flat_map(|it| it.split(' '))
        .collect();
    let asked: BTreeSet<_> = done()
        .filter(|(name, _)| *name == "socket")
        .filter_map(|(_, rest)| rest.split(',').next())
        .collect();
    let needed: Vec<_> = asked
        .iter()
        .filter(|family| !families.contains(**family))
        .collect();
    assert_eq!(
        needed,
        Vec::<&&str>::new(),
        "RestrictAddressFamilies= refuses them"
    );
    let writable_code = done().filter(|(name, rest)| {
        (*name == "mmap" || *name == "mprotect")
            && rest.contains("PROT_EXEC")
            && rest.contains("PROT_WRITE")
    });
    assert_eq!(
        writable_code.count(),
        0,
        "MemoryDenyWriteExecute= refuses it"
    );
}

#[test]
fn a_stop_first_gives_shared_lines_to_the_other_gateway_and_never_waits_for_that_in_vain() {
    let unit = unit();
    let [line] = values(&unit, "ExecStop")[..] else {
        panic!("one command")
    };
    // Whatever comes of it, the service is stopped.
    let words = line.strip_prefix("-/usr/bin/vfd-gateway ").unwrap();
    let place = Place::new();
    let text = format!(
        "[gateway]\ndata_dir = \"{}\"\n[[line]]\nname = \"hall-1\"\nport = \"{}\"\n[[line.drive]]\nname = \"pump-1\"\n\
         model = \"hyundai-n700\"\nstation = 1\n[[modbus_tcp]]\nlisten = \"127.0.0.1:0\"\n",
        place.file("").display(),
        place.file("line").display()
    );
    let file = place.write("gateway.toml", &text);
    let words = words.replace("/etc/vfd-gateway/vfd-gateway.toml", file.to_str().unwrap());
    let words: Vec<_> = words.split(' ').collect();
    assert_says(&vfd_gateway(&words), 1, &["vfd-gateway.sock"]);
    let gateway = start(&["run", "-c", file.to_str().unwrap()]);
    gateway.wait_for("that it runs", |line| {
        (fields(line)?["message"] == "running").then_some(())
    });
    assert_says(
        &vfd_gateway(&words),
        0,
        &["no line has a second gateway: there is nothing to hand over"],
    );
}

#[test]
fn nothing_ends_or_starts_the_service_behind_the_operators_back() {
    let unit = unit();
    for (key, value) in [
        ("Type", "notify"),
        ("Restart", "on-failure"),
        // What `check` and `run` say of a configuration that is wrong.
        ("RestartPreventExitStatus", "2"),
        ("StartLimitIntervalSec", "0"),
        ("KillMode", "mixed"),
        ("LimitRTPRIO", "20"),
    ] {
        assert_eq!(values(&unit, key), [value], "{key}");
    }
    let manifest = std::fs::read_to_string(deploy().with_file_name("Cargo.toml")).unwrap();
    let manifest: toml::Table = manifest.parse().unwrap();
    let units = &manifest["package"]["metadata"]["deb"]["systemd-units"];
    for key in [
        "enable",
        "start",
        "restart-after-upgrade",
        "stop-on-upgrade",
    ] {
        assert_eq!(units[key].as_bool(), Some(false), "{key}");
    }
}

/// What udev says of rules in files of their own, beside nothing else.
fn udev_says(rules: &Path) -> String {
    let script = "mount -t tmpfs none /usr/lib/udev/rules.d && mount -t tmpfs none /run && mkdir /run/udev && \
                  cp \"$1\" /usr/lib/udev/rules.d/ && exec udevadm test --action=add /sys/class/mem/null";
    let mut command = Command::new("unshare");
    command
        .args(["--map-root-user", "--mount", "sh", "-c", script, "sh"])
        .arg(rules);
    let said = said(&command.output().expect("unshare"));
    let name = rules.file_name().unwrap().to_str().unwrap();
    assert!(
        said.contains(&format!("Reading rules file: /usr/lib/udev/rules.d/{name}")),
        "{said}"
    );
    said.lines()
        .filter(|line| line.contains(&format!("{name}:")))
        .map(|line| format!("{line}\n"))
        .collect()
}

#[test]
fn udev_takes_the_rules_with_the_examples_too() {
    let place = Place::new();
    let rules = std::fs::read_to_string(deploy().join("udev/60-vfd-gateway.rules")).unwrap();
    let examples = rules.replace("# SUBSYSTEM", "SUBSYSTEM");
    assert!(
        examples.matches("SYMLINK+=\"vfd/").count() == 2
            && !rules.contains("\nSUBSYSTEM==\"tty\", ENV")
    );
    for (name, text) in [
        ("60-vfd-gateway.rules", &rules),
        ("61-vfd-gateway.rules", &examples),
    ] {
        assert_eq!(udev_says(&place.write(name, text)), "");
    }
    let wrong = examples.replace("SYMLINK", "SYMLINC");
    assert!(
        udev_says(&place.write("62-wrong.rules", &wrong)).contains("SYMLINC"),
        "a mistake is seen"
    );
}

#[test]
fn the_configuration_of_the_package_is_sound_and_lets_nobody_command() {
    let file = deploy().join("debian/vfd-gateway.toml");
    let output = vfd_gateway(&["check", "-c", file.to_str().unwrap()]);
    assert!(output.status.success(), "{}", said(&output));
    assert!(said(&output).contains("read-only"), "{}", said(&output));
    let text = std::fs::read_to_string(file).unwrap();
    let file: toml::Table = text.parse().unwrap();
    assert_eq!(
        file["gateway"]["data_dir"].as_str(),
        Some("/var/lib/vfd-gateway"),
        "the unit's StateDirectory"
    );
    assert_eq!(values(&unit(), "StateDirectory"), ["vfd-gateway"]);
    for table in [&file["modbus_tcp"][0], &file["http"]] {
        assert!(table["listen"].as_str().unwrap().starts_with("127.0.0.1:"));
    }
}

/// Each key stands behind words that say what it is, and what holds without it.
#[test]
fn the_example_explains_every_key() {
    let text = std::fs::read_to_string(deploy().join("vfd-gateway.toml")).unwrap();
    let (mut section, mut explained) = ("", false);
    let mut seen = BTreeSet::new();
    for (number, line) in text.lines().enumerate() {
        let line = line.trim_start();
        if line.is_empty() || line.starts_with('#') {
            explained = !line.is_empty();
        } else if line.starts_with('[') {
            (section, explained) = (line, false);
        } else {
            let (key, _) = line
                .split_once(" = ")
                .unwrap_or_else(|| panic!("line {}: {line}", number + 1));
            // A table that stands there again needs no second explanation.
            let is_new = seen.insert((section, key));
            assert!(
                explained || !is_new,
                "line {}: nothing is said of {line}",
                number + 1
            );
        }
    }
    assert!(seen.len() > 90, "{seen:?}");
}

#[test]
fn every_configuration_that_is_delivered_is_sound() {
    let files = [
        "compose/gateway/vfd-gateway.toml",
        "kubernetes/gateway/vfd-gateway.toml",
        "plc/vfd-gateway.toml",
    ];
    for file in files.map(|file| deploy().join(file)) {
        let output = program().args(["check", "-c"]).arg(&file).output().unwrap();
        assert!(
            output.status.success(),
            "{}: {}",
            file.display(),
            said(&output)
        );
    }
}
