//! `models new`: from answers alone, with a drive that is read meanwhile, and from a device template. What comes out is sound,
//! and runs a simulated drive.

use super::rig::{Place, assert_says, program, start, vfd_gateway};
use std::io::Write;
use std::path::Path;
use std::process::{Output, Stdio};

/// What `models new` does with `args` and these answers.
fn answered(args: &[&str], answers: &[&str]) -> Output {
    let mut command = program();
    // As a person sees it, who asks for no more of the log.
    command
        .args(["models", "new"])
        .args(args)
        .env_remove("RUST_LOG");
    let mut child = command
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let mut input = child.stdin.take().unwrap();
    // A program that has refused already does not read.
    let _ = input.write_all((answers.join("\n") + "\n").as_bytes());
    drop(input);
    child.wait_with_output().unwrap()
}

fn text(output: &Output) -> String {
    let all = [&output.stdout[..], &output.stderr].concat();
    let all = String::from_utf8_lossy(&all).into_owned();
    assert!(output.status.success(), "{all}");
    all
}

/// The invented drive of `deploy/adding-a-drive.md`.
const ANSWERS: [&str; 23] = [
    "Acme",
    "Flux 2",
    "Acme Flux 2 user manual",
    "19200 8N1 9.1",
    "8 9.3",
    "y",
    "0x2101 9.6",
    "100",
    "2100H 9.6",
    "0x0001 9.6",
    "8 9.6",
    "8450 9.6",
    "0x2000 9.5",
    "0 9.5 word 0",
    "1 9.5 word 1",
    "3 9.5 word 3",
    "0x2001 9.5",
    "100",
    "P0-02",
    "run commands: 2, communication",
    "9.4",
    "",
    "y",
];

#[test]
fn answers_make_a_model_that_runs_a_simulated_drive() {
    let place = Place::new();
    let file = place.file("acme-flux-2.toml");
    let out = file.to_str().unwrap();
    let said = text(&answered(&["acme-flux-2", "--out", out], &ANSWERS));
    for word in [
        "is valid: 5 registers",
        "run forward at 10 Hz, and stopped",
        "acme-flux-2.toml is written",
        "that is bit 0",
    ] {
        assert!(said.contains(word), "no {word}:\n{said}");
    }
    for word in ["only the drive's own watchdog", "shutting down"] {
        assert!(
            !said.contains(word),
            "the drive is simulated: {word}:\n{said}"
        );
    }
    let written = std::fs::read_to_string(&file).unwrap();
    assert!(
        written.contains("confidence = \"manual\"\nsource = \"UM 9.6\"")
            && written.contains("P0-02"),
        "{written}"
    );
    assert!(
        written.contains("max_words = { value = 8, confidence = \"manual\", source = \"UM 9.3\" }"),
        "{written}"
    );
    let again = answered(&["acme-flux-2", "--out", out], &[]);
    assert_says(&again, 2, &["already exists and is not overwritten"]);
    assert_eq!(std::fs::read_to_string(&file).unwrap(), written);
}

/// The register is in the manual, and the page with its words was not found.
#[test]
fn a_word_without_a_place_of_its_own_is_unproven_and_is_shown_so_before_the_file_is_written() {
    let place = Place::new();
    let file = place.file("flux.toml");
    let out = file.to_str().unwrap();
    let mut answers = ANSWERS;
    (answers[13], answers[14]) = ("4", "5");
    let said = text(&answered(&["acme-flux-2", "--out", out], &answers));
    let before = said.find("flux.toml is written").expect("it is written");
    for row in [
        "stop                         0x0004     third-party",
        "forward                      0x0005     third-party",
    ] {
        assert!(
            said.find(row).is_some_and(|at| at < before),
            "no {row}:\n{said}"
        );
    }
    assert!(
        said.contains("take orders only with accept_unverified"),
        "{said}"
    );
    let written = std::fs::read_to_string(&file).unwrap();
    assert!(
        written.contains("value = 0x0004, confidence = \"third-party\""),
        "{written}"
    );
    assert!(
        written.contains("value = 0x0003, confidence = \"manual\", source = \"UM 9.5 word 3\""),
        "{written}"
    );
    answers[22] = "n";
    let other = place.file("other.toml");
    assert_says(
        &answered(&["acme-flux-2", "--out", other.to_str().unwrap()], &answers),
        2,
        &["nothing was written"],
    );
    assert!(!other.exists());
}

#[test]
fn an_interview_that_is_broken_off_writes_nothing() {
    let place = Place::new();
    let file = place.file("x.toml");
    let broken = answered(
        &["acme-flux-2", "--out", file.to_str().unwrap()],
        &ANSWERS[..5],
    );
    assert_says(
        &broken,
        1,
        &["the input ended before", "nothing was written"],
    );
    assert!(!file.exists());
    assert_says(
        &answered(&["Acme"], &[]),
        2,
        &["maker and series in lower case"],
    );
    assert_says(
        &answered(&["hyundai-n700"], &[]),
        2,
        &["is built in", "--toml"],
    );
}

