//! What the fuzzer has found and what was given to it, played again: each file of `fuzz/corpus/` to its target.

use crate::fuzz_targets::TARGETS;
use std::collections::BTreeSet;
use std::fs;
use std::panic::catch_unwind;
use std::path::{Path, PathBuf};

/// Most files that the corpus of one target has, and most of their bytes together: it is kept small by hand.
const FILES_MAX: usize = 60;
const BYTES_MAX: usize = 200_000;

fn fuzz() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("fuzz")
}

/// Names of what is in `folder`, without the ending `.rs`.
fn names(folder: &Path) -> BTreeSet<String> {
    let entries =
        fs::read_dir(folder).unwrap_or_else(|error| panic!("{}: {error}", folder.display()));
    let name = |entry: fs::DirEntry| entry.file_name().into_string().unwrap();
    entries
        .map(|entry| name(entry.unwrap()).trim_end_matches(".rs").to_owned())
        .collect()
}

fn corpus(target: &str) -> Vec<(String, Vec<u8>)> {
    let folder = fuzz().join("corpus").join(target);
    let files = names(&folder).into_iter();
    files
        .map(|name| (name.clone(), fs::read(folder.join(&name)).unwrap()))
        .collect()
}

#[test]
fn every_target_has_a_binary_and_a_corpus_and_nothing_else_has() {
    let targets: BTreeSet<String> = TARGETS.iter().map(|(name, _)| (*name).to_owned()).collect();
    assert_eq!(targets.len(), TARGETS.len(), "a target twice");
    assert_eq!(names(&fuzz().join("corpus")), targets);
    assert_eq!(names(&fuzz().join("fuzz_targets")), targets);
    let manifest: toml::Table = fs::read_to_string(fuzz().join("Cargo.toml"))
        .unwrap()
        .parse()
        .unwrap();
    let binaries = manifest["bin"].as_array().unwrap().iter();
    assert_eq!(
        binaries
            .map(|bin| bin["name"].as_str().unwrap().to_owned())
            .collect::<BTreeSet<_>>(),
        targets
    );
    for target in &targets {
        let text =
            fs::read_to_string(fuzz().join("fuzz_targets").join(format!("{target}.rs"))).unwrap();
        assert!(
            text.contains(&format!("targets::{target}::run(bytes)")),
            "{target} calls another target"
        );
    }
}

#[test]
fn every_file_of_the_corpus_is_played() {
    let mut failed = Vec::new();
    for (target, run) in TARGETS {
        let files = corpus(target);
        let bytes: usize = files.iter().map(|(_, bytes)| bytes.len()).sum();
        assert!(
            !files.is_empty() && files.len() <= FILES_MAX && bytes <= BYTES_MAX,
            "{target}: {bytes} bytes"
        );
        let broken = files
            .into_iter()
            .filter(|(_, bytes)| catch_unwind(|| run(bytes)).is_err());
        failed.extend(broken.map(|(name, _)| format!("fuzz/corpus/{target}/{name}")));
    }
    assert!(
        failed.is_empty(),
        "a promise is broken by\n{}",
        failed.join("\n")
    );
}

/// A small campaign without a fuzzer: each file cut short, and with a byte changed.
#[test]
fn what_is_nearly_in_the_corpus_breaks_nothing_either() {
    for (target, run) in TARGETS {
        for (n, (_, bytes)) in corpus(target).into_iter().enumerate() {
            let at = (n * 7919) % bytes.len().max(1);
            run(&bytes[..at]);
            let mut changed = bytes;
            if let Some(byte) = changed.get_mut(at) {
                *byte = byte.wrapping_add(n as u8 | 1);
            }
            run(&changed);
        }
    }
}
