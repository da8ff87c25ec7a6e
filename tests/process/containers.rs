//! What the Dockerfile and its guide say of the program is true. `tests/run image` makes the image and tries it.

use super::rig::vfd_gateway;
use std::path::Path;

fn read(name: &str) -> String {
    std::fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join(name)).unwrap()
}

/// What stands behind `begin` in its line.
fn behind<'a>(text: &'a str, begin: &str) -> &'a str {
    let mut found = text
        .lines()
        .filter_map(|line| line.trim_start().split_once(begin))
        .map(|(_, rest)| rest);
    let rest = found
        .next()
        .unwrap_or_else(|| panic!("there is no {begin}"));
    assert_eq!(found.next(), None, "{begin} once");
    rest
}

/// Whether the program knows these arguments: it shows help instead of doing it only if all before are right.
#[track_caller]
fn assert_understood(words: &[String]) {
    let mut args: Vec<&str> = words.iter().map(String::as_str).collect();
    args.push("--help");
    let output = vfd_gateway(&args);
    assert!(
        output.status.success(),
        "{words:?}: {}",
        String::from_utf8_lossy(&output.stderr)
    );
}

/// The words of a command that is written as a list.
fn list(text: &str) -> Vec<String> {
    serde_json::from_str(text).unwrap_or_else(|error| panic!("{text}: {error}"))
}

#[test]
fn the_dockerfile_names_this_version_and_a_compiler_that_is_new_enough() {
    let (dockerfile, manifest) = (read("Dockerfile"), read("Cargo.toml"));
    assert_eq!(
        behind(&dockerfile, "ARG VERSION="),
        env!("CARGO_PKG_VERSION")
    );
    let numbers = |text: &str| -> Vec<u32> {
        text.trim_matches('"')
            .split('.')
            .map(|number| number.parse().unwrap())
            .collect()
    };
    assert!(
        numbers(behind(&dockerfile, "ARG RUST=")) >= numbers(behind(&manifest, "rust-version = "))
    );
}

#[test]
fn the_image_starts_and_checks_itself_with_commands_that_there_are() {
    let dockerfile = read("Dockerfile");
    assert_eq!(list(behind(&dockerfile, "ENTRYPOINT ")), ["vfd-gateway"]);
    let lines: Vec<_> = dockerfile
        .lines()
        .filter(|line| line.starts_with("CMD "))
        .collect();
    let [started] = lines[..] else {
        panic!("one CMD, not {lines:?}")
    };
    assert_understood(&list(started.trim_start_matches("CMD ")));
    let check = behind(&dockerfile, "HEALTHCHECK ");
    let (_, check) = check.split_once(" CMD ").unwrap();
    let check = list(check);
    assert_eq!(check[0], "vfd-gateway");
    assert_understood(&check[1..]);
}

#[test]
fn the_guide_types_commands_that_there_are() {
    let guide = read("docs/container.md");
    let typed: Vec<_> = guide
        .lines()
        .filter_map(|line| line.strip_prefix("docker exec vfd-gateway vfd-gateway "))
        .collect();
    assert!(typed.len() >= 3, "{typed:?}");
    for words in typed {
        assert_understood(&words.split(' ').map(str::to_owned).collect::<Vec<_>>());
    }
    let lists: Vec<_> = guide
        .lines()
        .filter_map(|line| line.trim_start().strip_prefix("command: "))
        .collect();
    assert!(!lists.is_empty());
    for words in lists {
        assert_understood(&list(words)[1..]);
    }
}
