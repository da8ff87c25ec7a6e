//! Each language has each sentence, and none is missing or left over.

use super::*;
use crate::domain::command::{Outcome, Owner, Reason, Report};
use crate::domain::ids::Station;
use crate::domain::report::LineFault;
use crate::domain::suspicion::LineSuspicion;
use crate::domain::traffic::HeardFrame;
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

type Sentences = BTreeMap<String, String>;

/// Words and uses of values are English as they are.
const BY_LANGUAGE: [&str; 2] = ["word.", "role."];
const PLURALS: [&str; 6] = [".zero", ".one", ".two", ".few", ".many", ".other"];

fn sentences(catalogue: TextCatalogue) -> Sentences {
    serde_json::from_str(catalogue.text)
        .unwrap_or_else(|error| panic!("{}: {error}", catalogue.language))
}

/// The key without its plural.
fn base(key: &str) -> &str {
    PLURALS
        .iter()
        .find_map(|plural| key.strip_suffix(plural))
        .unwrap_or(key)
}

fn is_shared(key: &str) -> bool {
    !BY_LANGUAGE.iter().any(|prefix| key.starts_with(prefix))
}

fn places(sentence: &str) -> BTreeSet<&str> {
    sentence
        .split('{')
        .skip(1)
        .filter_map(|rest| Some(rest.split_once('}')?.0))
        .collect()
}

#[test]
fn each_language_has_each_sentence_with_the_same_places() {
    let english = sentences(CATALOGUES[0]);
    let keys: BTreeSet<_> = english.keys().map(|key| base(key)).collect();
    assert!(english.keys().all(|key| is_shared(key)));
    for catalogue in CATALOGUES {
        let own = sentences(catalogue);
        let has: BTreeSet<_> = own
            .keys()
            .filter(|key| is_shared(key))
            .map(|key| base(key))
            .collect();
        assert_eq!(
            has.symmetric_difference(&keys).collect::<Vec<_>>(),
            Vec::<&&str>::new(),
            "{}",
            catalogue.language
        );
        for (key, sentence) in own.iter().filter(|(key, _)| is_shared(key)) {
            let original = english
                .get(key)
                .or_else(|| english.get(&format!("{}.other", base(key))))
                .unwrap();
            assert_eq!(
                places(sentence),
                places(original),
                "{}: {key}",
                catalogue.language
            );
            assert!(!sentence.trim().is_empty(), "{}: {key}", catalogue.language);
        }
    }
}

#[test]
fn a_sentence_with_plurals_has_one_for_all_other_numbers() {
    for catalogue in CATALOGUES {
        let own = sentences(catalogue);
        for key in own
            .keys()
            .filter(|key| base(key) != *key && !own.contains_key(base(key)))
        {
            assert!(
                own.contains_key(&format!("{}.other", base(key))),
                "{}: {key}",
                catalogue.language
            );
        }
    }
}

#[test]
fn reasons_suspicions_and_faults_read_as_in_the_log() {
    for reason in Reason::ALL {
        assert_eq!(
            english(&format!("reason.{}", reason.keyword())),
            Some(reason.text())
        );
    }
    for fault in LineFault::ALL {
        assert_eq!(
            english(&format!("fault.{}", fault.keyword())),
            Some(&*fault.to_string())
        );
    }
    let station = Station(7);
    let suspicions = [
        LineSuspicion::NothingHeard,
        LineSuspicion::ServerSilent,
        LineSuspicion::DrivesAreFaster,
        LineSuspicion::DrivesAreSlower,
        LineSuspicion::AlwaysDamaged,
        LineSuspicion::OneSilent(station),
        LineSuspicion::OneUnitSilent(station),
        LineSuspicion::NotModbusTcp,
        LineSuspicion::WrongReplies {
            station,
            request: HeardFrame::of(&[7, 3, 0]),
            reply: HeardFrame::of(&[7, 4]),
        },
        LineSuspicion::DuplicateStation(station),
        LineSuspicion::LateBeyondLimit(station),
        LineSuspicion::OtherMaster,
        LineSuspicion::Echo,
        LineSuspicion::Jam,
    ];
    for suspicion in suspicions {
        assert_eq!(
            crate::north::finding::suspicion(suspicion).to_string(),
            suspicion.to_string()
        );
    }
}

#[test]
fn outcomes_read_as_on_all_other_interfaces() {
    let model = crate::north::stage::model();
    let mut reports: Vec<_> = Reason::ALL
        .iter()
        .map(|reason| Report::refused(*reason))
        .collect();
    reports.push(Report::held_by(Owner::Mqtt));
    reports.push(Report::new(Outcome::Unknown, Reason::LineDown));
    for report in reports {
        let said = crate::north::shown::said(&model, &report);
        assert_eq!(
            said.to_string(),
            crate::north::shown::message(&model, &report)
        );
    }
}

