//! What `check` and `models` say, and the exit codes of the program: 0 done, 1 failed, 2 wrong usage or configuration.

use super::rig::{Place, vfd_gateway};
use std::path::Path;
use std::process::Output;

#[test]
fn check_reports_every_mistake_at_once_with_its_line() {
    let place = Place::new();
    let text = "[[line]]\n\
                name = \"hall-1\"\n\
                port = \"/dev/ttyUSB0\"\n\
                buad = 9600\n\
                parity = \"mark\"\n\
                \n\
                [[line.drive]]\n\
                name = \"pump-1\"\n\
                model = \"hyundai-n7000\"\n\
                station = 1\n\
                \n\
                [[line.drive]]\n\
                name = \"pump-2\"\n\
                model = \"hyundai-n700\"\n\
                station = 33\n\
                \n\
                [[modbus_tcp]]\n\
                listen = \"0.0.0.0:1502\"\n";
    let file = place.write("mistakes.toml", text);
    let output = vfd_gateway(&["check", "-c", file.to_str().unwrap()]);
    let said = said(&output);
    assert_eq!(output.status.code(), Some(2), "{said}");
    for (wrong, helps) in [
        ("buad", "baud"),
        ("\"mark\"", "even"),
        ("hyundai-n7000", "hyundai-n700\""),
        ("33", "1 to 32"),
        ("[[modbus_tcp]]", "allow"),
    ] {
        let line = text.lines().position(|line| line.contains(wrong)).unwrap() + 1;
        assert!(
            said.contains(&format!("{}:{line}:", file.display())),
            "no mistake in line {line} ({wrong}):\n{said}"
        );
        assert!(said.contains(helps), "{wrong} without {helps}:\n{said}");
    }
    assert!(said.contains("5 problems"), "{said}");
}

#[test]
fn what_is_no_file_or_much_too_long_is_refused_before_it_is_read() {
    let place = Place::new();
    let (pipe, long) = (place.file("pipe"), place.file("long"));
    assert!(
        std::process::Command::new("mkfifo")
            .arg(&pipe)
            .status()
            .unwrap()
            .success()
    );
    std::fs::File::create(&long)
        .unwrap()
        .set_len(50_000_000)
        .unwrap();
    let dir = place.file("dir");
    std::fs::create_dir(&dir).unwrap();
    for (path, why) in [
        (pipe.as_path(), "it is a pipe, and a regular file is needed"),
        (&dir, "it is a directory, and a regular file is needed"),
        (
            Path::new("/dev/zero"),
            "it is a device, and a regular file is needed",
        ),
        (
            &long,
            "it is 50000000 bytes long; 1048576 bytes are the most",
        ),
    ] {
        for command in [
            &["check", "-c"][..],
            &["run", "-c"],
            &["models", "check"],
            &["params", "diff", "x"],
        ] {
            let mut program = super::rig::program();
            // A dump that is no dump is met first, where two are read.
            let command = if command[0] == "params" {
                &["params", "diff"][..]
            } else {
                command
            };
            program.args(command).arg(path);
            if command[0] == "params" {
                program.arg(path);
            }
            let mut program = super::started::Started::new(program);
            let status = program.end_within(super::started::PATIENCE);
            let said = super::started::until("it says why", super::started::PATIENCE, || {
                Some(program.text()).filter(|said| said.contains(why))
            });
            assert_eq!(
                status.code(),
                Some(2),
                "{command:?} {}: {said}",
                path.display()
            );
        }
    }
}

#[test]
fn check_accepts_the_example_and_says_what_it_costs() {
    let example = Path::new(env!("CARGO_MANIFEST_DIR")).join("deploy/vfd-gateway.toml");
    let output = vfd_gateway(&["check", "--verbose", "-c", example.to_str().unwrap()]);
    let said = said(&output);
    assert_eq!(output.status.code(), Some(0), "{said}");
    for word in [
        "hall-1",
        "pump-1",
        "read-only",
        "serial device: rs485, direction turned by the adapter; low latency asked for",
        "silence before each frame",
        "127.0.0.1:1502",
        "commands from mqtt, modbus-tcp, page, sparkplug: 5.00 to 50.00 Hz, forward, reverse",
        "commander lost after 30s: stop; gateway ended: hold",
        "can be ordered: stop, frequency, forward, reverse, coast, reset",
        "acceleration_time (0x020C): not known to be RAM: treated as stored",
        "deceleration_time (0x020E): not known to be RAM: treated as stored",
        "command deadline 1s < lease 30s",
        "mqtts://broker.example:8883",
        "127.0.0.1/32 may write, 127.0.0.0/8 may stop",
    ] {
        assert!(said.contains(word), "no {word}:\n{said}");
    }
}

