//! What people call parts of the plant.

use super::{CONTROLLED, drive_with, good, only, with};
use crate::config::change::ConfigChange;
use crate::north::titles::PartTitle;

/// `MINIMAL` with a title of the drive, written as it is in the file.
fn titled(title: &str) -> String {
    drive_with(&format!("title = {title}"))
}

/// `CONTROLLED` with a title for each part.
fn everywhere() -> String {
    let mut text = with(
        CONTROLLED,
        "\"plant-a\"\n",
        "\"plant-a\"\ntitle = \"Werk Süd\"\n",
    );
    text = with(&text, "\"hall-1\"\n", "\"hall-1\"\ntitle = \"قاعة\"\n");
    text = with(
        &text,
        "\"pump-1\"\n",
        "\"pump-1\"\ntitle = \"Umwälzpumpe\"\ngroup = \"water\"\n",
    );
    text + "[[group]]\nname = \"water\"\ntitle = \"Wasser & Abwasser\"\n"
}

#[test]
fn each_part_has_a_title_of_any_letters_and_keeps_its_name() {
    let config = good(&everywhere());
    let titles = &config.titles;
    assert_eq!(
        titles.gateway.as_ref().map(PartTitle::as_str),
        Some("Werk Süd")
    );
    assert_eq!(titles.lines["hall-1"].as_str(), "قاعة");
    assert_eq!(titles.drives["pump-1"].as_str(), "Umwälzpumpe");
    assert_eq!(titles.drives.get("pump-2"), None);
    assert_eq!(titles.groups["water"].as_str(), "Wasser & Abwasser");
    assert_eq!(config.lines[0].drives[0].name.as_str(), "pump-1");
    assert!(config.warnings.is_empty(), "{:?}", config.warnings);
    assert!(good(CONTROLLED).titles.is_empty());
    let longest = titled(&format!("\"{}\"", "ü".repeat(80)));
    assert_eq!(good(&longest).titles.drives["pump-1"].as_str().len(), 160);
}

#[test]
fn a_title_is_short_and_acts_on_no_other_text() {
    let right = "1 to 80 characters of any language, on one line";
    for (title, why) in [
        ("\"\"", "is empty".to_owned()),
        ("\" \\u00a0\"", "is empty".to_owned()),
        ("7", "must be text, not a whole number".to_owned()),
        (
            &format!("\"{}\"", "ü".repeat(81)),
            "has 81 characters".to_owned(),
        ),
        ("\"a\\u001b[2Jb\"", hidden("001B")),
        ("\"a\\nb\"", hidden("000A")),
        ("\"a\\u202eb\"", hidden("202E")),
        ("\"a\\u2066b\"", hidden("2066")),
        ("\"a\\u200bb\"", hidden("200B")),
    ] {
        let expected = format!("line[0].drive[0].title: {why}; {right}");
        only(&titled(title), &expected);
    }
    only(
        &with(CONTROLLED, "[gateway]\n", "[gateway]\ntitle = \"\"\n"),
        &format!("gateway.title: is empty; {right}"),
    );
}

#[test]
fn no_two_drives_look_alike() {
    let second = |title: &str| {
        let titled = format!("name = \"pump-2\"\ntitle = \"{title}\"\n");
        with(&everywhere(), "name = \"pump-2\"\n", &titled)
    };
    good(&second("Umwälzpumpe 2"));
    // Also in capitals, with a mark that is not seen, or as the name of another.
    for title in ["Umwälzpumpe", "UMWÄLZPUMPE", "Umwälz\\uFE0Fpumpe", "pump-1"] {
        only(
            &second(title),
            "line[0].drive[1].title: another drive, `pump-1`, has this name or title already; a title of its own for each drive",
        );
    }
}

/// Why a title with this character is refused.
fn hidden(code: &str) -> String {
    format!("contains the character U+{code}, which is not shown and acts on other text")
}

#[test]
fn a_group_with_a_title_has_drives_and_is_there_once() {
    let twice = everywhere() + "[[group]]\nname = \"water\"\ntitle = \"x\"\n";
    only(
        &twice,
        "group[1].name: the name `water` is taken by group[0].name; a name that no other group uses",
    );
    let config = good(&(CONTROLLED.to_owned() + "[[group]]\nname = \"wter\"\ntitle = \"x\"\n"));
    let [warning] = &config.warnings[..] else {
        panic!("{:?}", config.warnings);
    };
    assert_eq!(
        (warning.key.as_str(), warning.what.as_str()),
        ("group[0].name", "no drive is in the group `wter`")
    );
}

#[test]
fn a_title_that_changes_restarts_no_line_and_is_reported() {
    let change = ConfigChange::between(&good(CONTROLLED), &good(&everywhere()));
    assert!(change.needs_restart.is_empty());
    // The drive is in a group now, which it tells its line.
    assert_eq!(change.continues, [None]);
    let change = ConfigChange::between(
        &good(&with(&everywhere(), "Umwälzpumpe", "Pumpe")),
        &good(&everywhere()),
    );
    assert_eq!(
        (&change.continues[..], &change.ended[..]),
        (&[Some(0)][..], &[][..])
    );
    let notes: Vec<_> = change.notes.iter().map(ToString::to_string).collect();
    assert_eq!(notes, ["drive pump-1: changed"]);
    for (old, new, note) in [
        ("Werk Süd", "Werk Nord", "gateway: changed"),
        ("قاعة", "صالة", "line hall-1: changed"),
        ("Wasser &", "Wasser und", "group water: changed"),
    ] {
        let change =
            ConfigChange::between(&good(&everywhere()), &good(&with(&everywhere(), old, new)));
        assert_eq!(change.continues, [Some(0)], "{note}");
        let notes: Vec<_> = change.notes.iter().map(ToString::to_string).collect();
        assert_eq!(notes, [note]);
    }
}
