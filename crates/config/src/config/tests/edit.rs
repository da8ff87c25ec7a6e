//! Changes to a file leave everything else in it as it is.

use crate::config::edit::{CannotEdit, EditedText, with_control, with_line};
use crate::config::written::{NewControl, NewDrive, NewLine};
use crate::config::{self, PortAddress};
use crate::domain::link::LinkSettings;
use crate::vendors;
use std::sync::Arc;

const MODEL: &str = "hyundai-n700";

fn line(name: &str, drives: &[(&str, u8)]) -> NewLine {
    let model = Arc::clone(vendors::catalog().find(MODEL).unwrap());
    let drive = |(name, station): &(&str, u8)| NewDrive {
        name: (*name).to_owned(),
        model: Arc::clone(&model),
        station: *station,
        unit: None,
        full_scale_hz: None,
        why: "chosen".to_owned(),
        control: None,
    };
    NewLine {
        name: name.to_owned(),
        port: PortAddress::Device("/dev/ttyUSB7".into()),
        link: LinkSettings::DEFAULT,
        is_ascii: false,
        echoes: false,
        drives: drives.iter().map(drive).collect(),
        notes: vec!["Station 9 answers elsewhere.".to_owned()],
    }
}

fn control() -> NewControl {
    NewControl {
        from: vec!["page".to_owned()],
        limits_hz: (5.0, 50.0),
        has_reverse: false,
        on_commander_lost: "stop".to_owned(),
        lost_after: "10s".to_owned(),
        on_shutdown: "stop".to_owned(),
        accepts_unproven: false,
    }
}

const PLANT: &str = "\
# The plant of hall 1.
[gateway]
name = \"plant\" # as on the sign

[[line]]
name = \"hall-1\" # by the door
port = \"/dev/ttyUSB0\"

  [[line.drive]]
  name = \"pump-1\"
  model = \"hyundai-n700\" # from the nameplate
  station = 1
    [line.drive.native]
    write = []
    # nothing so far

  # The second one.
  [[line.drive]]
  name = \"pump-2\"
  model = \"hyundai-n700\"
  station = 2

# For the PLC.
[[modbus_tcp]]
listen = \"127.0.0.1:1502\"
lines = [\"hall-1\"]
# The end.
";

/// What was there before is there, and nothing else besides what was added.
#[track_caller]
fn keeps(old: &str, edited: &EditedText) {
    let mut rest = edited.text.clone();
    rest.replace_range(edited.added.clone(), "");
    assert_eq!(rest.trim_end(), old.trim_end());
}

#[test]
fn a_line_follows_the_last_one_and_every_comment_stays() {
    let edited = with_line(PLANT, &line("hall-2", &[("fan-1", 1)])).unwrap();
    keeps(PLANT, &edited);
    let of = |what: &str| edited.text.find(what).unwrap();
    assert!(
        of("pump-2") < of("hall-2") && of("hall-2") < of("# For the PLC."),
        "{}",
        edited.text
    );
    let loaded = config::load(&edited.text, &vendors::catalog()).unwrap();
    let names: Vec<_> = loaded
        .lines
        .iter()
        .map(|line| (line.name.to_string(), line.drives.len()))
        .collect();
    assert_eq!(names, [("hall-1".to_owned(), 2), ("hall-2".to_owned(), 1)]);
}

#[test]
fn the_first_line_of_a_file_goes_to_its_end() {
    for text in [
        "",
        "# nothing yet",
        "[http]\nlisten = \"127.0.0.1:8080\" # here",
        "[gateway]\r\nname = \"a\"\r\n",
    ] {
        let edited = with_line(text, &line("hall-1", &[("fan-1", 1), ("fan-2", 2)])).unwrap();
        keeps(text, &edited);
        assert_eq!(
            config::load(&edited.text, &vendors::catalog())
                .unwrap()
                .lines[0]
                .drives
                .len(),
            2
        );
        assert_eq!(
            edited.text.matches("\r\n").count() > 2,
            text.contains('\r'),
            "{:?}",
            edited.text
        );
        assert!(!edited.text.replace("\r\n", "").contains('\r') || text.contains('\r'));
    }
}

#[test]
fn control_goes_to_the_drive_that_it_is_for() {
    for (name, before) in [
        ("pump-1", "# The second one."),
        ("pump-2", "# For the PLC."),
    ] {
        let edited = with_control(PLANT, name, &control()).unwrap();
        keeps(PLANT, &edited);
        assert!(
            edited.added.end <= edited.text.find(before).unwrap(),
            "{}",
            edited.text
        );
        let text = edited
            .text
            .replace("from = [\"page\"]", "from = [\"modbus-tcp\"]");
        let text = text.replace(
            "listen = \"127.0.0.1:1502\"",
            "listen = \"127.0.0.1:1502\"\nwrite = [\"127.0.0.1/32\"]",
        );
        let loaded = config::load(&text, &vendors::catalog()).unwrap();
        let controlled = loaded.lines[0]
            .drives
            .iter()
            .filter(|drive| drive.control.is_some());
        assert_eq!(
            controlled
                .map(|drive| drive.name.to_string())
                .collect::<Vec<_>>(),
            [name]
        );
    }
}

#[test]
fn what_cannot_be_changed_safely_is_left_to_a_person() {
    let inline = "line = [{ name = \"a\", port = \"/dev/ttyUSB0\", drive = [{ name = \"p\", model = \"hyundai-n700\", station = 1 }] }]\n";
    let drive_inline = "[[line]]\nname = \"a\"\nport = \"/dev/ttyUSB0\"\ndrive = [{ name = \"p\", model = \"hyundai-n700\", station = 1 }]\n";
    let has = with_control(PLANT, "pump-1", &control()).unwrap().text;
    let error_text = |done: Result<EditedText, CannotEdit>| done.unwrap_err().to_string();
    for (what, why) in [
        (with_line(inline, &line("b", &[])), "writes `line` inline"),
        (
            with_control(inline, "p", &control()),
            "writes `drive` inline",
        ),
        (
            with_control(drive_inline, "p", &control()),
            "writes `drive` inline",
        ),
        (
            with_control(PLANT, "pump-9", &control()),
            "no drive `pump-9`",
        ),
        (
            with_control(&has, "pump-1", &control()),
            "has a [line.drive.control] already",
        ),
        (with_line("[line", &line("b", &[])), "not valid TOML"),
        (with_line("line = 3", &line("b", &[])), "inline"),
    ] {
        let found = error_text(what);
        assert!(found.contains(why), "{found}");
    }
    // Its header looks like another one where a text in several lines holds one.
    let hidden = PLANT.replace("name = \"plant\"", "name = \"\"\"plant\\\n[[line]]\"\"\"");
    keeps(&hidden, &with_line(&hidden, &line("hall-2", &[])).unwrap());
}