#[test]
fn a_drive_that_is_read_meanwhile_shows_its_scale() {
    let place = Place::new();
    let models = place.file("models");
    std::fs::create_dir(&models).unwrap();
    text(&answered(
        &[
            "acme-flux-2",
            "--out",
            models.join("flux.toml").to_str().unwrap(),
        ],
        &ANSWERS,
    ));
    let line = place.file("line");
    let models = models.to_str().unwrap();
    let line = line.to_str().unwrap();
    let drive = start(&[
        "simulate",
        "--model",
        "acme-flux-2",
        "--model-dir",
        models,
        "--link",
        line,
    ]);
    drive.wait_for("that it plays", |line| {
        line.contains("station 1").then_some(())
    });
    let on_port = ["--port", line, "--station", "1", "--baud", "19200"];
    let of_model = [
        "--model",
        "acme-flux-2",
        "--model-dir",
        models,
        "--limits",
        "5-50",
    ];
    let set = vfd_gateway(&[&["write", "frequency", "25"][..], &of_model, &on_port].concat());
    assert!(set.status.success(), "{set:?}");

    let file = place.file("model.toml");
    let args = [
        &["acme-seven", "--out", file.to_str().unwrap()][..],
        &on_port,
    ]
    .concat();
    let general = ["", "", "", "", "", ""]; // maker, series, no manual, line, words, function 06
    let set_frequency = ["0x2001", "25", ""]; // taken for the output frequency here; the scale that was found is accepted
    let nothing_else = ["", "", "", "y"];
    let said = text(&answered(
        &args,
        &[&general[..], &set_frequency, &nothing_else].concat(),
    ));
    for word in [
        "the drive has 2500 (0x09C4) there",
        "[100]",
        "it takes no orders",
    ] {
        assert!(said.contains(word), "no {word}:\n{said}");
    }
    assert!(
        std::fs::read_to_string(&file)
            .unwrap()
            .contains("scale = 100")
    );
}

#[test]
fn a_device_template_becomes_a_model_that_is_only_read() {
    let place = Place::new();
    let template = r#"{ "device": { "name": "Acme Flux", "channels": [
        { "name": "Output Frequency", "reg_type": "holding", "address": 8449, "scale": 0.01, "units": "Hz" },
        { "name": "Energy", "reg_type": "holding", "address": 8450, "format": "u32" } ] } }"#;
    let template = place.write("config-acme.json", template);
    let file = place.file("model.toml");
    let made = made_from(&template, &file);
    assert!(
        made.contains("is valid: 1 register") && made.contains("it takes no orders"),
        "{made}"
    );
    let written = std::fs::read_to_string(&file).unwrap();
    assert!(
        written.contains("# Left out: Energy") && written.contains("unit = \"Hz\""),
        "{written}"
    );
    assert_says(
        &answered(&["acme-x", "--template", "/missing.json"], &[]),
        2,
        &["/missing.json"],
    );
}

fn made_from(template: &Path, file: &Path) -> String {
    let args = [
        "acme-flux",
        "--out",
        file.to_str().unwrap(),
        "--template",
        template.to_str().unwrap(),
    ];
    text(&answered(&args, &[]))
}

#[test]
fn a_skeleton_is_a_list_of_what_to_fill_and_replaces_no_file() {
    let place = Place::new();
    let file = place.file("flux.toml");
    let out = file.to_str().unwrap();
    let said = text(&answered(&["acme-flux-2", "--skeleton", "--out", out], &[]));
    assert!(said.contains("lists what is left to fill"), "{said}");
    assert_says(
        &vfd_gateway(&["models", "check", out]),
        2,
        &["run.stop.value", "link.bauds.value[0]"],
    );
    let before = std::fs::read(&file).unwrap();
    let again = answered(
        &["acme-flux-2", "--like", "hyundai-n700", "--out", out],
        &[],
    );
    assert_says(&again, 2, &["already exists and is not overwritten"]);
    assert_eq!(std::fs::read(&file).unwrap(), before);
}

#[test]
fn a_file_that_begins_from_another_model_says_what_is_unproven() {
    let place = Place::new();
    let file = place.file("like.toml");
    let said = text(&answered(
        &[
            "acme-flux-3",
            "--like",
            "hyundai-n700",
            "--out",
            file.to_str().unwrap(),
        ],
        &[],
    ));
    for word in [
        "is valid",
        "take orders only with accept_unverified",
        "stop: sibling",
    ] {
        assert!(said.contains(word), "no {word}:\n{said}");
    }
    let unknown = answered(
        &[
            "acme-x",
            "--like",
            "n70",
            "--out",
            place.file("x.toml").to_str().unwrap(),
        ],
        &[],
    );
    assert_says(
        &unknown,
        2,
        &["no model is called n70", "did you mean hyundai-n700"],
    );
}
