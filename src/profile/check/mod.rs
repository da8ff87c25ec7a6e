//! From the text of a model file to a sound model, or to all its problems at once.

mod exchange;
mod link;
mod registers;
mod run;
mod setup;
mod status;

use super::file::ModelFile;
use super::model::Model;
use super::reader::{self, Given, Written};
use super::register::{RegisterFile, named};
use crate::domain::problem::{Problem, nearest};
use std::collections::BTreeMap;

/// The model that `text` describes.
///
/// # Errors
/// All problems of the file, in the order of their places. A fact must cite one of the file's documents; only
/// a time on the line may be a cautious choice of ours instead.
pub fn model(text: &str) -> Result<Model, Vec<Problem>> {
    let mut problems = Vec::new();
    let model = reader::document(text, &mut problems).and_then(|document| {
        let file = ModelFile::read(document.section(), &mut problems);
        compare(&file, &mut problems);
        file.ready()
    });
    problems.sort_by_key(|problem| problem.span.start);
    model.filter(|_| problems.is_empty()).ok_or(problems)
}

/// The rules between the keys of a file.
fn compare(file: &ModelFile, problems: &mut Vec<Problem>) {
    if let Some(link) = &file.link {
        link::check(link, problems);
    }
    exchange::check(file, problems);
    registers::check(file, problems);
    if let Given::Usable(run) = &file.run {
        run::check(&run.value, &run.place, &file.registers, problems);
    }
    status::check(file, problems);
    setup::check(file, problems);
}

/// Reports each of `written` that stands there twice, at its second place.
fn once<'f, T: Ord + 'f>(
    written: impl IntoIterator<Item = &'f Written<T>>,
    called: impl Fn(&T) -> String,
    right: &str,
    problems: &mut Vec<Problem>,
) {
    let mut taken: BTreeMap<&T, &str> = BTreeMap::new();
    for Written { value, place } in written {
        match taken.get(value) {
            Some(first) => {
                problems.push(place.problem(format!("{} is taken by {first}", called(value))).right(right));
            }
            None => {
                taken.insert(value, &place.key);
            }
        }
    }
}