#[test]
fn check_warns_about_what_has_no_effect() {
    let place = Place::new();
    let text = "[[line]]\nname = \"hall-1\"\nport = \"/dev/ttyUSB0\"\n\n[[line.drive]]\nname = \"pump-1\"\n\
                model = \"hyundai-n700\"\nstation = 1\nrated_current_a = 7.5\n";
    let file = place.write("useless.toml", text);
    let file = file.to_str().unwrap();
    let plain = vfd_gateway(&["check", "-c", file]);
    let warned = String::from_utf8(plain.stderr.clone()).unwrap();
    assert_eq!(plain.status.code(), Some(0), "{warned}");
    assert!(
        warned.contains(&format!("{file}:9:")) && warned.contains("has no effect"),
        "{warned}"
    );
    assert!(
        warned.contains(": 1 warning") && !warned.contains("problem"),
        "{warned}"
    );
    assert!(String::from_utf8_lossy(&plain.stdout).contains("line hall-1"));
    let found = |file: &str| {
        let output = vfd_gateway(&["check", "-c", file, "--json"]);
        (
            output.status.code(),
            serde_json::from_slice::<serde_json::Value>(&output.stdout).unwrap(),
        )
    };
    let (code, json) = found(file);
    assert_eq!((code, &json["usable"]), (Some(0), &serde_json::json!(true)));
    let problem = &json["problems"][0];
    assert_eq!(
        (&problem["severity"], &problem["line"]),
        (&"warning".into(), &9.into()),
        "{json}"
    );
    assert_eq!(problem["key"], "line[0].drive[0].rated_current_a");
    let wrong = place.write("wrong.toml", &text.replace("station = 1", "station = 33"));
    let (code, json) = found(wrong.to_str().unwrap());
    assert_eq!(
        (code, &json["usable"]),
        (Some(2), &serde_json::json!(false))
    );
    let severities: Vec<_> = json["problems"]
        .as_array()
        .unwrap()
        .iter()
        .map(|it| it["severity"].clone())
        .collect();
    assert_eq!(severities, ["error", "warning"], "{json}");
}

#[test]
fn check_says_what_a_line_is_reached_through() {
    let place = Place::new();
    for (keys, says) in [
        (
            "port = \"tcp://10.0.0.7:4001\"",
            "network: frames go to a serial device server, whose line is set to 9600 8N1",
        ),
        (
            "port = \"tcp://10.0.0.7:4001\"\nsilence = \"0ms\"",
            "pseudo-terminal or tcp:// only",
        ),
        (
            "port = \"/dev/ttyS1\"\nrs485 = \"kernel\"",
            "rs485, direction turned by the driver (TIOCSRS485)",
        ),
        (
            "port = \"/dev/ttyS1\"\nrs485 = \"rts\"",
            "rs485, direction turned by the gateway with RTS",
        ),
        (
            "port = \"/dev/ttyS1\"\ninterface = \"rs232\"\nlow_latency = false",
            "rs232; low latency left as it is",
        ),
    ] {
        let text = format!(
            "[[line]]\nname = \"hall-1\"\n{keys}\n[[line.drive]]\nname = \"pump-1\"\nmodel = \"hyundai-n700\"\nstation = 1\n"
        );
        let file = place.write("port.toml", &text);
        let output = vfd_gateway(&["check", "--verbose", "-c", file.to_str().unwrap()]);
        let said = said(&output);
        assert_eq!(output.status.code(), Some(0), "{said}");
        assert!(said.contains(says), "{keys}: no {says}:\n{said}");
    }
}

#[test]
fn a_key_that_this_version_does_not_serve_is_refused() {
    let place = Place::new();
    let example = std::fs::read_to_string(
        Path::new(env!("CARGO_MANIFEST_DIR")).join("deploy/vfd-gateway.toml"),
    )
    .unwrap();
    let file = place.write(
        "later.toml",
        &example.replacen(
            "[[modbus_tcp]]\n",
            "[[modbus_tcp]]\nlease = \"session\"\n",
            1,
        ),
    );
    for command in ["check", "run"] {
        let output = vfd_gateway(&[command, "-c", file.to_str().unwrap()]);
        assert_eq!(output.status.code(), Some(2), "{}", said(&output));
        assert!(
            said(&output).contains("`lease` is not supported by this version"),
            "{}",
            said(&output)
        );
    }
}

#[test]
fn wrong_usage_is_2_and_help_is_0() {
    for (args, code) in [
        (&["--help"][..], 0),
        (&["--version"], 0),
        (&["models"], 0),
        (&["models", "show", "hyundai-n700"], 0),
        (&["models", "show", "hyundai-n70"], 2),
        (&["models", "check", "/nonexistent.toml"], 2),
        (&["check", "-c", "/nonexistent.toml"], 2),
        (&["run"], 2),
        (&["fly"], 2),
        (
            &["simulate", "--model", "hyundai-n700", "--station", "33"],
            2,
        ),
    ] {
        let output = vfd_gateway(args);
        assert_eq!(
            output.status.code(),
            Some(code),
            "{args:?}: {}",
            said(&output)
        );
    }
}

#[test]
fn a_model_is_shown_with_its_sources() {
    let output = vfd_gateway(&["models", "show", "hyundai-n700"]);
    let said = said(&output);
    for word in ["F001", "0x0101", "Hz", "manual", "inferred"] {
        assert!(said.contains(word), "no {word}:\n{said}");
    }
}

fn said(output: &Output) -> String {
    format!(
        "{}{}",
        String::from_utf8_lossy(&output.stdout),
        String::from_utf8_lossy(&output.stderr)
    )
}
