//! From the text of a model file to a sound model, or to all its problems at once.

use super::file::{BarrierFile, BarrierForm, BlockFile, FactFile, LinkFile, ModelFile, ReadFile, RunFile};
use super::model::{Model, Role};
use super::reader::{self, Given, Needed, Place, Written};
use super::register::{RegisterFile, distinct};
use crate::domain::problem::Problem;
use std::collections::{BTreeMap, BTreeSet};

/// Most words of a reset sequence.
const RESET_WORDS_MAX: usize = 8;

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
        defaults_are_allowed(link, problems);
        stations_are_apart(link, problems);
    }
    distinct(&[], &file.registers, problems);
    for barrier in &file.barriers {
        barrier_is_sound(barrier, file, problems);
    }
    if let Given::Usable(run) = &file.run {
        run_values_differ(&run.value, problems);
        reset_is_framed(&run.value, &run.place, problems);
        commands_are_taken(&run.place, &file.registers, problems);
    }
    for role in [Role::RunCommand, Role::FrequencyCommand] {
        role_is_writable(role, &file.registers, problems);
    }
}

/// Each default setting is one of those that can be set.
fn defaults_are_allowed(link: &LinkFile, problems: &mut Vec<Problem>) {
    let Some(Written { value: default, .. }) = &link.default.value else { return };
    one_of(&default.baud, &link.bauds, "bauds", problems);
    one_of(&default.data_bits, &link.data_bits, "data_bits", problems);
    one_of(&default.parity, &link.parities, "parities", problems);
    one_of(&default.stop_bits, &link.stop_bits, "stop_bits", problems);
}

fn one_of<T: PartialEq>(value: &Needed<T>, allowed: &FactFile<Vec<T>>, name: &str, problems: &mut Vec<Problem>) {
    if let (Some(value), Some(allowed)) = (value, &allowed.value)
        && !allowed.value.contains(&value.value)
    {
        problems.push(value.place.problem("the default cannot be set").right(format!("one of `link.{name}`")));
    }
}

/// The range of stations is not empty, and the broadcast is none of them.
fn stations_are_apart(link: &LinkFile, problems: &mut Vec<Problem>) {
    let Some(Written { value: stations, .. }) = &link.stations.value else { return };
    let (Some(from), Some(to)) = (&stations.from, &stations.to) else { return };
    if from.value > to.value {
        let problem = to.place.problem(format!("the last station is below the first, {}", from.value));
        problems.push(problem.right(format!("{} to 247", from.value)));
    }
    let broadcast = link.broadcast.as_ref().and_then(|broadcast| broadcast.value.as_ref()?.value.station.as_ref());
    if let Some(broadcast) = broadcast.filter(|it| (from.value..=to.value).contains(&it.value)) {
        let problem = broadcast.place.problem("the broadcast is also the station of one drive");
        problems.push(problem.right(format!("a number outside {} to {}", from.value, to.value)));
    }
}

/// A barrier lies within one read and covers only registers that can be read.
fn barrier_is_sound(barrier: &BarrierFile, file: &ModelFile, problems: &mut Vec<Problem>) {
    let Some(BarrierForm::Read(BlockFile { address: Some(address), count: Some(count) })) = &barrier.form else {
        return;
    };
    let limits = file.read.as_ref().and_then(ReadFile::ready);
    if let Some(most) = limits.map(|it| it.words_from(address.value)).filter(|most| *most < count.value) {
        let problem = count.place.problem("more words than one read from this address may have");
        problems.push(problem.right(format!("at most {most}")));
        return;
    }
    if let Some(unreadable) = first_unreadable(address.value, count.value, &file.registers) {
        let what = format!("no register that can be read is at 0x{unreadable:04X}");
        problems.push(barrier.place.problem(what).right("a range whose every register can be read"));
    }
}

/// The first address of the range where no readable register is; nothing also where a register is not known well
/// enough to tell.
fn first_unreadable(address: u16, count: u16, registers: &[RegisterFile]) -> Option<u32> {
    let mut readable = BTreeSet::new();
    for register in registers {
        let (address, access) = (register.address.as_ref()?, register.access.as_ref()?);
        readable.extend(access.value.can_read().then_some(u32::from(address.value)));
    }
    let first = u32::from(address);
    (first..first + u32::from(count)).find(|address| !readable.contains(address))
}

/// No two run commands have the same value.
fn run_values_differ(run: &RunFile, problems: &mut Vec<Problem>) {
    let mut taken: BTreeMap<u16, &Place> = BTreeMap::new();
    for Written { value, place } in run.words().map(|(_, word)| word) {
        let Some(first) = taken.get(value) else {
            taken.insert(*value, place);
            continue;
        };
        let problem = place.problem(format!("the value {value} is taken by {}", first.key));
        problems.push(problem.right("a value that no other run command has"));
    }
}

/// A reset is written between stops and never carries an order to run.
fn reset_is_framed(run: &RunFile, run_place: &Place, problems: &mut Vec<Problem>) {
    let value = |fact: &FactFile<u16>| fact.value.as_ref().map(|written| written.value);
    let Some(reset) = run.reset.as_ref() else {
        if let Given::Usable(sequence) = &run.reset_sequence {
            problems.push(sequence.place.problem("there is no `reset` to write").right("a value for `reset`"));
        }
        return;
    };
    let (Some(reset), Some(stop)) = (value(reset), value(&run.stop)) else { return };
    let right = format!("[{stop}, {reset}, {stop}], or longer with nothing else in it");
    match &run.reset_sequence {
        Given::LeftOut => {
            let what = "`reset_sequence` is left out, and `reset` is given";
            problems.push(run_place.missing("reset_sequence").problem(what).right(right));
        }
        Given::Unusable => {}
        Given::Usable(sequence) => {
            let words: Vec<u16> = sequence.value.iter().map(|word| word.value).collect();
            let framed = words.first() == Some(&stop);
            let only = words.iter().all(|word| *word == stop || *word == reset) && words.contains(&reset);
            if !(framed && only && words.len() <= RESET_WORDS_MAX) {
                let what = "a reset is written between stops and with nothing else";
                problems.push(sequence.place.problem(what).right(right));
            }
        }
    }
}

/// Some register takes the run commands.
fn commands_are_taken(run: &Place, registers: &[RegisterFile], problems: &mut Vec<Problem>) {
    let may_be = |register: &RegisterFile| match &register.role {
        Given::LeftOut => false,
        Given::Unusable => true,
        Given::Usable(role) => role.value == Role::RunCommand,
    };
    if !registers.iter().any(may_be) {
        let problem = run.problem("no register takes the run commands");
        problems.push(problem.right("a register with `role = \"run-command\"`"));
    }
}

/// Registers of `role` can be written.
fn role_is_writable(role: Role, registers: &[RegisterFile], problems: &mut Vec<Problem>) {
    for register in registers.iter().filter(|it| it.role.usable().is_some_and(|it| it.value == role)) {
        if let Some(access) = register.access.as_ref().filter(|access| !access.value.can_write()) {
            let problem = access.place.problem("a register that commands are written to must be writable");
            problems.push(problem.right("\"write\" or \"read-write\""));
        }
    }
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