/// The register that is meant by `name`, which must be readable.
fn readable<'f>(
    name: &Written<String>,
    registers: &'f [RegisterFile],
    problems: &mut Vec<Problem>,
) -> Option<&'f RegisterFile> {
    let Some(register) = named(&name.value, registers) else {
        let names = registers.iter().filter_map(|register| Some(register.name.as_ref()?.value.as_str()));
        let right = match nearest(&name.value, names) {
            Some(near) => format!("`{near}`"),
            None => "the `name` of a register".to_owned(),
        };
        problems.push(name.place.problem(format!("no register is called `{}`", name.value)).right(right));
        return None;
    };
    if register.access.as_ref().is_some_and(|access| !access.value.can_read()) {
        let problem = name.place.problem(format!("`{}` cannot be read", name.value));
        problems.push(problem.right("a register with access \"read\" or \"read-write\""));
    }
    Some(register)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::domain::link::LinkSettings;
    use crate::profile::model::Confidence;
    use crate::profile::testing::{MODEL, told};
    use std::time::Duration;

    /// What is told when `from`, which the sound model has, reads `to` instead.
    fn told_with(from: &str, to: &str) -> String {
        assert!(MODEL.contains(from), "{from}");
        let text = MODEL.replacen(from, to, 1);
        told(&model(&text).unwrap_err(), &text)
    }

    fn golden(name: &str, found: &str) {
        let path = format!("{}/tests/golden/models/{name}", env!("CARGO_MANIFEST_DIR"));
        if std::env::var_os("UPDATE_GOLDEN").is_some() {
            std::fs::write(&path, found).unwrap();
        }
        assert_eq!(found, std::fs::read_to_string(&path).unwrap(), "{path}");
    }

    #[test]
    fn a_reset_is_framed_by_stops() {
        let with = |sequence: &str| {
            let fact = |value| format!("{{ value = {value}, confidence = \"manual\", source = \"IM 1\" }}");
            let run = format!("[run]\nstop = {}\nforward = {}\nreset = {}\n{sequence}\n\n", fact(0), fact(1), fact(4));
            let register = "[[register]]\nname = \"run\"\ntitle = \"Run\"\naddress = 2\nscale = 1\nunit = \"-\"\n\
                            access = \"write\"\nrole = \"run-command\"\nconfidence = \"manual\"\nsource = \"IM 1\"\n\n";
            told_with("[[register]]", &format!("{run}{register}[[register]]"))
        };
        for wrong in ["", "reset_sequence = [4]", "reset_sequence = [0, 4, 1]", "reset_sequence = [0, 0, 0]"] {
            assert!(with(wrong).contains("right: [0, 4, 0]"), "{wrong}: {}", with(wrong));
        }
    }

    #[test]
    fn a_sound_file_is_a_model() {
        let model = model(MODEL).unwrap();
        assert_eq!(model.link.default.value, LinkSettings::DEFAULT);
        assert_eq!(model.link.stations.value, 1..=247);
        assert_eq!(model.timing.max_lateness.value, Duration::from_secs(1));
        assert_eq!(model.timing.max_lateness.confidence, Confidence::Default);
        assert_eq!((model.run, model.link.broadcast, model.read.boundary), (None, None, None));
        assert_eq!(model.registers[0].source, "IM 4");
    }

    #[test]
    fn all_mistakes_are_told_at_once() {
        let text = include_str!("../../../tests/golden/models/mistakes.toml");
        golden("mistakes.txt", &told(&model(text).unwrap_err(), text));
    }

    #[test]
    fn what_is_no_toml_is_told_alone() {
        let found = told_with("vendor = \"Acme\"", "vendor = ");
        assert!(found.starts_with("2:") && found.contains(": this is no TOML: "), "{found}");
        assert_eq!(found.lines().count(), 2, "{found}");
    }

    #[test]
    fn an_empty_file_tells_what_a_model_needs() {
        let found = told(&model("").unwrap_err(), "");
        let keys: Vec<_> = found.lines().filter_map(|line| line.strip_prefix("1:1 ")?.split(':').next()).collect();
        assert_eq!(keys, ["documents", "id", "vendor", "title", "link", "timing", "read", "write"]);
    }

    #[test]
    fn a_run_table_without_its_register_is_told() {
        let fact = |value| format!("{{ value = {value}, confidence = \"manual\", source = \"IM 5\" }}");
        let run = format!("[run]\nstop = {}\nforward = {}\n\n[[register]]", fact(0), fact(1));
        let found = told_with("[[register]]", &run);
        let expected = "\
29:1 run: no register takes the run commands
    right: a register with `role = \"run-command\"`
";
        assert_eq!(found, expected);
    }

    #[test]
    fn barriers_keep_to_what_one_read_may_have() {
        let barrier =
            |address, count| format!("[[barrier_read]]\naddress = {address}\ncount = {count}\n\n[[register]]");
        let found = told_with("[[register]]", &barrier("0x0101", 5));
        let expected = "\
31:9 barrier_read[0].count: more words than one read from this address may have
    right: at most 4
";
        assert_eq!(found, expected);

        let found = told_with("[[register]]", &barrier("0x0101", 2));
        let expected = "\
29:1 barrier_read[0]: no register that can be read is at 0x0102
    right: a range whose every register can be read
";
        assert_eq!(found, expected);

        let text = MODEL.replacen("[write]", "boundary = \"high-byte\"\n\n[write]", 1);
        let text = text.replacen("[[register]]", &barrier("0x01FF", 2), 1);
        assert!(told(&model(&text).unwrap_err(), &text).contains("right: at most 1\n"));
    }

    #[test]
    fn the_broadcast_is_no_station() {
        let found = told_with(
            "[timing]",
            "[link.broadcast]\nstation = 9\nfunctions = [6]\nconfidence = \"manual\"\nsource = \"IM 1\"\n\n[timing]",
        );
        let expected = "\
19:11 link.broadcast.station: the broadcast is also the station of one drive
    right: a number outside 1 to 247
";
        assert_eq!(found, expected);
    }

    #[test]
    fn a_source_is_not_told_wrong_while_the_documents_are_missing() {
        let found = told_with("[documents]\nIM = \"Interface manual\"\n", "");
        assert_eq!(found, "1:1 documents: `documents` is missing\n    right: a table `documents`\n");
    }
}
