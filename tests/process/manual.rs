//! Completions and manual pages, as a shell and `man` understand them.

use super::rig::{Place, program, vfd_gateway};
use std::process::Command;
use vfd_gateway::domain::version::PROGRAM_VERSION;

/// A program that would complain of a language for which nothing is installed, and set pages for the width of a terminal.
fn in_any_place(name: &str) -> Command {
    let mut command = Command::new(name);
    for key in [
        "LANG",
        "LANGUAGE",
        "MANOPT",
        "MANROFFOPT",
        "MANWIDTH",
        "COLUMNS",
    ] {
        command.env_remove(key);
    }
    command.env("LC_ALL", "C.UTF-8");
    command
}

/// What bash offers for the last of `words`.
fn offered(script: &str, words: &[&str]) -> Vec<String> {
    let (last, before) = (
        words[words.len() - 1],
        words
            .get(words.len().wrapping_sub(2))
            .copied()
            .unwrap_or(""),
    );
    let ask = format!(
        "{script}\nCOMP_WORDS=({})\nCOMP_CWORD={}\n$(complete -p vfd-gateway | grep -o '_vfd[a-z_-]*') vfd-gateway '{last}' '{before}'\nprintf '%s\\n' \"${{COMPREPLY[@]}}\"",
        words
            .iter()
            .map(|word| format!("'{word}'"))
            .collect::<Vec<_>>()
            .join(" "),
        words.len() - 1,
    );
    let output = in_any_place("bash")
        .args(["--norc", "-c", &ask])
        .output()
        .unwrap();
    assert_eq!(String::from_utf8_lossy(&output.stderr), "");
    String::from_utf8(output.stdout)
        .unwrap()
        .lines()
        .map(str::to_owned)
        .collect()
}

#[test]
fn bash_completes_commands_sub_commands_and_options() {
    let output = vfd_gateway(&["completions", "bash"]);
    assert!(output.status.success());
    let script = String::from_utf8(output.stdout).unwrap();
    assert_eq!(offered(&script, &["vfd-gateway", "che"]), ["check"]);
    assert_eq!(offered(&script, &["vfd-gateway", "models", "sh"]), ["show"]);
    assert_eq!(
        offered(&script, &["vfd-gateway", "map", "--for"]),
        ["--format"]
    );
    assert_eq!(
        offered(&script, &["vfd-gateway", "map", "--format", ""]),
        ["csv", "md"]
    );
    let all = offered(&script, &["vfd-gateway", ""]);
    assert!(
        ["run", "map", "--help"]
            .iter()
            .all(|word| all.contains(&(*word).to_owned())),
        "{all:?}"
    );
}

#[test]
fn every_shell_gets_a_script_and_another_one_is_wrong_usage() {
    for shell in ["bash", "elvish", "fish", "powershell", "zsh"] {
        let output = vfd_gateway(&["completions", shell]);
        assert!(
            output.status.success() && output.stdout.len() > 1000,
            "{shell}"
        );
    }
    assert_eq!(vfd_gateway(&["completions", "cmd"]).status.code(), Some(2));
}

#[test]
fn man_shows_a_page_for_each_command() {
    let place = Place::new();
    let dir = place.file("man1");
    std::fs::create_dir(&dir).unwrap();
    assert!(
        vfd_gateway(&["man", "--dir", dir.to_str().unwrap()])
            .status
            .success()
    );
    let mut names: Vec<_> = std::fs::read_dir(&dir)
        .unwrap()
        .map(|it| it.unwrap().file_name())
        .collect();
    names.sort();
    let names: Vec<_> = names.iter().map(|name| name.to_str().unwrap()).collect();
    for name in [
        "vfd-gateway.1",
        "vfd-gateway-run.1",
        "vfd-gateway-models-show.1",
        "vfd-gateway-map.1",
    ] {
        assert!(names.contains(&name), "no {name} among {names:?}");
    }
    assert!(
        !names
            .iter()
            .any(|name| name.contains("broker") || name.contains("help")),
        "{names:?}"
    );
    for name in &names {
        let parsed = Command::new("lexgrog")
            .arg(dir.join(name))
            .output()
            .unwrap();
        let text = String::from_utf8_lossy(&parsed.stdout).into_owned();
        assert!(
            parsed.status.success() && text.contains(" - "),
            "{name}: {text}"
        );
    }
    let mut man = in_any_place("man");
    let page = man
        .args(["--warnings", "-E", "UTF-8", "-P", "cat", "-l"])
        .arg(dir.join(names[1]))
        .output()
        .unwrap();
    assert_eq!(String::from_utf8_lossy(&page.stderr), "");
    let text = String::from_utf8_lossy(&page.stdout);
    assert!(
        text.contains("Exit codes: 0") && text.contains(&format!("vfd-gateway {PROGRAM_VERSION}")),
        "{text}"
    );
}

#[test]
fn the_page_of_the_program_is_printed() {
    let page = vfd_gateway(&["man"]).stdout;
    assert!(
        String::from_utf8(page)
            .unwrap()
            .contains(".TH vfd-gateway 1")
    );
    let nowhere = program()
        .args(["man", "--dir", "/nowhere/at/all"])
        .output()
        .unwrap();
    assert_eq!(nowhere.status.code(), Some(1));
    assert!(String::from_utf8_lossy(&nowhere.stderr).contains("/nowhere/at/all"));
}

#[test]
fn map_says_what_is_wrong() {
    let place = Place::new();
    let line = "[[line]]\nname = \"hall-1\"\nport = \"/dev/ttyUSB0\"\n[[line.drive]]\nname = \"pump-1\"\n\
                model = \"teco-e510\"\nstation = 1\n";
    let file = place.write("map.toml", line);
    let map = |more: &[&str]| vfd_gateway(&[&["map", "-c", file.to_str().unwrap()], more].concat());
    let none = map(&[]);
    assert_eq!(none.status.code(), Some(2));
    assert!(String::from_utf8_lossy(&none.stderr).contains("[[modbus_tcp]]"));
    place.write(
        "map.toml",
        &format!("{line}[[modbus_tcp]]\nlisten = \"127.0.0.1:1502\"\n"),
    );
    let other = map(&["--unit", "7"]);
    assert_eq!(other.status.code(), Some(2));
    assert!(String::from_utf8_lossy(&other.stderr).contains("units are 1, 101, 255"));
    let one = map(&["--unit", "101", "--json"]);
    let value: serde_json::Value = serde_json::from_slice(&one.stdout).unwrap();
    assert_eq!(value["maps"].as_array().unwrap().len(), 1);
    assert_eq!(map(&["--json", "--format", "csv"]).status.code(), Some(2));
}