/// All files below `folder` whose name ends so.
fn texts_below(folder: &Path, ends: &[&str], all: &mut Vec<String>) {
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            texts_below(&path, ends, all);
        } else if ends.iter().any(|end| path.to_string_lossy().ends_with(end))
            && !path.to_string_lossy().contains("uplot")
        {
            all.push(std::fs::read_to_string(path).unwrap());
        }
    }
}

/// Keys that are named, and beginnings of keys that end with a word of the gateway.
#[derive(Default)]
struct Named {
    whole: BTreeSet<String>,
    begun: BTreeSet<String>,
}

impl Named {
    /// Takes what stands behind each `mark` up to `end`; `begins` opens a part that is put in.
    fn take(&mut self, text: &str, mark: &str, end: char, begins: &str) {
        for rest in text.split(mark).skip(1) {
            let key = rest.split(end).next().unwrap();
            match key.split_once(begins) {
                Some((begin, _)) => self.begun.insert(begin.to_owned()),
                None => self.whole.insert(key.to_owned()),
            };
        }
    }
}

/// Whether a quoted text of the page is a key of more than one word, and not the name of a file.
fn is_key(literal: &str) -> bool {
    let is_word = |word: &str| {
        !word.is_empty()
            && word
                .chars()
                .all(|it| it.is_ascii_lowercase() || it.is_ascii_digit() || it == '_')
    };
    let is_file = [".csv", ".json", ".gz", ".js", ".open"]
        .iter()
        .any(|end| literal.ends_with(end));
    literal.contains('.')
        && literal.split('.').all(is_word)
        && !is_file
        && !literal.starts_with("p99")
}

/// What page and gateway name.
fn named() -> Named {
    let source = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../..");
    let (mut page, mut program) = (Vec::new(), Vec::new());
    texts_below(
        &source.join("src/daemon/http/page/files"),
        &[".js", ".html"],
        &mut page,
    );
    texts_below(&source.join("crates/north/src"), &[".rs"], &mut program);
    let mut named = Named::default();
    for text in &page {
        for mark in [
            " t(\"",
            "(t(\"",
            "[t(\"",
            "{t(\"",
            "data-t=\"",
            "data-t-label=\"",
        ] {
            named.take(text, mark, '"', "${");
        }
        // Either of two sentences.
        let quoted = text.split('"').filter(|literal| is_key(literal));
        named.whole.extend(quoted.map(str::to_owned));
        for mark in ["t(`", "key: `", "catalogue[`"] {
            named.take(text, mark, '`', "${");
        }
    }
    for text in &program {
        let of_gateway =
            |key: &&str| is_key(key) && OF_GATEWAY.iter().any(|it| key.starts_with(it));
        named
            .whole
            .extend(text.split('"').filter(of_gateway).map(str::to_owned));
        named.take(text, "Sentence::new(\"", '"', "{");
        named.take(text, "Sentence::new(format!(\"", '"', "{");
    }
    named
}

#[test]
fn no_sentence_is_missing_and_none_is_left_over() {
    let named = named();
    let english = sentences(CATALOGUES[0]);
    let keys: BTreeSet<_> = english.keys().map(|key| base(key)).collect();
    assert!(
        named.whole.len() > 200,
        "the marks are still the right ones: {}",
        named.whole.len()
    );
    let missing: Vec<_> = named
        .whole
        .iter()
        .filter(|key| !key.is_empty() && !keys.contains(key.as_str()))
        .collect();
    assert!(missing.is_empty(), "{missing:?}");
    let is_begun = |key: &str| {
        named
            .begun
            .iter()
            .any(|begin| !begin.is_empty() && key.starts_with(begin.as_str()))
    };
    let left: Vec<_> = keys
        .iter()
        .filter(|key| !named.whole.contains(**key) && !is_begun(key))
        .collect();
    assert!(left.is_empty(), "{left:?}");
}

#[test]
fn the_page_lists_the_same_languages() {
    let script = include_str!("../../../../../src/daemon/http/page/files/texts.js");
    let listed = script
        .split_once("LANGUAGES = {")
        .unwrap()
        .1
        .split_once('}')
        .unwrap()
        .0;
    let codes: Vec<_> = listed
        .split(',')
        .map(|it| it.split(':').next().unwrap().trim())
        .collect();
    assert_eq!(codes, CATALOGUES.map(|it| it.language));
}

#[test]
fn chapters_are_whole_and_share_no_sentence() {
    for catalogue in CATALOGUES {
        let chapters = TextChapter::ALL
            .map(|chapter| serde_json::from_str::<Sentences>(&catalogue.chapter(chapter)).unwrap());
        assert!(
            chapters.iter().all(|chapter| chapter.len() > 50),
            "{}",
            catalogue.language
        );
        assert_eq!(
            chapters.iter().map(Sentences::len).sum::<usize>(),
            sentences(catalogue).len()
        );
    }
}
